"""Values of a problem file that are unusual beside a person, and the units of its keys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from ergoqp.problem_files.in_words import nearest_first
from ergoqp.units import perhaps

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

_UNITS: Final = {
    "dt": "s",
    "response.ik.stature": "m",
    "response.ik.seat_height": "m",
    "robot.delay": "s",
    "robot.lag": "s",
    "robot.gain_error": "share",
    "robot.pose_delay": "s",
    "robot.pose_noise": "m",
    "robot.longest_hold": "s",
}
"""Units of keys that have a range and no usual one."""

_ANGLES: Final = ("response.ik.comfort_deg", "limits.joints.ranges_deg")
"""Tables of angles in degrees. Usually at least one angle is larger than pi."""


def unit_of(key: str) -> str:
    """Return the unit of the number of a key; empty if it has none or is not known."""
    if key in _USUAL:
        return _USUAL[key][2]
    return _UNITS.get(key, "deg" if key.endswith("_deg") else "")


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
                f"{key}: got {strange[0]:g}, usual are {low:g} to {high:g} {unit}"
                f"{perhaps(strange, low, high, unit)}{_if_meant(key)}"
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
