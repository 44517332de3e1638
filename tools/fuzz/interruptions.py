"""Calls of the fuzzer's stepper that are interrupted, and the judge of what they leave behind.

An interrupted call counts as not made: the stepper is where it was before the call. Three of four
interruptions are exceptions before a random line of the package, the same in every run; the others
come from a signal handler after a random time. The loop then goes on, and its judges with it.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np

import ergoqp
from ergoqp.errors import InputError
from ergoqp.step.stepper import Stepper
from tools.fuzz.inputs import Call
from tools.fuzz.judge import Tally
from tools.fuzz.problems import moving

_SHARE: Final = 0.15
"""Share of the calls before which one is interrupted."""

_BY_SIGNAL: Final = 0.25
"""Share of the interruptions that come from a signal handler."""

_ASKED: Final = 0.3
"""Share of the interruptions after which `Stepper.brake` is asked what comes next.

The others are followed by the loop's own call, because a complete `brake` may mend what an
interrupted call has left.
"""

_OFTEN: Final = (0.3, 0.25, 0.25, 0.05, 0.05, 0.1)
"""How often each call but the loop's own is interrupted, see `Interruptions._drawn`."""

_PACKAGE: Final = str(Path(ergoqp.__file__).parent)


class Interrupt(BaseException):
    """As KeyboardInterrupt, but certainly this one."""


class Interruptions:
    """Interrupts calls of one stepper, see the module."""

    def __init__(self, stepper: Stepper, dice: np.random.Generator, tally: Tally) -> None:
        """Keep what is interrupted.

        Args:
            stepper: the loop's; every call leaves it as it is, or that is counted as wrong.
            dice: of the interruptions alone, so that the other calls are the same without them.
            tally: takes what is found.
        """
        self._stepper, self._dice, self._tally = stepper, dice, tally
        self._lines: dict[str, int] = {}
        self._seconds: dict[str, float] = {}

    def before(self, call: Call, where: str) -> None:
        """Interrupt a call now and then, before the loop makes its own.

        Args:
            call: that the loop is going to make; half of the interrupted calls are the same.
            where: for the report.
        """
        if self._dice.random() >= _SHARE:
            return
        stepper, asked = self._stepper, self._dice.random() < _ASKED
        name, make = self._drawn(call)
        where = f"{where}, {name} interrupted"
        before, frame = stepper.state(), stepper.frame
        expected = stepper.brake() if asked else None
        stepper.restore(before)
        try:
            if self._dice.random() < _BY_SIGNAL and _signals():
                hit, late = self._by_signal(name, make), False
            else:
                hit, late = self._by_line(name, make, before)
        except BaseException as error:  # whatever it is, the loop must not see it
            if isinstance(error, KeyboardInterrupt):
                raise
            if not isinstance(error, InputError):
                self._wrong("exceptions", f"{type(error).__name__} of {name}", where, f"{error!r}")
            hit, late = False, False
        if not hit or late:
            # It was made, and counts as made; the loop goes on as if it was not.
            stepper.restore(before)
            return
        self._tally.interrupted += 1
        left = stepper.state()
        if not np.array_equal(left, before):
            at = np.flatnonzero(left != before)
            self._wrong("unsafe", f"an interrupted {name}", where, f"state differs at {at[:9]}")
            stepper.restore(before)
        elif any(a.tobytes() != b.tobytes() for a, b in zip(frame, stepper.frame, strict=True)):
            self._wrong("unsafe", f"the frame after an interrupted {name}", where, "differs")
        if expected is None:
            return
        try:
            step = stepper.brake()
            same = step.reason == expected.reason and np.array_equal(step.twist, expected.twist)
        except Exception as error:  # whatever it is, the loop must not see it
            self._wrong("exceptions", f"{type(error).__name__} after {name}", where, f"{error!r}")
        else:
            if not same:
                what = f"{step.twist} {step.reason!r}, not {expected.twist} {expected.reason!r}"
                self._wrong("unsafe", f"brake after an interrupted {name}", where, what)
        stepper.restore(before)

    def _wrong(self, figure: str, kind: str, where: str, what: str) -> None:
        self._tally.wrong(figure, kind, where, what)

    def _drawn(self, call: Call) -> tuple[str, Callable[[], Any]]:
        """Return which call is interrupted; its answer is never None."""
        stepper, given, rng = self._stepper, call.arguments, self._dice
        twist, ramp = moving(rng, stepper.problem), float(rng.uniform(0, 0.3))
        others: tuple[tuple[str, Callable[[], Any]], ...] = (
            ("brake", lambda: stepper.brake()),
            ("brake after a ramp", lambda: stepper.brake(elapsed=ramp)),
            ("stop", lambda: stepper.stop()),
            ("try_again", lambda: stepper.try_again() or True),
            ("reset", lambda: stepper.reset() or True),
            ("reset of a moving object", lambda: stepper.reset(twist) or True),
        )
        if call.kind != "step" or rng.random() < 0.5:
            return others[rng.choice(len(others), p=_OFTEN)]
        # Written out: a signal handler may run after a call by ``**given`` and before its answer is
        # assigned, see ceval.c of CPython, CALL_FUNCTION_EX.
        return "step", lambda: stepper.step(
            call.posture,
            given.get("pose"),
            given.get("twist"),
            dt=given.get("dt"),
            age=given.get("age", 0.0),
            enable=given.get("enable", True),
            observed=given.get("observed"),
        )

    def _by_line(self, name: str, make: Callable[[], Any], before: np.ndarray) -> tuple[bool, bool]:
        """Make a call that is interrupted before a random line of the package.

        Returns:
            Whether it was, and whether that was before the last line, which only returns: then the
            call counts as made. A signal handler never runs there, see ``docs/loop.md``.
        """
        known = self._lines.get(name, 0)
        # Sometimes beyond the end, so that a longer way through the same call becomes known.
        line = int(self._dice.integers(1, int(1.2 * known) + 2)) if known else sys.maxsize
        hit, passed = _traced(make, line)
        if not hit:
            self._lines[name] = max(known, passed)
            return False, False
        left = self._stepper.state()
        if np.array_equal(left, before):
            return True, False
        self._stepper.restore(before)
        _, passed = _traced(make, sys.maxsize)
        late = passed == line and np.array_equal(self._stepper.state(), left)
        self._stepper.restore(left)
        return True, late

    def _by_signal(self, name: str, make: Callable[[], Any]) -> bool:
        """Make a call that a signal handler interrupts after a random time; return whether it was.

        A call that has returned its answer was not.
        """
        longest = self._seconds.get(name, 1e-3)
        armed = True

        def handler(*_: object) -> None:
            # The timer may run out before it is stopped, and the handler be called after it.
            if armed:
                raise Interrupt

        usual, answer, start = signal.signal(signal.SIGALRM, handler), None, time.perf_counter()
        try:
            signal.setitimer(signal.ITIMER_REAL, self._dice.uniform(1e-6, 1.2 * longest))
            answer = make()
            armed = False
        except Interrupt:
            armed = False
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, usual)
        if answer is not None:
            self._seconds[name] = time.perf_counter() - start
        return answer is None


def _signals() -> bool:
    """Whether a signal handler can interrupt: on POSIX systems, in the main thread."""
    main = threading.current_thread() is threading.main_thread()
    return hasattr(signal, "setitimer") and main


def _traced(make: Callable[[], Any], line: int) -> tuple[bool, int]:
    """Make a call that is interrupted before its `line`-th line in the package.

    Returns:
        Whether it was, and how many lines it passed.
    """
    passed = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal passed
        if not frame.f_code.co_filename.startswith(_PACKAGE):
            return None
        if event == "line":
            passed += 1
            if passed == line:
                raise Interrupt
        return trace

    usual = sys.gettrace()
    sys.settrace(trace)
    try:
        make()
    except Interrupt:
        return True, passed
    finally:
        sys.settrace(usual)
    return False, passed
