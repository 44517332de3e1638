"""The numbers of a problem that the functions of a step take as inputs.

Two problems of one structure differ in nothing else. So their steps are one function, with other
values of these inputs. What decides which operations there are is structure: kinds of terms,
options, axes, which joints are listed, and whether a declared delay or error is zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final

import numpy as np

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.limits import Limit
from ergoqp.problem.problem import Problem
from ergoqp.responses import IkResponse
from ergoqp.solvers.solver import FREE
from ergoqp.step.layout import AT_ALL, History
from ergoqp.step.rest import HESITATES, HUNTING
from ergoqp.step.rows import limit_values

Constants = Mapping[str, np.ndarray]
"""Values (rows, columns) by name."""

_OF_ROWS: Final = ("tolerance", "recovery_time", "yield_zone")
"""Numbers of a limit that each of its rows has."""


_FAR: Final = (0.38, float(np.radians(60.0)))
"""Honest people are within this distance [m] and angle [rad], and less of both at once."""

_INHERITS: Final = 1e-5
"""Largest worsening of a bent row that any twist but braking may take over from braking [rad].

It applies inside such a row, with a long mean.
"""

_LONG: Final = 0.1
"""With a longer mean [s], the object turns so far that errors of a bent row add up."""


def constants_of(problem: Problem) -> dict[str, np.ndarray]:
    """Return the numbers of a problem (rows, columns), by the names of the inputs.

    No expression is built.
    """
    parts: dict[str, Mapping[str, Any]] = {
        "control": _of_control(problem),
        "stop": _of_stop(problem),
        "robot": _of_robot(problem),
        "task": _of_task(problem),
        "rows": _of_rows(problem),
        "history": History(problem).constants(),
    }
    if problem.way_out is not None:
        parts["regions"] = {"way_out": problem.way_out.numbers}
    terms: dict[str, Any] = {"response": problem.response, "cost": problem.cost}
    parts |= {name: term.constants() for name, term in terms.items() if shares(term)}
    parts |= {
        prefix_of(problem, limit): limit.constants()  # pyright: ignore[reportAttributeAccessIssue]
        for limit in problem.row_limits
        if hasattr(limit, "constants")
    }
    return {
        f"{part}_{name}": _matrix(value)
        for part, values in parts.items()
        for name, value in values.items()
    }


def shares(term: Any) -> bool:
    """Return whether a response or cost takes its numbers as inputs of a shared function.

    Others have them in their expressions, and a function of their own.
    """
    return type(term) in (IkResponse, SmoothReba)


def prefix_of(problem: Problem, limit: Limit) -> str:
    """Return what the names of the numbers of a limit begin with; empty for an unknown limit."""
    numbers = (i for i, each in enumerate(problem.row_limits) if each is limit)
    return next((f"limit{i}" for i in numbers if hasattr(limit, "constants")), "")


def bounds(problem: Problem) -> tuple[float, float]:
    """Return the distance [m] and the angle [rad] up to which posture and pose may be apart."""
    frames = problem.frames
    if frames.spread is None or frames.spread_deg is None:
        return _FAR
    # Calibrated with this person, whose other rests are up to twice as far off; and noise.
    far = max(0.20, 0.10 + 2.5 * frames.spread), max(45.0, 25 + 1.5 * frames.spread_deg)
    return min(_FAR[0], far[0]), min(_FAR[1], float(np.radians(far[1])))


def stand_in(problem: Problem) -> np.ndarray:
    """Return a posture for joints that are not seen: the comfort posture, or zeros without one."""
    return np.asarray(
        getattr(problem.response, "comfort", np.zeros(len(problem.coordinates))), dtype=float
    )


def _matrix(value: Any) -> np.ndarray:
    array = np.array(value, dtype=float)
    return array if array.ndim == 2 else array.reshape(-1, 1)


def _of_control(problem: Problem) -> dict[str, Any]:
    """Return the settings of the step, but the average, which is a length of time of the stop."""
    control = problem.control
    return {e.name: getattr(control, e.name) for e in fields(control) if e.name != "average"}


def _of_stop(problem: Problem) -> dict[str, Any]:
    """Return the law of the stop, and what it adds to a mean that rises."""
    law = problem.stop
    names = ("average", "longest", "stretch", "hold", "memory")
    found = {name: getattr(law, name) for name in names}
    found |= {
        "mean_rise": law.stretch * law.longest,
        "parked": max(law.average, problem.robot.dead_time, AT_ALL),
    }
    limit = law.limit
    return found | {"speed": limit.speed, "acceleration": limit.acceleration, "aside": limit.aside}


def _of_robot(problem: Problem) -> dict[str, Any]:
    """Return what is declared of the robot, and where it stands."""
    robot, frames = problem.robot, problem.frames
    found = {e.name: getattr(robot, e.name) for e in fields(robot)}
    found |= {"dead_time": robot.dead_time, "noise": robot.noise}
    shift, turn = (float(np.linalg.norm(part)) for part in np.split(robot.noise, 2))
    found |= {"distance_noise": shift, "turn_noise": turn}
    found |= {"first": [*[robot.pose_from_posture] * 6, np.radians(robot.pose_from_posture_deg)]}
    lag, hold = robot.lag, robot.longest_hold
    found |= {"clinging": lag * (1 - np.exp(-hold / lag)) if lag else 0.0}
    limit = problem.twist_limit
    found |= {"credible": 0.5 * np.repeat([limit.linear_speed, limit.angular_speed], 3)}
    found |= {"base": frames.base, "flange": frames.flange, "offset": frames.offset}
    return found | {"apart": bounds(problem)}


def _of_rows(problem: Problem) -> dict[str, np.ndarray]:
    """Return the numbers of each row of the limits (r,)."""
    limits = problem.row_limits
    capped = (limit_values(limits, "curvature") > 0) & (problem.average > _LONG)
    most = _INHERITS + 3 * float(np.linalg.norm(problem.robot.noise[3:]))
    found = {name: limit_values(limits, name) for name in _OF_ROWS}
    return found | {"inherits": np.where(capped, most, FREE)}


def _of_task(problem: Problem) -> dict[str, Any]:
    """Return what follows from several terms of the problem."""
    control, response = problem.control, problem.response
    weights = np.asarray(response.weight_vector, dtype=float)
    moved = np.array([joint in response.joints for joint in problem.coordinates], dtype=float)
    cautious = control.look_ahead * np.sqrt(control.caution * weights)
    return {
        "dt": problem.dt,
        "longest_period": problem.longest_period,
        "stand_in": stand_in(problem),
        "linear_acceleration": problem.twist_limit.linear_acceleration,
        "way_out_time": getattr(problem.way_out, "recovery_time", 1.0),
        "minimum": problem.cost.minimum,
        "comfort": control.comfort * moved * weights,
        "cautious": np.tile(cautious[:, None], 6),
        "second_order": control.look_ahead**2 / 2,
        "waits": max(HESITATES * control.stall_after, 1e-6),
        "hunts": HUNTING * control.stall_after,
        "effort": np.repeat([control.effort_linear, control.effort_angular], 3),
    }
