"""Simulated people for tests and benchmarks. They are never the controller's own model."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from ergoqp.arguments import shown
from ergoqp.errors import InputError

if TYPE_CHECKING:
    from ergoqp.human import Body
    from ergoqp.problem.problem import Problem
    from ergoqp.rest.person import Person

_MAKERS: Final = {
    "alike": "alike:sample_person",
    "follower": "follower:draw",
    "dead_zone": "dead_zone:draw",
    "stubborn": "stubborn:draw",
    "stepping": "stepping:draw",
    "pushed": "pushed:draw",
    "looking": "looking:draw",
    "trembling": "trembling:draw",
    "mass": "mass.person:draw",
}

KINDS: Final = tuple(_MAKERS)
"""Names of the kinds of people.

Example:
    >>> from ergoqp.simulation.people import KINDS
    >>> "alike" in KINDS, "mass" in KINDS
    (True, True)
"""


def person_of_kind(kind: str, problem: Problem, seed: int, body: Body | None = None) -> Person:
    """Return a person of a kind for a problem. The same seed gives the same person.

    Args:
        kind: one of `KINDS`.
        problem: the task; its response must be an `IkResponse`. Only its description of the
            task is used: hands, tool, stance, seat.
        seed: seed of the person.
        body: body of the person; None: it is drawn.

    Raises:
        InputError: if the kind does not exist.

    Example:
        >>> import ergoqp
        >>> from ergoqp.simulation.people import person_of_kind
        >>> problem = ergoqp.load_problem("screwing")
        >>> person_of_kind("stubborn", problem, seed=1).kind
        'stubborn'
    """
    if kind not in _MAKERS:
        raise InputError(f"follower: got {shown(kind)}, allowed one of {', '.join(KINDS)}")
    module, maker = _MAKERS[kind].split(":")
    return getattr(import_module(f"{__name__}.{module}"), maker)(problem, seed, body)
