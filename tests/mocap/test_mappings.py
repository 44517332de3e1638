"""A mapping file adds to the known names, and what this take lacks of it refuses nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.made_motions import RATE, walk
from ergoqp.errors import RecordingError, UnknownNamesError
from ergoqp.mocap import Recording, fit_postures


def fitted(mapping: Path, text: str, **renamed: str) -> Recording:
    places = walk()[0]
    mapping.write_text(text, encoding="utf-8")
    names = [renamed.get(name, name) for name in places]
    positions = np.stack(list(places.values()), axis=1)
    return fit_postures(names, positions, RATE, mapping=mapping)


def said(recording: Recording) -> str:
    return " ".join(recording.assumptions)


@pytest.fixture
def mapping(tmp_path: Path) -> Path:
    return tmp_path / "map.toml"


def test_one_line_is_added_to_a_known_skeleton(mapping: Path) -> None:
    whole = fit_postures(list(walk()[0]), np.stack(list(walk()[0].values()), axis=1), RATE)
    recording = fitted(mapping, 'right_wrist = "hand"\n', right_wrist="hand")
    np.testing.assert_array_equal(recording.postures, whole.postures)
    assert "named as in the mapping file map.toml" in said(recording)
    assert "does not have" not in said(recording)


def test_a_joint_that_the_mapping_calls_otherwise_is_used_once(mapping: Path) -> None:
    recording = fitted(mapping, 'right_knuckles = "right_wrist"\n')
    assert "right_wrist" not in recording.errors


def test_an_empty_name_leaves_out(mapping: Path) -> None:
    recording = fitted(mapping, 'head = ""\nhead_top = ""\n')
    assert not {"head", "head_top"} & set(recording.errors)
    assert "does not have" not in said(recording)


def test_what_the_take_lacks_is_said(mapping: Path) -> None:
    recording = fitted(mapping, 'left_toe = "foot"\nnose = ["eye", "right_toe"]\n')
    assert recording.scored.any()
    assert "left_toe" in recording.errors
    assert "The mapping file map.toml names foot, eye, which the recording does not have." in said(
        recording
    )


def test_too_little_is_refused_with_what_it_lacks(mapping: Path) -> None:
    mapping.write_text('neck = "n"\npelvis = "p"\n', encoding="utf-8")
    with pytest.raises(
        RecordingError,
        match=r"the pelvis cannot be placed; .*; the mapping file map.toml names p, which the",
    ):
        fit_postures(["n", "a"], np.ones((5, 2, 3)), 50.0, mapping=mapping)


def test_names_that_are_not_read_are_named_where_a_part_cannot_be_placed() -> None:
    places = walk()[0]
    theirs = {"neck": "C7", "right_shoulder": "R.Acr", "left_shoulder": "L.Acr", "head": "TETE"}
    names = [theirs.get(name, name) for name in places]
    with pytest.raises(UnknownNamesError) as refused:
        fit_postures(names, np.stack(list(places.values()), axis=1), RATE)
    assert str(refused.value).endswith(
        "of neck, right_shoulder, left_shoulder; not read as such: C7, TETE, R.Acr, L.Acr;"
        ' a mapping file can name them, with lines such as neck = "C7" (mapping)'
    )
    assert set(refused.value.names) == set(theirs.values())
