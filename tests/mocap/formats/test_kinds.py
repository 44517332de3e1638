"""Which format a file has, by what is in it and by its ending; whose reader reads it."""

from __future__ import annotations

import bz2
import gzip
import importlib
import lzma
import os
import time
from pathlib import Path
from typing import Any

import pytest
from c3d_files import made
from small_files import MOTIVE, MVNX, STORAGE, TABLE, TRC, write

from ergoqp.arguments import unseen
from ergoqp.errors import InputError, RecordingError
from ergoqp.mocap import readers
from ergoqp.mocap.formats.text import TableOptions
from ergoqp.mocap.readers import KINDS, READERS, Kind, kind_of, read_motion
from ergoqp.registry import GROUPS

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 3 Xposition Yposition Zposition
  End Site
  {
    OFFSET 0 1 0
  }
}
MOTION
Frames: 2
Frame Time: 0.1
0 0 0
1 1 1
"""
FILES: dict[str, tuple[Kind, bytes]] = {
    "bvh": (readers.BVH, BVH.encode()),
    "c3d": (readers.C3D, made()),
    "trc": (readers.TRC, TRC.encode()),
    "storage": (readers.STORAGE, STORAGE.encode()),
    "mvnx": (readers.MVNX, MVNX.encode()),
    "motive": (readers.MOTIVE, MOTIVE.encode()),
}
"""Files whose content tells what they are."""
ENDINGS = sorted({ending for kind in KINDS for ending in kind.endings})
TEXT = "Whatever was in the first line of the letter, it was no movement at all.\n"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("ending", [*ENDINGS, "", ".dat", ".c3d.gz", ".CSV"])
def test_the_content_is_surer_than_the_ending(name: str, ending: str, tmp_path: Path) -> None:
    kind, content = FILES[name]
    path = write(tmp_path / f"take{ending}", content)
    assert kind_of(path) is kind
    motion, notes = read_motion(path), []
    if path.suffix.lower() not in kind.endings:
        notes = [
            f"The file is read as {kind.title} because of its content, although its ending is"
            f" {path.suffix.lower() or 'none'}."
        ]
    assert list(motion.notes) == [*notes, *kind.read(path, unseen, TableOptions()).notes]
    stated = read_motion(path, asked=TableOptions(("neck",), 10.0))
    assert stated.notes[len(notes) :] == (
        "The stated names (columns) are not used: only a table can lack names.",
        "The stated frames per second (rate) are not used: the file has its own times.",
        *motion.notes[len(notes) :],
    )


@pytest.mark.parametrize("begin", ["\ufeff", "\n\n ", "\ufeff\r\n"])
@pytest.mark.parametrize("name", [name for name in FILES if name != "c3d"])
def test_what_stands_before_a_mark_does_not_count(name: str, begin: str, tmp_path: Path) -> None:
    kind, content = FILES[name]
    assert kind_of(write(tmp_path / "take.dat", begin.encode() + content)) is kind


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        ('<?xml version="1.0"?>\n<!-- MVN -->\n<mvnx:mvnx xmlns:mvnx="a">', readers.MVNX),
        ("OpenSim\nversion=1\nEndHeader\r\ntime\ta\n", readers.STORAGE),
        ('"Format Version","1.23"\n', readers.MOTIVE),
        ("#ROSBAG V2.0\n", readers.BAG),
        (b"SQLite format 3\0" + bytes(100), readers.BAG),
        (b"\x89MCAP0\r\n" + bytes(100), readers.BAG),
    ],
)
def test_marks(content: str | bytes, kind: Kind, tmp_path: Path) -> None:
    assert kind_of(write(tmp_path / "take.dat", content)) is kind


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_has_no_mark_is_what_its_ending_tells(ending: str, tmp_path: Path) -> None:
    kind = next(kind for kind in KINDS if ending in kind.endings)
    # A table may be of any program.
    expected = readers.TABLE if kind is readers.MOTIVE else kind
    for content in (TEXT, "", TABLE):
        assert kind_of(write(tmp_path / f"take{ending}", content)) is expected
    assert kind_of(tmp_path / f"missing{ending}") is kind
    with pytest.raises(RecordingError, match=f"missing{ending}: no such file"):
        read_motion(tmp_path / f"missing{ending}", asked=TableOptions(rate=10))


@pytest.mark.parametrize(
    "content",
    [
        TABLE,
        TABLE.replace(",", ";").replace(".", ","),
        TABLE.replace(",", "\t"),
        "\ufeff" + TABLE.replace(",", "  ").replace("\n", "\r\n"),
        "1 2 3 4 5 6\n2 3 4 5 6 7\n",
        "a title\n\n-1e-3,+2,3.,.4,5E+2,6,,\n",
    ],
)
def test_a_text_without_any_mark_may_be_a_table(content: str, tmp_path: Path) -> None:
    assert kind_of(write(tmp_path / "take.dat", content)) is readers.TABLE
    assert kind_of(write(tmp_path / "take", content)) is readers.TABLE


@pytest.mark.parametrize(
    "content",
    [
        "",
        TEXT,
        TEXT * 30 + "1 2 3 4 5 6\n",
        "1 2 3 4 5\n" * 5,
        "10.10.2020 1 2 3 4 5\n",
        "1 2 3 4 5 six\n",
        b"1 2 3 4 5 6\n\0",
        TABLE.encode("utf-16-le"),
        b"\x89PNG\r\n\x1a\n" + bytes(1000),
        b"P" * 1000,
        bytes(range(256)) * 10,
    ],
)
def test_what_is_of_no_known_format_is_told(content: str | bytes, tmp_path: Path) -> None:
    for name in ("take.dat", "take", "take.2"):
        path = write(tmp_path / name, content)
        with pytest.raises(RecordingError) as caught:
            read_motion(path)
        assert str(caught.value) == (
            f"{name}: got the ending {path.suffix!r} and the content of no known format, allowed"
            f" .bvh, .c3d, .trc, .mot, .sto, .mvnx, .csv, .tsv, .txt, .bag, .db3, .mcap"
        )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (gzip.compress(TABLE.encode()), "is compressed; unpack it"),
        (lzma.compress(TABLE.encode()), "is compressed; unpack it"),
        (bz2.compress(TABLE.encode()), "is compressed; unpack it"),
        (b"PK\3\4" + bytes(1000), "is compressed; unpack it first"),
        (b"7z\xbc\xaf\x27\x1c" + bytes(99), "is compressed; unpack"),
        (
            b"PK\3\4" + bytes(26) + b"[Content_Types].xml" + bytes(99),
            "is a file of a spreadsheet program; save it as CSV",
        ),
    ],
    ids=["gzip", "xz", "bzip2", "zip", "7z", "spreadsheet"],
)
@pytest.mark.parametrize("ending", [*ENDINGS, "", ".dat", ".gz", ".xlsx"])
def test_what_is_compressed_is_told(content: bytes, said: str, ending: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=f"^take{ending} {said.replace('[', '.')}"):
        read_motion(write(tmp_path / f"take{ending}", content))


@pytest.mark.parametrize("rows", [",\n", "-;-\n", "\n", "\n-", "endheader,x\n", "\t\n"])
def test_no_begin_takes_long_to_look_at(rows: str, tmp_path: Path) -> None:
    path = write(tmp_path / "take.csv", rows * ((1 << 17) // len(rows)))
    began = time.monotonic()
    assert kind_of(path) is readers.TABLE
    with pytest.raises(RecordingError):
        read_motion(path)
    assert time.monotonic() - began < 20  # it was minutes


@pytest.mark.parametrize(
    "line",
    ["1," * 200 + "x", "1, " * 200 + "x", "1" * 30_000 + "x", "1.5e5" * 9000, "1," * 30_000 + "x"],
)
def test_no_line_takes_long_to_look_at(line: str, tmp_path: Path) -> None:
    path = write(tmp_path / "take.dat", f"{line}\n" * 2)
    began = time.monotonic()
    with pytest.raises(RecordingError, match="content of no known format"):
        kind_of(path)
    assert time.monotonic() - began < 20  # it was minutes


def test_folders(tmp_path: Path) -> None:
    folder = tmp_path / "take.v2"
    folder.mkdir()
    with pytest.raises(RecordingError, match="is a folder; give the recording file itself, a"):
        read_motion(folder)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_bags(kind: str, tmp_path: Path) -> None:
    ros_bags = pytest.importorskip("ros_bags")
    bag = ros_bags.Bag(tmp_path, kind)
    places = {i: [i, 0, 0] for i in range(3)}
    bag.write([(time, "/joints", bag.markers(time, places)) for time in (0.0, 0.1)])
    assert kind_of(bag.path) is readers.BAG
    # A bag that is a folder has no ending, and needs none.
    assert "ending" not in " ".join(read_motion(bag.path).notes)


@pytest.mark.parametrize("name", ["x" * 5000, "x" * 5000 + ".c3d", "a\0b", "a\0b.csv"])
def test_names_that_no_file_has(name: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as caught:
        read_motion(tmp_path / name)
    assert len(str(caught.value)) < 400


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes are of Unix")
@pytest.mark.parametrize("name", ["pipe", "pipe.c3d", "pipe.csv", "pipe.bag", "pipe.dat"])
def test_pipes_are_not_waited_for(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(RecordingError, match="is not a file; give the recording file itself"):
        read_motion(tmp_path / name)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that registers a reader, which raises, for an ending."""

    def install(ending: str) -> None:
        information = tmp_path / "site" / "theirs-1.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text("Name: theirs\nVersion: 1\n")
        text = f"[{GROUPS['reader']}]\n{ending} = json:loads\n"
        (information / "entry_points.txt").write_text(text)
        monkeypatch.syspath_prepend(str(tmp_path / "site"))
        importlib.invalidate_caches()

    return install


@pytest.mark.parametrize("ending", ["csv", ".CSV", "tsv", "txt", "own"])
@pytest.mark.parametrize("name", [*FILES, "table"])
def test_an_own_reader_reads_its_ending(
    installed: Any, ending: str, name: str, tmp_path: Path
) -> None:
    installed(ending)
    content = FILES[name][1] if name in FILES else TABLE
    path = write(tmp_path / f"take.{ending.removeprefix('.')}", content)
    with pytest.raises(
        RecordingError, match=r"got .*Error \(.*, allowed what the reader \w+ reads$"
    ):
        read_motion(path)
    # Other endings are not its, and it is among those that are read.
    with pytest.raises(RecordingError, match=rf"allowed \.bvh, .*\.{path.suffix[1:].lower()}\b"):
        read_motion(write(tmp_path / "take.dat", TEXT))
    assert read_motion(write(tmp_path / "take.c3d", made())).names == ("LASI", "RASI")


@pytest.mark.parametrize("ending", READERS)
def test_no_own_reader_may_have_an_ending_of_ours(
    installed: Any, ending: str, tmp_path: Path
) -> None:
    installed(ending.upper())
    path = write(tmp_path / f"take.{ending}", made())
    with pytest.raises(InputError, match=f"reader {ending}: got an entry point of theirs, allowed"):
        read_motion(path)


def test_endings_of_ours() -> None:
    assert set(READERS) == {"bvh", "c3d", "trc", "mot", "sto", "mvnx", "bag", "db3", "mcap"}
