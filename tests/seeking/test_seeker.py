"""Whole loops that try places: the best measured is where they end, whatever comes in."""

from __future__ import annotations

import json
import time
from functools import cache
from typing import Any

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.identification.identify import Identifier
from ergoqp.problem.problem import Problem
from ergoqp.seeking import Place, Seeker, Seeking
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.run import Run
from ergoqp.simulation.starts import awkward_place


@cache
def start(kind: str, name: str, seed: int) -> tuple[Problem, Any, np.ndarray]:
    problem = ergoqp.load_problem(name)
    person = person_of_kind(kind, problem, seed)
    place, posture = awkward_place(problem, person, seed)
    return problem, person.at(place, None, seed), posture


@cache
def best_of_model(name: str) -> np.ndarray:
    problem = ergoqp.load_problem(name)
    return ergoqp.optimise(problem, problem.response.comfort, starts=4).pose  # type: ignore


@cache
def sought(kind: str, name: str, seed: int, **how: Any) -> Run:
    problem, holding, _ = start(kind, name, seed)
    places = [Place("model", best_of_model(name))]
    return ergoqp.simulate(problem, holding.copy(), 70.0, seed, seek=places)


@pytest.mark.parametrize(
    ("kind", "name", "seed"), [("stubborn", "desk", 2), ("alike", "low_bin", 1)]
)
def test_it_ends_at_the_best_that_it_measured(kind: str, name: str, seed: int) -> None:
    run = sought(kind, name, seed)
    scores = [each.score for each in run.tries if np.isfinite(each.score)]
    assert len(run.tries) > 1
    assert run.tries[-1].score <= min(scores) + 0.2 + 1e-9
    assert not run.twists[-300:].any()
    assert run.statuses[-1] == "settled"
    assert sum(run.violations.values()) == 0
    assert run.reba[-100:].max() <= run.reba[0]
    assert run.tries[0].ended < 20.0


def test_the_account_is_saved_with_the_run(tmp_path) -> None:
    run = sought("stubborn", "desk", 2)
    saved = json.loads(run.save(tmp_path).read_text(encoding="utf-8"))["tries"]
    assert [each["name"] for each in saved] == [each.name for each in run.tries]
    assert saved[0]["why"] == "downhill"
    assert saved[0]["score"] == pytest.approx(run.tries[0].score)


def test_at_rest_at_the_end_it_says_so() -> None:
    run = sought("stubborn", "desk", 2)
    assert run.reasons[-1] == "at rest: at the best of the places tried"


def steps_of(seeker: Seeker, posture: np.ndarray, count: int) -> list:
    return [seeker.step(posture) for _ in range(count)]


def test_who_says_no_is_left_alone_until_asked_again() -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], thinks=False)
    assert any(step.twist.any() for step in steps_of(seeker, posture, 50))
    seeker.hold()
    held = steps_of(seeker, posture, 200)
    assert not held[-1].twist.any()
    assert held[-1].status == "braking"
    assert "held" in held[-1].reason
    seeker.try_again()
    assert any(step.twist.any() for step in steps_of(seeker, posture, 50))


def test_a_person_who_never_follows_ends_at_rest_in_time() -> None:
    problem, _, posture = start("alike", "screwing", 1)
    how = Seeking(patience=5.0, longest=20.0)
    seeker = Seeker(problem, [best_of_model("screwing")], how, patient=True)
    steps = steps_of(seeker, posture, 4000)
    assert not any(step.twist.any() for step in steps[-500:])
    assert not seeker.seeks
    assert seeker.account[-1].ended < 25.0


def test_whatever_comes_in_a_step_comes_out() -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], Seeking(patience=1.0), patient=True)
    rng, wild = np.random.default_rng(0), posture.copy()
    for i in range(600):
        wild = posture + rng.normal(scale=2.0 if i % 3 else 40.0, size=32)
        given = [None, np.full(32, np.nan), np.full(32, 1e9), "me", wild][int(rng.integers(5))]
        dt = [None, np.nan, -1.0, 0.01, "slow"][int(rng.integers(5))]
        step = seeker.step(given, dt=dt, observed=None if i % 7 else np.zeros(32))
        assert np.isfinite(step.twist).all()
    for _ in range(400):
        step = seeker.step(posture + np.radians(350) * (np.arange(32) == 3))
        assert np.isfinite(step.twist).all()


def test_thinking_aside_does_not_hold_up_the_loop() -> None:
    """It is thought about while the object rests; no step waits for it."""
    problem, holding, _ = start("stubborn", "desk", 2)
    seeker = Seeker(problem, [best_of_model("desk")], Seeking(longest=120.0))
    person, pose = holding.copy(), holding.pose.copy()
    thinks = 0
    for _ in range(9000):
        before = seeker._tries.thinking
        step = seeker.step(person.posture, pose)
        thinks += before
        if before:
            assert not step.twist.any()
            time.sleep(0.001)
        pose = ergoqp_moved(pose, step.twist * seeker.dt)
        person.follow(pose, seeker.dt)
        if not seeker.seeks:
            break
    assert thinks > 1
    assert not seeker.seeks


def ergoqp_moved(pose: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    from ergoqp.simulation.robot import moved

    return moved(pose, displacement)


def test_a_thought_that_goes_wrong_ends_at_what_was_measured(monkeypatch, caplog) -> None:
    problem, holding, _ = start("stubborn", "desk", 2)
    monkeypatch.setattr(Identifier, "identify", lambda *a, **k: 1 / 0)
    places = [Place("model", best_of_model("desk"))]
    run = ergoqp.simulate(problem, holding.copy(), 70.0, 2, seek=places)
    assert run.statuses[-1] == "settled"
    assert "came to nothing" in caplog.text
    assert {each.name for each in run.tries} <= {"descent", "model"}


def test_mistakes_are_one_sentence() -> None:
    problem = ergoqp.load_problem("desk")
    with pytest.raises(InputError, match="guide: got one"):
        Seeker(problem, [], guide=np.eye(4))
    with pytest.raises(InputError, match="how: got 3"):
        Seeker(problem, [], 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="guide"):
        Seeker(problem, [np.zeros((4, 4))])
    with pytest.raises(InputError, match="problems of a person"):
        Seeker(ergoqp.load_problem("forearm"), [])
    with pytest.raises(InputError, match="seek: got places beside a guide"):
        ergoqp.simulate(
            problem, problem.response.comfort, 0.1, guide=best_of_model("desk"), seek=[]
        )
