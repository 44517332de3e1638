"""Why a step did what it did, in one sentence that names the cause."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ergoqp.joints import JOINTS, spoken
from ergoqp.step_function import Cause, Status

if TYPE_CHECKING:
    from ergoqp.problem import Problem


def reason_of(problem: Problem, status: Status, account: Mapping[str, np.ndarray], note: str) -> str:
    """Return the sentence of a step; empty for a plain optimal one.

    Args:
        problem: the task.
        status: of the step.
        account: the arrays that the step function gave, with the inputs ``posture``, ``dt`` and ``age``.
        note: what was wrong with an input before it became numbers.
    """
    causes = [cause for cause in Cause if int(account["causes"][0]) >> cause & 1]
    if status >= Status.braking:
        return "; ".join(_cause(problem, cause, account, note) for cause in causes)
    parts = []
    names = problem.row_names
    outside = [i for i in range(len(names)) if account["outside"][i] > 0.5]
    if outside:
        parts.append("outside, coming back: " + ", ".join(_beyond(names[i], account["margins"][i]) for i in outside))
    if status == Status.relaxed:
        used = [names[i] for i in np.flatnonzero(account["slack"] > 1e-6)]
        parts.append("braking alone would pass these limits, so they give way: " + ", ".join(map(spoken, used)))
    if status == Status.settled:
        parts.append("at rest: moving would gain too little")
    stuck = [i for i in range(len(names)) if account["margins"][i] < -_tolerance(problem, i) and i not in outside]
    parts.extend(f"{_beyond(names[i], account['margins'][i])}, and the object cannot move it" for i in stuck)
    return "; ".join(parts)


def _cause(problem: Problem, cause: Cause, account: Mapping[str, np.ndarray], note: str) -> str:
    if cause is Cause.posture:
        return note if note.startswith(("posture", "observed")) else _bad_posture(account["posture"])
    if cause in (Cause.pose, Cause.twist):
        fallback = "pose is not finite, far away or not a rotation" if cause is Cause.pose else "twist is not finite or huge"
        return note if note.startswith(cause.name) else fallback
    return {
        Cause.dt: f"dt is {account['dt'][0]:g} s, allowed 1e-05 to 0.5 s",
        Cause.age: f"age is {account['age'][0]:g} s, allowed at least 0",
        Cause.disabled: "not enabled",
        Cause.no_frame: "no posture arrived",
        Cause.too_old: f"the posture is {account['age'][0]:.3f} s old, allowed {problem.control.max_age:.3f} s",
        Cause.not_solved: f"the QP was not solved: residual {account['residuals'][0]:.1e}",
        Cause.not_certified: "no twist but braking keeps every limit through the stop",
    }[cause]


def _bad_posture(posture: np.ndarray) -> str:
    wrong = np.flatnonzero(~(np.abs(posture) <= np.pi))
    if not wrong.size:
        return "posture is not usable"
    first = int(wrong[0])
    others = f" and {wrong.size - 1} more" if wrong.size > 1 else ""
    return f"posture: {spoken(JOINTS[first])}{others} is {posture[first]:g}, allowed finite radians within +-3.1416"


def _beyond(name: str, margin: float) -> str:
    if name in JOINTS:
        return f"{spoken(name)} by {np.degrees(-margin):.1f} deg"
    return f"{name} by {-margin:.3g}"


def _tolerance(problem: Problem, row: int) -> float:
    tolerances = [limit.tolerance for limit in problem.row_limits for _ in limit.names]
    return tolerances[row]
