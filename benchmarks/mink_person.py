"""The plain mink program of a person: a task for each hand, one for the posture, mink's limits.

It is what an engineer writes first who wants a person's joints to follow an object: the model
person of ``models/human.xml`` as a mink configuration, a `FrameTask` for every hand that holds the
object, a `PostureTask` toward comfort, configuration and velocity limits, and the twist of the
hand from its Jacobian. It asks for less than the control step: no cost of the posture, no boundary
of forearm postures, no row of the object, no stop, no certification, and no soles that stay.

`ratios` times it, its arm alone, the step's own QP in qpsolvers and daqp, and the step in all its
forms, on the calls of one closed loop, in turns within one process, in CPU time of the thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import mink
import mujoco
import numpy as np

from benchmarks.report import Report
from benchmarks.step_c import c_times
from ergoqp.joints import LOWER, UPPER
from ergoqp.native.compiled import processor_flags
from ergoqp.problem.problem import Problem
from ergoqp.step.stepper import Stepper

Call = tuple[Any, Any, float]

PEER: Final = "daqp"
"""The solver of the peer that the ratios are to; the fastest of those that are timed."""

SOLVERS: Final = (PEER, "quadprog", "osqp")

ROOT: Final = Path(__file__).resolve().parents[1]

_MARGIN: Final = 1e-6
"""mink's limits allow no posture at its very end [rad]."""


def mink_person(problem: Problem, solver: str) -> Callable[[Call], np.ndarray]:
    """Return the peer as a function of a call's posture and pose that gives a twist (6,).

    Args:
        problem: gives comfort, hands and period.
        solver: a solver of qpsolvers.
    """
    model = mujoco.MjModel.from_xml_path(str(ROOT / "models" / "human.xml"))
    before = model.nq - len(LOWER)
    comfort, q = np.zeros(model.nq), np.zeros(model.nq)
    comfort[before:] = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
    hands = problem.response.hands  # type: ignore[attr-defined]
    configuration = mink.Configuration(model)
    reach = [
        mink.FrameTask(f"{hand}_grip", "site", position_cost=1.0, orientation_cost=0.3)
        for hand in hands
    ]
    posture_task = mink.PostureTask(model, cost=1e-2)
    posture_task.set_target(comfort)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, j) for j in range(model.njnt)]
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict.fromkeys(names, 1.0)),
    ]
    site, jacobian = model.site(f"{hands[0]}_grip").id, np.zeros((6, model.nv))
    low, high, tasks = LOWER + _MARGIN, UPPER - _MARGIN, [*reach, posture_task]

    def answer(call: Call) -> np.ndarray:
        q[before:] = np.clip(call[0], low, high)
        configuration.update(q)
        for task in reach:
            task.set_target(mink.SE3.from_matrix(call[1]))
        rates = mink.solve_ik(configuration, tasks, problem.dt, solver, damping=1e-3, limits=limits)
        mujoco.mj_jacSite(model, configuration.data, jacobian[:3], jacobian[3:], site)
        return jacobian @ rates

    return answer


def in_turns(
    forms: Mapping[str, Callable[[Call], object]],
    calls: Sequence[Call],
    rounds: int,
    before: Mapping[str, Callable[[], object]],
) -> dict[str, np.ndarray]:
    """Return the CPU time of every call [us] (rounds, calls) of each form, one after the other.

    What reading the clock takes, the least of an empty form, is subtracted.

    Args:
        forms: functions of a call, by name.
        calls: the calls.
        rounds: how often all forms go through them; a first round is not counted.
        before: what is called before a form's round.
    """
    forms = {**forms, "": lambda _: None}
    took = {name: np.zeros((rounds + 1, len(calls))) for name in forms}
    for number in range(rounds + 1):
        for name, form in forms.items():
            before.get(name, bool)()
            for i, call in enumerate(calls):
                start = time.thread_time_ns()
                form(call)
                took[name][number, i] = time.thread_time_ns() - start
    clock = float(took.pop("").min())
    return {name: 1e-3 * (times[1:] - clock) for name, times in took.items()}


def ratios(
    report: Report, problem: Problem, calls: Sequence[Call], prefix: str = "", few: bool = False
) -> float:
    """Report times and ratios of one problem; return the time of the peer [us].

    Args:
        report: takes the figures.
        problem: the task.
        calls: those of a closed loop.
        prefix: put in front of the names of the figures.
        few: whether only the peer and the exported step are timed.
    """
    forms: dict[str, Callable[[Call], object]] = {
        f"mink_person.{solver}": mink_person(problem, solver)
        for solver in SOLVERS[: 1 if few else None]
    }
    steppers = {}
    if not few:
        steppers = {
            "interpreted": Stepper(problem, compiled=False),
            "compiled": Stepper(problem, compiled=True),
        }
        forms |= {
            name: lambda call, it=it: it.step(call[0], call[1], age=call[2])
            for name, it in steppers.items()
        }
    some = calls[: report.pick(200, 1000)]
    resets = {name: stepper.reset for name, stepper in steppers.items()}
    took = in_turns(forms, some, report.pick(8, 30), resets)
    least = {name: float(np.median(times.min(axis=0))) for name, times in took.items()}
    for name, times in took.items():
        if not few:
            report.figure(f"{name}.least_us", least[name], "CPU, median of every call's shortest")
            report.figure(f"{name}.median_us", float(np.median(times)))
            report.figure(f"{name}.p999_us", float(np.percentile(times, 99.9)))
    peer = least[f"mink_person.{PEER}"]
    for name in steppers:
        report.figure(f"{prefix}{name}_ratio", peer / least[name], "plain mink person over ours")
    passes = report.pick(10, 30)
    kinds = {"c_ratio": processor_flags(), "c_ratio.baseline": ()}
    for name, flags in list(kinds.items())[: 1 if few else None]:
        if (c := c_times(problem, some, passes, flags)) is None:
            report.say(f"{prefix}{name}: no CMake or no compiler")
        else:
            report.figure(f"{prefix}{name}", peer / c.least_us, f"{c.least_us:.2f} us")
    return peer
