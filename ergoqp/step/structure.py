"""What decides which operations a step has, without building it.

Two problems of equal structure have the same functions, with other values of the inputs of
`ergoqp.step.constants`. Terms of the package say themselves what decides, in `structure`, beside
their `constants`. All others count with everything that they hold.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ergoqp.limits import ArmLength, AxisCone, JointLimit, Limit, WorkspaceBox
from ergoqp.limits.keep_out import KeepOut
from ergoqp.step.constants import shares
from ergoqp.step.layout import count
from ergoqp.step.model import StepModel

_LIMITS: Final = (WorkspaceBox, AxisCone, JointLimit, KeepOut, ArmLength)
"""Limits whose numbers are inputs."""

_DECLARED: Final = (
    *("gain_error", "lag", "dead_time", "longest_hold", "pose_noise", "pose_noise_deg"),
)
"""What is declared of a robot, and adds operations where it is not zero."""


def structure_of(model: StepModel) -> dict[str, Any]:
    """Return what decides which operations the step of a problem has.

    No expression is built.
    """
    problem, limit = model.problem, model.problem.twist_limit
    kept = () if problem.way_out is None else problem.way_out.kept
    return {
        "guided": model.guided,
        "coordinates": problem.coordinates,
        "axes": tuple((limit.speed > 0).tolist()),
        "aside": bool(limit.aside),
        "average": bool(problem.average),
        "robot": tuple(bool(getattr(problem.robot, name)) for name in _DECLARED),
        "noise": bool(problem.robot.noise.any()),
        "frames": (problem.frames.moved, problem.frames.compare),
        "response": _of_term(problem.response),
        "cost": _of_term(problem.cost),
        "limits": tuple(map(_of_limit, problem.row_limits)),
        "regions": [each in kept for each in problem.row_limits],
        "constants": {name: np.shape(value) for name, value in model.constants.items()},
        "state": count(model.state),
    }


def _of_term(term: Any) -> Any:
    """Return what decides of a response or a cost."""
    return (type(term), term.structure()) if shares(term) else term


def _of_limit(limit: Limit) -> Any:
    """Return what decides of a limit. The names of its rows do not."""
    return (type(limit), limit.structure()) if isinstance(limit, _LIMITS) else limit
