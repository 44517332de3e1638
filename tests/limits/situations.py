"""Limits and bounds as numeric functions, made once per limit."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from ergoqp.limits import Rows, Situation, TwistLimit
from ergoqp.step_rows import braking, movable_rows, row_bounds, stop_displacement, stop_time

SIZES = {"posture": (32, 1), "observed": (32, 1), "pose": (4, 4), "sensitivity": (32, 6), "swing": (6, 1)}
SIZES["change"] = (6, 1)
NAMES = [field.name for field in fields(Situation) if field.name not in ("readings", "surface")]
DEFAULTS = {"observed": np.ones(32), "pose": np.eye(4)}


def symbols() -> dict[str, ca.SX]:
    return {name: ca.SX.sym(name, *SIZES.get(name, (1, 1))) for name in NAMES}


_MADE: dict[int, tuple[Any, ca.Function]] = {}


def _rows(limit: Any) -> ca.Function:
    """By identity: limits hold dicts."""
    if id(limit) not in _MADE:
        _MADE[id(limit)] = (limit, _build(limit))
    return _MADE[id(limit)][1]


def _build(limit: Any) -> ca.Function:
    parts = symbols()
    displacement = ca.SX.sym("displacement", 6)
    situation = Situation(**parts)
    rows = limit.rows(situation)
    outputs = [rows.matrix, rows.below, rows.above, rows.rate, limit.margins(situation, displacement)]
    return ca.Function("limit", [*parts.values(), displacement], [ca.densify(part) for part in outputs])


def ask(limit: Any, *, displacement: Any = (0.0,) * 6, **given: Any) -> list[np.ndarray]:
    """Return (matrix, below, above, rate, margins) of a limit in a situation; what is not given is zero or as at rest."""
    values = [given.get(name, DEFAULTS.get(name, np.zeros(SIZES.get(name, (1, 1))))) for name in NAMES]
    found = [np.array(part) for part in _rows(limit)(*values, displacement)]
    return [found[0], *(part.ravel() for part in found[1:])]


@cache
def _brake(limit: TwistLimit) -> ca.Function:
    previous, dt = ca.SX.sym("previous", 6), ca.SX.sym("dt")
    found = braking(limit, previous, dt)
    outputs = [found.twist, found.low, found.high, stop_displacement(limit, previous, dt), stop_time(limit, previous)]
    return ca.Function("brake", [previous, dt], [ca.densify(part) for part in outputs])


def brake_of(limit: TwistLimit, previous: np.ndarray, dt: float) -> dict[str, np.ndarray]:
    names = ("twist", "low", "high", "displacement", "time")
    return dict(zip(names, (np.array(part).ravel() for part in _brake(limit)(previous, dt)), strict=True))


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
    brake = braking(twist_limit, previous, dt)
    situation = Situation(posture, ca.SX.ones(32), pose, sensitivity, previous * brake.reach, ca.SX(6, 1))
    movable = movable_rows(twist_limit, [limit], situation)
    all_rows = limit.rows(situation)
    rows = Rows(*(ca.densify(ca.SX(getattr(all_rows, part.name)))[movable, :] for part in fields(Rows)))
    found = row_bounds(twist_limit, [limit], rows, movable, brake, ca.SX(1))
    outputs = [found.lower, found.upper, found.side, found.cap]
    inputs = [pose, previous, dt, posture, sensitivity]
    return ca.Function("bounds", inputs, [ca.densify(part) for part in outputs]), movable


def bounds_of(
    limit: Any,
    twist_limit: TwistLimit,
    pose: np.ndarray,
    previous: np.ndarray,
    dt: float,
    posture: Any = 0.0,
    sensitivity: Any = 0.0,
) -> dict[str, np.ndarray]:
    """Bounds in the last pass, of the rows that some twist can move, for a stop that is as long as it looks."""
    function, names = _bounds(limit, twist_limit)[0], ("lower", "upper", "side", "cap")
    found = function(pose, previous, dt, posture, sensitivity)
    return dict(zip(names, (np.array(part).ravel() for part in found), strict=True))


def movable_of(limit: Any, twist_limit: TwistLimit) -> list[int]:
    return _bounds(limit, twist_limit)[1]
