"""Robots that do not do what they are sent: what is sent, where the object really is, and what is said of it.

Run ``python -m benchmarks.tracking [--quick | --full] [--json FILE]``. Every robot of `benchmarks.tracking_robots` on every
problem, with pose, twist, both or nothing reported. The object is driven by a posture that jumps about and follows nobody,
in a box of 6 cm and a cone of 6 degrees, so that it is led into every wall again and again; the robot is simulated apart
from the step, exactly, and judged inside the periods too.

Sent against limits, all robots, relative to the limit, at most:

- ``over_speed``, ``over_acceleration``, ``over_jerk`` (of 2 a / W, between the middles of periods; rounding of the
  difference of two twists is not jerk).

The true object, where a pose is reported or nothing but time is between the twist and it (no gain error, no noise):

- ``outside_mm.declared``, ``outside_deg.declared``: beyond box and cone at most, robots exactly as declared and up to that;
- ``outside_mm.undeclared_20ms``, ``outside_deg.undeclared_20ms``: robots that are up to 20 ms late and not declared, pose
  reported;
- ``outside_mm.undeclared``, ``outside_deg.undeclared``: all that do something else than declared, and are measured;
  ``..._unseen``: whose pose is not: the control of these figures;
- ``at_wall_share``: how much of the time the objects of declared robots are within 2 mm of a wall or 0.4 deg of the cone's end.

What is said, where a pose or a twist is reported:

- ``unnamed_faults``: motions in which reported and declared motion differ by more than 1 mm or 0.2 deg (beyond the declared
  noise) for 0.2 s and no ``robot: ...`` is said. Noise of the reported speed alone is no fault.
- ``false_faults``: runs of robots that keep what is declared in which one is said.

And ``path_share.declared``: path of the declared robots' objects over that of the ideal robot's, all together;
``still.path_m`` is the longest path with the object not enabled, the control of all these. ``worse_than_start``: closed
loops with people who follow (the benchmarks' own, `benchmarks.closed_loop`) on declared robots that end at a worse score
than they began with; ``loops`` how many. ``FORM.difference``: largest difference of what is sent from the interpreted step,
in the same calls.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Report, run
from benchmarks.step_c import built
from benchmarks.tracking_robots import NONE, Case, OddRobot, cases, moved, period, told
from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem import Problem
from ergoqp.problem_file import TASKS, load_problem
from ergoqp.robot import DeclaredRobot
from ergoqp.simulation.best import frame_of
from ergoqp.simulation.loop import run_loop, start_at
from ergoqp.simulation.people import sample_person
from ergoqp.simulation.starts import awkward_start
from ergoqp.step_inputs import stand_in

REPORTS = ("pose", "twist", "both", "nothing")
JUMP = 0.6
"""Every so often the posture is another one [s]."""

ROOM = 0.03
"""Half the size of the box that the object is driven about in [m]: so small that it is at a wall most of the time."""

TILT = 6.0
"""Half the angle of the cone [deg]."""

NEAR = (-2.0, -0.4)
"""What is at a wall, or at the end of the cone [mm, deg]."""


@dataclass
class Found:
    """What one run left behind."""

    over: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("speed", "acceleration", "jerk"), -np.inf))
    outside: np.ndarray = field(default_factory=lambda: np.full(2, -np.inf))
    at_wall: int = 0
    moments: int = 0
    path: float = 0.0
    unnamed: int = 0
    named: list[str] = field(default_factory=list)
    twists: list[np.ndarray] = field(default_factory=list)


class Sent:
    """Judges what is sent against the limits, from the twists and periods alone."""

    def __init__(self, problem: Problem, found: Found) -> None:
        """Start from rest."""
        limit = problem.twist_limit
        self._speed = np.where(limit.speed > 0, limit.speed, np.nan)
        self._most = np.repeat([limit.linear_acceleration, limit.angular_acceleration], 3)
        self._jerk, self._found = 2 * self._most / problem.average, found
        self._frozen = limit.speed == 0
        self._twist, self._slope, self._lasted = np.zeros(6), np.zeros(6), problem.dt

    def judge(self, twist: np.ndarray, dt: float) -> None:
        """Take over the next twist, which is meant for `dt` seconds."""
        slope, over = (twist - self._twist) / dt, self._found.over
        rounding = 4e-16 * np.nan_to_num(self._speed) / dt
        jerk = (np.abs(slope - self._slope) - 2 * rounding) / ((dt + self._lasted) / 2)
        frozen = np.max(np.abs(twist[self._frozen]), initial=0.0)
        over["speed"] = max(over["speed"], float(np.nanmax(np.abs(twist) / self._speed)) - 1, frozen)
        over["acceleration"] = max(over["acceleration"], float(np.max((np.abs(slope) - rounding) / self._most)) - 1)
        over["jerk"] = max(over["jerk"], float(np.max(jerk / self._jerk)) - 1)
        self._twist, self._slope, self._lasted = twist, slope, dt


class Faults:
    """Whether the loop says in time that the robot does something else, from the same reports that the loop gets."""

    def __init__(self, case: Case, found: Found) -> None:
        """Nothing moved yet."""
        robot = case.declared
        self._found, self._noise = found, np.repeat([robot.pose_noise, np.radians(robot.pose_noise_deg)], 3)
        self._rest, self._since, self._said = 10.0, 0.0, False
        self._expected: np.ndarray | None = None
        self._drift, self._sent = np.zeros(6), (np.zeros(6), 0.0)

    def judge(self, given: dict[str, Any], reason: str, twist: np.ndarray, dt: float, late: float) -> None:
        """Compare motion since the object last stood still; `late`: how much longer than `dt` the twist will last."""
        before, lasted = self._sent
        apart: list[np.ndarray] = []
        if "pose" in given:
            expected = given["pose"] if self._expected is None else moved(self._expected, before * lasted)
            apart.append(_between(expected, given["pose"]))
            self._expected = expected
        if "twist" in given:
            self._drift += (given["twist"] - before) * lasted
            # An integral of samples is off by half a period.
            apart.append(np.sign(self._drift) * np.maximum(np.abs(self._drift) - dt / 2 * np.abs(before), 0))
        sizes = [(np.linalg.norm(each[:3]) - self._noise[0]) / 0.001 for each in apart]
        sizes += [(np.linalg.norm(each[3:]) - self._noise[3]) / np.radians(0.2) for each in apart]
        self._since = self._since + lasted if max(sizes, default=0.0) > 1 else 0.0
        if reason.startswith("robot") or "; robot" in reason:
            self._found.named.append(reason)
            self._said = True
        if self._since > 0.2 and not self._said:
            self._found.unnamed += 1
            self._said = True
        self._rest = 0.0 if np.any(twist) else self._rest + dt
        if self._rest > 0.1:
            self._expected, self._drift, self._since, self._said = None, np.zeros(6), 0.0, False
        self._sent = (twist, dt)


def _between(expected: np.ndarray, pose: np.ndarray) -> np.ndarray:
    turned = pose[:3, :3] @ expected[:3, :3].T
    sines = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    return np.concatenate([pose[:3, 3] - expected[:3, 3], sines])


def outside(problem: Problem, pose: np.ndarray) -> np.ndarray:
    """Return by how much a pose (4, 4) is beyond (box [mm], cone [deg]); negative inside."""
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    beyond = np.maximum(np.asarray(box.lower) - pose[:3, 3], pose[:3, 3] - np.asarray(box.upper))[
        problem.twist_limit.speed[:3] > 0
    ]
    toward, axis = np.asarray(cone.direction), pose[:3, 0]
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(toward, axis)), toward @ axis)) - cone.half_angle_deg
    return np.array([1e3 * np.max(beyond, initial=-np.inf), angle])


@cache
def narrow(name: str, declared: DeclaredRobot) -> Problem:
    """Return a problem with walls all around the object, and a robot."""
    problem = load_problem(name)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    middle = (lower + upper) / 2
    walls = WorkspaceBox(tuple(np.maximum(lower, middle - ROOM)), tuple(np.minimum(upper, middle + ROOM)))
    kept = [limit for limit in problem.limits if limit not in (box, cone)]
    return problem.replace(limits=[*kept, walls, AxisCone(cone.direction, min(TILT, cone.half_angle_deg))], robot=declared)


def drive(
    problem: Problem,
    case: Case,
    reports: str,
    step: Callable[..., Any],
    brake: Callable[..., Any],
    seconds: float,
    seed: int,
    enable: bool = True,
) -> Found:
    """Drive the object about for some seconds and judge everything."""
    rng, found = np.random.default_rng([seed, 11]), Found()
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = (np.asarray(box.lower) + np.asarray(box.upper)) / 2, frame_of(np.asarray(cone.direction))
    robot = OddRobot(case, pose, np.random.default_rng([seed, 12]))
    sent, faults = Sent(problem, found), Faults(case, found)
    comfort, dt, time, until = stand_in(problem), problem.dt, 0.0, 0.0
    posture, first = comfort, {"pose": pose}
    while time < seconds:
        if time >= until:
            posture, until = np.clip(comfort + 0.6 * rng.normal(size=32), LOWER, UPPER), until + JUMP
        meant, late = period(case, dt, rng)
        given = told(case, robot, reports) | first
        answer = step(posture, **given, dt=meant, enable=enable)
        first = {}
        _send(problem, found, robot, sent, answer.twist, meant, 0.0 if case.periods == "watched" else late)
        faults.judge(given, answer.reason, answer.twist, meant, late)
        found.twists.append(answer.twist)
        time += meant + late
        if case.periods == "watched":
            for _ in range(round(late / dt)):
                answer = brake(dt)
                _send(problem, found, robot, sent, answer.twist, dt, 0.0)
                faults.judge(told(case, robot, reports), answer.reason, answer.twist, dt, 0.0)
    return found


def _send(problem: Problem, found: Found, robot: OddRobot, sent: Sent, twist: np.ndarray, meant: float, late: float) -> None:
    sent.judge(twist, meant)
    before = robot.pose
    parts = max(1, round((meant + late) / 0.005))
    for _ in range(parts):
        for pose in robot.execute(twist, (meant + late) / parts):
            beyond = outside(problem, pose)
            found.outside = np.maximum(found.outside, beyond)
            found.at_wall, found.moments = found.at_wall + bool(np.any(beyond > NEAR)), found.moments + 1
    found.path += float(np.linalg.norm(robot.pose[:3, 3] - before[:3, 3]))


@cache
def _stepper(name: str, declared: DeclaredRobot, form: str) -> Any:
    problem = narrow(name, declared)
    if form == "c":
        return _CStepper(problem)
    return problem.stepper(compiled=form == "compiled")


class _CStepper:
    """The exported step, called as the one in Python."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self._scratch = problem, tempfile.TemporaryDirectory()
        folder, self._wrapper = built(problem, Path(self._scratch.name) / "step")
        self._stepper = self._wrapper.Stepper(str(folder / "build/libergoqp_step.so"))

    def reset(self) -> None:
        self._stepper.reset()

    def step(self, posture: np.ndarray, **given: Any) -> Any:
        return _CAnswer(self._stepper.step(posture, **given))

    def brake(self, dt: float) -> Any:
        return _CAnswer(self._stepper.brake(dt))


class _CAnswer:
    def __init__(self, output: Any) -> None:
        self.twist, self.reason = np.array(output.twist[:]), "robot: " if output.fault else ""


Ran = tuple[str, Case, dict[str, Found], dict[str, float]]


def runs_of_all(name: str, alike: list[Case], seconds: float, seed: int, forms: tuple[str, ...]) -> list[Ran]:
    """Run the robots of which the same is declared, which share a step."""
    return [runs_of(name, case, seconds, seed, forms) for case in alike]


def runs_of(name: str, case: Case, seconds: float, seed: int, forms: tuple[str, ...]) -> Ran:
    """Return what every way of reporting gives for one robot on one problem, and how far other forms of the step are off."""
    problem, found, apart = narrow(name, case.declared), {}, {}
    for reports in REPORTS:
        stepper = _stepper(name, case.declared, "interpreted")
        stepper.reset()
        found[reports] = drive(problem, case, reports, stepper.step, stepper.brake, seconds, seed)
        for form in forms:
            other = _stepper(name, case.declared, form)
            other.reset()
            same = drive(problem, case, reports, other.step, other.brake, seconds, seed)
            apart[form] = max(
                apart.get(form, 0.0), float(np.abs(np.array(same.twists) - np.array(found[reports].twists)).max())
            )
    return name, case, found, apart


def people_of(name: str, seeds: range, duration: float) -> tuple[int, int]:
    """Return (closed loops with people on declared robots, how many end worse than they begin)."""
    worse = count = 0
    for lag, delay in ((0.1, 0.0), (0.2, 0.0), (0.05, 0.05)):
        problem = load_problem(name).replace(robot=DeclaredRobot(lag=lag, delay=delay, pose_noise=0.001, pose_noise_deg=0.2))
        stepper = problem.stepper()
        for seed in seeds:
            person = sample_person(problem, seed)
            start = start_at(person, awkward_start(problem, person, seed, 10))
            trace = run_loop(problem, person, start, duration=duration, seed=seed, stepper=stepper, stop_when_still=2.0)
            rest, reached = person.settle(trace.postures[-1], trace.poses[-1], start.grasp, start.soles)
            scores = problem.assess(np.array([trace.postures[0], rest if reached else trace.postures[-1]])).final
            count, worse = count + 1, worse + int(scores[1] > scores[0])
    return count, worse


def measure(report: Report) -> None:
    """Run everything in two processes."""
    names, seconds = report.pick(TASKS[3:], TASKS), report.pick(1.6, 6.0)
    alike: dict[DeclaredRobot, list[Case]] = {}
    for case in cases(0.01):
        alike.setdefault(case.declared, []).append(case)
    results: list[Ran] = []
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        futures = [
            pool.submit(runs_of_all, name, some, seconds, seed, _forms(report, name, some[-1]))
            for name in names
            for some in alike.values()
            for seed in range(report.pick(1, 3))
        ]
        seeds, duration = range(30, report.pick(31, 36)), report.pick(8.0, 16.0)
        loops = [pool.submit(people_of, name, seeds, duration) for name in report.pick(names[-1:], names)]
        for done, future in enumerate(futures, start=1):
            results += future.result()
            if done % 10 == 0:
                report.say(f"{done}/{len(futures)}")
        people = [future.result() for future in loops]
    _figures(report, results)
    report.figure("loops", sum(count for count, _ in people))
    report.figure("worse_than_start", sum(worse for _, worse in people))


def _forms(report: Report, name: str, case: Case) -> tuple[str, ...]:
    """Compiled steps take some ten seconds each to build, so only some robots have them."""
    some = case.declared == NONE or case.name.startswith("everything")
    return ("compiled", "c") if report.full and some and name in ("screwing", "desk") else ()


def _figures(report: Report, results: list) -> None:
    ran = [(name, case, reports, found) for name, case, every, _ in results for reports, found in every.items()]
    for what in ("speed", "acceleration", "jerk"):
        report.figure(f"over_{what}", max(found.over[what] for *_, found in ran))
    kept = [
        (name, case, reports, found)
        for name, case, reports, found in ran
        if case.honest
        and (reports in ("pose", "both") or not (case.declared.gain_error or case.declared.pose_noise or case.kind.speed_noise))
    ]
    slow = [one for one in ran if one[1].slow and one[2] in ("pose", "both")]
    others = [one for one in ran if not one[1].honest]
    seen, unseen = ([one for one in others if (one[2] in ("pose", "both")) == told] for told in (True, False))
    groups = (("declared", kept), ("undeclared_20ms", slow), ("undeclared", seen), ("undeclared_unseen", unseen))
    for label, chosen in groups:
        for number, unit in enumerate(("mm", "deg")):
            worst = max(chosen, key=lambda one: one[3].outside[number])
            report.figure(f"outside_{unit}.{label}", worst[3].outside[number], f"{worst[0]}, {worst[1].name}, {worst[2]}")
    moments = sum(found.moments for *_, found in kept)
    report.figure(
        "at_wall_share",
        sum(found.at_wall for *_, found in kept) / moments,
        "of the time, declared robots: within 2 mm or 0.4 deg",
    )
    heard = [one for one in ran if one[2] != "nothing"]
    blamed = {f"{one[1].name} ({one[2]})" for one in heard if one[3].unnamed and not one[1].honest}
    report.figure("unnamed_faults", sum(one[3].unnamed for one in heard if not one[1].honest), ", ".join(sorted(blamed))[:150])
    wrong = {f"{one[1].name} ({one[2]}): {one[3].named[0]}" for one in ran if one[1].honest and one[3].named}
    report.figure("false_faults", sum(bool(one[3].named) for one in ran if one[1].honest), "; ".join(sorted(wrong))[:200])
    path: dict[str, float] = {}
    for _, case, reports, found in kept:
        if reports == "pose" and case.periods == "even":
            kind = "ideal" if case.name == "ideal" else "declared" if case.declared != NONE else ""
            path[kind] = path.get(kind, 0.0) + found.path
            path[f"{kind} runs"] = path.get(f"{kind} runs", 0) + 1
    mean = {kind: path[kind] / path[f"{kind} runs"] for kind in ("ideal", "declared")}
    report.figure("path_share.declared", mean["declared"] / mean["ideal"], f"of {mean['ideal']:.2f} m")
    still = drive(
        narrow("screwing", NONE),
        Case("ideal"),
        "pose",
        (s := _stepper("screwing", NONE, "interpreted")).step,
        s.brake,
        1.0,
        0,
        False,
    )
    report.figure("still.path_m", still.path, "not enabled")
    for form in ("compiled", "c"):
        apart = [each[form] for *_, each in results if form in each]
        if apart:
            report.figure(f"{form}.difference", max(apart), "m/s, rad/s")
    said: dict[str, int] = {}
    for *_, found in ran:
        for reason in dict.fromkeys(found.named):
            words = " ".join(word for word in reason.split() if not any(letter.isdigit() for letter in word))
            said[words] = said.get(words, 0) + 1
    for words, count in sorted(said.items(), key=lambda item: -item[1])[:12]:
        report.say(f"  {count:>5}  {words}")


if __name__ == "__main__":
    run(measure, __doc__ or "")
