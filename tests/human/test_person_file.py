"""Person files and statures that the user gives: read, written, or refused in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ergoqp.errors import InputError
from ergoqp.human import FRACTIONS, Body
from ergoqp.human.body import Marker, believable
from ergoqp.human.person_file import given_person, person_with_markers, write_person
from ergoqp.mocap.assumptions import measured_person

NAMES = ["LASI", "L ASI", "Ärm.1", 'with "quotes" and \\', "tab\tline\nbell\x07", "\x7f", "🦴", ""]


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "me.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_person_file_is_the_body_it_describes(tmp_path: Path) -> None:
    path = written(tmp_path, "stature = 1.82\nmass = 81\n[lengths]\nforearm = 0.27\n")
    body = given_person(path)
    assert (body.stature, body.mass, body.lengths["forearm"]) == (1.82, 81, 0.27)
    assert given_person(str(path)).stature == given_person(1.82).stature == 1.82
    assert person_with_markers(path) == (body, {})
    assert person_with_markers(1.82) == (given_person(1.82), {})


def test_lengths_alone_tell_the_stature(tmp_path: Path) -> None:
    body = given_person(written(tmp_path, "[lengths]\nthigh = 0.43\nshank = 0.43\n"))
    assert body.stature == pytest.approx(0.43 / FRACTIONS["thigh"], rel=0.01)
    assert body.lengths["thigh"] == 0.43


def test_markers_are_read(tmp_path: Path) -> None:
    text = """stature = 1.7
[markers.LASI]
frame = "pelvis"
offset = [0.09, 0.12, 1]
[markers.RTHI]
frame = "right_hip"
offset = [0, -0.1, -0.2]
residual = 0.004
"""
    path = written(tmp_path, text)
    assert person_with_markers(path)[1] == {
        "LASI": Marker("pelvis", (0.09, 0.12, 1.0), 0.0),
        "RTHI": Marker("right_hip", (0.0, -0.1, -0.2), 0.004),
    }
    assert given_person(path).stature == 1.7


@pytest.mark.parametrize(
    "body",
    [
        Body.of_stature(1.68, 62.0),
        Body(1.8, {"trunk": 0.5, "forearm": 0.3}),
        Body.of_lengths({"upper_arm": 0.29}),
        Body.of_stature(1.2),
        Body.of_stature(2.3, 150.0),
    ],
)
def test_what_is_written_is_read_back(tmp_path: Path, body: Body) -> None:
    markers = {
        name: Marker("left_elbow", (0.01 * i, -0.2, 1e-9), 0.001 * i)
        for i, name in enumerate(NAMES)
    }
    path = tmp_path / "me.toml"
    write_person(path, body, markers)
    again = given_person(path)
    assert again.stature == pytest.approx(body.stature, abs=5e-5)
    assert again.mass == pytest.approx(body.mass, abs=0.05)
    assert again.lengths == pytest.approx(body.lengths, abs=5e-5)
    found = person_with_markers(path)[1]
    assert list(found) == NAMES
    for name, marker in markers.items():
        assert found[name].frame == marker.frame
        assert found[name].offset == pytest.approx(marker.offset, abs=5e-5)
        assert found[name].residual == pytest.approx(marker.residual, abs=5e-5)


def test_markers_that_were_never_seen_or_are_nowhere_near_are_not_written(tmp_path: Path) -> None:
    markers = {
        "never": Marker("pelvis", (0.0, 0.0, 0.0), float("nan")),
        "on the floor": Marker("pelvis", (0.0, 3.0, 0.0), 0.1),
        "seen": Marker("pelvis", (0.0, 0.0, 0.0), 0.0),
    }
    write_person(tmp_path / "me.toml", Body(), markers)
    assert list(person_with_markers(tmp_path / "me.toml")[1]) == ["seen"]
    write_person(tmp_path / "me.toml", Body(), {}, ["Of 'a\nb\x7f' nothing.", "Ärm"])
    first, second, third = (tmp_path / "me.toml").read_text(encoding="utf-8").splitlines()[:3]
    assert (first, second) == ("# Of 'a\\u000ab\\u007f' nothing.", "# Ärm")
    assert third == "stature = 1.7500"
    assert person_with_markers(tmp_path / "me.toml")[1] == {}
    with pytest.raises(OSError, match="none"):
        write_person(tmp_path / "none" / "me.toml", Body(), {})


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "required are a stature"),
        ("mass = 80", "required are a stature"),
        ("[lengths]", "required are a stature"),
        ("stature = 1" + 400 * "0", "stature: got "),
        ("stature = 1.8\nmass = 1" + 400 * "0", "mass: got "),
        ("stature = nan", "stature: got nan m, allowed 1.2"),
        ("stature = inf", "stature: got inf m, allowed 1.2"),
        ("stature = true", "stature: got True, allowed a number"),
        ('stature = "tall"', "stature: got 'tall', allowed a number"),
        ("stature = [1.8]", "stature: got [1.8], allowed a number"),
        ("stature = 2020-01-01", "stature: got datetime.date(2020, 1, 1), allowed a number"),
        ("stature = 180", "stature: got 180"),
        ("stature = -1.8", "stature: got -1.8"),
        ("stature = 1.8\nmass = -3", "mass: got -3"),
        ("stature = 1.8\nmass = 0", "mass: got 0 kg, allowed 20 to 300 kg"),
        ("stature = 1.8\nmass = nan", "mass: got nan kg, allowed 20"),
        ("height = 1.8", "got ['height'], allowed stature, mass"),
        ("stature = 1.8\n" + "\n".join(f"k{i} = 1" for i in range(99)), "allowed stature, mass"),
        ("stature = 1.8\nlengths = 0.3", "lengths: got 0.3, allowed a table"),
        ("lengths = [0.3]", "lengths: got [0.3], allowed a table"),
        ("[lengths]\nupper_arm = 'long'", "length of upper_arm: got 'long', allowed a number"),
        ("[lengths]\nupper_arm = 300", "length of upper_arm: got 300"),
        ("stature = 1.8\n[lengths]\nupper_arm = 0.9", "got 0.900 m, allowed 0.201 to 0.536 m"),
        (
            "stature = 1.5\n[lengths]\nupper_arm = 0.4\nthigh = 0.6\nshank = 0.6",
            "length of thigh: got 0.600 m, allowed 0.221 to 0.588 m for a stature of 1.50 m",
        ),
        ("stature = 1.9\n[lengths]\nshank = 0.2", "length of shank: got 0.200 m, allowed 0.280"),
        ("[lengths]\nthigh = 0.43\nshank = 0.43\nneck = 0.18", "length of neck: got 0.180 m"),
        ("stature = 1.8\n[lengths]\nupperarm = 0.3", "got ['upperarm'], allowed"),
        ("stature = ", "not a TOML file"),
        ("\x00", "not a TOML file"),
    ],
)
def test_what_describes_nobody_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(InputError) as told:
        given_person(written(tmp_path, text))
    assert sentence in str(told.value)
    assert str(told.value).count("me.toml") == 1
    assert "\n" not in str(told.value)
    assert len(str(told.value)) < 350


LASI = "stature = 1.8\n[markers.LASI]\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("stature = 1.8\nmarkers = 3", "markers: got 3, allowed a table for each marker"),
        (
            "stature = 1.8\n[markers]\nLASI = 3",
            "markers.LASI: got 3, allowed a table of frame, offset",
        ),
        (
            "stature = 1.8\n[markers]\nLASI = {}",
            "markers.LASI.frame: got None, allowed pelvis, trunk",
        ),
        (LASI + "at = 'pelvis'", "markers.LASI: got {'at': 'pelvis'}, allowed a table of frame"),
        (
            LASI + "frame = 'hip'\noffset = [0, 0, 0]",
            "markers.LASI.frame: got 'hip', allowed pelvis",
        ),
        (LASI + "frame = []\noffset = [0, 0, 0]", "markers.LASI.frame: got [], allowed pelvis"),
        (LASI + "frame = 'pelvis'", "markers.LASI.offset: got None, allowed three lengths in m"),
        (LASI + "frame = 'pelvis'\noffset = [0, 0]", "offset: got [0, 0], allowed three lengths"),
        (LASI + "frame = 'pelvis'\noffset = 'here'", "offset: got 'here', allowed three lengths"),
        (LASI + "frame = 'pelvis'\noffset = [0, 'a', 0]", "offset: got 'a', allowed a number"),
        (LASI + "frame = 'pelvis'\noffset = [0, nan, 0]", "offset: got nan, allowed -2 to 2"),
        (
            LASI + "frame = 'pelvis'\noffset = [90, 120, 10]",
            "offset: got 90, allowed -2 to 2",
        ),
        (
            LASI + "frame = 'pelvis'\noffset = [0, 0, 0]\nresidual = -1",
            "residual: got -1 m, allowed",
        ),
        (
            LASI + "frame = 'pelvis'\noffset = [0, 0, 0]\nresidual = inf",
            "residual: got inf m, allowed",
        ),
    ],
)
def test_markers_that_sit_nowhere_are_refused(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(InputError) as told:
        given_person(written(tmp_path, text))
    assert sentence in str(told.value)
    assert str(told.value).startswith("person file me.toml: markers")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("person", [10**400, float("nan"), True, [1.8], {"stature": 1.8}, b"me"])
def test_a_stature_that_is_none_is_refused(person: Any) -> None:
    with pytest.raises(InputError, match=r"got .*allowed"):
        given_person(person)


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize("stature", [1.20004, 1.39183, 1.64638, 2.29996])
def test_who_is_measured_can_be_read_again(tmp_path: Path, stature: float, high: bool) -> None:
    # At the very ends of what is taken for a person's, and rounded in the file.
    lengths = {name: believable(name, stature)[high] for name in FRACTIONS}
    body, average = measured_person(lengths, stature)
    assert not average
    write_person(tmp_path / "me.toml", body, {})
    again = given_person(tmp_path / "me.toml")
    assert again.lengths == pytest.approx(body.lengths, abs=5e-5)


def test_a_file_without_a_name() -> None:
    for nowhere in ("", ".", Path()):
        with pytest.raises(InputError, match=r"^person file: got '.?', allowed a file$"):
            given_person(nowhere)


@pytest.mark.parametrize("path", ["none.toml", "", ".", "a\x00b", "x" * 5000])
def test_a_file_that_is_none(path: str) -> None:
    with pytest.raises(
        InputError, match=r"^person file: .*(no such file|cannot be read: .*|allowed a file)$"
    ):
        given_person(path)
