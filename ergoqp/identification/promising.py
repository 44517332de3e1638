"""Places that are better for an identified person: the expected gain.

The expected gain of a place is the mean gain over the best measured score, over people who are as
likely as the identified one. A place that is worse for a person counts as 0. So both a place that
is probably a little better and one that may be much better count.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.identification.identify import Identified
from ergoqp.problem.geometry import Workspace
from ergoqp.problem.problem import Problem

LIKELY: Final = 48
"""Number of people who are as likely as the identified one."""

MODEL_SD: Final = float(np.radians(2.0))
"""Deviation of a rest at a new place from its prediction, `Identified.unsure` apart [rad]."""

_SPREAD: Final = 40
"""Number of places that are evaluated first."""
_ROUNDS: Final = ((0.3, 6), (0.12, 6))
"""Further rounds around the best three: distance as a share of the workspace, and number each."""
_REACHED: Final = 0.01
"""A hand that is farther from the object does not reach it [m]."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """The expected result of a place.

    Attributes:
        pose: pose of the object (4, 4) [m].
        gain: expected gain over the best measured score [points].
        score: score of the identified person's rest there [points].
        likely: scores of people who are as likely, in the same order at every place (`LIKELY`,)
            [points].
    """

    pose: np.ndarray
    gain: float
    score: float
    likely: np.ndarray


class CandidateSearch:
    """Search for places that are better for an identified person.

    Args:
        problem: problem with the workspace and the sheet.
        noise_deg: scale at which postures are scored [deg].
    """

    def __init__(self, problem: Problem, noise_deg: float) -> None:
        """Prepare the score of many postures at once."""
        self.workspace = Workspace(problem)
        smooth = SmoothReba((noise_deg,), (1.0,), problem.method, **problem.task)
        self._scores = smooth.function.map(LIKELY + 1)

    def places(
        self,
        person: Identified,
        best: float,
        known: Sequence[np.ndarray] = (),
        seed: int = 0,
        longest: float = np.inf,
    ) -> list[Candidate]:
        """Return places (4, 4), the most promising first; only those that the person reaches.

        Args:
            person: the identified person.
            best: score to improve on [points].
            known: further places to evaluate (4, 4).
            seed: seed of the random draws.
            longest: time after which no further place is evaluated [s].
        """
        until = time.perf_counter() + longest
        rng = np.random.default_rng(seed)
        n = len(person.joints)
        people = rng.multivariate_normal(
            np.zeros(person.habits), person.covariance[: person.habits, : person.habits], LIKELY
        )
        beside = rng.standard_normal((LIKELY, n))

        def promise(pose: np.ndarray) -> Candidate | None:
            if time.perf_counter() > until:
                return None
            rest = person.predict(pose)
            if rest.gap > _REACHED:
                return None
            postures = np.tile(rest.posture, (LIKELY + 1, 1))
            unsure = np.hypot(MODEL_SD, person.unsure(pose))
            postures[1:, person.joints] += people @ rest.by_traits.T + unsure * beside
            scores = np.array(self._scores(ca.DM(np.clip(postures, -np.pi, np.pi).T))).ravel()
            gain = float(np.maximum(0.0, best - scores[1:]).mean())
            return Candidate(pose, gain, float(scores[0]), scores[1:])

        points = self.workspace.spread(_SPREAD)
        found = [(point, promise(self.workspace.pose(point))) for point in points]
        found += [(None, promise(np.asarray(pose))) for pose in known]
        for far, count in _ROUNDS:
            around = [
                (each.gain, at, point)
                for at, (point, each) in enumerate(found)
                if each is not None and point is not None
            ]
            for _, _, point in sorted(around, key=lambda each: (-each[0], each[1]))[:3]:
                for _ in range(count):
                    near = np.clip(point + far * rng.uniform(-1, 1, 5), -1, 1)
                    found.append((near, promise(self.workspace.pose(near))))
        reached = [each for _, each in found if each is not None]
        return sorted(reached, key=lambda each: -each.gain)


def chosen(places: Sequence[Candidate], count: int) -> list[Candidate]:
    """Return places to try together, each chosen by what it adds to those before it.

    What a place adds is the mean gain over people who are as likely, when each person keeps the
    best of the places so far. So two places that promise the same for the same reason do not count
    twice.
    """
    left, found = list(places), []
    lowest = np.full(LIKELY, np.inf)
    for _ in range(min(count, len(left))):
        reached = [np.minimum(lowest, each.likely).mean() for each in left]
        found.append(left.pop(int(np.argmin(reached))))
        lowest = np.minimum(lowest, found[-1].likely)
    return found
