"""An exception at any point of a call leaves a stepper that is usable, and where it was."""

from __future__ import annotations

import shutil
import signal
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from step_samples import held_pose, near_comfort, problem_of

import ergoqp
from ergoqp.problem.settings import Control
from ergoqp.step.guide import Guide
from ergoqp.step.layout import places
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Stepper

PACKAGE = str(Path(ergoqp.__file__).parent)
POSTURE = near_comfort("screwing", np.random.default_rng(3), 25)
PLACE = Guide(held_pose("screwing"), firm=True)
MOVING = np.array([0.05, 0, 0, 0, 0.1, 0])


class Interrupt(BaseException):
    """As KeyboardInterrupt, but certainly this one."""


@cache
def made(kind: str, number: int) -> Stepper:
    """One stepper: plain, with a guide, or without a mean."""
    problem, guide = problem_of("screwing"), PLACE if kind == "guided" else None
    if kind == "planned":
        problem = problem.replace(control=Control(average=0.0))
    return Stepper(problem, guide=guide, log=lambda _: None)


def fresh(kind: str, number: int = 1) -> Stepper:
    """A stepper as new."""
    stepper = made(kind, number)
    stepper.reset()
    return stepper


def stepping(kind: str) -> Stepper:
    """A stepper that moves."""
    stepper = fresh(kind, 0)
    for _ in range(20):
        step = stepper.step(POSTURE)
    assert step.twist.any()
    return stepper


CALLS: dict[str, tuple[str, Callable[[Stepper], Any]]] = {
    "step": (
        "plain",
        lambda s: s.step(POSTURE, held_pose("screwing"), MOVING, dt=0.02, observed=np.ones(32)),
    ),
    "step of a wrong posture": ("plain", lambda s: s.step("no posture", enable="no")),
    "lost frame": ("plain", lambda s: s.step(None)),
    "brake": ("plain", lambda s: s.brake()),
    "brake after a ramp": ("plain", lambda s: s.brake(elapsed=0.07)),
    "stop": ("plain", lambda s: s.stop()),
    "state": ("plain", lambda s: s.state()),
    "reset": ("plain", lambda s: s.reset()),
    "reset of a moving object": ("plain", lambda s: s.reset(twist=MOVING)),
    "restore": ("plain", lambda s: s.restore(ergoqp.initial_state(s.problem, MOVING))),
    "hold": ("guided", lambda s: s.hold()),
    "try again": ("guided", lambda s: s.try_again()),
    "another guide": ("guided", lambda s: s.guide(np.eye(4))),
    "no guide": ("guided", lambda s: s.guide(None)),
    "sent instead": ("planned", lambda s: s.sent_instead(0.5 * MOVING)),
}


def within(left: np.ndarray, before: np.ndarray, after: np.ndarray) -> bool:
    """Whether a state is that before or after a call, or one of them and on hold."""
    held = places(StepModel(problem_of("screwing")).state)["on_hold"].start
    allowed = [before, after]
    for state in (before, after):
        allowed.append(state.copy())
        allowed[-1][held] = 1.0
    return any(np.array_equal(left, state) for state in allowed)


def interrupted(call: Callable[[], Any], line: int) -> tuple[bool, str]:
    """Make a call that is interrupted before its `line`-th line in the package.

    Returns:
        Whether it was, and the text of where.
    """
    passed, where = 0, ""

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal passed, where
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            passed += 1
            if passed == line:
                where = f"{frame.f_code.co_name}:{frame.f_lineno - frame.f_code.co_firstlineno}"
                raise Interrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except Interrupt:
        return True, where
    finally:
        sys.settrace(before)
    return False, where


def goes_on(stepper: Stepper) -> list[np.ndarray]:
    """What the next calls give."""
    steps = [stepper.step(POSTURE), stepper.brake(0.02), stepper.step(POSTURE)]
    assert not any("asked" in step.reason for step in steps[::2])
    return [step.account("next_state") for step in steps]


@pytest.mark.slow
@pytest.mark.parametrize("name", CALLS)
def test_before_any_line_it_leaves_the_stepper_as_before_or_as_after_the_call(name: str) -> None:
    kind, call = CALLS[name]
    stepper, other = stepping(kind), fresh(kind)
    start, log, lines = stepper._ready, stepper._log, 0
    for held in (False, True):
        stepper._ready, stepper._held = start, held
        before, frame = stepper.state(), stepper.frame
        call(stepper)
        after, next_frame = stepper.state(), stepper.frame
        for line in range(1, 10000):
            if line > 100 and line % 17:  # a loop repeats its lines
                continue
            stepper._ready, stepper._held = start, held
            hit, where = interrupted(lambda: call(stepper), line)
            if not hit:
                break
            lines += 1
            left = stepper.state()
            assert stepper._log is log
            assert within(left, before, after), where
            given = [each.tobytes() for each in stepper.frame]
            assert given in ([each.tobytes() for each in known] for known in (frame, next_frame))
            # What follows is as if it had never been interrupted.
            other._ready = stepper._ready
            other.restore(left)
            for one, same in zip(goes_on(stepper), goes_on(other), strict=True):
                np.testing.assert_array_equal(one, same, err_msg=where)
    assert lines > 1


@pytest.mark.slow
@pytest.mark.parametrize("call", ["step", "brake", "brake after a ramp", "stop"])
@pytest.mark.parametrize("compiled", [False, True])
def test_a_signal_that_raises_counts_as_no_call(call: str, compiled: bool) -> None:
    """As Ctrl-C that the loop catches: what the caller did not get was not sent."""
    if compiled:
        _ = shutil.which("cc") or pytest.skip("no C compiler")
    stepper, rng = Stepper(problem_of("screwing"), compiled=compiled), np.random.default_rng(0)
    for _ in range(20):
        stepper.step(POSTURE)

    def handler(*_: object) -> None:
        raise Interrupt

    make, times, spent = CALLS[call][1], 0, []
    for _ in range(5):
        start = time.perf_counter()
        make(stepper)
        spent.append(time.perf_counter() - start)
    usual = signal.signal(signal.SIGALRM, handler)
    try:
        for _ in range(300):
            before, answer = stepper.state(), None
            try:
                signal.setitimer(signal.ITIMER_REAL, rng.uniform(1e-6, 1.5 * min(spent)))
                answer = make(stepper)
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            except Interrupt:
                pass
            if answer is None:
                times += 1
                np.testing.assert_array_equal(stepper.state(), before)
            elif call != "stop":
                np.testing.assert_array_equal(stepper.state(), answer.account("next_state"))
            if rng.random() < 0.2:
                assert "asked" not in stepper.step(POSTURE).reason
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, usual)
    assert times > 10


def test_hold_during_a_step_is_not_lost() -> None:
    """A signal handler that asks the loop to hold may run in the middle of a step."""
    stepper = stepping("plain")

    class Slow:
        def __array__(self, *_: object, **__: object) -> np.ndarray:
            stepper.hold()
            return POSTURE

    stepper.step(Slow())
    assert "held" in stepper.step(POSTURE).reason
    stepper.try_again()
    assert "held" not in stepper.step(POSTURE).reason
