"""Problems from TOML files: what is read, and every mistake at once in words."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from step_samples import NAMES, problem_of

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ProblemError
from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, JointLimit, WorkspaceBox
from ergoqp.problem.load import TASKS, load_problem, problem_from_dict, problem_names
from ergoqp.registry import data_folder

LEAST = {"response": {"ik": {}}}


def changed(path: str, value: Any) -> dict[str, Any]:
    raw: dict[str, Any] = copy.deepcopy(LEAST)
    *tables, key = path.split(".")
    table = raw
    for name in tables:
        table = table.setdefault(name, {})
    table[key] = value
    return raw


@pytest.mark.slow
def test_the_problems_of_the_package() -> None:
    assert set(TASKS) | {"screwing_learned", "forearm"} == set(problem_names())
    assert TASKS == NAMES
    for name in NAMES:
        problem = problem_of(name)
        raw = tomllib.loads((data_folder("problems") / f"{name}.toml").read_text(encoding="utf-8"))
        assert problem.name == name
        assert problem.title == raw["title"]
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        np.testing.assert_allclose(
            [box.lower, box.upper], [raw["limits"]["workspace"][end] for end in ("lower", "upper")]
        )
        assert cone.half_angle_deg == raw["limits"]["tool_axis"]["half_angle_deg"]
        assert problem.twist_limit.linear_speed == raw["limits"]["twist"]["linear_speed"]
        assert problem.task["load_kg"] == raw["task"]["load_kg"]
        assert problem.task["seated"] == (raw["response"]["ik"]["stance"] == "seated")
        assert list(problem.response.hands) == raw["response"]["ik"]["hands"]  # type: ignore


def test_a_file_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        "dt = 0.005\n[response.ik]\nstature = 1.62\n[limits.joints]\nrate_deg = 45\n",
        encoding="utf-8",
    )
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
    light, heavy = (
        problem_from_dict(changed("task.load_kg", load), "load") for load in (0.0, 20.0)
    )
    q = np.zeros(32)
    assert heavy.assess(q).final[0] > light.assess(q).final[0]
    assert float(heavy.cost(q)[0]) > float(light.cost(q)[0]) + 0.5


@pytest.mark.parametrize(
    ("path", "value", "parts"),
    [
        ("dt", 1.0, ["dt", "got 1.0"]),
        ("dt", "0.01", ["dt", "got '0.01'"]),
        ("dt", float("nan"), ["dt", "nan"]),
        ("speed", 1.0, ["speed: got a key that is not known, allowed title"]),
        (
            "robot",
            {"lagg": 0.1},
            ["robot.lagg: got a key that is not known, allowed lag (the nearest), delay"],
        ),
        (
            "response.ik.stanse",
            "seated",
            ["response.ik.stanse: got a key that is not known, allowed stance (the nearest)"],
        ),
        (
            "limits.twist.linear_sped",
            0.1,
            ["limits.twist.linear_sped: got a key", "linear_speed (the nearest)"],
        ),
        ("response.ik.stature", 175, ["response.ik.stature", "2.3", "175"]),
        (
            "response.ik.stance",
            "kneeling",
            ["response.ik.stance", "'standing' or 'seated'", "kneeling"],
        ),
        ("response.ik.hands", [], ["response.ik.hands"]),
        ("response.ik.hands", ["left", "left"], ["response.ik.hands: got", "allowed"]),
        ("response.ik.hands", "right", ["response.ik.hands"]),
        ("response.ik.tool", "pen", ["response.ik.tool", "pen"]),
        (
            "response.ik.weights",
            {"elbow_flexion": 0},
            ["response.ik.weights.elbow_flexion", "1e-09 to"],
        ),
        (
            "response.ik.weights",
            {"tail": 1.0},
            ["mine: response.ik.weights: got 'tail', allowed a joint"],
        ),
        (
            "response.ik.comfort_deg",
            {"elbow_flexion": 200.0},
            ["right_elbow_flexion: got 200, which is beyond its range, allowed 0 to 150"],
        ),
        ("response.ik.comfort_deg", {"elbow_flexion": float("inf")}, ["comfort_deg.elbow_flexion"]),
        ("response.gmr", {}, ["response.gmr"]),
        ("task.load_kg", -1.0, ["task.load_kg", "-1"]),
        ("task.coupling", 4, ["task.coupling", "4"]),
        ("task.coupling", True, ["task.coupling: got true, allowed a whole number from 0 to 3"]),
        ("task.shock", "yes", ["task.shock", "'yes'"]),
        ("task.seated", True, ["task.seated: got a key that is not known"]),
        (
            "task.method",
            {"magic": 1},
            ["task.method.magic: got a key that is not known, allowed band_ends"],
        ),
        (
            "task.method",
            {"arms": "both"},
            ["task.method.arms: got 'both', allowed 'whole' or 'segments'"],
        ),
        ("limits.twist.axes", ["z", "roll"], ["limits.twist.axes", "roll", "allowed some of x, y"]),
        (
            "limits.twist.linear_speed",
            0.0,
            ["limits.twist.linear_speed", "allowed 1e-09 to 1e+06 m/s"],
        ),
        ("limits.workspace", {"lower": [0, 0, 0]}, ["limits.workspace.upper", "required"]),
        (
            "limits.workspace",
            {"lower": [0.0, 0.0, 1.0], "upper": [1.0, 1.0, 0.0]},
            ["lower", "above upper"],
        ),
        (
            "limits.workspace",
            {"lower": [0.0, 0.0], "upper": [1.0, 1.0, 1.0]},
            ["limits.workspace.lower"],
        ),
        (
            "limits.tool_axis",
            {"direction": [0.0, 0.0, 0.0], "half_angle_deg": 10.0},
            ["allowed any vector from"],
        ),
        (
            "limits.tool_axis",
            {"direction": [1e200, 1e200, 0.0], "half_angle_deg": 10.0},
            ["allowed any vector from"],
        ),
        ("response", {"points": {}}, ["cost: got the sheet, allowed a learned cost"]),
        (
            "limits.tool_axis",
            {"direction": [1.0, 0.0, 0.0], "half_angle_deg": 200.0},
            ["limits.tool_axis.half_angle_deg"],
        ),
        ("limits.joints.ranges_deg", {"tail": [0.0, 10.0]}, ["ranges_deg: got 'tail'"]),
        (
            "limits.joints.ranges_deg",
            {"trunk_flexion": [0.0, 200.0]},
            ["ranges_deg of trunk_flexion"],
        ),
        ("limits.friction", {}, ["limits.friction"]),
        (
            "control",
            {"boldness": 1.0},
            ["control.boldness: got a key that is not known, allowed look_ahead"],
        ),
        (
            "control",
            {"effort_linear": 1e308},
            ["control.effort_linear: got 1e+308, allowed 0 to 1e+09"],
        ),
        ("control", {"look_ahead": -1.0}, ["control.look_ahead", "-1"]),
        (
            "cost.smooth_reba.taus_deg",
            [0.0, 1.0],
            ["cost.smooth_reba.taus_deg.0", "0.001 to 180 deg"],
        ),
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


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("limits.twist.linear_speed", 8.0, "got 8, usual are 0.005 to 1 m/s"),
        ("limits.twist.angular_speed", 34.0, "got 34, usual are 0.02 to 4 rad/s"),
        ("limits.twist.linear_acceleration", 600.0, "got 600, usual are"),
        ("limits.twist.angular_acceleration", 100.0, "got 100, usual are"),
        ("limits.tool_axis.half_angle_deg", 0.6, "got 0.6, usual are 3.2 to 170 deg"),
        ("limits.joints.rate_deg", 1.5, "got 1.5, usual are 6.3 to 720 deg/s"),
        (
            "limits.joints.ranges_deg",
            {"right_elbow_flexion": [0.0, 2.4]},
            "got no angle beyond 2.4, usual are degrees, not",
        ),
        (
            "response.ik.comfort_deg",
            {"elbow_flexion": 1.5, "hip_flexion": 0},
            "got no angle beyond 1.5, usual are degrees",
        ),
        ("limits.workspace.upper", [800.0, 350.0, 1750.0], "got 800, usual are -3 to 3 m"),
        ("task.load_kg", 500.0, "got 500, usual are 0 to 50 kg"),
        ("cost.smooth_reba.taus_deg", [0.02, 0.2], "got 0.02, usual are 0.1 to 45 deg"),
    ],
)
def test_another_unit_is_noticed_unless_it_is_meant(key: str, value: Any, said: str) -> None:
    raw = changed(key, value)
    raw["limits"] = {"workspace": {"lower": [0.0, 0.0, 0.5], "upper": [1.0, 1.0, 1.5]}} | raw.get(
        "limits", {}
    )
    raw["limits"]["workspace"] = {"lower": [0.0, 0.0, 0.5], "upper": [1.0, 1.0, 1.5]} | raw[
        "limits"
    ]["workspace"]
    if "tool_axis" in raw["limits"]:
        raw["limits"]["tool_axis"] |= {"direction": [1.0, 0.0, 0.0]}
    with pytest.raises(ProblemError) as caught:
        problem_from_dict(raw, "mine")
    assert str(caught.value).startswith(f"mine: {key}: {said}")
    assert str(caught.value).endswith(f'name it in the first lines: unusual = ["{key}"]')
    problem_from_dict({"unusual": [key], **raw}, "mine")


def test_what_is_named_as_meant_is_a_key() -> None:
    with pytest.raises(
        ProblemError, match=r"unusual: got 'task.load', allowed task.load_kg \(the nearest\), cost"
    ):
        problem_from_dict(changed("unusual", ["task.load"]), "mine")


def test_who_sits_is_scored_as_one_who_sits() -> None:
    """The stance and `seated` were two keys: one without the other scored a sitting person's
    knees."""
    knees = np.zeros(32)
    knees[[JOINTS.index(f"{side}_knee_flexion") for side in ("right", "left")]] = np.radians(85)
    for stance, score in (("seated", 1), ("standing", 2)):
        problem = problem_from_dict(changed("response.ik.stance", stance), "mine")
        assert problem.assess(knees).final[0] == score
        assert float(problem.cost(knees)[0]) == pytest.approx(score, abs=0.6)
        with pytest.raises(ProblemError, match=f"because the stance is {stance}"):
            problem.replace(task={**problem.task, "seated": stance == "standing"})
        with pytest.raises(ProblemError, match="cost: got seated = "):
            problem.replace(cost=SmoothReba(seated=stance == "standing"))
        # From Python, where nothing is said, the stance says it.
        assert problem.replace(task={}).task == {"seated": stance == "seated"}


def test_a_file_without_a_person_is_refused() -> None:
    with pytest.raises(ProblemError, match="response"):
        problem_from_dict({"dt": 0.01}, "mine")


def test_files_that_are_none(tmp_path: Path) -> None:
    broken, binary = tmp_path / "broken.toml", tmp_path / "binary.toml"
    broken.write_text("dt = = 1", encoding="utf-8")
    binary.write_bytes(b"\xff\xfe\x00")
    deep, long, large = (tmp_path / f"{name}.toml" for name in ("deep", "long", "large"))
    deep.write_text("a = " + "[" * 20000 + "]" * 20000, encoding="utf-8")
    long.write_text("dt = " + "1" * 5000, encoding="utf-8")
    for path in (broken, binary, deep, long):
        with pytest.raises(ProblemError, match=f"problem: {path.name}: not (a TOML file|text)"):
            load_problem(path)
    large.write_text("#" * 1_000_001, encoding="utf-8")
    with pytest.raises(ProblemError, match=r"large.toml: got 1000001 bytes, allowed 1000000"):
        load_problem(large)
    marked = tmp_path / "marked.toml"
    marked.write_bytes(b"\xef\xbb\xbf[response.ik]\n")
    assert load_problem(marked).name == "marked"
    with pytest.raises(ProblemError, match="got 'screwin', allowed dentist, desk"):
        load_problem("screwin")
    with pytest.raises(ProblemError, match="no such file"):
        load_problem(tmp_path / "absent.toml")
    with pytest.raises(ProblemError, match="is a directory"):
        load_problem(tmp_path)
