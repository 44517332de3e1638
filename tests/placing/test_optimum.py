"""What was found, as a file and back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from ergoqp import JOINTS, load_problem
from ergoqp.cli.optimise import optimum_table
from ergoqp.errors import InputError
from ergoqp.placing.optimum import Optimum, StartResult
from ergoqp.problem.geometry import turn_about
from ergoqp.rest.model_person import sample_person


@pytest.fixture
def optimum():
    person = sample_person(load_problem("dentist"), 3).response
    pose, posture = np.eye(4), person.comfort + 1 / 3
    pose[:3, 3] = 0.1, 0.2, 0.3
    pose[:3, :3] = turn_about(1, 0.4) @ turn_about(2, -2.9)
    trial = StartResult(0, pose, posture, 3, 2.5, 1e-9, 1e-5, 0.01)
    return Optimum(
        "dentist",
        "treats",
        "stackelberg",
        "ipopt",
        4,
        person,
        pose,
        posture,
        7,
        3,
        1e-9,
        6.5,
        2.5,
        0.5,
        pose,
        posture,
        (trial, StartResult(1, pose, posture, 0, 2.5, 1e-9, 1e-5, 0.01, "out of reach")),
        ("Said.",),
    )


def test_saved_and_loaded(optimum, tmp_path):
    path = optimum.save(tmp_path / "new" / "folder")
    assert path.name == "optimum.json"
    again = Optimum.load(path.parent)
    for one, other in zip((again, *again.trials), (optimum, *optimum.trials), strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-14)
    plain = {"pose", "pose_before", "trials"}
    assert {k: v for k, v in again.as_dict().items() if k not in plain} == {
        k: v for k, v in optimum.as_dict().items() if k not in plain
    }
    np.testing.assert_array_equal(again.response.weight_vector, optimum.response.weight_vector)
    np.testing.assert_array_equal(again.posture, optimum.posture)
    assert again.trials[1].note == "out of reach"
    assert json.loads(path.read_text(encoding="utf-8"))["joints"] == list(JOINTS)


def test_says_what_it_found(optimum):
    assert "REBA 7 -> 3 with the object at (0.10, 0.20, 0.30) m" in repr(optimum)


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"problem": 3}'])
def test_no_optimum(text, tmp_path):
    path = tmp_path / "optimum.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"is no optimum|not JSON"):
        Optimum.load(path)


def test_not_there(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Optimum.load(tmp_path / "none.json")


def test_wrong_shape(optimum, tmp_path):
    path = optimum.save(tmp_path / "a.json")
    values = json.loads(path.read_text(encoding="utf-8"))
    values["posture"] = values["posture"][:31]
    path.write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(InputError, match=r"is no optimum|not JSON"):
        Optimum.load(path)


def test_pose_that_is_none(optimum, tmp_path):
    path = optimum.save(tmp_path / "a.json")
    values = json.loads(path.read_text(encoding="utf-8"))
    values["pose"]["quaternion_xyzw"] = [0, 0, 0, 0]
    path.write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(InputError, match=r"is no optimum|not JSON"):
        Optimum.load(path)


def test_documented(optimum):
    """Every key of the file is in its documentation."""
    text = (Path(__file__).resolve().parents[2] / "docs" / "optimum_json.md").read_text(
        encoding="utf-8"
    )
    values = optimum.as_dict()
    for key in (*values, *values["trials"][0]):
        assert f"`{key}`" in text, key


def test_a_place_has_no_minus_zero(optimum):
    pose = optimum.pose.copy()
    pose[:3, 3] = -0.001, 0.002, -0.3
    pose[:3, 0] = -0.001, 0.002, -1.0
    near = replace(optimum, pose=pose)
    console = Console(width=200)
    with console.capture() as captured:
        console.print(optimum_table(load_problem("dentist"), [near]))
    assert "0.00, 0.00, -0.30" in captured.get()
    assert "0.00, 0.00, -1.00" in captured.get()
    assert "-0.00" not in captured.get() + repr(near)
