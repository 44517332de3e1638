"""Whatever comes in, a safe twist comes out, with a reason that names the cause. ``python -m benchmarks.fuzz``.

Random sequences alternate between sane trajectories (the model person follows, with noise) and attacks (`fuzz_inputs`): on the
five problems, and on random ones with other people, boxes without an inside, cones that exclude the start, narrow ranges.
20 000 steps, 1 000 000 with ``--full``; two processes. Figures:

``exceptions``
    calls that raised anything.
``unsafe``
    steps whose twist broke a limit by `ergoqp.simulation.check.Checker`, which shares no code with the step. Acceleration is
    judged against the twist of the last period (the executed one if it was given and usable), always. A speed above its limit
    is tolerated only where braking from an executed twist beyond it gives no less. Workspace and tool axis may be left by
    nothing but what braking itself forces after the measured pose or the executed twist jumped: from the jump on, the object
    must stay within the worst point of the straight stop from there. On top of the Checker the whole stop from every
    twist sent must stay inside as well, and the pose that the step reckoned with must be the one that was given or sent. The
    model's joints: none is predicted further outside its range, and none moves faster than its limit unless the step says that
    this row gave way.
``certified_share``
    of the steps whose inputs were all usable (nothing wrong, a fresh frame, enabled) and from which some twist other than
    braking is certifiable, the share that was not answered by braking. Wherever the step brakes, without exception, that is
    decided by 60 random reachable twists, each also shortened toward braking, with exact margins in numpy: none of them keeps
    what held through its own stop means that nothing was to be had.
``reasons_wrong``
    steps whose status or sentence does not fit: a wrong input that is not ``invalid`` or not named, a usable one called
    invalid, a joint or limit outside its range that is not named, or one named that is inside.
"""

from __future__ import annotations

import multiprocessing
import traceback
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.fuzz_inputs import Call, attack, random_problem
from benchmarks.report import Report, run
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER, spoken
from ergoqp.limits import AxisCone, JointLimit, WorkspaceBox
from ergoqp.problem import Problem
from ergoqp.problem_file import TASKS, load_problem
from ergoqp.simulation.check import Checker
from ergoqp.step import Step

CHUNK = 5000
SEQUENCE = 250
ALLOWED = 1e-8


@dataclass
class Tally:
    """What one chunk found."""

    steps: int = 0
    judged: int = 0
    answered: int = 0
    counts: Counter = field(default_factory=Counter)
    statuses: Counter = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def wrong(self, figure: str, kind: str, where: str, what: str) -> None:
        """Count something wrong and keep the first of each kind as an example."""
        self.counts[figure] += 1
        self.counts[f"{figure}: {kind}"] += 1
        if self.counts[f"{figure}: {kind}"] <= 2:
            self.examples.append(f"{figure} ({kind}) at {where}: {what}")

    def add(self, other: Tally) -> None:
        """Take over what another chunk found."""
        self.steps, self.judged, self.answered = (
            self.steps + other.steps,
            self.judged + other.judged,
            self.answered + other.answered,
        )
        self.counts += other.counts
        self.statuses += other.statuses
        self.examples += other.examples


# --- the mechanics that the judge reckons with, in numpy alone -----------------------------------------------------------


class Bounds:
    """Limits of a problem as numbers, and how far outside an object is, now and through a stop."""

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        limit = problem.twist_limit
        self.speed, self.acceleration = np.array(limit.speed), np.array(limit.acceleration)
        self.box, self.cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        joints: JointLimit = problem.limit_of(JointLimit)
        self.low, self.high = LOWER.copy(), UPPER.copy()
        for name, ends in joints.ranges_deg.items():
            self.low[INDEX[name]], self.high[INDEX[name]] = np.radians(ends)
        self.rate, self.tolerance = np.radians(joints.rate_deg), np.radians(joints.tolerance_deg)
        self.names = [*(self.box.names if self.box else ()), *(self.cone.names if self.cone else ())]

    def stop_time(self, twist: np.ndarray) -> float:
        """Seconds to rest."""
        return float(np.max(np.abs(twist) / self.acceleration))

    def braked(self, twist: np.ndarray, dt: float) -> np.ndarray:
        """The braking twist."""
        seconds = self.stop_time(twist)
        return twist * max(0.0, 1 - dt / seconds) if seconds > 0 else 0.0 * twist

    def worst(self, pose: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """How far outside each row of the workspace is at worst on the straight way (negative: inside)."""
        parts = []
        if self.box:
            ends = np.stack([pose[:3, 3], pose[:3, 3] + displacement[:3]])
            parts.append(np.maximum(np.asarray(self.box.lower) - ends, ends - np.asarray(self.box.upper)).max(axis=0))
        if self.cone:
            parts.append([self._widest(pose[:3, 0], displacement[3:]) - np.radians(self.cone.half_angle_deg)])
        return np.concatenate(parts) if parts else np.zeros(0)

    def _widest(self, axis: np.ndarray, turn: np.ndarray) -> float:
        """The largest angle to the cone's middle while the axis turns: it runs on a circle, so look where that is farthest."""
        toward, end = np.asarray(self.cone.direction), float(np.linalg.norm(turn))
        axis = axis / np.linalg.norm(axis)
        angles = [0.0, end]
        u = turn / end if end > 0 else np.array([0, 0, 1.0])
        across = axis - u * (u @ axis)
        phase = np.arctan2(toward @ np.cross(u, across), toward @ across)
        angles += [a for a in (phase + np.pi, phase - np.pi) if 0 < a < end]
        reached = [u * (u @ axis) + across * np.cos(a) + np.cross(u, across) * np.sin(a) for a in angles]
        return max(float(np.arctan2(np.linalg.norm(np.cross(toward, a)), toward @ a)) for a in reached)


def moved(pose: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Return a pose after a world-aligned displacement."""
    angle = float(np.linalg.norm(displacement[3:]))
    after = pose.copy()
    after[:3, 3] += displacement[:3]
    if angle > 0:
        x, y, z = displacement[3:] / angle
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        after[:3, :3] = (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross) @ pose[:3, :3]
    return after


# --- one loop ------------------------------------------------------------------------------------------------------------


class Loop:
    """A stepper under test, everything that the judge knows about it, and the person who follows."""

    def __init__(self, problem: Problem, rng: np.random.Generator, tally: Tally) -> None:
        """Build the stepper once."""
        self.problem, self.rng, self.tally = problem, rng, tally
        self.bounds = Bounds(problem)
        self.stepper = problem.stepper()
        self.restart()

    def restart(self) -> None:
        """Start a new sequence."""
        rng = self.rng
        self.stepper.reset()
        comfort = np.asarray(self.problem.response.comfort)  # type: ignore[attr-defined]
        spread = np.radians(rng.choice([0, 10, 30]))
        self.person = np.clip(comfort + spread * rng.normal(size=32), LOWER, UPPER)
        self.measures = str(rng.choice(["integrated", "measured", "noisy"], p=[0.6, 0.3, 0.1]))
        self.sent, self.pose, self.jumped = np.zeros(6), None, True
        self.checker, self.least = Checker(self.problem), None

    def sane(self) -> Call:
        """Return the call of a well-behaved loop."""
        call = Call(np.clip(self.person + np.radians(0.5) * self.rng.normal(size=32), -3.1, 3.1))
        if self.measures != "integrated" and self.pose is not None:
            noise = self.rng.normal(size=6) * [*[2e-4] * 3, *[2e-3] * 3] if self.measures == "noisy" else np.zeros(6)
            call.arguments["pose"] = moved(self.pose, noise)
        return call

    def take(self, call: Call, where: str) -> None:
        """Make a call and judge the answer."""
        where = f"{where} {self.problem.name} [{' '.join(call.names) or 'sane'}]"
        self.tally.steps += 1
        try:
            step = self.stepper.step(call.posture, **call.arguments)
            reason = step.reason
        except BaseException as error:  # whatever it is, the loop must not see it
            if isinstance(error, KeyboardInterrupt):
                raise
            at = traceback.extract_tb(error.__traceback__)[-1]
            kind = f"{type(error).__name__} in {at.name}"
            self.tally.wrong("exceptions", kind, where, f"{error!r} of {call.arguments or call.posture!r}")
            self.restart()
            return
        self.tally.statuses[step.status] += 1
        self._judge_twist(call, step, where)
        self._judge_reason(call, step, reason, where)

    def _judge_twist(self, call: Call, step: Step, where: str) -> None:
        bad = {cause.strip() for cause in call.causes}
        given = call.arguments
        dt = given.get("dt", self.stepper.dt) if "dt is" not in bad else self.stepper.dt
        twist_given = given.get("twist") is not None and "twist" not in bad
        previous = np.asarray(given["twist"], dtype=float) if twist_given else self.sent
        pose_given = given.get("pose") is not None and "pose" not in bad
        posture, seen = self._frame(call)
        expected = np.asarray(given["pose"], dtype=float) if pose_given else self.pose
        if expected is None and posture is not None and seen.all():
            expected = np.array(self.problem.response.contact()(posture)[0])
        if step.twist.shape != (6,) or not np.isfinite(step.twist).all() or not np.isfinite(step.pose).all():
            self.tally.wrong("unsafe", "not finite", where, f"{step.twist}")
            self.restart()
            return
        if expected is not None and np.abs(step.pose - expected).max() > 1e-8:
            self.tally.wrong("unsafe", "pose", where, f"reckoned with {step.pose[:3, 3]}, was at {expected[:3, 3]}")
        # Before any usable frame or pose the object is nowhere yet; after a mismatch, one example is enough.
        anchored = self.pose is not None or pose_given or posture is not None
        pose = step.pose
        same = not twist_given or np.array_equal(previous, self.sent)
        jumped = not same or self.pose is None or (pose_given and np.abs(pose - self.pose).max() > 1e-12)
        after = moved(pose, step.twist * dt)
        broken, amounts = self._hard_rows(pose, previous, after, step.twist, jumped)
        broken += self._checked(step, previous, pose, posture, seen, dt, amounts)
        for name in broken:
            self.tally.wrong("unsafe", name, where, f"{step.status} twist {step.twist} after {previous} {amounts}")
        self._count_certified(call, step, previous, pose, posture, seen, dt, where)
        self.pose = after if anchored else None
        self.sent = step.twist.copy()
        self.person = np.clip(self.person + step.posture_rate * dt, LOWER, UPPER)

    def _frame(self, call: Call) -> tuple[np.ndarray | None, np.ndarray]:
        """The posture that the step may use, None if it is not usable, and which joints of it are seen."""
        seen = np.ones(32, bool)
        if call.posture is None or any(cause in ("posture", "radians", "observed") for cause in call.causes):
            return None, seen
        seen = np.asarray(call.arguments.get("observed", seen), dtype=bool)
        return np.asarray(call.posture, dtype=float), seen

    def _hard_rows(
        self, pose: np.ndarray, previous: np.ndarray, after: np.ndarray, twist: np.ndarray, jumped: bool
    ) -> tuple[list[str], dict[str, float]]:
        """Workspace and tool axis: never further out than before, or than braking forced when something jumped."""
        bounds = self.bounds
        here = np.maximum(bounds.worst(pose, np.zeros(6)), 0)
        if jumped or self.least is None:
            self.least = np.maximum(bounds.worst(pose, previous * bounds.stop_time(previous) / 2), 0)
        through = bounds.worst(after, twist * bounds.stop_time(twist) / 2)
        excess = through - np.maximum(self.least, 0)
        broken = {f"stop: {name}": float(x) for name, x in zip(bounds.names, excess, strict=True) if x > ALLOWED}
        # What the rest of the stop can still reach, and where it is now, is as far out as it may ever be again.
        self.least = np.minimum(self.least, np.maximum(here, np.maximum(through, 0)))
        return list(broken), broken

    def _checked(
        self,
        step: Step,
        previous: np.ndarray,
        pose: np.ndarray,
        posture: np.ndarray | None,
        seen: np.ndarray,
        dt: float,
        amounts: dict[str, float],
    ) -> list[str]:
        """What the Checker says, less what nobody could have done better."""
        if not seen.any():
            posture = None
        # Its memory of the workspace is for poses that do not jump; `_hard_rows` above judges those and the others alike.
        checker = Checker(self.problem)
        broken = checker.check(step.twist, previous, pose, posture, step.posture_rate, dt, seen)
        bounds, brake = self.bounds, self.bounds.braked(previous, dt)
        beyond = float(np.max(np.abs(step.twist) - np.maximum(bounds.speed, np.abs(brake))))
        kept = []
        for name in broken:
            if name in ("speed", "axes") and beyond <= ALLOWED:
                continue
            if name in ("workspace", "tool axis"):
                continue
            if name == "joint rate":
                fast = [JOINTS[i] for i in np.flatnonzero((np.abs(step.posture_rate) > bounds.rate + ALLOWED) & seen)]
                if all(joint in step.slack for joint in fast):
                    continue
            kept.append(name)
            amounts[name] = checker.max_violation[name]
        return kept

    def _count_certified(
        self,
        call: Call,
        step: Step,
        previous: np.ndarray,
        pose: np.ndarray,
        posture: np.ndarray | None,
        seen: np.ndarray,
        dt: float,
        where: str,
    ) -> None:
        if call.causes or posture is None:
            return
        if step.status not in ("braking", "invalid"):
            self.tally.judged += 1
            self.tally.answered += 1
            return
        if self.another_way(posture, seen, pose, previous, dt, step):
            self.tally.judged += 1
            self.tally.wrong("not certified", step.reason.split(":")[0], where, step.reason)

    def another_way(
        self, posture: np.ndarray, seen: np.ndarray, pose: np.ndarray, previous: np.ndarray, dt: float, step: Step
    ) -> bool:
        """Whether some reachable twist other than braking keeps everything through its stop as well as braking does."""
        bounds = self.bounds
        known = np.where(seen & np.isfinite(posture), posture, self.problem.response.comfort)  # type: ignore[attr-defined]
        locked = np.isin(JOINTS, step.locked).astype(float)
        S = np.array(self.problem.response.sensitivity()(known, locked)[0])
        brake = bounds.braked(previous, dt)
        low = np.minimum(np.maximum(-bounds.speed, previous - bounds.acceleration * dt), brake)
        high = np.maximum(np.minimum(bounds.speed, previous + bounds.acceleration * dt), brake)

        def outside(twist: np.ndarray) -> np.ndarray:
            displacement = twist * (dt + bounds.stop_time(twist) / 2)
            q = known + S @ displacement
            joints = np.where(seen, np.maximum(bounds.low - q, q - bounds.high), -np.inf)
            return np.concatenate([bounds.worst(pose, displacement), joints])

        now, at_braking = outside(np.zeros(6)), outside(brake)
        allowed = np.maximum(np.maximum(now, at_braking), 0) + 1e-9
        for target in self.rng.uniform(low, high, (60, 6)):
            for share in (1.0, 0.3, 0.1):
                twist = brake + share * (target - brake)
                if np.abs(twist - brake).max() > 1e-5 and np.all(outside(twist) <= allowed):
                    return True
        return False

    def _judge_reason(self, call: Call, step: Step, reason: str, where: str) -> None:
        wrong = self.tally.wrong
        said = f"{step.status}: {reason!r}, causes {call.causes}"
        if call.causes:
            status = "invalid" if call.invalid else "braking"
            if step.status != status:
                wrong("reasons_wrong", f"{call.names[0]} is {step.status}", where, said)
            for cause in call.causes:
                if cause not in reason:
                    wrong("reasons_wrong", f"{cause} not named", where, said)
            return
        if step.status == "invalid" or (step.status == "braking" and "braking" not in reason and "not solved" not in reason):
            wrong("reasons_wrong", "usable input refused", where, said)
        if step.status in ("braking", "invalid"):
            return
        posture, seen = self._frame(call)
        assert posture is not None
        bounds = self.bounds
        out = np.where(seen, np.maximum(bounds.low - posture, posture - bounds.high), 0) - bounds.tolerance
        for joint, amount in zip(JOINTS, out, strict=True):
            named = spoken(joint) in reason
            if amount > 1e-9 and not named:
                wrong("reasons_wrong", "joint outside not named", where, f"{joint} {np.degrees(amount):.2f} {said}")
            if amount < -1e-9 and named and joint not in step.slack:
                wrong("reasons_wrong", "joint inside named", where, f"{joint} {said}")
        for name, amount in zip(bounds.names, bounds.worst(step.pose, np.zeros(6)), strict=True):
            if amount > 2e-6 and name not in reason:
                wrong("reasons_wrong", "workspace outside not named", where, f"{name} {amount:.2g} {said}")
        if step.status in ("settled", "relaxed", "recovering") and not reason:
            wrong("reasons_wrong", "no reason", where, said)
        if step.status == "recovering" and "coming back" not in reason:
            wrong("reasons_wrong", "recovering from what", where, said)


def run_chunk(task: tuple[int, int]) -> Tally:
    """Run one chunk ``(number, steps)``; the same number gives the same inputs: ``run_chunk((7, 5000))`` reproduces it."""
    number, steps = task
    rng = np.random.default_rng([20_26, number])
    names = TASKS
    slot = number % (len(names) + 5)
    problem = load_problem(names[slot]) if slot < len(names) else random_problem(rng)
    tally = Tally()
    loop = Loop(problem, rng, tally)
    attacks_left, sane_left = 0, int(rng.integers(5, 40))
    for i in range(steps):
        if i % SEQUENCE == 0:
            loop.restart()
            # Some loops begin under attack.
            attacks_left, sane_left = (3, 0) if rng.random() < 0.3 else (0, int(rng.integers(5, 40)))
        call = loop.sane()
        if sane_left > 0:
            sane_left -= 1
        else:
            attack(rng, problem, call)
            attacks_left -= 1
            if attacks_left <= 0:
                attacks_left, sane_left = int(rng.integers(1, 10)), int(rng.integers(0, 40))
        loop.take(call, f"chunk {number} step {i}")
    return tally


def _silent_chunk(task: tuple[int, int]) -> Tally:
    import warnings

    # A warning is noise in a loop that runs a thousand times a second; here it counts as an exception.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("error")
        return run_chunk(task)


def fuzz(steps: int, processes: int = 2) -> Tally:
    """Run that many steps over all problems and return what was found."""
    size = min(CHUNK, max(SEQUENCE, steps // 20))
    tasks = [(number, size) for number in range(round(steps / size))]
    total = Tally()
    if processes == 1:
        found = map(_silent_chunk, tasks)
        for tally in found:
            total.add(tally)
        return total
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for tally in pool.imap_unordered(_silent_chunk, tasks):
            total.add(tally)
    return total


def measure(report: Report) -> None:
    """Attack."""
    found = fuzz(report.pick(20_000, 1_000_000))
    for status, count in found.statuses.most_common():
        report.say(f"  {status:<12} {count:>9}")
    kinds: dict[str, Any] = {name: count for name, count in found.counts.items() if ": " in name}
    for name, count in sorted(kinds.items(), key=lambda item: -item[1]):
        report.say(f"  {count:>7}  {name}")
    shown: Counter = Counter()
    for example in found.examples:
        kind = example.split(" at chunk")[0]
        shown[kind] += 1
        if shown[kind] == 1:
            report.say(f"  {example[:600]}")
    report.figure("steps", found.steps)
    report.figure("exceptions", found.counts["exceptions"], "calls that raised")
    report.figure("unsafe", found.counts["unsafe"], "twists that broke a limit, by the independent checker")
    report.figure("certified_share", found.answered / max(found.judged, 1), "of usable, feasible inputs")
    report.figure("reasons_wrong", found.counts["reasons_wrong"], "reasons that do not name their cause")


if __name__ == "__main__":
    run(measure, "Hostile inputs, up to a million: no exception, no unsafe twist, and a reason for each.")
