"""What ROS bags say: the shared one by its independent table, own ones by what was written."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from ros_bags import KINDS, LIFTED, Bag, body, read

from ergoqp.mocap.formats.bag import is_bag_folder, read_bag
from ergoqp.mocap.formats.bag_series import KINECT
from ergoqp.mocap.formats.table import read_table
from ergoqp.mocap.formats.text import TableOptions

TIMES = np.arange(10) / 10


@pytest.fixture(params=KINDS)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Bag:
    return Bag(tmp_path, request.param)


@pytest.fixture
def ros1(tmp_path: Path) -> Bag:
    return Bag(tmp_path, "ros1")


@pytest.mark.slow
def test_the_shared_bag_is_its_table(shared: Path) -> None:
    path = shared / "mocap/kinect/azure_kinect_body_tracking_part1.bag"
    shares: list[float] = []
    motion = read_bag(path, shares.append, TableOptions())
    table = read_table(path.with_suffix(".csv"), lambda share: None, TableOptions())
    assert motion.names == table.names
    seen = np.isfinite(motion.positions).all(axis=(1, 2))
    assert np.isnan(motion.positions[~seen]).all()
    # The table is rounded to a tenth of a millimetre and a microsecond.
    assert motion.positions[seen] == pytest.approx(table.positions, abs=5.1e-5)
    time = motion.time[seen]
    assert time - time[0] == pytest.approx(table.time, abs=1.1e-6)
    assert not seen[:18].any()
    assert (np.diff(motion.time) > 0).all()
    assert "18 of 560 messages show nobody." in motion.notes
    assert "The positions are in the axes of the frame 'kinect2_depth_camera_link'." in motion.notes
    assert not any("repeat the frame before" in note for note in motion.notes)
    assert (motion.unit, motion.up) == (1.0, None)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_frames_are_joints_in_their_root(bag: Bag) -> None:
    """Two moving frames, one on a mount that stands still, one on the other."""
    messages = [(0.0, "/tf_static", bag.tf(bag.transform(0, "/map", "mount", (1, 0, 0), LIFTED)))]
    for time in TIMES:
        messages.append((time, "/tf", bag.tf(bag.transform(time, "mount", "hand", (time, 0, 2)))))
    for time in TIMES[::2]:
        moved = bag.transform(time, "hand", "finger", (0, 0.5, 0), LIFTED)
        messages.append((time + 0.01, "/tf", bag.tf(moved)))
    motion = read(bag.write(sorted(messages, key=lambda each: each[0])))
    assert motion.names == ("hand", "finger")
    assert motion.time == pytest.approx(TIMES, abs=1e-8)
    hand = np.stack([np.ones(10), TIMES, np.full(10, 2.0)], axis=1)
    assert motion.of("hand") == pytest.approx(hand, abs=1e-6)
    assert motion.of("finger") == pytest.approx(hand - [0.5, 0, 0], abs=1e-6)
    assert motion.turns["hand"] == pytest.approx(np.tile(LIFTED, (10, 1)), abs=1e-6)
    half = np.tile([0, 0, 1, 0], (10, 1))
    assert np.abs((motion.turns["finger"] * half).sum(axis=1)) == pytest.approx(1, abs=1e-6)
    assert any("root 'map'" in note for note in motion.notes)


def test_angles_and_poses_are_those_told_last(bag: Bag) -> None:
    messages = [(time, "/cup", bag.pose(time, (time, 0, 1), LIFTED)) for time in TIMES]
    messages += [
        (t + 0.02, "/arm", bag.angles(t, {"pelvis_tilt": t, "wrist": -t})) for t in TIMES[1:4]
    ]
    motion = read(bag.write(sorted(messages, key=lambda each: each[0])))
    assert motion.names == ()
    assert motion.positions.shape == (10, 0, 3)
    pose = motion.objects["cup"]
    assert pose[:, 0, 3] == pytest.approx(TIMES, abs=1e-6)
    assert pose[3, :3, :3] == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-6)
    tilt = motion.angles["pelvis_tilt"]
    # Nothing before the first, the last one for half a second, and then nothing.
    assert tilt == pytest.approx(
        [np.nan, 0.1, 0.2, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, np.nan], abs=1e-6, nan_ok=True
    )
    assert motion.angles["wrist"] == pytest.approx(-tilt, nan_ok=True)
    assert "The poses are those of /cup in 'camera'." in motion.notes


def test_two_bodies_have_their_numbers(bag: Bag) -> None:
    messages = [(t, "/bodies", bag.markers(t, body(1, t) | body(3, -t))) for t in TIMES]
    messages += [(1.0, "/bodies", bag.markers(1.0, body(3, -1.0)))]
    motion = read(bag.write(messages))
    assert motion.names == tuple(f"body {n}:{joint}" for n in (1, 3) for joint in KINECT)
    assert motion.of("body 3:NECK")[4] == pytest.approx([3, 3, -0.4])
    assert np.isnan(motion.of("body 1:NECK")[10]).all()


def test_a_body_found_again_is_one_person(ros1: Bag) -> None:
    messages = [(t, "/bodies", ros1.markers(t, body(1 + (t > 0.45), t))) for t in TIMES]
    motion = read(ros1.write(messages))
    assert motion.names == KINECT
    assert motion.of("PELVIS")[:, 2] == pytest.approx(TIMES, abs=1e-6)
    assert any("2 bodies but never shows two at once" in note for note in motion.notes)


def test_other_markers_have_their_own_names(ros1: Bag) -> None:
    places = {("left", 1): (1, 2, 3), ("left", 2): (4, 5, 6), ("", 7): (7, 8, 9)}
    messages = []
    for time in TIMES:
        message = ros1.markers(time, places)
        message.markers[1].text = "knee"
        message.markers += ros1.markers(time, {99: (0, 0, 0)}, type=4).markers  # a line
        message.markers += ros1.markers(time, {98: (0, 0, 0)}, action=2).markers  # taken away
        messages.append((time, "/markers", message))
    motion = read(ros1.write(messages))
    assert motion.names == ("left/1", "knee", "7")
    assert motion.of("knee")[5] == pytest.approx([4, 5, 6])


def test_the_kinect_is_the_person_and_the_rest_is_said(ros1: Bag) -> None:
    messages = []
    for time in TIMES:
        messages.append((time, "/bodies", ros1.markers(time, body(1, time))))
        messages.append((time, "/walls", ros1.markers(time, {i: (0, 0, 0) for i in range(40)})))
        messages.append((time, "/tf", ros1.tf(ros1.transform(time, "map", "robot", (0, 0, 0)))))
        messages.append((time, "/vicon/cup", ros1.transform(time, "/camera", "cup", (time, 0, 0))))
    motion = read(ros1.write(messages))
    assert motion.names == KINECT
    assert motion.objects["vicon/cup"][7, 0, 3] == pytest.approx(0.7, abs=1e-6)
    text = " ".join(motion.notes)
    assert "The markers of /walls are not read" in text
    assert "The moving frames robot of tf are not read" in text
    assert "/vicon/cup in 'camera'" in text


def test_without_stamps_the_recorder_says_when(ros1: Bag) -> None:
    messages = [(t, "/bodies", ros1.markers(np.nan, body(1, t))) for t in TIMES**2]
    motion = read(ros1.write(messages))
    assert motion.time == pytest.approx(TIMES**2, abs=1e-8)
    assert any("those of the recorder" in note for note in motion.notes)


def test_messages_without_anybody_are_between_the_others(ros1: Bag) -> None:
    """They have no header; the sender's clock is 3 s behind."""
    messages = [
        (t, "/bodies", ros1.markers(t - 3, body(1, t) if i in (3, 4, 7) else {}))
        for i, t in enumerate(TIMES)
    ]
    motion = read(ros1.write(messages))
    assert motion.time == pytest.approx(TIMES, abs=1e-6)
    assert np.isfinite(motion.positions[:, 0, 0]).nonzero()[0].tolist() == [3, 4, 7]
    assert "7 of 10 messages show nobody." in motion.notes


@pytest.mark.parametrize("late", [0.0, 1000.0, np.nan])
def test_a_sender_of_another_clock_is_read_by_the_recorders(ros1: Bag, late: float) -> None:
    messages = []
    for time in TIMES:
        messages.append((time + 0.03, "/bodies", ros1.markers(time, body(1, time))))
        messages.append((time + 0.03, "/cup", ros1.pose(time + late, (time, 0, 0))))
    motion = read(ros1.write(messages))
    assert motion.objects["cup"][:, 0, 3] == pytest.approx(TIMES, abs=1e-6)


def test_trees_apart(ros1: Bag) -> None:
    messages = []
    for time in TIMES:
        seen = [ros1.transform(time, "room", name, (time, 0, 0)) for name in ("head", "hand")]
        other = ros1.transform(time, "odom", "robot", (0, 0, 0))
        messages.append((time, "/tf", ros1.tf(*seen, other)))
    motion = read(ros1.write(messages))
    assert motion.names == ("head", "hand")
    assert "The frames robot of tf have another root" in " ".join(motion.notes)


def test_markers_without_a_definition(tmp_path: Path) -> None:
    bag = Bag(tmp_path, "sqlite3")
    messages = [(t, "/bodies", bag.markers(t, body(1, t) if t else {})) for t in TIMES]
    path = bag.write(messages)
    with sqlite3.connect(path / "take.db3") as base:
        base.execute("DELETE FROM message_definitions")
    base.close()
    motion = read(path)
    assert motion.of("PELVIS")[1:, 2] == pytest.approx(TIMES[1:], abs=1e-6)
    said = "The bag does not define its messages: those of the latest ROS 2 are used."
    assert said in motion.notes


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_a_bag(tmp_path: Path, kind: str) -> None:
    """A folder with its metadata, or its file alone."""
    bag = Bag(tmp_path, kind)
    path = bag.write([(t, "/bodies", bag.markers(t, body(1, t))) for t in TIMES])
    assert not is_bag_folder(tmp_path)
    if kind == "ros1":
        return
    assert is_bag_folder(path)
    (file,) = [each for each in path.iterdir() if each.suffix != ".yaml"]
    assert len(read(file).time) == 10
