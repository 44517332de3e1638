"""A run from beginning to end: complete, repeatable, judged against standing still, and saved
without pickle."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import INDEX, UPPER
from ergoqp.limits import WorkspaceBox
from ergoqp.problem.settings import Control
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.robot import moved
from ergoqp.simulation.run import Run, arrays_of, summary_of_run
from ergoqp.simulation.simulate import simulate

KEYS = {
    "tries",
    "version",
    "problem",
    "title",
    "recording",
    "start_time_s",
    "seed",
    "dt",
    "steps",
    "duration_s",
    "reba_before",
    "reba_after",
    "reba_best",
    "reba_standing_still",
    "segments_before",
    "segments_after",
    "status_counts",
    "step_time_us",
    "settle_s",
    "guide",
    "let_go_s",
    "violations",
    "max_violation",
    "units",
    "person_outside",
    "person",
    "unobserved",
    "follower",
    "hand_force_n",
    "slips",
    "fell_s",
    "unbalanced_share",
    "options",
    "assumptions",
}


@pytest.fixture(scope="module")
def problem():
    return ergoqp.load_problem("screwing")


@pytest.fixture(scope="module")
def start(problem):
    return awkward_start(problem, sample_person(problem, 0), 0)


@pytest.fixture(scope="module")
def run(problem, start) -> Run:
    return simulate(problem, start, duration=4.0, seed=0, assumptions=["Given by the test."])


@pytest.mark.slow
def test_every_field_is_filled(problem, run):
    n = 400
    shapes = {
        "time": (n,),
        "postures": (n, 32),
        "base_poses": (n, 4, 4),
        "poses": (n, 4, 4),
        "twists": (n, 6),
        "reba": (n,),
        "cost": (n,),
        "step_time": (n,),
    }
    for name, shape in shapes.items():
        values = getattr(run, name)
        assert values.shape == shape, name
        assert np.isfinite(values).all(), name
    assert [len(series) for series in (run.statuses, run.reasons, run.active)] == [n, n, n]
    assert (run.problem, run.title, run.dt, run.seed) == ("screwing", problem.title, 0.01, 0)
    assert run.joints == problem.joints
    assert set(run.violations) == set(run.max_violation) == set(run.units)
    assert run.assumptions[0] == "Given by the test."
    assert any("1.75 m" in sentence for sentence in run.assumptions)
    assert run.recording is None


@pytest.mark.slow
def test_scores_are_those_of_the_true_postures(problem, run, start):
    np.testing.assert_array_equal(run.reba, problem.assess(run.postures).final)
    np.testing.assert_array_equal(run.assessment.final, run.reba[[0, -1]])
    np.testing.assert_array_equal(run.postures[0], start)
    assert run.reba[-1] < run.reba[0]


def test_poses_follow_the_twists_sent(run):
    for i in (0, 100, 250):
        np.testing.assert_allclose(
            moved(run.poses[i], run.twists[i] * run.dt), run.poses[i + 1], atol=1e-12
        )


@pytest.mark.slow
def test_same_seed_same_run(problem, run, start):
    again = simulate(problem, start, duration=1.0, seed=0)
    np.testing.assert_array_equal(again.twists, run.twists[:100])
    other = simulate(problem, start, duration=1.0, seed=1)
    assert np.abs(other.twists - again.twists).max() > 1e-6


@pytest.mark.slow
def test_standing_still_is_what_a_robot_that_stands_still_gets(problem, start):
    """The score it is compared with is that of a loop in which the object never moves."""
    person = sample_person(problem, 0)
    frozen = problem.replace(control=Control(move_above=1e6, rest_below=1e6, rest_after=0.0))
    still = simulate(frozen, start, duration=15.0, person=person)
    moving = simulate(problem, start, duration=1.0, person=person)
    assert np.abs(still.poses[-1] - still.poses[0]).max() < 0.02
    assert still.reba[-1] == moving.reba_standing_still


@pytest.mark.slow
def test_body_of_the_person(problem, start):
    body = Body.of_stature(1.62)
    run = simulate(problem, start, duration=0.5, person=body)
    assert run.body is body
    assert any("1.62 m" in sentence for sentence in run.assumptions)


@pytest.mark.slow
def test_unobserved_joints_reach_the_loop(problem, start):
    observed = np.ones(32, dtype=bool)
    observed[[INDEX["neck_twist"], INDEX["right_wrist_flexion"]]] = False
    blind = simulate(problem, start, duration=0.5, observed=observed)
    assert blind.unobserved == ("neck_twist", "right_wrist_flexion")
    assert any(
        "does not see neck twist, right wrist flexion" in sentence for sentence in blind.assumptions
    )
    seeing = simulate(problem, start, duration=0.5)
    assert np.abs(blind.twists - seeing.twists).max() > 1e-6


@pytest.mark.slow
def test_start_beyond_a_range_is_said(problem, start):
    posture = start.copy()
    posture[INDEX["left_wrist_flexion"]] = UPPER[INDEX["left_wrist_flexion"]] + 0.1
    run = simulate(problem, posture, duration=0.1)
    assert run.postures[0, INDEX["left_wrist_flexion"]] == UPPER[INDEX["left_wrist_flexion"]]
    assert any(
        "left wrist flexion" in sentence and "end" in sentence for sentence in run.assumptions
    )


@pytest.mark.slow
def test_progress_goes_to_the_end(problem, start):
    shares = []
    simulate(problem, start, duration=0.5, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


def test_options_name_every_control_parameter(run):
    told = dict(run.options)
    for entry in fields(Control):
        assert f"control: {entry.name.replace('_', ' ')}" in told
    assert told["task: load"] == "0.5 kg"
    assert told["task: arm supported"] == "no"
    assert "rate 90 deg/s" in told["joint limit"]
    assert "0.8 at 1.5 deg" in told["cost"]


def test_saved(run, tmp_path):
    path = run.save(tmp_path / "new" / "folder")
    assert path.name == "run.json"
    summary = json.loads(path.read_text(encoding="utf-8"))
    assert set(summary) == KEYS
    assert summary == json.loads(json.dumps(summary_of_run(run)))
    assert summary["steps"] == 400
    assert summary["reba_before"] == run.reba[0]
    assert summary["reba_after"] == run.reba[-1]
    assert summary["reba_best"] == run.reba.min()
    assert sum(summary["status_counts"].values()) == 400
    assert set(summary["step_time_us"]) == {"median", "p99", "max"}
    assert {"neck", "trunk", "legs", "right_wrist", "left_upper_arm"} <= set(
        summary["segments_before"]
    )
    with np.load(path.with_name("run.npz"), allow_pickle=False) as arrays:
        assert set(arrays) == set(arrays_of(run))
        np.testing.assert_array_equal(arrays["postures"], run.postures)
        assert arrays["statuses"].tolist() == run.statuses
        assert arrays["reasons"].tolist() == run.reasons
        names = arrays["active_names"]
        assert [tuple(sorted(set(active))) for active in run.active] == [
            tuple(names[row]) for row in arrays["active"]
        ]


def test_documented():
    """Every key of run.json and every array of run.npz is in its documentation."""
    text = (Path(__file__).resolve().parents[2] / "docs" / "run_json.md").read_text(
        encoding="utf-8"
    )
    for key in KEYS:
        assert f"`{key}`" in text, key


def test_an_endless_violation_is_null(run, tmp_path):
    broken = replace(run, max_violation={"speed": float("inf")}, settle=None, let_go=0.1 + 0.2)
    summary = json.loads(broken.save(tmp_path).read_text(encoding="utf-8"))
    assert summary["max_violation"] == {"speed": None}
    assert summary["settle_s"] is None
    assert summary["let_go_s"] == 0.3


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (dict(posture=np.zeros(31)), r"posture: got shape \(31,\)"),
        (dict(posture=np.full(32, np.nan)), "posture: got nan for trunk_flexion"),
        (dict(posture=np.full(32, 20.0)), "degrees given as radians"),
        (dict(posture="upright"), "posture: got str"),
        (dict(duration=0.0), "duration: got 0.0 s"),
        (dict(duration=float("nan")), "duration"),
        (dict(seed=-1), "seed: got -1"),
        (dict(seed=1.5), "seed: got 1.5"),
        (dict(observed=np.ones(32)), "observed: got an array of float64 of shape"),
    ],
)
def test_wrong_arguments(problem, wrong, words):
    arguments = {"posture": np.zeros(32), "duration": 1.0, **wrong}
    with pytest.raises(InputError, match=words):
        simulate(problem, **arguments)


class TestAwkwardStart:
    def test_bad_reached_and_repeatable(self, problem):
        person = sample_person(problem, 3)
        posture = awkward_start(problem, person, 3)
        np.testing.assert_array_equal(posture, awkward_start(problem, person, 3))
        assert problem.assess(posture).final[0] > problem.assess(person.response.comfort).final[0]
        pose = person.contact(posture)[0]
        box = problem.limit_of(WorkspaceBox)
        assert (pose[:3, 3] >= box.lower).all()
        assert (pose[:3, 3] <= box.upper).all()

    def test_without_a_workspace(self, problem):
        limits = [limit for limit in problem.limits if not isinstance(limit, WorkspaceBox)]
        with pytest.raises(InputError, match=r"no limits\.workspace"):
            awkward_start(problem.replace(limits=limits), sample_person(problem, 0), 0)

    def test_nowhere_to_reach(self, problem):
        # Only a tall person with long arms could.
        box = WorkspaceBox((1.7, -0.1, 1.0), (1.8, 0.1, 1.1))
        limits = [box if isinstance(limit, type(box)) else limit for limit in problem.limits]
        with pytest.raises(InputError, match="none of 3 places of the workspace can be a start"):
            awkward_start(problem.replace(limits=limits), sample_person(problem, 0), 0, places=3)
