"""Estimation of lost markers: postures from the markers that are seen.

A few Gauss-Newton steps solve many frames at once. The joints stay within their ranges and are
weakly pulled to the posture of the first fit. A marker that is far from its place on the body
weighs less (Cauchy's loss). The standard deviation of a marker that is not seen follows from the
curvature: it is small only if nearby markers determine the marker. Lengths and offsets are inputs
of the one compiled function.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human import Body
from ergoqp.human.person_file import Marker
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.recordings.fitting.centres_of import growth_of
from ergoqp.recordings.markers.frames import SEGMENTS, SIZE, inputs, segments

_BLOCK: Final = 512
"""Frames that are solved at once; the curvatures of more would need much memory."""
_SKIN: Final = 0.01
"""Least standard deviation of a marker on the skin [m]."""
_ANEW: Final = 1.5
"""Factor on a marker's residual for its own error where it is not seen: the fit follows the markers
that are seen, and in a new posture the skin moves otherwise."""
_FAR: Final = (0.3, 0.3, 0.15, 0.08, 0.03, 0.03)
"""Distance at which a marker weighs half [m], per round: a limb may start far from its place."""
_DRAWN: Final = np.array([0.2, 0.2, 0.2, 0.5, *np.full(len(JOINTS), 0.35)])
"""Standard deviation of the posture from the one it is pulled to: position [m], angles [rad]."""


def told_markers(
    body: Body,
    start: np.ndarray,
    markers: Mapping[str, np.ndarray],
    sits: Mapping[str, Marker],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return estimated positions of markers from those that are seen, and standard deviations.

    Args:
        body: the person.
        start: pelvis and posture to start from and to be pulled to (n, 36).
        markers: name -> positions (n, 3) [m]; NaN where not seen.
        sits: name -> place on the body.

    Returns:
        Name -> positions (n, 3) [m], and name -> standard deviation (n,) [m], of every marker.
    """
    names = [name for name in markers if np.isfinite(sits[name].residual)]
    frames = np.array([SEGMENTS.index(sits[name].frame) for name in names])
    offsets = np.array([sits[name].offset for name in names])
    residuals = np.array([sits[name].residual for name in names])
    exact, anew = np.maximum(residuals, _SKIN), np.maximum(_ANEW * residuals, _SKIN)
    growth = growth_of(body)
    places, spread = [], []
    for at in range(0, len(start), _BLOCK):
        rows = slice(at, at + _BLOCK)
        seen = np.stack([markers[name][rows] for name in names], axis=1)
        place, sure = _solved(start[rows], growth, seen, frames, offsets, exact)
        places.append(place)
        spread.append(np.sqrt(sure**2 + anew**2))
    place, sure = np.concatenate(places), np.concatenate(spread)
    return (
        {name: place[:, i] for i, name in enumerate(names)},
        {name: sure[:, i] for i, name in enumerate(names)},
    )


def _solved(
    start: np.ndarray,
    growth: np.ndarray,
    seen: np.ndarray,
    frames: np.ndarray,
    offsets: np.ndarray,
    exact: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return estimated positions of markers (n, m, 3) and their standard deviations (n, m) [m]."""
    z = start.copy()
    lower = np.concatenate([np.full(4, -np.inf), LOWER])
    upper = np.concatenate([np.full(4, np.inf), UPPER])
    drawn = 1 / _DRAWN**2
    for half in _FAR:
        place, slope = _placed(z, growth, frames, offsets)
        curved, pull = _normal(place, slope, seen, exact, half)
        pull += drawn * (start - z)
        step = np.linalg.solve(curved + np.diag(drawn), pull[:, :, None])[:, :, 0]
        z = np.clip(z + np.clip(step, -0.5, 0.5), lower, upper)
    place, slope = _placed(z, growth, frames, offsets)
    curved, _ = _normal(place, slope, seen, exact, _FAR[-1])
    unsure = np.linalg.inv(curved + np.diag(drawn))
    flat = slope.reshape(len(z), -1, SIZE)
    spread = ((flat @ unsure) * flat).sum(axis=2).reshape(*seen.shape[:2], 3).sum(axis=2)
    return place, np.sqrt(np.maximum(spread, 0.0))


def _normal(
    place: np.ndarray, slope: np.ndarray, seen: np.ndarray, exact: np.ndarray, half: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the Hessian (n, 36, 36) and the negative gradient (n, 36) for the seen markers."""
    there = np.asarray(np.isfinite(seen).all(axis=2))
    miss = np.where(there[:, :, None], seen - place, 0.0)
    far = np.linalg.norm(miss, axis=2)
    weight = there / exact**2 / (1 + (far / np.maximum(half, 3 * exact)) ** 2)
    root = np.sqrt(weight)[:, :, None]
    rows = (root[..., None] * slope).reshape(len(place), -1, SIZE)
    across = np.swapaxes(rows, 1, 2)
    return across @ rows, (across @ (root * miss).reshape(len(place), -1, 1))[:, :, 0]


def _placed(
    z: np.ndarray, growth: np.ndarray, frames: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return markers (n, m, 3) [m] and their Jacobians by pelvis and posture (n, m, 3, 36)."""
    values = _values(z, growth).reshape(len(z), len(SEGMENTS), -1)[:, frames]
    origin, turn = values[:, :, :3], values[:, :, 3:12].reshape(*values.shape[:2], 3, 3)
    moved = values[:, :, 12:].reshape(*values.shape[:2], SIZE, 6)
    # CasADi's matrices are stored by columns.
    arm = np.einsum("nmji,mj->nmi", turn, offsets)
    about = np.cross(moved[..., 3:], arm[:, :, None])
    return origin + arm, np.swapaxes(moved[..., :3] + about, 2, 3)


def _values(z: np.ndarray, growth: np.ndarray) -> np.ndarray:
    """Return the values of the compiled function, one row per frame."""
    function = _function()
    given = np.zeros((_BLOCK, SIZE))
    given[: len(z)] = z
    lengths = np.tile(growth, (_BLOCK, 1))
    found = np.empty((_BLOCK, function.size1_out(0)))
    # The results go into NumPy's memory, because CasADi's matrices would take most of the time.
    # CasADi's stubs ask for a length, which these methods do not take.
    buffer, evaluate = function.buffer()
    for i, array in enumerate((given, lengths)):
        buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
    buffer.set_res(0, found.data)  # pyright: ignore[reportCallIssue]
    evaluate()
    return found[: len(z)]


@cache
def _function() -> ca.Function:
    """Return a function: pelvis and posture, growth -> position, axes and Jacobian of segments."""
    given = inputs()
    rows = [ca.vec(part) for parts in segments(*given) for part in parts]
    one = ca.Function("segments", given, [ca.densify(ca.cse(ca.vertcat(*rows)))])
    return one.map(_BLOCK)
