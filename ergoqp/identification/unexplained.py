"""The part of a person's rests that no traits explain, and its prediction at other places.

People are not the model with other parameters. Their rests differ from those of the most likely
traits by some degrees, and similarly at places close to each other. So what was measured beyond the
model is a Gaussian process over places. All joints share one width and one noise, the most likely
ones of `WIDTHS` and `NOISES`. If noise alone is most likely, the process is zero.

C. E. Rasmussen, C. K. I. Williams: Gaussian Processes for Machine Learning, 2006, section 2.2
(prediction) and 5.4 (marginal likelihood). The model is fitted before, not together with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

WIDTHS: Final = tuple(np.radians([0.0, 1.5, 3.0, 5.0]))
"""Possible standard deviations of people from the model [rad]."""

NOISES: Final = tuple(np.radians([1.0, 2.0]))
"""Possible standard deviations of a rest's angles that differ the next time [rad]."""

REACH: Final = 0.3
"""Places this far apart have little in common [m]."""

_TURN: Final = 0.3
"""A turn of the tool's axis by one radian counts as this distance [m]."""

_FLUKE: Final = 3 * WIDTHS[-1]
"""A larger difference means that the person did something else; it counts as not seen [rad]."""

_UNSEEN: Final = 1e3
"""Variance of a joint that was not seen [rad^2].

It is the same for every noise, so it does not affect which noise is most likely.
"""


class Unexplained:
    """Prediction of the part beyond the model.

    Args:
        poses: poses of the rests (k, 4, 4).
        beyond: measured angles beyond the model (k, n) [rad]; NaN if a joint was not seen.
        widths: compared widths, `WIDTHS` except in controls [rad].
        noises: compared noises [rad].

    Attributes:
        width: the most likely width [rad].
    """

    def __init__(
        self,
        poses: Any,
        beyond: np.ndarray,
        widths: Sequence[float] = WIDTHS,
        noises: Sequence[float] = NOISES,
    ) -> None:
        """Find the most likely width and noise."""
        self._places = np.array([_place(pose) for pose in poses])
        seen = (np.abs(beyond) <= _FLUKE).T
        self._beyond = np.where(seen, beyond.T, 0.0)
        known, once = seen[:, :, None], np.eye(len(self._places))
        alike = np.array([self._alike(pose) for pose in poses])
        found = [
            (*self._fitted(width**2 * alike + np.where(known, noise**2, _UNSEEN) * once), width)
            for width in widths
            for noise in noises
        ]
        _, self._inverse, self.width = max(found, key=lambda each: each[0])

    def at(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the prediction for every joint at a place (4, 4): mean and deviation (n,) [rad].

        The deviation is that of the process with this width, without noise. It does not include the
        uncertainty of the width or of the traits. Few rests that the traits explain give a width of
        zero.
        """
        alike = self.width**2 * self._alike(pose)
        weights = alike @ self._inverse
        mean = np.einsum("jk,jk->j", weights, self._beyond)
        return mean, np.sqrt(np.maximum(0.0, self.width**2 - weights @ alike))

    def _alike(self, pose: Any) -> np.ndarray:
        away = np.linalg.norm(self._places - _place(pose), axis=1)
        return np.exp(-0.5 * (away / REACH) ** 2)

    def _fitted(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the log likelihood of the measurements, and the inverses (n, k, k)."""
        inverse = np.linalg.inv(covariance)
        fits = np.einsum("jk,jkl,jl->", self._beyond, inverse, self._beyond)
        volume = np.linalg.slogdet(inverse)[1].sum()
        return 0.5 * float(volume - fits), inverse


def _place(pose: Any) -> np.ndarray:
    """Return position and tool axis of a pose (4, 4) as one vector (6,) [m]."""
    given = np.asarray(pose, dtype=float)
    return np.concatenate([given[:3, 3], _TURN * given[:3, 0]])
