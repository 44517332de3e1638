"""Smoothing of joint centres that jitter from frame to frame, as far as they jitter.

In recordings by depth cameras, a wrist at rest jitters by a centimetre or two. That is 5 degrees of
a forearm, and in some frames half a band of the sheet. A recording without jitter is left
unchanged, to the last bit.

The jitter of a centre is its distance from the cubic through its four neighbours in time. The
smoothed path is the likeliest path of a point whose acceleration is white noise: the spline that
minimises squared distance over the jitter's variance plus squared acceleration over its density
(Wahba, "Spline models for observational data", SIAM 1990, section 1.3), one pentadiagonal system.
The density is that of the movement around: hammering is smoothed less than standing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d

from ergoqp.joints import spoken
from ergoqp.mocap.fitting.unknown import FASTEST
from ergoqp.mocap.fitting.validity import moments

_TREMBLES: Final = 0.004
"""Largest jitter that is not smoothed [m]: a degree of a forearm."""
_LIVELY: Final = 1.0
"""Least density of people's acceleration [m^2/s^3]: 10 mm at 60 Hz are smoothed above 4.5 Hz."""
_BEND: Final = 0.1
"""Time to either side over which the bend of a path is measured [s]."""
_WHILE: Final = 0.5
"""Time to either side over which the density of acceleration is averaged [s]."""
_QUICK: Final = 0.02
"""Frame time above which quick movement looks like jitter [s]: no centre's jitter is then taken as
more than `_ALIKE` times the median of all."""
_ALIKE: Final = 1.5
_GAP: Final = 0.2
"""Longest gap across which a path is smoothed [s]."""
_FEW: Final = 50
"""Number of frames from which the jitter of a centre can be measured."""
_BLOCK: Final = 20_000
"""Frames that are evaluated at once, to save memory."""


def smoothed(
    places: Mapping[str, np.ndarray], time: np.ndarray
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the smoothed centres, and a sentence about it, or none if nothing was smoothed.

    Args:
        places: centre -> positions (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s], increasing.
    """
    found, trembling, new = dict(places), {}, moments(places)
    if new.sum() < _FEW:
        return found, []
    seen = {centre: new & np.isfinite(path).all(axis=1) for centre, path in places.items()}
    trembles = {
        centre: tremble_of(path[seen[centre]], time[seen[centre]])
        for centre, path in places.items()
    }
    if np.median(np.diff(time[new])) > _QUICK:
        most = _ALIKE * float(np.median(list(trembles.values())))
        trembles = {centre: min(tremble, most) for centre, tremble in trembles.items()}
    # A repeated frame shows the position of the last new one.
    shown = np.cumsum(new) - 1
    for centre, tremble in trembles.items():
        if tremble > _TREMBLES:
            trembling[centre], rows = tremble, seen[centre]
            path = places[centre].copy()
            path[rows] = _spline(path[rows].astype(float), time[rows], tremble)
            found[centre] = path[new][shown]
    if not trembling:
        return found, []
    worst = max(trembling, key=lambda centre: trembling[centre])
    step = float(np.median(np.diff(time[new])))
    passes = (_LIVELY / (trembling[worst] ** 2 * step)) ** 0.25 / (2 * math.pi)
    return found, [
        f"{len(trembling)} of {len(places)} joint centres jitter from frame to frame, most of all"
        f" the {spoken(worst)}, by {1000 * trembling[worst]:.0f} mm: they are smoothed, and"
        f" movements of that centre below {passes:.1f} Hz are kept."
    ]


def tremble_of(path: np.ndarray, time: np.ndarray) -> float:
    """Return the standard deviation of a coordinate's jitter [m]; zero for too few frames.

    Args:
        path: positions (n, 3) [m].
        time: times of the frames (n,) [s], increasing.
    """
    if len(time) < _FEW:
        return 0.0
    starts = range(0, len(time) - 4, _BLOCK)
    blocks = [slice(start, min(start + _BLOCK + 4, len(time))) for start in starts]
    return 1.4826 * float(np.median(np.concatenate([_off(path[b], time[b]) for b in blocks])))


def _off(path: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the distance of positions from the cubic through their neighbours (n - 4, 3) [m].

    It is scaled so that independent jitter of all five has its own standard deviation.
    """
    # Lagrange weights of the four neighbours, at the time in the middle.
    around = np.stack([time[:-4], time[1:-3], time[3:-1], time[4:]])
    middle = time[2:-2]
    weights = np.ones_like(around)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (middle - around[j]) / (around[i] - around[j])
    paths = np.stack([path[:-4], path[1:-3], path[3:-1], path[4:]])
    off = path[2:-2] - (weights[:, :, None] * paths).sum(axis=0)
    return np.abs(off) / np.sqrt(1 + (weights**2).sum(axis=0))[:, None]


def _spline(path: np.ndarray, time: np.ndarray, tremble: float) -> np.ndarray:
    """Return the likeliest positions (n, 3) [m] for measured positions that jitter."""
    since = np.diff(time)
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
    linked = (since < _GAP) & (moved < np.maximum(FASTEST * since, 8 * tremble))
    before, after = since[:-1], since[1:]
    both = before + after
    bend = np.stack([2 / (before * both), -2 / (before * after), 2 / (after * both)])
    lively = _density(path, time, linked, tremble)[1:-1]
    size = np.where(linked[:-1] & linked[1:], both / 2 * tremble**2 / lively, 0.0)
    banded = np.zeros((3, len(time)))
    banded[2] = 1.0
    for i in range(3):
        for j in range(i, 3):
            term = size * bend[i] * bend[j]
            banded[2 - (j - i), j : len(time) - 2 + j] += term
    return solveh_banded(banded, path, check_finite=False)


def _density(path: np.ndarray, time: np.ndarray, linked: np.ndarray, tremble: float) -> np.ndarray:
    """Return the density of the acceleration around each frame (n,) [m^2/s^3].

    If the acceleration is white noise of density q, the second difference of the path over h to
    either side has the variance 2 / 3 q h^3. Jitter adds 6 times its own variance.
    """
    step = float(np.median(np.diff(time)))
    lag, around = max(1, round(_BEND / step)), max(1, round(_WHILE / step))
    if len(time) <= 2 * lag:
        return np.full(len(time), _LIVELY)
    bend = path[2 * lag :] - 2 * path[lag:-lag] + path[: -2 * lag]
    cuts = np.concatenate([[0], np.cumsum(~linked)])
    whole = np.pad((cuts[2 * lag :] == cuts[: -2 * lag]).astype(float), lag)
    square = whole * np.pad((bend**2).mean(axis=1), lag)
    told, count = (
        uniform_filter1d(each, 2 * around + 1, mode="constant") for each in (square, whole)
    )
    mean = told / np.maximum(count, 1e-6)
    return np.maximum(_LIVELY, (mean - 6 * tremble**2) / (2 / 3 * (lag * step) ** 3))
