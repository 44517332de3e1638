"""What is found outside the code: folders of data and cache, and terms that packages register.

The user's own terms, by the names that problem files and commands use. A package registers terms as
entry points, with one group per kind. A term is imported only when it is named.
`examples/own_terms` is such a package. A name must be unique: a name that two packages register, or
that ergoqp itself has, is refused when it is used.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

from ergoqp.errors import ErgoqpError, InputError, in_words

_PACKAGE = Path(__file__).resolve().parent


def data_folder(name: str) -> Path:
    """Return the folder ``models`` or ``problems`` of this installation.

    It is inside the package (a wheel), or else beside it (a checkout or an editable install).

    Args:
        name: ``"models"`` or ``"problems"``.

    Raises:
        ErgoqpError: if it is in neither place. The installation is then broken.
    """
    for parent in (_PACKAGE, _PACKAGE.parent):
        folder = parent / name
        if folder.is_dir():
            return folder
    raise ErgoqpError(
        f"the data folder {name!r} is missing from this installation of ergoqp; reinstall the"
        " package"
    )


def cache_folder() -> Path:
    """Return the user's cache folder for ergoqp: below ``XDG_CACHE_HOME``, else ``~/.cache``.

    A relative ``XDG_CACHE_HOME`` is ignored, as the XDG Base Directory Specification demands.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "ergoqp"


GROUPS: Final = {
    "cost": "ergoqp.costs",
    "limit": "ergoqp.limits",
    "response": "ergoqp.responses",
    "solver": "ergoqp.solvers",
    "reader": "ergoqp.readers",
    "person": "ergoqp.people",
}
"""Groups of entry points by kind of term."""


def _installed() -> Any:
    """Return all entry points. Reading them takes 10 ms, and is asked for by every term."""
    return _installed_on(tuple(sys.path))


@lru_cache(maxsize=1)
def _installed_on(_: tuple[str, ...]) -> Any:
    return entry_points()


def registered(kind: str) -> tuple[str, ...]:
    """Return the names of all terms of a kind that installed packages register."""
    return tuple(sorted({_name(kind, each) for each in _installed().select(group=GROUPS[kind])}))


def check_free(kind: str, names: Iterable[str]) -> None:
    """Check that no installed package registers one of ergoqp's own names.

    Args:
        kind: kind of the terms.
        names: names of the package's own terms that are used.

    Raises:
        InputError: if one is registered. The message names the distribution.
    """
    used = set(names)
    for name in sorted(used & set(registered(kind) if used else ())):
        raise InputError(
            f"{kind} {name}: got an entry point of {_distributions(_found(kind, name))}, allowed"
            " any name but one of ergoqp's own"
        )


def own_term(kind: str, name: str) -> Any:
    """Import the term that is registered under a name.

    Raises:
        InputError: if it cannot be imported, or two packages register it.
    """
    found, *others = _found(kind, name)
    if others:
        raise InputError(
            f"{kind} {name}: got entry points of {_distributions([found, *others])}, allowed one"
            " package with that name"
        )
    try:
        return found.load()
    except Exception as error:  # the import runs the user's code, which may raise anything
        raise InputError(
            f"{kind} {name}: got {in_words(error)} from {found.value}, allowed an"
            f" entry point of {GROUPS[kind]} that can be imported"
        ) from None


def _found(kind: str, name: str) -> list[EntryPoint]:
    return [each for each in _installed().select(group=GROUPS[kind]) if _name(kind, each) == name]


def _name(kind: str, point: EntryPoint) -> str:
    """Return the name of a term. For readers it is a file ending, which is not case sensitive."""
    return point.name.lower().removeprefix(".") if kind == "reader" else point.name


def _distributions(points: Iterable[EntryPoint]) -> str:
    return ", ".join(sorted(each.dist.name if each.dist else each.value for each in points))
