"""The same task for other people: other statures, other hands, other loads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Final

from ergoqp.arguments import as_tuple, check_real, check_word
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError, OutOfReachError
from ergoqp.human import Body
from ergoqp.lab.cluster import on_cluster
from ergoqp.placing.optimise import STARTS, optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.placing.parallel import in_order
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import person_of
from ergoqp.sheets.options import TaskOptions

STATURES: Final = (1.50, 1.60, 1.70, 1.80, 1.90, 2.00)
"""Statures from a small woman to a tall man [m]."""

HANDS: Final[Mapping[str, tuple[str, ...]]] = {
    "right": ("right",),
    "left": ("left",),
    "both": ("right", "left"),
}
"""The hands that hold the object, by a word."""


def population(
    problem: Problem,
    statures: Sequence[float] = STATURES,
    hands: Sequence[str] | None = None,
    loads_kg: Sequence[float] | None = None,
) -> Iterator[tuple[str, Problem]]:
    """Yield (label, problem) for every combination; the stature changes fastest.

    The labels say what was varied.

    Args:
        problem: the task; its response must be an `IkResponse`.
        statures: statures of the people [m].
        hands: keys of `HANDS`; None: as in the problem.
        loads_kg: masses of the tool [kg]; None: as in the problem.

    Raises:
        InputError: if a sequence is empty, or `variant` does not accept a value.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.population import population
        >>> people = population(ergoqp.load_problem("desk"), [1.60, 1.90], ["right", "both"])
        >>> [label for label, _ in people]
        ['1.60 m, right hand', '1.90 m, right hand', '1.60 m, both hands', '1.90 m, both hands']
    """
    given = {"loads_kg": loads_kg, "hands": hands, "statures": statures}
    choices = [
        (None,) if values is None else as_tuple(name, values) for name, values in given.items()
    ]
    for name, values in zip(given, choices, strict=True):
        if not values:
            raise InputError(f"{name}: got nothing, allowed at least one")
    for load, hand, stature in product(*choices):
        changed = variant(problem, stature=stature, hands=hand, load_kg=load)
        words = [f"{stature:.2f} m"]
        words += [f"{hand} hand{'s' if hand == 'both' else ''}"] if hand is not None else []
        words += [f"{load:g} kg"] if load is not None else []
        yield ", ".join(words), changed


@dataclass(frozen=True, eq=False)
class Found:
    """Result for one person of a population.

    Attributes:
        label: the person, as named by `population`.
        optimum: the best place; None if there is none.
        note: why there is none; empty otherwise.

    Example:
        >>> from ergoqp.lab.population import Found
        >>> Found("1.20 m", None, "reaches no place").note
        'reaches no place'
    """

    label: str
    optimum: Optimum | None
    note: str = ""

    @property
    def starts_at_best(self) -> int:
        """Number of starts that end at the best score."""
        best = self.optimum
        return 0 if best is None else sum(trial.reba == best.reba_after for trial in best.trials)


def best_of_population(
    people: Iterable[tuple[str, Problem]],
    starts: int = STARTS,
    seed: int = 0,
    jobs: int = 1,
    mode: str = "stackelberg",
    solver: str = "ipopt",
    *,
    scheduler: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Found]:
    """Return the best place of each person, see `ergoqp.placing.optimise.optimise`.

    Args:
        people: (label, problem), as `population` yields them.
        starts: number of starts per person, as in `optimise`.
        seed: as there.
        jobs: as there.
        mode: as there.
        solver: as there.
        scheduler: address of a Dask scheduler whose workers take the people; None: this machine.
        progress: called with the share that is done.

    Raises:
        InputError: if an option is not usable, or no scheduler answers. A person who reaches no
            place is not an error; the result is a `Found` with a note.
        WorkersError: if the workers of the cluster are gone for good.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.population import best_of_population, variant
        >>> problem = ergoqp.load_problem("screwing")
        >>> people = [("1.60 m", variant(problem, stature=1.60))]
        >>> [found] = best_of_population(people, starts=1)
        >>> found.label, found.optimum.reba_after <= found.optimum.reba_before
        ('1.60 m', True)
    """
    calls = [(label, problem, starts, seed, jobs, mode, solver) for label, problem in people]
    if progress is not None:
        progress(0.0)
    if scheduler is None:
        return in_order(_found, calls, progress=progress)
    found: dict[int, Found] = {}
    for number, each in on_cluster(_found, calls, scheduler):
        found[number] = each
        if progress is not None:
            progress(len(found) / len(calls))
    return [found[number] for number in range(len(calls))]


def _found(label: str, problem: Problem, *options: Any) -> Found:
    try:
        return Found(label, optimise(problem, None, *options))
    except OutOfReachError as nowhere:
        return Found(label, None, str(nowhere))


def variant(
    problem: Problem,
    *,
    stature: float | None = None,
    hands: str | None = None,
    load_kg: float | None = None,
) -> Problem:
    """Return the problem for another person. Arguments that are None change nothing.

    Workspace and comfort posture stay the same.

    Args:
        problem: the task; its response must be an `IkResponse`.
        stature: stature of the person [m], with average proportions.
        hands: a key of `HANDS`.
        load_kg: mass of the tool [kg], in the exact score and in the cost.

    Raises:
        InputError: if a value is not allowed, the response is of another type, or a load is
            given but the cost was learned without one.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.population import variant
        >>> problem = ergoqp.load_problem("screwing")
        >>> variant(problem, stature=1.60, load_kg=3.0).response.body.stature
        1.6
    """
    response = person_of(problem)
    if stature is not None:
        check_real("stature", stature, "metres")
        response = replace(response, body=Body.of_stature(stature))
    if hands is not None:
        check_word("hands", hands, HANDS)
        response = replace(response, hands=HANDS[hands])
    changed = problem.replace(response=response)
    if load_kg is None:
        return changed
    check_real("load_kg", load_kg, "kilograms")
    if not isinstance(problem.cost, SmoothReba):
        raise InputError(
            f"load_kg: got {load_kg:g}, but the cost {problem.cost.name!r} was learned without;"
            " allowed None"
        )
    task = TaskOptions(**{**problem.task, "load_kg": float(load_kg)})
    cost = SmoothReba(
        problem.cost.taus_deg, problem.cost.weights, method=problem.cost.method, **task
    )
    return changed.replace(cost=cost, task=task)
