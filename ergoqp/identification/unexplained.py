"""What no traits explain of a person's rests, and how much of it is to be expected elsewhere.

People are not the model with other numbers: where they rest differs from what the likeliest traits
say by some degrees, and alike at places that are near to each other. So what was measured beyond
the model is a Gaussian process over places, with one width and one noise for all joints, the
likeliest of `WIDTHS` and `NOISES`. Where nothing but noise is the likeliest it is zero.

C. E. Rasmussen, C. K. I. Williams: Gaussian Processes for Machine Learning, 2006, section 2.2
(prediction) and 5.4 (marginal likelihood). The model is fitted before, and not together with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

WIDTHS: Final = tuple(np.radians([0.0, 1.5, 3.0, 5.0]))
"""How far people may be from the model, standard deviation [rad]."""

NOISES: Final = tuple(np.radians([1.0, 2.0]))
"""Of a rest's angles, standard deviation: what is not there again the next time [rad]."""

REACH: Final = 0.3
"""Places so far apart have little to do with each other [m]."""

_TURN: Final = 0.3
"""A tool's axis that is turned by a radian is so far apart [m]."""

_FLUKE: Final = 3 * WIDTHS[-1]
"""Who is further off than that did something else [rad]: it counts as not seen."""

_UNSEEN: Final = 1e3
"""Variance of a joint that was not seen [rad^2].

Of no noise: it would decide which noise is the likeliest.
"""


class Unexplained:
    """What is expected beyond the model.

    Args:
        poses: where the rests were (k, 4, 4).
        beyond: what was measured beyond the model (k, n) [rad]; NaN where a joint was not seen.
        widths: that are compared, `WIDTHS` but for controls [rad].
        noises: that are compared [rad].

    Attributes:
        width: the likeliest [rad].
    """

    def __init__(
        self,
        poses: Any,
        beyond: np.ndarray,
        widths: Sequence[float] = WIDTHS,
        noises: Sequence[float] = NOISES,
    ) -> None:
        """Find width and noise."""
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
        """Return what is expected of every joint at a place (4, 4): mean and deviation (n,) [rad].

        The deviation is that of the process with this width, noise apart: nothing of how well the
        width or the traits are known. Few rests, which the traits explain, leave a width of zero.
        """
        alike = self.width**2 * self._alike(pose)
        weights = alike @ self._inverse
        mean = np.einsum("jk,jk->j", weights, self._beyond)
        return mean, np.sqrt(np.maximum(0.0, self.width**2 - weights @ alike))

    def _alike(self, pose: Any) -> np.ndarray:
        away = np.linalg.norm(self._places - _place(pose), axis=1)
        return np.exp(-0.5 * (away / REACH) ** 2)

    def _fitted(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the log likelihood of what was measured, and the inverses (n, k, k)."""
        inverse = np.linalg.inv(covariance)
        fits = np.einsum("jk,jkl,jl->", self._beyond, inverse, self._beyond)
        volume = np.linalg.slogdet(inverse)[1].sum()
        return 0.5 * float(volume - fits), inverse


def _place(pose: Any) -> np.ndarray:
    """Return position and tool axis of a pose (4, 4), the latter as a way (6,) [m]."""
    given = np.asarray(pose, dtype=float)
    return np.concatenate([given[:3, 3], _TURN * given[:3, 0]])
