"""The best place of the object for one person: many starts, and the best end by exact score.

One start: a random place or the best of several, then the program with a cost that narrows from
stage to stage. At the end the person and the sheet judge the result.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import (
    Progress,
    check_called,
    check_kind,
    check_number,
    check_whole,
    sentences,
)
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError, OutOfReachError
from ergoqp.expressions import read_pose
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.limits import JointLimit, OneClassBoundary
from ergoqp.placing.optimum import Optimum, StartResult
from ergoqp.placing.parallel import call_packed, in_order, packed
from ergoqp.placing.place import Place
from ergoqp.placing.program import Program, check_names, smooth_cost
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.rest.batch import settling
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import REACHED, REACHED_ANGLE, ModelPerson, Start
from ergoqp.rest.person_protocol import read_posture

FINAL_TAU_DEG: Final = 0.5
"""Scale of the smooth score in the last stage [deg]."""

STARTS: Final = 8
"""Number of starts."""

WIDE: Final = ((12.0, 1e-2), (3.0, 1e-2))
"""(tau [deg], relaxation [rad]) of the stages before the last one, for every other start.

These starts can descend from far away.
"""
NARROW: Final = ((3.0, 1e-2),)
"""The same for the other starts, which find what is near."""

SCREENED: Final = 8
"""Number of places of which a narrow start takes the one where the person's rest is best."""

RELAXATION: Final = 1e-4
"""Relaxation of complementarity in the last stage [rad]."""

RESIDUAL: Final = 1e-6
"""Largest violation of the optimality conditions of an end that counts as optimal."""

SAME: Final = 1e-3
"""Postures that differ by less than this count as equal [rad]."""

DRAWS: Final = 20
"""Number of places that a start may try until the person reaches as many as it needs."""

REPEATS: Final = 5
"""Largest number of solutions of the last stage, each from where the person has come to rest."""

_SLACK = 1e-3  # allowed distance outside a learned boundary, beyond its tolerance


class StartSolver:
    """Solves the starts of one search. The program is built once.

    Args:
        problem: the task.
        person: who holds the object.
        begin: the posture, the pose of the object, the grasp, and where the soles stand.
        mode: one of `ergoqp.placing.program.MODES`.
        solver: one of `ergoqp.placing.program.SOLVERS`.
        seed: seed of the places.
        tau_deg: scale of the smooth score in the last stage [deg].
    """

    stages: ClassVar = (WIDE, NARROW)
    """Of starts with even and odd numbers."""
    screened: ClassVar = SCREENED
    """Places of which an odd start takes the best."""

    def __init__(
        self,
        problem: Problem,
        person: ModelPerson,
        begin: Start,
        mode: str,
        solver: str,
        seed: int,
        tau_deg: float,
    ) -> None:
        """Build the program.

        Raises:
            InputError: if the task is not well posed.
        """
        self.problem, self.person, self.begin = problem, person, begin
        self.seed, self.tau_deg, self.cooperative = seed, tau_deg, mode == "cooperative"
        self.program = Program(problem, person.response, mode, solver)
        self.anchor = self.program.place.anchor(problem, begin.pose)
        self._settled = settling(person, places=0)

    def start(self, number: int) -> StartResult:
        """Return the result of a start.

        It depends only on the task and the number, not on which process solves it. Rests that are
        compiled and such that are not differ in the last digits, see `ergoqp.rest.batch.settling`.
        """
        clock, begin, place = time.perf_counter(), self.begin, self.program.place
        drawn = self._draw(number)
        if drawn is None:
            pose, posture = begin.pose, begin.posture
            cost, took = self._cost(posture), time.perf_counter() - clock
            return StartResult(number, pose, posture, 0, cost, np.inf, 0.0, took, "out of reach")
        unknowns, rest = drawn
        posture, residual, last = rest, np.inf, (self.tau_deg, RELAXATION)
        for tau, relaxation in [
            *(stage for stage in self.stages[number % 2] if stage[0] > self.tau_deg),
            *[last] * REPEATS,
        ]:
            given = self.program.given(
                begin.posture, begin.grasp, begin.soles, self.anchor, relaxation, tau
            )
            pelvis = self.person.contact(rest)[1]
            near = self.program.start(unknowns, rest, pelvis, given)
            values, residual = self.program.solve(near, given)
            if not np.isfinite(values).all():
                break
            unknowns = np.clip(values[: len(unknowns)], place.lower, place.upper)
            posture = np.array(self.program.posture(values, given)).ravel()
            settled, _ = self._settle(posture, unknowns)
            apart = float(np.abs(settled - posture).max())
            rest = posture if self.cooperative else settled
            there = apart <= SAME or self.cooperative
            if (tau, relaxation) == last and residual <= RESIDUAL and there:
                break
        return self._verdict(number, unknowns, posture, residual, clock)

    def _cost(self, posture: np.ndarray) -> float:
        return smooth_cost(self.problem, posture, self.tau_deg)

    def _draw(self, number: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return a place and the rest posture there; None if the person reaches none.

        Number 0 begins at the given place, if the person reaches it. The other even numbers begin
        at the first random place that they reach. Odd ones begin at that of the first `screened`
        where the rest has the lowest score, and of equal scores the lowest cost.
        """
        begin, place = self.begin, self.program.place
        rng = np.random.default_rng([self.seed, 6, number])
        found = list[tuple[np.ndarray, np.ndarray]]()
        for attempt in range(DRAWS):
            if number == attempt == 0:
                unknowns = place.unknowns(begin.pose, self.anchor)
            else:
                unknowns = place.draw(rng, self.anchor)
            posture, reached = self._settle(begin.posture, unknowns)
            if reached:
                found.append((unknowns, posture))
            if len(found) == (self.screened if number % 2 else 1):
                break
        if not found:
            return None
        scores = self.problem.assess(np.array([posture for _, posture in found])).final
        costs = [self._cost(posture) for _, posture in found]
        best = min(range(len(found)), key=lambda i: (scores[i], costs[i]))
        return found[best]

    def _settle(
        self, posture: np.ndarray, unknowns: np.ndarray
    ) -> tuple[np.ndarray, bool | np.bool_]:
        pose = self.program.place.pose(unknowns, self.anchor)
        begin = self.begin
        return self._settled(posture, pose, begin.grasp, begin.soles)

    def _verdict(
        self,
        number: int,
        unknowns: np.ndarray,
        posture: np.ndarray,
        residual: float,
        clock: float,
    ) -> StartResult:
        pose = self.program.place.pose(unknowns, self.anchor)
        settled, reached = self._settle(posture, unknowns)
        apart = float(np.abs(settled - posture).max())
        if self.cooperative:
            settled, reached = posture, self._holds(posture, pose)
        note = "out of reach" if not reached else self._outside(settled, pose)
        score = 0 if note else int(self.problem.assess(settled).final[0])
        cost, took = self._cost(settled), time.perf_counter() - clock
        return StartResult(number, pose, settled, score, cost, residual, apart, took, note)

    def _holds(self, posture: np.ndarray, pose: np.ndarray) -> bool:
        targets = np.hstack([pose @ grip for grip in self.begin.grasp])
        _, distance, angle = self.person.move(posture, targets, self.begin.soles, 0.0, 0.0)
        return distance < REACHED and angle < REACHED_ANGLE

    def _outside(self, posture: np.ndarray, pose: np.ndarray) -> str:
        """Return which limit of the problem is violated, or an empty text."""
        problem, angles = self.problem, posture[self.program.moved]
        if (joints := problem.limit_of(JointLimit)) is not None:
            low, high = (ends[self.program.moved] for ends in joints.range)
            if ((angles < low - joints.tolerance) | (angles > high + joints.tolerance)).any():
                return "outside a joint's range"
        if pose[:3, 0] @ self.program.place.direction < self.program.place.least_cosine - 1e-6:
            return "outside the tool axis's cone"
        boundary = problem.limit_of(OneClassBoundary)
        if boundary is not None and float(np.ravel(np.array(boundary.measure()(posture)))[0]) < -(
            boundary.tolerance + _SLACK
        ):
            return "outside the learned boundary"
        return problem.own_limits.broken(pose, posture)


def begin_from(person: ModelPerson, posture: np.ndarray, pose: ArrayLike | None) -> Start:
    """Return how a person holds an object at `pose` (4, 4). None: as the posture holds it.

    Raises:
        InputError: if `pose` is not a pose.
    """
    return person.start_at(posture, None if pose is None else read_pose("pose", pose))


def optimise(
    problem: Problem,
    posture: ArrayLike | None = None,
    starts: int = STARTS,
    seed: int = 0,
    jobs: int = 1,
    mode: str = "stackelberg",
    solver: str = "ipopt",
    *,
    pose: ArrayLike | None = None,
    person: ModelPerson | Body | None = None,
    tau_deg: float = FINAL_TAU_DEG,
    assumptions: Sequence[str] = (),
    progress: Progress | None = None,
) -> Optimum:
    """Find the place of the object at which the person, at rest there, has the lowest score.

    The object leads and the person follows: they come to rest at the place
    (`ergoqp.placing.program`). The conditions of the rest make this one nonlinear program. It is
    solved from several places, with a smooth score that becomes narrower from stage to stage.
    Every other start begins at the best of several random places, as the person rests there. At
    the end of every start the person settles (`ModelPerson.settle`), and the exact sheet gives the
    score. The start with the lowest exact score wins. Of equal scores one that is proven optimal
    comes first, then the lowest cost.

    Args:
        problem: the task; its response must be an `IkResponse`.
        posture: posture in which the person holds the object now (32,) [rad]; None: an awkward
            one, drawn with the seed.
        starts: number of starts; the first is where the object is now.
        seed: seed of the places from which the starts begin.
        jobs: number of processes.
        mode: ``"stackelberg"``, or ``"cooperative"``: the posture of the person is chosen too,
            which gives an optimistic bound.
        solver: ``"ipopt"``, ``"fatrop"`` or ``"sqpmethod"``.
        pose: pose of the object now (4, 4) [m]; None: as the posture holds it.
        person: who holds the object, or their body; None: the person of the problem's
            response.
        tau_deg: scale of the smooth score in the last stage [deg]; not used by a cost that is
            not the smooth score.
        assumptions: sentences on earlier assumptions, for the report.
        progress: called with the share of the starts that is done.

    Returns:
        The best place and all starts. The result does not depend on `jobs`.

    Raises:
        InputError: if an argument is not usable, or no start ends at a place that the limits
            allow and the person reaches.
        MissingExtraError: if a package for several processes is not installed.
        WorkersError: if one of the processes was ended.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = ergoqp.optimise(problem, starts=1)
        >>> best.pose.shape, best.reba_after <= best.reba_before
        ((4, 4), True)
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    check_search(starts, seed, jobs, mode, solver)
    check_number("tau_deg", tau_deg, 0.05, 20.0, "deg")
    check_called("progress", progress, "a function of the share that is done")
    assumptions = sentences("assumptions", assumptions)
    follower = follower_of(problem, person)
    notes: list[str] = []
    Place.of(problem)  # Report faults of the task itself before any search.
    if posture is None:
        given = awkward_start(problem, follower, int(seed))
        notes.append(
            "The object starts at the worst-scored of some random places of the workspace (seed"
            f" {seed})."
        )
    else:
        given, notes = read_posture(posture)
    begin = begin_from(follower, given, pose)
    Place.of(problem).anchor(problem, begin.pose)
    terms = (problem, follower, begin, mode, solver, int(seed), float(tau_deg))
    trials = _solve(terms, int(starts), int(jobs), progress)
    best = best_of(problem, trials)
    return Optimum(
        problem=problem.name,
        title=problem.title or problem.name,
        mode=mode,
        solver=solver,
        seed=int(seed),
        response=follower.response,
        pose=best.pose,
        posture=best.posture,
        reba_before=int(problem.assess(given).final[0]),
        reba_after=best.reba,
        kkt_residual=best.kkt_residual,
        cost_before=smooth_cost(problem, given, float(tau_deg)),
        cost_after=best.cost,
        tau_deg=float(tau_deg) if isinstance(problem.cost, SmoothReba) else None,
        pose_before=begin.pose,
        posture_before=given,
        trials=tuple(trials),
        assumptions=(*assumptions, *notes, *_assumptions(follower.response, mode)),
    )


def check_search(starts: int, seed: int, jobs: int, mode: str, solver: str) -> None:
    """Check the options of a search, before anything is computed.

    Raises:
        InputError: if one cannot be used; the message names it.
    """
    check_names(mode, solver)
    for name, value, least in (("starts", starts, 1), ("seed", seed, 0), ("jobs", jobs, 1)):
        check_whole(name, value, least)


def follower_of(problem: Problem, person: ModelPerson | Body | None) -> ModelPerson:
    """Return who holds the object: the problem's person, or one alike with another body.

    Raises:
        InputError: if the problem's response is not a person's, or `person` is something else.
    """
    response = problem.response
    if not isinstance(response, IkResponse) or tuple(problem.coordinates) != JOINTS:
        kind = type(response).__name__
        raise InputError(
            f"problem {problem.name}: got a response of type {kind}, allowed IkResponse: a person's"
        )
    if isinstance(person, ModelPerson):
        return person
    check_kind("person", person, (Body, type(None)), "a person alike, a Body or None")
    return ModelPerson(response if person is None else replace(response, body=person))


def _solve(terms: tuple, starts: int, jobs: int, progress: Progress | None) -> list[StartResult]:
    """Return the trials of all starts, in order; `terms` are those of a `StartSolver`."""
    if jobs == 1:
        calls = [(number,) for number in range(starts)]
        return in_order(StartSolver(*terms).start, calls, progress=progress)
    [sent] = packed("jobs", [terms])
    return in_order(_solve_start, [(sent, number) for number in range(starts)], jobs, progress)


def _solve_start(sent: bytes, number: int) -> StartResult:
    return _solver_of(sent).start(number)


@lru_cache(maxsize=4)
def _solver_of(sent: bytes) -> StartSolver:
    """Return the solver in another process, which builds the program only once."""
    return call_packed(StartSolver, sent)


def best_of(problem: Problem, trials: Sequence[StartResult]) -> StartResult:
    """Return the trial with the lowest exact score; of equal ones an optimal one, then by cost.

    Raises:
        OutOfReachError: if none counts.
    """
    counting = [trial for trial in trials if trial.reba > 0]
    if not counting:
        notes = Counter(trial.note for trial in trials).most_common()
        words = ", ".join(f"{count} {note}" for note, count in notes)
        raise OutOfReachError(
            f"problem {problem.name}: none of {len(trials)} starts ended at a place that counts"
            f" ({words}); enlarge the workspace or loosen the limits"
        )
    # Of equal scores an end that is proven optimal comes first. The last criterion is the
    # number of the start, which does not depend on the order in which starts finish.
    return min(
        counting,
        key=lambda each: (
            each.reba,
            each.kkt_residual > RESIDUAL,
            round(each.cost, 6),
            each.number,
        ),
    )


def _assumptions(response: IkResponse, mode: str) -> list[str]:
    chooses = "The person comes to rest by their own comfort at every place of the object."
    if mode == "cooperative":
        chooses = (
            "The posture is chosen together with the place: an optimistic bound, because people do"
            " not choose their posture by its score."
        )
    return [
        (
            f"The person is {response.body.stature:.2f} m tall and holds the object as in the"
            f" posture at the start; {response.footing}."
        ),
        chooses,
    ]
