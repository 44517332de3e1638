"""Bags that are cut, broken or of something else: one sentence each."""

from __future__ import annotations

import random
import sqlite3
import sys
from pathlib import Path

import pytest
from ros_bags import KINDS, Bag, body, read

from ergoqp.errors import MissingExtraError, RecordingError

TIMES = [i / 10 for i in range(10)]
DAMAGED = r"^take(\.\w+)?: the bag is damaged or cut off$"


def sentence(path: Path, match: str) -> None:
    with pytest.raises(RecordingError, match=match) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def storage(path: Path) -> Path:
    """Return the file of a bag that holds the messages."""
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")


@pytest.fixture(params=KINDS)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Bag:
    return Bag(tmp_path, request.param)


@pytest.fixture
def ros1(tmp_path: Path) -> Bag:
    return Bag(tmp_path, "ros1")


def people(bag: Bag) -> Path:
    return bag.write([(t, "/bodies", bag.markers(t, body(1, t))) for t in TIMES])


def test_an_empty_bag(bag: Bag) -> None:
    sentence(
        bag.write([]), r"^take.*: got no movement in a bag without topics, allowed messages of"
    )


def test_other_topics_alone(bag: Bag) -> None:
    text = bag.make("std_msgs/msg/String", data="hello")
    path = bag.write([(t, "/chatter", text) for t in TIMES], topics=("/rosout",))
    sentence(path, r"got no movement in .*/chatter \(std_msgs/String\).*tf2_msgs/TFMessage")


def test_frames_that_stand_still_are_nobody(bag: Bag) -> None:
    still = bag.tf(bag.transform(0, "map", "mount", (1, 0, 0)))
    sentence(bag.write([(0.0, "/tf_static", still)]), r"no movement in /tf_static \(tf2_msgs/TFM")


def test_nobody_at_all(ros1: Bag) -> None:
    path = ros1.write([(t, "/bodies", ros1.markers(t, {})) for t in TIMES])
    sentence(path, r"None of the 10 messages of /bodies shows anybody")


def test_a_cut_bag(bag: Bag) -> None:
    path = people(bag)
    file = storage(path)
    whole = file.read_bytes()
    for share in (0.0, 0.001, 0.1, 0.5, 0.9, 0.999):
        file.write_bytes(whole[: int(share * len(whole))])
        name = file.name if path.is_file() else path.name
        sentence(path, rf"^{name}: (the bag|does not begin) [^()]*$")


@pytest.mark.slow
def test_broken_bytes(bag: Bag) -> None:
    """They may do no harm, or be told; another exception fails the test."""
    path = people(bag)
    file = storage(path)
    whole = file.read_bytes()
    chance = random.Random(7)
    told = []
    for _ in range(60):
        broken = bytearray(whole)
        for _ in range(20):
            broken[chance.randrange(len(broken))] = chance.choice((0, 0x7F, 0x80, 0xFF))
        file.write_bytes(broken)
        try:
            read(path)
        except RecordingError as error:
            told.append(str(error))
    assert len(told) > 10
    assert not [text for text in told if "Error" in text or "codec" in text or "\n" in text]


def test_a_broken_list_of_files(tmp_path: Path) -> None:
    path = people(Bag(tmp_path, "mcap"))
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [\n")
    sentence(path, DAMAGED)
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    sentence(path, DAMAGED)


def test_what_a_database_has_instead_of_text(tmp_path: Path) -> None:
    path = storage(people(Bag(tmp_path, "sqlite3")))
    with sqlite3.connect(path) as base:
        for column in ("type", "name"):
            base.execute(f"UPDATE topics SET {column} = 7")
    base.close()
    sentence(path, r"^take\.db3: got no movement in 7 \(7\), allowed messages of")


def test_a_number_that_is_none(tmp_path: Path) -> None:
    path = people(Bag(tmp_path, "mcap"))
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("count: 10", "count: many"))
    sentence(path, DAMAGED)


def test_a_billion_stated_messages_are_not_awaited(tmp_path: Path) -> None:
    path = people(Bag(tmp_path, "mcap"))
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("count: 10", "count: 1000000000"))
    motion = read(path)
    assert len(motion.time) == 10
    assert "The bag states 1000000000 messages on its topics and has 10." in motion.notes


def test_a_billion_stated_markers_are_not_made(ros1: Bag) -> None:
    path = people(ros1)
    raw = path.read_bytes()
    # 32 markers, then the first header without a number.
    count = (32).to_bytes(4, "little") + bytes(4)
    assert raw.count(count) >= 10
    path.write_bytes(raw.replace(count, (10**9).to_bytes(4, "little") + bytes(4)))
    sentence(path, DAMAGED)


def test_a_billion_markers_of_nothing_are_not_made(ros1: Bag) -> None:
    """A bag may define its messages so that a marker takes no byte."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    with Writer(ros1.path) as writer:
        text = "Nothing[] markers\n" + "=" * 80 + "\nMSG: visualization_msgs/Nothing\n"
        store = get_typestore(Stores.EMPTY)
        name = "visualization_msgs/msg/MarkerArray"
        store.register(get_types_from_msg(text, name))
        connection = writer.add_connection("/bodies", name, typestore=store)
        writer.write(connection, 1, (10**9).to_bytes(4, "little"))
    sentence(ros1.path, DAMAGED)


def test_markers_in_two_frames(ros1: Bag) -> None:
    messages = [(t, "/bodies", ros1.markers(t, body(1, t), str(t > 0.5))) for t in TIMES]
    sentence(ros1.write(messages), r"/bodies: got markers in the frames False, True, allowed one")


def test_a_circle_of_frames(ros1: Bag) -> None:
    pair = (("a", "b"), ("b", "a"))
    messages = [
        (t, "/tf", ros1.tf(*(ros1.transform(t, *p, (0, 0, 1)) for p in pair))) for t in TIMES
    ]
    sentence(ros1.write(messages), r"^take\.bag: got the frame '.' of tf inside itself, allowed a")


def test_numbers_without_end(ros1: Bag) -> None:
    messages = [(t, "/bodies", ros1.markers(t, body(1, 1e300))) for t in TIMES]
    sentence(ros1.write(messages), r"^take\.bag: /bodies: got a number that is not finite")


def test_angles_without_names(ros1: Bag) -> None:
    message = ros1.angles(0, {"elbow": 0.0, "wrist": 1.0})
    message.name = ["elbow"]
    path = ros1.write([(0.0, "/arm", message)])
    sentence(path, r"^take\.bag: /arm: got 1 names and 2 positions, allowed as many names")


def test_more_than_anybody_has(ros1: Bag) -> None:
    many = {i: (0, 0, 0) for i in range(1001)}
    path = ros1.write([(t, "/points", ros1.markers(t, many)) for t in TIMES[:2]])
    sentence(path, r"/points has 1001 markers or more and is not read")


def test_no_file_and_no_bag(tmp_path: Path) -> None:
    sentence(tmp_path / "none.bag", r"none\.bag: no such file")
    for name in ("text.bag", "text.db3", "text.mcap"):
        (tmp_path / name).write_text("This is no bag, however long it may be.\n" * 100)
        sentence(tmp_path / name, rf"^{name}: does not begin like a ROS bag$")


def test_marks_in_a_name(tmp_path: Path) -> None:
    path = people(Bag(tmp_path, "sqlite3")).rename(tmp_path / "take#2")
    sentence(path, r"got # in the path of a bag")


def test_without_rosbags_its_extra_is_named(ros1: Bag, monkeypatch: pytest.MonkeyPatch) -> None:
    path = people(ros1)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(MissingExtraError, match=r"reading ROS bags needs the package 'rosbags'"):
        read(path)


@pytest.mark.parametrize("topic", ["/bodies", "/tf", "/cup"])
def test_messages_of_one_time_that_differ(ros1: Bag, topic: str) -> None:
    messages = []
    for i in range(20):
        time, place = 0.1 * (i // 2), (i, 0, 0)
        if topic == "/bodies":
            message = ros1.markers(time, {5: place})
        elif topic == "/tf":
            message = ros1.tf(ros1.transform(time, "map", "hand", place))
        else:
            message = ros1.pose(time, place)
        messages.append((0.05 * i, topic, message))
    sentence(ros1.write(messages), "10 of 20 frames have the time of the frame before and show")
