"""A control loop that tries places, measures the person at rest in each, and keeps the best.

Descent finds only what lies downhill for the model of the person, and the optimum of the model is
that of the model person. Which place is better for the real person is measured: by the smooth score
of their mean posture over one second at rest.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final

import numpy as np

from ergoqp.arguments import as_tuple, check_kind
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError
from ergoqp.identification.identify import Identifier
from ergoqp.identification.loops import Resting, RestWatch
from ergoqp.identification.promising import Candidate, CandidateSearch
from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import Workspace
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.seeking.next_place import Place, SearchState, SeekOptions, Try
from ergoqp.step.constants import stand_in
from ergoqp.step.given import number, truth
from ergoqp.step.guide import Guide, read_guide
from ergoqp.step.rest import BACK, LOOK, THERE
from ergoqp.step.stepper import Step, Stepper

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


class BackgroundIdentification:
    """Identification of the person and search for places, one at a time.

    Args:
        problem: the task.
        noise_deg: scale at which postures are scored [deg].

    Attributes:
        note: why the last run gave no result; empty if it gave one.
    """

    def __init__(self, problem: Problem, noise_deg: float) -> None:
        """Build the models."""
        self._identifier, self._promising = Identifier(problem), CandidateSearch(problem, noise_deg)
        self._aside: ThreadPoolExecutor | None = None
        self._future: Future[list[Candidate]] = Future()
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

    def promises(self) -> list[Candidate]:
        """Return what places promise, the most promising first; empty if there is no result."""
        return self._future.result()

    def _think(self, rests: list[Resting], best: float, longest: float) -> list[Candidate]:
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


NOISE_DEG: Final = 2.0
"""Scale of the smooth score of a measured posture [deg]: remaining noise and variation at rest."""

_NOT_ENABLED: Final = "not enabled"
_KEPT: Final = "at rest: at the best of the places tried"
_NOWHERE: Final = "at rest: the person came to rest nowhere"
_LOST: Final = "at rest: back at the best place the person was worse than before, or did not rest"
_LOOKS: Final = "at rest: looking for places that suit this person"
_THERE: Final = "at rest: back where it was best, to be measured again"

_GONE: Final = 1.0
"""A person who was not seen for this long is gone [s]."""

_SEEN: Final = 0.25
"""Smallest share of joints that must be seen. Otherwise the model would be scored."""

_REMEMBERED: Final = 10
"""Number of recent rests that identify the person. More cost time and add little."""


class Seeker:
    """One control loop that tries places; its inputs and outputs are those of a `Stepper`.

    Every twist comes from the stepper, with its limits and its certification. The seeker changes
    only the place that the object is drawn to.

    Args:
        problem: the task; it must move an object that a person holds.
        places: places to try after descent, the most promising first: `Place`, or an `Optimum`.
        how: how many places, and for how long. None: the defaults of `SeekOptions`.
        thinks: whether the person is identified from the rests, and places are tried that promise
            to be better for them (`ergoqp.identify`).
        patient: whether the loop waits for this identification, as a simulation may. False: it runs
            in the background while the object rests.
        terms: keywords of the `Stepper`.

    Raises:
        InputError: as for `Stepper`, and if a place cannot be used.

    Attributes:
        stepper: stepper that moves the object.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> seeker = ergoqp.Seeker(problem, thinks=False)
        >>> step = seeker.step(problem.response.comfort)
        >>> step.status, seeker.seeks, seeker.best is None
        ('optimal', True, True)
    """

    def __init__(
        self,
        problem: Problem,
        places: Sequence[Any] = (),
        how: SeekOptions | None = None,
        *,
        thinks: bool = True,
        patient: bool = False,
        **terms: Any,
    ) -> None:
        """Read the places and build the step."""
        check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
        if tuple(problem.coordinates) != JOINTS:
            raise InputError(
                f"problem {problem.name}: got one that moves {', '.join(problem.coordinates)},"
                " allowed problems of a person"
            )
        if "guide" in terms:
            raise InputError("guide: got one, allowed only as one of the places to be tried")
        check_kind("how", how, (SeekOptions, type(None)), "SeekOptions or None")
        known = [_read_place(problem, place) for place in as_tuple("places", places)]
        thinks = thinks and can_think(problem)
        # A stepper can change its guide only if it is made with one.
        first = [place.pose for place in known] or ([a_place(problem)] if thinks else [])
        guide = Guide(first[0], firm=True) if first else None
        self.stepper = Stepper(problem, guide=guide, **terms)
        self._guided, self._patient = bool(first), patient
        self.problem = self.stepper.problem
        self._score = SmoothReba((NOISE_DEG,), (1.0,), problem.method, **problem.task)
        self._thought = BackgroundIdentification(problem, NOISE_DEG) if thinks else None
        floor = self.score(np.zeros(len(JOINTS)))
        self._tries = SearchState(known, how or SeekOptions(), floor, self._thought is not None)
        self._watch = RestWatch()
        self._rests: list[Resting] = []
        self.reset()

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return self.stepper.dt

    @property
    def account(self) -> list[Try]:
        """The tries so far, with their results."""
        return list(self._tries.account)

    @property
    def best(self) -> Try | None:
        """The rest with the lowest score, as measured last; None before the first rest."""
        return self._tries.best

    @property
    def seeks(self) -> bool:
        """Whether places are still tried."""
        return not self._tries.done

    def score(self, posture: np.ndarray) -> float:
        """Return the smooth score of a mean posture (32,) [points].

        Joints that are NaN are scored as in the comfort posture of the model.
        """
        known = np.where(np.isfinite(posture), posture, stand_in(self.problem))
        return float(self._score(np.clip(known, -np.pi, np.pi))[0])

    def reset(self, twist: Any = None) -> None:
        """Reset the loop and delete what was tried; see `Stepper.reset`."""
        self.stepper.reset(twist)
        self._now, self._held = 0.0, False
        self._tries.begin(0.0)
        self._watch.begin()
        self._rests.clear()
        self._still, self._unseen = False, 0.0
        self._lead(None)

    def hold(self) -> None:
        """Bring the object to rest and keep it there; no place is tried until `try_again`."""
        self.stepper.hold()
        self._held = True

    def try_again(self) -> None:
        """Allow motion again, and try all places again from here."""
        self.stepper.try_again()
        self._held = False
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Try all places from here; nothing that keeps the object at rest is acknowledged."""
        self._tries.begin(self._now)
        self._watch.begin()
        self._lead(None)

    def brake(self, dt: float | None = None, elapsed: float = 0.0) -> Step:
        """Return the next braking twist without new data; see `Stepper.brake`."""
        return self.stepper.brake(dt, elapsed)

    def step(
        self,
        posture: Any,
        pose: Any = None,
        twist: Any = None,
        *,
        dt: float | None = None,
        age: float = 0.0,
        enable: bool = True,
        observed: Any = None,
    ) -> Step:
        """Return the next twist of the object; see `Stepper.step`."""
        step = self.stepper.step(
            posture,
            pose,
            twist,
            dt=dt,
            age=age,
            # The stepper handles values that are neither True nor False.
            enable=False if self._stays else enable,
            observed=observed,
        )
        if self._stays and not step.twist.any() and step.reason == _NOT_ENABLED:
            step.status, step.reason = "settled", self._why()
        period = self.dt if dt is None else number(dt, "dt", {})
        if not 0.0 < period <= self.problem.longest_period:
            return step
        seen = posture is not None and step.status not in ("braking", "invalid")
        known = int(np.count_nonzero(self.stepper.frame[1] > 0.5))
        seen = seen and known >= _SEEN * len(JOINTS)
        self._unseen = 0.0 if seen else self._unseen + period
        if self._held or not truth(enable, "enable", {}) or self._unseen > _GONE:
            # The time of a try stops while the object may not move or no person is there. The
            # person who stands there afterwards is measured again.
            self._watch.begin()
            self._still = False
            return step
        self._now += period
        self._look(step, period, seen)
        return step

    def _why(self) -> str:
        """Return the reason why the object stays."""
        if self._tries.thinking:
            return _LOOKS
        if not self._tries.done:
            return _THERE
        if not self._tries.kept:
            return _NOWHERE if self._tries.best is None else _LOST
        note = "" if self._thought is None else self._thought.note
        return f"{_KEPT}; {note}" if note else _KEPT

    def _look(self, step: Step, period: float, seen: bool) -> None:
        """Update the tries after a step."""
        # A lost frame does not end a rest.
        self._still = not step.twist.any() and (
            step.status == "settled" or (self._still and not seen)
        )
        posture = np.full(len(JOINTS), np.nan)
        if self._still and seen:
            angles, mask = self.stepper.frame
            posture = np.where(mask > 0.5, angles, np.nan)
        rest = self._watch.add(self._now, period, self._still, posture, step.pose)
        if self._tries.returning and step.drawn == LOOK:
            self._stays = True
        if self._tries.done:
            if rest is not None and self._tries.worsened(rest.pose, self.score(rest.posture)):
                # The earlier rests say little about the person now.
                self._rests.clear()
                self._begin_anew()
        elif self._tries.thinking:
            self._think_on()
        elif rest is not None:
            self._rests = [*self._rests[1 - _REMEMBERED :], rest]
            self._lead(self._tries.measured(rest, self.score(rest.posture)))
        elif step.drawn in (THERE, BACK):
            self._tries.on_the_way(self._now)
        elif self._tries.overdue(self._now):
            self._watch.begin()
            self._lead(self._tries.unrested(self._now, step.pose.copy()))

    def _think_on(self) -> None:
        """Go to the suggested place once the identification is done."""
        if self._thought is not None and self._thought.done:
            self._lead(self._tries.suggested(self._now, self._thought.promises()))

    def _lead(self, place: Place | None) -> None:
        # At the end the object stays where it is: a descent would leave the measured place.
        self._stays = self._tries.done or self._tries.thinking
        if self._guided:
            self.stepper.guide(None if place is None else Guide(place.pose, firm=True))
        best = self._tries.best
        if self._tries.thinking and self._thought is not None and best is not None:
            self._thought.begin(self._rests, best.score, self._patient)
            self._think_on()


def _read_place(problem: Problem, given: Any) -> Place:
    """Return a place that the object can go to, from what a user gives."""
    pose = read_guide(problem, given).pose
    return given if isinstance(given, Place) else Place("given", pose)
