"""Objects of a bag: their poses are brought by tf into the frame of the person, or left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_bags import LIFTED, Bag, body, read

from ergoqp.errors import RecordingError

TIMES = np.arange(10) / 10
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""What `LIFTED` does."""


@pytest.fixture
def bag(tmp_path: Path) -> Bag:
    return Bag(tmp_path, "ros1")


def written(bag: Bag, *more: tuple[float, str, Any]) -> Any:
    messages = [(t, "/bodies", bag.markers(t, body(1, t))) for t in TIMES]
    return read(bag.write(sorted([*messages, *more], key=lambda each: each[0])))


def cup(bag: Bag, frame: str, turn: tuple[float, ...] = (0, 0, 0, 1)) -> list[Any]:
    return [(t, "/cup", bag.pose(t, (t, 0, 0), turn, frame)) for t in TIMES]


def test_a_pose_in_what_the_camera_hangs_from(bag: Bag) -> None:
    """The camera is at (1, 2, 3) in the world, and turned by a quarter."""
    still = bag.tf(bag.transform(0, "/world", "camera", (1, 2, 3), LIFTED))
    motion = written(bag, (0.0, "/tf_static", still), *cup(bag, "/world", LIFTED))
    there = (np.stack([TIMES, 0 * TIMES, 0 * TIMES], axis=1) - [1, 2, 3]) @ TURN
    np.testing.assert_allclose(motion.objects["cup"][:, :3, 3], there, atol=1e-6)
    np.testing.assert_allclose(motion.objects["cup"][4, :3, :3], np.eye(3), atol=1e-6)
    said = "The poses of /cup are transformed by tf from the frame 'world' to 'camera'."
    assert said in motion.notes


def test_a_pose_in_a_gripper_that_moves(bag: Bag) -> None:
    """Both hang from a platform whose own way nobody knows; the gripper is lost after a while."""
    still = bag.tf(bag.transform(0, "platform", "camera", (0, 0, 1)))
    arm = [(t, "/tf", bag.tf(bag.transform(t, "platform", "gripper", (0, t, 5)))) for t in TIMES]
    motion = written(bag, (0.0, "/tf_static", still), *arm[1:4], *cup(bag, "gripper"))
    places = motion.objects["cup"][:, :3, 3]
    np.testing.assert_array_equal(np.isnan(places[:, 0]), [True] + 8 * [False] + [True])
    np.testing.assert_allclose(places[2], [0.2, 0.2, 4], atol=1e-6)
    np.testing.assert_allclose(places[8], [0.8, 0.3, 4], atol=1e-6)


def test_a_pose_in_a_frame_that_nobody_connects(bag: Bag) -> None:
    still = bag.tf(bag.transform(0, "room", "table", (0, 0, 1)))
    motion = written(bag, (0.0, "/tf_static", still), *cup(bag, "table"))
    assert dict(motion.objects) == {}
    assert (
        "The poses of /cup are in the frame 'table' and are left out: tf does not connect it with"
        " 'camera', the frame of the rest."
    ) in motion.notes
    assert not any("The poses are those of" in note for note in motion.notes)


def test_one_topic_in_two_frames(bag: Bag) -> None:
    early = [(0.0, "/cup", bag.pose(0.0, (7, 0, 0), frame="world"))]
    said = "take.bag: /cup: got poses in the frames 'world' and 'camera', allowed one frame"
    with pytest.raises(RecordingError, match=said):
        written(bag, *early, *cup(bag, "camera")[2:])


def test_one_frame_in_two_others(bag: Bag) -> None:
    moved = [(t, "/tf", bag.tf(bag.transform(t, f"arm{t > 0.5}", "cup", (0, 0, t)))) for t in TIMES]
    said = "got the frame 'cup' of tf in 'armFalse' and in 'armTrue', allowed one parent"
    with pytest.raises(RecordingError, match=said):
        written(bag, *moved)


def test_the_frames_of_tf_are_in_their_root(bag: Bag) -> None:
    names = ("head", "hand")
    moved = [
        (t, "/tf", bag.tf(*(bag.transform(t, "camera", n, (t, 0, 1)) for n in names)))
        for t in TIMES
    ]
    still = bag.tf(bag.transform(0, "world", "camera", (5, 0, 0)))
    poses = [*cup(bag, "camera"), (0.0, "/box", bag.pose(0.0, (1, 1, 1), frame="world"))]
    messages = [(0.0, "/tf_static", still), *moved, *poses]
    motion = read(bag.write(sorted(messages, key=lambda each: each[0])))
    np.testing.assert_allclose(motion.of("head")[:, 0], TIMES + 5, atol=1e-6)
    np.testing.assert_allclose(motion.objects["cup"][:, 0, 3], TIMES + 5, atol=1e-6)
    np.testing.assert_allclose(motion.objects["box"][0, :3, 3], 1, atol=1e-6)
