"""What the fuzzer feeds a stepper: sane trajectories with attacks between them.

With each attack comes what it must be called.

An attack changes one call and says which causes the answer has to name; one that names none is a
strange but usable input, which must get a usable answer. Lies are about the robot: a pose where the
object is not, a twist that it does not have, a robot that does something else. What they must be
called is reckoned by `tools.fuzz.robot`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.problem.problem import Problem
from tools.fuzz.problems import moving, rotation, somewhere
from tools.fuzz.world import moved

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
    """One call of a stepper, as it will be made.

    Attributes:
        posture: what is passed as posture.
        arguments: what is passed by keyword.
        causes: words that the reason must contain, one per thing that is wrong.
        invalid: whether the status must be ``invalid``.
        names: attacks that made it, for the report.
        kind: of which method: ``step``, ``brake`` or ``reset``.
        lies: what in it is made up, ``pose`` or ``twist``.
        hold: seconds for which the robot goes on with the twist because the next call is late.
        does: what the robot makes of every twist from now on (6, 6); None: what it did.
    """

    posture: Any
    arguments: Arguments = field(default_factory=dict)
    causes: list[str] = field(default_factory=list)
    invalid: bool = False
    names: list[str] = field(default_factory=list)
    kind: str = "step"
    lies: set[str] = field(default_factory=set)
    hold: float = 0.0
    does: np.ndarray | None = None


# --- attacks: (rng, problem, call) -> None --------------------------------------------------------


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
    q[some] = np.clip(np.where(rng.random(32) < 0.5, LOWER - beyond, UPPER + beyond), -3.14, 3.14)[
        some
    ]


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
    choices: list[Any] = [
        q[:31],
        q[None],
        np.zeros(0),
        q.tolist()[:20],
        "upright",
        {},
        [None] * 32,
        [*q.tolist()[:31], None],
    ]
    choices += [
        [*q.tolist()[:31], "x"],
        q + 1j,
        [[1], [2, 3]],
        object(),
        Hostile(),
        7,
        float("nan"),
        np.zeros((32, 1)),
        b"q",
    ]
    call.posture = choices[rng.integers(len(choices))]
    _wrong(call, "posture")


def lost(rng: Rng, problem: Problem, call: Call) -> None:
    call.posture = None
    call.causes.append("no posture arrived")


def pose_elsewhere(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["pose"] = somewhere(rng, problem)
    call.lies.add("pose")


def pose_nearly_rigid(rng: Rng, problem: Problem, call: Call) -> None:
    pose_elsewhere(rng, problem, call)
    call.arguments["pose"][:3, :3] += rng.normal(size=(3, 3)) * 1e-10


def pose_nudged(rng: Rng, problem: Problem, call: Call) -> None:
    if isinstance(call.arguments.get("pose"), np.ndarray) and call.arguments["pose"].shape == (
        4,
        4,
    ):
        size = rng.choice([0.1, 0.5, 1.0, 1.5, 10.0]) * np.repeat([1e-3, np.radians(0.2)], 3)
        call.arguments["pose"] = moved(call.arguments["pose"], size * rng.uniform(-1, 1, 6))
        call.lies.add("pose")


def disobeyed(rng: Rng, problem: Problem, call: Call) -> None:
    if "pose" in call.arguments and not problem.robot.pose_delay:
        half = np.zeros((6, 6))
        half[:3, :3], half[3:, 3:] = rotation(rng), rotation(rng)
        call.does = (0.0 * half, 0.5 * np.eye(6), 1.4 * np.eye(6), half, -np.eye(6))[
            rng.integers(5)
        ]
        call.lies.add("robot")


def not_a_pose(rng: Rng, problem: Problem, call: Call) -> None:
    nan, mirror, far, stretched = (
        np.full((4, 4), np.nan),
        np.diag([1, 1, -1.0, 1]),
        np.eye(4),
        np.diag([1.1, 1, 1, 1]),
    )
    far[0, 3] = 1e5
    hole = np.eye(4)
    hole[1, 3] = np.inf
    choices = [
        nan,
        mirror,
        far,
        stretched,
        hole,
        np.zeros((4, 4)),
        np.eye(3),
        np.eye(4)[:3],
        "home",
        Hostile(),
        np.eye(4) + 1j,
    ]
    call.arguments["pose"] = choices[rng.integers(len(choices))]
    _wrong(call, "pose ")


def did_something_else(rng: Rng, problem: Problem, call: Call) -> None:
    limit = problem.twist_limit
    full = np.repeat([limit.linear_speed, limit.angular_speed], 3)
    call.arguments["twist"] = (
        rng.uniform(-1, 1, 6) * full * rng.choice([0.1, 1.0, 3.0, 10.0]) * (rng.random(6) < 0.7)
    )
    call.lies.add("twist")


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
    call.arguments["dt"] = float(problem.dt * 10 ** rng.uniform(-1, np.log10(3)))


def longest_period(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["dt"] = problem.longest_period


def tiny_period(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["dt"] = float(10 ** rng.uniform(-5, -3))


def long_period(rng: Rng, problem: Problem, call: Call) -> None:
    call.arguments["dt"] = float(
        problem.longest_period * (1 / problem.longest_period) ** rng.uniform(1e-3, 1)
    )
    call.causes.append("three periods")


def not_a_period(rng: Rng, problem: Problem, call: Call) -> None:
    choices = [
        0.0,
        -0.01,
        np.nan,
        np.inf,
        10.0,
        1.01,
        1e-6,
        "soon",
        Hostile(),
        np.array([0.01, 0.02]),
        1j,
        10**400,
    ]
    call.arguments["dt"] = choices[rng.integers(len(choices))]
    _wrong(call, "dt is")


def held(rng: Rng, problem: Problem, call: Call) -> None:
    call.hold = float(problem.robot.longest_hold * rng.choice([1.0, rng.random()]))


def watchdog(rng: Rng, problem: Problem, call: Call) -> None:
    call.kind, call.arguments, call.causes, call.invalid = "brake", {}, ["asked to brake"], False
    if rng.random() < 0.4:
        (other_period, long_period, not_a_period)[rng.integers(3)](rng, problem, call)
    if rng.random() < 0.5:
        choices = [
            rng.uniform(0, 0.1),
            rng.uniform(0, 1),
            1e-9,
            70.0,
            1e9,
            np.inf,
            -1.0,
            np.nan,
            "late",
            Hostile(),
            None,
        ]
        call.arguments["elapsed"] = choices[
            rng.choice(11, p=[0.3, 0.25, 0.05, 0.05, 0.05, *[0.05] * 6])
        ]


def taken_over(rng: Rng, problem: Problem, call: Call) -> None:
    call.kind, call.arguments, call.causes, call.invalid = (
        "reset",
        {"twist": moving(rng, problem)},
        [],
        False,
    )
    if rng.random() < 0.3:
        choices: list[Any] = [
            np.full(6, np.nan),
            np.zeros(5),
            "still",
            Hostile(),
            [None] * 6,
            np.zeros(6) + 1j,
        ]
        call.arguments["twist"], call.invalid = choices[rng.integers(len(choices))], True


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


_Attack = Callable[[Rng, Problem, Call], None]

USABLE: Final[tuple[_Attack, ...]] = (
    at_the_limits,
    beyond_the_limits,
    anywhere,
    straight,
    jumped,
    listed,
    single_precision,
    other_period,
    longest_period,
    tiny_period,
    late,
    partly_seen,
    held,
    watchdog,
)
"""Strange, and to be worked with (`late` only if not too late), or with an answer of its own."""

UNUSABLE: Final[tuple[_Attack, ...]] = (
    not_a_number,
    degrees,
    not_a_posture,
    lost,
    not_a_pose,
    not_a_twist,
    not_a_period,
    long_period,
    not_an_age,
    disabled,
    not_a_mask,
)
"""Wrong: the answer must brake and name each cause."""

LIES: Final[tuple[_Attack, ...]] = (
    pose_elsewhere,
    pose_nearly_rigid,
    pose_nudged,
    pose_nudged,
    disobeyed,
    taken_over,
    did_something_else,
    did_something_else,
)
"""About the robot: usable, and a fault of the robot where they contradict what was sent."""

_OF_POSTURE: Final = (*USABLE[:7], *UNUSABLE[:4], partly_seen, not_a_mask)
_ALONE: Final = (watchdog, taken_over, disobeyed)


def attack(rng: Rng, problem: Problem, call: Call, lying: bool) -> None:
    """Change a call by one to three attacks, at most one on the posture; lies only if `lying`."""
    touched, known = False, USABLE + UNUSABLE + (LIES if lying else ())
    count = int(rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1]))
    for number in rng.permutation(len(known))[:count]:
        chosen = known[number]
        if (chosen in _OF_POSTURE and touched) or (chosen in _ALONE and call.names):
            continue
        touched |= chosen in _OF_POSTURE
        tried = replace(
            call, arguments=dict(call.arguments), causes=list(call.causes), lies=set(call.lies)
        )
        chosen(rng, problem, tried)
        # An argument that was attacked already stays as it is.
        if call.names and any(
            tried.arguments[name] is not value for name, value in call.arguments.items()
        ):
            continue
        vars(call).update(vars(tried))
        call.names.append(chosen.__name__)
        if chosen in _ALONE:
            return
