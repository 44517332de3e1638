"""Kinds of people by name. They are never the controller's own model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ergoqp.arguments import check_word
from ergoqp.registry import check_free, own_term, registered
from ergoqp.rest.model_person import sample_person

if TYPE_CHECKING:
    from ergoqp.human import Body
    from ergoqp.problem.problem import Problem
    from ergoqp.rest.person_protocol import Person


def kinds() -> tuple[str, ...]:
    """Return the names of the kinds of people: like the model, and those that packages register.

    ``ergoqp.lab`` registers the others that ergoqp has.

    Raises:
        InputError: if another package registers ``alike``.

    Example:
        >>> from ergoqp.simulation.people import kinds
        >>> "alike" in kinds(), "mass" in kinds()
        (True, True)
    """
    check_free("person", ["alike"])
    return ("alike", *registered("person"))


def person_of_kind(kind: str, problem: Problem, seed: int, body: Body | None = None) -> Person:
    """Return a person of a kind for a problem. The same seed gives the same person.

    Args:
        kind: one of `kinds`.
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
    check_word("follower", kind, kinds())
    draw = sample_person if kind == "alike" else own_term("person", kind)
    return draw(problem, seed, body)
