"""Takes of raised arms in which the acromion's marker slides, with the true arms.

Forearms may have a carrying angle: the wrist is outside the plane in which a straight arm bends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.made_markers import plug_in_gait
from benchmarks.made_motions import BODY, RATE, posture, shoulders
from ergoqp.human import Body
from ergoqp.human.body import Marker
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap.markers.fit import places_of_markers
from ergoqp.mocap.naming import centres_of
from ergoqp.sheets.description import elevation_of

Shape = Callable[[np.ndarray], np.ndarray]
FOREARM: Final = ("FRM", "WRA", "WRB", "FIN")
"""Markers that move with the elbow's joint."""
ARM: Final = ("UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
"""Markers that move with the shoulder's joint."""
STILL: Final = 75
"""Frames of hanging arms before a movement."""
LOWEST: Final = 40.0
"""Least elevation in takes without a hanging arm [deg]."""


def ramp(elevation: np.ndarray) -> np.ndarray:
    """Return the share of the slide at elevations [deg]: whole at 120 deg and above."""
    return np.clip(elevation / 120, 0, 1)


@dataclass(frozen=True, eq=False)
class Slide:
    """What moves in the trunk when an arm is raised.

    Attributes:
        skin: how far the acromion's marker slides on the joint up, in, and ahead [m].
        rise: how far the joint moves up and in, with the whole arm [m]; this is no error.
        shape: share of `skin` at an elevation [deg].
        girdle: movement of the joint ahead, left and up that does not depend on the elevation of
            the arms, by the postures (n, 32) -> (n, 3) [m].
        noise: standard deviation of a marker's coordinate [m].
        carrying: angle by which forearms point outward along the axis of the elbow [deg].
        body: the person.
        seed: of the noise.
    """

    skin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rise: tuple[float, float] = (0.0, 0.0)
    shape: Shape = ramp
    girdle: Callable[[np.ndarray], np.ndarray] = lambda postures: np.zeros((len(postures), 3))
    noise: float = 0.0005
    carrying: float = 0.0
    body: Body = BODY
    seed: int = 1000


@dataclass(frozen=True, eq=False)
class Take:
    """Markers, and what is true.

    Attributes:
        names: of the markers.
        places: of the markers (n, m, 3) [m].
        elevation: of the right and the left upper arm (n, 2) [deg].
        joints: side -> centre of the shoulder (n, 3) [m].
        arms: side -> from there to the elbow (n, 3) [m].
    """

    names: tuple[str, ...]
    places: np.ndarray
    elevation: np.ndarray
    joints: dict[str, np.ndarray]
    arms: dict[str, np.ndarray]


def raised(name: str, elbow: float, *, hang: bool, still: int = STILL) -> np.ndarray:
    """Return postures (n, 32) [rad] of a movement, after hanging arms or without any low arm.

    Args:
        name: movement of `benchmarks.made_motions.SHOULDERS`.
        elbow: bend of the elbows [deg].
        hang: whether the arms hang first; else only frames with raised arms are kept.
        still: for how many frames they hang first.
    """
    moved = shoulders(name, elbow)
    if not hang:
        return moved[np.degrees(elevation_of(moved)[0]).min(axis=1) >= LOWEST]
    bends = {"trunk_flexion": 5.0, "neck_flexion": 4.0, "arms_elbow_flexion": elbow}
    first = posture(1, arms_shoulder_abduction=5.0, **bends)
    return np.concatenate([np.repeat(first, still, axis=0), moved])


def one_arm(postures: np.ndarray) -> np.ndarray:
    """Return the postures with a left arm that hangs."""
    found = postures.copy()
    for joint, angle in (("flexion", 3.0), ("abduction", 3.0), ("rotation", 0.0)):
        found[:, INDEX[f"left_shoulder_{joint}"]] = np.radians(angle)
    return found


def busy(postures: np.ndarray) -> np.ndarray:
    """Return the postures with a trunk that bends, and legs that walk."""
    found, time = postures.copy(), np.arange(len(postures)) / RATE
    found[:, INDEX["trunk_flexion"]] += np.radians(20) * (1 - np.cos(2 * np.pi * 0.4 * time))
    found[:, INDEX["trunk_side_bend"]] += np.radians(10) * np.sin(2 * np.pi * 0.7 * time)
    for side, turn in zip(SIDES, (0.0, np.pi), strict=True):
        phase = 2 * np.pi * 0.9 * time + turn
        found[:, INDEX[f"{side}_hip_flexion"]] = np.radians(8 + 22 * np.sin(phase))
        found[:, INDEX[f"{side}_knee_flexion"]] = np.radians(8 + 40 * np.maximum(np.cos(phase), 0))
    return found


def shrugging(postures: np.ndarray) -> np.ndarray:
    """Return shoulders that are shrugged and moved ahead, whatever the arms do (n, 3) [m]."""
    time = np.arange(len(postures)) / RATE
    ahead, up = np.sin(2 * np.pi * 0.31 * time), np.sin(2 * np.pi * 0.23 * time + 1)
    return np.column_stack([0.03 * ahead, 0 * time, 0.025 * np.maximum(up, 0)])


def slowly(postures: np.ndarray) -> np.ndarray:
    """Return shoulders that are shrugged and moved back slowly, and by more (n, 3) [m]."""
    time = np.arange(len(postures)) / RATE
    back, up = np.cos(2 * np.pi * 0.17 * time), np.sin(2 * np.pi * 0.13 * time + 2)
    return np.column_stack([-0.02 * back, 0 * time, 0.04 * np.maximum(up, 0)])


def bending(postures: np.ndarray) -> np.ndarray:
    """Return the postures with elbows that bend from 3 to 90 deg and straighten again."""
    found, time = postures.copy(), np.arange(len(postures)) / RATE
    for side in SIDES:
        bend = 3 + 87 * (1 - np.cos(2 * np.pi * 0.37 * time)) / 2
        found[:, INDEX[f"{side}_elbow_flexion"]] = np.radians(bend)
    return found


def reaching(postures: np.ndarray) -> np.ndarray:
    """Return shoulders that move ahead as the right arm is flexed (n, 3) [m]."""
    share = np.clip(postures[:, INDEX["right_shoulder_flexion"]] / (np.pi / 2), 0, 1)
    return np.column_stack([0.035 * share, 0 * share, 0 * share])


def take_of(postures: np.ndarray, slide: Slide) -> Take:
    """Return the markers of a person who walks or stands, with what slides, and the true arms."""
    body, count = slide.body, len(postures)
    way = 1.0 * np.arange(count) / RATE if np.ptp(postures[:, INDEX["right_knee_flexion"]]) else 0.0
    pelvis = np.tile([0.0, 0.0, 0.88, 0.3], (count, 1))
    pelvis[:, 0] += way
    corners = {axis: tuple(row) for axis, row in zip("oxyz", np.eye(4)[:, 1:], strict=True)}
    worn = plug_in_gait(body) | {
        name: Marker("trunk", (float(x), float(y), float(z)), 0.0)
        for name, (x, y, z) in corners.items()
    }
    beyond = -body.lengths["upper_arm"]
    worn |= {
        f"{side}_aside": Marker(f"{side}_shoulder", (0.0, out, beyond), 0.0)
        for side, out in zip(SIDES, (-1.0, 1.0), strict=True)
    }
    paths = places_of_markers(body, pelvis, postures, worn)
    origin = paths.pop("o")
    axes = np.stack([paths.pop(axis) - origin for axis in "xyz"], axis=1)
    elevation, centres = (
        np.degrees(elevation_of(postures)[0]),
        centres_of(body, pelvis, postures),
    )
    joints, arms = {}, {}
    for i, side in enumerate(SIDES):
        letter, inward = side[0].upper(), 1.0 if side == "right" else -1.0
        elbow, aside = centres[f"{side}_elbow"], paths.pop(f"{side}_aside")
        tilt = _tilted(aside - elbow, centres[f"{side}_wrist"] - elbow, slide.carrying)
        for name in FOREARM:
            paths[f"{letter}{name}"] = elbow + tilt.apply(paths[f"{letter}{name}"] - elbow)
        up, inside, ahead = slide.skin
        skin = slide.shape(elevation[:, i])[:, None] * [ahead, inward * inside, up]
        rise = ramp(elevation[:, i])[:, None] * [0.0, inward * slide.rise[1], slide.rise[0]]
        skin, rise = (
            np.einsum("nji,nj->ni", axes, each) for each in (skin, rise + slide.girdle(postures))
        )
        for name in (*ARM, "SHO"):
            paths[f"{letter}{name}"] = paths[f"{letter}{name}"] + rise
        paths[f"{letter}SHO"] = paths[f"{letter}SHO"] + skin
        arms[side] = elbow - centres[f"{side}_shoulder"]
        joints[side] = centres[f"{side}_shoulder"] + rise
    places = np.stack(list(paths.values()), axis=1)
    places += slide.noise * np.random.default_rng(slide.seed).standard_normal(places.shape)
    return Take(tuple(paths), places, elevation, joints, arms)


def _tilted(aside: np.ndarray, fore: np.ndarray, angle: float) -> Rotation:
    """Return the turns (n,) of forearms (n, 3) by an angle [deg] toward the elbows' axes (n, 3)."""
    about = np.cross(fore, aside)
    about /= np.linalg.norm(about, axis=1, keepdims=True)
    return Rotation.from_rotvec(np.radians(angle) * about)
