"""The people of a group: by stature, drawn with seeds, or the user's own simulated people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real

from ergoqp.arguments import as_tuple, check_whole
from ergoqp.errors import InputError
from ergoqp.placing.population import person_of, variant
from ergoqp.problem.problem import Problem
from ergoqp.simulation.people.alike import Alike, sample_person

MOST = 200
"""Largest size of a group."""


@dataclass(frozen=True)
class GroupPerson:
    """One person of a group.

    Attributes:
        label: name of the person in tables, unique in a group.
        follower: body, weights and comfort.

    Example:
        >>> import ergoqp
        >>> from ergoqp.placing.group.people import GroupPerson
        >>> from ergoqp.simulation.people.alike import sample_person
        >>> problem = ergoqp.load_problem("screwing")
        >>> anna = GroupPerson("Anna", sample_person(problem, seed=3))
        >>> anna.label, round(anna.stature, 1)
        ('Anna', 1.8)
    """

    label: str
    follower: Alike

    @property
    def stature(self) -> float:
        """Standing height [m]."""
        return self.follower.response.body.stature


def read_people(
    problem: Problem, people: Sequence[float | Alike | GroupPerson]
) -> tuple[GroupPerson, ...]:
    """Return the people of a group.

    A number is the stature [m] of a person with the weights and the comfort of the problem.

    Raises:
        InputError: if the group is empty or larger than `MOST`, or a person has other hands,
            stance, seat height or tool than the problem.
    """
    people = as_tuple("group", people)
    if not 1 <= len(people) <= MOST:
        raise InputError(f"group: got {len(people)} people, allowed 1 to {MOST}")
    return _unique([_person(problem, person) for person in people])


def drawn_people(problem: Problem, count: int, seed: int = 0) -> tuple[GroupPerson, ...]:
    """Return people drawn with the seeds `seed`, `seed` + 1 and so on.

    Each is drawn as in `ergoqp.simulation.people.alike.sample_person`.

    Raises:
        InputError: if the count is not from 1 to `MOST`, or the seed is negative.
    """
    if isinstance(count, bool) or not (isinstance(count, Integral) and 1 <= count <= MOST):
        raise InputError(f"group: got {count} people, allowed 1 to {MOST}")
    check_whole("seed", seed, 0)
    followers = [(number, sample_person(problem, number)) for number in range(seed, seed + count)]
    return tuple(
        GroupPerson(f"{person.response.body.stature:.2f} m, seed {number}", person)
        for number, person in followers
    )


def _person(problem: Problem, person: float | Alike | GroupPerson) -> GroupPerson:
    if isinstance(person, Alike):
        person = GroupPerson(f"{person.response.body.stature:.2f} m", person)
    if not isinstance(person, GroupPerson):
        if isinstance(person, bool) or not isinstance(person, Real):
            raise InputError(
                f"group: got a {type(person).__name__}, allowed statures in metres or simulated"
                " people"
            )
        return GroupPerson(
            f"{float(person):.2f} m", Alike(person_of(variant(problem, stature=float(person))))
        )
    model, own = person_of(problem), person.follower.response
    for term in ("hands", "stance", "seat_height", "tool"):
        if getattr(own, term) != getattr(model, term):
            raise InputError(
                f"group: {person.label} has {term} {getattr(own, term)!r}, allowed the problem's"
                f" {getattr(model, term)!r}"
            )
    return person


def _unique(people: list[GroupPerson]) -> tuple[GroupPerson, ...]:
    """Add numbers to labels that occur more than once."""
    labels = [person.label for person in people]
    numbered = []
    for i, person in enumerate(people):
        same = labels[: i + 1].count(person.label)
        numbered.append(
            person if same == 1 else GroupPerson(f"{person.label} ({same})", person.follower)
        )
    return tuple(numbered)
