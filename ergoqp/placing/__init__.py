"""The best place of the object, offline: for one person, for a population, for a group that shares one fixed place.

One person: `ergoqp.Problem.optimise`, many starts of one nonlinear program, each verified on the person and the sheet. A group:
`best_for_group`. Everybody of a population: `best_of_population` over `ergoqp.placing.population.population`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ergoqp.placing.optimum import Optimum, Trial

if TYPE_CHECKING:
    from ergoqp.placing.group.optimise import best_for_group
    from ergoqp.placing.group.optimum import GroupOptimum
    from ergoqp.placing.group.people import drawn_people
    from ergoqp.placing.population import best_of_population, variant

__all__ = ["GroupOptimum", "Optimum", "Trial", "best_for_group", "best_of_population", "drawn_people", "variant"]

_LATER = {
    "GroupOptimum": "ergoqp.placing.group.optimum",
    "best_for_group": "ergoqp.placing.group.optimise",
    "best_of_population": "ergoqp.placing.population",
    "drawn_people": "ergoqp.placing.group.people",
    "variant": "ergoqp.placing.population",
}


def __getattr__(name: str) -> Any:
    """Import what is used for the first time: a group is put to rest by the simulated person, which may need an optimum."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)
