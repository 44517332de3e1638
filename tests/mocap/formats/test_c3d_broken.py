"""C3D files that are cut, contradict themselves or were changed at random: one sentence each."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from c3d_files import BLOCK, CODES, POINT, POINTS, made, parameter, words
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_files import read, refused, write

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.c3d import read_c3d

GROUPS = {
    "TRIAL": {"ACTUAL_START_FIELD": [1, 0], "ACTUAL_END_FIELD": [3, 0]},
    "PROCESSING": {"LKneeWidth": 140.0},
}
STATED = {
    **POINT,
    "LABELS": ["LASI", "LKneeAngles"],
    "ANGLES": ["LKneeAngles"],
    "ANGLE_UNITS": "deg",
    "SCALE": -0.1,
    "RATE": 100.0,
    "FRAMES": 3,
    "LONG_FRAMES": 3.0,
}
WHOLE = {
    "floats": made(POINTS, STATED, GROUPS, analog=2, fourth=[[0, 0], [-1, 0], [0, -1]]),
    "integers": made(POINTS, {**STATED, "SCALE": 0.25}, GROUPS, scale=0.25),
    "DEC": made(POINTS, STATED, GROUPS, processor="DEC"),
    "MIPS": made(POINTS, STATED, GROUPS, processor="MIPS", block=3),
    "header only": made(POINTS, {"LABELS": ["LASI", "RASI"]}),
}
BEGIN = 1100
"""Bytes in which most of the structure is."""
SLOW = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]


def check(path: Path) -> bool:
    """Check that a file is read well, or refused well; return which."""
    try:
        motion = read(read_c3d, path)
    except RecordingError as error:
        text = str(error)
        assert text.startswith((path.name, "'"))
        assert "\n" not in text
        assert len(text) < 600
        return False
    count = len(motion.time)
    assert count
    assert np.isfinite(motion.time).all()
    assert (np.diff(motion.time) > 0).all()
    assert motion.positions.shape == (count, len(motion.names), 3)
    assert not np.isinf(motion.positions).any()
    assert len(set(motion.names)) == len(motion.names)
    assert all(name.strip() and name.isprintable() for name in motion.names)
    for values in motion.angles.values():
        assert values.shape == (count,)
        assert not np.isinf(values).any()
    assert np.isfinite(list(motion.measures.values())).all()
    assert all(note.isprintable() and len(note) < 1000 for note in motion.notes)
    return True


def changed(content: bytes, at: int, new: bytes) -> bytes:
    return content[:at] + new + content[at + len(new) :]


@pytest.mark.parametrize("name", WHOLE)
def test_no_cut_breaks_it(name: str, tmp_path: Path) -> None:
    content, path = WHOLE[name], tmp_path / "a.c3d"
    whole = next(i for i in range(len(content), 0, -1) if content[i - 1])
    for end in range(len(content) + 1):
        if end % 100 and not any(content[end - 1 : end + 1]):
            continue  # in zeros
        good = check(write(path, content[:end]))
        # What fills the last block, and zeros, are no frames.
        assert not good if end < whole else good or end < whole + 16


@pytest.mark.parametrize(
    ("end", "sentence"),
    [
        (0, "got no C3D header, allowed 512 bytes of which the second is 80"),
        (511, "got no C3D header"),
        (512, "parameters: got block 2, allowed a block in the file; the file is cut"),
        (515, "parameters: got block 2, allowed a block in the file; the file is cut"),
        (530, "got parameters that end within 'LA', allowed a complete file"),
        (540, "got parameters that end within 'LABELS', allowed a complete file"),
        (1024, "got 0 frames, allowed 3 as stated; the file is cut"),
        (1024 + 95, "got 2 frames, allowed 3 as stated; the file is cut"),
    ],
)
def test_a_cut_file_is_told(end: int, sentence: str, tmp_path: Path) -> None:
    content = made(point={**POINT, "FRAMES": 3})
    refused(read_c3d, write(tmp_path / "a.c3d", content[:end]), rf"^a\.c3d: {sentence}")


@pytest.mark.parametrize(
    ("at", "new", "sentence"),
    [
        (0, b"\0", "parameters: got block 0, allowed a block after the header"),
        (0, b"\1", "parameters: got block 1, allowed a block after the header"),
        (0, b"\xff", "parameters: got block 255, allowed a block in the file"),
        (1, b"Q", "got no C3D header, allowed 512 bytes of which the second is 80"),
        (515, b"\0", r"processor: got 0, allowed 84 \(Intel\), 85 \(DEC\), 86 \(MIPS\)"),
        (515, b"W", "processor: got 87, allowed"),
        (2, b"\0\0", "got no point in a frame"),
        (2, b"\xff\xff", "got 0 frames, allowed 3"),
        (4, b"\xff\xff", "got 0 frames, allowed 3"),
        (12, bytes(4), "scale of the points: got 0, allowed a number that is not 0"),
        (12, b"\0\0\xc0\x7f", "scale of the points: got nan, allowed"),
        (12, b"\0\0\x80\x7f", "scale of the points: got inf, allowed"),
        (16, b"\0\0", "begin of the frames: got byte -512, allowed a byte after the parameters"),
        (16, b"\1\0", "begin of the frames: got byte 0, allowed a byte after the parameters"),
        (16, b"\2\0", "begin of the frames: got byte 512, allowed a byte after the parameters"),
        (16, b"\xff\xff", "got 0 frames, allowed 3 as stated; the file is cut"),
        (20, bytes(4), "frames per second: got 0, allowed 1 to 100000"),
        (20, b"\0\0\xc0\x7f", "frames per second: got nan, allowed 1 to 100000"),
        (20, b"\0\0\x80\x7f", "frames per second: got inf, allowed 1 to 100000"),
        (20, b"\0\0\x80\xff", "frames per second: got -inf, allowed 1 to 100000"),
        (20, b"\0\0\0\x3f", "frames per second: got 0.5, allowed 1 to 100000"),
    ],
)
def test_a_wrong_header_is_told(at: int, new: bytes, sentence: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.c3d", changed(made(), at, new))
    refused(read_c3d, path, rf"^a\.c3d: {sentence}")


def test_integers_beyond_all_reason_are_not_seen(tmp_path: Path) -> None:
    for scale in (1e38, 1e-45, 3e34):
        content = made(np.zeros((1, 1, 3)), {"LABELS": ["a"]}, scale=scale)
        content = changed(content, 1024, words([30000, -30000, 1, 0], "Intel"))
        assert check(write(tmp_path / "a.c3d", content))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("LABELS", (-1, (0, 255, 255, 255, 255), b"")),
        ("LABELS", (-1, (255, 255, 255), b"ab")),
        ("LABELS", (-1, (0,), b"")),
        ("LABELS", (-1, (2, 0), b"")),
        ("LABELS", (4, (1,) * 100, b"\0\0\0\0")),
        ("UNITS", (2, (1,) * 255, b"\0\0")),
        ("UNITS", (-1, (1,) * 255, b"m")),
        ("FRAMES", (2, (0, *(255,) * 40), b"")),
        ("FRAMES", (2, (0, *(255,) * 7), b"")),
        ("FRAMES", (1, (), b"\x03")),
        ("FRAMES", (3, (), b"\0\0\0")),
        ("FRAMES", (-2, (), b"\0\0")),
        ("ANGLE_UNITS", (4, (2,), bytes(8))),
    ],
)
def test_parameters_of_wild_shapes(
    name: str, value: tuple[int, tuple[int, ...], bytes], tmp_path: Path
) -> None:
    began = time.monotonic()
    good = check(write(tmp_path / "a.c3d", made(point={**POINT, name: value})))
    assert good == (name != "LABELS")
    assert time.monotonic() - began < 1


@pytest.mark.parametrize("shape", [(4, 1), (1, 255)])
def test_many_parameters_are_read_soon(shape: tuple[int, int], tmp_path: Path) -> None:
    # As many as 255 blocks hold, each of which is short or states that it is long.
    begun = parameter(1, "A", (-1, shape, b"LASI"), "Intel")
    content = made(point=POINT)
    head, behind = content[:512], content[1024:]
    block = content[512:1024].rstrip(b"\0") + begun * (254 * 512 // len(begun))
    block = changed(block.ljust(255 * BLOCK, b"\0"), 2, b"\xff")
    content = changed(head, 16, words(2 + 255, "Intel")) + block + behind
    began = time.monotonic()
    motion = read(read_c3d, write(tmp_path / "a.c3d", content))
    assert time.monotonic() - began < 2
    np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))


def test_places_that_are_no_file(tmp_path: Path) -> None:
    refused(read_c3d, tmp_path / "missing.c3d", "no such file")
    refused(read_c3d, tmp_path, "is not a file")
    refused(read_c3d, tmp_path / ("x" * 5000), "cannot be read")


@pytest.mark.parametrize("processor", CODES)
@settings(deadline=2000, max_examples=100, suppress_health_check=SLOW)
@given(data=st.data())
def test_no_bits_of_frames_break_it(processor: str, data: st.DataObject, tmp_path: Path) -> None:
    scale = data.draw(st.sampled_from([-0.1, 0.25, 1e37, 1e-37]))
    content = made(0 * POINTS, processor=processor, scale=scale, analog=1, pad=False)
    new = data.draw(st.binary(min_size=26, max_size=102))
    assert check(write(tmp_path / "a.c3d", changed(content, len(content) - len(new), new)))


@pytest.mark.parametrize("name", WHOLE)
@settings(deadline=2000, max_examples=150, suppress_health_check=SLOW)
@given(data=st.data())
def test_no_change_of_bytes_breaks_it(name: str, data: st.DataObject, tmp_path: Path) -> None:
    content = bytearray(WHOLE[name])
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, 25) | st.integers(512, BEGIN) | st.integers(0, 2000))
        value = data.draw(st.sampled_from([0, 1, 2, 127, 128, 254, 255]) | st.integers(0, 255))
        content[min(at, len(content) - 1)] = value
    end = data.draw(st.just(len(content)) | st.integers(0, len(content)))
    check(write(tmp_path / "a.c3d", bytes(content[:end])))


@pytest.mark.parametrize("name", WHOLE)
@settings(deadline=2000, max_examples=100, suppress_health_check=SLOW)
@given(data=st.data())
def test_nothing_put_in_or_taken_out_breaks_it(
    name: str, data: st.DataObject, tmp_path: Path
) -> None:
    content = WHOLE[name]
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, BEGIN))
        end = data.draw(st.integers(start, start + 40))
        new = data.draw(st.binary(max_size=12) | st.just(content[start:end] * 2))
        content = content[:start] + new + content[end:]
    check(write(tmp_path / "a.c3d", content))


@settings(deadline=2000, max_examples=100, suppress_health_check=SLOW)
@given(content=st.binary(max_size=2000))
def test_no_bytes_break_it(content: bytes, tmp_path: Path) -> None:
    check(write(tmp_path / "a.c3d", b"\2\x50" + content))
