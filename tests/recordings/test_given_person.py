"""Person files and statures that the user gives: read, or refused in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ergoqp.errors import InputError
from ergoqp.human.person_file import given_person


def test_a_person_file_is_the_body_it_describes(tmp_path: Path) -> None:
    path = tmp_path / "me.toml"
    path.write_text("stature = 1.82\nmass = 81\n[lengths]\nforearm = 0.27\n", encoding="utf-8")
    body = given_person(path)
    assert (body.stature, body.mass, body.lengths["forearm"]) == (1.82, 81, 0.27)
    assert given_person(1.82).stature == 1.82


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("stature = 1" + 400 * "0", "stature is 1000"),
        ("stature = 1.8\nmass = 1" + 400 * "0", "mass is 1000"),
        ("stature = nan", "stature is nan, allowed a number"),
        ("stature = true", "stature is True, allowed a number"),
        ('stature = "tall"', "stature is 'tall', allowed a number"),
        ("height = 1.8", "got ['height'], allowed stature, mass"),
        ("mass = 80", "required are a stature"),
    ],
)
def test_what_describes_nobody_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "me.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as told:
        given_person(path)
    assert sentence in str(told.value)
    assert "me.toml" in str(told.value)
    assert len(str(told.value)) < 200


@pytest.mark.parametrize("person", [10**400, float("nan"), True, [1.8]])
def test_a_stature_that_is_none_is_refused(person: Any) -> None:
    with pytest.raises(InputError, match=r"got .*allowed"):
        given_person(person)
