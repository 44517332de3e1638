"""Whether the rows of a user's limit agree with each other, tried at a few places.

A limit with a wrong gradient, or without the distances that must not be used, would let the object
through. Nothing else would notice before the checker of a simulation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.errors import ProblemError
from ergoqp.limits.limit import Limit, Rows, Situation

_PLACES: Final = 8
_STEP: Final = 1e-5
"""Step of the central differences [m, rad]."""
_FAR: Final = 0.05
"""Displacement with which margins are tried [m, rad]."""
_EXACT: Final = 1e-3
"""Largest difference of a rate, relative to 1 + its size."""
_ROUNDING: Final = 1e-7


@dataclass(frozen=True)
class _Place:
    """A state and what its rows say there.

    Attributes:
        posture: posture (n,) [rad].
        pose: pose of the object (4, 4) [m].
        sensitivity: S (n, 6).
    """

    posture: np.ndarray
    pose: np.ndarray
    sensitivity: np.ndarray

    def moved(self, displacement: np.ndarray) -> _Place:
        """Return the place after a displacement (6,) [m, rad] of the object."""
        pose = self.pose.copy()
        pose[:3, 3] += displacement[:3]
        pose[:3, :3] = Rotation.from_rotvec(displacement[3:]).as_matrix() @ pose[:3, :3]
        return replace(self, posture=self.posture + self.sensitivity @ displacement, pose=pose)


class OwnRates:
    """The rows of one limit as a function of a place, and what they must satisfy.

    Args:
        limit: a limit whose rows have the right shapes.
        situation: a symbolic situation with nothing under way.
    """

    def __init__(self, limit: Limit, situation: Situation) -> None:
        """Build the functions."""
        self.limit, self.first = limit, limit.names[0]
        n, m = situation.posture.numel(), len(limit.names)
        sensitivity, shift = ca.SX.sym("sensitivity", n, 6), ca.SX.sym("shift", n)
        displacement = ca.SX.sym("displacement", 6)
        self._measure = limit.measure()
        here = replace(situation, sensitivity=sensitivity)
        readings = ca.SX(0, 1)
        if self._measure is not None:
            readings = ca.SX.sym("readings", self._measure.numel_out(0))
            here = replace(here, readings={self.first: readings})
        lost = replace(here, lost={self.first: (ca.SX.ones(m), ca.SX.ones(m))})
        rows, fewer = limit.rows(here), limit.rows(lost)
        shifted = limit.rows(replace(here, shift=shift))
        # A hard limit of a state that the twist moves directly knows of no object under way.
        self._of_object = limit.hard and ca.depends_on(ca.vertcat(*_ends(rows)), here.pose)
        outputs = [rows.matrix, *_ends(rows), *_ends(fewer), *_ends(shifted)]
        outputs.append(limit.margins(here, displacement))
        symbols = [here.posture, here.pose, sensitivity, readings, shift, displacement]
        self._rows = ca.Function("rows", symbols, [ca.densify(each) for each in outputs])

    def judge(self) -> None:
        """Check the rows at some places.

        Raises:
            ProblemError: if margins are wrong at one of the places, or rows at most of them. Rows
                may have edges at which no derivative exists.
        """
        found = [set(self._wrong(place)) for place in self._places()]
        for words in sorted(set().union(*found)):
            count = sum(words in each for each in found)
            if 2 * count > len(found) or words.startswith("margins"):
                raise ProblemError(f"limits: rows of {self.first}: got {words}")

    def _places(self) -> Iterator[_Place]:
        rng, n = np.random.default_rng(0), self._rows.numel_in(0)
        for _ in range(_PLACES):
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
            pose[:3, 3] = rng.uniform([-0.8, -0.8, 0.3], [0.8, 0.8, 1.8])
            yield _Place(rng.uniform(-0.3, 0.3, n), pose, rng.normal(size=(n, 6)))

    def _wrong(self, place: _Place) -> Iterator[str]:
        """Yield what is wrong at a place, in words that are the same at every place."""
        matrix, ends, fewer, _, margins = self._at(place)
        finite = np.isfinite(ends)
        if self._of_object and not np.allclose(fewer[finite], ends[finite] - 1):
            yield (
                "distances that do not become smaller by situation.lost, allowed rows that are"
                f" returned through situation.counted({self.first!r}, rows)"
            )
        rates = np.concatenate([matrix, -matrix])
        for axis in np.eye(6):
            further, before = (self._at(place.moved(s * _STEP * axis))[1] for s in (1, -1))
            known = np.isfinite(further) & np.isfinite(before)
            true = (further[known] - before[known]) / (2 * _STEP)
            if not np.allclose(rates[known] @ axis, true, rtol=_EXACT, atol=_EXACT):
                yield "a matrix that is not the derivative of the distances, allowed their rates"
                return
        if not self.limit.hard:
            step = np.full(len(place.posture), 1e-2)
            there = self._at(replace(place, posture=place.posture + step))[1]
            if not np.allclose(self._at(place, shift=step)[3][finite], there[finite]):
                yield "distances without situation.shift, allowed posture + shift in them"
            return
        m = len(self.limit.names)
        least = np.minimum(ends[:m], ends[m:])
        if (margins > least + _ROUNDING).any():
            yield "margins above the distances at rest, allowed at most min(below, above)"
        for sign in (1, -1):
            for axis in np.eye(6):
                far = sign * _FAR * axis
                there = self._at(place.moved(far))[1]
                beyond = np.minimum(there[:m], there[m:]) + _ROUNDING
                if (self._at(place, displacement=far)[4] > beyond).any():
                    yield (
                        "margins above those that the object has after the displacement, allowed"
                        " lower bounds: curved rows bend along it"
                    )
                    return

    def _at(
        self,
        place: _Place,
        shift: np.ndarray | None = None,
        displacement: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return matrix (m, 6), ends (2 m,), those with less and shifted, and margins (m,)."""
        readings = [] if self._measure is None else self._measure(place.posture)
        found = self._rows(
            place.posture,
            place.pose,
            place.sensitivity,
            readings,
            np.zeros(len(place.posture)) if shift is None else shift,
            np.zeros(6) if displacement is None else displacement,
        )
        matrix, *parts, margins = (np.array(each) for each in found)
        pairs = [
            np.concatenate([a, b]).ravel() for a, b in zip(parts[::2], parts[1::2], strict=True)
        ]
        return matrix, pairs[0], pairs[1], pairs[2], margins.ravel()


def _ends(rows: Rows) -> tuple[ca.SX, ca.SX]:
    return rows.below, rows.above
