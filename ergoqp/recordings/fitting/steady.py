"""Angles that do not show at every moment: held together over time by those moments that tell.

The turn of an upper arm about itself shows in a bent elbow only, its flexion not while it points
straight to the side. What is measured then is noise. So such an angle is taken for a random walk,
measured with an accuracy that changes: its mean given all measurements is a tridiagonal system.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg import solveh_banded

_NOISE: Final = np.radians(1.0) ** 2
"""Variance of an angle that shows at the rate of sin 45 deg [rad^2]."""
_SURE: Final = 1e-6
"""Share of that variance which an angle keeps that shows fully: it is taken as it is."""
_WANDER: Final = 1.0
"""By how much the variance of an angle grows in a second [rad^2/s]."""
_USUAL: Final = 1.0
"""Variance of an angle about zero, of which nothing is known [rad^2]."""
_FORGOTTEN: Final = 10.0
"""After how long nothing is known of an angle that was [s]."""


def steady(
    measured: np.ndarray, shows: np.ndarray, time: np.ndarray, leaps: np.ndarray | None = None
) -> np.ndarray:
    """Return the likeliest angles (n,) [rad].

    Args:
        measured: angles (n,) [rad], without leaps of a whole turn; NaN where there is none.
        shows: how much a small change of the angle turns what is measured (n,), 0 to 1.
        time: when (n,) [s], increasing.
        leaps: between which frames the angle leaps (n - 1,) bool; None: nowhere.
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
    """Return angles (n,) [rad] as measured and, where there is none (NaN), `steady` ones."""
    seen = np.isfinite(measured)
    if seen.all():
        return measured
    return np.where(seen, measured, steady(measured, seen.astype(float), time))
