"""The best place of the object, offline: for one person, for a population, for a group that shares one fixed place.

One person: `ergoqp.Problem.optimise`, many starts of one nonlinear program, each verified on the person and the sheet. A group:
`best_for_group`. Everybody of a population: `best_of_population` over `ergoqp.optimise.population.population`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ergoqp.optimise.optimum import Optimum, Trial

if TYPE_CHECKING:
    from ergoqp.optimise.group import best_for_group
    from ergoqp.optimise.group_optimum import GroupOptimum
    from ergoqp.optimise.people import drawn_people
    from ergoqp.optimise.population import best_of_population, variant

__all__ = ["GroupOptimum", "Optimum", "Trial", "best_for_group", "best_of_population", "drawn_people", "variant"]

_LATER = {
    "GroupOptimum": "ergoqp.optimise.group_optimum",
    "best_for_group": "ergoqp.optimise.group",
    "best_of_population": "ergoqp.optimise.population",
    "drawn_people": "ergoqp.optimise.people",
    "variant": "ergoqp.optimise.population",
}


def __getattr__(name: str) -> Any:
    """Import what is used for the first time: a group is put to rest by the simulated person, which may need an optimum."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)
