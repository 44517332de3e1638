"""Terms of the user's own, by the names that problem files and commands call them.

A package registers them as entry points, one group per kind, and they are imported when somebody
names them, not before. `examples/own_terms` is such a package.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any, Final

from ergoqp.errors import InputError

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
    return tuple(sorted(entry_points(group=GROUPS[kind]).names))


def own_term(kind: str, name: str) -> Any:
    """Import what is registered under a name.

    Raises:
        InputError: if it cannot be imported.
    """
    found = next(iter(entry_points(group=GROUPS[kind], name=name)))
    try:
        return found.load()
    except Exception as error:  # whatever the user's package does when it is imported
        words = " ".join(str(error).split())[:100]
        raise InputError(
            f"{kind} {name}: got {type(error).__name__} ({words}) from {found.value}, allowed an"
            f" entry point of {GROUPS[kind]} that can be imported"
        ) from None
