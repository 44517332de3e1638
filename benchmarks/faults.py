"""Faults of the service, its clients and what is between them, with a robot of its own clock.

Run ``python -m benchmarks.faults [--quick | --full] [--json FILE] [--keep FOLDER]``. ``--quick``
takes 40 faults, and needs about three minutes on two cores: it does not fit into 45 s. ``--full``
takes 500, about half an hour; with ``--keep`` it goes on where it was ended, and the files of
trials that were not as expected stay in that folder.

Each trial has a problem of its own (a wall across the way, a cone that the turn leaves, a ball
beside the way) and a robot of its own inside what the problem declares: lag 0 to 150 ms, delay 0
to 40 ms, gain 0.95 to 1.05, noise of the pose. Service, robot, loop and relay are processes. One
fault is injected at a random time while the object moves. `KINDS` of `benchmarks.faults_kinds`
states how each is answered. Judged are, by formulas of `benchmarks.faults_judge` alone:

- what was commanded: speed, acceleration and jerk (2 a / W), per period of the loop; behind a relay
  over one period of the stream at 1 kHz, by its own time stamps. Behind the robot's own timeout,
  its ramp is the robot's own, and what comes after it is judged from there;
- the true pose of the object, every millisecond: workspace, ball and cone.

Figures:

- ``injected``: faults; ``unsafe``: trials in which anything was beyond the declaration. Wanted 0.
- ``outside_mm``, ``outside_deg``: largest distance beyond workspace or into the ball, and angle
  beyond the cone; negative: inside. ``acceleration_factor``, ``jerk_factor``, ``speed_factor``:
  largest share of the limit.
- ``control.outside_mm``, ``control.unsafe`` (a share), ``control.acceleration_factor``,
  ``control.jerk_factor``: the same of loops that hold their last twist, and of one that is killed
  with nothing beside the robot. They must fail.
- ``rest_late_s``: how much later than the stop's time the commanded twist was zero, where no answer
  came until then.
- ``back_s``: longest time from the end of a fault of the worker until a fresh answer moves the
  object again, minus the time of the stop, and of the robot's own way to rest after it was sent
  zero (its delay and lag), if the loop had to wait for that. Wanted <= 0.3.
  ``supervisor_back_s``: the same for a supervisor that is started again at once. Wanted <= 1.
- ``free.back_s``, ``free.supervisor_back_s``: without the time in which supervisor and worker were
  ready to run, and the machine gave its processors to others (`/proc/PID/schedstat`).
- ``exempt.acceleration_factor``, ``exempt.jerk_factor``: of programs that take over a motion (a
  reported twist has no slope, so the jerk is not held), and of clients without a relay that lie
  about what was executed. They do not count as unsafe for that, but for all else.
- ``record_lost``, ``record_wrong``: steps missing in records without being counted there, and steps
  that a replay computes otherwise. Wanted 0 wrong.
- ``unexpected``: trials whose answer was not the stated one, by what was said on the wire.
- ``late_machine``: trials in which the machine kept the robot or the relay from its clock for more
  than 5 ms. They are judged like all others.
- ``KIND.unsafe``, ``KIND.count``.

What cannot be injected from outside: a garbage collector that is on in the worker (there is no such
switch; `settle_in` freezes and disables it). The jump of the wall clock is made by a library that
the service loads, because the machine's own clock is not ours to set; `faults_clock.c`.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.faults_judge import NEVER, Found, back, judge, rest_late, settles
from benchmarks.faults_kinds import KINDS
from benchmarks.faults_trial import NotMovingError, Trial, built
from benchmarks.faults_world import draw_world
from benchmarks.report import Report, run
from ergoqp.errors import ErgoqpError
from ergoqp.service.record import Record, record_lost
from ergoqp.service.replayed import record_wrong
from ergoqp.service.worker import die_with_parent

FAULT: Final = (0.05, 1.2)
"""When the fault comes, after the object began to move [s]."""
_SIDE_BY_SIDE: Final = 2
_TRIES: Final = 4
_LONGEST_BACK: Final = 8.0
"""How long it is waited for the object to move again [s]."""
_LATE: Final = 0.005
_SEED: Final = 47
"""Seed of the list of trials: which kinds, with which seeds."""
_OUTCOMES: Final = "outcomes.jsonl"
_SHORTEST: Final = (
    "worker_kill",
    "worker_kill_relay",
    "worker_kill_twice",
    "worker_stop_0.05",
    "worker_stop_0.2",
    "worker_stop_0.6_relay",
    "supervisor_kill",
    "supervisor_stop_kill",
    "client_kill_relay",
    "client_kill_0.1_relay",
    "client_kill_takes",
    "client_stop_0.2_relay",
    "client_kill_again_hold",
    "client_stop_0.09_hold",
    "client_stop_0.2_hold",
    "recorder_kill",
    "worker_kill_recorded",
    "disk_full",
    "two_clients",
    "two_loops",
    "garbage",
    "nan",
    "own_garbage",
    "replayed",
    "skipped",
    "sequence_again",
    "deaf",
    "clock",
    "load_in_motion",
    "web_page",
    "busy",
    "control_naive",
    "control_naive_stop",
    "control_client_kill",
)


def trial(kind: str, seed: int, keep: str = "") -> dict[str, Any]:
    """Run one trial; return what was found.

    Args:
        kind: name of the kind.
        seed: of everything that is drawn.
        keep: folder for the files of a trial that was not as expected; empty: they are removed.
    """
    for again in range(_TRIES):
        folder = Path(tempfile.mkdtemp(prefix="eqf"))
        try:
            found = _trial(kind, seed + 100_000 * again, folder)
            if keep and (found.unsafe or found.wrong) and not KINDS[kind].control:
                _keep(folder, Path(keep) / f"{kind}-{seed}")
            return {"kind": kind, "seed": seed, **asdict(found)}
        except NotMovingError:
            continue
        except Exception:
            return {"kind": kind, "seed": seed, "error": traceback.format_exc()}
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return {"kind": kind, "seed": seed, "error": "the object never moved"}


def _keep(folder: Path, into: Path) -> None:
    """Copy the files of a trial; sockets cannot be."""
    into.mkdir(parents=True, exist_ok=True)
    for path in folder.iterdir():
        if path.is_file():
            shutil.copy(path, into / path.name)


def _trial(kind: str, seed: int, folder: Path) -> Found:
    """Run one trial in a folder.

    Raises:
        NotMovingError: if the object did not move, so that nothing can be said.
    """
    rng, spec = np.random.default_rng(seed), KINDS[kind]
    world = draw_world(rng, folder, spec.setup.relayed, spec.setup.hold)
    one = Trial(world, spec.setup, folder, rng)
    try:
        spec.before(one)
        wait = float(rng.uniform(*FAULT))
        one.begin(mischief=0.3 + wait)
        time.sleep(max(0.0, one.moved + wait - time.monotonic()))
        before = one.waited() if spec.group else {}
        fault = time.monotonic()
        over = spec.inject(one)
        waited = _wait_for_motion(one, over, before) if spec.group else -1.0
        time.sleep(max(0.0, over + spec.after - time.monotonic()))
    finally:
        one.end()
    found, rows = judge(world, folder, spec.setup.relayed, spec.exempt), one.loop_rows()
    found.wrong += one.notes
    if spec.group:
        found.back_s = back(rows, over) - settles(rows, folder, fault)
        found.waited_s = waited
        found.rest_late_s = rest_late(rows, folder, fault, spec.setup.relayed)
    if spec.setup.recorded:
        _judge_records(found, folder)
    return found


def _wait_for_motion(one: Trial, over: float, before: dict[int, float]) -> float:
    """Wait until the object moves again; return how long the machine kept the service waiting."""
    while time.monotonic() < over + _LONGEST_BACK and back(one.loop_rows(), over) == NEVER:
        time.sleep(0.02)
    return sum(seconds - before.get(pid, 0.0) for pid, seconds in one.waited().items())


def _judge_records(found: Found, folder: Path) -> None:
    """Compute the steps of a trial's records again."""
    paths = sorted(folder.glob("record*.mcap"), key=lambda path: (len(path.name), path.name))
    paths = [path for path in paths if path.stat().st_size]
    try:
        # A recorder that is killed at once leaves a file without a step.
        whole = [path for path in paths if any(True for _ in Record(path).messages())]
        found.record_lost, found.record_wrong = record_lost(*paths), record_wrong(*whole)
    except ErgoqpError as error:
        found.wrong.append(f"record: {error}")


def drawn_trials(count: int, everything: bool) -> list[tuple[str, int]]:
    """Return which trials are run: every kind, and more of those that weigh more."""
    rng, kinds = np.random.default_rng(_SEED), list(KINDS) if everything else _SHORTEST
    weights = np.array([KINDS[kind].weight for kind in kinds])
    more = rng.choice(kinds, size=max(0, count - len(kinds)), p=weights / weights.sum())
    names = [*kinds, *map(str, more)]
    return [(name, number) for number, name in enumerate(names)]


def _outcomes(report: Report, jobs: list[tuple[str, int]]) -> list[dict[str, Any]]:
    """Return the outcomes of trials, kept ones included."""
    path, done, keep = None, [], ""
    if report.keep is not None:
        report.keep.mkdir(parents=True, exist_ok=True)
        path, keep = report.keep / _OUTCOMES, str(report.keep)
        if path.exists():
            done = [json.loads(line) for line in path.read_text().splitlines()]
    known = {(each["kind"], each["seed"]) for each in done}
    done = [each for each in done if (each["kind"], each["seed"]) in set(jobs)]
    left = [job for job in jobs if job not in known]
    # How soon a service is back is measured with nothing beside it: its start is all computation.
    alone = [job for job in left if KINDS[job[0]].group == "supervisor"]
    others = [job for job in left if job not in alone]
    begun, number = time.monotonic(), 0
    for count, part in ((_SIDE_BY_SIDE, others), (1, alone)):
        with ProcessPoolExecutor(count, initializer=die_with_parent) as pool:
            for one in as_completed([pool.submit(trial, *job, keep) for job in part]):
                found, number = one.result(), number + 1
                done.append(found)
                if path is not None:
                    with path.open("a") as file:
                        file.write(json.dumps(found) + "\n")
                told = found.get("error") or "; ".join([*found["unsafe"], *found["wrong"]])
                if told and not KINDS[found["kind"]].control:
                    report.say(f"{found['kind']}, seed {found['seed']}: {told.strip()[-300:]}")
                if number % 20 == 0:
                    passed = time.monotonic() - begun
                    report.say(f"{number} of {len(left)} trials in {passed:.0f} s")
    return done


def measure(report: Report) -> None:
    """Measure all figures."""
    for name in ("robot", "loop", "relay"):
        built(name)
    jobs = drawn_trials(report.pick(40, 500), report.full)
    outcomes = _outcomes(report, jobs)
    failed = [each for each in outcomes if "error" in each]
    judged = [each for each in outcomes if "error" not in each]
    control = [each for each in judged if KINDS[each["kind"]].control]
    trials = [each for each in judged if not KINDS[each["kind"]].control]
    report.figure("injected", len(judged), "faults")
    report.figure("failed", len(failed), "trials that say nothing; wanted 0")
    report.figure("unsafe", sum(bool(each["unsafe"]) for each in trials), "wanted 0")
    report.figure("outside_mm", _largest(trials, "outside_mm"), "negative: inside; wanted <= 0")
    report.figure("outside_deg", _largest(trials, "outside_deg"), "likewise")
    strict = [each for each in trials if not KINDS[each["kind"]].exempt]
    lenient = [each for each in trials if KINDS[each["kind"]].exempt]
    report.figure("speed_factor", _largest(trials, "speed"))
    report.figure("acceleration_factor", _largest(strict, "acceleration"), "wanted <= 1")
    report.figure("jerk_factor", _largest(strict, "jerk"), "wanted <= 1")
    report.figure("exempt.acceleration_factor", _largest(lenient, "acceleration"))
    report.figure("exempt.jerk_factor", _largest(lenient, "jerk"))
    report.figure("control.outside_mm", _largest(control, "outside_mm"), "has to be > 0")
    share = np.mean([bool(each["unsafe"]) for each in control]) if control else 0.0
    report.figure("control.unsafe", float(share), "a share; has to be near 1")
    report.figure("control.acceleration_factor", _largest(control, "acceleration"))
    report.figure("control.jerk_factor", _largest(control, "jerk"))
    report.figure("rest_late_s", _largest(trials, "rest_late_s"), "wanted <= 0")
    for name, group, most in (("back_s", "worker", 0.3), ("supervisor_back_s", "supervisor", 1)):
        found = [each for each in trials if KINDS[each["kind"]].group == group]
        report.figure(name, _largest(found, "back_s"), f"wanted <= {most}")
        free = [each["back_s"] - each["waited_s"] for each in found]
        report.figure(f"free.{name}", max(free, default=0.0), f"wanted <= {most}")
    report.figure("record_lost", sum(each["record_lost"] for each in trials))
    report.figure("record_wrong", sum(each["record_wrong"] for each in trials), "wanted 0")
    report.figure("unexpected", sum(bool(each["wrong"]) for each in trials), "wanted 0")
    late = sum(each["robot_late_s"] > _LATE for each in judged)
    report.figure("late_machine", late, "trials")
    report.say(f"{'kind':<26}{'unsafe':>7}{'of':>5}{'mm':>9}{'acc':>7}{'jerk':>7}  expected")
    for kind in KINDS:
        found = [each for each in judged if each["kind"] == kind]
        if not found:
            continue
        unsafe = sum(bool(each["unsafe"]) for each in found)
        report.figure(f"{kind}.unsafe", unsafe, quiet=True)
        report.figure(f"{kind}.count", len(found), quiet=True)
        report.say(
            f"{kind:<26}{unsafe:>7}{len(found):>5}{_largest(found, 'outside_mm'):>9.2f}"
            f"{_largest(found, 'acceleration'):>7.2f}{_largest(found, 'jerk'):>7.2f}"
            f"  {KINDS[kind].expected}"
        )


def _largest(found: list[dict[str, Any]], name: str) -> float:
    return max((each[name] for each in found), default=0.0)


if __name__ == "__main__":
    run(measure, (__doc__ or "").partition("\n")[0])
