"""One loop of the service: a stepper, and what its client and the robot did with its answers."""

from __future__ import annotations

import os
import time
from typing import Final

import numpy as np

from ergoqp.service.packing import packing_of
from ergoqp.service.reasons import reason_code
from ergoqp.service.schema import (
    ANSWER_HEAD,
    KNOTS,
    REQUEST_HEAD,
    SPOKEN,
    TEXT,
    VERSION,
    Ask,
    Flag,
    Mark,
    Tell,
    answer_frame,
    note,
    request_frame,
)
from ergoqp.step.answer import Step
from ergoqp.step.causes import Status
from ergoqp.step.certification import longest_stop
from ergoqp.step.guide import Guide
from ergoqp.step.layout import SHORTEST_DT
from ergoqp.step.rest import FIRM, UNKNOWN
from ergoqp.step.stepper import Stepper

_COPIED: Final = ("fault", "residuals")
"""First and last of the outputs of a step that lie beside each other in an answer too."""

# Plain numbers, because those of an enumeration cost ten times as much to compare.
_FRAME, _POSE, _TWIST, _OBSERVED, _ENABLE, _EXPLAIN, _BRAKE = (
    int(Flag[name]) for name in ("frame", "pose", "twist", "observed", "enable", "explain", "brake")
)
_BEGINS: Final = int(Flag.stands | Flag.takes_over)
_ORDERS: Final = int(Flag.hold | Flag.try_again | Flag.guide | Flag.no_guide)
_STEP, _TOLD, _STILL = int(Ask.step), int(Tell.step), int(Mark.still)
_STATUSES: Final = {status.name: status for status in Status}
_HOLD, _UNRECORDED = int(Flag.hold), int(Mark.unrecorded)

RECEIVED, _COMPUTED, SENT, NOT_SENT = range(4)
"""What was done with bytes that arrived, as in ``c/exchange.c``."""
_MOST_BRAKES: Final = 4096
"""Most periods that are braked for one request, which takes some 0.1 s."""
_CALM: Final = 1.0
"""How long a robot that stands is braked on [s], beside what is still under way: what follows of a
longer rest is the same."""
_MOST_TWISTS: Final = 8192
"""Of a stop of more twists only every second, third, ... is computed."""
_STALE: Final = 10
"""A reason in words is formed anew after so many steps."""

_UNKNOWN: Final = (
    "the service does not know what the robot does: report that it stands, or take over by its"
    " measured twist"
)


class Request:
    """One request, read: views of the buffer that the client's frames are received in."""

    def __init__(self, coordinates: int) -> None:
        """Make a buffer for frames of a problem."""
        frame = request_frame(coordinates)
        self.buffer = bytearray(frame.length)
        self.length = frame.length
        self.pose = frame.numbers(self.buffer, "pose").reshape(4, 4)
        self.twist = frame.numbers(self.buffer, "twist")
        self.guide = frame.numbers(self.buffer, "guide").reshape(4, 4)
        self.promise = frame.numbers(self.buffer, "promise")
        self.posture = frame.numbers(self.buffer, "posture")
        self.observed = frame.numbers(self.buffer, "observed")
        self.address = self.pose.ctypes.data - frame.at["pose"].start


class Loop:
    """A stepper that takes frames and gives frames.

    The states after the answer that the robot executes, and after the newest one, are kept. A
    request says which answer was executed, and how many periods of its stop. What was answered
    since is taken back, and those periods are braked, before the step is computed. So the state of
    the loop is always what the robot did, whatever was lost or late between the two.

    Attributes:
        name: name of the loop.
        session: number of the present beginning; 0: nobody has reported what the robot does.
        undone: answers that were taken back so far.
        moved: whether the last answer was not at rest.
        before: the state before the last step (n,), which nothing changes; None if the last
            answer was no step. With `led` and `turned` it is for a record.
        led: the guide before the last step: pose and promise, nothing for none; None for that of
            the start.
        turned: whether the last step began anew, undid answers, or changed hold or guide.
        unrecorded: set by who could not record an answer; the next one says so.
    """

    def __init__(self, name: str, stepper: Stepper, engine: int = 0, digest: int = 0) -> None:
        """Prepare the frames, and whatever would make the first step slow."""
        problem = stepper.problem
        self.name, self.stepper, self.digest = name, stepper, digest
        self.coordinates, self.rows = len(problem.coordinates), len(problem.row_names)
        self.session, self.undone, self.moved = 0, 0, False
        self._engine, self._sequence = engine, 0
        # State after an answer, the period of its stop [s] and its guide; what is braked after it.
        self._kept: dict[int, tuple[np.ndarray, float, bytes | None]] = {}
        self._braked: tuple[int, int, np.ndarray, int] | None = None
        self._guide: bytes | None = None
        self._said: tuple[int, int, int, int] | None = None
        self._text, self._since = bytes(TEXT), 0
        self.before: np.ndarray | None = None
        self.led: bytes | None = None
        self.turned = self.unrecorded = False
        self._bits = 0
        frame = answer_frame(self.coordinates, self.rows)
        self._length, self._out = frame.length, bytearray(frame.length)
        self._view = memoryview(self._out)
        numbers = frame.numbers
        self._twist = numbers(self._out, "twist")
        self._pose = numbers(self._out, "pose").reshape(4, 4)
        self._rate = numbers(self._out, "posture_rate")
        self._rest = numbers(self._out, *_COPIED)
        self._times = numbers(self._out, "times")
        self._stop = numbers(self._out, "stop").reshape(KNOTS, 6)
        numbers(self._out, "speed")[:] = problem.twist_limit.speed
        numbers(self._out, "acceleration")[:] = problem.twist_limit.acceleration
        numbers(self._out, "longest_dt")[:] = problem.longest_period
        self._words = frame.at["text"]
        self._guided, self._first_guide = stepper.guided, stepper.place
        robot = problem.robot
        self._settling = _CALM + robot.dead_time + 10 * robot.lag
        stepper.warm_up()
        slices = stepper.evaluator.slices
        self._copied = slice(slices[_COPIED[0]].start, slices[_COPIED[1]].stop)
        self._pose_at, self._rate_at = slices["pose_used"], slices["posture_rate"]
        self._causes_at = slices["causes"].start
        self._counted = np.arange(1.0, KNOTS + 1)
        self._asked = (0, 0, 0.0, 0.0)
        where = request_frame(self.coordinates), frame, self._out, self._copied, engine, digest
        self._packing = packing_of(stepper, *where)
        self.exchange = None if self._packing is None else self._packing.exchange

    def new_request(self) -> Request:
        """Return a buffer for the requests of one client."""
        return Request(self.coordinates)

    def answer(self, request: Request) -> bytes | memoryview:
        """Return the answer to a whole frame; it is valid until the next one.

        It never raises because of what the frame holds.
        """
        (
            length,
            version,
            kind,
            session,
            sequence,
            acted,
            problem,
            followed,
            bits,
            coordinates,
            contact,
            age,
            dt,
        ) = REQUEST_HEAD.unpack_from(request.buffer)
        wrong, self.before = "", None
        if version not in SPOKEN:
            wrong = f"version: got {version}, allowed {', '.join(map(str, SPOKEN))}"
        elif kind != _STEP:
            wrong = f"kind: got {kind}, allowed {int(Ask.step)} for a step"
        elif coordinates != self.coordinates or length != request.length:
            wrong = f"posture: got {coordinates} entries, allowed {self.coordinates}"
        elif problem and problem != self.digest:
            wrong = "the problem of this loop was replaced: read its description again"
        elif contact:
            wrong = f"contact: got {contact}, allowed 0"
        if wrong:
            return note(Tell.refused, sequence, wrong, self.session)
        marks = 0
        if bits & _BEGINS:
            if wrong := self._begin(request, bits):
                return note(Tell.refused, sequence, wrong, self.session)
            marks |= Mark.begun
        elif session != self.session or acted not in self._kept:
            return note(Tell.unknown, sequence, _UNKNOWN, self.session)
        elif sequence <= self._sequence:
            wrong = f"sequence: got {sequence} again, allowed a number above {self._sequence}"
            return note(Tell.refused, sequence, wrong, self.session)
        elif acted != self._sequence or followed:
            if wrong := self._continue_from(acted, followed):
                return note(Tell.unknown, sequence, wrong, self.session)
            marks |= Mark.undone
        else:
            self.before = self._kept[acted][0]
        return self._step(request, sequence, acted, bits, marks, age, dt)

    def resume(self, session: int, acted: int, state: np.ndarray, guide: bytes | None) -> None:
        """Continue from the state before a recorded step, as if its client had acted on an answer.

        Args:
            session: the session of the step.
            acted: the answer that its request says was executed.
            state: the state before it (n,).
            guide: as `led`; None only if no guide was ever changed.

        Raises:
            InputError: if it is no state of this problem.
        """
        stepper = self.stepper
        if self._guided and guide != self._guide:
            self._take_guide(guide)
        stepper.restore(state)
        self.session, self._sequence, self._bits = session, acted, 0
        self._kept, self._braked = {acted: (state, stepper.dt, self._guide)}, None
        self.disarm()

    def _begin(self, request: Request, bits: int) -> str:
        """Begin anew, at rest or at the measured twist; return why this cannot be."""
        twist = request.twist if bits & Flag.takes_over else None
        if twist is not None and not (bits & Flag.twist and np.isfinite(twist).all()):
            return "takes_over: got no twist of six finite numbers, allowed the measured twist"
        if self._guide is not None:
            self._take_guide(None)
        self.stepper.reset(twist)
        self.session = int.from_bytes(os.urandom(7), "little") + 1
        self._kept, self._braked = {}, None
        self.before = self.stepper.state()
        return ""

    def _continue_from(self, acted: int, followed: int) -> str:
        """Take back what was not executed, and brake what was; return why this cannot be."""
        (state, period, guide), done, rest = self._kept[acted], 0, 0
        if self._braked is not None and self._braked[0] == acted and self._braked[1] <= followed:
            _, done, state, rest = self._braked
        stepper = self.stepper
        if guide != self._guide:
            self._take_guide(guide)
        stepper.restore(state)
        for _ in range(min(followed - done, _MOST_BRAKES)):
            if rest * period > self._settling:
                done = followed  # it stands, and goes on standing
                break
            done += 1
            rest = 0 if stepper.brake(period).twist.any() else rest + 1
        self.before = stepper.state() if done else state
        self._braked = (acted, done, self.before, rest) if done else None
        if done < followed:
            state, _, guide = self._kept[self._sequence]
            if guide != self._guide:
                self._take_guide(guide)
            stepper.restore(state)
            return f"{_UNKNOWN}: got {followed} periods of a stop"
        self.undone += acted != self._sequence
        return ""

    def _step(
        self,
        request: Request,
        sequence: int,
        acted: int,
        bits: int,
        marks: int,
        age: float,
        dt: float,
    ) -> memoryview:
        """Return the frame of a step."""
        stepper, packing, self.led = self.stepper, self._packing, self._guide
        self.turned = marks != 0 or (bits ^ self._bits) & _HOLD != 0
        self._bits = bits
        if self.unrecorded:
            marks, self.unrecorded = marks | _UNRECORDED, False
        if bits & _ORDERS:
            self._obey(request, bits)
        if bits & _BRAKE:
            step = stepper.brake(dt)
        elif packing is not None:
            self._asked = request.address, bits, dt, age
            step = stepper.step_filled(self._fill, bits & _FRAME != 0)
        else:
            step = stepper.step(
                request.posture if bits & _FRAME else None,
                request.pose if bits & _POSE else None,
                request.twist if bits & _TWIST else None,
                dt=dt,
                age=age,
                enable=bits & _ENABLE != 0,
                observed=request.observed if bits & _OBSERVED else None,
            )
        return self._conclude(step, sequence, acted, bits, marks, dt)

    def _conclude(
        self, step: Step, sequence: int, acted: int, bits: int, marks: int, dt: float
    ) -> memoryview:
        """Write the answer of a step that was computed."""
        stepper, packing = self.stepper, self._packing
        usual = dt == stepper.dt or SHORTEST_DT <= dt <= stepper.problem.longest_period
        period, values = dt if usual else stepper.dt, step.values
        if packing is not None:
            knots = packing.tell(period)
        else:
            knots = self._write_stop(period)
            self._twist[:] = step.twist
            self._pose[...] = values[self._pose_at].reshape(4, 4).T
            self._rate[:] = values[self._rate_at]
            self._rest[:] = values[self._copied]
        causes, status = int(values[self._causes_at]), _STATUSES[step.status]
        code = reason_code(step, status, causes) if status or causes else 0
        self._keep(acted, sequence, period)
        if not self.moved:
            marks |= _STILL
        if bits & _EXPLAIN:
            self._explain(step, (status, causes, code, bits & _HOLD))
        ANSWER_HEAD.pack_into(
            self._out,
            0,
            self._length,
            VERSION,
            _TOLD,
            self.session,
            sequence,
            self._engine,
            step.drawn,
            status,
            causes,
            code,
            marks,
            self.coordinates,
            self.rows,
            knots,
            step.solve_time,
        )
        return self._view

    def _keep(self, acted: int, sequence: int, period: float) -> None:
        """Keep the state after an answer, and that after the one that it continues from."""
        stepper = self.stepper
        state = stepper.state()
        kept = {acted: self._kept[acted]} if acted in self._kept else {}
        kept[sequence] = state, period, self._guide
        self._kept, self._sequence, self.moved = kept, sequence, not stepper.still
        if self._packing is not None:
            self._packing.arm(stepper.usual, state, self.session, sequence)

    def disarm(self) -> None:
        """Answer the next request in Python, whatever it is."""
        if self._packing is not None:
            self._packing.arm(None, self._rate, 0, 0)

    def exchanged(self, request: Request, done: int) -> memoryview:
        """Note what `exchange` computed or sent; return the answer.

        Args:
            request: the frame that was received.
            done: what was done with it, see ``c/exchange.c``.
        """
        *_, sequence, acted, _, _, bits, _, _, _, dt = REQUEST_HEAD.unpack_from(request.buffer)
        self.before, self.led, self.turned, self._bits = (
            self._kept[acted][0],
            self._guide,
            False,
            bits,
        )
        step = self.stepper.answered({}, bits & _FRAME != 0, time.perf_counter())
        if done == _COMPUTED:
            return self._conclude(step, sequence, acted, bits, 0, dt)
        usual = dt == self.stepper.dt or SHORTEST_DT <= dt <= self.stepper.problem.longest_period
        self._keep(acted, sequence, dt if usual else self.stepper.dt)
        return self._view

    def _fill(self) -> bool:
        """Write the request that is answered into the inputs of the step."""
        assert self._packing is not None
        return self._packing.take(*self._asked)

    def _obey(self, request: Request, bits: int) -> None:
        """Carry out what a request orders beside the step."""
        if bits & Flag.hold:
            self.stepper.hold()
        if bits & Flag.try_again:
            self.turned = True
            self.stepper.try_again()
        if self._guided and bits & (Flag.guide | Flag.no_guide):
            self._lead(request, bits)

    def _explain(self, step: Step, key: tuple[int, int, int, int]) -> None:
        """Write the reason in words.

        It is formed when its number changes, and every few steps, because it holds numbers. A step
        without a reason may still have a remark.
        """
        self._since += 1
        if key != self._said or self._since >= _STALE:
            self._said, self._since = key, 0
            self._text = step.reason.encode()[: TEXT - 1].ljust(TEXT, b"\0")
        self._out[self._words] = self._text

    def _lead(self, request: Request, bits: int) -> None:
        """Change the guide, if it is another one than before."""
        given = b"" if bits & Flag.no_guide else request.guide.tobytes() + request.promise.tobytes()
        if given != self._guide:
            self.turned = True
            self._take_guide(given)

    def _take_guide(self, given: bytes | None) -> None:
        """Take a guide: pose and promise, or nothing for none; None: that of the start."""
        self._guide = given
        if not given:
            self.stepper.guide(self._first_guide if given is None else None)
            return
        numbers = np.frombuffer(given)
        promise = float(numbers[16])
        firm = promise == FIRM
        expected = None if firm or promise == UNKNOWN else promise
        self.stepper.guide(Guide(numbers[:16].reshape(4, 4).copy(), expected, firm))

    def _write_stop(self, period: float) -> int:
        """Write the certified stop into the answer; return the number of knots."""
        most = longest_stop(self.stepper.problem, period)
        if most > _MOST_TWISTS:
            period *= (most - 2) // (_MOST_TWISTS - 2) + 1
        twists = self.stepper.stop(period)
        count = len(twists)
        if count <= KNOTS:
            self._times[:], self._stop[:count] = period * self._counted, twists
            return count
        chosen = chosen_knots(twists)
        count = len(chosen)
        self._times[:count], self._stop[:count] = (chosen + 1) * period, twists[chosen]
        return count


def chosen_knots(twists: np.ndarray) -> np.ndarray:
    """Return which twists (k, 6) of a long stop become its knots, at most `KNOTS` of them.

    Between knots the stop is a straight line. So they lie close where it bends, and the first and
    the last one always belong to them. Of a very long stop only every second, third, ... twist is
    looked at.
    """
    count = len(twists)
    stride = max(1, count // 128)
    seen = twists[::stride]
    bends = np.zeros(len(seen))
    bends[1:-1] = np.sqrt(np.abs(seen[2:] - 2 * seen[1:-1] + seen[:-2]).max(axis=1))
    bends[1:] += np.cumsum(bends)[-1] / (8 * len(seen)) + 1e-12  # added up one by one, as in C
    along = np.cumsum(bends)
    wanted = along[-1] * np.arange(KNOTS) / (KNOTS - 1) * (1 - 1e-12)
    chosen = np.minimum(np.searchsorted(along, wanted), len(seen) - 1) * stride
    chosen[-1] = count - 1
    return np.unique(chosen)
