"""Problems that a client sends as a text: what such a text may not do, and how it is served."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from ergoqp.arguments import shown
from ergoqp.errors import InputError, ProblemError
from ergoqp.files.read import toml_of
from ergoqp.problem.schema import own_names
from ergoqp.service.served import Served, check_name, served_text

LONGEST_PROBLEM: Final = 64_000
"""Longest text of a problem [bytes]."""

LONGEST_PACKET: Final = LONGEST_PROBLEM + 1000
"""Longest packet between door and supervisor [bytes]."""

MOST_LOADED: Final = 8
"""Most problems that are served by text at once."""

Own: TypeAlias = Mapping[tuple[str, str], frozenset[str]]
"""Texts that the tables of each own term may hold, by part and name of the term."""

_MODEL: Final = re.compile(r"[A-Za-z0-9_-]{1,100}")
_MODELS: Final = (("response", "gmr"), ("cost", "learned"), ("limits", "one_class_boundary"))
"""Terms with a model."""


@dataclass(frozen=True)
class Text:
    """A problem as a client sent it.

    Attributes:
        name: name of the problem and of its loop.
        text: the problem file.
        own: own terms that it may have.
    """

    name: str
    text: str
    own: Own = field(default_factory=dict)

    @property
    def loop_names(self) -> list[str]:
        """Names of the loops."""
        return [self.name]

    def load(self) -> Served:
        """Return the problem. No file is opened but the models that come with the package.

        Raises:
            ProblemError: if it has mistakes, or names a file or a term that is not allowed.
        """
        check_name(self.name)
        try:
            raw = toml_of(self.text, self.name)
            _check_files(raw)
            _check_own(raw, self.own)
        except InputError as error:
            raise ProblemError(str(error)) from None
        return served_text(self.text, self.name)


def own_terms(problems: Iterable[Served]) -> dict[tuple[str, str], frozenset[str]]:
    """Return the own terms of problems, by part and name, with the texts in their tables."""
    found: dict[tuple[str, str], frozenset[str]] = {}
    for each in problems:
        raw = toml_of(each.text, each.name)
        for part, name in own_names(raw):
            before = found.get((part, name), frozenset())
            found[part, name] = before | frozenset(_texts(raw[part][name]))
    return found


def _check_files(raw: Mapping[str, Any]) -> None:
    """Refuse what would open a file by a path."""
    if "person" in _table(raw, "response", "ik"):
        raise InputError(
            "response.ik.person: got a person file, allowed stature: no file is opened for a client"
        )
    for part, term in _MODELS:
        model = _table(raw, part, term).get("model")
        if isinstance(model, str) and not _MODEL.fullmatch(model):
            raise InputError(
                f"{part}.{term}.model: got {shown(model)}, allowed the name of a model that comes"
                " with the package: no file is opened for a client"
            )


def _check_own(raw: Mapping[str, Any], own: Own) -> None:
    """Refuse the users' terms that the service was not started with, and unknown texts in them."""
    for part, name in own_names(raw):
        if (part, name) not in own:
            raise InputError(
                f"{part}.{name}: got a term that is not ergoqp's, allowed only if the service was"
                " started with a problem that has it"
            )
        # A text may be the path of a file.
        for text in _texts(raw[part][name]):
            if text not in own[part, name]:
                raise InputError(
                    f"{part}.{name}: got the text {shown(text)}, allowed the texts that the"
                    " problems have there that the service was started with"
                )


def _table(raw: Mapping[str, Any], part: str, term: str) -> Mapping[str, Any]:
    tables = raw.get(part)
    found = tables.get(term) if isinstance(tables, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _texts(value: Any) -> Iterable[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list):
        for each in value:
            yield from _texts(each)


def pack_load(number: int, name: str, text: str) -> bytes:
    """Return the packet by which the door asks the supervisor to serve a problem."""
    return f"{number}\0{name}\0{text}".encode()


def unpack_load(packet: bytes) -> tuple[int, str, str]:
    """Return number, name and text of such a packet.

    Raises:
        ValueError: if it is none.
    """
    number, name, text = packet.decode().split("\0", 2)
    return int(number), name, text


def pack_outcome(number: int, words: str) -> bytes:
    """Return the packet that says why a problem is not served, or nothing if it is."""
    return json.dumps([number, words]).encode()


def unpack_outcome(packet: bytes) -> tuple[int, str]:
    """Return number and words of such a packet; number 0 if it is none."""
    try:
        number, words = json.loads(packet)
    except ValueError:
        return 0, ""
    return number, words
