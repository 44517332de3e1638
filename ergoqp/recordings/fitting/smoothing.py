"""Joint centres that tremble from frame to frame, smoothed as far as they tremble.

Depth cameras see a wrist that rests tremble by a centimetre or two: that is 5 degrees of a forearm,
and in some frames half a band of the sheet. A recording that does not tremble is left as it is, to
the last bit.

How much a centre trembles is how far it is from the cubic through its four neighbours in time. What
it did is then the likeliest path of a point whose acceleration is white noise: the spline that
minimises squared distance over the tremble's variance plus squared acceleration over its density
(Wahba, "Spline models for observational data", SIAM 1990, section 1.3), one pentadiagonal system.
The density is that of the movement around: who hammers is smoothed less than who stands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d

from ergoqp.joints import spoken
from ergoqp.recordings.fitting.leaps import moments

_TREMBLES: Final = 0.004
"""What trembles less is left as it is [m]: a degree of a forearm."""
_LIVELY: Final = 1.0
"""Least density of people's acceleration [m^2/s^3]: 10 mm at 60 Hz are smoothed above 4.5 Hz."""
_BEND: Final = 0.1
"""Over which time it is looked at how much they bend their way [s]."""
_WHILE: Final = 0.5
"""For how long who hammers does [s]."""
_QUICK: Final = 0.02
"""Where frames are further apart [s], what moves quickly seems to tremble: no centre trembles more
than `_ALIKE` times as much as the others do."""
_ALIKE: Final = 1.5
_GAP: Final = 0.2
"""Over what is lost for longer nothing is smoothed [s]."""
_FASTEST: Final = 12.0
"""Nor over leaps that are faster [m/s]."""
_FEW: Final = 50
"""Frames that do not tell how much a centre trembles."""
_BLOCK: Final = 20_000
"""Frames that are looked at at once: more would be much memory."""


def smoothed(
    places: Mapping[str, np.ndarray], time: np.ndarray
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the centres without what they tremble, and what was done, a sentence or none.

    Args:
        places: centre -> positions (n, 3) [m], NaN where not seen.
        time: when (n,) [s], increasing.
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
    # Of the moments, the one that a frame shows.
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
        f"{len(trembling)} of {len(places)} joint centres tremble from frame to frame, most of all"
        f" the {spoken(worst)}, by {1000 * trembling[worst]:.0f} mm: they are smoothed, its"
        f" movements below {passes:.1f} Hz are kept."
    ]


def tremble_of(path: np.ndarray, time: np.ndarray) -> float:
    """Return how much a coordinate trembles, as standard deviation [m]; zero where few are seen.

    Args:
        path: positions (n, 3) [m].
        time: when (n,) [s], increasing.
    """
    if len(time) < _FEW:
        return 0.0
    starts = range(0, len(time) - 4, _BLOCK)
    blocks = [slice(start, min(start + _BLOCK + 4, len(time))) for start in starts]
    return 1.4826 * float(np.median(np.concatenate([_off(path[b], time[b]) for b in blocks])))


def _off(path: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return how far positions are from what their neighbours say (n - 4, 3) [m].

    In units of what an independent tremble of all five would do.
    """
    # Lagrange's weights of the four neighbours, at the time in the middle.
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
    """Return the likeliest positions (n, 3) [m] behind positions that tremble."""
    since = np.diff(time)
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
    linked = (since < _GAP) & (moved < np.maximum(_FASTEST * since, 8 * tremble))
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
    """Return the density of acceleration around (n,) [m^2/s^3].

    A way whose acceleration is white noise of density q bends within h to either side by
    2 / 3 q h^3 (variance), and trembling adds 6 of its own.
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
