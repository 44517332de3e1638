"""The report's second model: posture and cost in relation to the object's pose."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import problem_of

from benchmarks.second_model import conditional_mean, errors_of
from ergoqp.errors import InputError, ModelError
from ergoqp.joints import INDEX, JOINTS
from ergoqp.learning.mixtures import MixtureRegression
from ergoqp.learning.model_file import load_model, save_model
from ergoqp.problem.geometry import pose_error, turned
from ergoqp.problem.load import load_problem, problem_from_dict
from ergoqp.responses import gmr
from ergoqp.responses.gmr import GmrResponse, coordinates_of, mean_pose
from ergoqp.responses.ik import IkResponse

ARM = [INDEX[f"right_{joint}"] for joint in ("shoulder_flexion", "elbow_flexion", "wrist_flexion")]


def person() -> IkResponse:
    response = problem_of("screwing").response
    assert isinstance(response, IkResponse)
    return response


def recorded(count: int = 400, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Postures of a person of whom three joints and the trunk move, and where the hand is."""
    rng = np.random.default_rng(seed)
    postures = np.tile(person().comfort, (count, 1))
    postures[:, ARM] += 0.25 * rng.normal(size=(count, 3))
    postures[:, INDEX["trunk_flexion"]] += 0.1 * rng.normal(size=count)
    return postures, np.array([np.array(person().contact()(q)[0]) for q in postures])


def value(postures: np.ndarray) -> np.ndarray:
    return 3.0 + (np.atleast_2d(postures)[:, ARM] ** 2).sum(axis=1)


@cache
def model() -> GmrResponse:
    return GmrResponse.fit(*recorded(), value, person(), components=4)


def moved(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    after = pose.copy()
    after[:3, 3] += twist[:3]
    after[:3, :3] = turned(pose[:3, :3], twist[3:])
    return after


def test_joints_and_cost_at_a_pose_are_the_conditional_mean_of_the_mixture() -> None:
    """And the derivative is that of them along a twist of the world."""
    assert len(model().mixture.weights) == 4
    derivative, call, shared = np.max(list(errors_of(model())), axis=0)
    assert derivative < 1e-8
    assert call < 1e-10
    assert shared > 0.3
    pose = ca.MX.sym("pose", 4, 4)
    function = ca.Function("prediction", [pose], list(model().prediction(pose)))
    for at in recorded(10, seed=1)[1]:
        x = model().x_r(at[None])
        np.testing.assert_allclose(
            np.array(function(at)[1]), model().regression.covariance(x)[0], atol=1e-10
        )
        np.testing.assert_allclose(
            np.array(function(at)[0]).ravel(), conditional_mean(model(), x[0]), atol=1e-10
        )


def test_a_posture_that_follows_linearly_is_followed_as_it_does() -> None:
    """One Gaussian is a straight line: known in advance, in position and in rotation."""
    rng, slope = np.random.default_rng(3), np.array([0.5, -1.0, 0.3, 0.2, 0.4, -0.1])
    x = rng.normal(size=(2000, 6)) * 0.05
    centre = np.array(person().contact()(person().comfort)[0])
    poses = np.array([moved(centre, each) for each in x])
    postures = np.tile(person().comfort, (2000, 1))
    postures[:, ARM[0]] += x @ slope

    def cost(rows: np.ndarray) -> np.ndarray:
        return 3.0 - 2.0 * rows[:, ARM[0]]

    firm = replace(person(), free_about_tool=False)
    found = GmrResponse.fit(postures, poses, cost, firm, components=1, regularisation=1e-9)
    assert found.joints == (JOINTS[ARM[0]],)
    S, dV = (np.array(part) for part in found.slopes()(mean_pose(poses)))
    np.testing.assert_allclose(S[ARM[0]], slope, atol=1e-3)
    assert not np.delete(S, ARM[0], axis=0).any()
    np.testing.assert_allclose(dV.ravel(), -2.0 * slope, atol=2e-3)


def test_where_the_object_is_follows_from_the_posture() -> None:
    q, locked = recorded(3, seed=4)[0][2], np.zeros(32)
    locked[ARM[1]] = 1.0
    here = np.array(person().contact()(q)[0])
    S, E = (np.array(part) for part in model().sensitivity()(q, locked))
    expected = np.array(model().slopes()(here)[0])
    expected[ARM[1]] = 0.0
    np.testing.assert_allclose(S, expected, atol=1e-12)
    np.testing.assert_allclose(
        np.array(ca.evalf(model().expression(ca.MX(ca.DM(q)))))[ARM[0]], S[ARM[0]]
    )
    J = np.zeros((6, 32))
    for joint in range(32):
        step = 1e-6 * np.eye(32)[joint]
        ends = (np.array(person().contact()(q + each)[0]) for each in (-step, step))
        J[:, joint] = pose_error(*ends) / 2e-6
    # The hand may turn about the tool.
    assert person().free_about_tool
    kept = np.eye(6)
    kept[3:, 3:] -= np.outer(here[:3, 0], here[:3, 0])
    np.testing.assert_allclose(E, kept @ (np.eye(6) - J @ S), atol=1e-7)
    firm = replace(model(), person=replace(person(), free_about_tool=False))
    S, E = (np.array(part) for part in firm.sensitivity()(q, locked))
    np.testing.assert_allclose(E, np.eye(6) - J @ S, atol=1e-7)


def test_how_the_hand_turns_about_the_tool_does_not_count() -> None:
    postures, contacts = recorded()
    rng = np.random.default_rng(8)
    rolls = np.array([turned(np.eye(3), [angle, 0.0, 0.0]) for angle in rng.uniform(-3, 3, 400)])
    poses = contacts.copy()
    poses[:, :3, :3] = contacts[:, :3, :3] @ rolls
    rolled, plain = (
        GmrResponse.fit(postures, each, value, person(), components=2) for each in (poses, contacts)
    )
    np.testing.assert_allclose(rolled.mixture.means, plain.mixture.means, atol=1e-9)
    for one, two in zip(rolled.slopes()(poses[3]), plain.slopes()(contacts[3]), strict=True):
        np.testing.assert_allclose(np.array(one), np.array(two), atol=1e-6)
        about = np.r_[np.zeros(3), contacts[3, :3, 0]]
        np.testing.assert_allclose(np.array(one) @ about, 0, atol=1e-9)
    firm = replace(person(), free_about_tool=False)
    with pytest.raises(InputError, match="object: it turns by"):
        GmrResponse.fit(postures, poses, value, firm, components=2)


@pytest.mark.parametrize("moves", [np.r_[1, 1, 1, 0, 0, 0], np.r_[0, 0, 0, 1, 1, 1]])
def test_an_object_may_only_move_or_only_turn(moves: np.ndarray) -> None:
    """Of what did not move nothing is known: S is zero."""
    rng = np.random.default_rng(7)
    x = 0.1 * rng.normal(size=(300, 6)) * moves
    centre = np.array(person().contact()(person().comfort)[0])
    postures = np.tile(person().comfort, (300, 1))
    postures[:, ARM[0]] += x @ np.ones(6)
    poses = np.array([moved(centre, each) for each in x])
    firm = replace(person(), free_about_tool=False)
    found = GmrResponse.fit(postures, poses, value, firm, components=1, regularisation=1e-6)
    S = np.array(found.slopes()(found.mean)[0])[ARM[0]]
    np.testing.assert_allclose(S, moves, atol=1e-2)


def linear(count: int, keeps: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A recording that is one Gaussian, of frames that keep a part of the one before."""
    rng = np.random.default_rng(5)
    wander = np.zeros((count, 9))
    for number in range(1, count):
        fresh = np.sqrt(1 - keeps**2) * rng.normal(size=9)
        wander[number] = keeps * wander[number - 1] + fresh
    x = 0.05 * wander[:, :6]
    centre = np.array(person().contact()(person().comfort)[0])
    postures = np.tile(person().comfort, (count, 1))
    postures[:, ARM] += x[:, :3] + 0.02 * wander[:, 6:]
    return postures, np.array([moved(centre, each) for each in x])


def test_bic_takes_as_many_gaussians_as_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    firm = replace(person(), free_about_tool=False)

    def count(rows: tuple[np.ndarray, np.ndarray], components: tuple[int, ...]) -> int:
        return len(GmrResponse.fit(*rows, value, firm, components).mixture.weights)

    postures, poses = recorded(800)
    apart = poses.copy()
    apart[::2, 0, 3] += 0.5
    assert count(linear(800), (1, 2, 4)) == 1
    assert count((postures, apart), (1, 2)) == 2
    # More Gaussians than the frames can fill are not tried.
    assert count((postures[:30], poses[:30]), (1, 24)) == 1
    # Frames that are nearly those before them are no evidence for more.
    assert count(linear(800, keeps=0.97), (1, 2, 4)) == 1
    monkeypatch.setattr(gmr, "_independent", lambda columns: 1.0)
    assert count(linear(800, keeps=0.97), (1, 2, 4)) == 4


def test_x_r_is_relative_to_the_mean_pose_along_the_axes_of_the_world() -> None:
    poses = recorded(50)[1]
    mean, turn = mean_pose(poses), np.eye(4)
    turn[:3, :3] = turned(np.eye(3), np.array([0.3, -0.2, 1.0]))
    np.testing.assert_allclose(mean_pose(turn @ poses), turn @ mean, atol=1e-12)
    x = coordinates_of(poses, mean)
    np.testing.assert_allclose(x[:, :3].mean(axis=0), 0, atol=1e-12)
    for pose, each in zip(poses, x, strict=True):
        np.testing.assert_allclose(pose_error(mean, pose), each, atol=1e-9)


def test_a_saved_model_gives_the_same_numbers(tmp_path: Path) -> None:
    path, q = tmp_path / "response.npz", recorded(2, seed=6)[0][1]
    model().save(path)
    loaded = GmrResponse.load(path)
    sent = pickle.loads(pickle.dumps(model()))
    file = {"response": {"gmr": {"model": "response.npz"}}}
    problem = problem_from_dict(file, "own", tmp_path)
    for other in (loaded, sent, problem.response):
        for one, two in zip(other.sensitivity()(q, 0), model().sensitivity()(q, 0), strict=True):
            np.testing.assert_array_equal(np.array(one), np.array(two))
    assert loaded.joints == model().joints
    assert loaded.stance == person().stance
    np.testing.assert_array_equal(loaded.comfort, person().comfort)
    np.testing.assert_array_equal(loaded.weight_vector, person().weight_vector)
    assert problem.task["seated"] is False


def spun() -> np.ndarray:
    """Poses of which a few turn by 170 degrees about the vertical."""
    poses = recorded()[1]
    mean = mean_pose(poses)
    poses[-1, :3, :3] = turned(mean[:3, :3], np.array([0.0, 0.0, np.radians(170.4)]))
    return poses


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": np.tile(np.eye(4), (400, 1, 1))}, "object: it moves by 0.0 mm and 0.0 deg"),
        ({"poses": np.zeros((400, 4, 4))}, "poses: got a pose that is not a rigid motion"),
        ({"poses": np.tile(np.diag([1, 1, -1, 1.0]), (400, 1, 1))}, "poses: got a pose that is"),
        ({"poses": spun()}, "object: it turns by 16"),
        ({"cost": lambda q: 1.0}, "cost: got"),
        ({"cost": lambda q: np.full(len(q), np.nan)}, "cost: got"),
        ({"poses": np.tile(np.eye(4), (3, 1, 1))}, "poses: got"),
        ({"postures": np.zeros((400, 32))}, "postures: no joint moves"),
        ({"postures": [[1.0], [1.0, 2.0]]}, "postures: got"),
        ({"postures": np.zeros((400, 3))}, "postures: got"),
        ({"postures": None}, "postures: got"),
        ({"postures": np.full((400, 32), np.nan)}, "postures: got"),
        ({"postures": np.zeros((1, 32)), "poses": np.eye(4)[None]}, "postures: got 1 frames"),
        ({"components": 0}, "components: got 0"),
        ({"components": []}, "components: got None"),
        ({"components": 2.5}, "components: got 2.5"),
        ({"components": None}, "components: got None"),
        (
            {"components": 40},
            "postures: got 400 frames, allowed at least 520: 13 for each Gaussian",
        ),
        ({"seed": -1}, "seed: got -1"),
        ({"regularisation": 0.0}, "regularisation: got 0"),
    ],
)
def test_what_shows_nothing_is_refused(change: dict[str, Any], message: str) -> None:
    postures, poses = recorded()
    given: dict[str, Any] = {"postures": postures, "poses": poses, "components": 4, "cost": value}
    with pytest.raises(InputError) as found:
        GmrResponse.fit(person=person(), **given | change)
    assert str(found.value).startswith(message)
    assert "\n" not in str(found.value)


def test_parts_that_do_not_fit_together_are_refused(tmp_path: Path) -> None:
    mixture = MixtureRegression(np.ones(1), np.zeros((1, 9)), np.eye(9)[None])
    two: Any = ("trunk_flexion", "trunk_twist")
    with pytest.raises(ModelError, match="a mixture of 9 columns, allowed 8: x_r, 1 joints, V"):
        GmrResponse(person(), mixture, ("trunk_flexion",), np.eye(4))
    for given, message in (
        ((person(), mixture, ("trunk_flexion", "tail"), np.eye(4)), "joints: got"),
        ((person(), mixture, ("trunk_flexion",) * 2, np.eye(4)), "joints: got"),
        ((person(), mixture, None, np.eye(4)), "joints: got None"),
        ((None, mixture, two, np.eye(4)), "person: got None"),
        ((person(), None, two, np.eye(4)), "mixture: got None"),
        ((person(), mixture, two, 2 * np.eye(4)), "mean: got"),
        ((person(), mixture, two, np.full((4, 4), np.nan)), "mean: got"),
    ):
        with pytest.raises(InputError, match=message):
            GmrResponse(*given)  # type: ignore[arg-type]
    flat = MixtureRegression(np.ones(1), np.zeros((1, 9)), np.zeros((1, 9, 9)))
    with pytest.raises(ModelError, match="has no variance"):
        GmrResponse(person(), flat, two, np.eye(4))
    path = tmp_path / "response.npz"
    model().save(path)
    header, arrays = load_model(path)
    for wrong, message in (
        (
            ({**header, "kind": "gmr"}, arrays),
            "holds a model of kind 'gmr', allowed 'gmr_response'",
        ),
        (({**header, "joints": ["tail"]}, arrays), "joints: got"),
        (({**header, "joints": 3}, arrays), "does not hold what"),
        (({**header, "person": {}}, arrays), "does not hold what a model of kind 'gmr_response'"),
        ((header, {k: v for k, v in arrays.items() if k != "mean"}), "does not hold what"),
        ((header, {**arrays, "mean": np.zeros(3)}), "does not hold what"),
    ):
        save_model(path, *wrong)
        with pytest.raises(ModelError, match=message):
            GmrResponse.load(path)


@pytest.mark.slow
def test_the_step_keeps_the_objects_limits_with_it() -> None:
    from tools.fuzz.fuzz import run_chunk

    problem = load_problem("screwing").replace(response=model())
    problem = problem.replace(frames=replace(problem.frames, compare=False))
    tally = run_chunk((3, 500), of=problem)
    assert tally.steps == 500
    assert tally.counts["unsafe"] == tally.counts["exceptions"] == 0
    assert tally.answered == tally.judged > 50
