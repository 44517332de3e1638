"""Bags under other names, in folders with other things, and of kinds that nobody reads."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from ros_bags import KINDS, Bag, body, read

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.bag import is_bag
from ergoqp.mocap.readers import BAG, kind_of, read_motion

TIMES = [i / 10 for i in range(10)]


def file_of(folder: Path, kind: str) -> Path:
    """Return the file of a bag that holds the messages."""
    bag = Bag(folder, kind)
    path = bag.write([(t, "/bodies", bag.markers(t, body(1, t))) for t in TIMES])
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name", ["take.txt", "take", "take.BAG", "take.bag", "take.db3", "take.mcap", "t#?%20.db3"]
)
def test_the_ending_does_not_matter(tmp_path: Path, kind: str, name: str) -> None:
    path = file_of(tmp_path, kind)
    path = path.rename(tmp_path / f"of_{kind}_{name}")
    assert kind_of(path) is BAG
    motion = read_motion(path)
    np.testing.assert_allclose(motion.of("PELVIS")[:, 2], TIMES, atol=1e-6)
    said = f"although its ending is {path.suffix or 'none'}" in " ".join(motion.notes)
    assert said == (path.suffix.lower() not in {".bag", ".db3", ".mcap"})


def test_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = file_of(tmp_path, "mcap").rename(tmp_path / "take.dat")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    read(path)
    assert not list((tmp_path / "temporary").iterdir())
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(RecordingError, match=r"^take\.dat: got a bag that is damaged"):
        read(path)
    assert not list((tmp_path / "temporary").iterdir())


def test_where_nobody_may_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = file_of(tmp_path, "mcap").rename(tmp_path / "take.dat")

    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "symlink_to", refuse)
    with pytest.raises(RecordingError) as caught:
        read(path)
    assert str(caught.value) == (
        "take.dat: got a name that rosbags does not accept and that cannot be linked (Operation not"
        " permitted), allowed a name that ends in .mcap and has none of ?#%"
    )


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_folder_is_a_bag_if_it_is_nothing_else(tmp_path: Path, kind: str) -> None:
    file = file_of(tmp_path, kind)
    folder, metadata = file.parent, file.parent / "metadata.yaml"
    (folder / "notes.txt").write_text("Beside the bag.")
    assert is_bag(folder)
    metadata.unlink()
    assert not is_bag(folder)
    with pytest.raises(RecordingError, match="is a folder, allowed the recording file itself"):
        read_motion(folder)
    (folder / "notes.txt").unlink()
    (folder / ".DS_Store").write_text("hidden")
    (folder / f"{file.name}-wal").write_bytes(b"")
    assert is_bag(folder)
    (folder / "more").mkdir()
    assert not is_bag(folder)


def sentence(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read(path)
    return str(caught.value)


def test_a_version_that_nobody_knows(tmp_path: Path) -> None:
    folder = file_of(tmp_path, "mcap").parent
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("version: 8", "version: 99"))
    assert sentence(folder) == (
        "take: got a bag of a kind that rosbags does not read (Rosbag2 version 99 not supported),"
        " allowed a whole ROS bag"
    )


def test_a_part_that_is_not_there(tmp_path: Path) -> None:
    file = file_of(tmp_path, "mcap")
    file.rename(tmp_path / "elsewhere.mcap")
    said = "take: got a metadata.yaml that names missing files, allowed a whole ROS bag"
    assert sentence(file.parent) == said


def test_a_bag_whose_recorder_was_stopped(tmp_path: Path) -> None:
    path = file_of(tmp_path, "ros1")
    raw = path.read_bytes()
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(raw[:at] + bytes(8) + raw[at + 8 :])
    assert sentence(path) == (
        "take.bag: got a bag without an index, because its recording was cut off, allowed a whole"
        " ROS bag"
    )


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_bag_that_may_not_be_read(tmp_path: Path) -> None:
    folder = file_of(tmp_path, "mcap").parent
    (folder / "metadata.yaml").chmod(0)
    assert "Permission denied" in sentence(folder)
