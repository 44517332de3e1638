"""Limits and bounds as numeric functions, made once per limit."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from ergoqp.limits import LimitContext, Rows, TwistLimit
from ergoqp.limits.twist_and_stopping import Stop
from ergoqp.solvers.solver import FREE
from ergoqp.step.rows import movable_rows, no_further, row_bounds

SIZES = {
    "posture": (32, 1),
    "observed": (32, 1),
    "pose": (4, 4),
    "sensitivity": (32, 6),
    "stop_displacement": (6, 1),
}
SIZES |= {"change": (6, 1), "pending_displacement": (6, 1), "shift": (32, 1)}
NAMES = list(SIZES)
DEFAULTS = {"observed": np.ones(32), "pose": np.eye(4)}


def symbols() -> dict[str, ca.SX]:
    return {name: ca.SX.sym(name, *SIZES[name]) for name in NAMES}


_MADE: dict[tuple[int, bool], tuple[Any, ca.Function]] = {}


def _rows(limit: Any, uncertain: bool) -> ca.Function:
    """By identity: limits hold dicts."""
    key = (id(limit), uncertain)
    if key not in _MADE:
        _MADE[key] = (limit, _build(limit, uncertain))
    return _MADE[key][1]


def _build(limit: Any, uncertain: bool) -> ca.Function:
    parts = symbols()
    displacement, m = ca.SX.sym("displacement", 6), len(limit.names)
    unsure = {
        "lost below": ca.SX.sym("below", m),
        "lost above": ca.SX.sym("above", m),
        "turn": ca.SX.sym("turn"),
    }
    context = LimitContext(**parts)
    if uncertain:
        below, above, turn = unsure.values()
        context = LimitContext(
            **parts, margin_reduction={limit.names[0]: (below, above)}, turn=turn
        )
    rows = limit.rows(context)
    outputs = [
        rows.matrix,
        rows.to_lower,
        rows.to_upper,
        rows.rate,
        limit.margins(context, displacement),
    ]
    inputs = [*parts.values(), displacement, *(unsure.values() if uncertain else ())]
    return ca.Function("limit", inputs, [ca.densify(part) for part in outputs])


def ask(
    limit: Any, *, displacement: Any = (0.0,) * 6, lost: Any = None, turn: Any = None, **given: Any
) -> list[np.ndarray]:
    """Return (matrix, below, above, rate, margins) of a limit in a context; what is not given is
    zero or as at rest.

    `lost` (distances to the lower and to the upper ends that do not count) and `turn`, together: of
    a declared robot.
    """
    values = [given.pop(name, DEFAULTS.get(name, np.zeros(SIZES[name]))) for name in NAMES]
    assert not given, f"unknown: {list(given)}"
    uncertain = lost is not None
    assert uncertain == (turn is not None)
    unsure = [*lost, turn] if uncertain else []
    found = [np.array(part) for part in _rows(limit, uncertain)(*values, displacement, *unsure)]
    return [found[0], *(part.ravel() for part in found[1:])]


@cache
def _brake(stop: Stop) -> ca.Function:
    previous, dt = ca.SX.sym("previous", 6), ca.SX.sym("dt")
    found = stop.braking(previous, dt)
    outputs = [found.twist, found.low, found.high, found.reach]
    outputs += [stop.displacement(previous, dt), stop.time(previous)]
    return ca.Function("brake", [previous, dt], [ca.densify(part) for part in outputs])


def brake_of(
    limit: TwistLimit, previous: np.ndarray, dt: float, **law: float
) -> dict[str, np.ndarray]:
    """Braking from a planned twist, and the displacement of its own period and stop; `law` are
    other attributes of `Stop`."""
    names = ("twist", "low", "high", "reach", "displacement", "time")
    found = _brake(Stop(limit, **law))(previous, dt)
    return dict(zip(names, (np.array(part).ravel(order="F") for part in found), strict=True))


_BOUNDS: dict[tuple[int, TwistLimit], tuple[Any, ca.Function, list[int]]] = {}


def _bounds(limit: Any, twist_limit: TwistLimit) -> tuple[ca.Function, list[int]]:
    """By identity, as above."""
    key = (id(limit), twist_limit)
    if key not in _BOUNDS:
        _BOUNDS[key] = (limit, *_build_bounds(limit, twist_limit))
    return _BOUNDS[key][1:]


def _build_bounds(limit: Any, twist_limit: TwistLimit) -> tuple[ca.Function, list[int]]:
    previous, dt, parts = ca.SX.sym("previous", 6), ca.SX.sym("dt"), symbols()
    pose, posture, sensitivity = parts["pose"], parts["posture"], parts["sensitivity"]
    # What is sent as planned: the rows are tested without the mean and without a declared robot.
    brake = Stop(twist_limit).braking(previous, dt)
    context = LimitContext(
        posture, ca.SX.ones(32), pose, sensitivity, previous * brake.reach, ca.SX(6, 1)
    )
    movable = movable_rows(twist_limit, [limit], context)
    all_rows = no_further(twist_limit, limit, limit.rows(context), brake)
    rows = Rows(
        *(ca.densify(ca.SX(getattr(all_rows, part.name)))[movable, :] for part in fields(Rows))
    )
    found = row_bounds(
        twist_limit, [limit], rows, movable, _away(limit, rows, movable), brake, ca.SX(1)
    )
    outputs = [found[name] for name in ("lbA", "ubA", "side", "cap", "A")]
    inputs = [pose, previous, dt, posture, sensitivity]
    return ca.Function("bounds", inputs, [ca.densify(part) for part in outputs]), movable


def _away(limit: Any, rows: Rows, movable: list[int]) -> ca.SX:
    """How far outside rows are that ask to come back, beyond the upper ends and beyond the lower
    ones."""
    asks = ca.DM(np.broadcast_to(limit.recovers, len(limit.names))[movable].astype(float))
    distance = ca.fmin(ca.vertcat(rows.to_upper, rows.to_lower), FREE)
    return ca.if_else(distance < -limit.tolerance, -distance, 0) * ca.vertcat(asks, asks)


def bounds_of(
    limit: Any,
    twist_limit: TwistLimit,
    pose: np.ndarray,
    previous: np.ndarray,
    dt: float,
    posture: Any = 0.0,
    sensitivity: Any = 0.0,
) -> dict[str, np.ndarray]:
    """Bounds in the last pass, of the rows that some twist can move, for a stop that is as long as
    it looks."""
    function, names = _bounds(limit, twist_limit)[0], ("lower", "upper", "side", "cap", "matrix")
    found = function(pose, previous, dt, posture, sensitivity)
    return dict(zip(names, (np.array(part).ravel(order="F") for part in found), strict=True))


def movable_of(limit: Any, twist_limit: TwistLimit) -> list[int]:
    return _bounds(limit, twist_limit)[1]
