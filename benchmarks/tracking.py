"""Robots that do other than sent: what is sent, where the object really is, what is said of it.

Run ``python -m benchmarks.tracking [--quick | --full] [--json FILE]``. Every robot of
`benchmarks.tracking_robots` on every problem, with pose, twist, both, a pose that is lost for two
thirds of the time, or nothing reported. The object is driven by a posture that jumps about and
follows nobody, in a box of 6 cm and a cone of 6 degrees, so that it is led into every wall again
and again; the robot is simulated apart from the step, exactly, and judged inside the periods too.

Sent against limits, all robots, relative to the limit, at most:

- ``over_speed``, ``over_acceleration``, ``over_jerk`` (of 2 a / W, between the middles of periods;
  rounding of the difference of two twists is not jerk).

The true object, where a pose is reported or nothing but time is between the twist and it (no gain
error, no noise):

- ``outside_mm.declared``, ``outside_deg.declared``: beyond box and cone at most, robots exactly as
  declared and up to that;
- ``outside_mm.undeclared_20ms``, ``outside_deg.undeclared_20ms``: robots that are up to 20 ms late
  and not declared, whatever is reported all the time; ``..._lost``: whose pose is lost for two
  thirds of the time;
- ``outside_mm.undeclared``, ``outside_deg.undeclared``: all that do something else than declared,
  and are measured; ``..._unseen``: whose pose is not: the control of these figures;
- ``outside_mm.untold``, ``outside_deg.untold``: the declared robots again, with a step that is told
  nothing of them and sees nothing: what holds the others is what it is told;
- ``at_wall_share``: how much of the time the objects of declared robots are within 2 mm of a wall
  or 0.4 deg of the cone's end.

What is said, where a pose or a twist is reported:

- ``unnamed_faults``: motions in which reported and declared motion differ by more than 1 mm or 0.2
  deg (beyond the declared noise) for 0.2 s and no ``robot: ...`` is said. Noise of the reported
  speed alone is no fault.
- ``false_faults``: runs of robots that keep what is declared in which one is said.
- ``unnamed_faults.silent``, ``false_faults.simple``: the controls. A watch that says nothing leaves
  so many unnamed; one that knows nothing of a robot's delay and lag and says whatever differs from
  what was sent by that much, for that long, blames so many of the runs of robots that keep what is
  declared.

Where the pose is given once and then only a twist (`benchmarks.tracking_twists`):

- ``outside_mm.wrong_twist``, ``outside_deg.wrong_twist``: an ideal robot that reports its twist
  wrongly; ``.acknowledged``: and its stop is acknowledged every two seconds; ``.believed``: the
  control, a step that takes the integral of the report for its pose; ``path_m...``: their paths;
- ``path_share.noisy_twist``: path with a noisy twist over that with the true one.

Robots that turn without rest for half a minute (`benchmarks.tracking_faults`):

- ``turning_runs``, ``false_faults.turning``: runs of robots as declared, and those of them in which
  a fault is said (they count in ``false_faults`` too); ``unnamed_faults.near``: robots whose gain
  is 0.03 beyond the declared one, or whose lag is 1.3 times as long, not named within 3 s.

And ``path_share.declared``: path of the declared robots' objects over that of the ideal robot's,
all together, driven in the problems' own workspaces; ``path_share.worst`` of the robot that loses
most, ``path_share.narrow`` in the small box, where a wall is always near. ``still.path_m`` is the
longest path with the object not enabled, the control of all these. ``worse_than_start``: closed
loops with people who follow (the benchmarks' own, `benchmarks.closed_loop`) on declared robots that
end at a worse score than they began with; ``loops`` how many. ``FORM.difference``: largest
difference of what is sent from the interpreted step, in the same calls.
"""

from __future__ import annotations

from concurrent.futures import Executor

import numpy as np

from benchmarks.kept import KeptPool
from benchmarks.report import Report, run
from benchmarks.tracking_faults import declarations, honest, near
from benchmarks.tracking_judges import Found
from benchmarks.tracking_loops import drive, driven, stepper_of
from benchmarks.tracking_robots import NONE, Case, cases
from benchmarks.tracking_twists import LIES, NOISES, believed, drive_blind
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.loop import run_loop
from ergoqp.step.stepper import Stepper

REPORTS = ("pose", "twist", "both", "lost", "nothing")

UNTOLD = "untold"
"""Nothing is reported, and nothing is declared either."""

OWN = "own workspace"
"""Beside the ways of reporting: with the pose, in the workspace of the problem."""

Ran = tuple[str, Case, dict[str, Found], dict[str, float]]


def runs_of_all(
    name: str, alike: list[Case], seconds: float, seed: int, forms: tuple[str, ...]
) -> list[Ran]:
    """Run the robots of which the same is declared, which share a step."""
    return [runs_of(name, case, seconds, seed, forms) for case in alike]


def runs_of(name: str, case: Case, seconds: float, seed: int, forms: tuple[str, ...]) -> Ran:
    """Return what every way of reporting gives for one robot on one problem.

    Also return how far other forms of the step are off.
    """
    problem, found, apart = driven(name, case.declared), {}, {}
    if case.honest and case.periods == "even":
        stepper = stepper_of(name, case.declared, narrow=False)
        stepper.reset()
        found[OWN] = drive(
            stepper.problem, case, "pose", stepper.step, stepper.brake, seconds, seed
        )
        if case.declared != NONE:
            stepper = stepper_of(name, NONE)
            stepper.reset()
            found[UNTOLD] = drive(
                stepper.problem, case, "nothing", stepper.step, stepper.brake, seconds, seed
            )
    for reports in REPORTS:
        stepper = stepper_of(name, case.declared)
        stepper.reset()
        found[reports] = drive(problem, case, reports, stepper.step, stepper.brake, seconds, seed)
        for form in forms:
            other = stepper_of(name, case.declared, form)
            other.reset()
            same = drive(problem, case, reports, other.step, other.brake, seconds, seed)
            apart[form] = max(
                apart.get(form, 0.0),
                float(np.abs(np.array(same.twists) - np.array(found[reports].twists)).max()),
            )
    return name, case, found, apart


def people_of(name: str, seeds: range, duration: float) -> tuple[int, int]:
    """Return (closed loops with people on declared robots, how many end worse than they begin)."""
    worse = count = 0
    for lag, delay in ((0.1, 0.0), (0.2, 0.0), (0.05, 0.05)):
        problem = load_problem(name).replace(
            robot=DeclaredRobot(lag=lag, delay=delay, pose_noise=0.001, pose_noise_deg=0.2)
        )
        stepper = Stepper(problem)
        for seed in seeds:
            person = sample_person(problem, seed)
            start = person.start_at(awkward_start(problem, person, seed, 10))
            trace = run_loop(
                problem,
                person.holding(start),
                duration=duration,
                seed=seed,
                controller=stepper,
                stop_when_still=2.0,
            )
            rest, reached = person.settle(
                trace.postures[-1], trace.poses[-1], start.grasp, start.soles
            )
            scores = problem.assess(
                np.array([trace.postures[0], rest if reached else trace.postures[-1]])
            ).final
            count, worse = count + 1, worse + int(scores[1] > scores[0])
    return count, worse


def measure(report: Report) -> None:
    """Run everything in two processes."""
    names, seconds = report.pick(TASKS[3:], TASKS), report.pick(1.2, 6.0)
    alike: dict[DeclaredRobot, list[Case]] = {}
    for case in cases(0.01):
        alike.setdefault(case.declared, []).append(case)
    results: list[Ran] = []
    with KeptPool(report, "tracking") as pool:
        futures = [
            pool.submit(runs_of_all, name, some, seconds, seed, _forms(report, name, some[-1]))
            for name in names
            for some in alike.values()
            for seed in range(report.pick(1, 3))
        ]
        seeds, duration = range(30, report.pick(31, 36)), report.pick(8.0, 16.0)
        loops = [
            pool.submit(people_of, name, seeds, duration) for name in report.pick(names[-1:], names)
        ]
        blind = _Blind(report, pool)
        turning = _Turning(report, pool)
        for done, future in enumerate(futures, start=1):
            results += future.result()
            if done % 10 == 0:
                report.say(f"{done}/{len(futures)}")
        people = [future.result() for future in loops]
        blind.figures(report)
        false = turning.figures(report)
    _figures(report, results, false)
    report.figure("loops", sum(count for count, _ in people))
    report.figure("worse_than_start", sum(worse for _, worse in people))


class _Blind:
    """Ideal robots that report a wrong twist, or a noisy one, and never their pose."""

    def __init__(self, report: Report, pool: Executor) -> None:
        seconds = report.pick(6.0, 120.0)
        seeds = range(report.pick(1, 3))
        self._runs = {
            label: [
                pool.submit(drive_blind, kind, near, said, seconds, seed)
                for kind in LIES
                for near in (False, True)
                for seed in seeds
            ]
            for label, said in (("wrong_twist", False), ("acknowledged", True))
        }
        self._runs["believed"] = [
            pool.submit(believed, kind, near, seconds, 0) for kind in LIES for near in (False, True)
        ]
        self._noisy = {
            size: [
                pool.submit(drive_blind, f"noise {size}", near, False, seconds, seed)
                for near in (False, True)
                for seed in seeds
            ]
            for size in NOISES
        }

    def figures(self, report: Report) -> None:
        for label, futures in self._runs.items():
            runs = [future.result() for future in futures]
            report.figure(f"outside_mm.{label}", max(run[0] for run in runs), f"{len(runs)} runs")
            report.figure(f"outside_deg.{label}", max(run[1] for run in runs))
            report.figure(f"path_m.{label}", float(np.mean([run[2] for run in runs])))
        paths = {
            size: sum(future.result()[2] for future in futures)
            for size, futures in self._noisy.items()
        }
        true = paths.pop(0.0)
        report.figure(
            "path_share.noisy_twist",
            min(paths.values()) / true,
            f"of {true:.2f} m with true twists",
        )


class _Turning:
    """Robots that turn without rest, as declared and a little beyond it."""

    def __init__(self, report: Report, pool: Executor) -> None:
        count, runs, seconds = report.pick(6, 200), report.pick(1, 10), report.pick(8.0, 30.0)
        self._honest = [
            pool.submit(honest, declared, names, runs, seconds, number)
            for number, (declared, names) in enumerate(declarations(count, seed=7))
        ]
        self._near = [pool.submit(near, number, 7) for number in range(report.pick(3, 100))]

    def figures(self, report: Report) -> int:
        runs = [run for future in self._honest for run in future.result()]
        false = [(names, kind, said[0]) for names, _, kind, said in runs if said]
        report.figure("turning_runs", len(runs), "every pair and triple of what can be declared")
        report.figure("false_faults.turning", len(false), str(false[:2])[:200])
        near_runs = [run for future in self._near for run in future.result()]
        unnamed = [(names, declared, kind) for names, declared, kind, said in near_runs if not said]
        report.figure(
            "unnamed_faults.near", len(unnamed), f"of {len(near_runs)} {str(unnamed[:1])[:200]}"
        )
        return len(false)


def _forms(report: Report, name: str, case: Case) -> tuple[str, ...]:
    """Compiled steps take some ten seconds each to build, so only some robots have them."""
    some = case.declared == NONE or case.name.startswith("everything")
    return ("compiled", "c") if report.full and some and name in ("screwing", "desk") else ()


def _figures(report: Report, results: list, false_turning: int) -> None:
    every_run = [
        (name, case, reports, found)
        for name, case, every, _ in results
        for reports, found in every.items()
    ]
    untold, ran = (
        [one for one in every_run if (one[2] == UNTOLD) == told] for told in (True, False)
    )
    for what in ("speed", "acceleration", "jerk"):
        report.figure(f"over_{what}", max(found.over[what] for *_, found in ran))
    kept = [
        (name, case, reports, found)
        for name, case, reports, found in ran
        if case.honest
        and (
            reports in ("pose", "both", OWN)
            or not (case.declared.gain_error or case.declared.pose_noise or case.kind.speed_noise)
        )
    ]
    slow, lost = (
        [one for one in ran if one[1].slow and (one[2] == "lost") == told] for told in (False, True)
    )
    others = [one for one in ran if not one[1].honest]
    seen, unseen = (
        [one for one in others if (one[2] in ("pose", "both")) == told] for told in (True, False)
    )
    groups = (
        ("declared", kept),
        ("untold", untold),
        ("undeclared_20ms", slow),
        ("undeclared_20ms_lost", lost),
        ("undeclared", seen),
        ("undeclared_unseen", unseen),
    )
    for label, chosen in groups:
        for number, unit in enumerate(("mm", "deg")):
            worst = max(chosen, key=lambda one: one[3].outside[number])
            report.figure(
                f"outside_{unit}.{label}",
                worst[3].outside[number],
                f"{worst[0]}, {worst[1].name}, {worst[2]}",
            )
    moments = sum(found.moments for *_, found in kept)
    report.figure(
        "at_wall_share",
        sum(found.at_wall for *_, found in kept) / moments,
        "of the time, declared robots: within 2 mm or 0.4 deg",
    )
    heard = [one for one in ran if one[2] != "nothing"]
    blamed = {f"{one[1].name} ({one[2]})" for one in heard if one[3].unnamed and not one[1].honest}
    report.figure(
        "unnamed_faults",
        sum(one[3].unnamed for one in heard if not one[1].honest),
        ", ".join(sorted(blamed))[:150],
    )
    report.figure("unnamed_faults.silent", sum(one[3].apart for one in heard if not one[1].honest))
    wrong = {
        f"{one[1].name} ({one[2]}): {one[3].named[0]}"
        for one in ran
        if one[1].honest and one[3].named
    }
    report.figure(
        "false_faults",
        sum(bool(one[3].named) for one in ran if one[1].honest) + false_turning,
        "; ".join(sorted(wrong))[:200],
    )
    honest = [one for one in heard if one[1].honest]
    report.figure(
        "false_faults.simple", sum(one[3].apart > 0 for one in honest), f"of {len(honest)} runs"
    )
    _paths(report, kept)
    stepper = stepper_of("screwing", NONE)
    still = drive(
        stepper.problem, Case("ideal"), "pose", stepper.step, stepper.brake, 1.0, 0, enable=False
    )
    report.figure("still.path_m", still.path, "not enabled")
    for form in ("compiled", "c"):
        apart = [each[form] for *_, each in results if form in each]
        if apart:
            report.figure(f"{form}.difference", max(apart), "m/s, rad/s")
    said: dict[str, int] = {}
    for *_, found in ran:
        for reason in dict.fromkeys(found.named):
            words = " ".join(
                word for word in reason.split() if not any(letter.isdigit() for letter in word)
            )
            said[words] = said.get(words, 0) + 1
    for words, count in sorted(said.items(), key=lambda item: -item[1])[:12]:
        report.say(f"  {count:>5}  {words}")


def _paths(report: Report, kept: list) -> None:
    for label, where in (("declared", OWN), ("narrow", "pose")):
        paths: dict[str, list[float]] = {}
        for _, case, reports, found in kept:
            if reports == where and (case.name == "ideal" or case.declared != NONE):
                paths.setdefault(case.name, []).append(found.path)
        ideal = float(np.mean(paths.pop("ideal")))
        shares = {name: float(np.mean(values)) / ideal for name, values in paths.items()}
        report.figure(
            f"path_share.{label}", float(np.mean(list(shares.values()))), f"of {ideal:.2f} m"
        )
        if where == OWN:
            worst = min(shares, key=lambda name: shares[name])
            report.figure("path_share.worst", shares[worst], worst)


if __name__ == "__main__":
    run(measure, __doc__ or "")
