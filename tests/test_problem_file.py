"""Problems from TOML files: what is read, and every mistake at once in words."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from step_samples import NAMES, problem_of

from ergoqp.errors import ProblemError
from ergoqp.limits import AxisCone, JointLimit, WorkspaceBox
from ergoqp.paths import data_folder
from ergoqp.problem_file import TASKS, load_problem, problem_from_dict, problem_names

LEAST = {"response": {"ik": {}}}


def changed(path: str, value: Any) -> dict[str, Any]:
    raw: dict[str, Any] = copy.deepcopy(LEAST)
    *tables, key = path.split(".")
    table = raw
    for name in tables:
        table = table.setdefault(name, {})
    table[key] = value
    return raw


def test_the_problems_of_the_package() -> None:
    assert set(TASKS) | {"screwing_learned", "forearm"} == set(problem_names())
    assert TASKS == NAMES
    for name in NAMES:
        problem = problem_of(name)
        raw = tomllib.loads((data_folder("problems") / f"{name}.toml").read_text(encoding="utf-8"))
        assert problem.name == name
        assert problem.title == raw["title"]
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        np.testing.assert_allclose([box.lower, box.upper], [raw["limits"]["workspace"][end] for end in ("lower", "upper")])
        assert cone.half_angle_deg == raw["limits"]["tool_axis"]["half_angle_deg"]
        assert problem.twist_limit.linear_speed == raw["limits"]["twist"]["linear_speed"]
        assert problem.task["load_kg"] == raw["task"]["load_kg"]
        assert problem.task["seated"] == (raw["response"]["ik"]["stance"] == "seated")
        assert list(problem.response.hands) == raw["response"]["ik"]["hands"]  # type: ignore[attr-defined]


def test_a_file_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("dt = 0.005\n[response.ik]\nstature = 1.62\n[limits.joints]\nrate_deg = 45\n", encoding="utf-8")
    problem = load_problem(path)
    assert (problem.name, problem.title, problem.dt) == ("mine", "mine", 0.005)
    assert problem.response.body.stature == 1.62  # type: ignore[attr-defined]
    assert problem.limit_of(JointLimit).rate_deg == 45
    assert problem.limit_of(WorkspaceBox) is None
    assert load_problem(str(path)).dt == 0.005


def test_the_least_problem_has_defaults() -> None:
    problem = problem_from_dict(LEAST, "least")
    assert (problem.dt, problem.cost.name) == (0.01, "smooth_reba")
    assert problem.limit_of(JointLimit) is not None


def test_cost_and_sheet_are_of_the_same_task() -> None:
    light, heavy = (problem_from_dict(changed("task.load_kg", load), "load") for load in (0.0, 20.0))
    q = np.zeros(32)
    assert heavy.assess(q).final[0] > light.assess(q).final[0]
    assert float(heavy.cost(q)[0]) > float(light.cost(q)[0]) + 0.5


@pytest.mark.parametrize(
    ("path", "value", "parts"),
    [
        ("dt", 1.0, ["dt", "got 1.0"]),
        ("dt", "0.01", ["dt", "got '0.01'"]),
        ("dt", float("nan"), ["dt", "nan"]),
        ("speed", 1.0, ["speed", "got 1.0"]),
        ("response.ik.stature", 175, ["response.ik.stature", "2.3", "175"]),
        ("response.ik.stance", "kneeling", ["response.ik.stance", "'standing' or 'seated'", "kneeling"]),
        ("response.ik.hands", [], ["response.ik.hands"]),
        ("response.ik.hands", ["left", "right"], ["hands: got", "allowed"]),
        ("response.ik.hands", "right", ["response.ik.hands"]),
        ("response.ik.tool", "pen", ["response.ik.tool", "pen"]),
        ("response.ik.weights", {"elbow_flexion": 0}, ["response.ik.weights.elbow_flexion", "greater than 0"]),
        ("response.ik.weights", {"tail": 1.0}, ["weights: got 'tail', allowed a joint"]),
        ("response.ik.comfort_deg", {"elbow_flexion": 200.0}, ["right_elbow_flexion is beyond its range"]),
        ("response.ik.comfort_deg", {"elbow_flexion": float("inf")}, ["comfort_deg.elbow_flexion"]),
        ("response.gmr", {}, ["response.gmr"]),
        ("task.load_kg", -1.0, ["task.load_kg", "-1"]),
        ("task.coupling", 4, ["task.coupling", "4"]),
        ("task.coupling", True, ["task.coupling", "True"]),
        ("task.seated", "yes", ["task.seated", "'yes'"]),
        ("task.method", {"magic": 1}, ["task.method: got magic, allowed"]),
        ("limits.twist.axes", ["z", "roll"], ["limits.twist.axes.1", "roll"]),
        ("limits.twist.linear_speed", 0.0, ["limits.twist.linear_speed", "greater than 0"]),
        ("limits.workspace", {"lower": [0, 0, 0]}, ["limits.workspace.upper", "required"]),
        ("limits.workspace", {"lower": [0.0, 0.0, 1.0], "upper": [1.0, 1.0, 0.0]}, ["lower", "above upper"]),
        ("limits.workspace", {"lower": [0.0, 0.0], "upper": [1.0, 1.0, 1.0]}, ["limits.workspace.lower"]),
        ("limits.tool_axis", {"direction": [0.0, 0.0, 0.0], "half_angle_deg": 10.0}, ["any vector but zero"]),
        ("limits.tool_axis", {"direction": [1.0, 0.0, 0.0], "half_angle_deg": 200.0}, ["limits.tool_axis.half_angle_deg"]),
        ("limits.joints.ranges_deg", {"tail": [0.0, 1.0]}, ["ranges_deg: got 'tail'"]),
        ("limits.joints.ranges_deg", {"trunk_flexion": [0.0, 200.0]}, ["ranges_deg of trunk_flexion"]),
        ("limits.friction", {}, ["limits.friction"]),
        ("control", {"boldness": 1.0}, ["control: got boldness, allowed"]),
        ("control", {"look_ahead": -1.0}, ["control.look_ahead", "-1"]),
        ("cost.smooth_reba.taus_deg", [0.0, 1.0], ["cost.smooth_reba.taus_deg.0", "greater than 0"]),
        ("cost.smooth_reba.taus_deg", [1.0], ["weights"]),
        ("cost.magic", {}, ["cost.magic"]),
    ],
)
def test_a_mistake_is_named_by_its_key(path: str, value: Any, parts: list[str]) -> None:
    with pytest.raises(ProblemError) as caught:
        problem_from_dict(changed(path, value), "mine")
    sentence = str(caught.value)
    assert sentence.startswith("mine: ")
    for part in parts:
        assert part in sentence
    assert "pydantic" not in sentence
    assert "\n" not in sentence or "mistakes" in sentence


def test_all_mistakes_are_listed_at_once() -> None:
    raw = changed("dt", 7.0) | {"colour": "red", "limits": {"twist": {"linear_speed": -1.0}}}
    with pytest.raises(ProblemError) as caught:
        problem_from_dict(raw, "mine")
    for part in ("3 mistakes", "dt", "colour", "limits.twist.linear_speed"):
        assert part in str(caught.value)


def test_a_file_without_a_person_is_refused() -> None:
    with pytest.raises(ProblemError, match="response"):
        problem_from_dict({"dt": 0.01}, "mine")


def test_files_that_are_none(tmp_path: Path) -> None:
    broken, binary = tmp_path / "broken.toml", tmp_path / "binary.toml"
    broken.write_text("dt = = 1", encoding="utf-8")
    binary.write_bytes(b"\xff\xfe\x00")
    for path in (broken, binary):
        with pytest.raises(ProblemError, match=f"{path.name}: not a TOML file"):
            load_problem(path)
    with pytest.raises(ProblemError, match="got 'screwin', allowed dentist, desk"):
        load_problem("screwin")
    with pytest.raises(ProblemError, match="is not there"):
        load_problem(tmp_path / "absent.toml")
    with pytest.raises(ProblemError, match="is a directory"):
        load_problem(tmp_path)
