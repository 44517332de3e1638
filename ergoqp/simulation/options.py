"""The terms of a problem in words for reports, as (what, value)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.sheets.reba import Method

_UNITS: Final[dict[str, str]] = {
    "look_ahead": "s",
    "smoothing": "s",
    "rest_after": "s",
    "move_after": "s",
    "rest_filter": "s",
    "max_age": "s",
    "average": "s",
    "delay": "s",
    "lag": "s",
    "pose_delay": "s",
    "pose_noise": "m",
    "longest_hold": "s",
    "recovery_time": "s",
    "relaxation_time": "s",
    "rate_deg": "deg/s",
    "rest_below": "points",
    "move_above": "points",
    "guide_gain": "points",
    "guide_price": "points",
    "effort_linear": "points/(m/s)²",
    "effort_angular": "points/(rad/s)²",
    "contact": "points/(m/s)²",
    "comfort": "points/rad²",
    "linear_speed": "m/s",
    "angular_speed": "rad/s",
    "linear_acceleration": "m/s²",
    "angular_acceleration": "rad/s²",
    "lower": "m",
    "upper": "m",
    "seat_height": "m",
    "stature": "m",
}
_ENDINGS: Final = {"_deg": "deg", "_kg": "kg"}
_INNER: Final = (
    "tolerance",
    "yield_zone",
)  # fields of every limit, in its own unit, that only concern how rows are built


def options_of(problem: Problem, solver: str) -> list[tuple[str, str]]:
    """Return the terms of a problem and the options of the method as text for people.

    Args:
        problem: the task.
        solver: name of the QP solver.
    """
    control = _fields(problem.control) | {"average": problem.average}
    changed = [
        (name, value)
        for name, value in _fields(problem.method).items()
        if value != getattr(Method(), name)
    ]
    return [
        ("cost", _cost(problem.cost)),
        ("person in the controller", _response(problem.response)),
        *((_spaced(type(limit).__name__), _sentence(_fields(limit))) for limit in problem.limits),
        *(("task: " + _label(name), _value(name, value)) for name, value in problem.task.items()),
        *(("method: " + _label(name), _value(name, value)) for name, value in changed),
        *(("control: " + _label(name), _value(name, value)) for name, value in control.items()),
        *(
            ("robot: " + _label(name), _value(name, value))
            for name, value in _fields(problem.robot).items()
            if value
        ),
        ("QP solver", solver),
    ]


def _cost(cost: Any) -> str:
    words = cost.name.replace("_", " ")
    if not hasattr(cost, "taus_deg"):
        return words
    parts = zip(cost.weights, cost.taus_deg, strict=True)
    return f"{words}: " + " + ".join(f"{weight:g} at {tau:g} deg" for weight, tau in parts)


def _response(response: Any) -> str:
    if not isinstance(response, IkResponse):
        return _spaced(type(response).__name__)
    where = "standing" if response.stance == "standing" else f"seated at {response.seat:.2g} m"
    hands = " and ".join(response.hands)
    turn = "free to turn about" if response.free_about_tool else "firm on"
    return (
        f"{response.body.stature:.2f} m, {where}, {hands} hand {turn} the tool ({response.tool} the"
        " hand)"
    )


def _fields(term: Any) -> dict[str, Any]:
    return (
        {entry.name: getattr(term, entry.name) for entry in fields(term)}
        if is_dataclass(term)
        else {}
    )


def _sentence(values: Mapping[str, Any]) -> str:
    told = {
        name: value
        for name, value in values.items()
        if name not in _INNER and value not in ({}, ())
    }
    return "; ".join(f"{_label(name)} {_value(name, value)}" for name, value in told.items())


def _label(name: str) -> str:
    for ending in _ENDINGS:
        name = name.removesuffix(ending)
    return name.replace("_", " ")


def _value(name: str, value: Any) -> str:
    unit = _UNITS.get(name) or next(
        (unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), ""
    )
    return f"{_plain(value)} {unit}".rstrip()


def _plain(value: Any) -> str:
    if (
        isinstance(value, tuple)
        and len(value) == 2
        and all(isinstance(each, bool) for each in value)
    ):
        sides = [side for side, each in zip(("right", "left"), value, strict=True) if each]
        return " and ".join(sides) or "no"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{_label(str(key))} {_plain(each)}" for key, each in value.items())
    if isinstance(value, (tuple, list)):
        return ", ".join(map(_plain, value))
    return str(value)


def _spaced(name: str) -> str:
    return "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()
