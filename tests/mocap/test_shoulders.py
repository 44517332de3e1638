"""Few rigid bodies, as handling studies track them: the shoulders are found by the elbows."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.recording_outcomes import outside
from ergoqp.human import FRACTIONS, Body, Kinematics
from ergoqp.joints import INDEX, LOWER, SIDES
from ergoqp.mocap import unseen
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recording import JointMotion
from ergoqp.mocap.unseen import SAID
from ergoqp.sheets.description import elevation_of

# Not the average that is fallen back to.
BODY = Body(1.72, {"shoulder_width": 1.15 * FRACTIONS["shoulder_width"] * 1.72})
NAMES = {
    "Belt": "pelvis",
    "Shoulder Center": "neck",
    "Head": "head",
    "Left Elbow": "left_elbow",
    "Right Elbow": "right_elbow",
    "Left Hand": "left_wrist",
    "Right Hand": "right_wrist",
}


def handled(sway: float, noise: float = 0.002) -> tuple[JointMotion, np.ndarray]:
    """Somebody who works with both hands, whose arms swing by so many degrees."""
    time = np.arange(600) / 60.0
    postures = np.zeros((len(time), 32))
    postures[:, INDEX["trunk_flexion"]] = np.radians(20 + 15 * np.sin(time))
    for i, side in enumerate(SIDES):
        for joint, angle in (
            ("elbow_flexion", 60 + 20 * np.sin(2 * time)),
            ("shoulder_flexion", 45 + sway * np.sin(1.3 * time + i)),
            ("shoulder_abduction", 20 + sway / 3 * np.cos(1.7 * time + i)),
        ):
            postures[:, INDEX[f"{side}_{joint}"]] = np.radians(angle)
    centres = centres_of(BODY, np.tile([0.0, 0.0, 0.9, 0.3], (len(time), 1)), postures)
    centres["pelvis"] = (centres["right_hip"] + centres["left_hip"]) / 2
    trunk = Kinematics(BODY).function("trunk").map(len(time))(postures.T)[1]
    turns = np.array(trunk).reshape(3, len(time), 3).swapaxes(0, 1)
    # Nobody knows how the rigid body's axes lie in the person.
    axes = (
        Rotation.from_euler("Z", 0.3)
        * Rotation.from_matrix(turns)
        * Rotation.from_euler("XYZ", [0.5, -1.0, 2.0])
    )
    generator = np.random.default_rng(3)
    places = np.stack([centres[theirs] for theirs in NAMES.values()], axis=1)
    places += noise * generator.standard_normal(places.shape)
    turning = {"Shoulder Center": axes.as_quat()}
    return JointMotion(tuple(NAMES), places, time, turns=turning, unit=1.0, up="z"), postures


def elevation_off(motion: JointMotion, postures: np.ndarray) -> float:
    recording = recording_of(motion, "take", ReadOptions(neutral="vertical"))
    assert SAID in recording.assumptions
    assert recording.scored.all()
    off = elevation_of(recording.postures)[0] - elevation_of(postures)[0]
    return float(np.degrees(np.sqrt(np.mean(off**2))))


@pytest.mark.parametrize(("sway", "most"), [(60.0, 2.5), (25.0, 4.0), (3.0, 6.0)])
def test_elbows_tell_shoulders(sway: float, most: float):
    assert elevation_off(*handled(sway)) < most


def test_an_average_person_would_not_do(monkeypatch: pytest.MonkeyPatch):
    found = elevation_off(*handled(60.0))
    monkeypatch.setattr(unseen, "_TRUST", 1e3)
    assert elevation_off(*handled(60.0)) > 1.5 * found


def test_without_an_orientation_the_arms_are_not_seen():
    motion, _ = handled(60.0)
    recording = recording_of(
        JointMotion(motion.names, motion.positions, motion.time, unit=1.0, up="z"),
        "take",
        ReadOptions(neutral="vertical"),
    )
    assert SAID not in recording.assumptions
    assert recording.scored.all()
    arms = [INDEX[f"{side}_shoulder_flexion"] for side in SIDES]
    assert not recording.observed[:, arms].any()
    np.testing.assert_allclose(recording.low[:, arms], np.tile(LOWER[arms], (len(motion.time), 1)))


def test_what_is_lost_for_a_while():
    motion, postures = handled(60.0)
    motion.turns["Shoulder Center"][100:200] = np.nan
    motion.positions[300:330, motion.names.index("Left Elbow")] = np.nan
    recording = recording_of(motion, "take", ReadOptions(neutral="vertical"))
    assert not recording.observed[120:180, INDEX["right_shoulder_flexion"]].any()
    assert outside(recording, postures).max() < 12
