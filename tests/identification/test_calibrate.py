"""Base and flange from rests of one person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.identification.calibrate import _Fit
from ergoqp.joints import INDEX
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames

TRUE = Frames(
    [0.9, 0.2, 0.7, 0.1, 0.2, 0.3, np.sqrt(0.86)], [0.03, -0.02, 0.15, 0.5, -0.5, 0.5, 0.5]
)


def rests(
    problem: Problem, count: int = 10, bias_deg: float = 0.0, stature: float = 1.75, seed: int = 0
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rests of a person, whose angles are read with a constant error."""
    rng = np.random.default_rng(seed)
    who = replace(problem.response, body=Body.of_stature(stature))
    bias, found = np.radians(rng.uniform(-bias_deg, bias_deg, 32)), []
    for _ in range(count):
        posture = problem.response.comfort + 0.35 * rng.normal(size=32)
        contact = np.array(who.contact()(posture)[0])
        found.append((posture + bias, TRUE.reported_pose(contact)))
    return found


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ergoqp.load_problem("screwing")


def test_frames_of_the_model_person_are_found_exactly(problem: Problem) -> None:
    found = ergoqp.calibrate_frames(problem, rests(problem))
    # Up to what the weak prior of the frames pulls.
    np.testing.assert_allclose(found.base, TRUE.base, atol=2e-3)
    # The turn about the tool is free.
    np.testing.assert_allclose(found.flange[:3, [0, 3]], TRUE.flange[:3, [0, 3]], atol=2e-3)
    assert found.residual.max() < 1e-3
    assert found.spread is not None
    assert found.spread < 1e-3
    assert found.undetermined == ()
    assert found.left_out == ()


def test_a_person_with_errors_is_calibrated_as_far_as_it_goes(problem: Problem) -> None:
    given = rests(problem, 10, 7.0, 1.88)
    found = ergoqp.calibrate_frames(problem, given)
    honest = rests(problem, 10, 7.0, 1.88)
    away = [
        np.linalg.norm((found.contact_pose(pose) - TRUE.contact_pose(pose))[:3, 3])
        for _, pose in honest
    ]
    assert max(away) < 0.2
    assert found.spread is not None
    assert found.spread < 0.15
    # Nearer to the truth where a part is known, and unsure only of the rest.
    known = ergoqp.calibrate_frames(problem.replace(frames=TRUE), given, known=["base", "flange"])
    assert known == Frames(
        TRUE.base, TRUE.flange, None, known.offset, known.spread, known.spread_deg
    )
    assert known.unsure["base_m"] == 0.0


def test_what_the_frames_leave_is_as_plain_arithmetic_says(problem: Problem) -> None:
    given = rests(problem, 8, bias_deg=4.0)
    given[3][1][0, 3] += 0.03
    found = ergoqp.calibrate_frames(problem, given)
    by_pose = np.array([found.base @ pose @ found.flange for _, pose in given])
    by_posture = np.array([problem.response.contact()(posture)[0].full() for posture, _ in given])
    angles = np.arccos(np.sum(by_pose[:, :3, 0] * by_posture[:, :3, 0], axis=1))
    assert found.spread_deg == pytest.approx(np.degrees(angles.max()), rel=1e-6)
    shifts = by_pose[:, :3, 3] - by_posture[:, :3, 3]
    np.testing.assert_allclose(found.offset, shifts.mean(axis=0), atol=1e-12)
    assert np.argmax(found.residual) == 3
    assert 0.012 < found.residual[3] < 0.03


def test_a_start_of_the_search_is_a_frame_along_the_tool(problem: Problem) -> None:
    given = rests(problem, 8)
    fit = _Fit(problem, *(np.array(part) for part in zip(*given, strict=True)), ())
    tool = np.array([0.3, -0.5, 0.2])
    turn = fit._flange_turn(tool, TRUE.base[:3, :3] @ fit.poses[:, :3, :3])
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turn[:, 0], tool / np.linalg.norm(tool), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)


@pytest.mark.slow
def test_a_wild_rest_is_left_out(problem: Problem) -> None:
    given = rests(problem)
    posture, pose = given[3]
    given[3] = (posture, pose @ TRUE.base)
    found = ergoqp.calibrate_frames(problem, given)
    assert np.linalg.norm(found.base[:3, 3] - TRUE.base[:3, 3]) < 0.1
    assert found.left_out == (3,)
    assert found.rests == 9


def test_rests_that_are_too_similar_are_said_to_be(problem: Problem) -> None:
    posture = np.array(problem.response.comfort)
    given = []
    for turn in (0.0, 0.03, 0.06):
        posture = posture.copy()
        posture[INDEX["right_elbow_flexion"]] += turn
        given.append(
            (posture, TRUE.reported_pose(np.array(problem.response.contact()(posture)[0])))
        )
    found = ergoqp.calibrate_frames(problem, given)
    assert any("the rests are too similar" in sentence for sentence in found.undetermined)
    # Near them they are good.
    contact = np.array(problem.response.contact()(given[1][0])[0])
    assert np.linalg.norm((found.contact_pose(given[1][1]) - contact)[:3, 3]) < 0.01


@pytest.mark.slow
def test_the_log_of_a_stepper_is_read_as_the_robot_reported(problem: Problem) -> None:
    log: list[dict[str, object]] = []
    stepper = ergoqp.Stepper(problem, log=log.append)
    for posture, pose in rests(problem, 3):
        for _ in range(600):
            stepper.step(posture, pose=pose)
    found = ergoqp.calibrate_frames(problem, log)
    assert found.rests == 3
    assert found.residual.max() < 0.01


def test_few_rests_determine_the_base_as_far_as_people_are_alike(problem: Problem) -> None:
    """Of people of any stature it would be 0.133 m."""
    found = ergoqp.calibrate_frames(problem, rests(problem, 3, bias_deg=5.0))
    assert found.unsure["base_m"] == pytest.approx(0.115, abs=0.008)


@pytest.mark.parametrize("shift", [0, 3])
def test_poses_of_other_moments_are_said_not_to_fit(problem: Problem, shift: int) -> None:
    right = rests(problem, 10, bias_deg=5.0)
    mixed = [(posture, right[(i + shift) % 10][1]) for i, (posture, _) in enumerate(right)]
    said = "; ".join(ergoqp.calibrate_frames(problem, mixed).undetermined)
    assert ("of the same moments" in said) == (shift > 0)


def test_wrong_arguments_are_named(problem: Problem) -> None:
    good = rests(problem, 3)
    with pytest.raises(InputError, match="rests: got 2, allowed at least 3"):
        ergoqp.calibrate_frames(problem, good[:2])
    for wrong, said in ((["camera"], "camera"), ("base", "'base'"), (None, "None"), (5, "5")):
        with pytest.raises(InputError, match=f"known: got {said}, allowed a list of 'base' and"):
            ergoqp.calibrate_frames(problem, good, known=wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="has no person"):
        ergoqp.calibrate_frames(ergoqp.load_problem("forearm"), good)
    in_degrees = [(np.degrees(posture), pose) for posture, pose in good]
    with pytest.raises(InputError, match=r"rests\[0\]: posture: got .* rad: is it in degrees\?"):
        ergoqp.calibrate_frames(problem, in_degrees)
    unseen = good[0][0].copy()
    unseen[INDEX["right_elbow_flexion"]] = np.nan
    with pytest.raises(InputError, match="a joint between floor and hand was not seen"):
        ergoqp.calibrate_frames(problem, [(unseen, good[0][1]), *good[1:]])
    unseen = good[0][0].copy()
    unseen[INDEX["left_elbow_flexion"]] = np.nan
    ergoqp.calibrate_frames(problem, [(unseen, good[0][1]), *good[1:]])
