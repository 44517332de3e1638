"""``ergoqp score --save-person``: a person and their markers, for the next take, for problems."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import mistake

from benchmarks.made_markers import markers_of, write_c3d
from benchmarks.made_motions import BODY, RATE, fitted, walk
from ergoqp.human.person_file import given_person, person_with_markers
from ergoqp.problem.load import load_problem

LEFT_ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk with all markers, with one that falls off, of one arm, and without the left ASIS."""
    folder = tmp_path_factory.mktemp("takes")
    recording = fitted(walk(3.0)[0])
    poses = recording.base_poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    pelvis = np.column_stack([poses[:, :3, 3], yaw])
    names, places = markers_of(BODY, pelvis, recording.postures)
    write_c3d(folder / "whole.c3d", names, places, RATE)
    fallen = places.copy()
    fallen[60:, names.index("RTIB")] += (0.0, 0.0, -0.2)
    write_c3d(folder / "fallen.c3d", names, fallen, RATE)
    kept = [i for i, name in enumerate(names) if name not in LEFT_ARM]
    write_c3d(folder / "one arm.c3d", tuple(names[i] for i in kept), places[:, kept], RATE)
    places[:, names.index("LASI")] = np.nan
    write_c3d(folder / "lacking.c3d", names, places, RATE)
    return folder


@pytest.mark.slow
def test_a_take_tells_the_person_and_the_next_one_needs_it(ergoqp, takes, tmp_path):
    assert "the pelvis cannot be placed" in mistake(ergoqp("score", takes / "lacking.c3d"))
    outcome = ergoqp("score", takes / "whole.c3d", "--save-person", "me.toml")
    assert outcome.status == 0, outcome.err
    assert given_person(tmp_path / "me.toml").stature == pytest.approx(BODY.stature, abs=0.01)
    assert len(person_with_markers(tmp_path / "me.toml")[1]) == 39
    outcome = ergoqp("score", takes / "lacking.c3d", "--person", "me.toml")
    assert outcome.status == 0, outcome.err
    assert "left asis" in " ".join(outcome.out.split())


@pytest.mark.slow
def test_a_problem_of_that_person(ergoqp, takes, tmp_path):
    assert ergoqp("score", takes / "whole.c3d", "--save-person", "me.toml").status == 0
    (tmp_path / "mine.toml").write_text('[response.ik]\nperson = "me.toml"\n', encoding="utf-8")
    body = load_problem(tmp_path / "mine.toml").response.body
    assert body.stature == pytest.approx(BODY.stature, abs=0.01)


@pytest.mark.slow
def test_a_recording_without_markers_tells_lengths(ergoqp, demo, tmp_path):
    outcome = ergoqp("score", demo, "--save-person", tmp_path / "me.toml")
    assert outcome.status == 0
    sentence = "Not measured, and as long as those of an average person of 1.72 m: "
    assert sentence in outcome.out
    first = (tmp_path / "me.toml").read_text().splitlines()[0]
    assert first.startswith(f"# {sentence}")
    assert "hand" in first
    assert "thigh" not in first
    assert given_person(tmp_path / "me.toml").stature == pytest.approx(1.72, abs=0.001)
    assert person_with_markers(tmp_path / "me.toml")[1] == {}


def refusal(ergoqp, tmp_path, *arguments):
    """The sentence of a person who is not written, and no results beside."""
    sentence = mistake(ergoqp("score", *arguments, "--out", "out", "--save-person", "me.toml"))
    assert not (tmp_path / "me.toml").exists()
    assert not (tmp_path / "out").exists()
    return sentence


def test_few_frames_measure_nobody(ergoqp, takes, tmp_path):
    take = takes / "whole.c3d"
    sentence = refusal(ergoqp, tmp_path, take, "--window", "0:0.05")
    assert "--save-person: got a recording with 4 scored frames, allowed one with 20" in sentence
    assert "got a recording with 1 scored frame," in refusal(
        ergoqp, tmp_path, take, "--window", "0:0.01"
    )


def test_frames_that_are_not_scored_measure_nobody(ergoqp, takes, tmp_path):
    sentence = refusal(ergoqp, tmp_path, takes / "whole.c3d", "--person", "1.25")
    assert "--save-person: got a recording with no scored frame, allowed" in sentence


def test_joint_angles_measure_nobody(ergoqp, tmp_path):
    names = ["lumbar_extension", "arm_flex_r", "elbow_flex_r", "arm_flex_l", "elbow_flex_l"]
    names += ["pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty"]
    names += ["pelvis_tz", "arm_add_r", "arm_rot_r", "arm_add_l", "arm_rot_l"]
    names += ["lumbar_bending", "lumbar_rotation"]
    names += [f"{name}_{s}" for name in ("hip_flexion", "knee_angle", "ankle_angle") for s in "rl"]
    rows = [
        "\t".join([f"{i / 50}", *["0.9" if n == "pelvis_ty" else "5" for n in names]])
        for i in range(60)
    ]
    head = f"take\nversion=1\nnRows=60\nnColumns={len(names) + 1}\ninDegrees=yes\nendheader\n"
    text = head + "\t".join(["time", *names]) + "\n" + "\n".join(rows) + "\n"
    (tmp_path / "take.mot").write_text(text, encoding="utf-8")
    assert ergoqp("score", "take.mot").status == 0
    sentence = refusal(ergoqp, tmp_path, "take.mot")
    assert "--save-person: got joint angles, which measure nobody, allowed" in sentence


@pytest.mark.slow
def test_who_is_stated_is_not_measured_by_joints(ergoqp, demo, takes, tmp_path):
    sentence = refusal(ergoqp, tmp_path, demo, "--person", "1.72")
    assert "got a person who is stated (--person) and a recording without markers" in sentence
    outcome = ergoqp("score", takes / "whole.c3d", "--person", "1.75", "--save-person", "me.toml")
    assert outcome.status == 0, outcome.err
    first = "The lengths are those that were stated (--person), and not measured."
    assert (tmp_path / "me.toml").read_text().splitlines()[0] == f"# {first}"
    assert first in outcome.out


@pytest.mark.slow
def test_markers_that_do_not_stay_are_left_out(ergoqp, takes, tmp_path):
    assert ergoqp("score", takes / "fallen.c3d", "--save-person", "me.toml").status == 0
    first, second = (tmp_path / "me.toml").read_text().splitlines()[:2]
    assert first.startswith("# Not measured, and as long as")
    assert second.startswith(
        "# Markers that move by more than 25 mm against their segment are left"
    )
    assert "RTIB by " in second
    assert "RTIB" not in person_with_markers(tmp_path / "me.toml")[1]


def test_one_arm_is_told(ergoqp, takes, tmp_path):
    outcome = ergoqp("score", takes / "one arm.c3d", "--save-person", "me.toml")
    assert outcome.status == 0, outcome.err
    assert "Measured on the right side only: upper arm, forearm." in outcome.out


@pytest.mark.parametrize("path", ["none/me.toml", ".", "x" * 300])
def test_where_nothing_can_be_written(ergoqp, demo, path):
    sentence = mistake(ergoqp("score", demo, "--save-person", path))
    assert "--save-person: got " in sentence
    assert "allowed the path of a file" in sentence


@pytest.mark.slow
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
