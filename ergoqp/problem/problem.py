"""The terms of one task: the person, the cost, the response, the limits and the settings.

A workspace without a place where a person can hold the object is refused. Only what nobody could
use is: every place is in a region to keep out of, or out of reach of even the tallest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import as_tuple
from ergoqp.coordinates import Coordinates
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ProblemError
from ergoqp.human.body import FRACTIONS
from ergoqp.joints import JOINTS
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, Limit, TwistLimit, WorkspaceBox
from ergoqp.limits.custom import OwnLimits
from ergoqp.limits.keep_out import WayOut
from ergoqp.limits.twist_and_stopping import Stop
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.problem.validate import check_expression, check_kinds, check_pace, judge_terms
from ergoqp.responses import IkResponse, LinearResponse, Response
from ergoqp.sheets.options import TaskOptions, check_by_joint
from ergoqp.sheets.reba import Assessment, Method, assess

if TYPE_CHECKING:
    from ergoqp.costs.cost import Cost

PLACES: Final = 40
"""Number of places that are tried for a start."""

_TALLEST: Final = 2.1
"""Stature of the tallest person who might stand there [m]."""

_STEP: Final = 0.4
"""How far the hips may be from above the origin, where the model person stands or sits [m].

People who step after the object were seen to reach 0.1 m less far than this, see
`ergoqp.lab.people.kinds`.
"""

_MOST_CELLS: Final = 4096
"""A workspace that is left in more parts than this counts as one with room."""

_CORNERS: Final = np.array(list(product((0, 1), repeat=3)), dtype=bool)

Depth = Callable[[np.ndarray], np.ndarray]
"""How deep points (n, 3) are in a region (n,) [m]; negative outside."""


def no_start(notes: Sequence[str]) -> str:
    """Return why none of some places can be a start, from a note on each."""
    words = ", ".join(f"{count} {note}" for note, count in sorted(Counter(notes).items()))
    return (
        f"none of {len(notes)} places of the workspace can be a start ({words}); enlarge the"
        " workspace or loosen the limits"
    )


def no_room(limits: Sequence[Any], response: Any) -> str:
    """Return why no place of the workspace can be used, or an empty text if one may be.

    The workspace is halved until a part of it has a free place in its middle, or every part is in
    one region or out of reach. Both are exact: regions are convex, and reach is judged by the
    nearest point of a part. Regions of users are not judged.

    Args:
        limits: limits of a problem.
        response: its response. Only an `IkResponse` says how far the person reaches.
    """
    box = next((limit for limit in limits if isinstance(limit, WorkspaceBox)), None)
    if box is None:
        return ""
    keep_outs = [limit for limit in limits if isinstance(limit, KeepOut)]
    depths = {limit.name: _depth_of(limit.region) for limit in keep_outs}
    regions = {name: depth for name, depth in depths.items() if depth is not None}
    hips, arm = _reach_of(response)
    lower, upper = _parts(box, [limit.region for limit in keep_outs])
    while len(lower) <= _MOST_CELLS:
        middle = (lower + upper) / 2
        free = _apart(middle, middle, hips) <= arm
        left = _apart(lower, upper, hips) <= arm
        for depth in regions.values():
            corners = np.where(_CORNERS, upper[:, None], lower[:, None])
            free &= depth(middle) < 0
            left &= (depth(corners.reshape(-1, 3)).reshape(-1, 8) < 0).any(axis=1)
        if free.any():
            return ""
        if not left.any():
            break
        lower, upper = _halved(lower[left], upper[left])
    else:
        return ""
    places = np.random.default_rng(0).uniform(box.lower, box.upper, (PLACES, 3))
    notes = np.full(PLACES, "out of reach", dtype=object)
    for name, depth in regions.items():
        notes[(_apart(places, places, hips) <= arm) & (depth(places) >= 0)] = f"in {name}"
    return no_start(notes.tolist())


def _depth_of(region: Any) -> Depth | None:
    """Return the depth in a region of the package, None for one of a user."""
    match region if type(region) in (HalfSpace, Ball, Box) else None:
        case HalfSpace(normal, offset):
            return lambda points: offset - points @ np.array(normal)
        case Ball(centre, radius):
            return lambda points: radius - np.linalg.norm(points - centre, axis=1)
        case Box(lower, upper):
            return lambda points: np.minimum(points - lower, upper - points).min(axis=1)
    return None


def _reach_of(response: Any) -> tuple[float, float]:
    """Return the height of the column in which the hips are, and the reach from there [m].

    Trunk and arm are taken stretched in any direction, which no person can do. They are those of
    the tallest person, or of the model if it is larger still.
    """
    if not isinstance(response, IkResponse):
        return 0.0, np.inf
    most = {
        name: max(share * _TALLEST, response.body.lengths[name])
        for name, share in FRACTIONS.items()
    }
    shoulder = float(np.hypot(most["shoulder_height"], most["shoulder_width"] / 2))
    arm = most["upper_arm"] + most["forearm"] + most["hand"]
    return most["thigh"] + most["shank"] + most["foot_height"], shoulder + arm + _STEP


def _apart(lower: np.ndarray, upper: np.ndarray, hips: float) -> np.ndarray:
    """Return the distance of boxes (n, 3) from the column of the hips (n,) [m]."""
    column = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, hips]])
    return np.linalg.norm(np.maximum(np.maximum(lower - column[1], column[0] - upper), 0), axis=1)


def _parts(box: WorkspaceBox, regions: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return a workspace cut along the faces of box regions, as corners of parts (n, 3)."""
    boxes = [each for each in regions if type(each) is Box]
    corners = [corner for each in boxes for corner in (each.lower, each.upper)]
    ends = [
        np.unique([low, high, *(cut for cut in cuts if low < cut < high)])
        for low, high, *cuts in zip(box.lower, box.upper, *corners, strict=True)
    ]
    pairs = [(each[:-1], each[1:]) if len(each) > 1 else (each, each) for each in ends]
    lower, upper = (
        np.stack(np.meshgrid(*(pair[side] for pair in pairs), indexing="ij"), axis=-1)
        for side in (0, 1)
    )
    return lower.reshape(-1, 3), upper.reshape(-1, 3)


def _halved(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the eight parts of each box (n, 3), halved along every axis."""
    middle = ((lower + upper) / 2)[:, None]
    below, above = lower[:, None], upper[:, None]
    return (
        np.where(_CORNERS, middle, below).reshape(-1, 3),
        np.where(_CORNERS, above, middle).reshape(-1, 3),
    )


_AVERAGE: Final = 0.05

_NARROWEST: Final = 1e-5
"""Smallest width of a workspace: no object is measured or held more exactly [m]."""


_ROOM: Final = 1e-3
"""Distance from the ends of the workspace that a way out of a region leads to [m]."""


@dataclass(frozen=True)
class Problem:
    """One task, made in Python; `ergoqp.load_problem` makes the same from a file.

    Attributes:
        cost: cost of the state, V(q), see `ergoqp.costs`.
        response: how the state follows the object, S(q), see `ergoqp.responses`.
        limits: the limits, with exactly one `TwistLimit` among them.
        dt: control period [s].
        control: settings of the step: how fast and how far the object moves.
        robot: declared delays and errors of the robot.
        frames: where the robot's base, the tool in its flange and the camera are.
        task: what joint angles cannot tell (load, coupling ...), as keywords of
            `ergoqp.reba.assess`. The stance of the response says whether the person sits.
        method: options of the exact sheet, where implementations disagree.
        name: short name, a word.
        title: the task in a few words.

    Raises:
        ProblemError: if terms are missing, unknown or contradict each other; the message names the
            first mistake.

    Example:
        >>> import ergoqp
        >>> from ergoqp.costs.smooth_reba import SmoothReba
        >>> problem = ergoqp.load_problem("screwing")
        >>> slow = problem.replace(dt=0.02, cost=SmoothReba(load_kg=6.0))
        >>> slow.dt, slow.cost.minimum
        (0.02, 1.0)
        >>> int(slow.assess(slow.response.comfort).final[0])
        1
    """

    cost: Cost
    response: Response
    limits: Sequence[Limit | TwistLimit]
    dt: float = 0.01
    control: Control = field(default_factory=Control)
    robot: DeclaredRobot = field(default_factory=DeclaredRobot)
    frames: Frames = field(default_factory=Frames)
    task: TaskOptions = field(default_factory=TaskOptions)
    method: Method = field(default_factory=Method)
    name: str = "custom"
    title: str = ""

    def __post_init__(self) -> None:
        """Check that the terms are valid and fit together."""
        object.__setattr__(self, "limits", as_tuple("limits", self.limits, ProblemError))
        check_kinds(self)
        check_by_joint(self.method, "problem")
        self._check_state()
        check_expression(self.cost, len(self.coordinates))
        count = sum(isinstance(limit, TwistLimit) for limit in self.limits)
        if count != 1:
            raise ProblemError(f"limits: got {count} twist limits, allowed exactly one")
        names = [name for limit in self.row_limits for name in limit.names]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            regions = any(isinstance(limit, KeepOut) for limit in self.row_limits)
            hint = " (a KeepOut takes a `name`)" if regions else ""
            raise ProblemError(
                f"limits: got more than one row named {', '.join(doubled)}, allowed one each{hint}"
            )
        self._check_room()
        if nowhere := no_room(self.limits, self.response):
            raise ProblemError(f"limits: {nowhere}")
        self.own_limits.judge()
        check_pace(self.own_times, self.dt)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the entries of `posture`."""
        return tuple(self.response.coordinates)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that the object can move; the others stay as measured."""
        return self.response.joints

    @cached_property
    def twist_limit(self) -> TwistLimit:
        """The bounds on the twist, less the acceleration that a surface needs."""
        limit = next(limit for limit in self.limits if isinstance(limit, TwistLimit))
        return limit if self.surface is None else replace(limit, aside=self.surface.aside(limit))

    @cached_property
    def surface(self) -> Any:
        """The limit that is an equality, see `ergoqp.limits.limit.Surface`, or None."""
        return next((each for each in self.limits if getattr(each, "equality", False)), None)

    @cached_property
    def row_limits(self) -> tuple[Limit, ...]:
        """The limits that have rows: all but the `TwistLimit`."""
        return tuple(limit for limit in self.limits if not isinstance(limit, TwistLimit))

    @cached_property
    def own_limits(self) -> OwnLimits:
        """The limits that are judged by their rows only, see `ergoqp.limits.custom`."""
        return OwnLimits(self.row_limits, len(self.coordinates), self.surface)

    @cached_property
    def way_out(self) -> WayOut | None:
        """The way out of regions to keep out of, or None without a region that can be left."""
        box, moves = self.limit_of(WorkspaceBox), self.twist_limit.speed[:3] > 0
        room = self._rises + _ROOM
        return WayOut.of(self.row_limits, box, room, moves, self.robot.noise[:3])

    @cached_property
    def own_times(self) -> dict[str, float]:
        """How long a user's cost and response take [s], see `ergoqp.problem.validate`."""
        return judge_terms(self.cost, self.response)

    @cached_property
    def stop(self) -> Stop:
        """The law by which the object stops."""
        robot = self.robot
        hold, memory = robot.longest_hold, self.average + robot.dead_time + robot.lag
        return Stop(self.twist_limit, self.average, 3 * self.dt, 1 + robot.gain_error, hold, memory)

    @cached_property
    def row_names(self) -> tuple[str, ...]:
        """Name of every row, in the order of `Step.margins`."""
        return tuple(name for limit in self.row_limits for name in limit.names)

    def assess(self, postures: ArrayLike) -> Assessment:
        """Return the exact assessment of postures (n, 32) [rad] for this task."""
        return assess(postures, self.method, **self.task)

    @property
    def moves_pose(self) -> bool:
        """Whether the twist moves an object that a person holds; False: it moves the state."""
        return tuple(self.response.coordinates) == JOINTS

    @cached_property
    def average(self) -> float:
        """Time over which the planned twist is averaged [s], see `Control.average`."""
        given = self.control.average
        return (_AVERAGE if self.moves_pose else 0.0) if given is None else given

    @property
    def longest_period(self) -> float:
        """Longest period of a step [s]: a step with a longer one brakes."""
        return max(3 * self.dt, self.robot.longest_hold)

    def _check_state(self) -> None:
        """Check that limits and cost depend on the state that the response moves."""
        state = tuple(self.response.coordinates)
        if not self.moves_pose:
            for what, given in (
                ("robot", self.robot.declared),
                ("frames", self.frames != Frames()),
                ("control.average", bool(self.control.average)),
            ):
                if given:
                    raise ProblemError(
                        f"{what}: got one, allowed only where an object that a person holds is"
                        " moved"
                    )
        for limit in self.limits:
            needs = getattr(limit, "state", None)
            commanded = not getattr(limit, "commanded", False) or _is_identity(self.response)
            if needs is not None and (state != needs or not commanded):
                named = getattr(limit, "name", None)
                what = f"a {type(limit).__name__}" if named is None else repr(named)
                known = "a person's posture" if needs == JOINTS else ", ".join(needs)
                raise ProblemError(f"limits: got {what}, allowed only where the state is {known}")
        if isinstance(self.cost, SmoothReba) and state != JOINTS:
            raise ProblemError(
                "cost: got the sheet, allowed a learned cost where the state is not a person's"
                " posture"
            )
        self._check_seat()
        for what, term in (("cost", self.cost), *(("limits", limit) for limit in self.limits)):
            reads = getattr(term, "coordinates", None) or getattr(
                getattr(term, "model", None), "coordinates", None
            )
            if isinstance(reads, Coordinates) and reads.state != state:
                known = "the 32 joints" if state == JOINTS else ", ".join(state)
                raise ProblemError(
                    f"{what}: got a model of {', '.join(reads.names[:3])} ..., allowed one of"
                    f" {known}"
                )

    def _check_seat(self) -> None:
        """Check that task and cost agree with the stance whether the person sits.

        A task that does not say it gets it from the stance.
        """
        stance = getattr(self.response, "stance", None)
        if stance is None:
            return
        sits = stance == "seated"
        object.__setattr__(self, "task", TaskOptions(**{"seated": sits, **self.task}))
        for what, told in (("task", self.task), ("cost", getattr(self.cost, "task", {}))):
            if bool(told.get("seated", sits)) != sits:
                raise ProblemError(
                    f"{what}: got seated = {not sits}, allowed {sits}, because the stance is"
                    f" {stance}"
                )

    @property
    def _rises(self) -> np.ndarray:
        """Distance (3,) from an end that a mean may need for its rise [m]."""
        return np.array(self.stop.most(self.dt))[:3, 0] if self.average else np.zeros(3)

    def _check_room(self) -> None:
        """Check that the workspace leaves room to move and stop along the object's movable axes."""
        box = self.limit_of(WorkspaceBox)
        if box is None:
            return
        for axis, rise in enumerate(self._rises.tolist()):
            width = box.upper[axis] - box.lower[axis]
            least = max(_NARROWEST, rise) + 2 * self.robot.pose_noise
            if self.twist_limit.speed[axis] > 0 and width < least:
                name = "xyz"[axis]
                raise ProblemError(
                    f"workspace {name}: got {1e3 * width:.3g} mm from end to end, allowed at least"
                    f" {1e3 * least:.3g} mm where the object can move along {name}, or a twist"
                    f" limit whose axes leave {name} out"
                )

    def limit_of(self, kind: type) -> Any:
        """Return the limit of a kind, or None."""
        return next((limit for limit in self.limits if isinstance(limit, kind)), None)

    def replace(self, **terms: Any) -> Problem:
        """Return a new problem with other terms, for example ``problem.replace(cost=...)``.

        Raises:
            ProblemError: if a name is not the name of a term.
        """
        if unknown := set(terms) - set(self.__dataclass_fields__):
            raise ProblemError(
                f"replace: got {sorted(unknown)}, allowed {sorted(self.__dataclass_fields__)}"
            )
        return replace(self, **terms)


def _is_identity(response: Response) -> bool:
    return isinstance(response, LinearResponse) and np.array_equal(
        np.asarray(response.matrix), np.eye(6)
    )
