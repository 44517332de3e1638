"""Files that are not what they claim: one clear sentence each, at once, whatever is broken."""

import contextlib
import re
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats import bvh
from ergoqp.mocap.formats.bvh import read_bvh


def small_file() -> str:
    """A person's arm in three frames: enough for the reader, small enough to break in every way."""
    return "\n".join(
        [
            "HIERARCHY",
            "ROOT Hips",
            "{",
            "  OFFSET 0 0 0",
            "  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation",
            "  JOINT Arm",
            "  {",
            "    OFFSET 0 1 0",
            "    CHANNELS 3 Zrotation Xrotation Yrotation",
            "    End Site",
            "    {",
            "      OFFSET 0 1 0",
            "    }",
            "  }",
            "}",
            "MOTION",
            "Frames: 3",
            "Frame Time: 0.1",
            "0 1 0 0 0 0 1 2 3",
            "0 1 0 0 0 0 1 2 3",
            "0 1 0 0 0 0 1 2 3",
            "",
        ]
    )


ROW = "0 1 0 0 0 0 1 2 3"
BROKEN = {
    "cut in a row": (lambda t: t[: t.rindex("1 2 3")], "line 21"),
    "cut between rows": (lambda t: t[: t.rindex(ROW)], "got 2 rows, allowed 3 as stated"),
    "cut in the skeleton": (lambda t: t[: t.index("End Site")], "closing brace"),
    "no motion": (lambda t: t[: t.index("MOTION")], "MOTION"),
    "motion and nothing else": (lambda t: t[: t.index("Frames")], "Frames:"),
    "no frame time": (lambda t: t[: t.index("Frame Time")], "Frame Time:"),
    "no rows": (lambda t: t[: t.index(ROW)].replace("Frames: 3", "Frames: 0"), "0 rows"),
    "empty": (lambda t: "", "empty"),
    "blank": (lambda t: "\n \n\t\n", "empty"),
    "huge frame count": (
        lambda t: t.replace("Frames: 3", "Frames: 100000000"),
        "allowed 100000000 as stated",
    ),
    "absurd frame count": (lambda t: t.replace("Frames: 3", "Frames: " + "9" * 5000), "line 17"),
    "negative frame count": (lambda t: t.replace("Frames: 3", "Frames: -3"), "line 17"),
    "fewer frames stated": (
        lambda t: t.replace("Frames: 3", "Frames: 2"),
        "got 3 rows, allowed 2 as stated",
    ),
    "infinity": (lambda t: t.replace(ROW, "0 1 0 0 0 0 1 2 1e999", 1), "line 19: number 9"),
    "a word in a row": (
        lambda t: t.replace(ROW, "0 1 zero 0 0 0 1 2 3", 1),
        "line 19: number 3 of the row: got 'zero'",
    ),
    "digits joined": (
        lambda t: t.replace(ROW, "0 1_0 0 0 0 0 1 2 3", 1),
        "line 19: number 2 of the row: got '1_0'",
    ),
    "other digits": (
        lambda t: t.replace("Time: 0.1", "Time: \u0660.1"),
        "line 18: the frame time: got",
    ),
    "narrow row": (
        lambda t: t.replace(ROW, "0 1 0 0 0 0 1 2", 1),
        "got a row of 8 numbers, allowed 9",
    ),
    "wide row": (lambda t: t.replace(ROW, ROW + " 4", 1), "got a row of 10 numbers, allowed 9"),
    "frame time zero": (
        lambda t: t.replace("Time: 0.1", "Time: 0"),
        "line 18: the frame time: got 0 s",
    ),
    "frame time NaN": (
        lambda t: t.replace("Time: 0.1", "Time: nan"),
        "line 18: the frame time: got 'nan'",
    ),
    "frame rate as time": (lambda t: t.replace("Time: 0.1", "Time: 120"), "to 10 s"),
    "name with a space": (lambda t: t.replace("JOINT Arm", "JOINT Left Arm"), "without spaces"),
    "unknown channel": (
        lambda t: t.replace("3 Zrotation", "3 Wrotation"),
        "line 9: got the channel 'Wrotation', allowed",
    ),
    "channel twice": (lambda t: t.replace("3 Zrotation", "3 Xrotation"), "got a channel twice"),
    "channel count": (
        lambda t: t.replace("CHANNELS 3", "CHANNELS 4"),
        "line 9: CHANNELS: got 3 channels, allowed the stated number, '4'",
    ),
    "infinite offset": (
        lambda t: t.replace("OFFSET 0 1 0", "OFFSET 0 inf 0", 1),
        "line 8: OFFSET: got 'inf'",
    ),
    "short offset": (
        lambda t: t.replace("OFFSET 0 1 0", "OFFSET 0 1", 1),
        "line 8: OFFSET: got 2 numbers",
    ),
    "lost brace": (
        lambda t: t.replace("{", "", 1),
        "line 4: got 'OFFSET 0 0 0', allowed here is {",
    ),
    "brace too few": (
        lambda t: t.replace("    }\n  }\n", "    }\n"),
        "line 15: got 'MOTION', allowed inside joint 'Hips'",
    ),
    "brace too many": (lambda t: t.replace("{\n", "{\n{\n", 1), "line 4: got '{'"),
    "brace not alone": (lambda t: t.replace("{\n", "{ ", 1), "allowed here is { alone"),
    "two roots": (
        lambda t: t.replace("JOINT Arm", "ROOT Arm"),
        "line 6: got 'ROOT Arm', allowed inside joint 'Hips'",
    ),
    "no root": (
        lambda t: t.replace("ROOT Hips\n", ""),
        "line 2: got '{', allowed here is a line ROOT",
    ),
    "no offset": (lambda t: t.replace("  OFFSET 0 0 0\n", "", 1), "allowed here is a line OFFSET"),
    "offset twice": (
        lambda t: t.replace("  OFFSET 0 0 0\n", "  OFFSET 0 0 0\n" * 2),
        "line 5: got 'OFFSET 0 0 0', allowed here is a line CHANNELS",
    ),
    "end site of nothing": (
        lambda t: t.replace("      OFFSET 0 1 0\n", ""),
        "line 12: got '}', allowed here is a line OFFSET",
    ),
    "joint in an end site": (
        lambda t: t.replace("      OFFSET 0 1 0\n", "      OFFSET 0 1 0\n      JOINT Tip\n"),
        "line 13: got 'JOINT Tip', allowed here is } alone",
    ),
    "no channels": (
        lambda t: re.sub("CHANNELS .*", "CHANNELS 0", t),
        "got a skeleton without channels",
    ),
    "not a BVH": (
        lambda t: "solid cube\n" + t,
        "line 1: a BVH file starts with the line HIERARCHY",
    ),
    "bones between stars": (
        lambda t: t.replace("OFFSET 0 1 0", "OFFSET 0 1e300 0", 1),
        "finite numbers up to",
    ),
}


def message(path: Path) -> str:
    """What the user is told, after checking that it is one line and came at once."""
    start = time.perf_counter()
    with pytest.raises(RecordingError) as caught:
        read_bvh(path)
    assert time.perf_counter() - start < 1.0
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 400
    return text


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_told_with_its_line(name: str, tmp_path: Path):
    change, told = BROKEN[name]
    path = tmp_path / "broken.bvh"
    path.write_text(change(small_file()))
    assert change(small_file()) != small_file()
    assert told in message(path)
    assert "broken.bvh" in message(path)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", bytes(5000), small_file().encode("utf-16")])
def test_bytes_that_are_no_text(content: bytes, tmp_path: Path):
    path = tmp_path / "bytes.bvh"
    path.write_bytes(content)
    assert "bytes.bvh, line 1" in message(path)


def test_places_that_are_no_file(tmp_path: Path):
    assert "no such file" in message(tmp_path / "missing.bvh")
    assert "not a file" in message(tmp_path)
    assert "cannot be read" in message(tmp_path / ("x" * 5000))


def test_a_skeleton_nested_beyond_reason(tmp_path: Path):
    lines = ["HIERARCHY"]
    for i in range(2000):
        lines += [f"{'JOINT' if i else 'ROOT'} j{i}", "{", "OFFSET 0 1 0", "CHANNELS 1 Xrotation"]
    lines += ["}"] * 2000 + ["MOTION", "Frames: 1", "Frame Time: 1", " ".join(["0"] * 2000)]
    path = tmp_path / "deep.bvh"
    path.write_text("\n".join(lines))
    assert "nested too deeply" in message(path)


@pytest.mark.parametrize(
    "change", [lambda t: "\ufeff" + t, lambda t: t.replace("\n", "\r\n"), lambda t: t + "\n\n  \n"]
)
def test_harmless_variants_are_read(change, tmp_path: Path):
    path = tmp_path / "variant.bvh"
    path.write_bytes(change(small_file()).encode())
    assert read_bvh(path).positions.shape == (3, 2, 3)


@pytest.mark.parametrize("block", [1, 2, 3, 100])
def test_blocks_are_as_the_whole(block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    text = small_file().replace(ROW, "0 1 0 0 0 0 9 8 7", 1)
    (tmp_path / "blocks.bvh").write_text(text)
    whole = read_bvh(tmp_path / "blocks.bvh").positions
    monkeypatch.setattr(bvh, "_BLOCK", block)
    np.testing.assert_array_equal(read_bvh(tmp_path / "blocks.bvh").positions, whole)


PIECES = st.sampled_from(
    [
        "{",
        "}",
        "MOTION",
        "JOINT",
        "End Site",
        "OFFSET",
        "CHANNELS 3",
        "Frames: 9",
        "nan",
        "-1e9",
        "\x00",
        "é",
        "\n",
        "",
    ]
)


@pytest.mark.slow
@settings(
    deadline=1000, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_no_mutation_crashes_or_hangs(data: st.DataObject, tmp_path: Path):
    text = small_file()
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 60)))
        text = text[:start] + data.draw(PIECES | st.text(max_size=8)) + text[end:]
    path = tmp_path / "mutated.bvh"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with contextlib.suppress(RecordingError):
        motion = read_bvh(path)
        assert motion.positions.shape == (len(motion.time), len(motion.names), 3)
        assert np.isfinite(motion.positions).all()


@settings(
    deadline=1000, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.binary(max_size=300))
def test_no_bytes_crash_the_reader(content: bytes, tmp_path: Path):
    path = tmp_path / "bytes.bvh"
    path.write_bytes(content)
    with pytest.raises(RecordingError):
        read_bvh(path)
