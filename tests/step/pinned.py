"""Loops whose inputs and answers are kept in ``pinned.npz``: what the step answers is what it
answered when they were made.

They say nothing of what is right, which the other tests do: they notice that an answer has changed,
to the seventh digit, in every part of the step, the state included. A change that is meant to
change answers makes them anew, with ``python tests/step/pinned.py``, and the changelog says so.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.human.forearm import forearm_length, forearm_points
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.limits import ArmLength, AxisCone, JointLimit, WorkspaceBox
from ergoqp.problem.geometry import frame_of
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot, Frames
from ergoqp.simulation.robot import RobotKind, SimulatedRobot
from ergoqp.step.stepper import Step, Stepper

FILE = Path(__file__).with_suffix(".npz")
EVERY = 8
"""One in so many steps is kept with all that it says."""

IDEAL, NOTHING = RobotKind(), DeclaredRobot()
LATE = {"delay": 0.03, "lag": 0.05, "pose_delay": 0.02}
NOISE = {"pose_noise": 0.001, "pose_noise_deg": 0.2}


@dataclass(frozen=True)
class Loop:
    """One loop: a problem, and how it is driven.

    Attributes:
        problem: makes the task.
        kind: the robot that the inputs come from.
        steps: how many.
        reports: what is reported of the robot: ``pose``, ``twist``, ``both``, ``lost`` (the pose
            is, a third of the time).
        guided: whether a place is given.
        every: number of steps after which the person takes another posture.
        oddity: what is wrong with what is measured of the robot, see `_wrong`.
        odd: whether frames are lost, unseen, not enabled, late, and the robot stands still now and
            then.
    """

    problem: Callable[[], Problem]
    kind: RobotKind = IDEAL
    steps: int = 160
    reports: str = "pose"
    guided: bool = False
    every: int = 40
    odd: bool = False
    oddity: str = ""


def apart(name: str) -> Problem:
    """A problem whose postures and poses have nothing to do with each other."""
    return load_problem(name).replace(frames=Frames(compare=False))


def facing(name: str) -> Problem:
    """A problem whose frames put the pose in the middle where the comfort posture has it."""
    problem = load_problem(name)
    comfort = problem.response.comfort  # type: ignore
    contact = problem.response.contact()(comfort)[0].full()
    return problem.replace(frames=Frames(base=contact @ np.linalg.inv(amid(problem))))


def narrow(
    name: str, robot: DeclaredRobot = NOTHING, average: float | None = None, **joints: Any
) -> Problem:
    """A problem in a small box and cone, with an object that is mostly at some wall."""
    problem = apart(name)
    box, cone, ranges = (problem.limit_of(kind) for kind in (WorkspaceBox, AxisCone, JointLimit))
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    middle = (lower + upper) / 2
    walls = WorkspaceBox(
        tuple(np.maximum(lower, middle - 0.03)), tuple(np.minimum(upper, middle + 0.03))
    )
    tight = replace(cone, half_angle_deg=min(8.0, cone.half_angle_deg))
    limits = [{id(box): walls, id(cone): tight}.get(id(limit), limit) for limit in problem.limits]
    if joints:
        limits = [replace(limit, **joints) if limit is ranges else limit for limit in limits]
    control = replace(problem.control, average=average, rest_below=0.001)
    return problem.replace(limits=limits, robot=robot, control=control)


LOOPS: dict[str, Loop] = {
    "ideal": Loop(lambda: narrow("dentist"), reports="both"),
    "late": Loop(
        lambda: narrow("screwing", DeclaredRobot(**LATE, **NOISE, gain_error=0.02)),
        RobotKind(**LATE, **NOISE, gain=1.015, speed_noise=0.03),
        reports="lost",
    ),
    "beyond": Loop(
        lambda: narrow("low_bin", DeclaredRobot(lag=0.05, delay=0.02)),
        RobotKind(lag=0.05, delay=0.02, gain=1.15, speed_noise=0.05),
        reports="both",
        odd=True,
    ),
    "holds": Loop(
        lambda: narrow("desk", DeclaredRobot(longest_hold=0.2, lag=0.04)),
        RobotKind(lag=0.04),
        odd=True,
    ),
    "planned": Loop(
        lambda: narrow(
            "screwing",
            average=0.0,
            ranges_deg={"trunk_flexion": (-5, 8), "right_elbow_flexion": (60, 90)},
            rate_deg=40,
            recover=True,
        ),
        odd=True,
    ),
    "jumps": Loop(
        lambda: narrow("dentist", DeclaredRobot(lag=0.04, **NOISE)),
        RobotKind(lag=0.03, **NOISE, speed_noise=0.05),
        reports="both",
        oddity="jumps",
    ),
    "creeps": Loop(
        lambda: narrow("overhead", DeclaredRobot(**NOISE)),
        RobotKind(**NOISE),
        steps=240,
        oddity="creeps",
    ),
    "spikes": Loop(
        lambda: narrow("screwing", DeclaredRobot(delay=0.02)),
        RobotKind(delay=0.02, speed_noise=0.02),
        reports="both",
        oddity="spikes",
    ),
    "stalls": Loop(lambda: narrow("low_bin"), reports="twist", odd=True),
    "swift": Loop(
        lambda: narrow(
            "screwing",
            DeclaredRobot(lag=0.05, longest_hold=0.06, gain_error=0.05, pose_delay=0.02),
            0.1,
        ),
        RobotKind(lag=0.05, gain=1.04, pose_delay=0.02),
        odd=True,
    ),
    "frame": Loop(
        lambda: narrow("dentist", DeclaredRobot(gain_error=0.1)), reports="both", oddity="frame"
    ),
    "hands": Loop(
        lambda: narrow("desk", DeclaredRobot(delay=0.01, gain_error=0.03), 0.02),
        RobotKind(delay=0.01, gain=0.98),
    ),
    "rests": Loop(lambda: apart("overhead"), steps=320, every=240),
    "guided": Loop(lambda: apart("overhead"), guided=True, steps=640, every=1000),
    "learned": Loop(lambda: apart("screwing_learned"), reports="both"),
    "points": Loop(lambda: load_problem("forearm"), reports="nothing"),
    "compared": Loop(lambda: facing("screwing"), steps=240, every=60),
}


def stepper_of(loop: Loop) -> Stepper:
    """Return a stepper of a loop, as new."""
    problem = loop.problem()
    if not loop.guided:
        return Stepper(problem)
    return Stepper(problem, guide=amid(problem))


def amid(problem: Problem) -> np.ndarray:
    """Return the pose (4, 4) in the middle of box and cone."""
    box, cone, pose = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone), np.eye(4)
    pose[:3, 3], pose[:3, :3] = (
        np.mean([box.lower, box.upper], axis=0),
        frame_of(np.asarray(cone.direction)),
    )
    return pose


def at_points(rng: np.random.Generator) -> np.ndarray:
    """Return elbow and wrist (6,) of some posture."""
    posture = np.zeros(32)
    posture[[INDEX["right_shoulder_flexion"], INDEX["right_elbow_flexion"]]] = rng.uniform(
        0.9, 1.4, 2
    )
    return ArmLength(forearm_length()).project(forearm_points(posture[None]))[0]


def answers(stepper: Stepper, inputs: list[dict[str, Any]]) -> Iterator[Step]:
    """Yield what a stepper answers to kept inputs."""
    for given in inputs:
        call = dict(given)
        elapsed = call.pop("elapsed", None)
        yield stepper.step(**call) if elapsed is None else stepper.brake(elapsed=elapsed)


def told(step: Step) -> np.ndarray:
    """Return all that a step says, and the state that it leaves."""
    return step.values


def drive(loop: Loop, seed: int) -> list[dict[str, Any]]:
    """Return the inputs of a loop with a simulated robot; every number is one that 32 bits hold."""
    rng, stepper = np.random.default_rng(seed), stepper_of(loop)
    problem, inputs = stepper.problem, []
    points = len(problem.coordinates) != len(LOWER)
    comfort = at_points(rng) if points else np.asarray(problem.response.comfort)  # type: ignore
    robot, posture = SimulatedRobot(loop.kind, np.eye(4) if points else amid(problem), rng), comfort
    for number in range(loop.steps):
        if number % loop.every == 0 and not points:
            posture = np.clip(
                comfort + 0.5 * rng.normal(size=len(comfort)), LOWER - 0.03, UPPER + 0.03
            )
        noisy = posture + np.radians(0.3) * rng.normal(size=len(posture)) * (not points)
        given: dict[str, Any] = {"posture": noisy}
        if loop.reports in ("pose", "both") or (loop.reports == "lost" and number // 20 % 3 < 2):
            given["pose"] = robot.measured_pose()
        if loop.reports in ("twist", "both", "lost"):
            given["twist"] = robot.reported_twist()
        ill = loop.odd and number % 80 > 70
        _wrong(loop.oddity, number, given, rng)
        if loop.odd:
            given |= _odd(number, len(posture), rng)
        given = {
            name: np.float32(value).astype(float) if np.ndim(value) else value
            for name, value in given.items()
        }
        if loop.odd and number % 70 == 60:
            given = {"elapsed": 0.02}
        inputs.append(given)
        step = next(answers(stepper, [given]))
        for _ in robot.execute(step.twist * (0.0 if ill else 1.0), problem.dt):
            pass
        if points:
            posture = posture + step.twist * problem.dt
    return inputs


def _odd(number: int, size: int, rng: np.random.Generator) -> dict[str, Any]:
    """What happens now and then."""
    if number % 23 == 5:
        return {"posture": None}
    if number % 29 == 7:
        return {"observed": rng.random(size) > 0.2}
    if number % 90 in (80, 81, 82):
        return {"enable": False}
    if number % 31 == 9:
        return {"dt": 0.02}
    if number % 37 == 11:
        return {"age": 0.05}
    return {}


def _wrong(oddity: str, number: int, given: dict[str, Any], rng: np.random.Generator) -> None:
    """What is measured of a robot is not what it does: it jumps, creeps, has spikes or comes in
    another frame."""
    if oddity == "jumps" and number % 60 > 40:
        given["pose"][:3, 3] += 0.006
    if oddity == "creeps" and number > 60:
        given["pose"][1, 3] += 0.0008 * (number - 60) * 0.01 * 10
    if oddity == "spikes" and number % 45 == 30:
        given["twist"][rng.integers(6)] += 0.3
    if oddity == "frame" and number > 40:
        given["twist"] = np.concatenate([given["twist"][[1, 2, 0]], given["twist"][[4, 5, 3]]])


def load(name: str) -> tuple[list[dict[str, Any]], dict[str, np.ndarray], list[str]]:
    """Return what is kept of a loop: inputs, answers, and the reasons step by step."""
    with np.load(FILE) as kept:
        prefix = f"{name}."
        found = {
            key.removeprefix(prefix): kept[key] for key in kept.files if key.startswith(prefix)
        }
    plain = json.loads(str(found.pop("plain")))
    arrays = {
        key: iter(np.float64(found.pop(key))) for key in ("posture", "pose", "twist", "observed")
    }
    inputs = [
        {key: next(arrays[key]) if value == "array" else value for key, value in given.items()}
        for given in plain["inputs"]
    ]
    return inputs, found, plain["reasons"]


def make() -> None:
    """Drive all loops and keep them."""
    kept: dict[str, np.ndarray] = {}
    for seed, (name, loop) in enumerate(LOOPS.items()):
        inputs = drive(loop, seed)
        steps = list(answers(stepper_of(loop), inputs))
        arrays: dict[str, list[np.ndarray]] = {
            "posture": [],
            "pose": [],
            "twist": [],
            "observed": [],
        }
        plain = []
        for given in inputs:
            plain.append(
                {key: "array" if np.ndim(value) else value for key, value in given.items()}
            )
            for key, value in given.items():
                if np.ndim(value):
                    arrays[key].append(np.float32(value))
        for key, values in arrays.items():
            kept[f"{name}.{key}"] = np.array(values, dtype=np.float32)
        kept[f"{name}.sent"] = np.array([step.twist for step in steps])
        kept[f"{name}.told"] = np.array([told(step) for step in steps[EVERY - 1 :: EVERY]])
        kept[f"{name}.plain"] = np.array(
            json.dumps({"inputs": plain, "reasons": [f"{s.status}: {s.reason}" for s in steps]})
        )
        counts = {
            status: sum(step.status == status for step in steps)
            for status in {step.status for step in steps}
        }
        print(f"{name}: {counts}")
    np.savez_compressed(FILE, **kept)  # type: ignore[arg-type]


if __name__ == "__main__":
    make()
