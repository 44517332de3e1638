"""C3D files: the points of ezc3d, and those of every computer and program that writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_files import CODES, POINT, POINTS, made, parameter
from small_files import read, refused, write

from ergoqp.recordings.formats.c3d import read_c3d
from ergoqp.recordings.motion import JointMotion

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


@pytest.mark.parametrize(
    "processor", ["Intel", "DEC"]
)  # it reads neither MIPS nor integers rightly
def test_ezc3d_reads_what_is_made(processor: str, tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    content = made(processor=processor, analog=4, block=3, fourth=[[0, -1], [0, 0], [0, 0]])
    path = write(tmp_path / "a.c3d", content)
    theirs = ezc3d.c3d(str(path))
    motion = read(read_c3d, path)
    assert tuple(theirs["parameters"]["POINT"]["LABELS"]["value"]) == motion.names
    np.testing.assert_array_equal(theirs["data"]["points"][:3].T, motion.positions)


def test_what_is_not_seen(tmp_path: Path) -> None:
    points = np.array(
        [[[0, 0, 0], [0, 0, 1]], [[np.nan, 1, 1], [1, np.inf, 1]], [[1e31, 1, 1]] * 2]
    )
    lost = np.full(3, np.nan)
    found = read_made(tmp_path, points=points).positions
    np.testing.assert_array_equal(found, [[lost, [0, 0, 1]], [lost, lost], [lost, lost]])
    # Angles may well be zero.
    labels = point(LABELS=["LKneeAngles", "RASI"], ANGLES=["LKneeAngles"])
    bent = read_made(tmp_path, points=points, point=labels, fourth=[[0, 0], [0, 0], [-1, 0]]).angles
    np.testing.assert_array_equal(bent["LKneeAngles x"], [0, np.nan, np.nan])
    np.testing.assert_allclose(bent["LKneeAngles y"], [0, np.pi / 180, np.nan], rtol=1e-6)


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


MODEL = ["LASI", "LKneeAngles", "LKneeForce", "LKneeMoment", "LKneePower", "CentreOfMass", "Axis"]
GROUPED = {
    "LABELS": MODEL,
    "UNITS": "mm",
    "ANGLES": ["LKneeAngles"],
    "FORCES": "LKneeForce",
    "MOMENTS": ["LKneeMoment", ""],
    "POWERS": ["LKneePower"],
    "REACTIONS": ["CentreOfMass"],
    "MODELED_MARKERS": ["Axis"],
}


@pytest.mark.parametrize(
    ("units", "factor"),
    [
        (None, np.pi / 180),
        ("deg", np.pi / 180),
        ("Degrees", np.pi / 180),
        (["deg"], np.pi / 180),
        ("", np.pi / 180),
        ("°", np.pi / 180),
        ([1, 2], np.pi / 180),
        ("rad", 1.0),
        (["Radians"], 1.0),
    ],
)
@pytest.mark.parametrize("prefix", ["", "Ann:"])
def test_what_a_model_computed(units: Any, factor: float, prefix: str, tmp_path: Path) -> None:
    points = np.arange(1, 43, dtype=float).reshape(2, 7, 3)
    stated = {**GROUPED, "LABELS": [prefix + name for name in MODEL]}
    stated |= {} if units is None else {"ANGLE_UNITS": units}
    motion = read_made(tmp_path, points=points, point=stated)
    assert motion.names == (f"{prefix}LASI",)
    assert "5 points are computed (forces, moments, powers) and left out." in motion.notes
    assert set(motion.angles) == {f"{prefix}LKneeAngles {axis}" for axis in "xyz"}
    for i, axis in enumerate("xyz"):
        bent = motion.angles[f"{prefix}LKneeAngles {axis}"]
        np.testing.assert_allclose(bent, factor * points[:, 1, i], rtol=1e-6)


@pytest.mark.parametrize(
    ("labels", "names", "note"),
    [
        (["LASI", "LASI"], ("LASI",), "LASI: there twice; the first is taken."),
        (["LASI", ""], ("LASI",), "1 of 2 points have no label and are left out."),
        (["*12", "RASI"], ("RASI",), "1 of 2 points have no label and are left out."),
        (["Ann:*12", "Ann:RASI"], ("Ann:RASI",), "1 of 2 points have no label"),
        (["U3", "RASI"], ("RASI",), "1 of 2 points have no label and are left out."),
        (["Unlabelled 7", "RASI"], ("RASI",), "1 of 2 points have no label and are left out."),
        (["LASI"], ("LASI",), "1 of 2 points have no label and are left out."),
        (["LASI", "RASI", "C7"], ("LASI", "RASI"), "The file names 3 points and has 2: the first"),
        (["LASI", "RASI", "", ""], ("LASI", "RASI"), None),
        (["Hüfte", "épaule"], ("Hüfte", "épaule"), None),
        (["R knee (out)", "r knee"], ("R knee (out)", "r knee"), None),
        (["a\nb", "c\0\0d\x1b"], ("a b", "c  d"), None),
    ],
)
def test_labels(
    labels: list[str], names: tuple[str, ...], note: str | None, tmp_path: Path
) -> None:
    motion = read_made(tmp_path, point=point(LABELS=labels))
    assert motion.names == names
    np.testing.assert_array_equal(
        motion.of(names[-1])[0], POINTS[0, 1 if len(names) > 1 else 0]
    ) if (note is None) else None
    assert len(motion.notes) == (1 if note is None else 2)
    assert motion.notes[0].startswith(note or "The frames are uniform")


def test_labels_of_windows_programs(tmp_path: Path) -> None:
    labels = (-1, (5, 2), "Hüfteépaul".encode("latin-1"))
    assert read_made(tmp_path, point=point(LABELS=labels)).names == ("Hüfte", "épaul")


def test_many_labels_that_are_there_twice_are_one_sentence(tmp_path: Path) -> None:
    points = np.ones((2, 200, 3))
    labels = [f"{i // 4} marker" for i in range(200)]
    motion = read_made(tmp_path, points=points, point=point(LABELS=labels))
    assert len(motion.names) == 50
    assert motion.notes[0].startswith("0 marker, 1 marker, ")
    assert motion.notes[0].endswith("and 38 more: there twice; the first is taken.")


@pytest.mark.parametrize("count", [255, 256, 300, 511, 700])
def test_more_labels_than_a_parameter_holds(count: int, tmp_path: Path) -> None:
    points = np.arange(1, 3 * count + 1, dtype=float).reshape(1, count, 3)
    labels = [f"marker{i:03d} of the left hand" for i in range(count)]
    stated = {"LABELS": labels[:255], "LABELS2": labels[255:510], "LABELS3": labels[510:]}
    motion = read_made(tmp_path, points=points, point={k: v for k, v in stated.items() if v})
    assert motion.names == tuple(labels)
    np.testing.assert_array_equal(motion.positions, points)


def test_long_labels(tmp_path: Path) -> None:
    # The length of a parameter is read without a sign: 49 980 bytes are too many for one with.
    labels = [f"{i:03d}".rjust(196, "x") for i in range(255)]
    stated = {"LABELS": labels, "UNITS": "mm"}
    motion = read_made(tmp_path, points=np.ones((1, 255, 3)), point=stated)
    assert (motion.names, motion.unit) == (tuple(labels), 0.001)


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
        " taken."
    )
    assert len(read_made(tmp_path, point=point(RATE=100.0)).notes) == 1
    for rate in (0.0, -1.0, np.nan, np.inf):
        assert read_made(tmp_path, rate=rate, point=point(RATE=50.0)).time[1] == 0.02
        assert read_made(tmp_path, point=point(RATE=rate)).time[1] == 0.01
    assert read_made(tmp_path, point=point(SCALE=-0.2)).positions[0, 0, 0] == 1
    assert read_made(tmp_path, scale=0.25, point=point(SCALE=0.5)).positions[0, 0, 0] == 2


def test_markers_are_asked_for(tmp_path: Path) -> None:
    labels = point(LABELS=["LKneeAngles", "*1"], ANGLES=["LKneeAngles"])
    for stated in (labels, point(LABELS=["", "*7"]), {}, {"LABELS2": ["a", "b"]}, point(LABELS=3)):
        path = write(tmp_path / "a.c3d", made(point=stated))
        refused(read_c3d, path, r"^a\.c3d: got no marker with a name among 2 points, allowed")
