"""What `ergoqp.formulate` gives, solved by others, against what the control step wants.

Run ``python -m benchmarks.formulate [--quick | --full] [--json FILE]``. Closed loops of all
problems, from awkward places, with simulated people whose weights are not the model's; also one
with a declared robot, and two with an object at full speed and postures that jump, with joints at
and beyond their ends and joints that no sensor sees: in one a guide leads, in the other the object
begins outside its workspace. In each step the QP is formulated from the state before it, and
two backends of qpsolvers solve it. The answer of the step itself is what its own solver returned
for its last QP. All differences are largest ones of any entry of the twist [m/s, rad/s].

- ``difference``: over all steps in which no row gives way, and both backends; 1e-9 is wanted.
  ``difference.quadprog``, ``difference.daqp``: one backend alone.
- ``difference.CASE``: one loop alone.
- ``difference.planned``: from the twist that the step then planned, over the steps that were
  certified whole and not at rest. ``difference.gave_way``: where rows give way.
- Controls that show that the figure can be bad: ``difference.without_rows`` solves H and g alone,
  ``difference.without_state`` formulates from the initial state.
- ``steps``, ``gave_way``, ``with_slack``, ``unusable``, ``unsolved``: steps; those in which a row
  gives way; those whose QP has unknowns for slack; those without a usable QP; QPs for which a
  backend has no answer. ``several_passes``, ``drawn``: those in which joints yield, and those that
  a guide leads. ``different_steps``: steps in which the step of the formulation has another
  twist, status or reason than that of the loop.
- ``call_us``, ``step_us``: median time of a call, and of the interpreted step of the same loop.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import qpsolvers

from benchmarks.report import Report, run
from ergoqp.comparison.record import RecordingSolver, closed_loop
from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import frame_of
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.simulation.loop import in_world
from ergoqp.simulation.robot import moved
from ergoqp.step.formulate import Formulation, Formulator
from ergoqp.step.rest import THERE, TRIAL
from ergoqp.step.stepper import Step, Stepper

BACKENDS: Final = ("quadprog", "daqp")
"""Exact active-set methods: Goldfarb and Idnani's, and DAQP apart from the step's plugin."""

_ACCURATE: Final = {"quadprog": {}, "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-11}}

_ROBOT: Final = DeclaredRobot(delay=0.02, lag=0.1, pose_noise=0.001, pose_noise_deg=0.2)


@dataclass(frozen=True, eq=False)
class Solved:
    """One step of a loop, and its QP.

    Attributes:
        qp: as it was formulated from the state before the step.
        unstated: the same from the initial state.
        step: what the loop got.
        wanted: answer of the step's own solver for its last QP (6,).
        planned: twist that the step planned (6,).
        passes: number of QPs that the step solved.
        call_us: time of the formulation.
    """

    qp: Formulation
    unstated: Formulation
    step: Step
    wanted: np.ndarray
    planned: np.ndarray
    passes: int
    call_us: float

    @property
    def whole(self) -> bool:
        """Whether the step planned what it wanted."""
        moves = self.step.status not in ("settled", "braking")
        return moves and self.step.residuals["accepted"] == 1


class WatchedStepper(Stepper):
    """A stepper that formulates every step of its loop too.

    Args:
        problem: the task.
        guide: that of the stepper.

    Attributes:
        solved: the steps so far.
    """

    def __init__(self, problem: Problem, guide: Any = None) -> None:
        """Build both functions."""
        self._recording = RecordingSolver()
        super().__init__(problem, solver=self._recording, guide=guide)
        self._formulator = Formulator(problem, guide=guide)
        self.solved: list[Solved] = []

    def step(self, posture: Any, pose: Any = None, twist: Any = None, **given: Any) -> Step:
        """Step, and formulate the same step."""
        state = self.state()
        self._recording.heard.clear()
        step = super().step(posture, pose, twist, **given)
        heard = self._recording.heard
        wanted = heard[-1][1].x[:6].copy()
        start = time.perf_counter()
        qp = self._formulator(state, posture, pose, twist, **given)
        took = 1e6 * (time.perf_counter() - start)
        unstated = self._formulator(None, posture, pose, twist, **given)
        planned = self.state()[self._parts["planned"]][:6]
        self.solved.append(Solved(qp, unstated, step, wanted, planned, len(heard), took))
        return step


def answer(qp: Formulation, backend: str, rows: bool = True) -> np.ndarray | None:
    """Return the twist (6,) in the answer of a backend of qpsolvers; None if there is none."""
    fixed = qp.lower == qp.upper
    above, below = (np.isfinite(end) & ~fixed for end in (qp.upper, qp.lower))
    if not rows:
        return np.linalg.solve(qp.H, -qp.g)[:6]
    G = np.vstack([qp.A[above], -qp.A[below]])
    h = np.concatenate([qp.upper[above], -qp.lower[below]])
    A, b = (qp.A[fixed], qp.upper[fixed]) if fixed.any() else (None, None)
    x = qpsolvers.solve_qp(qp.H, qp.g, G, h, A, b, solver=backend, **_ACCURATE[backend])
    return None if x is None else x[:6]


def apart(found: np.ndarray | None, wanted: np.ndarray) -> float:
    """Return the largest difference of two twists; infinite if there is none."""
    return np.inf if found is None else float(np.abs(found - wanted).max())


def disturbed(problem: Problem, stepper: Stepper, periods: int, above: float) -> None:
    """Step with postures that jump, some joints at their ends, and an object that begins outside.

    Args:
        problem: the task.
        stepper: what is stepped.
        periods: number of steps.
        above: height of the object over the upper end of its workspace [m].
    """
    rng, pose = np.random.default_rng(0), middle(problem)
    comfort = np.array(problem.response.comfort)  # pyright: ignore[reportAttributeAccessIssue]
    pose[2, 3] = problem.limit_of(WorkspaceBox).upper[2] + above
    posture = comfort
    for period in range(periods):
        if period % 60 == 0:
            wide = comfort + np.radians(40) * rng.normal(size=comfort.size)
            posture = np.clip(wide, LOWER - 0.05, UPPER + 0.05)
        observed = rng.random(comfort.size) < 0.9 if period % 10 == 9 else None
        step = stepper.step(posture, pose, observed=observed)
        pose = moved(pose, step.twist * problem.dt)


def middle(problem: Problem) -> np.ndarray:
    """Return the pose (4, 4) in the middle of the workspace, its tool along the cone."""
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    pose = np.eye(4)
    pose[:3, :3] = frame_of(np.asarray(cone.direction))
    pose[:3, 3] = (np.asarray(box.lower) + np.asarray(box.upper)) / 2
    return pose


def bold(problem: Problem) -> Control:
    """Return the settings of an object that goes to its walls at full speed."""
    free = {"effort_linear": 0.01, "effort_angular": 0.01, "contact": 0.0, "caution": 0.0}
    return replace(problem.control, rest_below=0.0, stall_after=1e6, **free)


def loop_of(case: str, periods: int) -> list[Solved]:
    """Return the steps of one case: a problem, or ``declared``, ``guided`` or ``disturbed``."""
    names = {"declared": "screwing", "guided": "overhead", "disturbed": "low_bin"}
    problem = in_world(load_problem(names.get(case, case)))
    if case == "declared":
        problem = problem.replace(robot=_ROBOT)
    if case not in ("guided", "disturbed"):
        stepper = WatchedStepper(problem)
        closed_loop(problem, stepper, 0, periods * problem.dt)
    else:
        # Whoever stands still while the object moves away is in no frame.
        problem = problem.replace(frames=Frames(compare=False), control=bold(problem))
        stepper = WatchedStepper(problem, middle(problem) if case == "guided" else None)
        if case == "guided":
            # It is led at once.
            state = stepper.state()
            state[-TRIAL:][:7] = [THERE, 0.0, 0.0, 5.0, 1e9, 0.0, 0.0]
            stepper.restore(state)
        disturbed(problem, stepper, periods, -0.02 if case == "guided" else 0.02)
    return stepper.solved


CASES: Final = (*TASKS, "screwing_learned", "forearm", "declared", "guided", "disturbed")


def measure(report: Report) -> None:
    """Run the loops, solve their QPs, and print the figures."""
    loops = {case: loop_of(case, report.pick(200, 2000)) for case in CASES}
    steps = [each for solved in loops.values() for each in solved]
    usable = [each for each in steps if each.qp.usable]
    kept = [each for each in usable if not each.qp.gave_way]
    gave_way = [each for each in usable if each.qp.gave_way]
    found = {
        backend: {id(each): answer(each.qp, backend) for each in usable} for backend in BACKENDS
    }

    def worst(solved: list[Solved], backends: tuple[str, ...] = BACKENDS) -> float:
        every = (apart(found[name][id(each)], each.wanted) for name in backends for each in solved)
        return max(every, default=0.0)

    report.figure("difference", worst(kept), "no row gives way; 1e-9 is wanted")
    for backend in BACKENDS:
        report.figure(f"difference.{backend}", worst(kept, (backend,)))
    for case, solved in loops.items():
        own = [each for each in solved if each.qp.usable and not each.qp.gave_way]
        report.figure(f"difference.{case}", worst(own), f"{len(own)} steps")
    # A length is kept by a projection afterwards.
    sent = [each for case in CASES if case != "forearm" for each in loops[case]]
    planned = [each for each in sent if each.qp.usable and each.whole and not each.qp.gave_way]
    values = [apart(found["quadprog"][id(each)], each.planned) for each in planned]
    report.figure("difference.planned", max(values), f"{len(planned)} steps")
    report.figure("difference.gave_way", worst(gave_way), "up to 2e-6 is said")
    free = [apart(answer(each.qp, "", rows=False), each.wanted) for each in kept]
    report.figure("difference.without_rows", max(free), "control")
    others = [apart(answer(each.unstated, "quadprog"), each.wanted) for each in kept]
    report.figure("difference.without_state", max(others), "control")
    report.figure("steps", len(steps))
    report.figure("gave_way", len(gave_way))
    report.figure("with_slack", sum(len(each.qp.unknowns) > 6 for each in usable))
    report.figure("unusable", len(steps) - len(usable))
    report.figure("several_passes", sum(each.passes > 1 for each in usable))
    report.figure("drawn", sum(each.step.drawn > 0 for each in usable))
    none = sum(x is None for answers in found.values() for x in answers.values())
    report.figure("unsolved", none)
    report.figure("different_steps", sum(not same(each) for each in steps))
    report.figure("call_us", float(np.median([each.call_us for each in steps])), "us")
    report.figure("step_us", _step_us(), "us")


def same(solved: Solved) -> bool:
    """Return whether the step of the formulation is that of the loop."""
    ours, loops = solved.qp.step, solved.step
    texts = (ours.status, ours.reason) == (loops.status, loops.reason)
    return texts and bool(np.abs(ours.twist - loops.twist).max() <= 1e-12)


def _step_us() -> float:
    stepper = Stepper(load_problem("screwing"), compiled=False)
    posture = np.array(stepper.problem.response.comfort)  # pyright: ignore
    return 1e6 * float(np.median([stepper.step(posture).solve_time for _ in range(500)]))


if __name__ == "__main__":
    run(measure, "The QP of a step as data, solved by others.")
