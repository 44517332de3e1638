"""Bags under other names, in folders with other things, and of kinds that nobody reads."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from ros_bags import KINDS, Bag, body, read

from ergoqp.errors import RecordingError
from ergoqp.mocap.readers import BAG, kind_of, read_motion

TIMES = [i / 10 for i in range(10)]


def file_of(folder: Path, kind: str) -> Path:
    """Return the file of a bag that holds the messages."""
    bag = Bag(folder, kind)
    path = bag.write([(t, "/bodies", bag.markers(t, body(1, t))) for t in TIMES])
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["other.txt", "other", "other.BAG"])
def test_another_ending_is_told(tmp_path: Path, kind: str, name: str) -> None:
    path = file_of(tmp_path, kind)
    ending = path.suffix
    path = path.rename(tmp_path / name)
    assert kind_of(path) is BAG
    said = f"{name}: got a ROS bag with another ending, allowed {ending}: rename it"
    assert sentence(path) == said


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_folder_is_a_bag_by_its_metadata(tmp_path: Path, kind: str) -> None:
    folder = file_of(tmp_path, kind).parent
    (folder / "notes.txt").write_text("Beside the bag.")
    assert len(read_motion(folder).time) == 10
    (folder / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match="is a folder; give the recording file itself"):
        read_motion(folder)


def sentence(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read(path)
    return str(caught.value)


def test_a_version_that_nobody_knows(tmp_path: Path) -> None:
    folder = file_of(tmp_path, "mcap").parent
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("version: 8", "version: 99"))
    assert sentence(folder) == (
        "take: a bag of a kind that rosbags does not read (Rosbag2 version 99 not supported)"
    )


def test_a_part_that_is_not_there(tmp_path: Path) -> None:
    file = file_of(tmp_path, "mcap")
    file.rename(tmp_path / "elsewhere.mcap")
    said = "take: metadata.yaml names files that are missing"
    assert sentence(file.parent) == said


def test_a_bag_whose_recorder_was_stopped(tmp_path: Path) -> None:
    path = file_of(tmp_path, "ros1")
    raw = path.read_bytes()
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(raw[:at] + bytes(8) + raw[at + 8 :])
    assert sentence(path) == ("take.bag: the bag has no index, because its recording was cut off")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_bag_that_may_not_be_read(tmp_path: Path) -> None:
    folder = file_of(tmp_path, "mcap").parent
    (folder / "metadata.yaml").chmod(0)
    assert "Permission denied" in sentence(folder)
