"""Wrong frames: how many are named, how fast, and how often honest people are taken for one.

Run ``python -m benchmarks.frames [--quick | --full] [--json FILE]``.

Everybody is honest but the frames: people of all kinds follow, whose angles are read with a
constant error of up to 7 degrees each (8, of those who tremble) beside the noise of their kind, and
whose stature the controller has wrong by up to 0.15 m. Seeds from 1000; the bounds of the
comparison were found with seeds below 100 and the kinds alike, follower, stubborn, pushed, looking
and trembling.

- ``share_named``: loops with a wrong frame in which a step within 1 s brakes and names it: a pose
  in millimetres, a base 1 m and 0.6 m off, the tool along z instead of x, a base turned by 90
  degrees about z. ``share_named.FAULT`` of one; so also a base ``0.3 m`` off, an ``inverse`` pose
  and one ``mirrored`` in y, which are not in the sum. A fault that changes the pose by less than
  0.1 m and 15 degrees is none and does not count (a mirrored pose in the plane of the mirror).
- ``share_said.FAULT``: the same, or said in the reason within 3 s without braking.
- ``share_named.calibrated``: of the last three, by a step whose frames `ergoqp.calibrate_frames`
  found from eight rests of the same person.
- ``false_brakes``: honest loops with a step that brakes for its frames, of ``loops``;
  ``false_doubts``: share in which the reason doubts them. ``stepping.*``: of people who step, which
  are not in the sum. ``*.calibrated``: after the calibration.
- ``reba.FAULT``: mean score at the end of 8 s, ``reba.FAULT.unchecked`` without the comparison,
  ``reba.FAULT.start`` at the start: what the frames do to the person.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any
from unittest import mock

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from benchmarks.kept import KeptPool
from benchmarks.report import Report, run
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.identification.calibrate import calibrate_frames
from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import pose_error
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames
from ergoqp.rest.best_place import TURNS, awkward_start, tilted_frames
from ergoqp.rest.person_protocol import Holding, Person, SensorModel
from ergoqp.simulation.loop import run_loop
from ergoqp.simulation.people import kinds, person_of_kind
from ergoqp.step import frames_check
from ergoqp.step.causes import Cause
from ergoqp.step.stepper import Step, Stepper

FIRST = 1000
"""First seed of those that nothing was tuned on."""
NAMED, SAID, HONEST, LED = 1.0, 3.0, 3.0, 8.0
"""Time to name a fault, and to say it; length of an honest loop, and of one with a score [s]."""
RESTS = 8
_BIAS, _STATURE = 7.0, 0.15
_LEAST = (0.1, float(np.radians(15.0)))
"""A fault that changes less is none [m], [rad]."""
COUNTED = ("mm", "1 m", "0.6 m", "z for x", "90 deg")
OTHERS = ("0.3 m", "inverse", "mirrored")


@dataclass(frozen=True)
class Fault:
    """What a wrong frame does.

    Attributes:
        reported: the pose that the controller gets, for the true one (4, 4) [m].
        turn: the controller's axes in the world (3, 3), along which the robot executes the twist.
    """

    reported: Callable[[np.ndarray], np.ndarray]
    turn: np.ndarray


def faults(rng: np.random.Generator) -> dict[str, Fault]:
    """Return the faults by name, each along a random direction where it has one."""
    straight, along = np.eye(3), rng.normal(size=3)
    along /= np.linalg.norm(along)
    round_z, other_tool, mirror = np.eye(4), np.eye(4), np.diag([1.0, -1.0, 1.0, 1.0])
    round_z[:2, :2] = [[0, -1], [1, 0]]
    other_tool[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]

    def off(distance: float) -> Fault:
        base = np.eye(4)
        base[:3, 3] = distance * along
        return Fault(lambda pose: base @ pose, straight)

    def in_mm(pose: np.ndarray) -> np.ndarray:
        return np.block([[pose[:3, :3], 1000 * pose[:3, 3:]], [pose[3:]]])

    return {
        "mm": Fault(in_mm, straight),
        "1 m": off(1.0),
        "0.6 m": off(0.6),
        "z for x": Fault(lambda pose: pose @ other_tool, straight),
        "90 deg": Fault(lambda pose: round_z @ pose, round_z[:3, :3].T),
        "0.3 m": off(0.3),
        "inverse": Fault(np.linalg.inv, straight),
        "mirrored": Fault(lambda pose: mirror @ pose @ mirror, mirror[:3, :3]),
    }


@dataclass(frozen=True)
class Unit:
    """One honest person at a start.

    Attributes:
        problem: the task, with the stature that the controller assumes.
        person: who follows.
        senses: their sensors, with the constant error.
        start: true posture at the start (32,) [rad].
        seed: of the loops.
    """

    problem: Problem
    person: Person
    senses: SensorModel
    start: np.ndarray
    seed: int

    def holding(self) -> Holding:
        """Return the person at the start."""
        return self.person.hold(self.start, self.senses, self.seed)

    @property
    def rng(self) -> np.random.Generator:
        """The chance of everything but the person."""
        who = self.person.kind + self.problem.name
        return np.random.default_rng([self.seed, 43, *map(ord, who)])


@cache
def _problem(name: str) -> Problem:
    return load_problem(name)


def drawn(kind: str, name: str, seed: int) -> Unit | None:
    """Return the unit of a kind, problem and seed; None if the person reaches no place."""
    problem = _problem(name)
    rng = np.random.default_rng([seed, 42, *map(ord, kind + name)])
    person = person_of_kind(kind, problem, seed)
    try:
        start = awkward_start(problem, person, seed, places=3)
    except InputError:
        return None
    stature = np.clip(person.body.stature + rng.uniform(-_STATURE, _STATURE), 1.25, 2.25)
    body = Body.of_stature(float(stature))
    response: Any = problem.response
    drawn_bias = zip(JOINTS, rng.uniform(-_BIAS, _BIAS, len(JOINTS)).tolist(), strict=True)
    senses = replace(person.senses, bias_deg=dict(drawn_bias) | dict(person.senses.bias_deg))
    problem = problem.replace(response=replace(response, body=body))
    return Unit(problem, person, senses, start, seed)


class Wrong:
    """A stepper behind a fault: it gets another pose, and its twist is executed along its axes."""

    def __init__(self, stepper: Stepper, fault: Fault) -> None:
        """Take a stepper."""
        self._stepper, self._fault, self.steps, self.dt = stepper, fault, [], stepper.dt
        self.steps: list[Step]

    def reset(self) -> None:
        """Begin a loop."""
        self._stepper.reset()
        self.steps = []

    def step(self, posture: np.ndarray, pose: np.ndarray, **more: Any) -> Any:
        """Return the step, with the twist as the robot executes it."""
        step = self._stepper.step(posture, self._fault.reported(pose), **more)
        self.steps.append(step)
        turn = self._fault.turn
        step.twist = np.concatenate([turn @ step.twist[:3], turn @ step.twist[3:]])
        return step

    def named(self, seconds: float) -> bool:
        """Return whether a step of the first seconds brakes and names the frame."""
        bits = 2**Cause.frames | 2**Cause.pose
        first = self.steps[: round(seconds / self.dt)]
        return any(int(step.account("causes")[0]) & bits for step in first)

    def said(self, seconds: float) -> bool:
        """Return whether a step of the first seconds names or doubts the frame."""
        first = self.steps[: round(seconds / self.dt) : 5]
        return self.named(seconds) or any("frames:" in step.reason for step in first)


RIGHT = Fault(lambda pose: pose, np.eye(3))


def loop(unit: Unit, stepper: Stepper, fault: Fault, seconds: float) -> tuple[Wrong, int]:
    """Run a loop; return the stepper behind the fault, and the score at the end."""
    wrong, held = Wrong(stepper, fault), unit.holding()
    run_loop(unit.problem, held, duration=seconds, seed=unit.seed, controller=wrong)
    return wrong, int(unit.problem.assess(held.posture).final[0])


def matters(fault: Fault, pose: np.ndarray) -> bool:
    """Return whether a fault changes the pose, its tool's axis included."""
    other = fault.reported(pose)
    shift = np.linalg.norm(pose_error(pose, other)[:3])
    turn = np.arccos(np.clip(pose[:3, 0] @ other[:3, 0], -1, 1))
    return bool(shift > _LEAST[0] or turn > _LEAST[1])


def honest(kind: str, name: str, seed: int) -> dict[str, Any]:
    """Return whether an honest loop was braked or doubted for its frames."""
    unit = drawn(kind, name, seed)
    if unit is None:
        return {}
    ran, _ = loop(unit, Stepper(unit.problem), RIGHT, HONEST)
    return {"braked": ran.named(HONEST), "doubted": ran.said(HONEST)}


def wrong(kind: str, name: str, seed: int, scored: bool) -> dict[str, Any]:
    """Return what was named of each fault, and the scores at the end if `scored`."""
    unit = drawn(kind, name, seed)
    if unit is None:
        return {}
    stepper, found, pose = Stepper(unit.problem), {}, unit.holding().pose
    for what, fault in faults(unit.rng).items():
        if matters(fault, pose):
            ran, _ = loop(unit, stepper, fault, SAID)
            found[what] = {"named": ran.named(NAMED), "said": ran.said(SAID)}
    if scored:
        endless = (1e9, 4.0)
        with (
            mock.patch.object(frames_check, "_FAR", endless),
            mock.patch.object(frames_check, "_WALKED", endless),
        ):
            unchecked = Stepper(unit.problem)
        start = int(unit.problem.assess(unit.start).final[0])
        for what, fault in faults(unit.rng).items():
            if what in found:
                ends = [loop(unit, each, fault, LED)[1] for each in (stepper, unchecked)]
                found[what]["reba"] = [start, *ends]
    return found


def calibrated(kind: str, name: str, seed: int) -> dict[str, Any]:
    """Return the same after a calibration with rests of the same person."""
    unit = drawn(kind, name, seed)
    if unit is None:
        return {}
    rng, problem = unit.rng, unit.problem
    true = Frames(_frame(rng, 1.0), _frame(rng, 0.2))
    rests = []
    for pose in _places(problem, rng):
        posture, reached = unit.person.reach(pose)
        if reached:
            # The mean of a second: of the noise only the slow part is left.
            read = (
                posture
                + unit.senses.bias
                + np.radians(unit.senses.drift_deg) * rng.normal(size=len(posture))
            )
            rests.append((read, true.reported_pose(pose)))
        if len(rests) == RESTS:
            break
    if len(rests) < RESTS:
        return {}
    found = problem.replace(frames=calibrate_frames(problem, rests))
    stepper = Stepper(found)

    def behind(fault: Fault) -> Fault:
        return Fault(lambda pose: fault.reported(true.reported_pose(pose)), fault.turn)

    ran, _ = loop(unit, stepper, behind(RIGHT), HONEST)
    result = {"honest": {"braked": ran.named(HONEST), "doubted": ran.said(HONEST)}}
    pose = true.reported_pose(unit.holding().pose)
    for what, fault in faults(rng).items():
        if what in OTHERS and matters(fault, pose):
            ran, _ = loop(unit, stepper, behind(fault), NAMED)
            result[what] = {"named": ran.named(NAMED)}
    return result


def _frame(rng: np.random.Generator, most: float) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    frame[:3, 3] = rng.uniform(-most, most, 3)
    return frame


def _places(problem: Problem, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Yield places of the workspace."""
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    rotations = tilted_frames(cone, problem.twist_limit.axes, TURNS)
    for _ in range(4 * RESTS):
        pose = np.eye(4)
        pose[:3, 3] = rng.uniform(box.lower, box.upper)
        pose[:3, :3] = rotations[rng.integers(len(rotations))]
        yield pose


def _mean(values: Sequence[bool]) -> float:
    return float(np.mean(values))


def _begin() -> None:
    threadpool_limits(1)


def measure(report: Report) -> None:
    """Run the loops and print the figures."""
    chosen = [kind for kind in kinds() if kind not in ("mass", "stepping")]
    pairs = [(kind, name) for kind in chosen for name in TASKS] * report.pick(1, 15)
    # A seed is a place too, so each unit has one of its own.
    units = [(*pair, FIRST + i) for i, pair in enumerate(pairs[:: report.pick(3, 1)])]
    stepping = [("stepping", name, FIRST + i) for i, name in enumerate(TASKS * report.pick(1, 15))]
    stepping = stepping if report.full else stepping[:2]
    with_mass = [("mass", name, FIRST) for name in TASKS] if report.full else []
    few = units[:: report.pick(1, 7)]
    jobs: list[tuple[Callable[..., dict[str, Any]], tuple[Any, ...]]] = [
        (honest, unit) for unit in (*units, *with_mass, *stepping)
    ]
    jobs += [(wrong, (*unit, i % report.pick(6, 5) == 0)) for i, unit in enumerate(few)]
    jobs += [(calibrated, unit) for unit in few[:: report.pick(2, 1)]]
    with KeptPool(report, "frames", initializer=_begin) as pool:
        futures = [(function, unit, pool.submit(function, *unit)) for function, unit in jobs]
        found = [(function, unit, future.result()) for function, unit, future in futures]
    of = {
        function: [(unit, result) for what, unit, result in found if what is function and result]
        for function in (honest, wrong, calibrated)
    }
    _print_named(report, [result for _, result in of[wrong]])
    after = [result for _, result in of[calibrated]]
    rates = {what: [r[what]["named"] for r in after if what in r] for what in OTHERS}
    every = [named for values in rates.values() for named in values]
    report.figure("share_named.calibrated", _mean(every), "of the last three, calibrated")
    for what, values in rates.items():
        report.figure(f"share_named.{what}.calibrated", _mean(values))
    loops = [result for unit, result in of[honest] if unit[0] != "stepping"]
    _print_honest(report, loops, "")
    _print_honest(report, [r for unit, r in of[honest] if unit[0] == "stepping"], "stepping.")
    _print_honest(report, [result["honest"] for result in after], "", ".calibrated")


def _print_named(report: Report, found: list[dict[str, Any]]) -> None:
    every = [result[what]["named"] for result in found for what in COUNTED if what in result]
    report.figure("share_named", _mean(every), f"within {NAMED:g} s, of {len(every)} loops")
    for what in (*COUNTED, *OTHERS):
        values = [result[what] for result in found if what in result]
        report.figure(f"share_named.{what}", _mean([each["named"] for each in values]))
        report.figure(f"share_said.{what}", _mean([each["said"] for each in values]))
        if scores := [each["reba"] for each in values if "reba" in each]:
            start, end, unchecked = np.mean(scores, axis=0).tolist()
            report.figure(f"reba.{what}.start", start, "mean REBA score")
            report.figure(f"reba.{what}", end, f"after {LED:g} s")
            report.figure(f"reba.{what}.unchecked", unchecked, "without the comparison")


def _print_honest(
    report: Report, found: list[dict[str, Any]], before: str, after: str = ""
) -> None:
    report.figure(f"{before}loops{after}", len(found), f"honest loops of {HONEST:g} s")
    braked = sum(each["braked"] for each in found)
    report.figure(f"{before}false_brakes{after}", braked, "of them braked for their frames")
    doubts = _mean([each["doubted"] for each in found])
    report.figure(f"{before}false_doubts{after}", doubts, "share whose frames are doubted")


if __name__ == "__main__":
    run(measure, __doc__ or "")
