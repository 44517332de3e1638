"""Mistakes of a problem file in words: the key, what was found and what is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Any, Final, get_args

import numpy as np
from pydantic import BaseModel, ValidationError

from ergoqp.problem_files.keys import keys_of

_USUAL: Final[dict[str, tuple[float, float, str]]] = {
    "limits.twist.linear_speed": (0.005, 1.0, "m/s"),
    "limits.twist.angular_speed": (0.02, 4.0, "rad/s"),
    "limits.twist.linear_acceleration": (0.02, 5.0, "m/s^2"),
    "limits.twist.angular_acceleration": (0.05, 20.0, "rad/s^2"),
    "limits.point_speed.speed": (0.005, 1.0, "m/s"),
    "limits.point_speed.acceleration": (0.02, 5.0, "m/s^2"),
    "limits.workspace.lower": (-3.0, 3.0, "m"),
    "limits.workspace.upper": (-3.0, 3.0, "m"),
    "limits.arm_length.length": (0.1, 0.5, "m"),
    "limits.tool_axis.half_angle_deg": (3.2, 170.0, "deg"),
    "limits.joints.rate_deg": (6.3, 720.0, "deg/s"),
    "cost.smooth_reba.taus_deg": (0.1, 45.0, "deg"),
    "limits.keep_out.ball.centre": (-10.0, 10.0, "m"),
    "limits.keep_out.ball.radius": (0.005, 5.0, "m"),
    "limits.keep_out.box.lower": (-10.0, 10.0, "m"),
    "limits.keep_out.box.upper": (-10.0, 10.0, "m"),
    "limits.keep_out.half_space.offset": (-10.0, 10.0, "m"),
    "task.load_kg": (0.0, 50.0, "kg"),
}
"""Usual ranges beside a person. A value outside usually has the wrong unit."""

_ANGLES: Final = ("response.ik.comfort_deg", "limits.joints.ranges_deg")
"""Tables of angles in degrees. Usually at least one angle is larger than pi."""


def listed(name: str, found: Sequence[str]) -> str:
    """Return the mistakes of a file as one text."""
    head = f"{name}: " if len(found) == 1 else f"{name}: {len(found)} mistakes:\n  "
    return head + "\n  ".join(found)


def mistakes(table: type[BaseModel], error: ValidationError) -> list[str]:
    """Return a sentence for each mistake that was found in a table.

    Args:
        table: table that the file was read as.
        error: errors of pydantic.
    """
    return [_sentence(table, dict(item)) for item in error.errors(include_url=False)]


def _sentence(table: type[BaseModel], item: dict[str, Any]) -> str:
    *above, last = item["loc"] or ("",)
    key = ".".join(str(part) for part in item["loc"])
    got, message = f"got {item['input']!r:.80}", item["msg"]
    if item["type"] == "extra_forbidden":
        keys = _keys(table, above)
        return (
            f"{key}: got a key that is not known, allowed"
            f" {', '.join(nearest_first(str(last), keys))}"
        )
    if item["type"] == "missing":
        return f"{key}: got nothing, required"
    if message.startswith("Input should be "):
        return f"{key}: {got}, allowed {message.removeprefix('Input should be ')}"
    return f"{key}: {message[0].lower()}{message[1:]}, {got}".removeprefix(": ")


def _keys(table: type[BaseModel], path: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at a path."""
    for part in path:
        if isinstance(part, str):
            table = next(_tables(table.model_fields[keys_of(table)[part]].annotation))
    return list(keys_of(table))


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables that a type consists of, as a union or as a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for each in get_args(annotation):
        yield from _tables(each)


def nearest_first(got: str, allowed: Sequence[str]) -> list[str]:
    """Return the allowed names. The one that was probably meant is first and marked."""
    near = get_close_matches(got, allowed, 1, 0.6)
    return [
        *(f"{each} (the nearest)" for each in near),
        *(each for each in allowed if each not in near),
    ]


def unusual(raw: dict[str, Any], meant: Sequence[str]) -> list[str]:
    """Return a sentence for each number that is unusual beside a person.

    Numbers whose key is in `meant` are left out.

    Args:
        raw: tables of a file without mistakes.
        meant: keys whose unusual values are meant.
    """
    known = {*_USUAL, *_ANGLES}
    found = [
        f"unusual: got {key!r}, allowed {', '.join(nearest_first(key, sorted(known)))}"
        for key in meant
        if key not in known
    ]
    for key, (low, high, unit) in _USUAL.items():
        strange = [each for each in _numbers(_value(raw, key)) if not low <= each <= high]
        if strange and key not in meant:
            found.append(
                f"{key}: got {strange[0]:g}, usual are {low:g} to {high:g} {unit}{_if_meant(key)}"
            )
    for key in _ANGLES:
        angles = list(_numbers(_value(raw, key)))
        if any(angles) and max(map(abs, angles)) <= np.pi and key not in meant:
            found.append(
                f"{key}: got no angle beyond {max(map(abs, angles)):g}, usual are degrees, not"
                f" radians{_if_meant(key)}"
            )
    return found


def _if_meant(key: str) -> str:
    return f'; if it is meant, name it in the first lines: unusual = ["{key}"]'


def _value(raw: Any, key: str) -> Any:
    """Return the value of a key; for an array of tables, a list of values."""
    if isinstance(raw, list):
        return [_value(each, key) for each in raw]
    first, _, rest = key.partition(".")
    value = raw.get(first) if isinstance(raw, dict) else None
    return _value(value, rest) if rest else value


def _numbers(value: Any) -> Iterator[float]:
    """Yield all numbers in tables and lists."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for each in value:
            yield from _numbers(each)
    elif value is not None:
        yield float(value)
