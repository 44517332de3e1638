"""A problem for a person of a file, beside the problem's own file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ergoqp.errors import ProblemError
from ergoqp.human import Body
from ergoqp.human.body import Marker
from ergoqp.human.person_file import write_person
from ergoqp.problem.load import load_problem, problem_from_dict
from ergoqp.problem.problem import Problem

ME = Body(1.62, {"forearm": 0.22, "trunk": 0.5}, 58.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A problem, and in a folder of its own a person file with a marker."""
    (tmp_path / "people").mkdir()
    write_person(tmp_path / "people" / "me.toml", ME, {"LASI": Marker("pelvis", (0, 0, 0), 0.0)})
    return tmp_path


def asked(folder: Path, **keys: Any) -> Problem:
    return problem_from_dict({"response": {"ik": keys}}, "mine", folder)


@pytest.mark.slow
def test_the_person_is_that_of_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'dt = 0.005\n[response.ik]\nperson = "people/me.toml"\nhands = ["left"]\n'
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    # Wherever one is: the path is relative to the problem's file.
    monkeypatch.chdir(folder / "people")
    for path in (folder / "mine.toml", str(folder / "mine.toml"), "../mine.toml"):
        body = load_problem(path).response.body  # type: ignore[attr-defined]
        assert body.stature == pytest.approx(ME.stature, abs=1e-4)
        assert body.mass == pytest.approx(ME.mass)
        assert dict(body.lengths) == pytest.approx(dict(ME.lengths), abs=1e-4)
    assert load_problem(folder / "mine.toml").response.hands == ("left",)  # type: ignore


def test_an_absolute_path_needs_no_folder(folder: Path) -> None:
    problem = problem_from_dict(
        {"response": {"ik": {"person": str(folder / "people" / "me.toml")}}}, "mine"
    )
    assert problem.response.body.stature == pytest.approx(1.62)  # type: ignore[attr-defined]


def test_another_person_follows_otherwise(folder: Path) -> None:
    small, average = (asked(folder, **keys) for keys in ({"person": "people/me.toml"}, {}))
    hands = [
        np.array(problem.response.body.model.site("right_grip").pos)  # type: ignore[attr-defined]
        for problem in (small, average)
    ]
    assert np.abs(hands[0] - hands[1]).max() > 0.0
    assert average.response.body == Body()  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (
            {"person": "people/me.toml", "stature": 1.7},
            "response.ik: got stature and person, allowed one of them",
        ),
        ({"person": 1.7}, "response.ik.person: got 1.7, allowed a text"),
        ({"person": ["me.toml"]}, "response.ik.person: got ['me.toml'], allowed a text"),
        ({"person": "none.toml"}, "person file: none.toml: no such file"),
        ({"person": "people"}, "person file: people: is a directory"),
        ({"person": ""}, "person file: got '', allowed a file"),
        ({"person": "a\x00b"}, "cannot be read: embedded null byte"),
        ({"person": "bad.toml"}, "person file bad.toml: got ['height'], allowed stature, mass"),
        (
            {"person": "nan.toml"},
            "person file nan.toml: markers.LASI.offset: got nan, allowed -2 to 2",
        ),
        ({"person": "long.toml"}, "person file long.toml: length of thigh: got 0.600 m, allowed"),
        ({"person": "tall.toml"}, "person file tall.toml: stature: got 3.1 m, allowed 1.2 to 2.3"),
    ],
)
def test_who_is_nobody_is_refused(folder: Path, keys: dict[str, Any], sentence: str) -> None:
    (folder / "bad.toml").write_text("height = 1.8", encoding="utf-8")
    (folder / "tall.toml").write_text("stature = 3.1", encoding="utf-8")
    (folder / "long.toml").write_text("stature = 1.5\n[lengths]\nthigh = 0.6", encoding="utf-8")
    lasi = 'stature = 1.7\n[markers.LASI]\nframe = "pelvis"\noffset = [nan, 0, 0]'
    (folder / "nan.toml").write_text(lasi, encoding="utf-8")
    with pytest.raises(ProblemError) as told:
        asked(folder, **keys)
    assert str(told.value).startswith("mine: ")
    assert sentence in str(told.value)
    assert "\n" not in str(told.value)
