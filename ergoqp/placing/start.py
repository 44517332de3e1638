"""One start: a random place, then the program with a cost that narrows from stage to stage.

At the end the person and the sheet judge the result.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.expressions.rigid import read_pose
from ergoqp.limits import JointLimit, OneClassBoundary
from ergoqp.placing.optimum import Trial
from ergoqp.placing.program import Program, Solution, smooth_cost
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import REACHED, REACHED_ANGLE, Alike, Start

FINAL_TAU_DEG: Final = 0.5
"""Scale of the smooth score in the last stage [deg]."""

WIDE: Final = ((12.0, 1e-2), (1.5, 1e-3))
"""(tau [deg], relaxation [rad]) of the stages before the last one, for every other start.

These starts can descend from far away.
"""
NARROW: Final = ((3.0, 1e-2),)
"""The same for the other starts, which find what is near."""

RELAXATION: Final = 1e-4
"""Relaxation of complementarity in the last stage [rad]."""

RESIDUAL: Final = 1e-6
"""Largest violation of the optimality conditions of an end that counts as optimal."""

SAME: Final = 1e-3
"""Postures that differ by less than this count as equal [rad]."""

DRAWS: Final = 20
"""Number of places that a start may try until the person reaches one."""

REPEATS: Final = 5
"""Largest number of solutions of the last stage, each from where the person has come to rest."""

_SETTLING = 400
_SLACK = 1e-3  # allowed distance outside a learned boundary, beyond its tolerance


@dataclass(frozen=True, eq=False)
class PlaceTask:
    """Everything that a start needs. It can be sent to another process.

    Attributes:
        problem: the task.
        person: who holds the object.
        begin: the posture, the pose of the object, the grasp, and where the soles stand.
        mode: one of `ergoqp.placing.program.MODES`.
        solver: one of `ergoqp.placing.program.SOLVERS`.
        seed: seed of the places.
        tau_deg: scale of the smooth score in the last stage [deg].
    """

    problem: Problem
    person: Alike
    begin: Start
    mode: str
    solver: str
    seed: int
    tau_deg: float


class StartSolver:
    """Solves the starts of one task. The program is built once."""

    def __init__(self, task: PlaceTask) -> None:
        """Build the program.

        Raises:
            InputError: if the task is not well posed.
        """
        self.task = task
        self.program = Program(task.problem, task.person.response, task.mode, task.solver)
        self.anchor = self.program.place.anchor(task.problem, task.begin.pose)

    def start(self, number: int) -> Trial:
        """Return the result of a start.

        It depends only on the task and the number, not on where and when it is solved.
        """
        begin = time.perf_counter()
        task, place = self.task, self.program.place
        drawn = self._draw(number)
        if drawn is None:
            nowhere = (task.begin.pose, task.begin.posture)
            return Trial(
                number,
                *nowhere,
                0,
                self._cost(task.begin.posture),
                np.inf,
                0.0,
                _since(begin),
                "out of reach",
            )
        unknowns, rest = drawn
        solution, posture = Solution(np.empty(0), np.inf), rest
        last = (task.tau_deg, RELAXATION)
        for tau, relaxation in [
            *(stage for stage in (NARROW if number % 2 else WIDE) if stage[0] > task.tau_deg),
            *[last] * REPEATS,
        ]:
            given = self._given(relaxation, tau)
            pelvis = task.person.contact(rest)[1]
            solution = self.program.solve(self.program.start(unknowns, rest, pelvis, given), given)
            if not np.isfinite(solution.values).all():
                break
            unknowns = np.clip(solution.values[: len(unknowns)], place.lower, place.upper)
            posture = np.array(self.program.posture(solution.values, given)).ravel()
            settled, _ = self._settle(posture, unknowns)
            apart = float(np.abs(settled - posture).max())
            rest = posture if task.mode == "cooperative" else settled
            if (
                (tau, relaxation) == last
                and solution.residual <= RESIDUAL
                and (apart <= SAME or task.mode == "cooperative")
            ):
                break
        return self._verdict(number, unknowns, posture, rest, solution.residual, begin)

    @cached_property
    def _sides(self) -> tuple[np.ndarray, np.ndarray]:
        limit = self.task.problem.limit_of(JointLimit)
        moved = self.program.moved
        low, high = (np.full(len(self.task.begin.posture), end) for end in (-np.inf, np.inf))
        if limit is not None:
            low[moved] = limit.range[0][moved] - limit.tolerance
            high[moved] = limit.range[1][moved] + limit.tolerance
        return low, high

    def _cost(self, posture: np.ndarray) -> float:
        return smooth_cost(self.task.problem, posture, self.task.tau_deg)

    def _draw(self, number: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return a place and the rest posture there; None if the person reaches none.

        It is the given place for number 0, and a random one that the person reaches for the
        others.
        """
        task, place = self.task, self.program.place
        rng = np.random.default_rng([task.seed, 6, number])
        for attempt in range(DRAWS):
            first = number == 0 and attempt == 0
            unknowns = (
                place.unknowns(task.begin.pose, self.anchor)
                if first
                else place.draw(rng, self.anchor)
            )
            posture, reached = self._settle(task.begin.posture, unknowns)
            if reached:
                return unknowns, posture
        return None

    def _settle(self, posture: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, bool]:
        pose = self.program.place.pose(unknowns, self.anchor)
        begin = self.task.begin
        return self.task.person.settle(posture, pose, begin.grasp, begin.soles, steps=_SETTLING)

    def _given(self, relaxation: float, tau_deg: float) -> np.ndarray:
        begin = self.task.begin
        return self.program.given(
            begin.posture, begin.grasp, begin.soles, self.anchor, relaxation, tau_deg
        )

    def _verdict(
        self,
        number: int,
        unknowns: np.ndarray,
        posture: np.ndarray,
        rest: np.ndarray,
        residual: float,
        begin: float,
    ) -> Trial:
        task = self.task
        pose = self.program.place.pose(unknowns, self.anchor)
        settled, reached = self._settle(posture, unknowns)
        apart = float(np.abs(settled - posture).max())
        if task.mode == "cooperative":
            settled, reached = posture, self._holds(posture, pose)
        note = "out of reach" if not reached else self._outside(settled, pose)
        score = 0 if note else int(task.problem.assess(settled).final[0])
        return Trial(
            number, pose, settled, score, self._cost(settled), residual, apart, _since(begin), note
        )

    def _holds(self, posture: np.ndarray, pose: np.ndarray) -> bool:
        begin = self.task.begin
        targets = np.hstack([pose @ grip for grip in begin.grasp])
        _, distance, angle = self.task.person.move(posture, targets, begin.soles, 0.0, 0.0)
        return distance < REACHED and angle < REACHED_ANGLE

    def _outside(self, posture: np.ndarray, pose: np.ndarray) -> str:
        """Return which limit of the problem is violated, or an empty text."""
        problem = self.task.problem
        low, high = self._sides
        if ((posture < low) | (posture > high)).any():
            return "outside a joint's range"
        if pose[:3, 0] @ self.program.place.direction < self.program.place.least_cosine - 1e-6:
            return "outside the tool axis's cone"
        boundary = problem.limit_of(OneClassBoundary)
        if boundary is not None and float(np.ravel(np.array(boundary.measure()(posture)))[0]) < -(
            boundary.tolerance + _SLACK
        ):
            return "outside the learned boundary"
        return problem.own_limits.broken(pose, posture)


def _since(begin: float) -> float:
    return time.perf_counter() - begin


def begin_from(person: Alike, posture: np.ndarray, pose: ArrayLike | None) -> Start:
    """Return how a person holds an object at `pose` (4, 4). None: as the posture holds it.

    Raises:
        InputError: if `pose` is not a pose.
    """
    contact = person.contact(posture)[0]
    grips = person.grasp(posture)
    if pose is None:
        return Start(posture, contact, grips, person.stand(posture))
    pose = read_pose("pose", pose)
    held = np.stack([np.linalg.solve(pose, contact @ grip) for grip in grips])
    return Start(posture, pose, held, person.stand(posture))
