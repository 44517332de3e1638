"""Where nose, knuckles and thumbs are by the orientations of segments, and what angles come out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.naming import Naming, centres_of, known_namings, naming_of
from ergoqp.mocap.recording import JointMotion
from ergoqp.mocap.unseen import AHEAD, oriented

BODY = Body.of_stature(1.72)
COUNT = 90
NAMINGS = {naming.title: naming for naming in known_namings()}
MVN, MOTIVE = NAMINGS["Xsens MVN"], NAMINGS["Motive"]
QUARTER = {
    "Head": Rotation.identity(),
    "RightHand": Rotation.from_euler("z", 90, degrees=True),
    "LeftHand": Rotation.from_euler("z", -90, degrees=True),
}
"""How Xsens' axes lie in our segments: where the palms look ahead they are those of the world."""


def moved() -> tuple[np.ndarray, np.ndarray]:
    """Return pelvis (n, 4) and postures (n, 32) of somebody who turns head and forearms."""
    phase = 2 * np.pi * np.arange(COUNT) / COUNT
    angles = {
        "trunk_flexion": 10 + 10 * np.sin(phase),
        "trunk_twist": 15 * np.sin(phase + 0.7),
        "neck_flexion": 12 * np.sin(2 * phase),
        "neck_side_bend": 8 * np.sin(phase + 0.5),
        "neck_twist": 50 * np.sin(phase + 1.0),
    }
    for side, late in zip(SIDES, (0.0, 1.3), strict=True):
        angles |= {
            f"{side}_shoulder_flexion": 30 + 25 * np.sin(phase + late),
            f"{side}_shoulder_abduction": 20 + 10 * np.cos(phase + late),
            f"{side}_shoulder_rotation": 20 * np.sin(phase + late),
            f"{side}_elbow_flexion": 80 + 30 * np.sin(phase),
            f"{side}_forearm_pronation": 55 * np.sin(phase + 2 * late + 0.3),
            f"{side}_wrist_flexion": 25 * np.cos(phase + late),
            f"{side}_wrist_deviation": 8 * np.sin(phase),
            f"{side}_hip_flexion": 10 + 5 * np.sin(phase),
            f"{side}_knee_flexion": 15 + 5 * np.sin(phase),
        }
    postures = np.zeros((COUNT, 32))
    for name, path in angles.items():
        postures[:, INDEX[name]] = np.radians(path)
    walked = np.column_stack([np.arange(COUNT) / 60, 0 * phase, 0 * phase + 0.9, 0.3 + 0.4 * phase])
    return walked, postures


def turned(frame: str, pelvis: np.ndarray, postures: np.ndarray) -> Rotation:
    """Return the turns of a frame in the world."""
    at = Kinematics(BODY).at
    own = Rotation.from_matrix([np.array(at(frame, ca.DM(posture))[1]) for posture in postures])
    return Rotation.from_euler("z", pelvis[:, 3:]) * own


def made(
    naming: Naming, axes: Mapping[str, Rotation], unit: float = 1.0, up: str = "z"
) -> tuple[JointMotion, np.ndarray]:
    """Return a recording of `moved` with these names, and its postures.

    Args:
        naming: how its joints are called.
        axes: segment -> how its axes lie in ours; what is not there has no orientation.
        unit: of length [m].
        up: its vertical axis: z or y.
    """
    pelvis, postures = moved()
    centres = centres_of(BODY, pelvis, postures)
    theirs = {name: theirs[0] for name, theirs in naming.centres.items() if name in centres}
    tilt = Rotation.identity() if up == "z" else Rotation.from_euler("x", -90, degrees=True)
    own = {segment: centre for centre, segment in theirs.items()}
    places = np.stack([tilt.apply(centres[name]) for name in theirs], axis=1)
    turns = {
        segment: (tilt * turned(own[segment], pelvis, postures) * axis).as_quat()
        for segment, axis in axes.items()
    }
    motion = JointMotion(
        tuple(theirs.values()),
        (places / unit).astype(np.float32),
        np.arange(COUNT) / 60,
        turns=turns,
        unit=unit,
        up=up,
    )
    return motion, postures


def angles_off(motion: JointMotion, postures: np.ndarray, joint: str) -> float:
    """Return by how much an angle is off that was read from a recording, at most [deg]."""
    recording = recording_of(motion, "take", ReadOptions(body=BODY, neutral="vertical"))
    assert recording.observed[:, INDEX[joint]].all()
    off = recording.postures[:, INDEX[joint]] - postures[:, INDEX[joint]]
    return float(np.degrees(np.abs(off)).max())


@pytest.mark.parametrize(("unit", "up"), [(1.0, "z"), (0.001, "y")])
def test_head_and_forearms_are_turned_as_xsens_has_them(unit: float, up: str) -> None:
    motion, postures = made(MVN, QUARTER, unit, up)
    recording = recording_of(motion, "take", ReadOptions(body=BODY, neutral="vertical"))
    for joint in ("neck_twist", *(f"{side}_forearm_pronation" for side in SIDES)):
        assert recording.observed[:, INDEX[joint]].all()
        off = recording.postures[:, INDEX[joint]] - postures[:, INDEX[joint]]
        assert np.degrees(np.abs(off)).max() < 1, joint
    for side in SIDES:
        for joint in ("flexion", "deviation"):
            at = INDEX[f"{side}_wrist_{joint}"]
            assert np.degrees(np.abs(recording.postures[:, at] - postures[:, at])).max() < 3
    assert AHEAD not in recording.assumptions
    # Without orientations nothing tells them.
    bare = recording_of(
        replace(motion, turns={}), "take", ReadOptions(body=BODY, neutral="vertical")
    )
    assert not bare.observed[:, INDEX["neck_twist"]].any()
    assert not bare.observed[:, INDEX["right_forearm_pronation"]].any()


def test_names_are_found_as_joints_are() -> None:
    motion, _ = made(MVN, QUARTER)
    naming, found = naming_of(motion, None, "take")
    expected, said = oriented(motion, naming, found)
    assert said == ()
    assert set(expected) == set(MVN.turned)
    for written in ("Xsens:{}", "skeleton_{}", "{}"):
        names = {name: written.format(name.upper()) for name in motion.names}
        other = motion.joints(names)
        points, _ = oriented(other, *naming_of(other, None, "take"))
        assert set(points) == set(expected)
        for centre, path in points.items():
            np.testing.assert_array_equal(path, expected[centre])


def test_points_are_where_the_body_has_them() -> None:
    motion, postures = made(MVN, QUARTER)
    pelvis, at = moved()[0], Kinematics(BODY).at
    points, _ = oriented(motion, *naming_of(motion, None, "take"))
    yaw = Rotation.from_euler("z", pelvis[:, 3:])
    for centre, path in points.items():
        place = [np.array(at(centre, ca.DM(posture))[0]).ravel() for posture in postures]
        place = yaw.apply(place) + pelvis[:, :3]
        joint = "head" if centre in ("nose", "head_top") else f"{centre.split('_')[0]}_wrist"
        here = motion.of(MVN.centres[joint][0])
        along = turned(joint, pelvis, postures).inv().apply(path - here)
        theirs = turned(joint, pelvis, postures).inv().apply(place - here)
        if centre == "nose":
            along, theirs = along[:, :2], theirs[:, :2]  # ahead: it is no higher than the head
        elif centre.endswith("thumb"):
            along, theirs = along[:, :2], theirs[:, :2]  # beside the hand
        along, theirs = (
            each / np.linalg.norm(each, axis=1, keepdims=True) for each in (along, theirs)
        )
        assert np.degrees(np.arccos(np.clip((along * theirs).sum(axis=1), -1, 1))).max() < 1, centre


@pytest.mark.parametrize("seed", range(3))
def test_a_head_whose_axes_nobody_knows_looks_ahead_mostly(seed: int) -> None:
    axes = Rotation.from_rotvec(2 * np.random.default_rng(seed).normal(size=3))
    motion, postures = made(MOTIVE, {"Head": axes})
    points, said = oriented(motion, *naming_of(motion, None, "take"))
    assert said == (AHEAD,)
    assert set(points) == {"nose"}
    assert angles_off(motion, postures, "neck_twist") < 6  # of 50: the median is not quite zero
    # Without the trunk's turn and the nods it is.
    away = turned("head", *moved()).inv().apply(points["nose"] - motion.of("Head"))
    assert np.ptp(away, axis=0).max() < 1e-5
    level = away / np.linalg.norm(away, axis=1, keepdims=True)
    assert level[0, 0] > np.cos(np.radians(12))


def broken(motion: JointMotion, name: str) -> JointMotion:
    positions, turns = motion.positions.copy(), {n: t.copy() for n, t in motion.turns.items()}
    names = motion.names
    if name == "turns are lost in some frames":
        for turn in turns.values():
            turn[10:20], turn[30, 1] = np.nan, np.nan
    elif name == "turns are lost":
        turns = {n: np.full_like(turn, np.nan) for n, turn in turns.items()}
    elif name == "turns are zero":
        turns = {n: 1e-200 * turn for n, turn in turns.items()}
    elif name == "no head":
        positions[:, names.index("Head")] = np.nan
    elif name == "no hips":
        positions[:, 0] = np.nan
    elif name == "no shoulder":
        positions[:, [i for i, n in enumerate(names) if "U" in n]] = np.nan
    elif name == "nothing":
        positions[:] = np.nan
    elif name == "one place":
        positions[:] = 1
    elif name == "one frame":
        return replace(motion, turns=turns, positions=positions).at(np.arange(COUNT) == 3)
    return replace(motion, positions=positions, turns=turns)


@pytest.mark.parametrize("naming", [MVN, MOTIVE])
@pytest.mark.parametrize(
    "name",
    [
        "turns are lost in some frames",
        "turns are lost",
        "turns are zero",
        "no head",
        "no hips",
        "no shoulder",
        "nothing",
        "one place",
        "one frame",
    ],
)
def test_what_is_lost(naming: Naming, name: str) -> None:
    whole, _ = made(naming, QUARTER if naming is MVN else {"Head": QUARTER["RightHand"]})
    motion = broken(whole, name)
    points, _ = oriented(motion, *naming_of(motion, None, "take"))
    for path in points.values():
        assert path.shape == (len(motion.time), 3)
        assert not np.isinf(path).any()
    if name == "turns are lost in some frames":
        lost = np.zeros(COUNT, dtype=bool)
        lost[10:20], lost[30] = True, True
        np.testing.assert_array_equal(np.isnan(points["nose"][:, 0]), lost)
    elif name in ("turns are lost", "turns are zero", "no head", "nothing"):
        assert all(np.isnan(points[n]).all() for n in points if n in ("nose", "head_top"))


def test_what_a_joint_shows_is_its() -> None:
    motion, _ = made(MVN, QUARTER)
    nose = replace(motion, names=(*motion.names[:-1], "nose"))
    found = {**MVN.found_in(nose.names), "nose": (len(nose.names) - 1,)}
    assert "nose" not in oriented(nose, MVN, found)[0]
    assert oriented(replace(motion, turns={}), MVN, MVN.found_in(motion.names)) == ({}, ())


def test_hips_without_a_pelvis() -> None:
    motion, _ = made(MVN, QUARTER)
    expected, _ = oriented(motion, MVN, MVN.found_in(motion.names))
    found = {name: each for name, each in MVN.found_in(motion.names).items() if name != "pelvis"}
    points, _ = oriented(motion, MVN, found)
    for centre, path in points.items():
        np.testing.assert_allclose(path, expected[centre], atol=1e-6)
