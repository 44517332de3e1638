"""Identification of the person in the background, and places that promise to be better for them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final

import numpy as np

from ergoqp.identification.identify import Identifier
from ergoqp.identification.promising import Promise, Promising
from ergoqp.identification.resting import Resting
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.problem.workspace import Workspace
from ergoqp.responses.ik import IkResponse

LONGEST: Final = 2.0
"""Largest duration of an identification in the background, approximately [s]."""

FITS_DEG: Final = 15.0
"""Largest residual of rests that an identified person may have [deg].

Residuals of people were mostly within 4 and at most 10. With the other hand, or with angles in
another order, they are 19 and more.
"""

_LOG = logging.getLogger(__name__)


def can_think(problem: Problem) -> bool:
    """Return whether a problem has what identification and the place search need."""
    limits = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    return isinstance(problem.response, IkResponse) and all(each is not None for each in limits)


def a_place(problem: Problem) -> np.ndarray:
    """Return any place (4, 4) [m] that a problem allows."""
    return Workspace(problem).pose(np.zeros(5))


class Thought:
    """Identification of the person and search for places, one at a time.

    Args:
        problem: the task.
        noise_deg: scale at which postures are scored [deg].

    Attributes:
        note: why the last run gave no result; empty if it gave one.
    """

    def __init__(self, problem: Problem, noise_deg: float) -> None:
        """Build the models."""
        self._identifier, self._promising = Identifier(problem), Promising(problem, noise_deg)
        self._aside: ThreadPoolExecutor | None = None
        self._future: Future[list[Promise]] = Future()
        self._future.set_result([])
        self.note = ""

    def begin(self, rests: Sequence[Resting], best: float, patient: bool) -> None:
        """Begin with the given rests and the best score; return at once unless `patient`."""
        given = list(rests)
        if patient:
            self._future = Future()
            self._future.set_result(self._think(given, best, np.inf))
            return
        if self._aside is None:
            self._aside = ThreadPoolExecutor(1, thread_name_prefix="ergoqp-thought")
        self._future = self._aside.submit(self._think, given, best, LONGEST)

    @property
    def done(self) -> bool:
        """Whether the run is finished."""
        return self._future.done()

    def promises(self) -> list[Promise]:
        """Return what places promise, the most promising first; empty if there is no result."""
        return self._future.result()

    def _think(self, rests: list[Resting], best: float, longest: float) -> list[Promise]:
        # Whatever goes wrong here, the loop goes on with its measurements.
        try:
            self.note = ""
            person = self._identifier.identify(rests, longest=longest / 2)
            if not person.residual_deg <= FITS_DEG:
                self.note = (
                    f"no person of the model rests as measured: the likeliest one is"
                    f" {person.residual_deg:.0f} deg off (another hand, or wrong angles?)"
                )
                return []
            return self._promising.places(
                person, best, [rest.pose for rest in rests], longest=longest / 2
            )
        except Exception:
            _LOG.exception("identifying the person came to nothing")
            self.note = "identifying the person came to nothing, see the log"
            return []
