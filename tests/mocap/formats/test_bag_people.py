"""Who is shown in a bag: nobody, one person, several in turn, or one by ready angles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_bags import Bag, read

import ergoqp
from benchmarks.made_motions import stoop
from ergoqp.errors import RecordingError
from ergoqp.joints import INDEX, JOINTS
from ergoqp.mocap.formats.bag_series import KINECT

TIMES = np.arange(20) / 10


@pytest.fixture
def bag(tmp_path: Path) -> Bag:
    return Bag(tmp_path, "ros1")


def sentence(bag: Bag, messages: list[Any]) -> str:
    with pytest.raises(RecordingError) as caught:
        ergoqp.load_recording(bag.write(messages))
    return str(caught.value)


ALLOWED = (
    "which show no person, allowed a person's joints: MarkerArray, tf, or JointState with all of"
    " ergoqp.JOINTS or with the coordinates of an OpenSim model from its pelvis or thorax on"
)


def test_a_thing_alone(bag: Bag) -> None:
    said = sentence(bag, [(t, "/cup", bag.pose(t, (t, 0, 0))) for t in TIMES])
    assert said == f"take.bag: got the topics /cup (geometry_msgs/PoseStamped), {ALLOWED}"


def test_a_robot_alone(bag: Bag) -> None:
    angles = {"shoulder_pan_joint": 1.0, "elbow_joint": 0.5}
    said = sentence(bag, [(t, "/arm", bag.angles(t, angles)) for t in TIMES])
    assert said == (
        "take.bag: got the topics /arm (sensor_msgs/JointState) and the joints shoulder_pan_joint,"
        f" elbow_joint, {ALLOWED}"
    )


def shown(bag: Bag, bodies: list[int], apart: float) -> list[Any]:
    """Return a message for each body: its pelvis is as far along y as its number says."""
    messages = []
    for time, number in zip(TIMES, bodies, strict=False):
        places = {100 * number + i: (i, number * apart, time) for i in range(32)}
        messages.append((time, "/bodies", bag.markers(time, places)))
    return messages


@pytest.mark.parametrize("bodies", [[1, 2] * 10, [1, 1, 2, 2, 2] * 4, [1, 2, 3, 1] * 5])
def test_two_people_in_turn(bag: Bag, bodies: list[int]) -> None:
    motion = read(bag.write(shown(bag, bodies, 1.0)))
    count = len(set(bodies))
    assert motion.names[:: len(KINECT)] == tuple(f"body {i + 1}:PELVIS" for i in range(count))
    seen = np.isfinite(motion.of("body 2:PELVIS")).all(axis=1)
    np.testing.assert_array_equal(seen, np.array(bodies) == 2)
    assert (
        f"The tracker shows {count} bodies in turn and far apart: they are taken as different"
        " people."
    ) in motion.notes


@pytest.mark.parametrize(
    ("bodies", "apart"),
    [
        ([1, 2] * 10, 0.1),  # one person under two numbers
        ([1] * 7 + [2] * 7 + [5] * 6, 1.0),  # lost, and found as a new one elsewhere
        ([1] * 7 + [2] * 2 + [1] * 11, 1.0),  # a mistake of two messages
    ],
)
def test_one_person_who_is_numbered_anew(bag: Bag, bodies: list[int], apart: float) -> None:
    motion = read(bag.write(shown(bag, bodies, apart)))
    assert motion.names == KINECT
    assert np.isfinite(motion.positions).all()
    assert any("never shows two at once" in note for note in motion.notes)


def test_people_in_turn_are_asked_for(bag: Bag) -> None:
    said = sentence(bag, shown(bag, [1, 2] * 10, 1.0))
    assert said == (
        "take.bag: got 2 people (body 1, body 2), allowed one; state the person whose posture is"
        " meant (subject)"
    )


def moved(count: int) -> np.ndarray:
    """Return angles of all joints that are within their ranges (count, 32) [rad]."""
    draw = np.random.default_rng(3)
    phase, speed = draw.uniform(0, 6, len(JOINTS)), draw.uniform(0.5, 2, len(JOINTS))
    size = np.full(len(JOINTS), 0.15)
    middle = np.zeros(len(JOINTS))
    for joint in ("elbow_flexion", "knee_flexion", "shoulder_flexion"):
        for side in ("right", "left"):
            middle[INDEX[f"{side}_{joint}"]] = 0.7
    return middle + size * np.sin(phase + speed * np.arange(count)[:, None] / 10)


@pytest.mark.parametrize("prefix", ["", "human/"])
def test_ready_angles_are_the_postures(bag: Bag, prefix: str) -> None:
    postures = moved(50)
    messages = [
        (i / 10, "/human", bag.angles(i / 10, {prefix + j: row[k] for k, j in enumerate(JOINTS)}))
        for i, row in enumerate(postures)
    ]
    robot = bag.angles(0.0, {"shoulder_pan_joint": 1.0})
    thing = bag.pose(0.0, (1, 1, 1))
    messages = [(0.0, "/arm", robot), (0.0, "/cup", thing), *messages]
    recording = ergoqp.load_recording(bag.write(messages))
    assert recording.scored.all()
    assert recording.observed.mean() > 0.9
    off = np.abs(recording.postures - postures)
    assert np.degrees(off[recording.observed].max()) < 1.0
    assert recording.object_poses is None
    said = " ".join(recording.assumptions)
    assert "The joint centres are placed by the file's angles of the joints of ergoqp" in said
    assert "The objects are left out" in said


def test_ready_angles_in_degrees(bag: Bag) -> None:
    said = sentence(bag, [(t, "/human", bag.angles(t, dict.fromkeys(JOINTS, 45.0))) for t in TIMES])
    assert said == (
        "take.bag: the trunk flexion reaches 45 rad, allowed two whole turns: the angles may be in"
        " degrees; or state that the angles are right (trust angles)"
    )


def test_all_but_one_of_our_joints_are_none(bag: Bag) -> None:
    angles = dict.fromkeys(JOINTS[:-1], 0.1)
    said = sentence(bag, [(t, "/human", bag.angles(t, angles)) for t in TIMES])
    assert "and the joints trunk flexion" in said.replace("_", " ")
    assert "which show no person" in said


@pytest.mark.parametrize("prefix", ["human/", "/human/", "human:", "human_", "/"])
def test_frames_of_a_person_have_a_prefix(bag: Bag, prefix: str) -> None:
    recording = ergoqp.load_recording(bag.write(frames(bag, prefix)))
    assert recording.scored.any()


@pytest.mark.parametrize("subject", ["anna", "anna/", "/anna", "/anna/"])
def test_the_subject_is_a_prefix_with_or_without_a_slash(bag: Bag, subject: str) -> None:
    messages = sorted(frames(bag, "anna/") + frames(bag, "ben/"), key=lambda each: each[0])
    path = bag.write(messages)
    with pytest.raises(RecordingError, match=r"got 2 people \(anna, ben\), allowed one"):
        ergoqp.load_recording(path)
    assert "The person is 'anna'." in ergoqp.load_recording(path, subject=subject).assumptions


def test_a_robot_beside_a_person_with_a_prefix(bag: Bag) -> None:
    messages = frames(bag, "human/")
    for i, (time, _, message) in enumerate(messages):
        message.transforms += [
            bag.transform(time, "world", f"robot/link_{j}", (1, j * np.sin(i), j)) for j in range(7)
        ]
    recording = ergoqp.load_recording(bag.write(messages))
    assert "The person is 'human'." in recording.assumptions
    assert "Also in the recording, and left out: 'robot'." in recording.assumptions
    assert recording.object_poses is None


def test_a_mapping_may_name_frames_with_their_prefix(bag: Bag, tmp_path: Path) -> None:
    """It says whose they are: nobody is asked for."""
    path = bag.write(sorted(frames(bag, "anna/") + frames(bag, "ben/"), key=lambda each: each[0]))
    mapping = tmp_path / "mapping.toml"
    mapping.write_text("".join(f'{centre} = "anna/{centre}"\n' for centre in stoop()[0]))
    assert ergoqp.load_recording(path, mapping=mapping).scored.any()


def frames(bag: Bag, prefix: str) -> list[Any]:
    """Return a stooping person as frames of tf."""
    places = stoop()[0]
    return [
        (
            i / 50,
            "/tf",
            bag.tf(*(bag.transform(i / 50, "world", prefix + c, p[i]) for c, p in places.items())),
        )
        for i in range(0, len(places["neck"]), 5)
    ]
