"""Names of the points in a C3D file: of markers, of what a model computed, and of nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_files import POINT, POINTS, made
from small_files import read, refused, write

from ergoqp.mocap.formats.c3d import read_c3d
from ergoqp.mocap.recording import JointMotion


def read_made(folder: Path, **options: Any) -> JointMotion:
    return read(read_c3d, write(folder / "a.c3d", made(**options)))


def point(**parameters: Any) -> dict[str, Any]:
    return {**POINT, **parameters}


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
        (
            ["LASI", "LASI"],
            ("LASI",),
            "In the file more than once with different numbers, of which the first is used and the"
            " others are left out: LASI (up to ",
        ),
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
    for i, name in enumerate(names):
        at = labels.index(name) if name in labels else i
        np.testing.assert_array_equal(motion.of(name), POINTS[:, at].astype(np.float32))
    assert len(motion.notes) == (1 if note is None else 2)
    assert any(each.startswith(note or "The frames are uniform") for each in motion.notes)


def test_labels_of_windows_programs(tmp_path: Path) -> None:
    labels = (-1, (5, 2), "Hüfteépaul".encode("latin-1"))
    assert read_made(tmp_path, point=point(LABELS=labels)).names == ("Hüfte", "épaul")


def test_many_labels_that_are_there_twice_are_one_sentence(tmp_path: Path) -> None:
    points = np.ones((2, 200, 3))
    labels = [f"{i // 4} marker" for i in range(200)]
    motion = read_made(tmp_path, points=points, point=point(LABELS=labels))
    assert len(motion.names) == 50
    said = next(note for note in motion.notes if note.startswith("In the file more than once"))
    assert "used: 0 marker, 1 marker, " in said
    assert said.endswith("and 38 more.")


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


def test_markers_are_asked_for(tmp_path: Path) -> None:
    labels = point(LABELS=["LKneeAngles", "*1"], ANGLES=["LKneeAngles"])
    for stated in (labels, point(LABELS=["", "*7"]), {}, {"LABELS2": ["a", "b"]}, point(LABELS=3)):
        path = write(tmp_path / "a.c3d", made(point=stated))
        refused(read_c3d, path, r"^a\.c3d: got no marker with a name among 2 points, allowed")
