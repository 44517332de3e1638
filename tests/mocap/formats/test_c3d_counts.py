"""How many frames a C3D file has: the header counts to 65 535, and others say it elsewhere."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_files import BLOCK, CODES, POINT, POINTS, made
from small_files import read, refused, write

from ergoqp.mocap.formats.c3d import read_c3d

LONG = 70_000
"""Frames of a take of an hour at 20 Hz."""


def long_take(folder: Path, trial: Any = None, count: int = LONG, **options: Any) -> Path:
    """Write a take of many frames, by default with the header that Vicon's programs write."""
    points = np.arange(1, 3 * count + 1, dtype=float).reshape(count, 1, 3)
    point = {"LABELS": ["LASI"], "UNITS": "mm", **options.pop("point", {})}
    groups = {} if trial is None else {"TRIAL": trial}
    options = {"last": 65535, "pad": False, **options}
    return write(folder / "a.c3d", made(points, point, groups, **options))


def fields(first: int, last: int) -> dict[str, list[int]]:
    """Return the first and last frame as two words each."""
    return {
        f"ACTUAL_{name}_FIELD": [number % 65536, number // 65536]
        for name, number in (("START", first), ("END", last))
    }


@pytest.mark.parametrize("processor", CODES)
@pytest.mark.parametrize(
    ("point", "trial"),
    [
        ({}, fields(1, LONG)),
        ({}, fields(233, LONG + 232)),
        ({"FRAMES": -1}, fields(1, LONG)),
        ({"LONG_FRAMES": float(LONG)}, None),
        ({"LONG_FRAMES": float(LONG), "FRAMES": -1}, fields(1, LONG)),
        ({"FRAMES": float(LONG)}, None),
        # Whatever else is there is taken if it is what the file holds.
        ({"FRAMES": float(LONG)}, fields(1, 300)),
        ({"FRAMES": LONG % 65536, "LONG_FRAMES": 5.0}, fields(1, LONG)),
    ],
)
def test_a_long_take_is_read_whole(
    point: dict[str, Any], trial: dict[str, Any] | None, processor: str, tmp_path: Path
) -> None:
    motion = read(read_c3d, long_take(tmp_path, trial, point=point, processor=processor))
    assert motion.time[-1] == pytest.approx((LONG - 1) / 100)
    expected = np.arange(1, 3 * LONG + 1, dtype=np.float32).reshape(LONG, 1, 3)
    np.testing.assert_array_equal(motion.positions, expected)
    assert len(motion.notes) == 1


@pytest.mark.parametrize("count", [65536, LONG, 2 * 65536])
@pytest.mark.parametrize("last", [65535, None])
@pytest.mark.parametrize("frames", [{}, {"FRAMES": -1}, {"FRAMES": 65535.0}])
def test_a_long_take_without_a_long_count_is_refused(
    count: int, last: int | None, frames: dict[str, Any], tmp_path: Path
) -> None:
    # Some programs stop to count at 65535, some begin anew.
    path = long_take(tmp_path, count=count, last=count if last is None else last, point=frames)
    refused(
        read_c3d,
        path,
        rf"^a\.c3d: got {count} frames of which .*, allowed a long count"
        r" \(TRIAL:ACTUAL_END_FIELD or POINT:LONG_FRAMES\) beyond 65535; export the take with it,"
        r" or in parts$",
    )


def test_no_frame_is_taken_for_what_fills_the_last_block(tmp_path: Path) -> None:
    # The frames are of 16 bytes: some may be as long as what fills a block.
    for pad in (True, False):
        refused(read_c3d, long_take(tmp_path, count=65536, pad=pad), "got 65536 frames")
        assert len(read(read_c3d, long_take(tmp_path, count=65535, pad=pad)).time) == 65535


def test_a_part_of_a_long_take_whose_last_frame_has_a_large_number(tmp_path: Path) -> None:
    path = long_take(tmp_path, count=10_000, first=60_001)
    refused(read_c3d, path, "got 10000 frames of which 5535 are stated, allowed a long count")
    for point, trial in (({"FRAMES": 10_000}, None), ({}, fields(60_001, LONG))):
        path = long_take(tmp_path, trial, 10_000, first=60_001, point=point)
        assert len(read(read_c3d, path).time) == 10_000


def test_the_header_counts_the_frames_of_what_a_part_was_cut_from(tmp_path: Path) -> None:
    # c3d.org: "the frame numbers of the data that created the C3D file".
    def count(**options: Any) -> int:
        points = np.ones((3, 40, 3))
        point = {"LABELS": [f"M{i}" for i in range(40)], **options.pop("point", {})}
        content = made(points, point, options.pop("groups", None), **options)
        return len(read(read_c3d, write(tmp_path / "a.c3d", content)).time)

    for last in (1000, 2, 0, 65535):
        assert count(last=last, point={"FRAMES": 3}) == 3
        assert count(last=last, point={"FRAMES": 3.0}) == 3
        assert count(last=last, groups={"TRIAL": fields(5, 7)}) == 3
    for wrong in (fields(1, 1000), fields(1, 2), fields(7, 5), fields(0, 2**32 - 1)):
        assert count(groups={"TRIAL": wrong}) == 3
    for wrong in (0.0, 2.0, -7.0, 1e30, np.nan, np.inf, -np.inf, 1000, [], "3"):
        assert count(point={"FRAMES": wrong}) == 3
        assert count(point={"LONG_FRAMES": wrong}) == 3
    for wrong in ([3.0, 0.0], [np.nan, np.inf], [3], [], "3", ["3", "0"], 1.0):
        either = {"ACTUAL_START_FIELD": [1, 0], "ACTUAL_END_FIELD": wrong}
        assert count(groups={"TRIAL": either}) == 3


def test_more_than_is_stated_is_told(tmp_path: Path) -> None:
    content = made(pad=False) + b"\1" * 4 * BLOCK
    motion = read(read_c3d, write(tmp_path / "a.c3d", content))
    np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))
    assert motion.notes[0] == (
        "The file states 3 frames and is long enough for 67: the data after the stated frames is"
        " left out."
    )
    # Turns of segments are kept there, and are no points.
    content = made(groups={"ROTATION": {"USED": 1}}, pad=False) + b"\1" * 4 * BLOCK
    assert len(read(read_c3d, write(tmp_path / "a.c3d", content)).notes) == 1


@pytest.mark.parametrize(
    ("point", "trial"),
    [
        ({"FRAMES": 1e9}, None),
        ({"LONG_FRAMES": 1e9}, None),
        ({}, fields(1, 10**9)),
        ({"FRAMES": 1e9, "LONG_FRAMES": 1e9}, fields(1, 10**9)),
    ],
)
def test_a_billion_frames_take_no_memory(
    point: dict[str, Any], trial: dict[str, Any] | None, tmp_path: Path
) -> None:
    path = long_take(tmp_path, trial, 100, point=point, last=0)
    tracemalloc.start()
    try:
        refused(read_c3d, path, r"got 100 frames, allowed 1000000000 as stated; the file is")
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_no_frames(tmp_path: Path) -> None:
    content = made(np.empty((0, 2, 3)), POINT, pad=False)
    refused(read_c3d, write(tmp_path / "a.c3d", content), "got the frames 1 to 0, allowed 1 and")
    content = made(np.empty((3, 0, 3)), {"LABELS": ["a"]}, analog=5, fourth=np.empty((3, 0)))
    refused(
        read_c3d, write(tmp_path / "a.c3d", content), "got no point in a frame, allowed markers"
    )
