"""The step drawn toward a given place: never at the price of a limit, and to the last bit the same
where there is none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from step_samples import NAMES, comfort_of, held_pose, near_comfort, problem_of

import ergoqp.step.stepper
from ergoqp.errors import InputError
from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.simulation.check import Checker
from ergoqp.simulation.robot import moved
from ergoqp.step.guide import Guide, pull_function, read_guide
from ergoqp.step.model import StepModel
from ergoqp.step.rest import AFTER, BACK, DESCENT, THERE, TRIAL
from ergoqp.step.stepper import Step, Stepper

STEPPERS: dict[str, Stepper] = {}


def guided_stepper(name: str) -> Stepper:
    """A stepper as new that can be drawn somewhere; there is one per problem."""
    if name not in STEPPERS:
        STEPPERS[name] = Stepper(problem_of(name), guide=held_pose(name))
    stepper = STEPPERS[name]
    stepper.guide(held_pose(name))
    stepper.reset()
    return stepper


def set_out(stepper: Stepper, phase: int = THERE) -> None:
    """Put the stepper on a journey at once."""
    know(stepper, [phase, 0.0, 0.0, 5.0, 1e9, 0.0, 0.0])


def know(stepper: Stepper, values: Sequence[float]) -> None:
    """Let the stepper know this of the trial of the given place."""
    state = stepper.state()
    state[-TRIAL:][: len(values)] = values
    stepper.restore(state)


def walk(stepper: Stepper, name: str, seed: int, steps: int = 120) -> list[Step]:
    """A loop with noise, lost frames and odd periods."""
    rng = np.random.default_rng(seed)
    q, found = near_comfort(name, rng, 15), []
    for number in range(steps):
        dt = float(rng.uniform(0.005, 0.03)) if number % 3 == 0 else None
        step = stepper.step(
            q + 0.01 * rng.normal(size=32) if number % 11 else None, dt=dt, enable=number % 59 != 31
        )
        q = np.clip(q + step.posture_rate * 0.01, LOWER, UPPER)
        found.append(step)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_without_a_place_it_is_the_same_step_to_the_last_bit(name: str) -> None:
    stepper = guided_stepper(name)
    stepper.guide(None)
    for plain, led in zip(
        walk(Stepper(problem_of(name)), name, 0), walk(stepper, name, 0), strict=True
    ):
        for name_out in plain._parts:
            ours, other = plain.account(name_out), led.account(name_out)
            # A stepper that can be led has the trial behind the rest of its state.
            assert (
                ours.tobytes() == (other[:-TRIAL] if name_out == "next_state" else other).tobytes()
            ), name_out
        assert (plain.status, plain.reason) == (led.status, led.reason)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dentist", "low_bin", "overhead", "screwing"])
def test_a_journey_arrives_and_only_then_descends(name: str) -> None:
    stepper, q = guided_stepper(name), comfort_of(name)
    box = problem_of(name).limit_of(WorkspaceBox)
    pose = held_pose(name)
    pose[:3, 3] = np.asarray(box.lower) + 0.2 * (np.asarray(box.upper) - np.asarray(box.lower))
    pose = moved(pose, np.array([0, 0, 0, 0.0, 0.1, 0.15]))
    set_out(stepper)
    steps = [stepper.step(q, pose)]
    while steps[-1].drawn and len(steps) < 1000:
        steps.append(stepper.step(q))
    goal, end = held_pose(name), steps[-1].pose
    assert 20 < len(steps) < 1000
    np.testing.assert_allclose(end[:3, 3], goal[:3, 3], atol=0.02)
    assert end[:3, 0] @ goal[:3, 0] > np.cos(0.05)
    reasons = [step.reason for step in steps]
    assert set(reasons) == {
        "drawn toward the given place",
        "at the given place, waiting for the person",
        "",
    }
    assert reasons.count("at the given place, waiting for the person") == pytest.approx(100, abs=2)
    assert steps[-5].status == "settled"
    assert np.abs(steps[-5].twist).max() == 0
    # Nothing was promised, so descent takes over.
    assert steps[-1].status == "optimal"
    assert steps[-1].account("next_state")[-TRIAL] == AFTER
    # As straight as the cost lets it be.
    left = np.array([np.linalg.norm(step.pose[:3, 3] - goal[:3, 3]) for step in steps])
    assert np.all(np.diff(left) < 1e-3)


def test_what_is_added_to_the_objective_is_convex_and_none_where_nobody_travels() -> None:
    rng, pull = (
        np.random.default_rng(2),
        pull_function(StepModel(problem_of("screwing"), guided=True)),
    )
    for phase in range(BACK + 1):
        for _ in range(20):
            pose, goal = (moved(held_pose("screwing"), 0.3 * rng.normal(size=6)) for _ in range(2))
            H, g, distance, on, drawn = (
                np.array(part)
                for part in pull(pose, goal, 1, [phase, *np.zeros(6), *rng.normal(size=6)])
            )
            about = np.concatenate([np.zeros(3), pose[:3, 0]])
            np.testing.assert_allclose(H, H.T)
            assert np.linalg.eigvalsh(H).min() > -1e-9
            np.testing.assert_allclose(H @ about, 0, atol=1e-9)
            assert about @ g == pytest.approx(0, abs=1e-9)
            assert bool(H.any()) == bool(g.any()) == (phase in (THERE, BACK))
            assert on == 1
            assert distance > 0
            assert drawn == (0 if phase in (DESCENT, AFTER) else phase)
            assert not any(
                np.array(part).any()
                for part in pull(pose, goal, 0, np.r_[phase, rng.normal(size=12)])[:2]
            )


def test_turning_about_the_tool_is_nobodys_business() -> None:
    """Only where the tool points is led: the same place turned about its axis gives the same
    twist."""
    q, stepper, answers = (
        near_comfort("screwing", np.random.default_rng(1)),
        guided_stepper("screwing"),
        [],
    )
    for turn in (0.0, 1.0, -2.5):
        goal = held_pose("screwing")
        stepper.guide(moved(goal, np.concatenate([np.zeros(3), turn * goal[:3, 0]])))
        stepper.reset()
        set_out(stepper)
        answers.append(stepper.step(q, moved(goal, np.array([0.1, 0, 0, 0, 0.1, 0.1]))).twist)
    np.testing.assert_allclose(answers[1], answers[0], atol=1e-9)
    np.testing.assert_allclose(answers[2], answers[0], atol=1e-9)


PLACES = ("wall", "corner", "edge of the cone", "outside", "opposite", "far", "jumps")


def place_of_kind(name: str, kind: str, rng: np.random.Generator) -> np.ndarray:
    """Where nobody should be led, or only just."""
    problem, pose = problem_of(name), held_pose(name)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    if kind in ("wall", "corner"):
        pose[:3, 3] = np.where(
            rng.random(3) < (0.5 if kind == "wall" else 1.0), box.upper, pose[:3, 3]
        )
    elif kind == "edge of the cone":
        pose = moved(pose, np.array([0, 0, 0, 0, np.radians(cone.half_angle_deg), 0]))
    elif kind == "outside":
        pose[:3, 3] = np.asarray(box.upper) + rng.uniform(0, 0.5, 3)
    elif kind == "opposite":
        pose = moved(pose, np.array([0, 0, 0, 0, 0, 3.1]))
    elif kind == "far":
        pose[:3, 3] = rng.normal(size=3) * 50
    return pose


def put(stepper: Stepper, pose: np.ndarray) -> None:
    """Lead the step somewhere without asking whether that is allowed: the limits must not depend on
    it."""
    stepper._ready = (stepper._led(stepper._ready[0], Guide(pose)), *stepper._ready[1:])


@pytest.mark.parametrize("name", NAMES)
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(PLACES),
    phase=st.sampled_from([THERE, BACK]),
)
@settings(deadline=None, max_examples=12)
def test_no_place_is_worth_a_limit(name: str, seed: int, kind: str, phase: int) -> None:
    rng, stepper, checker = (
        np.random.default_rng(seed),
        guided_stepper(name),
        Checker(problem_of(name)),
    )
    pose, previous = held_pose(name), np.zeros(6)
    q = near_comfort(name, rng, 15)
    put(stepper, place_of_kind(name, kind, rng))
    for number in range(60):
        if kind == "jumps":
            put(stepper, place_of_kind(name, str(rng.choice(PLACES[:-1])), rng))
        if number % 20 == 0:
            set_out(stepper, phase)
            know(stepper, [*stepper.state()[-TRIAL:][:7], *rng.normal(size=6)])
        # Beyond three periods it would brake.
        dt = float(rng.uniform(0.002, 0.03)) if rng.random() < 0.97 else 0.05
        step = stepper.step(q, pose if number == 0 else None, dt=dt)
        stops = step.status == "braking"
        broken = checker.check(
            step.twist, previous, pose, q, step.posture_rate, dt, None, step.slack, stops=stops
        )
        assert broken == [], (broken, checker.max_violation)
        assert np.isfinite(step.twist).all()
        pose, previous = moved(pose, step.twist * dt), step.twist
        q = np.clip(q + step.posture_rate * dt, LOWER, UPPER)


@given(data=st.data())
@settings(deadline=None, max_examples=30)
def test_numbers_that_are_none_lead_nowhere(data: st.DataObject) -> None:
    """The function itself is safe from what is given to it: whoever calls it from C has no other
    guard."""
    stepper = guided_stepper("screwing")
    bad = data.draw(st.sampled_from([np.nan, np.inf, -np.inf, 1e300]))
    where = data.draw(st.sampled_from(["guide", "guided"]))
    given = stepper._ready[0][stepper._at[where]]
    given[data.draw(st.integers(0, given.size - 1))] = bad
    led = where == "guided" and bad > 0
    set_out(stepper)
    step = stepper.step(
        near_comfort("screwing", np.random.default_rng(0)),
        moved(held_pose("screwing"), np.full(6, 0.05)),
    )
    assert np.isfinite(step.twist).all()
    assert step.status == "optimal"
    assert bool(step.drawn) == led


# --- what is refused ------------------------------------------------------------------------------


class Unreadable:
    """Raises when it is looked at."""

    @property
    def pose(self) -> Any:
        raise ValueError("broken")


def wrong_places() -> list[tuple[Any, str]]:
    away, tilted, nan = (
        held_pose("screwing"),
        moved(held_pose("screwing"), np.array([0, 0, 0, 0, 0, 1.0])),
        held_pose("screwing"),
    )
    away[0, 3], nan[1, 1] = 3.0, np.nan
    return [
        (away, r"guide: got the place \(3, .*\) m, allowed the workspace \(.*\) to \(.*\) m"),
        (
            tilted,
            r"guide: got a tool axis 57.3 deg from the middle of its cone, allowed at most 35 deg",
        ),
        (nan, "guide: got a pose that is not finite"),
        (2 * np.eye(4), "guide: got a pose that is not a rigid motion: its last row is"),
        (np.zeros(6), r"guide: got shape \(6,\), allowed a pose \(4, 4\)"),
        ("home", "guide: got 'home', allowed a pose"),
        (
            SimpleNamespace(pose=held_pose("screwing"), posture=np.full(32, np.nan)),
            "guide.posture: got",
        ),
        (SimpleNamespace(pose=held_pose("screwing"), posture=np.zeros(3)), "guide.posture: got"),
    ]


@pytest.mark.parametrize(("place", "sentence"), wrong_places())
def test_a_place_that_cannot_be_used_is_refused_at_construction_and_none_in_the_loop(
    place: Any, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        Stepper(problem_of("screwing"), guide=place)
    stepper = guided_stepper("screwing")
    stepper.guide(place)
    step = stepper.step(comfort_of("screwing"), held_pose("screwing"))
    assert step.status == "optimal"
    assert re.search(sentence, step.reason)
    assert stepper._ready[0][stepper._at["guided"]] == 0
    stepper.guide(held_pose("screwing"))
    assert stepper.step(comfort_of("screwing")).reason == ""


def test_whatever_a_place_does_when_it_is_read_the_loop_goes_on() -> None:
    stepper = guided_stepper("screwing")
    stepper.guide(Unreadable())
    step = stepper.step(comfort_of("screwing"), held_pose("screwing"))
    assert (step.status, step.reason) == (
        "optimal",
        "guide: cannot be read (ValueError); give a pose (4, 4)",
    )


def test_a_problem_without_a_person_has_no_place_for_an_object() -> None:
    with pytest.raises(
        InputError, match=r"guide: problem forearm moves elbow_x, .*, allowed problems of a person"
    ):
        Stepper(problem_of("forearm"), guide=np.eye(4))


@pytest.mark.parametrize("firm", ["no", 2, None])
def test_a_guide_is_firm_or_is_not(firm: Any) -> None:
    with pytest.raises(InputError, match=r"guide\.firm: got"):
        read_guide(problem_of("screwing"), Guide(held_pose("screwing"), firm=firm))


def test_a_stepper_without_a_guide_says_that_it_has_none() -> None:
    with pytest.raises(InputError, match="guide: the stepper was made without one"):
        Stepper(problem_of("screwing")).guide(held_pose("screwing"))


def test_what_a_place_promises_is_the_cost_of_its_posture() -> None:
    problem, q = problem_of("screwing"), comfort_of("screwing")
    known = read_guide(problem, SimpleNamespace(pose=held_pose("screwing"), posture=q))
    assert known.promise == pytest.approx(float(problem.cost(q)[0]))
    assert read_guide(problem, held_pose("screwing")).promise is None
    assert read_guide(problem, known) is known


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (
            {"problem": "desk"},
            "guide: got a place of problem 'desk', allowed one of problem screwing",
        ),
        (
            {"problem": "screwing", "mode": "cooperative"},
            "guide: got a place of mode cooperative, .* allowed a place of mode stackelberg",
        ),
    ],
)
def test_a_place_that_was_found_for_something_else_is_refused(
    what: dict[str, str], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        read_guide(problem_of("screwing"), SimpleNamespace(pose=held_pose("screwing"), **what))


# --- state ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_guided_log_replays_bit_for_bit() -> None:
    import json

    log: list[dict[str, Any]] = []
    problem = problem_of("screwing")
    stepper = Stepper(problem, log=log.append, guide=held_pose("screwing"))
    set_out(stepper)
    steps = walk(stepper, "screwing", 3, 60)
    stepper.guide(np.full((4, 4), np.nan))
    steps += walk(stepper, "screwing", 4, 20)
    replayed = ergoqp.replay(problem, json.loads(json.dumps(log)))
    assert any(step.drawn for step in steps)
    for one, other in zip(steps, replayed, strict=True):
        assert one.values.tobytes() == other.values.tobytes()
        assert (one.status, one.reason) == (other.status, other.reason)


def test_reset_keeps_the_place_and_forgets_the_trial() -> None:
    stepper, q = guided_stepper("screwing"), near_comfort("screwing", np.random.default_rng(5))
    first = [stepper.step(q) for _ in range(5)][-1]
    set_out(stepper)
    stepper.step(q)
    stepper.reset()
    assert stepper._ready[0][stepper._at["guided"]] == 1
    assert [stepper.step(q) for _ in range(5)][-1].twist.tobytes() == first.twist.tobytes()


@pytest.mark.slow
def test_compiled_it_is_led_alike() -> None:
    from ergoqp.native.compiled import CompilerError, compiler

    try:
        compiler()
    except CompilerError as absent:
        pytest.skip(str(absent))
    compiled, plain = (
        Stepper(problem_of("dentist"), compiled=True, guide=held_pose("dentist")),
        guided_stepper("dentist"),
    )
    set_out(compiled)
    set_out(plain)
    answers = [walk(stepper, "dentist", 6, 60) for stepper in (compiled, plain)]
    assert any(step.drawn for step in answers[0])
    for one, other in zip(*answers, strict=True):
        assert (one.status, one.reason) == (other.status, other.reason)
        np.testing.assert_allclose(one.twist, other.twist, atol=1e-9)
