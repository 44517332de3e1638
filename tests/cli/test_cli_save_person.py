"""``ergoqp score --save-person``: a person and their markers, for the next take, for problems."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import mistake

from benchmarks.made_markers import markers_of, write_c3d
from benchmarks.made_motions import BODY, RATE, fitted, walk
from ergoqp.human.person_file import given_person, person_with_markers
from ergoqp.problem_files.load import load_problem


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk with all markers, and one in which the left ASIS is never seen."""
    folder = tmp_path_factory.mktemp("takes")
    recording = fitted(walk(3.0)[0])
    poses = recording.base_poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    pelvis = np.column_stack([poses[:, :3, 3], yaw])
    names, places = markers_of(BODY, pelvis, recording.postures)
    write_c3d(folder / "whole.c3d", names, places, RATE)
    places[:, names.index("LASI")] = np.nan
    write_c3d(folder / "lacking.c3d", names, places, RATE)
    return folder


def test_a_take_tells_the_person_and_the_next_one_needs_it(ergoqp, takes, tmp_path):
    assert "the pelvis cannot be placed" in mistake(ergoqp("score", takes / "lacking.c3d"))
    outcome = ergoqp("score", takes / "whole.c3d", "--save-person", "me.toml")
    assert outcome.status == 0, outcome.err
    assert given_person(tmp_path / "me.toml").stature == pytest.approx(BODY.stature, abs=0.01)
    assert len(person_with_markers(tmp_path / "me.toml")[1]) == 39
    outcome = ergoqp("score", takes / "lacking.c3d", "--person", "me.toml")
    assert outcome.status == 0, outcome.err
    assert "left asis" in " ".join(outcome.out.split())


def test_a_problem_of_that_person(ergoqp, takes, tmp_path):
    assert ergoqp("score", takes / "whole.c3d", "--save-person", "me.toml").status == 0
    (tmp_path / "mine.toml").write_text('[response.ik]\nperson = "me.toml"\n', encoding="utf-8")
    body = load_problem(tmp_path / "mine.toml").response.body
    assert body.stature == pytest.approx(BODY.stature, abs=0.01)


def test_a_recording_without_markers_tells_lengths(ergoqp, demo, tmp_path):
    assert ergoqp("score", demo, "--save-person", tmp_path / "me.toml").status == 0
    assert given_person(tmp_path / "me.toml").stature == pytest.approx(1.72, abs=0.001)
    assert person_with_markers(tmp_path / "me.toml")[1] == {}


@pytest.mark.parametrize("path", ["none/me.toml", ".", "x" * 300])
def test_where_nothing_can_be_written(ergoqp, demo, path):
    sentence = mistake(ergoqp("score", demo, "--save-person", path))
    assert "--save-person: got " in sentence
    assert "allowed the path of a file" in sentence


def test_the_person_that_is_given_may_be_written_anew(ergoqp, takes, tmp_path):
    assert ergoqp("score", takes / "whole.c3d", "--save-person", "me.toml").status == 0
    before = person_with_markers(tmp_path / "me.toml")[1]
    again = ("score", takes / "whole.c3d", "--person", "me.toml", "--save-person", "me.toml")
    assert ergoqp(*again).status == 0
    assert given_person(tmp_path / "me.toml").stature == pytest.approx(BODY.stature, abs=0.01)
    after = person_with_markers(tmp_path / "me.toml")[1]
    assert list(after) == list(before)
    for name, marker in before.items():
        # Beside a joint it may as well sit on the other segment.
        if after[name].frame == marker.frame:
            assert after[name].offset == pytest.approx(marker.offset, abs=0.001)
