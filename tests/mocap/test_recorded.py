"""Somebody in a recording does the task of a problem: in their body, where their hand is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import ergoqp
from benchmarks.made_motions import BODY, fitted, posture, stoop
from ergoqp.errors import InputError
from ergoqp.human import Kinematics
from ergoqp.joints import INDEX, SIDES
from ergoqp.limits.workspace import AxisCone, WorkspaceBox
from ergoqp.mocap import Recording, load_recording
from ergoqp.mocap.demo_recording import demo_recording
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recorded import as_recorded, held_poses, planted, seat_above_feet
from ergoqp.problem.geometry import turn_about
from ergoqp.simulation.people import person_of_kind


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return load_recording(demo_recording(tmp_path_factory.mktemp("demo") / "demo.bvh"))


def still(**angles: float) -> Recording:
    """A recording of one posture [deg]."""
    pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (3, 1))
    return fitted(centres_of(BODY, pelvis, posture(3, **angles)), neutral="vertical")


@pytest.mark.slow
def test_who_sits_sits() -> None:
    seated = still(legs_hip_flexion=88.0, legs_knee_flexion=90.0)
    height = seat_above_feet(seated, 0)
    assert height == pytest.approx(0.246 * 1.72 + 0.039 * 1.72, abs=0.05)
    problem, _, notes = as_recorded(ergoqp.load_problem("screwing"), seated, 0)
    assert problem.response.stance == "seated"
    assert problem.response.seat == height
    assert any("seated, as in the recording" in note for note in notes)
    assert problem.task["seated"] is True
    with pytest.raises(InputError, match="learned cost knows only that"):
        as_recorded(ergoqp.load_problem("screwing_learned"), seated, 0)
    # A squat is balanced over the feet.
    legs = {"legs_hip_flexion": 95.0, "legs_knee_flexion": 130.0, "legs_ankle_flexion": 35.0}
    squat = still(**legs, trunk_flexion=45.0, arms_shoulder_flexion=60.0)
    assert seat_above_feet(squat, 0) is None
    assert seat_above_feet(still(), 0) is None
    assert as_recorded(ergoqp.load_problem("dentist"), still(), 0)[0].response.stance == "standing"


@pytest.mark.parametrize("frame", [0, 60, 120, 180])
def test_both_soles_are_flat_on_one_floor(frame: int, demo: Recording) -> None:
    recorded = demo.postures[frame].copy()
    for lifted, given in ((0.0, demo), (25.0, None)):
        if given is None:
            bent = demo.postures.copy()
            bent[:, INDEX["left_knee_flexion"]] += np.radians(lifted)
            given = Recording(**{**vars(demo), "postures": bent})
        found, kinematics = planted(given, frame), Kinematics(demo.person)
        heights = []
        for side in SIDES:
            place, axes, _ = kinematics.at(f"{side}_sole", ca.DM(found))
            heights.append(float(place[2]))
            assert float(axes[2, 2]) > np.cos(np.radians(4))
            assert found[INDEX[f"{side}_knee_flexion"]] >= np.radians(5) - 1e-9
        assert abs(heights[0] - heights[1]) < 0.01
        np.testing.assert_array_equal(found[:20], recorded[:20])


def test_who_kneels_is_refused() -> None:
    kneeling = still(legs_hip_flexion=0.0, legs_knee_flexion=90.0, legs_ankle_flexion=-40.0)
    with pytest.raises(InputError, match="neither sits nor stands on both feet"):
        as_recorded(ergoqp.load_problem("screwing"), kneeling, 0)


def test_the_task_is_where_the_hand_is(demo: Recording) -> None:
    plain = ergoqp.load_problem("screwing")
    problem, start, _ = as_recorded(plain, demo, 150)
    assert problem.response.body == demo.person
    pose = np.array(problem.response.contact()(start)[0])
    for limit in problem.limits:
        if isinstance(limit, WorkspaceBox):
            assert (np.array(limit.lower) <= pose[:3, 3]).all()
            assert (np.array(limit.upper) >= pose[:3, 3]).all()
        if isinstance(limit, AxisCone):
            assert np.array(limit.direction) @ pose[:3, 0] >= np.cos(np.radians(35)) - 1e-9
    # Where it was inside all the same nothing changes.
    inside = [each for each in plain.limits if not isinstance(each, WorkspaceBox | AxisCone)]
    assert [each for each in problem.limits if each in inside] == inside


def test_a_hand_that_is_elsewhere_has_its_task_there() -> None:
    plain, recording = ergoqp.load_problem("screwing"), still(arms_elbow_flexion=5.0)
    problem, start, notes = as_recorded(plain, recording, 0)
    pose = np.array(problem.response.contact()(start)[0])
    before = next(each for each in plain.limits if isinstance(each, WorkspaceBox))
    assert pose[0, 3] < before.lower[0]
    box, cone = (
        next(each for each in problem.limits if isinstance(each, kind))
        for kind in (WorkspaceBox, AxisCone)
    )
    assert (np.array(box.lower) <= pose[:3, 3] - 0.01).all()
    assert (np.array(box.upper) >= pose[:3, 3] + 0.01).all()
    assert (np.array(box.lower) <= before.lower).all()
    np.testing.assert_allclose(cone.direction, pose[:3, 0], atol=1e-6)
    assert sum("recording" in note for note in notes) == 3


def ends(recording: Recording, frame: int, seed: int) -> tuple[int, int]:
    """Return the scores at the end, and had the object stayed where it was."""
    problem, start, _ = as_recorded(ergoqp.load_problem("screwing"), recording, frame)
    holding = person_of_kind("alike", problem, seed, recording.person).hold(start, seed=seed)
    holding.rest(holding.pose)
    run = ergoqp.simulate(problem, holding, 15.0, seed)
    assert run.let_go is None
    return int(run.reba[-1]), run.reba_standing_still


@pytest.mark.slow
@pytest.mark.parametrize("frame", [60, 150])
def test_the_end_is_not_worse_than_leaving_the_object_alone(frame: int, demo: Recording) -> None:
    after, alone = ends(demo, frame, 1)
    assert after <= alone


@pytest.mark.slow
def test_a_real_unscrewing_posture_gets_no_worse(shared: Path) -> None:
    path = shared / "mocap" / "bvh" / "cmu_62_04_screwing_keyframes.bvh"
    recording = load_recording(path)
    for frame, seed in ((5, 0), (7, 1), (11, 2)):
        after, alone = ends(recording, frame, seed)
        assert after <= alone


@pytest.mark.slow
def test_a_deep_stoop_can_be_started_from() -> None:
    recording = fitted(stoop(deepest=60.0, stands=False)[0])
    after, alone = ends(recording, 10, 0)
    assert after <= alone


def test_an_object_in_the_hand_is_where_the_hand_is(demo: Recording) -> None:
    """However it is held, and wherever the person stands in the recording."""
    response = replace(ergoqp.load_problem("screwing").response, body=demo.person)
    postures, by_hand = held_poses(demo, response, by_hand=True)
    np.testing.assert_array_equal(postures, demo.postures[demo.scored])
    for q, pose in zip(postures[::40], by_hand[::40], strict=True):
        np.testing.assert_allclose(pose, np.array(response.contact()(q)[0]), atol=1e-12)
    grip = np.eye(4)
    grip[:3, :3], grip[:3, 3] = turn_about(2, 0.7), (0.1, -0.05, 0.2)
    held = []
    for q, base in zip(demo.postures, demo.base_poses, strict=True):
        contact, pelvis = (np.array(part) for part in response.contact()(q))
        held.append(base @ np.linalg.inv(pelvis) @ contact @ grip)
    held[3] = np.full((4, 4), np.nan)
    recording = replace(demo, object_poses=np.array(held))
    seen, poses = held_poses(recording, response)
    assert len(seen) == len(postures) - 1
    np.testing.assert_allclose(poses, np.delete(by_hand, 3, axis=0), atol=1e-9)
    with pytest.raises(InputError, match="recording: has no held object"):
        held_poses(demo, response)
    nowhere = replace(demo, object_poses=np.full((len(held), 4, 4), np.nan))
    with pytest.raises(InputError, match="no frame shows a posture and the object"):
        held_poses(nowhere, response)
