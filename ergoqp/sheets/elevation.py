"""Elevation of an arm: how far it is raised, whichever way its joints reach the direction.

Flexion and abduction of a shoulder describe some directions in two ways. Flexion 0 with
abduction 170 is 10 degrees away from flexion 170 with abduction 10, but a sheet that reads
flexion scores them 2 and 4. The elevation is the angle between the upper arm and the downward
axis of the trunk. Its plane is the direction in which the arm points: 0 degrees to the side,
90 forward, -90 backward (Wu et al., ISB recommendation on definitions of joint coordinate
systems, part II, Journal of Biomechanics 38 (2005), 981-992).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ergoqp.joints import INDEX, SIDES

_ROWS = [(INDEX[f"{side}_shoulder_flexion"], INDEX[f"{side}_shoulder_abduction"]) for side in SIDES]


def elevation_of(postures: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return elevation and plane of the right and the left upper arm, each (n, 2) [rad].

    The plane of an arm that hangs or points straight up is 0.

    Args:
        postures: joint angles (n, 32) [rad].
    """
    found = [_raised(postures[:, flexion], postures[:, abduction]) for flexion, abduction in _ROWS]
    elevations, planes, _ = zip(*found, strict=True)
    return np.stack(elevations, axis=1), np.stack(planes, axis=1)


def by_elevation(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return joint angles (32, n) [rad] for a sheet that scores the direction of the arms.

    The flexion of the shoulder is replaced by the elevation, which is negative if the arm
    points backward more than to the side. The abduction is replaced by the angle between the
    arm and the sagittal plane.

    Args:
        angles: one row per joint (32, n) [rad].
    """
    read = angles.copy()
    for flexion, abduction in _ROWS:
        elevation, plane, aside = _raised(angles[flexion], angles[abduction])
        behind = (plane < -np.pi / 4) & (plane > -3 * np.pi / 4)
        read[flexion] = np.where(behind, -elevation, elevation)
        read[abduction] = aside
    return read


def _raised(
    flexion: NDArray[np.float64], abduction: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return elevation, plane, and the angle to the sagittal plane (n,) [rad]."""
    forward, out = np.sin(flexion) * np.cos(abduction), np.sin(abduction)
    down = np.cos(flexion) * np.cos(abduction)
    aside = np.hypot(forward, out)
    plane = np.where(aside > 1e-9, np.arctan2(forward, out), 0.0)
    return np.arctan2(aside, down), plane, np.arcsin(np.clip(out, -1.0, 1.0))
