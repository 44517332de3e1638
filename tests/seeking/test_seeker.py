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
from ergoqp.identification.loops import Resting
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames
from ergoqp.rest.best_place import awkward_place
from ergoqp.seeking import Place, Seeker, SeekOptions
from ergoqp.seeking.next_place import THEIRS
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.robot import moved
from ergoqp.simulation.run import Run


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name", "seed"), [("stubborn", "desk", 2), ("alike", "low_bin", 1)]
)
def test_it_ends_at_the_best_that_it_measured(kind: str, name: str, seed: int) -> None:
    run = sought(kind, name, seed)
    # What a place scored last is what it scores: it may not be what it was.
    latest = {each.name: each.score for each in run.tries if np.isfinite(each.score)}
    assert len(run.tries) > 1
    assert run.tries[-1].score <= min(latest.values()) + 0.2 + 1e-9
    assert not run.twists[-300:].any()
    assert run.statuses[-1] == "settled"
    assert sum(run.violations.values()) == 0
    assert run.reba[-100:].max() <= run.reba[0]
    assert run.tries[0].ended < 20.0


@pytest.mark.slow
def test_the_account_is_saved_with_the_run(tmp_path) -> None:
    run = sought("stubborn", "desk", 2)
    saved = json.loads(run.save(tmp_path).read_text(encoding="utf-8"))["tries"]
    assert [each["name"] for each in saved] == [each.name for each in run.tries]
    assert saved[0]["why"] == "downhill"
    assert saved[0]["score"] == pytest.approx(run.tries[0].score)


@pytest.mark.slow
def test_at_rest_at_the_end_it_says_so() -> None:
    run = sought("stubborn", "desk", 2)
    assert run.reasons[-1] == "at rest: at the best of the places tried"


def steps_of(seeker: Seeker, posture: np.ndarray, count: int) -> list:
    return [seeker.step(posture) for _ in range(count)]


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_person_who_never_follows_ends_at_rest_in_time() -> None:
    problem, _, posture = start("alike", "screwing", 1)
    how = SeekOptions(patience=5.0, longest=20.0)
    seeker = Seeker(problem, [best_of_model("screwing")], how, patient=True)
    steps = steps_of(seeker, posture, 4000)
    assert not any(step.twist.any() for step in steps[-500:])
    assert not seeker.seeks
    assert seeker.account[-1].ended < 25.0


@pytest.mark.slow
def test_whatever_comes_in_a_step_comes_out() -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(patience=1.0), patient=True)
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


@pytest.mark.slow
def test_thinking_aside_does_not_hold_up_the_loop() -> None:
    """It is thought about while the object rests; no step waits for it."""
    problem, holding, _ = start("stubborn", "desk", 2)
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(longest=120.0))
    person, pose = holding.copy(), holding.pose.copy()
    thinks = 0
    for _ in range(9000):
        before = seeker._tries.thinking
        step = seeker.step(person.posture, pose)
        thinks += before
        if before:
            assert not step.twist.any()
            time.sleep(0.001)
        pose = moved(pose, step.twist * seeker.dt)
        person.follow(pose, seeker.dt)
        if not seeker.seeks:
            break
    assert thinks > 1
    assert not seeker.seeks


@pytest.mark.slow
def test_a_thought_that_goes_wrong_ends_at_what_was_measured(monkeypatch, caplog) -> None:
    problem, holding, _ = start("stubborn", "desk", 2)
    monkeypatch.setattr(Identifier, "identify", lambda *a, **k: 1 / 0)
    places = [Place("model", best_of_model("desk"))]
    run = ergoqp.simulate(problem, holding.copy(), 70.0, 2, seek=places)
    assert run.statuses[-1] == "settled"
    assert "came to nothing" in caplog.text
    assert {each.name for each in run.tries} <= {"descent", "model"}


@pytest.mark.slow
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


NO: tuple[Any, ...] = ("no", "yes", 2, np.nan, None, np.array([1, 0]), [], object(), False, 0)


@pytest.mark.slow
@pytest.mark.parametrize("enable", NO, ids=range(len(NO)))
def test_what_does_not_enable_a_stepper_does_not_enable_it(enable: Any) -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], thinks=False)
    for _ in range(50):
        step = seeker.step(posture, enable=enable)
        assert not step.twist.any()
    assert step.status == "braking"
    assert any(seeker.step(posture, enable=1).twist.any() for _ in range(20))


@pytest.mark.slow
def test_without_places_it_descends_and_still_thinks() -> None:
    problem, _, posture = start("alike", "desk", 0)
    assert any(step.twist.any() for step in steps_of(Seeker(problem), posture, 50))
    assert any(step.twist.any() for step in steps_of(Seeker(problem, thinks=False), posture, 50))


@pytest.mark.slow
def test_a_period_that_is_none_is_no_time() -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], thinks=False)
    for dt in (-5.0, 1e6, np.nan, np.inf, "slow", 0.0):
        seeker.step(posture, dt=dt)
    assert seeker.seeks
    assert not seeker.account
    assert seeker._now <= 6 * problem.longest_period


@pytest.mark.slow
def test_while_it_is_not_enabled_no_try_runs_out_of_time() -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(patience=1.0), thinks=False)
    for _ in range(400):
        seeker.step(posture, enable=False)
    assert not seeker.account
    assert any(step.twist.any() for step in steps_of(seeker, posture, 50))


@pytest.mark.slow
def test_it_says_why_it_stays(monkeypatch) -> None:
    """While it is thought about, and where nobody came to rest anywhere, nothing is best yet."""
    problem, holding, posture = start("stubborn", "desk", 2)
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(patience=0.5, longest=1.0))
    steps = steps_of(seeker, posture, 600)
    assert seeker.best is None
    assert steps[-1].reason == "at rest: the person came to rest nowhere"
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(longest=120.0))
    monkeypatch.setattr(type(seeker._thought), "done", property(lambda self: False))
    said, pose, person = set(), holding.pose.copy(), holding.copy()
    for _ in range(6000):
        step = seeker.step(person.posture, pose)
        pose = moved(pose, step.twist * seeker.dt)
        person.follow(pose, seeker.dt)
        if seeker._tries.thinking:
            said.add(seeker.step(person.posture, pose).reason)
            break
    seeker.step(person.posture, pose)
    assert "at rest: looking for places that suit this person" in {
        seeker.step(person.posture, pose).reason for _ in range(100)
    }


@pytest.mark.slow
def test_a_thought_after_a_place_without_rest_is_a_new_one(monkeypatch) -> None:
    problem, holding, _ = start("stubborn", "desk", 2)
    seeker = Seeker(problem, [best_of_model("desk")], patient=True)
    begun = []
    monkeypatch.setattr(seeker._thought, "begin", lambda rests, *_: begun.append(len(rests)))
    rest = Resting(5.0, holding.pose, holding.posture)
    for number in range(2):
        seeker._rests.append(rest)
        pose = holding.pose.copy()
        pose[2, 3] -= 0.2 * number
        seeker._tries.measured(Resting(5.0 + number, pose, holding.posture), 5.0)
    seeker._tries.thinking = False
    seeker._tries._left.clear()
    seeker._lead(seeker._tries.unrested(20.0, holding.pose))
    assert begun == [2]


@pytest.mark.slow
def test_who_became_another_is_not_known_by_the_rests_before() -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(longest=0.0), patient=True)
    steps_of(seeker, problem.response.comfort, 1500)  # type: ignore[attr-defined]
    assert not seeker.seeks
    assert seeker.account
    worse = posture.copy()
    worse[0] += 0.8
    for _ in range(1500):
        seeker.step(worse)
        if seeker.seeks:
            break
    assert seeker.seeks
    assert not seeker._rests


@pytest.mark.slow
def test_an_object_that_somebody_moved_away_is_led_anew() -> None:
    problem, holding, _ = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], SeekOptions(longest=0.0), patient=True)
    person, pose = holding.copy(), holding.pose.copy()
    for _ in range(3000):
        pose = moved(pose, seeker.step(person.posture, pose).twist * seeker.dt)
        person.follow(pose, seeker.dt)
        if not seeker.seeks:
            break
    assert not seeker.seeks
    for _ in range(1000):
        assert not seeker.step(person.posture, pose).twist.any()
    pose = moved(pose, np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0]))
    sought = []
    for _ in range(1000):
        seeker.step(person.posture, pose)
        person.follow(pose, seeker.dt)
        sought.append(seeker.seeks)
    assert any(sought)


def led(
    seeker: Seeker,
    holding: Any,
    seconds: float,
    told: Any = lambda now, person, pose: (person, pose),
) -> tuple[list[Any], np.ndarray]:
    """Steps of a loop in which what is measured is what `told` makes of it."""
    person, pose, steps = holding.copy(), holding.pose.copy(), []
    for number in range(round(seconds / seeker.dt)):
        posture, at = told(number * seeker.dt, person.posture, pose)
        steps.append(seeker.step(posture, at))
        pose = moved(at if at is not None else pose, steps[-1].twist * seeker.dt)
        person.follow(pose, seeker.dt)
    return steps, pose


def within_limits(problem: Problem, steps: list[Any]) -> bool:
    speed = problem.twist_limit.speed
    return all((np.abs(step.twist) <= speed + 1e-9).all() for step in steps)


@pytest.mark.slow
@pytest.mark.parametrize("gone", [None, np.full(32, np.nan)], ids=["no frame", "nan"])
def test_who_leaves_and_comes_back_loses_no_time(gone: Any) -> None:
    problem, holding, _ = start("follower", "desk", 2)
    seeker = Seeker(problem, [best_of_model("desk")], thinks=False)

    def leaves(now: float, posture: np.ndarray, pose: np.ndarray) -> Any:
        return (gone if 4.0 < now < 64.0 else posture), pose

    steps, _ = led(seeker, holding, 100.0, leaves)
    assert within_limits(problem, steps)
    assert not any(step.twist.any() for step in steps[600:6300]), "nobody is led who is not there"
    assert any(step.twist.any() for step in steps[6450:])
    assert not seeker.seeks
    assert seeker.best is not None
    assert all(np.isfinite(each.score) for each in seeker.account)


@pytest.mark.slow
def test_who_leaves_the_object_at_rest_is_not_taken_for_the_model() -> None:
    """Angles that nobody sees are the model's, whose score is low."""
    problem, _, posture = start("alike", "desk", 0)
    seeker = Seeker(problem, [best_of_model("desk")], thinks=False)
    steps_of(seeker, problem.response.comfort, 150)  # type: ignore[attr-defined]
    for _ in range(3000):
        assert not seeker.step(None).twist.any()
    assert not seeker.account
    seeker.step(posture)
    assert seeker.seeks


@pytest.mark.slow
@pytest.mark.parametrize("seen", [(), (31,)])
def test_of_whom_hardly_a_joint_is_seen_nothing_is_measured(seen: tuple[int, ...]) -> None:
    problem, _, posture = start("alike", "desk", 0)
    seeker, observed = Seeker(problem, [best_of_model("desk")], thinks=False), np.zeros(32)
    observed[list(seen)] = 1.0
    for _ in range(2000):
        seeker.step(posture, observed=observed)
    assert not seeker.account
    assert seeker.seeks


@pytest.mark.slow
def test_a_rest_is_measured_anew_after_a_pause() -> None:
    problem = start("alike", "desk", 0)[0]
    comfort = problem.response.comfort  # type: ignore[attr-defined]
    measured = []
    for pauses in (False, True):
        seeker = Seeker(problem, [best_of_model("desk")], thinks=False)
        for number in range(1000):
            seeker.step(comfort, enable=not (pauses and number == 220))
            if seeker.account:
                break
        measured.append(number)
    assert 230 < measured[0] < 420
    assert measured[1] - 220 >= 200, "two seconds from the pause on"


@pytest.mark.slow
def test_lost_frames_end_no_rest() -> None:
    problem, holding, _ = start("follower", "desk", 2)
    seeker, rng = Seeker(problem, thinks=False), np.random.default_rng(0)

    def loses(now: float, posture: np.ndarray, pose: np.ndarray) -> Any:
        return (None if rng.random() < 0.05 else posture), pose

    led(seeker, holding, 25.0, loses)
    assert seeker.best is not None
    assert not seeker.seeks


@pytest.mark.slow
def test_who_fights_is_bounded_named_and_at_rest() -> None:
    """Somebody pushes the object about, at the speed of a hand."""
    problem, holding, _ = start("follower", "desk", 2)
    seeker = Seeker(problem, [best_of_model("desk")], thinks=False)

    def pushes(now: float, posture: np.ndarray, pose: np.ndarray) -> Any:
        pushed = pose.copy()
        pushed[1, 3] += 0.06 * seeker.dt * np.sign(np.sin(2.0 * now)) * (now < 40.0)
        return posture, pushed

    steps, _ = led(seeker, holding, 60.0, pushes)
    assert within_limits(problem, steps)
    assert "robot: moves although nothing was sent" in {step.reason for step in steps[:4000]}
    assert not any(step.twist.any() for step in steps[-300:])


@pytest.mark.slow
def test_another_hand_than_the_one_that_is_expected_is_named() -> None:
    problem, holding, _ = start("stubborn", "screwing", 2)
    # Otherwise the wrong arm is taken for a wrong frame.
    problem = problem.replace(frames=Frames(compare=False))
    seeker = Seeker(problem, [best_of_model("screwing")], patient=True)
    right = [number for number, name in enumerate(JOINTS) if name.startswith("right_")]
    left = [JOINTS.index("left_" + JOINTS[number][6:]) for number in right]

    def other(now: float, posture: np.ndarray, pose: np.ndarray) -> Any:
        swapped = posture.copy()
        swapped[right], swapped[left] = posture[left], posture[right]
        return swapped, pose

    steps, _ = led(seeker, holding, 90.0, other)
    assert within_limits(problem, steps)
    assert not seeker.seeks
    assert not any(step.twist.any() for step in steps[-300:])
    assert "no person of the model rests as measured" in steps[-1].reason
    assert not any(each.name == THEIRS for each in seeker.account)
