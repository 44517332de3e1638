"""Markers that are lost for a while, put where the others have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.human import Body
from ergoqp.human.marker import Marker
from ergoqp.recordings.markers.gauss_newton import told_markers
from ergoqp.recordings.motion import JointMotion

_LEAST: Final = 10
"""Markers that must be seen in a frame."""
_SURE: Final = 0.025
"""A place whose standard deviation is larger is not told [m]: it would turn a bone by some 5
degrees. Of real takes, no gap that is told is farther off (`benchmarks.recording_told`)."""
_STEADY: Final = 0.03
"""A marker that usually is farther from where it sits is not followed [m]."""
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
    """Return the motion with lost markers where the others tell them; None if they tell none.

    Args:
        motion: the markers, in the file's unit and axes.
        sits: used marker -> where it sits on the body.
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4), as a fit without these markers has it.
        postures: likewise (n, 32) [rad].
        axes: from the file's unit and axes to metres along ours (3, 3).
        along: marker -> by how much the fitted person is elsewhere (n, 3) [m], if at all: of a
            skeleton that leans all above the hips is put where it would be upright.
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
        f"In {int(told.sum())} of {len(told)} frames markers are lost that the others tell to"
        f" {100 * _SURE:g} cm: they are put there ({count} places)."
    )
    return replace(motion, positions=positions, notes=(*motion.notes, said))
