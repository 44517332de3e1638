"""Where base and flange are, from rests of one person: posture, and pose as the robot reports it.

The unknown frames, the stature and the bias of the angles minimise the distance between the contact
frame that the robot's pose gives and the one that the posture gives, over all rests, plus the
deviation of the person from people in general. The turn about the tool's axis does not count where
the grasp leaves it free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Any, Final

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from ergoqp.arguments import check_kind, names_of
from ergoqp.errors import InputError
from ergoqp.expressions import turned
from ergoqp.identification.loops import rests_in, rests_of, watched
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames

_FEWEST: Final = 3
"""Rests below this number determine nothing."""

_OFF: Final = (0.03, 0.08)
"""What no bias explains at one rest [m], [rad]."""

_WILD: Final = (0.12, 3.0)
"""A rest is left out if it is off by more than this [m], and by this multiple of the median."""

_STATURE, _BIAS = 0.08 / 1.75, float(np.radians(5.0))
"""Standard deviations of people: of every length, as a share, and of every angle's error [rad]."""

_WIDE: Final = 3.0
"""Standard deviation of the unknown frames [m], [rad]: no robot stands further away."""

_UNSURE: Final = (0.15, 15.0)
"""From these standard deviations on a frame counts as not determined [m], [deg]."""

_UNFIT: Final = 0.05
"""From this median residual on, posture and pose are not of the same rests [m].

Of simulated people who stood still it was up to 0.03, of exchanged rests 0.05 to 0.3.
"""

_STARTS: Final = 6


@dataclass(frozen=True, eq=False)
class CalibratedFrames(Frames):
    """Frames that were found from rests, and how well.

    Attributes:
        spread: how far one used rest is from the mean `offset` at most [m].
        spread_deg: the same of the tool's axis, from where the model's person has it [deg].
        rests: number of rests that were used.
        left_out: numbers of those that do not fit to the others and were left out.
        residual: what frames, stature and bias leave unexplained at each used rest (n,) [m].
        unsure: standard deviation of each unknown: ``base_m``, ``base_deg``, ``flange_m``,
            ``flange_deg`` [m, deg].
        undetermined: a sentence for each frame that these rests do not determine; its value is
            only good near these rests. And one if postures and poses do not fit to each other.

    Example:
        >>> import numpy as np
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> drawn = np.random.default_rng(0).normal(size=(6, 32))
        >>> postures = problem.response.comfort + 0.3 * drawn
        >>> contact = problem.response.contact()
        >>> rests = [(posture, contact(posture)[0].full()) for posture in postures]
        >>> found = ergoqp.calibrate_frames(problem, rests)
        >>> bool(found.residual.max() < 0.01), found.rests
        (True, 6)
    """

    rests: int = 0
    left_out: tuple[int, ...] = ()
    residual: Any = ()
    unsure: Any = None
    undetermined: tuple[str, ...] = ()


def calibrate_frames(problem: Problem, rests: Any, known: Sequence[str] = ()) -> CalibratedFrames:
    """Return base and flange that fit the rests of one person, for ``problem.replace(frames=)``.

    The step then compares posture and pose sharply, for this person: by how far these rests are
    apart at most. For somebody else calibrate again, or use ``Frames(found.base, found.flange)``.

    Args:
        problem: the task. Its model of the person is the assumption about them, and its frames are
            those that are `known`.
        rests: three or more pairs of a posture (32,) [rad] at rest and the pose (4, 4) [m] of the
            flange in the base, as the robot reports it; or a stepper's log. Ten places with the
            object turned by 30 degrees and more determine most.
        known: ``"base"`` or ``"flange"``, if the frames of the problem are right there.

    Raises:
        InputError: if there are fewer than three rests, one cannot be read or has angles beyond
            what a person can do, a joint that the contact depends on was not seen, or `known` names
            something else.

    Source:
        Robot-world and hand-eye calibration, AX = YB: Zhuang, Roth and Sudhakar (1994); solved
        together with the person's errors, by nonlinear least squares.

    Example:
        >>> import numpy as np
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> true = ergoqp.Frames(base=[0.9, 0.2, 0.5, 0, 0, 1, 0])
        >>> drawn = np.random.default_rng(1).normal(size=(8, 32))
        >>> postures = problem.response.comfort + 0.3 * drawn
        >>> contact = problem.response.contact()
        >>> rests = [(q, true.reported_pose(contact(q)[0].full())) for q in postures]
        >>> found = ergoqp.calibrate_frames(problem, rests, known=["flange"])
        >>> found.base[:3, 3].round(2).tolist()
        [0.9, 0.2, 0.5]
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    if not problem.moves_pose:
        raise InputError(f"problem {problem.name}: has no person, allowed one with a person")
    empty = isinstance(known, (tuple, list)) and not known
    kept = () if empty else names_of("known", known, "a list of 'base' and 'flange'")
    if not set(kept) <= {"base", "flange"}:
        raise InputError(f"known: got {', '.join(kept)}, allowed a list of 'base' and 'flange'")
    loop = watched(rests)
    found = rests_of(rests) if loop is None else rests_in(loop)
    if len(found) < _FEWEST:
        raise InputError(f"rests: got {len(found)}, allowed at least {_FEWEST}")
    postures, largest = np.array([rest.posture for rest in found]), problem.response.largest
    for number, joint in np.argwhere(np.abs(postures) > largest):
        name, angle = problem.coordinates[joint], postures[number, joint]
        raise InputError(
            f"rests[{number}]: posture: got {name} = {angle:.4g} rad, allowed up to"
            f" {largest:.3g} rad: is it in degrees?"
        )
    poses = np.array([rest.pose for rest in found])
    used, left_out = list(range(len(found))), list[int]()
    while True:
        frames = _Fit(problem, postures[used], poses[used], kept).solved(tuple(left_out))
        worst = int(np.argmax(frames.residual))
        usual = max(_WILD[0], _WILD[1] * float(np.median(frames.residual)))
        if frames.residual[worst] <= usual or len(left_out) + 1 > len(found) - _FEWEST:
            return frames
        left_out.append(used.pop(worst))


class _Fit:
    """The least squares of one calibration."""

    def __init__(
        self, problem: Problem, postures: np.ndarray, poses: np.ndarray, known: Sequence[str]
    ) -> None:
        self.problem, self.postures, self.poses, self.known = problem, postures, poses, known
        contact = problem.response.contact()
        self.contacts = np.array([contact(q)[0].full() for q in np.nan_to_num(postures)])
        self.joints = sorted(set(contact.jac_sparsity(0, 0).get_triplet()[1]))
        if not np.isfinite(postures[:, self.joints]).all():
            raise InputError(
                "rests: got one in which a joint between floor and hand was not seen, allowed rests"
                " in which all are"
            )
        self.postures = np.nan_to_num(postures)
        # The turn about the tool's axis says nothing where the grasp leaves it free.
        self.axes = 1 if getattr(problem.response, "free_about_tool", True) else 2
        self._moved = _mover()
        self._residual, self._slope = self._functions(contact)

    def _functions(self, contact: ca.Function) -> tuple[ca.Function, ca.Function]:
        """Return ``(unknowns, base, flange) -> residuals`` and their derivative.

        The unknowns turn and shift base and flange from where they are given (12,), and are the
        growth of the person and the bias of the joints.
        """
        unknown = ca.MX.sym("unknown", 13 + len(self.joints))
        start = [ca.MX.sym("base", 4, 4), ca.MX.sym("flange", 4, 4)]
        posture, pose = ca.MX.sym("posture", self.postures.shape[1]), ca.MX.sym("pose", 4, 4)
        bias = ca.MX(self.postures.shape[1], 1)
        bias[self.joints] = unknown[13:]
        there = contact(posture - bias)[0]
        base, flange = (
            self._moved(frame, unknown[6 * i : 6 * i + 6]) for i, frame in enumerate(start)
        )
        apart = base @ pose @ flange
        parts = [(apart[:3, 3] - (1 + unknown[12]) * there[:3, 3]) / _OFF[0]]
        parts += [(apart[:3, i] - there[:3, i]) / _OFF[1] for i in range(self.axes)]
        one = ca.Function("rest", [posture, pose, unknown, *start], [ca.vertcat(*parts)])
        rests = [one(q, x, unknown, *start) for q, x in zip(self.postures, self.poses, strict=True)]
        widths = np.r_[np.full(12, _WIDE), _STATURE, np.full(len(self.joints), _BIAS)]
        residual = ca.vertcat(*rests, unknown / widths)
        inputs = [unknown, *start]
        return (
            ca.Function("residual", inputs, [residual]),
            ca.Function("slope", inputs, [ca.jacobian(residual, unknown)]),
        )

    def solved(self, left_out: tuple[int, ...]) -> CalibratedFrames:
        """Return the frames with the least squares, from several starts."""
        given = self.problem.frames
        free = np.array([name not in self.known for name in ("base", "flange") for _ in range(6)])
        free = np.r_[free, np.ones(1 + len(self.joints), dtype=bool)]
        tried = [self._search(start, free) for start in self._starts()]
        _, value, start = min(tried, key=lambda each: each[0])
        base, flange = (
            np.array(self._moved(frame, value[6 * i : 6 * i + 6])) for i, frame in enumerate(start)
        )
        count = (3 + 3 * self.axes) * len(self.poses)
        left = np.array(self._residual(value, *start)).ravel()[:count].reshape(len(self.poses), -1)
        frames = Frames(base, flange)
        apart = np.array([frames.contact_pose(pose) for pose in self.poses])
        shift = apart[:, :3, 3] - self.contacts[:, :3, 3]
        axis = np.linalg.norm(apart[:, :3, 0] - self.contacts[:, :3, 0], axis=1)
        offset = shift.mean(axis=0)
        # From there, so that the turn about the tool's axis is an unknown of its own.
        value[:12] = 0.0
        unsure = self._unsure(np.array(self._slope(value, base, flange))[:, free], free)
        residual = np.linalg.norm(left[:, :3], axis=1) * _OFF[0]
        return CalibratedFrames(
            base=base,
            flange=flange,
            camera=given.camera,
            offset=offset,
            spread=float(np.linalg.norm(shift - offset, axis=1).max()),
            spread_deg=float(np.degrees(2 * np.arcsin(np.minimum(axis / 2, 1))).max()),
            compare=given.compare,
            rests=len(self.poses),
            left_out=left_out,
            residual=residual,
            unsure=unsure,
            undetermined=(*_sentences(unsure), *_misfit(float(np.median(residual)))),
        )

    def _search(
        self, start: tuple[np.ndarray, np.ndarray], free: np.ndarray
    ) -> tuple[float, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Return cost and unknowns of the least squares from one start, and the start."""
        value = np.zeros(len(free))

        def with_known(call: ca.Function) -> Callable[[np.ndarray], np.ndarray]:
            def evaluate(some: np.ndarray) -> np.ndarray:
                value[free] = some
                return np.array(call(value, *start))

            return evaluate

        residual, slope = with_known(self._residual), with_known(self._slope)
        found = least_squares(
            lambda some: residual(some).ravel(),
            np.zeros(int(free.sum())),
            lambda some: slope(some)[:, free],  # pyright: ignore[reportArgumentType]
            max_nfev=60,
        )
        value[free] = found.x
        return float(found.cost), value, start

    def _starts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return base and flange for the most promising orientations of the base."""
        given = self.problem.frames
        turns = [given.base[:3, :3], *(() if "base" in self.known else _cube())]
        tried = []
        for turn in turns:
            flange_turns = turn @ self.poses[:, :3, :3]
            # The tool's axis in the flange, and both shifts, are linear where the turn is known.
            tool = np.einsum("nji,nj->i", flange_turns, self.contacts[:, :3, 0])
            rows = np.concatenate(
                [flange_turns, np.broadcast_to(np.eye(3), flange_turns.shape)], axis=2
            ).reshape(-1, 6)
            right = self.contacts[:, :3, 3] - self.poses[:, :3, 3] @ turn.T
            shifts = np.linalg.lstsq(rows, right.ravel(), rcond=1e-3)[0]
            base, flange = np.eye(4), np.eye(4)
            base[:3, :3], base[:3, 3], flange[:3, 3] = turn, shifts[3:], shifts[:3]
            flange[:3, :3] = self._flange_turn(tool, flange_turns)
            if "base" in self.known:
                base = given.base
            if "flange" in self.known:
                flange = given.flange
            cost = np.sum(np.array(self._residual(0, base, flange)) ** 2)
            tried.append((float(cost), base, flange))
        tried.sort(key=lambda each: each[0])
        return [(base, flange) for _, base, flange in tried[:_STARTS]]

    def _flange_turn(self, tool: np.ndarray, flange_turns: np.ndarray) -> np.ndarray:
        """Return the contact frame's rotation in the flange, with x along `tool` (3,)."""
        # The nearest rotation to the mean one; its x is then turned to the tool's axis.
        mean = np.einsum("nji,njk->ik", flange_turns, self.contacts[:, :3, :3])
        x = tool / max(float(np.linalg.norm(tool)), 1e-12)
        y = mean[:, 1] - x * (x @ mean[:, 1])
        if np.linalg.norm(y) < 1e-9:
            y = np.cross(x, [1.0, 0.0, 0.0] if abs(x[0]) < 0.9 else [0.0, 1.0, 0.0])
        y /= np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])

    def _unsure(self, slope: np.ndarray, free: np.ndarray) -> dict[str, float]:
        """Return the standard deviation of each unknown frame [m, deg]."""
        variance = np.zeros(len(free))
        variance[free] = np.diag(np.linalg.inv(slope.T @ slope))
        if self.axes == 1:
            variance[6] = 0.0  # the turn about the tool's axis is not asked for
        each = np.sqrt(np.maximum(variance[:12], 0)).reshape(4, 3).max(axis=1)
        names = ("base_deg", "base_m", "flange_deg", "flange_m")
        each[::2] = np.degrees(each[::2])
        return dict(zip(names, each.tolist(), strict=True))


def _mover() -> ca.Function:
    """Return ``(frame (4, 4), by (6,)) -> frame``, turned and shifted about its own axes."""
    frame, by = ca.SX.sym("frame", 4, 4), ca.SX.sym("by", 6)
    change = ca.vertcat(ca.horzcat(turned(by[:3], ca.SX.eye(3)), by[3:]), ca.SX([[0, 0, 0, 1]]))
    return ca.Function("moved", [frame, by], [ca.densify(frame @ change)])


def _sentences(unsure: dict[str, float]) -> list[str]:
    """Return a sentence for each frame that the rests do not determine."""
    found = []
    for name in ("base", "flange"):
        shift, turn = unsure[f"{name}_m"], unsure[f"{name}_deg"]
        if shift > _UNSURE[0] or turn > _UNSURE[1]:
            found.append(
                f"{name}: known to {shift:.2f} m and {turn:.0f} deg only, the rests are too"
                " similar: add places further apart, with the object turned by 30 deg and more"
            )
    return found


def _misfit(residual: float) -> list[str]:
    """Return a sentence if the rests are this far [m] from what any frames explain."""
    if residual <= _UNFIT:
        return []
    return [
        f"rests: posture and pose are {residual:.2f} m apart in the median with the best frames,"
        f" allowed {_UNFIT:g} m: are they of the same moments, did the person stay where they"
        " stood, and is the pose that of the flange?"
    ]


def _cube() -> list[np.ndarray]:
    """Return the 24 rotations (3, 3) of a cube."""
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.diag(signs)[list(order)]
        if np.linalg.det(turn) > 0:
            found.append(turn)
    return found
