"""Angles that are measured from a part of the body whose own angle is not known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_motions import RATE, Places, fitted, posture
from benchmarks.recording_intervals import whole
from ergoqp import reba
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.mocap import Recording
from ergoqp.mocap.fitting.coupled import TWIST, by_pronation, by_rotation, by_twist
from ergoqp.mocap.fitting.unknown import spans_of

COUNT = 300
TIME = np.arange(COUNT) / RATE
STANDS = np.tile([0.0, 0.0, 0.9, 0.0], (COUNT, 1))
ARMS = {"arms_elbow_flexion": 80.0, "arms_shoulder_flexion": 40.0, "arms_shoulder_abduction": 15.0}


def swing(least: float, most: float, seconds: float = 2.5) -> np.ndarray:
    return least + (most - least) * (1 - np.cos(2 * np.pi * TIME / seconds)) / 2


def without(places: Places, *names: str, rows: slice = slice(None)) -> Recording:
    """Read the centres without some."""
    for name in names:
        places[name][rows] = np.nan
    return fitted(places, neutral="vertical")


def assert_holds(recording: Recording, truth: np.ndarray, slack: float = 0.5) -> None:
    """The truth is between the ends of every angle, and some degrees, and of the score."""
    beyond = np.maximum(recording.low - truth, truth - recording.high)[recording.scored]
    worst = np.degrees(beyond.max(axis=0))
    assert worst.max() < slack, (JOINTS[int(worst.argmax())], worst.max())
    right = reba.assess(truth).final
    found = reba.assess(recording.postures, low=recording.low, high=recording.high)
    assert ((found.final_low <= right) & (right <= found.final_high))[recording.scored].all()


@pytest.mark.parametrize("lost", SIDES)
def test_without_a_shoulder_the_trunk_may_be_twisted(lost: str) -> None:
    truth = posture(
        COUNT, trunk_twist=swing(-35, 35), trunk_flexion=10.0, neck_flexion=15.0, **ARMS
    )
    recording = without(whole(STANDS, truth), f"{lost}_shoulder")
    assert recording.scored.all()
    assert_holds(recording, truth)
    other = SIDES[1 - SIDES.index(lost)]
    for joint in ("neck_twist", f"{other}_shoulder_abduction", f"{other}_shoulder_rotation"):
        assert not recording.observed[:, INDEX[joint]].any()
    # How far an arm is raised does not depend on it.
    assert recording.observed[:, INDEX[f"{other}_elbow_flexion"]].all()


def test_a_shoulder_that_is_lost_for_a_while() -> None:
    truth = posture(COUNT, trunk_twist=swing(-30, 30), neck_flexion=15.0, **ARMS)
    recording = without(whole(STANDS, truth), "left_shoulder", rows=slice(100, 130))
    assert_holds(recording, truth)
    assert recording.observed[:100].all()
    assert recording.observed[130:].all()


def test_without_hips_flexion_may_be_side_bend() -> None:
    truth = posture(COUNT, trunk_twist=swing(0, 40), trunk_flexion=24.0, **ARMS)
    recording = without(whole(STANDS, truth), "right_hip", "left_hip")
    assert_holds(recording, truth)
    # Both shoulders show what neck and arms are measured from.
    for joint in ("neck_flexion", "right_shoulder_flexion"):
        assert recording.observed[:, INDEX[joint]].all()


def test_a_body_that_turns_unseen() -> None:
    truth = posture(COUNT, trunk_flexion=24.0, right_hip_flexion=40.0, left_hip_flexion=-20.0)
    turned = STANDS.copy()
    turned[:, 3] = np.radians(swing(-60, 60))
    lost = [f"{side}_{pair}" for side in SIDES for pair in ("hip", "shoulder")]
    # In the first moments it is taken not to have turned.
    assert_holds(without(whole(turned, truth), *lost, rows=slice(50, 200)), truth, slack=8.0)


def test_a_neck_is_measured_from_the_trunk() -> None:
    truth = posture(COUNT, trunk_flexion=swing(5, 75), neck_flexion=swing(-10, 30, 2.1), **ARMS)
    hips = ("right_hip", "left_hip", "pelvis")
    recording = without(whole(STANDS, truth), *hips, rows=slice(100, 150))
    assert not recording.observed[100:150, INDEX["neck_flexion"]].any()
    assert_holds(recording, truth)


@pytest.mark.parametrize("rotation", [-18.0, 15.0, 60.0])
def test_a_straight_arm_shows_the_sum_of_rotation_and_pronation(rotation: float) -> None:
    truth = posture(
        COUNT,
        arms_elbow_flexion=4.0,
        arms_shoulder_flexion=60.0,
        arms_shoulder_rotation=rotation,
        arms_forearm_pronation=20.0,
    )
    # What is left of the bend turns the hand.
    assert_holds(fitted(whole(STANDS, truth), neutral="vertical"), truth, slack=4.0)


@pytest.mark.parametrize("pronation", [-60.0, 35.0, 70.0])
def test_without_a_thumb_a_wrist_may_be_turned(pronation: float) -> None:
    truth = posture(
        COUNT,
        arms_forearm_pronation=pronation,
        arms_wrist_flexion=25.0,
        arms_wrist_deviation=10.0,
        **ARMS,
    )
    recording = without(whole(STANDS, truth), "right_thumb", "left_thumb")
    # Some pronations are tried, 10 deg apart.
    beyond = np.degrees(np.maximum(recording.low - truth, truth - recording.high)).max(axis=0)
    assert beyond.max() < 2


@pytest.mark.parametrize("side", SIDES)
def test_the_ends_of_a_wrist_are_those_of_all_pronations(side: str) -> None:
    joints = [
        INDEX[f"{side}_{n}"] for n in ("forearm_pronation", "wrist_flexion", "wrist_deviation")
    ]
    postures = posture(1)
    postures[0, joints] = np.radians([0.0, 45.0, 22.0])
    observed = np.ones_like(postures, dtype=bool)
    observed[0, joints[0]] = False
    # The hand is turned about the forearm, along z.
    out = -1.0 if side == "right" else 1.0
    bent, aside = postures[0, joints[1:]]
    hand = [-np.sin(aside), -out * np.cos(aside) * np.sin(bent), -np.cos(aside) * np.cos(bent)]
    turns = np.linspace(LOWER[joints[0]], UPPER[joints[0]], 500)
    x, y, z = Rotation.from_euler("Z", -out * turns[:, None]).inv().apply(hand).T
    flexion, deviation = -out * np.arctan2(y, -z), -np.arcsin(x)
    can = (deviation >= LOWER[joints[2]]) & (deviation <= UPPER[joints[2]])
    found = by_pronation(postures, observed)
    for joint, angles in zip(joints[1:], (flexion[can], deviation[can]), strict=True):
        rows, low, high = found[joint]
        assert list(rows) == [0]
        np.testing.assert_allclose([low[0], high[0]], [angles.min(), angles.max()], atol=0.06)


def test_a_rotation_takes_from_the_pronation() -> None:
    postures = posture(1, right_forearm_pronation=20.0, right_shoulder_rotation=10.0)
    observed = np.ones_like(postures, dtype=bool)
    rotation, pronation = (INDEX[f"right_{n}"] for n in ("shoulder_rotation", "forearm_pronation"))
    observed[0, rotation] = False
    span = np.array([0]), np.radians([5.0]), np.radians([60.0])
    _, low, high = by_rotation(rotation, span, postures, observed)[pronation]
    np.testing.assert_allclose(np.degrees([low[0], high[0]]), [-30.0, 25.0])


@pytest.mark.parametrize("twist", [-35.0, 35.0])
def test_neck_and_arms_turn_against_the_twist(twist: float) -> None:
    truth = posture(COUNT, trunk_twist=twist, neck_flexion=25.0, neck_twist=10.0, **ARMS)
    read = without(whole(STANDS, truth), "left_shoulder")
    assert np.abs(read.postures[:, TWIST]).max() < 1e-6
    joints = ["neck_twist", "neck_side_bend"]
    joints += [f"right_shoulder_{name}" for name in ("flexion", "abduction", "rotation")]
    seen = np.ones_like(truth, dtype=bool)
    seen[:, TWIST] = False
    every, none = np.ones(COUNT, dtype=bool), np.zeros(COUNT, dtype=bool)
    for right in (True, False):
        ends = sorted([0.0, np.radians(twist) * (1.1 if right else -1.1)])
        low, high = (np.full(COUNT, end) for end in ends)
        found = by_twist((low, high), read.postures, seen, (every, none), none)
        for joint in joints:
            rows, least, most = found[INDEX[joint]]
            assert len(rows) == COUNT
            there = truth[rows, INDEX[joint]]
            inside = (least - 0.02 < there) & (there < most + 0.02)
            # The flexion of an arm that points between ahead and aside hardly changes.
            assert inside.all() if right else not inside.any() or "flexion" in joint, joint


@pytest.mark.parametrize("twist", [-35.0, 35.0])
def test_without_hips_a_lean_turns_with_the_twist(twist: float) -> None:
    truth = posture(COUNT, trunk_twist=twist, trunk_flexion=30.0, **ARMS)
    read = without(whole(STANDS, truth), "left_hip", "right_hip")
    seen = np.ones_like(truth, dtype=bool)
    seen[:, TWIST] = False
    every, none = np.ones(COUNT, dtype=bool), np.zeros(COUNT, dtype=bool)
    bend = INDEX["trunk_side_bend"]
    assert np.abs(np.degrees(read.postures[:, bend])).min() > 10
    for right in (True, False):
        ends = sorted([0.0, np.radians(twist) * (1.1 if right else -1.1)])
        low, high = (np.full(COUNT, end) for end in ends)
        _, least, most = by_twist((low, high), read.postures, seen, (none, every), none)[bend]
        assert ((least < 0.01) & (most > -0.01)).all() == right


@pytest.mark.parametrize(
    "beyond", [{"trunk_twist": 60.0}, {"trunk_flexion": -45.0}, {"trunk_side_bend": 55.0}]
)
def test_neck_and_arms_are_measured_from_a_trunk_beyond_its_range(beyond: dict[str, float]) -> None:
    angles = {joint: swing(0.0, end) for joint, end in beyond.items()}
    truth = posture(COUNT, neck_flexion=10.0, **ARMS, **angles)
    recording = fitted(whole(STANDS, truth), neutral="vertical")
    others = [i for joint, i in INDEX.items() if joint.split("_")[0] in ("neck", "right", "left")]
    off = np.degrees(np.abs(recording.postures - truth))[:, others]
    assert off[recording.observed[:, others]].max() < 1


def test_a_hand_is_measured_from_a_forearm_beyond_its_range() -> None:
    truth = posture(
        COUNT,
        right_shoulder_rotation=swing(0, 115),
        right_elbow_flexion=90.0,
        right_forearm_pronation=-20.0,
        right_wrist_flexion=30.0,
        right_wrist_deviation=10.0,
    )
    recording = fitted(whole(STANDS, truth), neutral="vertical")
    wrist = [INDEX[f"right_{n}"] for n in ("forearm_pronation", "wrist_flexion", "wrist_deviation")]
    assert np.degrees(np.abs(recording.postures - truth))[:, wrist].max() < 1


def test_a_knee_that_is_bent_backward_is_straight() -> None:
    truth = posture(COUNT, legs_knee_flexion=-16.0, **ARMS)
    recording = fitted(whole(STANDS, truth), neutral="vertical")
    assert recording.seen.all()
    assert np.degrees(recording.postures[:, INDEX["right_knee_flexion"]]).max() == 0
    assert np.abs(np.degrees(recording.postures[:, INDEX["right_hip_rotation"]])).max() < 1


def test_a_straight_leg_is_rotated_as_its_foot_is() -> None:
    truth = posture(COUNT, legs_knee_flexion=0.0, legs_hip_rotation=20.0)
    recording = fitted(whole(STANDS, truth), neutral="vertical")
    rotation = np.degrees(recording.postures[:, [INDEX[f"{side}_hip_rotation"] for side in SIDES]])
    np.testing.assert_allclose(rotation, 20.0, atol=1.5)


@pytest.mark.parametrize("ever", [True, False])
def test_what_stands_for_a_neck_is_off_by_some_degrees(ever: bool) -> None:
    truth = posture(COUNT, trunk_flexion=swing(5, 40), **ARMS)
    places = whole(STANDS, truth)
    # The neck of a skeleton is ahead of the shoulders.
    along = places["neck"] - (places["right_hip"] + places["left_hip"]) / 2
    ahead = np.cross(places["left_shoulder"] - places["right_shoulder"], along)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    places["neck"] += 0.05 * ahead
    plain = fitted({name: path.copy() for name, path in places.items()}, neutral="vertical")
    rows = slice(100, 250) if ever else slice(None)
    recording = without(places, "neck", rows=rows)
    trunk = INDEX["trunk_flexion"]
    off = np.degrees(np.abs(recording.postures - plain.postures))[rows, trunk]
    assert (off.max() < 0.5) == ever
    assert recording.observed[rows, trunk].all()
    wide = np.degrees(recording.high - recording.low)[rows, trunk]
    np.testing.assert_allclose(wide, 10.0 if ever else 16.0, atol=0.1)
    assert (recording.low[rows, trunk] <= plain.postures[rows, trunk]).all()
    assert (plain.postures[rows, trunk] <= recording.high[rows, trunk]).all()


def test_hips_by_the_centre_of_the_pelvis_are_where_they_are_at_other_times() -> None:
    truth = posture(COUNT, trunk_flexion=24.0, **ARMS)
    stands = STANDS.copy()
    yaw = np.where(TIME < 50 / RATE, 0.5, 2.0)
    stands[:, 3] = yaw
    places = whole(stands, truth)
    behind = -0.08 * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    places["pelvis"] = places["pelvis"] + behind + [0.0, 0.0, 0.10]
    recording = without(places, "right_hip", "left_hip", rows=slice(100, 250))
    off = np.degrees(np.abs(recording.postures - truth))[:, INDEX["trunk_flexion"]]
    assert off.max() < 0.5


def test_movements_are_measured_by_time_and_not_by_frames() -> None:
    # 10 frames a second of standing, 100 of quick movements: the arm is lost in some of these.
    slow = [np.arange(start, start + 28.5, 0.1) for start in np.arange(0, 300, 30.0)]
    time = np.sort(
        np.concatenate([*slow, *(each[-1] + 0.1 + np.arange(0, 1.5, 0.01) for each in slow)])
    )
    phase = np.clip((time % 30 - 28.5) / 1.5, 0, 1)
    bent = 5 + 100 * np.sin(np.pi * phase) ** 2
    truth = posture(len(time), right_elbow_flexion=bent)
    observed = np.ones_like(truth, dtype=bool)
    joint, lost = INDEX["right_elbow_flexion"], (phase > 0.3) & (phase < 0.7) & (time > 200)
    observed[lost, joint] = False
    read = truth.copy()
    read[lost, joint] = np.interp(time[lost], time[~lost], truth[~lost, joint])
    spans, _ = spans_of(read, observed, time)
    frames, low, high = spans[joint]
    beyond = np.maximum(low - truth[frames, joint], truth[frames, joint] - high)
    assert np.degrees(beyond).max() < 6


def test_a_trunk_that_may_lean_otherwise_bends_no_elbow() -> None:
    truth = posture(COUNT, trunk_flexion=20.0, **ARMS)
    recording = without(whole(STANDS, truth), "neck")
    wide = np.degrees(recording.high - recording.low)
    assert wide[:, INDEX["right_elbow_flexion"]].max() == 0
    for joint in ("flexion", "abduction", "rotation"):
        assert wide[:, INDEX[f"right_shoulder_{joint}"]].min() > 15
