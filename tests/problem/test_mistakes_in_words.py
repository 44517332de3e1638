"""Mistakes of problem files, in words that somebody who writes TOML understands."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from ergoqp.errors import InputError, ProblemError
from ergoqp.files.read import read_toml
from ergoqp.problem.load import problem_from_dict
from ergoqp.responses import IkResponse


def said_of(text: str) -> str:
    """Return the message about a file with this text."""
    with pytest.raises(ProblemError) as caught:
        problem_from_dict(tomllib.loads(text), "mine")
    return str(caught.value)


IK = "[response.ik]\n"
BALL = "ball = {centre = [0, 0, 0], radius = 0.1}\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f'{IK}hands = "both"',
            'response.ik.hands: got \'both\', allowed a list such as ["right", "left"] with 1 to 2'
            " entries",
        ),
        (
            f"{IK}hands = []",
            'response.ik.hands: got [], allowed a list such as ["right", "left"] with 1 to 2'
            " entries",
        ),
        (
            f'{IK}[limits.tool_axis]\ndirection = "x"\nhalf_angle_deg = 20',
            "limits.tool_axis.direction: got 'x', allowed a list of three numbers",
        ),
        (
            f"{IK}[limits.tool_axis]\ndirection = [1, 0]\nhalf_angle_deg = 20",
            "limits.tool_axis.direction: got [1, 0], allowed a list of three numbers",
        ),
        (
            f"{IK}[limits.tool_axis]\ndirection = [1]\nhalf_angle_deg = 20",
            "limits.tool_axis.direction: got [1], allowed a list of three numbers",
        ),
        (
            f"{IK}[limits.tool_axis]\ndirection = [1, 0, 0, 0]\nhalf_angle_deg = 20",
            "limits.tool_axis.direction: got [1, 0, 0, 0], allowed a list of three numbers",
        ),
        (
            f"{IK}[task]\narm_supported = true",
            "task.arm_supported: got true, allowed a list such as [true, false]",
        ),
        (
            f"{IK}[limits.joints]\nranges_deg = {{trunk_flexion = 20}}",
            "limits.joints.ranges_deg.trunk_flexion: got 20, allowed a list of two numbers",
        ),
        (
            f"{IK}[cost.smooth_reba]\ntaus_deg = 3.0",
            "cost.smooth_reba.taus_deg: got 3.0, allowed a list of numbers with at least 1 entry",
        ),
        (f"{IK}[limits]\nkeep_out = 3", "limits.keep_out: got 3, allowed a list of tables"),
        (f"{IK}[limits]\ntwist = 3", "limits.twist: got 3, allowed a table"),
        (f"{IK}weights = 3", "response.ik.weights: got 3, allowed a table"),
        (f'{IK}looks = "yes"', "response.ik.looks: got 'yes', allowed true or false"),
        (f"title = 3\n{IK}", "title: got 3, allowed a text"),
        (
            f"{IK}[limits.arm_length]\nlength = true",
            "limits.arm_length.length: got true, allowed a number from 0.001 to 100 m",
        ),
    ],
)
def test_a_wrong_type_is_told_in_words_of_the_file(text: str, said: str) -> None:
    assert said_of(text) == f"mine: {said}"


def test_the_hands_may_be_in_any_order() -> None:
    there, back = (
        problem_from_dict(tomllib.loads(f"{IK}hands = {hands}"), "mine").response
        for hands in ('["right", "left"]', '["left", "right"]')
    )
    assert there == back
    assert isinstance(back, IkResponse)
    assert back.hands == ("right", "left")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f'{IK}hands = ["left", "left"]', "response.ik.hands: got ('left', 'left'), allowed"),
        (
            f"{IK}comfort_deg = {{elbow_flexion = -50}}",
            "response.ik.comfort_deg: right_elbow_flexion: got -50, which is beyond its range",
        ),
        (
            f"{IK}[limits.joints]\nranges_deg = {{right_elbow_flexion = [50, 20]}}",
            "limits.joints.ranges_deg of right_elbow_flexion: got 50 to 20, allowed within",
        ),
        (f'{IK}[limits.twist]\naxes = ["x", "x"]', "limits.twist.axes: got ('x', 'x'), allowed"),
        (
            f"{IK}[limits.tool_axis]\ndirection = [0, 0, 0]\nhalf_angle_deg = 20",
            "limits.tool_axis.direction: got (0.0, 0.0, 0.0), allowed any vector",
        ),
        (
            f"{IK}[limits.workspace]\nlower = [0, 0, 1]\nupper = [1, 1, 0]",
            "limits.workspace: got lower (0.0, 0.0, 1.0) above upper",
        ),
        (
            f"{IK}[[limits.keep_out]]\nhalf_space = {{normal = [0, 0, 0], offset = 1}}",
            "limits.keep_out.0.half_space.normal: got (0.0, 0.0, 0.0), allowed any vector",
        ),
        (
            f'{IK}[limits.one_class_boundary]\nmodel = "none"',
            "limits.one_class_boundary.model: got 'none', allowed",
        ),
        (
            f"{IK}[cost.smooth_reba]\ntaus_deg = [1, 2]\nweights = [1]",
            "cost.smooth_reba.weights: got (1.0,), allowed",
        ),
        (
            f'{IK}[cost.learned]\nmodel = "none"',
            "cost.learned.model: got 'none', allowed",
        ),
    ],
)
def test_a_mistake_that_a_term_finds_has_its_full_key(text: str, said: str) -> None:
    assert said_of(text).startswith(f"mine: {said}")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"{IK}[[limits.keep_out]]\n{BALL}box = {{lower = [0, 0, 0], upper = [1, 1, 1]}}",
            "limits.keep_out.0: got ball and box, allowed exactly one of half_space, ball and box",
        ),
        (
            f"{IK}[limits.keep_out]",
            "limits.keep_out.0: got none, allowed exactly one of half_space, ball and box",
        ),
        (
            f"{IK}[response.points]",
            "response: got ik and points, allowed exactly one of ik, points and gmr",
        ),
        (
            f'{IK}[cost]\nsmooth_reba = {{}}\nlearned = {{model = "a"}}',
            "cost: got smooth_reba and learned, allowed only one of smooth_reba and learned",
        ),
        (
            f'{IK}stature = 1.7\nperson = "me.toml"',
            "response.ik: got stature and person, allowed one of them",
        ),
        (
            f"{IK}[[limits.keep_out]]\n{BALL}[[limits.keep_out]]\n{BALL}",
            "limits.keep_out: got two regions named 'keep out', allowed regions each with a `name`"
            " of its own",
        ),
    ],
)
def test_keys_that_exclude_each_other_are_named_without_their_values(text: str, said: str) -> None:
    assert said_of(text) == f"mine: {said}"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{IK}stature = 168", "response.ik.stature: got 168, allowed 1.2 to 2.3 m (centimetres?)"),
        (f"{IK}stature = 3", "response.ik.stature: got 3, allowed 1.2 to 2.3 m"),
        (f"{IK}[robot]\nlag = 80", "robot.lag: got 80, allowed 0 to 0.5 s (milliseconds?)"),
        (f"{IK}[robot]\nlag = -1", "robot.lag: got -1, allowed 0 to 0.5 s"),
        (f"{IK}[robot]\ngain_error = 5", "robot.gain_error: got 5, allowed 0 to 0.5 (per cent?)"),
        (f"dt = 10\n{IK}", "dt: got 10, allowed 0.0001 to 0.1 s (milliseconds?)"),
        (f"{IK}[task]\ncoupling = 4", "task.coupling: got 4, allowed 0 to 3"),
        (f"{IK}[task]\nload_kg = -1", "task.load_kg: got -1, allowed at least 0 kg"),
        (
            f"{IK}[limits.tool_axis]\ndirection = [1, 0, 0]\nhalf_angle_deg = 200",
            "limits.tool_axis.half_angle_deg: got 200, allowed 1e-06 to 170 deg",
        ),
    ],
)
def test_a_number_out_of_range_names_the_range_with_its_unit(text: str, said: str) -> None:
    assert said_of(text) == f"mine: {said}"


def test_an_unusual_number_names_the_unit_it_may_be_in() -> None:
    box = "[limits.workspace]\nlower = [250, -300, 700]\nupper = [400, 300, 800]"
    assert "lower: got 250, usual are -3 to 3 m (millimetres?); if it is" in said_of(IK + box)
    cone = "[limits.tool_axis]\ndirection = [1, 0, 0]\nhalf_angle_deg = 0.52"
    assert "got 0.52, usual are 3.2 to 170 deg (radians?); if it is" in said_of(IK + cone)
    far = "[limits.workspace]\nlower = [-1, -1, 0]\nupper = [1, 1, 40000]"
    assert "upper: got 40000, usual are -3 to 3 m; if it is" in said_of(IK + far)


@pytest.mark.parametrize("table", ["workspace", "tool_axis", "arm_length"])
@pytest.mark.parametrize("key", ["tolerance", "recovery_time"])
def test_a_file_cannot_change_what_counts_as_inside(table: str, key: str) -> None:
    said = said_of(f"{IK}[limits.{table}]\n{key} = 0.5")
    assert f"limits.{table}.{key}: got a key that is not known" in said


def test_a_required_key_that_is_misspelled_is_one_mistake() -> None:
    cone = "[limits.tool_axis]\ndirection = [1, 0, 0]\nhalf_angle = 0.52"
    assert said_of(IK + cone) == (
        "mine: limits.tool_axis.half_angle: got a key that is not known, allowed half_angle_deg"
        " (the nearest, required), direction"
    )
    several = said_of(f"{IK}[limits.tool_axis]\nhalf_angle = 0.52")
    assert "2 mistakes" in several
    assert "limits.tool_axis.direction: got nothing, required" in several
    other = said_of(f"{IK}[limits.arm_length]\nname = 3")
    assert "limits.arm_length.length: got nothing, required" in other
    assert "limits.arm_length.name: got a key that is not known, allowed length" in other


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{IK}[task]\nseated = true", "; the stance under [response.ik] tells whether the person"),
        (f"{IK}[limits.ball]\nradius = 1", "; ball belongs under [limits.keep_out]"),
        (f"stature = 1.7\n{IK}", "; stature belongs under [response.ik]"),
        (f"{IK}dt = 0.01", "; dt belongs at the top of the file, above all tables"),
    ],
)
def test_a_key_at_the_wrong_place_is_told_the_right_one(text: str, said: str) -> None:
    assert said in said_of(text)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ('title = "abc\ndt = 1', r"\(is a text in that line not closed by a quotation mark\?\)"),
        ('hands = ["right]\n', r"\(is a text in that line not closed by a quotation mark\?\)"),
        ("title = 'abc\ndt = 1", r"\(is a text not closed by a quotation mark\?\)"),
        ('title = "abc', r"\(is a text not closed by a quotation mark\?\)"),
        ("hands = [1, 2\ndt = 1", r"\(is a list not closed by \]\?\)"),
        ('person = "C:\\models"', r"\(a text with backslashes stands in single quotation marks\)"),
        ("stance = seated", r"\(a text stands in quotation marks, and true and false are lower"),
        ("looks = True", r"\(a text stands in quotation marks, and true and false are lower"),
        ("stature = 1,75", r"\(is there a decimal comma, or more after the value\?\)"),
        ("[a\nb = 1", r"not a TOML file: Expected '\]' .* \(at line 1, column 3\)$"),
    ],
)
def test_what_is_no_toml_has_a_hint_for_common_slips(text: str, hint: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=hint):
        read_toml(path, "problem")
