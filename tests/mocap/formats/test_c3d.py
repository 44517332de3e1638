"""C3D files: the points of ezc3d, and those of every computer and program that writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_files import CODES, POINT, POINTS, made, parameter
from small_files import read, write

from ergoqp.mocap.formats.c3d import read_c3d
from ergoqp.mocap.recording import JointMotion

FILES = {
    # file: unit [m], points with a name of their own that are markers, angles
    "c3dorg_Capture0002": (0.001, 18, 0),
    "c3dorg_pc_real": (0.001, 36, 0),
    "millard_neu_t169_f250f350": (0.001, 38, 0),
    "millard_stoop1_t169_f620f800": (0.001, 38, 0),
    "pycgm_Movement_trial": (0.001, 115, 26),
    "pycgm_Sample_Static": (0.001, 111, 26),
    "pyomeca_box_handling": (0.001, 51, 0),
}


def read_made(folder: Path, **options: Any) -> JointMotion:
    return read(read_c3d, write(folder / "a.c3d", made(**options)))


def point(**parameters: Any) -> dict[str, Any]:
    return {**POINT, **parameters}


@pytest.mark.parametrize("name", FILES)
def test_the_points_of_ezc3d(name: str, shared: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    path = shared / "mocap" / "c3d" / f"{name}.c3d"
    unit, markers, angles = FILES[name]
    motion, theirs = read(read_c3d, path), ezc3d.c3d(str(path))
    stated, points = theirs["parameters"]["POINT"], theirs["data"]["points"]
    labels = list(stated["LABELS"]["value"][: points.shape[1]])
    assert len(motion.names) == markers
    assert set(motion.names) <= set(labels)
    assert motion.markers
    assert motion.unit == unit
    assert stated["UNITS"]["value"][0].lower() == "mm"
    rate = float(stated["RATE"]["value"][0])
    np.testing.assert_array_equal(motion.time, np.arange(points.shape[2]) / rate)
    for marker in motion.names:
        expected = points[:3, labels.index(marker)].T.astype(np.float32)
        expected[(expected == 0).all(axis=1)] = np.nan  # a point at the origin is not seen
        np.testing.assert_array_equal(motion.of(marker), expected)
    assert len(motion.angles) == 3 * angles
    for each, values in motion.angles.items():
        label, axis = each.rsplit(" ", 1)
        expected = points["xyz".index(axis), labels.index(label)]
        np.testing.assert_allclose(np.degrees(values), expected, rtol=1e-6, atol=1e-30)


def test_what_was_measured_at_the_person(shared: Path) -> None:
    motion = read(read_c3d, shared / "mocap" / "c3d" / "pycgm_Movement_trial.c3d")
    # Vicon's own figures of the subject, in its mm.
    measured = {"lkneewidth": 0.144, "rkneewidth": 0.139, "lelbowwidth": 0.096, "lleglength": 0.877}
    assert {name: motion.measures[name] for name in measured} == pytest.approx(measured)
    assert "lsoledelta" not in motion.measures
    assert {"LKneeAngles x", "LKneeAngles y", "LKneeAngles z"} <= set(motion.angles)
    assert "LHipMoment" not in motion.names


def test_the_points_times_and_notes(tmp_path: Path) -> None:
    motion = read_made(tmp_path)
    assert motion.names == ("LASI", "RASI")
    np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))
    np.testing.assert_array_equal(motion.time, [0, 0.01, 0.02])
    assert motion.notes == ("The frames are uniform in time, 0.01 s apart.",)
    assert (motion.unit, motion.up, motion.rest, motion.markers) == (0.001, None, None, True)
    assert (dict(motion.angles), dict(motion.measures)) == ({}, {})


@pytest.mark.parametrize("processor", CODES)
@pytest.mark.parametrize("scale", [-0.1, 0.25])
@pytest.mark.parametrize("analog", [0, 7])
@pytest.mark.parametrize("block", [2, 5])
@pytest.mark.parametrize("pad", [True, False])
def test_the_same_frames_of_other_computers(
    processor: str, scale: float, analog: int, block: int, pad: bool, tmp_path: Path
) -> None:
    groups = {"PROCESSING": {"LKneeWidth": 140.0}, "TRIAL": {"CAMERA_RATE": 50.0}}
    motion = read_made(
        tmp_path,
        groups=groups,
        processor=processor,
        scale=scale,
        analog=analog,
        block=block,
        pad=pad,
        fourth=[[513, -1], [0, 0], [-1, 2]],
    )
    expected = POINTS.astype(np.float32)
    expected[0, 1], expected[2, 0] = np.nan, np.nan
    np.testing.assert_array_equal(motion.positions, expected)
    assert motion.time == pytest.approx([0, 0.01, 0.02])
    assert dict(motion.measures) == pytest.approx({"lkneewidth": 0.14})


@pytest.mark.parametrize("processor", ["Intel", "DEC"])  # it reads no MIPS
@pytest.mark.parametrize("scale", [-0.1, 0.25])
def test_ezc3d_reads_what_is_made(processor: str, scale: float, tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    content = made(
        point=point(SCALE=scale),
        groups={"ANALOG": {"USED": 4, "RATE": 100.0, "SCALE": [1.0] * 4, "OFFSET": [0] * 4}},
        processor=processor,
        scale=scale,
        analog=4,
        block=3,
        fourth=[[0, -1], [0, 0], [0, 0]],
    )
    path = write(tmp_path / "a.c3d", content)
    theirs, motion = ezc3d.c3d(str(path)), read(read_c3d, path)
    assert tuple(theirs["parameters"]["POINT"]["LABELS"]["value"]) == motion.names
    np.testing.assert_array_equal(theirs["data"]["points"][:3].T, motion.positions)


def test_what_is_not_seen(tmp_path: Path) -> None:
    points = np.array([[[0, 0, 0], [0, 0, 1]], [[np.nan, 1, 1], [1, np.inf, 1]], [[2e9, 1, 1]] * 2])
    lost = np.full(3, np.nan)
    found = read_made(tmp_path, points=points).positions
    np.testing.assert_array_equal(found, [[lost, [0, 0, 1]], [lost, lost], [lost, lost]])
    # Angles may well be zero.
    labels = point(LABELS=["LKneeAngles", "RASI"], ANGLES=["LKneeAngles"])
    bent = read_made(tmp_path, points=points, point=labels, fourth=[[0, 0], [0, 0], [-1, 0]]).angles
    np.testing.assert_array_equal(bent["LKneeAngles x"], [0, np.nan, np.nan])
    np.testing.assert_array_equal(bent["LKneeAngles y"], [0, np.nan, np.nan])


@pytest.mark.parametrize(
    ("units", "unit"),
    [
        ("mm", 0.001),
        ("MM", 0.001),
        ("mm  ", 0.001),
        ("mm\0\0", 0.001),
        ("cm", 0.01),
        ("m", 1.0),
        ("in", 0.0254),
        ("meters", 1.0),
        ("Millimeters", 0.001),
        (["mm"], 0.001),
        (["mm", "deg"], 0.001),
        ("unknown", None),
        ("", None),
        ([""], None),
        ([], None),
        (3, None),
        ([1.5, 2.5], None),
    ],
)
def test_units(units: Any, unit: float | None, tmp_path: Path) -> None:
    measured = {"PROCESSING": {"LKneeWidth": 140.0}}
    motion = read_made(tmp_path, point=point(UNITS=units), groups=measured)
    assert motion.unit == unit
    # Of what unit such a measure is nobody knows then.
    assert motion.measures == ({} if unit is None else {"lkneewidth": pytest.approx(140 * unit)})


def test_no_units(tmp_path: Path) -> None:
    assert read_made(tmp_path, point={"LABELS": ["LASI", "RASI"]}).unit is None


def test_names_in_small_letters_locked_and_in_any_order(tmp_path: Path) -> None:
    content = made(point={name.lower(): value for name, value in POINT.items()})
    locked = content.replace(b"\x06\x01labels", b"\xfa\x01labels")
    assert locked != content
    assert read(read_c3d, write(tmp_path / "a.c3d", locked)).names == ("LASI", "RASI")
    group = b"\x05\xffPOINT\x03\x00\x00"
    labels, units = (parameter(1, name, POINT[name], "Intel") for name in ("LABELS", "UNITS"))
    behind = made(point={})
    at = behind.index(group)
    moved = labels + units + group
    behind = behind[:at] + moved + behind[at + len(moved) :]
    motion = read(read_c3d, write(tmp_path / "b.c3d", behind))
    assert (motion.names, motion.unit) == (("LASI", "RASI"), 0.001)


def test_what_the_parameters_state_is_surer_than_the_header(tmp_path: Path) -> None:
    motion = read_made(tmp_path, point=point(RATE=50.0))
    assert motion.time == pytest.approx([0, 0.02, 0.04])
    assert motion.notes[0] == (
        "The file states 100 frames per second in its header and 50 in POINT:RATE: the latter are"
        " used."
    )
    assert len(read_made(tmp_path, point=point(RATE=100.0)).notes) == 1
    for rate in (0.0, -60.0, np.nan, np.inf, 1e9):
        assert read_made(tmp_path, rate=rate, point=point(RATE=50.0)).time[1] == 0.02
        motion = read_made(tmp_path, point=point(RATE=rate))
        assert motion.time[1] == 0.01
        assert motion.notes[0] == (
            f"POINT:RATE states {rate:g} frames per second, which no file has: the 100 of the"
            " header are used."
        )
    assert read_made(tmp_path, point=point(SCALE=-0.2)).positions[0, 0, 0] == 1
    assert read_made(tmp_path, scale=0.25, point=point(SCALE=0.5)).positions[0, 0, 0] == 2
