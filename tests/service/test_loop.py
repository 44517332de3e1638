"""The service's loop: after any request its state is what the robot has executed."""

from __future__ import annotations

import socket
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ergoqp
from ergoqp.service.loop import SENT, Loop, Request, chosen_knots
from ergoqp.service.schema import (
    ANSWER,
    ANSWER_HEAD,
    KNOTS,
    REQUEST_HEAD,
    VERSION,
    Ask,
    Flag,
    Mark,
    Tell,
    answer_frame,
)
from ergoqp.step.causes import Cause, Status
from ergoqp.step.guide import Guide
from ergoqp.step.stepper import Stepper

_HEAD_NAMES = [field.name for field in ANSWER[: len(ANSWER_HEAD.unpack(bytes(ANSWER_HEAD.size)))]]
USUAL = Flag.frame | Flag.enable


class Answer:
    """An answer as a client reads it, by the declared layout alone."""

    def __init__(self, frame: bytes, coordinates: int, rows: int) -> None:
        for name, value in zip(_HEAD_NAMES, ANSWER_HEAD.unpack_from(frame), strict=True):
            setattr(self, name, value)
        if self.kind == Tell.step:
            layout = answer_frame(coordinates, rows)
            for field in layout.fields:
                if field.kind == "f64" and field.name != "computed":
                    setattr(self, field.name, layout.numbers(frame, field.name))
            self.text = frame[layout.at["text"]].rstrip(b"\0").decode()
        else:
            self.text = frame[ANSWER_HEAD.size :].rstrip(b"\0").decode()

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)


class Talk:
    """A client of a loop in the same process, which says what it is told to say.

    Attributes:
        done: how many requests were answered in which way, see ``c/exchange.c``.
    """

    def __init__(self, loop: Loop) -> None:
        self.loop, self.request, self.sequence = loop, Request(loop.coordinates), 0
        self.done = [0, 0, 0, 0]

    def answer(self, request: Request) -> Any:
        """Have the loop receive and answer as a worker does."""
        if self.loop.exchange is None:
            return self.loop.answer(request)
        mine, theirs = socket.socketpair()
        with mine, theirs:
            mine.sendall(request.buffer)
            request.buffer[:] = bytes(request.length)
            count, done = divmod(self.loop.exchange(theirs.fileno(), request.address, 0), 4)
            assert count == request.length
            answer = self.loop.exchanged(request, done) if done else None
            self.done[done] += 1
            if done == SENT:
                return mine.recv(100_000)
            return answer if done else self.loop.answer(request)

    def ask(
        self,
        posture: Any = None,
        bits: int = 0,
        *,
        acted: int = 0,
        followed: int = 0,
        session: int | None = None,
        sequence: int | None = None,
        dt: float = 0.01,
        age: float = 0.0,
        version: int = VERSION,
        kind: int = Ask.step,
        problem: int = 0,
        coordinates: int | None = None,
        contact: int = 0,
        **arrays: Any,
    ) -> Answer:
        self.sequence = self.sequence + 1 if sequence is None else sequence
        request = self.request
        REQUEST_HEAD.pack_into(
            request.buffer,
            0,
            request.length,
            version,
            kind,
            self.loop.session if session is None else session,
            self.sequence,
            acted,
            problem,
            followed,
            bits,
            self.loop.coordinates if coordinates is None else coordinates,
            contact,
            age,
            dt,
        )
        if posture is not None:
            request.posture[:] = posture
        for name, values in arrays.items():
            getattr(request, name)[...] = values
        frame = bytes(self.answer(request))
        return Answer(frame, self.loop.coordinates, self.loop.rows)


PROBLEM = ergoqp.load_problem("screwing")
START = np.array(PROBLEM.response.comfort)
START[ergoqp.JOINTS.index("right_shoulder_flexion")] = 1.3
START[ergoqp.JOINTS.index("right_elbow_flexion")] = 0.5


@pytest.fixture(scope="module")
def made() -> Stepper:
    stepper = Stepper(PROBLEM)
    stepper.warm_up()
    return stepper


@pytest.fixture(scope="module")
def compiled() -> Stepper:
    return Stepper(PROBLEM, compiled=True)


@pytest.fixture(params=["compiled", "machine code", "Python"])
def talk(
    made: Stepper,
    compiled: Stepper,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> Talk:
    """Plain steps are answered in machine code; or frames are packed so, or all is Python."""
    if request.param == "Python":
        monkeypatch.setattr("ergoqp.service.loop.packing_of", lambda *_: None)
    stepper = compiled if request.param == "compiled" else made
    talk = Talk(Loop("screwing", stepper.sibling(), digest=7))
    assert (talk.loop.exchange is not None) == (request.param == "compiled")
    return talk


def test_an_answer_is_the_step_of_a_stepper_to_the_last_bit(talk: Talk, made: Stepper) -> None:
    own, posture, acted, step = made.sibling(), START.copy(), 0, None
    for number in range(40):
        seen = np.ones(32)
        seen[number % 32] = 0.0
        # A pose that is measured now and then, and a wrong one.
        pose = np.eye(4) if number == 20 else step.pose if step and number % 7 == 3 else None
        step = own.step(posture, pose, observed=seen.astype(bool), age=0.01)
        bits = USUAL | Flag.observed | (Flag.stands if not acted else 0) | Flag.explain
        more = {} if pose is None else {"pose": pose}
        answer = talk.ask(
            posture, bits | (Flag.pose if more else 0), acted=acted, observed=seen, age=0.01, **more
        )
        assert answer.kind == Tell.step
        assert Status(answer.status).name == step.status
        np.testing.assert_array_equal(answer.twist, step.twist)
        np.testing.assert_array_equal(answer.pose.reshape(4, 4), step.pose)
        np.testing.assert_array_equal(answer.posture_rate, step.posture_rate)
        np.testing.assert_array_equal(answer.margins, list(step.margins.values()))
        np.testing.assert_array_equal(answer.residuals, list(step.residuals.values()))
        for name in ("slack", "multipliers", "locked", "outside", "frames", "fault"):
            np.testing.assert_array_equal(getattr(answer, name), step.account(name))
        assert (answer.cost, answer.gain) == (step.cost, step.gain)
        assert answer.causes == int(step.account("causes")[0])
        if answer.reason:
            assert answer.text == step.reason
        stop = own.stop()
        assert answer.knots == len(stop)
        np.testing.assert_array_equal(answer.stop.reshape(-1, 6)[: len(stop)], stop)
        np.testing.assert_array_equal(answer.times[: len(stop)], 0.01 * np.arange(1, len(stop) + 1))
        posture, acted = posture + 0.01 * step.posture_rate, answer.sequence


def test_nothing_moves_until_the_robot_is_reported(talk: Talk) -> None:
    for session in (0, 1, 12345):
        answer = talk.ask(START, USUAL, session=session)
        assert answer.kind == Tell.unknown
        assert "report that it stands" in answer.text
    assert talk.ask(START, USUAL | Flag.stands).kind == Tell.step


def test_a_moving_robot_is_taken_over_by_its_measured_twist(talk: Talk, made: Stepper) -> None:
    twist = np.array([0.05, 0, -0.05, 0, 0.1, 0])
    assert talk.ask(START, USUAL | Flag.takes_over).kind == Tell.refused
    bad = np.where(np.arange(6) == 2, np.nan, twist)
    assert talk.ask(START, USUAL | Flag.takes_over | Flag.twist, twist=bad).kind == Tell.refused
    answer = talk.ask(START, USUAL | Flag.takes_over | Flag.twist, twist=twist)
    assert answer.marks & Mark.begun
    own = made.sibling()
    own.reset(twist)
    np.testing.assert_array_equal(answer.twist, own.step(START, twist=twist).twist)


def run(talk: Talk, own: Stepper, plan: list[tuple[int, int]]) -> None:
    """Lose answers as planned; the loop goes on as a stepper that made only what was executed.

    Each entry: how many answers in a row are lost, and how many periods of the stop the robot
    executes besides (a client that was not called).
    """
    posture = START.copy()
    step = own.step(posture)
    answer = talk.ask(posture, USUAL | Flag.stands)
    acted = answer.sequence
    for lost, more in plan:
        posture = posture + 0.01 * step.posture_rate
        followed = more
        for _ in range(lost):
            talk.ask(posture + 0.3, USUAL, acted=acted, followed=followed)
            followed += 1
        for _ in range(followed):
            own.brake(0.01)
        step = own.step(posture)
        answer = talk.ask(posture, USUAL, acted=acted, followed=followed)
        assert answer.kind == Tell.step
        assert bool(answer.marks & Mark.undone) == bool(followed)
        np.testing.assert_array_equal(answer.twist, step.twist)
        np.testing.assert_array_equal(talk.loop.stepper.state(), own.state())
        acted = answer.sequence


def test_answers_that_were_not_executed_are_taken_back(talk: Talk, made: Stepper) -> None:
    run(talk, made.sibling(), [(0, 0)] * 20 + [(1, 0), (0, 0), (3, 0), (0, 2), (2, 5), (0, 0)])
    assert talk.loop.undone == 6
    if talk.loop.exchange is not None:
        assert talk.done[SENT] > 15


@settings(max_examples=30, deadline=None)
@given(plan=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 4)), min_size=1, max_size=25))
def test_whatever_is_lost_the_state_is_what_was_executed(
    made: Stepper, plan: list[tuple[int, int]]
) -> None:
    run(Talk(Loop("screwing", made.sibling())), made.sibling(), plan)


def test_a_stop_of_an_hour_costs_no_more_than_the_stop(talk: Talk, made: Stepper) -> None:
    """The robot has followed the whole stop, and stood: braking on changes nothing but ages."""
    posture, acted = START.copy(), 0
    for _ in range(30):
        answer = talk.ask(posture, USUAL | (Flag.stands if not acted else 0), acted=acted)
        posture, acted = posture + 0.01 * answer.posture_rate, answer.sequence
    calls = []
    brake = talk.loop.stepper.brake
    talk.loop.stepper.brake = lambda *a: calls.append(1) or brake(*a)  # type: ignore[method-assign]
    answer = talk.ask(posture, USUAL, acted=acted, followed=360_000)
    assert answer.kind == Tell.step
    assert answer.marks & Mark.undone
    assert len(calls) <= answer.knots + 160
    # The same again: what was braked is not braked again.
    calls.clear()
    talk.ask(posture, USUAL, acted=acted, followed=370_000)
    assert not calls


def place(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


@pytest.fixture(scope="module")
def guided() -> Stepper:
    stepper = Stepper(PROBLEM, guide=Guide(place(0.4, -0.1, 1.1)))
    stepper.warm_up()
    return stepper


def test_a_guide_whose_answer_was_lost_is_taken_anew(guided: Stepper) -> None:
    """What was learned about the guide before belongs to the state, and not to the new one."""
    own, talk = guided.sibling(), Talk(Loop("screwing", guided.sibling()))
    first, second = place(0.45, -0.1, 1.2), place(0.35, -0.2, 1.0)
    posture, bits = np.zeros(32), int(USUAL | Flag.guide)
    posture[ergoqp.JOINTS.index("right_shoulder_flexion")] = 0.5
    own.guide(Guide(first, 1.0))
    more: dict[str, Any] = {"guide": first, "promise": 1.0}
    answer = talk.ask(posture, bits | int(Flag.stands), **more)
    step = own.step(posture)
    for _ in range(1500):
        np.testing.assert_array_equal(answer.twist, step.twist)
        if answer.drawn:
            break
        answer = talk.ask(posture, bits, acted=talk.sequence, **more)
        step = own.step(posture)
    assert answer.drawn == step.drawn == 1
    acted = talk.sequence
    # Lost: the next guide. Lost again: no guide. Then the next guide once more.
    talk.ask(posture, bits, acted=acted, guide=second, promise=1.0)
    talk.ask(posture, int(USUAL | Flag.no_guide), acted=acted, followed=1)
    answer = talk.ask(posture, bits, acted=acted, followed=2, guide=second, promise=1.0)
    own.brake()
    own.brake()
    own.guide(Guide(second, 1.0))
    step = own.step(posture)
    np.testing.assert_array_equal(answer.twist, step.twist)
    np.testing.assert_array_equal(talk.loop.stepper.state(), own.state())
    # Lost: another guide. The client goes on with the one that it had.
    acted = talk.sequence
    talk.ask(posture, bits, acted=acted, **more)
    answer = talk.ask(posture, bits, acted=acted, followed=1, guide=second, promise=1.0)
    own.brake()
    np.testing.assert_array_equal(answer.twist, own.step(posture).twist)
    np.testing.assert_array_equal(talk.loop.stepper.state(), own.state())


def test_a_beginning_has_the_guide_of_the_start(guided: Stepper) -> None:
    own, talk = guided.sibling(), Talk(Loop("screwing", guided.sibling()))
    talk.ask(START, USUAL | Flag.stands | Flag.no_guide)
    assert talk.loop.stepper.place is None
    for _ in range(3):
        talk.ask(START, USUAL, acted=talk.sequence)
    answer = talk.ask(START, USUAL | Flag.stands)
    again = talk.loop.stepper.place
    np.testing.assert_array_equal(again.pose, place(0.4, -0.1, 1.1))
    assert (again.promise, again.firm) == (None, False)
    np.testing.assert_array_equal(answer.twist, own.step(START).twist)
    np.testing.assert_array_equal(talk.loop.stepper.state(), own.state())


def test_a_stop_is_followed_while_anything_is_under_way() -> None:
    """The robot is late: it moves on for a while after the last twist of the stop."""
    late = PROBLEM.replace(robot=ergoqp.DeclaredRobot(delay=0.1, lag=0.1))
    stepper = Stepper(late)
    stepper.warm_up()
    own, talk = stepper.sibling(), Talk(Loop("late", stepper.sibling()))
    posture = START.copy()
    step = own.step(posture)
    talk.ask(posture, USUAL | Flag.stands)
    for _ in range(40):
        posture = posture + 0.01 * step.posture_rate
        step = own.step(posture)
        talk.ask(posture, USUAL, acted=talk.sequence)
    stop = len(own.stop())
    for _ in range(stop + 60):
        own.brake()
    step = own.step(posture)
    answer = talk.ask(posture, USUAL, acted=talk.sequence, followed=stop + 60)
    np.testing.assert_array_equal(answer.twist, step.twist)
    np.testing.assert_array_equal(talk.loop.stepper.state(), own.state())


def test_a_stop_is_followed_in_the_periods_of_its_answer(talk: Talk, made: Stepper) -> None:
    """The next request may have another period."""
    own = made.sibling()
    step, answer = own.step(START), talk.ask(START, USUAL | Flag.stands)
    for _ in range(20):
        step, answer = (
            own.step(START, dt=0.02),
            talk.ask(START, USUAL, acted=talk.sequence, dt=0.02),
        )
    stop = own.stop(0.02)
    np.testing.assert_array_equal(answer.stop.reshape(-1, 6)[: len(stop)], stop)
    assert answer.times[0] == 0.02
    acted = talk.sequence
    talk.ask(START, USUAL, acted=acted, followed=3, dt=0.01)
    for twist in stop[:5]:
        np.testing.assert_allclose(own.brake(0.02).twist, twist, atol=1e-14)
    step = own.step(START, dt=0.005)
    answer = talk.ask(START, USUAL, acted=acted, followed=5, dt=0.005)
    np.testing.assert_array_equal(answer.twist, step.twist)


@pytest.mark.parametrize("way", ["machine code", "Python"])
def test_the_longest_stop_ends_at_zero(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow object has more than 8192 periods of 1 ms to its rest."""
    if way == "Python":
        monkeypatch.setattr("ergoqp.service.loop.packing_of", lambda *_: None)
    slow = ergoqp.limits.TwistLimit(linear_acceleration=0.02, angular_acceleration=0.06)
    limits = [slow if isinstance(each, type(slow)) else each for each in PROBLEM.limits]
    stepper = Stepper(PROBLEM.replace(limits=limits, dt=0.001))
    talk = Talk(Loop("slow", stepper.sibling()))
    answer = talk.ask(START, USUAL | Flag.takes_over | Flag.twist, twist=0.19, dt=0.001)
    exact = talk.loop.stepper.stop()
    assert len(exact) > 8192
    stop = answer.stop.reshape(-1, 6)[: answer.knots]
    assert not stop[-1].any()
    times = answer.times[: answer.knots]
    assert (np.diff(times) > 0).all()
    assert times[-1] >= 0.001 * len(exact) - 1e-9
    lines = np.interp(0.001 * np.arange(1, len(exact) + 1), times, stop[:, 0])
    assert np.abs(lines - exact[:, 0])[1:].max() < 3e-4


def test_a_stop_of_very_short_periods_does_not_hold_up_the_other_loops(talk: Talk) -> None:
    acted = talk.ask(START, USUAL | Flag.takes_over | Flag.twist, dt=1e-5, twist=0.19).sequence
    answer = talk.ask(START, USUAL, acted=acted, followed=30_000)
    assert answer.kind == Tell.unknown
    assert "30000 periods" in answer.text
    # Nothing was braked: who knows better goes on from the answer.
    again = talk.ask(START, USUAL, acted=acted, dt=1e-5)
    np.testing.assert_allclose(again.twist, 0.19, atol=1e-4)


@pytest.mark.parametrize(
    ("given", "kind", "words"),
    [
        ({"version": 0}, Tell.refused, "version: got 0"),
        ({"version": 2}, Tell.refused, "version: got 2"),
        ({"kind": 3}, Tell.refused, "kind: got 3"),
        ({"coordinates": 31}, Tell.refused, "posture: got 31 entries, allowed 32"),
        ({"problem": 8}, Tell.refused, "the problem of this loop was replaced"),
        ({"contact": 1}, Tell.refused, "contact: got 1"),
        ({"sequence": 1}, Tell.refused, "sequence: got 1 again"),
        ({"acted": 99}, Tell.unknown, "does not know"),
        ({"acted": 0}, Tell.unknown, "does not know"),
        ({"session": 3}, Tell.unknown, "does not know"),
        ({"session": 0}, Tell.unknown, "does not know"),
    ],
)
def test_a_request_that_is_none_of_this_loop_changes_nothing(
    talk: Talk, given: dict[str, int], kind: Tell, words: str
) -> None:
    first = talk.ask(START, USUAL | Flag.stands)
    before = talk.loop.stepper.state()
    given = {"acted": first.sequence} | given
    answer = talk.ask(START, USUAL, **given)
    assert answer.kind == kind
    assert words in answer.text
    np.testing.assert_array_equal(talk.loop.stepper.state(), before)
    # The loop goes on for the client that knows better.
    talk.sequence = max(talk.sequence, 5)
    assert talk.ask(START, USUAL, acted=first.sequence, problem=7).kind == Tell.step


def test_bad_numbers_give_the_step_of_bad_numbers(talk: Talk) -> None:
    acted = talk.ask(START, USUAL | Flag.stands).sequence
    for _ in range(10):
        acted = talk.ask(START, USUAL, acted=acted).sequence
    nan = np.full(32, np.nan)
    for one, cause in [
        ({"posture": nan}, Cause.posture),
        ({"posture": START, "age": np.nan}, Cause.age),
        ({"posture": START, "age": 9.0}, Cause.too_old),
        ({"posture": START, "dt": np.nan}, Cause.dt),
        ({"posture": START, "dt": -1.0}, Cause.dt),
        ({"posture": START, "dt": 5.0}, Cause.dt),
        ({"posture": START, "dt": 0.5}, Cause.long_period),
        ({"posture": START, "pose": np.inf, "bits": USUAL | Flag.pose}, Cause.pose),
        ({"posture": START, "twist": np.nan, "bits": USUAL | Flag.twist}, Cause.twist),
        ({"posture": START, "observed": 0.5, "bits": USUAL | Flag.observed}, Cause.posture),
    ]:
        answer = talk.ask(**({"bits": USUAL, "acted": acted} | one))
        assert answer.kind == Tell.step
        assert answer.causes >> cause & 1
        assert np.isfinite(answer.stop).all()
        assert answer.knots
        acted = answer.sequence
        assert talk.ask(START, 0, acted=acted).causes >> Cause.disabled & 1
        acted = talk.sequence


def test_hold_and_try_again_are_those_of_the_stepper(talk: Talk) -> None:
    acted = talk.ask(START, USUAL | Flag.stands).sequence
    for _ in range(5):
        acted = talk.ask(START, USUAL, acted=acted).sequence
    for _ in range(60):
        answer = talk.ask(START, USUAL | Flag.hold, acted=acted)
        acted = answer.sequence
    assert not answer.twist.any()
    assert answer.marks & Mark.still
    held = talk.ask(START, USUAL | Flag.explain, acted=acted)
    assert "held" in held.text
    again = talk.ask(START, USUAL | Flag.try_again, acted=held.sequence)
    assert again.twist.any()
    assert not again.marks & Mark.still


@pytest.mark.slow  # it compiles the step of each period
@pytest.mark.parametrize("dt", [0.01, 0.003, 0.001])
def test_both_ways_of_packing_give_the_same_bytes(
    dt: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From full speed, with bad inputs in between; the time that a step took differs."""
    stepper = Stepper(PROBLEM, dt=dt, compiled=True)
    one = Talk(Loop("screwing", stepper.sibling()))
    monkeypatch.setattr("ergoqp.service.loop.packing_of", lambda *_: None)
    other = Talk(Loop("screwing", stepper.sibling()))
    rng, acted, knots, pose, sent = np.random.default_rng(0), 0, set(), np.eye(4), np.zeros(6)
    full = PROBLEM.twist_limit.speed * [0.9, -0.5, 1, 0.4, -1, 0.2]
    for number in range(240):
        bits = int(USUAL) | (int(rng.integers(0, 16)) if number else 0)
        bits |= int(Flag.explain) * (number % 3 == 0) | int(Flag.hold) * (number % 30 > 24)
        bits |= int(Flag.try_again) * (number % 30 == 0) | int(Flag.brake) * (number % 23 == 9)
        bits |= int(Flag.stands) * (number % 50 == 35)
        given = {
            "posture": START + 0.005 * rng.standard_normal(32),
            "pose": np.eye(4) if number % 17 == 3 else pose,
            "twist": full if number % 40 == 0 else sent,
            "observed": rng.random(32) < 0.9,
            "age": float(rng.choice([0.0, 0.01, 0.2, np.nan], p=[0.6, 0.3, 0.05, 0.05])),
            "dt": dt * float(rng.choice([1, 1, 1, 2, 0.7, 900])),
        }
        if number % 9 == 4:
            given["observed"] = np.full(32, 0.5)
        if number % 40 == 0:
            bits |= int(Flag.takes_over | Flag.twist)
        followed = int(rng.choice([0, 2], p=[0.9, 0.1])) * bool(acted)
        first = one.ask(bits=bits, acted=acted, followed=followed, **given)
        second = other.ask(bits=bits, acted=acted, followed=followed, **given)
        assert first.kind == second.kind == Tell.step
        for field in answer_frame(one.loop.coordinates, one.loop.rows).fields:
            if field.name in ("session", "computed"):
                continue
            left, right = getattr(first, field.name), getattr(second, field.name)
            if field.name in ("times", "stop"):
                k = first.knots * (6 if field.name == "stop" else 1)
                left, right = left[:k], right[:k]
            np.testing.assert_array_equal(left, right, err_msg=field.name)
        np.testing.assert_array_equal(one.loop.stepper.state(), other.loop.stepper.state())
        np.testing.assert_array_equal(one.loop.before, other.loop.before)
        assert one.loop.turned == other.loop.turned
        assert (first.marks & Mark.begun != 0) == (number % 40 == 0 or number % 50 == 35)
        acted, pose, sent = first.sequence, first.pose.reshape(4, 4), first.twist
        knots.add(first.knots)
    assert max(knots) > 30
    assert one.done[0] > 3
    assert one.done[1] > 3
    assert one.done[SENT] > 3


@pytest.mark.parametrize("dt", [0.005, 0.001])
def test_the_knots_are_the_stop_to_a_micrometre(dt: float) -> None:
    """Where a stop has more twists than knots, the lines between these stay beside it."""
    stepper = Stepper(PROBLEM, dt=dt)
    stepper.warm_up()
    stepper.reset(twist=PROBLEM.twist_limit.speed * [0.9, -0.5, 1, 0.4, -1, 0.2])
    stepper.step(START)
    twists = stepper.stop()
    chosen = chosen_knots(twists)
    assert len(chosen) <= KNOTS < len(twists)
    assert chosen[0] == 0
    assert chosen[-1] == len(twists) - 1
    periods = np.arange(len(twists))
    lines = np.array([np.interp(periods, chosen, twists[chosen, i]) for i in range(6)]).T
    assert np.abs(lines - twists).max() < 5e-5
    assert np.abs(np.cumsum(lines - twists, axis=0)).max() * dt < 1e-6
    steepest = np.abs(np.diff(lines, axis=0)).max(axis=0) / dt
    assert (steepest <= np.array(PROBLEM.twist_limit.acceleration) * (1 + 1e-9)).all()
