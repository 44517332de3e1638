"""Estimation of markers that are lost for a while, from the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.human import Body
from ergoqp.human.person_file import Marker
from ergoqp.recordings.markers.gauss_newton import told_markers
from ergoqp.recordings.motion import JointMotion

_LEAST: Final = 10
"""Least number of markers that are seen in a frame."""
_SURE: Final = 0.025
"""Largest standard deviation of an estimate that is used [m]; such an error turns a bone by about 5
degrees. In real takes, no gap that was filled has a larger error (`benchmarks.recording_told`)."""
_STEADY: Final = 0.03
"""Largest residual of a marker that is used and estimated [m]."""
_BLOCK: Final = 4096


def has_gaps(motion: JointMotion, used: Mapping[str, str]) -> bool:
    """Return whether a used marker that is seen at all is lost in some frame."""
    for name in used:
        seen = np.isfinite(motion.of(name)[:, 0])
        if seen.any() and not seen.all():
            return True
    return False


def completed(
    motion: JointMotion,
    sits: Mapping[str, Marker],
    body: Body,
    pelvis: np.ndarray,
    postures: np.ndarray,
    axes: np.ndarray,
    along: Mapping[str, np.ndarray],
) -> JointMotion | None:
    """Return the motion with lost markers as estimated from the others; None if none is.

    Args:
        motion: the markers, in the file's unit and axes.
        sits: used marker -> its place on the body.
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4), from a fit without the lost markers.
        postures: joint angles from the same fit (n, 32) [rad].
        axes: from the file's unit and axes to metres along ours (3, 3).
        along: marker -> shift of the fitted person against the recording (n, 3) [m], if any:
            everything above the hips is shifted if the skeleton leans and is straightened.
    """
    sits = {name: each for name, each in sits.items() if each.residual < _STEADY}
    if len(sits) < _LEAST:
        return None
    places = [motion.names.index(name) for name in sits]
    seen = np.isfinite(motion.positions[:, places, 0])
    gaps = np.flatnonzero(~seen.all(axis=1) & (seen.sum(axis=1) >= _LEAST))
    if not len(gaps):
        return None
    away = {name: along.get(name, np.zeros((len(motion.time), 1))) for name in sits}
    positions, back = motion.positions.copy(), np.linalg.inv(axes).T
    count, told = 0, np.zeros(len(motion.time), dtype=bool)
    for at in range(0, len(gaps), _BLOCK):
        rows = gaps[at : at + _BLOCK]
        markers = {
            name: motion.positions[rows, i].astype(float) @ axes.T + away[name][rows]
            for name, i in zip(sits, places, strict=True)
        }
        start = np.hstack([pelvis[rows], postures[rows]])
        found, spread = told_markers(body, start, markers, sits)
        for name, i in zip(sits, places, strict=True):
            put = np.isnan(markers[name][:, 0]) & (spread[name] < _SURE)
            positions[rows[put], i] = (found[name] - away[name][rows])[put] @ back
            count += int(put.sum())
            told[rows[put]] = True
    if not count:
        return None
    said = (
        f"In {int(told.sum())} of {len(told)} frames lost markers are estimated from the others,"
        f" with a standard deviation below {100 * _SURE:g} cm ({count} places)."
    )
    return replace(motion, positions=positions, notes=(*motion.notes, said))
