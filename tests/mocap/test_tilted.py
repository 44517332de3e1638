"""Cameras that are tilted: found by whoever stands upright, with little of them seen; else said."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_motions import Places, fitted, stoop
from ergoqp.joints import INDEX
from ergoqp.mocap import Recording

TRUNK = INDEX["trunk_flexion"]
UNSURE = "Whether the camera is tilted against that axis is not checked"
TURN = Rotation.from_rotvec(np.radians([9.0, 25.0, 0.0])).as_matrix()


def seen(*gone: str) -> tuple[Recording, Recording]:
    """The same stoop by a straight camera and by a tilted one, without some centres."""
    places = {name: path for name, path in stoop()[0].items() if name not in gone}
    tilted: Places = {name: path @ TURN.T for name, path in places.items()}
    return fitted(places, up=None), fitted(tilted, up=None)


@pytest.mark.parametrize(
    "gone",
    [
        (),
        ("left_ankle", "left_toe"),
        ("left_ankle", "left_toe", "left_knee", "left_hip"),
        ("pelvis",),
        ("neck",),
    ],
)
def test_a_tilt_is_found_by_what_is_seen(gone: tuple[str, ...]) -> None:
    straight, tilted = seen(*gone)
    said = " ".join(tilted.assumptions)
    assert "The camera is taken to be tilted by 2" in said
    assert UNSURE not in said
    off = np.degrees(np.abs(tilted.postures - straight.postures))[:, TRUNK]
    assert off.max() < (3 if "left_hip" not in gone else 6)


@pytest.mark.parametrize("gone", [("ankle",), ("knee", "ankle", "toe")])
def test_without_feet_nobody_knows(gone: tuple[str, ...]) -> None:
    straight, tilted = seen(*(f"{side}_{name}" for side in ("right", "left") for name in gone))
    assert UNSURE in " ".join(tilted.assumptions)
    assert UNSURE in " ".join(straight.assumptions)
    off = np.degrees(np.abs(tilted.postures - straight.postures))[:, TRUNK]
    assert np.median(off) > 15  # which is why it is said


def test_what_is_stated_is_not_doubted() -> None:
    assert UNSURE not in " ".join(fitted(stoop()[0]).assumptions)
