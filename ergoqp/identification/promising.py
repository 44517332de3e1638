"""Places that an identified person would be better at: what is to be gained, and how likely.

What a place promises is the mean, over people who are as likely as the identified one, of what it
would gain beyond the best that was measured: 0 where it is worse. So a place counts that is
probably a little better, and one that may be much better.
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
from ergoqp.problem.problem import Problem
from ergoqp.problem.workspace import Workspace

LIKELY: Final = 48
"""People who are as likely as the identified one."""

MODEL_SD: Final = float(np.radians(2.0))
"""How far a rest at an unseen place is from what is predicted, `Identified.unsure` apart [rad]."""

_SPREAD: Final = 40
"""Places looked at first."""
_ROUNDS: Final = ((0.3, 6), (0.12, 6))
"""Then around the best three: how far, as shares of the workspace, and how many each."""
_REACHED: Final = 0.01
"""A hand that is further off is not where the object is [m]."""


@dataclass(frozen=True, eq=False)
class Promise:
    """What is expected of a place.

    Attributes:
        pose: of the object (4, 4) [m].
        gain: expected beyond the best that was measured [points].
        score: of the identified person's rest there [points].
        likely: of people who are as likely, in the same order at every place (`LIKELY`,) [points].
    """

    pose: np.ndarray
    gain: float
    score: float
    likely: np.ndarray


class Promising:
    """Looks for places that an identified person would be better at.

    Args:
        problem: whose workspace and sheet hold.
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
    ) -> list[Promise]:
        """Return places (4, 4), the most promising first; only those that would be reached.

        Args:
            person: as identified.
            best: score to be improved on [points].
            known: further places to look at and around (4, 4).
            seed: of what is drawn.
            longest: after how long no further place is looked at [s].
        """
        until = time.perf_counter() + longest
        rng = np.random.default_rng(seed)
        n = len(person.joints)
        people = rng.multivariate_normal(
            np.zeros(person.habits), person.covariance[: person.habits, : person.habits], LIKELY
        )
        beside = rng.standard_normal((LIKELY, n))

        def promise(pose: np.ndarray) -> Promise | None:
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
            return Promise(pose, gain, float(scores[0]), scores[1:])

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


def chosen(places: Sequence[Promise], count: int) -> list[Promise]:
    """Return places to be tried together: one after the other, what it adds to those before it.

    What a place adds is the mean gain over people who are as likely, each of whom keeps the best of
    the places so far: not twice what promises the same for the same reason.
    """
    left, found = list(places), []
    lowest = np.full(LIKELY, np.inf)
    for _ in range(min(count, len(left))):
        reached = [np.minimum(lowest, each.likely).mean() for each in left]
        found.append(left.pop(int(np.argmin(reached))))
        lowest = np.minimum(lowest, found[-1].likely)
    return found
