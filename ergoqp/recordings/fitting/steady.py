"""Interpolation of angles that are not determined at every moment.

The rotation of an upper arm is determined only while the elbow is bent, and its flexion is not
determined while the arm points straight to the side. The measured value is then noise. Such an
angle is modelled as a random walk that is measured with a varying accuracy. Its mean given all
measurements is the solution of a tridiagonal system.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg import solveh_banded

_NOISE: Final = np.radians(1.0) ** 2
"""Variance of a measured angle whose `shows` is sin 45 deg [rad^2]."""
_SURE: Final = 1e-6
"""Share of that variance that a fully determined angle has: it is practically kept as measured."""
_WANDER: Final = 1.0
"""Growth of an angle's variance per second [rad^2/s]."""
_USUAL: Final = 1.0
"""Variance about zero of an angle of which nothing is known [rad^2]."""
_FORGOTTEN: Final = 10.0
"""Time after which nothing is known of an earlier angle [s]."""


def steady(
    measured: np.ndarray, shows: np.ndarray, time: np.ndarray, leaps: np.ndarray | None = None
) -> np.ndarray:
    """Return the likeliest angles (n,) [rad].

    Args:
        measured: angles (n,) [rad], unwrapped; NaN where there is none.
        shows: how much a small change of the angle turns the measured bone (n,), 0 to 1.
        time: times of the frames (n,) [s], increasing.
        leaps: steps between frames in which the angle may jump (n - 1,) bool; None: nowhere.
    """
    seen = np.isfinite(measured) & (shows > 0)
    weight = np.where(seen, shows**2 / np.maximum(1 - shows**2, _SURE), 0.0)
    known = np.where(seen, measured, 0.0)
    if not seen.any():
        return known
    since = np.diff(time)
    links = _NOISE / (_WANDER * since)
    if leaps is not None:
        links = np.where(leaps, 0.0, links)
    unknown = np.minimum(np.concatenate([since, [_FORGOTTEN]]) / _FORGOTTEN, 1.0)
    diagonal = weight + _NOISE / _USUAL * unknown
    diagonal[:-1] += links
    diagonal[1:] += links
    if len(time) == 1:
        return weight * known / diagonal
    banded = np.stack([np.concatenate([[0.0], -links]), diagonal])
    return solveh_banded(banded, weight * known, check_finite=False)


def filled(measured: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles (n,) [rad] as measured, with those of `steady` where there is none (NaN)."""
    seen = np.isfinite(measured)
    if seen.all():
        return measured
    return np.where(seen, measured, steady(measured, seen.astype(float), time))
