"""Lines of JSON from strangers: one object per line, read with nothing taken on trust.

A line that cannot be read gives an error of one sentence. Nothing in it is evaluated.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import InputError
from ergoqp.expressions import pose_at
from ergoqp.joints import INDEX

LONGEST_LINE: Final = 1_000_000
"""Longest line [bytes]."""

DEEPEST: Final = 8
"""Most lists and objects within one another."""

_DIGITS: Final = 18
"""Most digits of a whole number."""

_LONGEST_ID: Final = 200

# A text that is not closed is one too: else such texts would be searched again and again.
_BRACKETS: Final = re.compile(rb'"(?:[^"\\]|\\.)*+"?|[\[{]|[\]}]', re.DOTALL)


class LineError(InputError):
    """A line is no request.

    Example:
        >>> from ergoqp.service.lines import LineError, read_line
        >>> try:
        ...     read_line(b'{"step": {}, "step": {}}')
        ... except LineError as error:
        ...     print(error)
        line: got the key 'step' twice, allowed once
    """


def read_line(line: bytes) -> dict[str, Any]:
    """Return the object of a line.

    Raises:
        LineError: if it is too long or too deep, is not UTF-8, is no JSON object, has a key twice,
            or holds a number that is not finite.
    """
    if len(line) > LONGEST_LINE:
        raise LineError(f"line: got {len(line)} bytes, allowed {LONGEST_LINE}")
    _check_depth(line)
    try:
        found = json.loads(
            line.decode(),
            object_pairs_hook=_object,
            parse_float=_float,
            parse_int=_int,
            parse_constant=_constant,
        )
    except UnicodeDecodeError as error:
        raise LineError(f"line: byte {error.start} is not UTF-8; send JSON in UTF-8") from None
    except json.JSONDecodeError as error:
        raise LineError(
            f"line: not JSON: {error.msg} at character {error.pos + 1}; send one object per line,"
            ' such as {"describe": {}}'
        ) from None
    if not isinstance(found, dict):
        raise LineError(
            f"line: got {shown(found)}, allowed one JSON object per line, such as"
            ' {"describe": {}}'
        )
    return found


def write_line(told: Mapping[str, Any]) -> bytes:
    """Return an object as a line; floats are written so that they are read as the same numbers.

    A number that is not finite becomes null.
    """
    try:
        text = json.dumps(told, allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(told), allow_nan=False)
    return text.encode() + b"\n"


def id_of(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an answer repeats of a request: its id, or nothing.

    Raises:
        LineError: if the id is neither a text nor a number.
    """
    if "id" not in request:
        return {}
    number = request["id"]
    if isinstance(number, bool) or not isinstance(number, (str, int, float)):
        raise LineError("id: got no text and no number, allowed one of them")
    if isinstance(number, str) and len(number) > _LONGEST_ID:
        raise LineError(f"id: got {len(number)} characters, allowed {_LONGEST_ID}")
    return {"id": number}


def table(what: str, value: Any, allowed: Collection[str]) -> dict[str, Any]:
    """Return an object that has no other keys than those that are allowed.

    Raises:
        LineError: if it is no object, or has another key.
    """
    if not isinstance(value, dict):
        raise LineError(f"{what}: got {shown(value)}, allowed an object, such as {{}}")
    for key in value:
        if key not in allowed:
            words = f"allowed {', '.join(allowed)}" if allowed else "allowed none"
            raise LineError(f"{what}: got the key {shown(key)}, {words}")
    return value


def number(what: str, value: Any, unit: str) -> float:
    """Return a number.

    Raises:
        LineError: if it is none.
    """
    if type(value) not in (int, float):
        raise LineError(f"{what}: got {shown(value)}, allowed a number [{unit}]")
    return float(value)


def flag(what: str, value: Any) -> bool:
    """Return true or false.

    Raises:
        LineError: if it is neither.
    """
    if type(value) is not bool:
        raise LineError(f"{what}: got {shown(value)}, allowed true or false")
    return value


def text(what: str, value: Any, most: int) -> str:
    """Return a text.

    Raises:
        LineError: if it is none, is too long, or holds half a character.
    """
    if not isinstance(value, str):
        raise LineError(f"{what}: got {shown(value)}, allowed a text")
    try:
        size = len(value.encode())
    except UnicodeEncodeError:
        raise LineError(f"{what}: got half of a character, allowed a text in UTF-8") from None
    if size > most:
        raise LineError(f"{what}: got {size} bytes, allowed {most}")
    return value


def numbers(what: str, value: Any, count: int | None, allowed: str) -> list[float]:
    """Return a list of numbers; a count of None allows any.

    Raises:
        LineError: if it is none, or has another length.
    """
    if not isinstance(value, list) or count not in (None, len(value)):
        got = f"{len(value)} entries" if isinstance(value, list) else shown(value)
        raise LineError(f"{what}: got {got}, allowed {allowed}")
    for i, each in enumerate(value):
        if type(each) not in (int, float):
            raise LineError(f"{what}: got {shown(each)} at place {i + 1}, allowed {allowed}")
    return [float(each) for each in value]


def pose(what: str, value: Any) -> np.ndarray:
    """Return a pose (4, 4) from rows, from 16 numbers, or from a position and a quaternion [m].

    Raises:
        LineError: if it is none of these.
    """
    allowed = (
        "4 rows of 4 numbers, 16 numbers row by row, or an object with position_m (3) and"
        " quaternion_xyzw (4)"
    )
    if isinstance(value, dict):
        keys = ("position_m", "quaternion_xyzw")
        table(what, value, keys)
        position, turn = (
            numbers(f"{what}.{key}", value.get(key), count, f"{count} numbers")
            for key, count in zip(keys, (3, 4), strict=True)
        )
        length = math.hypot(*turn)
        if not abs(length - 1) <= 1e-3:
            raise LineError(
                f"{what}.quaternion_xyzw: got the length {length:.6g}, allowed 1 (x, y, z, w)"
            )
        return pose_at(np.array(position), np.array(turn))
    if isinstance(value, list) and len(value) == 4:
        rows = [numbers(f"{what}, row {i + 1}", row, 4, allowed) for i, row in enumerate(value)]
        return np.array(rows)
    return np.array(numbers(what, value, 16, allowed)).reshape(4, 4)


def posture(what: str, value: Any, names: Sequence[str]) -> np.ndarray:
    """Return a posture (n,); NaN stands for entries that are not seen [rad].

    Args:
        what: name of the value, for the message.
        value: list of numbers, null for what is not seen, or an object of numbers by name, in which
            names that end in ``_deg`` are in degrees, and those that are missing are not seen.
        names: names of the entries.

    Raises:
        LineError: if it is neither.
    """
    if isinstance(value, dict):
        return _by_name(what, value, names)
    if not isinstance(value, list) or len(value) != len(names):
        got = f"{len(value)} entries" if isinstance(value, list) else shown(value)
        raise LineError(
            f"{what}: got {got}, allowed {len(names)} numbers (null: not seen), or an object of"
            " names"
        )
    found = np.full(len(names), np.nan)
    for i, each in enumerate(value):
        if each is not None:
            found[i] = number(f"{what}, {names[i]}", each, "rad")
    return found


def _by_name(what: str, value: dict[str, Any], names: Sequence[str]) -> np.ndarray:
    places = {name: i for i, name in enumerate(names)}
    found, said = np.full(len(names), np.nan), set[str]()
    for key, each in value.items():
        name = key if key in places else key.removesuffix("_deg")
        if name not in places or (name != key and name not in INDEX):
            degrees = ", each with _deg for degrees" if INDEX.keys() >= places.keys() else ""
            raise LineError(
                f"{what}: got the name {shown(key)}, allowed {', '.join(places)}{degrees}"
            )
        if name in said:
            raise LineError(f"{what}: got {name} in two units, allowed one of them")
        said.add(name)
        if each is not None:
            given = number(f"{what}.{key}", each, "rad" if name == key else "deg")
            found[places[name]] = given if name == key else math.radians(given)
    return found


def _check_depth(line: bytes) -> None:
    """Refuse brackets within brackets before a parser follows them."""
    depth = 0
    for found in _BRACKETS.finditer(line):
        first = found[0][0]
        if first in b"[{":
            depth += 1
            if depth > DEEPEST:
                raise LineError(f"line: got more than {DEEPEST} lists and objects within another")
        elif first in b"]}":
            depth -= 1


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))
        raise LineError(f"line: got the key {shown(twice)} twice, allowed once")
    return found


def _float(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise LineError(f"line: got {shown(digits)}, allowed finite numbers")
    return value


def _int(digits: str) -> int:
    if len(digits) > _DIGITS:
        raise LineError(f"line: got a number of {len(digits)} digits, allowed {_DIGITS}")
    return int(digits)


def _constant(name: str) -> float:
    raise LineError(f"line: got {name}, allowed finite numbers; null is a joint that is not seen")


def _finite(told: Any) -> Any:
    if isinstance(told, dict):
        return {key: _finite(each) for key, each in told.items()}
    if isinstance(told, (list, tuple)):
        return [_finite(each) for each in told]
    return None if isinstance(told, float) and not math.isfinite(told) else told
