"""What the fuzzer feeds a stepper: sane trajectories with attacks between them, and what each attack must be called.

An `Attack` changes the arguments of one call and says which causes the answer has to name; an attack that names none is a
strange but usable input, which must get a usable answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from ergoqp.errors import ErgoqpError
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.limits import AXES, AxisCone, JointLimit, TwistLimit, WorkspaceBox
from ergoqp.problem import Problem
from ergoqp.problem_file import TASKS, load_problem

Rng = np.random.Generator
Arguments = dict[str, Any]


class Hostile:
    """An object that raises whatever is asked of it."""

    def __array__(self, *args: Any, **kwargs: Any) -> np.ndarray:
        """Raise something that no converter expects."""
        raise RuntimeError("not today")

    def __float__(self) -> float:
        """Raise something that no converter expects."""
        raise RuntimeError("not today")


@dataclass
class Call:
    """One call of `Stepper.step`, as it will be made.

    Attributes:
        posture: what is passed as posture.
        arguments: what is passed by keyword.
        causes: words that the reason must contain, one per thing that is wrong.
        invalid: whether the status must be ``invalid``.
        names: attacks that made it, for the report.
    """

    posture: Any
    arguments: Arguments = field(default_factory=dict)
    causes: list[str] = field(default_factory=list)
    invalid: bool = False
    names: list[str] = field(default_factory=list)


# --- attacks: (rng, problem, call) -> None -------------------------------------------------------------------------------


def _wrong(call: Call, *causes: str) -> None:
    call.causes += causes
    call.invalid = True


def _numbers(call: Call) -> np.ndarray:
    """The posture as numbers, for attacks that change some of them."""
    call.posture = np.array(call.posture, dtype=float)
    return call.posture


def at_the_limits(rng: Rng, problem: Problem, call: Call) -> None:
    q, some = _numbers(call), rng.random(32) < 0.3
    q[some] = np.where(rng.random(32) < 0.5, LOWER, UPPER)[some]


def beyond_the_limits(rng: Rng, problem: Problem, call: Call) -> None:
    q, some = _numbers(call), rng.random(32) < 0.15
    beyond = rng.uniform(0, np.radians(rng.choice([1, 10, 60])), 32)
    q[some] = np.clip(np.where(rng.random(32) < 0.5, LOWER - beyond, UPPER + beyond), -3.14, 3.14)[some]


def anywhere(rng: Rng, problem: Problem, call: Call) -> None:
    _numbers(call)[:] = rng.uniform(LOWER, UPPER)


def straight(rng: Rng, problem: Problem, call: Call) -> None:
    q = _numbers(call)
    for side in SIDES:
        for joint in ("knee_flexion", "elbow_flexion", "wrist_flexion", "wrist_deviation"):
            if rng.random() < 0.7:
                q[INDEX[f"{side}_{joint}"]] = rng.choice([0.0, 1e-9, -1e-9])


def jumped(rng: Rng, problem: Problem, call: Call) -> None:
    q = _numbers(call)
    q[:] = np.clip(q + rng.normal(size=32) * 0.3, -3.14, 3.14)


def listed(rng: Rng, problem: Problem, call: Call) -> None:
    call.posture = np.asarray(call.posture, dtype=float).tolist()


def single_precision(rng: Rng, problem: Problem, call: Call) -> None:
    call.posture = np.asarray(call.posture, dtype=np.float32)


def not_a_number(rng: Rng, problem: Problem, call: Call) -> None:
    q = _numbers(call)
    joint = int(rng.integers(32))
    q[joint] = rng.choice([np.nan, np.inf, -np.inf, 1e308, -4.0])
    _wrong(call, "posture")


def degrees(rng: Rng, problem: Problem, call: Call) -> None:
    q = _numbers(call)
    q[:] = np.degrees(q)
    if np.abs(q).max() > np.pi:
        _wrong(call, "radians")


def not_a_posture(rng: Rng, problem: Problem, call: Call) -> None:
    q = np.asarray(call.posture, dtype=float)
    choices: list[Any] = [q[:31], q[None], np.zeros(0), q.tolist()[:20], "upright", {}, [None] * 32, [*q.tolist()[:31], None]]
    choices += [[*q.tolist()[:31], "x"], q + 1j, [[1], [2, 3]], object(), Hostile(), 7, float("nan"), np.zeros((32, 1)), b"q"]
    call.posture = choices[rng.integers(len(choices))]
    _wrong(call, "posture")


def lost(rng: Rng, problem: Problem, call: Call) -> None:
    call.posture = None
    call.causes.append("no posture arrived")


def pose_elsewhere(rng: Rng, problem: Problem, call: Call) -> None:
    pose = np.eye(4)
    pose[:3, :3] = _rotation(rng)
    box = problem.limit_of(WorkspaceBox)
    low, high = (np.asarray(box.lower), np.asarray(box.upper)) if box else (np.zeros(3), np.ones(3))
    pose[:3, 3] = rng.uniform(low, high) + rng.choice([0.0, 0.01, 0.5]) * rng.normal(size=3)
    cone = problem.limit_of(AxisCone)
    if cone is not None and rng.random() < 0.6:
        pose[:3, :3] = _along(np.asarray(cone.direction) + rng.choice([0.0, 0.3]) * rng.normal(size=3), rng)
    call.arguments["pose"] = pose


def pose_nearly_rigid(rng: Rng, problem: Problem, call: Call) -> None:
    pose_elsewhere(rng, problem, call)
    call.arguments["pose"][:3, :3] += rng.normal(size=(3, 3)) * 1e-10


def not_a_pose(rng: Rng, problem: Problem, call: Call) -> None:
    nan, mirror, far, stretched = np.full((4, 4), np.nan), np.diag([1, 1, -1.0, 1]), np.eye(4), np.diag([1.1, 1, 1, 1])
    far[0, 3] = 1e5
    hole = np.eye(4)
    hole[1, 3] = np.inf
    choices = [nan, mirror, far, stretched, hole, np.zeros((4, 4)), np.eye(3), np.eye(4)[:3], "home", Hostile(), np.eye(4) + 1j]
    call.arguments["pose"] = choices[rng.integers(len(choices))]
    _wrong(call, "pose ")


def did_something_else(rng: Rng, problem: Problem, call: Call) -> None:
    limit = problem.twist_limit
    full = np.repeat([limit.linear_speed, limit.angular_speed], 3)
    call.arguments["twist"] = rng.uniform(-1, 1, 6) * full * rng.choice([0.1, 1.0, 3.0]) * (rng.random(6) < 0.7)


def not_a_twist(rng: Rng, problem: Problem, call: Call) -> None:
    choices: list[Any] = [
        np.full(6, np.nan),
        [0, 0, np.inf, 0, 0, 0],
        np.full(6, 1e200),
        np.zeros(5),
        "still",
        Hostile(),
        [None] * 6,
    ]
    choices += [np.zeros(6) + 1j, np.full(6, 1e4), np.zeros((6, 1)), [None] * 6]
    call.arguments["twist"] = choices[rng.integers(len(choices))]
    _wrong(call, "twist ")


def other_period(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["dt"] = float(10 ** rng.uniform(-3, np.log10(0.05)))


def not_a_period(rng: Rng, problem: Problem, call: Call) -> None:
    choices = [0.0, -0.01, np.nan, np.inf, 10.0, "soon", Hostile(), np.array([0.01, 0.02]), 1j, 10**400]
    call.arguments["dt"] = choices[rng.integers(len(choices))]
    _wrong(call, "dt is")


def late(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["age"] = float(rng.choice([0.0, 0.05, 0.11, 1.0, 1e9, np.inf]))
    if call.arguments["age"] > problem.control.max_age:
        call.causes.append("s old")


def not_an_age(rng: Rng, problem: Problem, call: Call) -> None:
    choices = [-0.01, np.nan, "old", Hostile(), [0.0, 0.0], -np.inf]
    call.arguments["age"] = choices[rng.integers(len(choices))]
    _wrong(call, "age is")


def disabled(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["enable"] = False
    call.causes.append("not enabled")


def partly_seen(rng: Rng, problem: Problem, call: Call) -> None:
    if not isinstance(call.posture, np.ndarray) or call.posture.shape != (32,) or call.causes:
        return
    seen = rng.random(32) < rng.choice([0.0, 0.3, 0.9])
    q = _numbers(call)
    # What an unseen joint says is not used, whatever it is.
    q[~seen] = rng.choice([np.nan, np.inf, 1e300, 0.1], (~seen).sum())
    call.arguments["observed"] = seen


def not_a_mask(rng: Rng, problem: Problem, call: Call) -> None:
    choices = [np.ones(31, bool), "all", Hostile(), [[True]], np.ones((32, 1), bool), [None] * 31]
    call.arguments["observed"] = choices[rng.integers(len(choices))]
    _wrong(call, "observed")


USABLE: Final[tuple[Callable[[Rng, Problem, Call], None], ...]] = (
    *(at_the_limits, beyond_the_limits, anywhere, straight, jumped, listed, single_precision),
    *(pose_elsewhere, pose_nearly_rigid, did_something_else, other_period, late, partly_seen),
)
"""Strange, and to be worked with (`late` only if it is not too late)."""

UNUSABLE: Final[tuple[Callable[[Rng, Problem, Call], None], ...]] = (
    *(not_a_number, degrees, not_a_posture, lost, not_a_pose, not_a_twist, not_a_period, not_an_age, disabled, not_a_mask),
)
"""Wrong: the answer must brake and name each cause."""

_OF_POSTURE: Final = (*USABLE[:7], *UNUSABLE[:4], partly_seen, not_a_mask)


def attack(rng: Rng, problem: Problem, call: Call) -> None:
    """Change a call by one to three attacks, at most one of them on the posture."""
    touched = False
    for number in rng.permutation(len(USABLE) + len(UNUSABLE))[: rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1])]:
        chosen = (USABLE + UNUSABLE)[number]
        if chosen in _OF_POSTURE and touched:
            continue
        touched |= chosen in _OF_POSTURE
        before = set(call.arguments)
        tried = replace(call, arguments=dict(call.arguments), causes=list(call.causes))
        chosen(rng, problem, tried)
        # An argument that was attacked already stays as it is.
        if any(tried.arguments[name] is not call.arguments[name] for name in before):
            continue
        call.posture, call.arguments, call.causes, call.invalid = tried.posture, tried.arguments, tried.causes, tried.invalid
        call.names.append(chosen.__name__)


def _rotation(rng: Rng) -> np.ndarray:
    return _along(rng.normal(size=3), rng)


def _along(direction: np.ndarray, rng: Rng) -> np.ndarray:
    x = direction / np.linalg.norm(direction)
    y = np.cross(rng.normal(size=3), x)
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])
