"""Terms of the user's own, by the names that problem files and commands call them.

A package registers them as entry points, one group per kind, and they are imported when somebody
names them, not before. `examples/own_terms` is such a package. A name means one thing: what two
packages register, or ergoqp itself has, is refused when somebody names it.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from ergoqp.errors import InputError, in_words

GROUPS: Final = {
    "cost": "ergoqp.costs",
    "limit": "ergoqp.limits",
    "response": "ergoqp.responses",
    "solver": "ergoqp.solvers",
    "reader": "ergoqp.readers",
}
"""Groups of entry points by kind of term."""


def registered(kind: str) -> tuple[str, ...]:
    """Return the names of the terms of a kind that installed packages register."""
    return tuple(sorted({_name(kind, each) for each in entry_points(group=GROUPS[kind])}))


def check_free(kind: str, names: Iterable[str]) -> None:
    """Check that no installed package registers a name that ergoqp has itself.

    Args:
        kind: of the terms.
        names: of the package's own terms that are wanted.

    Raises:
        InputError: if one does, with the distribution's name.
    """
    for name in sorted(set(names) & set(registered(kind))):
        raise InputError(
            f"{kind} {name}: got an entry point of {_distributions(_found(kind, name))}, allowed"
            " any name but one of ergoqp's own"
        )


def own_term(kind: str, name: str) -> Any:
    """Import what is registered under a name.

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
    except Exception as error:  # whatever the user's package does when it is imported
        raise InputError(
            f"{kind} {name}: got {in_words(error)} from {found.value}, allowed an"
            f" entry point of {GROUPS[kind]} that can be imported"
        ) from None


def _found(kind: str, name: str) -> list[EntryPoint]:
    return [each for each in entry_points(group=GROUPS[kind]) if _name(kind, each) == name]


def _name(kind: str, point: EntryPoint) -> str:
    """Return what a term is called by: readers go by the endings of files, which have no case."""
    return point.name.lower().removeprefix(".") if kind == "reader" else point.name


def _distributions(points: Iterable[EntryPoint]) -> str:
    return ", ".join(sorted(each.dist.name if each.dist else each.value for each in points))
