"""Bodies, habits and tasks of people: proportions, favourite postures, points of the body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import mujoco
import numpy as np

from ergoqp.human import Body
from ergoqp.human.body import FRACTIONS
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.problem.geometry import rotation_vector
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import person_of

BASE = 4
"""Number of entries before the joints: pelvis x, y, z [m] and yaw [rad]."""

_NOWHERE = np.eye(4)

_UNMOVED_BY_BALANCE = ("neck", "shoulder", "elbow", "forearm", "wrist")
"""Joints that do not help to balance: neck and arms."""


class BodyTasks:
    """Kinematics of a body at a placement.

    A placement is pelvis x, y, z [m], yaw [rad], then the 32 joints [rad]: (36,).

    Args:
        body: the body.
    """

    def __init__(self, body: Body) -> None:
        """Load the model of the body."""
        self.model = body.model
        self._data = mujoco.MjData(self.model)
        self._sites = {self.model.site(number).name: number for number in range(self.model.nsite)}
        self._feet = [self._sites[f"{side}_{end}"] for side in SIDES for end in ("heel", "toe")]
        self._pelvis = self.model.body("pelvis").id
        self.size = BASE + len(JOINTS)
        self.lower = np.concatenate([np.full(BASE, -np.inf), LOWER])
        self.upper = np.concatenate([np.full(BASE, np.inf), UPPER])
        helps = [not any(part in joint for part in _UNMOVED_BY_BALANCE) for joint in JOINTS]
        self._balances = np.concatenate([np.ones(BASE), helps])

    def place(self, placement: np.ndarray) -> None:
        """Set the placement (36,). All other methods refer to it."""
        self._data.qpos[:] = placement
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)

    def frame(self, site: str) -> np.ndarray:
        """Return the pose (4, 4) of a site in the world."""
        number, pose = self._sites[site], _NOWHERE.copy()
        pose[:3, :3] = self._data.site_xmat[number].reshape(3, 3)
        pose[:3, 3] = self._data.site_xpos[number]
        return pose

    def point(self, site: str) -> np.ndarray:
        """Return the position of a site in the world (3,) [m]."""
        return self._data.site_xpos[self._sites[site]].copy()

    def toward(self, site: str, want: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the motion (6,) of a site to a pose (4, 4), and its `jacobian`."""
        number, way = self._sites[site], np.empty(6)
        way[:3] = want[:3, 3] - self._data.site_xpos[number]
        way[3:] = rotation_vector(self._data.site_xmat[number].reshape(3, 3), want[:3, :3])
        return way, self.jacobian(site)

    def jacobian(self, site: str) -> np.ndarray:
        """Return how a site moves with the placement (6, 36): world-aligned, linear first."""
        moves = np.empty((6, self.size))
        mujoco.mj_jacSite(self.model, self._data, moves[:3], moves[3:], self._sites[site])
        return moves

    def mass_centre(self) -> tuple[list[float], np.ndarray]:
        """Return the centre of mass over the floor (2,) [m], and how it moves (2, 36).

        Neck and arms move it too, but they are not moved for its sake.
        """
        moves = np.empty((3, self.size))
        mujoco.mj_jacSubtreeCom(self.model, self._data, moves, self._pelvis)
        return self._data.subtree_com[self._pelvis, :2].tolist(), moves[:2] * self._balances

    def feet(self) -> list[list[float]]:
        """Return the positions of heel and toe of each foot (4, 3) [m]."""
        return self._data.site_xpos[self._feet].tolist()

    def step_within(
        self, placement: np.ndarray, hessian: np.ndarray, pull: np.ndarray, mobile: np.ndarray
    ) -> np.ndarray:
        """Return the Newton step (36,) of mobile entries; others stop at the end of their range.

        Args:
            placement: placement before the step (36,).
            hessian: (36, 36).
            pull: right side of the Newton equation (36,).
            mobile: entries that may move (36,) bool.
        """
        lower, upper = self.lower - placement, self.upper - placement
        step = np.zeros(len(pull))
        for _ in range(4):
            if mobile.all():
                # The usual case: no joint is at the end of its range, so all entries move.
                step = _solved(hessian, pull)
            else:
                free = np.flatnonzero(mobile)
                left = pull[free] - hessian[free] @ np.where(mobile, 0.0, step)
                step[free] = _solved(hessian[free[:, None], free], left)
            beyond = mobile & ((step < lower) | (step > upper))
            if not beyond.any():
                return step
            step = np.where(beyond, np.minimum(np.maximum(step, lower), upper), step)
            mobile = mobile & ~beyond
        return step

    def standing(self, posture: np.ndarray) -> np.ndarray:
        """Return the placement (36,) of a posture (32,) with the world's origin between the soles.

        x is along their mean heading.
        """
        placement = np.concatenate([np.zeros(BASE), posture])
        self.place(placement)
        soles = [self.frame(f"{side}_sole") for side in SIDES]
        heading = soles[0][:3, 0] + soles[1][:3, 0]
        yaw = -np.arctan2(heading[1], heading[0])
        middle = (soles[0][:3, 3] + soles[1][:3, 3]) / 2
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        placement[:2], placement[2], placement[3] = -turn @ middle[:2], -middle[2], yaw
        self.place(placement)
        return placement

    def seated(self, posture: np.ndarray, height: float) -> np.ndarray:
        """Return the placement (36,) of a posture (32,) on a seat [m] above the origin."""
        placement = np.concatenate([[0.0, 0.0, height, 0.0], posture])
        self.place(placement)
        return placement

    def leg_height(self, posture: np.ndarray) -> float:
        """Return the height of the hip centres at which the lower sole is on the floor [m]."""
        self.place(np.concatenate([np.zeros(BASE), posture]))
        return -min(self.frame(f"{side}_sole")[2, 3] for side in SIDES)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the solution (n,) with a small positive definite matrix (n, n). It is called often."""
    factor, solution = matrix.copy(), np.empty(len(right))
    mujoco.mju_cholFactor(factor, 0.0)
    mujoco.mju_cholSolve(solution, factor, right)
    return solution


AXIS: Final = {"along": (1.0, 0.0, 0.0), "thumb": (0.0, 0.0, 1.0)}
"""The tool axis in the frame of a grip: out of the fist, or past the thumb."""


@dataclass(frozen=True)
class Work:
    """A problem's description of how the object is held, independent of the person.

    Attributes:
        hands: hands that hold the object.
        stance: ``"standing"`` or ``"seated"``.
        seat_height: height of the hip centres when seated [m]; None: adapted to the person.
        tool: axis of the tool in the hand.
        free_about_tool: whether the hand may turn about it.
    """

    hands: tuple[str, ...]
    stance: str
    seat_height: float | None
    tool: str
    free_about_tool: bool

    @classmethod
    def of(cls, problem: Problem) -> Work:
        """Return the work of a problem.

        Raises:
            InputError: if its response is not an `IkResponse`.
        """
        said = person_of(problem)
        return cls(said.hands, said.stance, said.seat_height, said.tool, said.free_about_tool)

    def contact(self, grips: Sequence[np.ndarray]) -> np.ndarray:
        """Return the contact frame of the object (4, 4) for the grips of the hands (4, 4) each."""
        return contact_of(grips, self.tool)


def contact_of(grips: Sequence[np.ndarray], tool: str) -> np.ndarray:
    """Return the contact frame (4, 4) [m] for grips (4, 4) each. Its x axis is the tool axis.

    One hand: it is at the grip. Two hands: it is midway, y points from the right grip to the
    left one, and x is as close as possible to the mean of the two tool axes.
    """
    frame = np.eye(4)
    frame[:3, 3] = np.mean([grip[:3, 3] for grip in grips], axis=0)
    x = np.sum([grip[:3, :3] @ AXIS[tool] for grip in grips], axis=0)
    if len(grips) == 1:
        frame[:3, 0], frame[:3, 1] = x, grips[0][:3, 1]
    else:
        y = grips[1][:3, 3] - grips[0][:3, 3]
        frame[:3, 1] = y / np.linalg.norm(y)
        x = x - frame[:3, 1] * (frame[:3, 1] @ x)
        frame[:3, 0] = x / np.linalg.norm(x)
    frame[:3, 2] = np.cross(frame[:3, 0], frame[:3, 1])
    return frame


Sex = Literal["female", "male"]

STATURES: Final = (1.50, 1.95)
"""Least and greatest drawn stature [m]."""

_POPULATION: Final[dict[Sex, tuple[float, float]]] = {
    "female": (1.63, 0.065),
    "male": (1.76, 0.070),
}
"""Mean and standard deviation of statures [m], similar to anthropometric surveys of adults."""

_BUILD: Final = (20.0, 30.0)
"""Least and greatest mass per squared stature [kg/m^2]."""

_PROPORTIONS: Final = 0.03
"""Standard deviation of the length of a segment, as a share of it."""

_WIDTHS: Final[dict[Sex, dict[str, float]]] = {
    "female": {"shoulder_width": 0.95, "hip_width": 1.06},
    "male": {"shoulder_width": 1.03, "hip_width": 0.98},
}
"""Widths of each sex relative to the mean of both."""


def draw_body(rng: np.random.Generator) -> tuple[Sex, Body]:
    """Return sex and body, with a stature within `STATURES` and drawn build and proportions."""
    sex: Sex = "male" if rng.integers(2) else "female"
    stature = float(np.clip(rng.normal(*_POPULATION[sex]), *STATURES))
    mass = float(rng.uniform(*_BUILD)) * stature**2
    lengths = {}
    for name, fraction in FRACTIONS.items():
        usual = fraction * stature * _WIDTHS[sex].get(name, 1.0)
        lengths[name] = usual * float(np.clip(rng.normal(1.0, _PROPORTIONS), 0.9, 1.1))
    return sex, Body(stature, lengths, mass)


def generators(kind: str, problem: str, seed: int) -> Iterator[np.random.Generator]:
    """Yield the generators for body, habits and senses of a person.

    With another body the other properties stay the same. Every kind has its own people.

    Args:
        kind: kind of the person.
        problem: name of the problem.
        seed: seed of the person.
    """
    said = [seed, *kind.encode(), 0, *problem.encode()]
    return (np.random.default_rng([*said, part]) for part in range(3))


_EASE: Final[Mapping[str, tuple[float, float]]] = {
    "trunk_flexion": (3.0, 4.0),
    "trunk_side_bend": (0.0, 2.0),
    "trunk_twist": (0.0, 2.0),
    "neck_flexion": (9.0, 5.0),
    "neck_side_bend": (0.0, 2.0),
    "neck_twist": (0.0, 3.0),
    "shoulder_flexion": (12.0, 8.0),
    "shoulder_abduction": (8.0, 5.0),
    "shoulder_rotation": (4.0, 8.0),
    "elbow_flexion": (75.0, 12.0),
    "forearm_pronation": (12.0, 15.0),
    "wrist_flexion": (-6.0, 6.0),
    "wrist_deviation": (2.0, 4.0),
}
"""Mean and standard deviation of the upper body's angles at ease, with the hands at work [deg]."""

_LEGS: Final[Mapping[str, Mapping[str, tuple[float, float]]]] = {
    "standing": {
        "hip_flexion": (5.0, 0.0),
        "hip_abduction": (3.0, 1.5),
        "knee_flexion": (10.0, 0.0),
        "ankle_flexion": (5.0, 0.0),
    },
    "seated": {"hip_flexion": (84.0, 3.0), "knee_flexion": (84.0, 3.0)},
}
"""The same for the legs."""

_FREE_ARM: Final[Mapping[str, Mapping[str, float]]] = {
    "standing": {"shoulder_flexion": 4.0, "shoulder_abduction": 6.0, "elbow_flexion": 12.0},
    "seated": {"shoulder_flexion": 14.0, "shoulder_abduction": 6.0, "elbow_flexion": 68.0},
}
"""Posture of an arm that holds nothing [deg]: it hangs, or lies on the thigh."""

_SPREAD: Final[Mapping[str, float]] = {
    "trunk_flexion": 11.0,
    "trunk_side_bend": 7.0,
    "trunk_twist": 9.0,
    "neck_flexion": 12.0,
    "neck_side_bend": 8.0,
    "neck_twist": 16.0,
    "shoulder_flexion": 20.0,
    "shoulder_abduction": 13.0,
    "shoulder_rotation": 22.0,
    "elbow_flexion": 30.0,
    "forearm_pronation": 32.0,
    "wrist_flexion": 16.0,
    "wrist_deviation": 10.0,
    "hip_flexion": 20.0,
    "hip_abduction": 9.0,
    "hip_rotation": 9.0,
    "knee_flexion": 18.0,
    "ankle_flexion": 14.0,
    "ankle_inversion": 9.0,
}
"""Deviation from ease at which every joint has the same cost [deg]."""

_OWN_SPREAD: Final = (0.6, 1.7)
"""Range of the factor on it, drawn log-uniformly per person and joint."""


@dataclass(frozen=True)
class PersonParameters:
    """Preferred posture and stiffness of one person.

    Attributes:
        comfort: posture at ease (32,) [rad].
        spread: deviation from it at which every joint has the same cost (32,) [rad].
        relaxation: time constant of coming to rest [s].
        lean: preferred distance of the centre of mass ahead of the middle of the feet [m].
        steadiness: deviation of the centre of mass with the same cost as a joint that moves by
            `spread` [m].
    """

    comfort: np.ndarray
    spread: np.ndarray
    relaxation: float
    lean: float
    steadiness: float


def draw_habits(work: Work, rng: np.random.Generator) -> PersonParameters:
    """Return random habits of a person for a work."""
    low, high = np.log(_OWN_SPREAD)
    factors = np.exp(rng.uniform(low, high, len(_SPREAD)))
    own = dict(zip(_SPREAD, factors, strict=True))
    ease = {name: rng.normal(*numbers) for name, numbers in (_EASE | _LEGS[work.stance]).items()}
    comfort, spread = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
    for joint, number in INDEX.items():
        side = next((each for each in SIDES if joint.startswith(each)), None)
        name = joint if side is None else joint.removeprefix(f"{side}_")
        is_free = side is not None and side not in work.hands and number < 20
        angle = _FREE_ARM[work.stance].get(name, 0.0) if is_free else ease.get(name, 0.0)
        if name == "ankle_inversion":
            angle = ease.get("hip_abduction", 0.0)  # keeps the sole of an abducted leg level
        comfort[number] = np.radians(angle)
        spread[number] = np.radians(_SPREAD[name] * own[name])
    return PersonParameters(
        comfort=np.clip(comfort, LOWER, UPPER),
        spread=spread,
        relaxation=float(rng.uniform(0.5, 1.5)),
        lean=float(rng.uniform(-0.01, 0.03)),
        steadiness=float(rng.uniform(0.02, 0.04)),
    )
