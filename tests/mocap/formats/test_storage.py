"""OpenSim's motion files: angles in radians, lengths as they are."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from small_files import STORAGE, read, refused, write

from ergoqp.mocap.formats.opensim import is_length, read_storage

UNIFORM = "The frames are uniform in time, 0.1 s apart."
UNSTATED = "The file does not state the unit of its angles: they are taken as "


def test_the_angles_times_and_notes(tmp_path: Path) -> None:
    motion = read(read_storage, write(tmp_path / "a.mot", STORAGE))
    assert motion.names == ()
    assert motion.positions.shape == (3, 0, 3)
    assert list(motion.angles) == ["knee_angle_r", "pelvis_tx"]
    assert motion.angles["knee_angle_r"] == pytest.approx([np.pi / 2, np.pi / 4, 0])
    np.testing.assert_array_equal(motion.angles["pelvis_tx"], [0.5, 0.6, 0.7])
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert (motion.unit, motion.up, motion.notes) == (1.0, "y", (UNIFORM,))


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + STORAGE,
        STORAGE.replace("\n", "\r\n"),
        STORAGE.rstrip(),
        STORAGE.replace("\n", "\t\n"),
        STORAGE.replace("\n", ",,\n").replace("\t", ","),
        STORAGE.replace("\n", ";;\n").replace("\t", ";").replace("0.", "0,"),
        STORAGE.replace("\t", "   "),
        STORAGE.replace("0.1\t45\t", " 0.1 45  ").replace("\t90\t", " 90 ").replace("\t0\t", " 0 "),
        STORAGE.replace("endheader", "EndHeader\n"),
        STORAGE.replace("inDegrees=yes", "inDegrees = Yes"),
        STORAGE.replace("time", '"time"'),
        STORAGE.replace("time", "Time"),
    ],
)
def test_the_same_file_of_other_programs(content: str, tmp_path: Path) -> None:
    motion = read(read_storage, write(tmp_path / "a.sto", content))
    assert motion.angles["knee_angle_r"] == pytest.approx([np.pi / 2, np.pi / 4, 0])
    np.testing.assert_array_equal(motion.angles["pelvis_tx"], [0.5, 0.6, 0.7])
    assert motion.notes == (UNIFORM,)


@pytest.mark.parametrize(
    ("name", "old", "new", "factor", "notes"),
    [
        ("a.mot", "inDegrees=yes", "inDegrees=no", 1, ()),
        ("a.sto", "inDegrees=yes\n", "", 1, (f"{UNSTATED}radians.",)),
        ("a.mot", "inDegrees=yes\n", "", 1, (f"{UNSTATED}radians.",)),
        # SIMM's own files, which state no version.
        (
            "a.mot",
            "version=1\nnRows=3\nnColumns=3\ninDegrees=yes",
            "datacolumns 3\ndatarows 3",
            np.pi / 180,
            (f"{UNSTATED}degrees, as in SIMM's files.",),
        ),
    ],
)
def test_the_unit_of_angles(
    name: str, old: str, new: str, factor: float, notes: tuple[str, ...], tmp_path: Path
) -> None:
    motion = read(read_storage, write(tmp_path / name, STORAGE.replace(old, new)))
    assert motion.angles["knee_angle_r"] == pytest.approx(factor * np.array([90, 45, 0]))
    np.testing.assert_array_equal(motion.angles["pelvis_tx"], [0.5, 0.6, 0.7])
    assert motion.notes == (UNIFORM, *notes)


@pytest.mark.parametrize(
    ("rows", "notes"),
    [
        ("4", ("The file states 4 rows and has 3: all are read.",)),
        ("1000000000", ("The file states 1000000000 rows and has 3: all are read.",)),
        ("9" * 5000, (f"The file states {10**18 - 1} rows and has 3: all are read.",)),
        ("²", ()),
        ("many", ()),
        ("", ()),
    ],
)
def test_the_count_of_rows_is_compared(rows: str, notes: tuple[str, ...], tmp_path: Path) -> None:
    content = STORAGE.replace("nRows=3", f"nRows={rows}")
    assert read(read_storage, write(tmp_path / "a.mot", content)).notes == (*notes, UNIFORM)


def test_a_frame_that_is_there_twice_is_left_out(tmp_path: Path) -> None:
    content = STORAGE.replace("0.1\t45\t0.6", "0.0\t90\t0.5")
    motion = read(read_storage, write(tmp_path / "a.mot", content))
    np.testing.assert_array_equal(motion.angles["pelvis_tx"], [0.5, 0.7])
    other = write(tmp_path / "b.mot", STORAGE.replace("0.1\t45", "0.0\t45"))
    refused(read_storage, other, "^b.mot: 1 of 3 frames have the time of the frame before and show")


BROKEN = {
    "empty": ("", "^a.mot: the file ends in line 0, required is the line endheader"),
    "no endheader": (
        STORAGE.replace("endheader", ""),
        "^a.mot: the file ends in line 11, required is the line endheader",
    ),
    "no endheader in long files": (
        STORAGE.replace("endheader\n", "") + "0.3\t0\t0\n" * 300,
        "line 201: got 200 rows without endheader, allowed a motion file",
    ),
    "head only": (STORAGE[: STORAGE.index("time")], "ends in line 7, required is the names"),
    "names only": (STORAGE[: STORAGE.index("0.0")], "^a.mot: got no row of numbers, allowed"),
    "empty lines": (
        STORAGE.replace("endheader", "endheader" + "\n" * 999),
        "line 401: got no names of columns below endheader",
    ),
    "cut in the head": (STORAGE[:20], "ends in line 2, required is the line endheader"),
    "cut in a row": (STORAGE[:-5], "line 11: got a row of 2 numbers, allowed 3: the file is cut"),
    "no time": (STORAGE.replace("time", "frame"), "line 8: got the first column 'frame', allowed"),
    "no names": (STORAGE.replace("time\tknee_angle_r\tpelvis_tx", "\u2003"), "first column ''"),
    "a word": (STORAGE.replace("45", "4_5"), "line 10: got '4_5', allowed a number"),
    "a wide row": (STORAGE.replace("45", "4\t5"), "line 10: got a row of 4 numbers, allowed 3"),
    "a narrow row": (
        STORAGE.replace("\t", " ").replace(" 45", ""),
        "line 10: got a row of 2 numbers, allowed 3",
    ),
    "infinite": (STORAGE.replace("45", "inf"), "line 10: got a number that is not finite"),
    "time back": (STORAGE.replace("0.1\t", "1\t"), "time runs backwards from frame 2 to 3"),
    "garbage": (bytes(range(256)) * 20, "required is the line endheader"),
    "UTF-16": (STORAGE.encode("utf-16"), "line 1: got text in UTF-16"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    refused(read_storage, write(tmp_path / "a.mot", content), sentence)


def test_which_columns_are_lengths() -> None:
    assert all(map(is_length, ["pelvis_tx", "ground_thorax_ty", "Box_TZ", "box_transx"]))
    assert not any(map(is_length, ["hip_flexion_r", "tx_angle", "shoulder_plane"]))


@pytest.mark.parametrize(
    ("name", "rows", "said"),
    [
        ("opencap_squats", 801, None),
        ("thoracoscapular_ABD01", 1091, None),
        ("thoracoscapular_FLX21", 709, None),
        ("pyomeca_box_ik_comma_badcount", 88, "The file states 250 rows and has 88"),
    ],
)
def test_files_of_others(name: str, rows: int, said: str | None, shared: Path) -> None:
    path = shared / "mocap" / "mot" / f"{name}.mot"
    motion = read(read_storage, path)
    text = path.read_text().replace("\r", "")
    names, *body = re.split(r"endheader,*\n", text)[1].strip().split("\n")
    mark = "," if "," in names else "\t"
    numbers = np.array([[float(word) for word in row.split(mark)] for row in body])
    assert ["time", *motion.angles] == names.split(mark)
    assert numbers.shape == (rows, len(motion.angles) + 1)
    assert motion.time == pytest.approx(numbers[:, 0] - numbers[0, 0])
    for i, (angle, values) in enumerate(motion.angles.items(), 1):
        length = angle[-3:] in {"_tx", "_ty", "_tz"} or "_trans" in angle
        expected = numbers[:, i] if length else np.radians(numbers[:, i])
        assert values == pytest.approx(expected), angle
    assert bool(said) == (said is not None and motion.notes[0].startswith(said))
