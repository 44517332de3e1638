"""A client of the service in Python: the calls of `Stepper`, and a stop that needs no service."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import check_number, read_array
from ergoqp.errors import ErgoqpError, InputError
from ergoqp.service.asking import asking_of
from ergoqp.service.client_step import STATUSES, Answer, ClientStep, Plan, ramp
from ergoqp.service.folder import default_folder, socket_path
from ergoqp.service.relay import Base, RelayTell
from ergoqp.service.relay_link import RelayLink
from ergoqp.service.schema import (
    ANSWER_HEAD,
    HEAD,
    LONGEST,
    REQUEST_HEAD,
    VERSION,
    Ask,
    Flag,
    Tell,
    answer_frame,
    request_frame,
)
from ergoqp.service.stream import Stream
from ergoqp.step.layout import SHORTEST_DT

# Plain numbers, because those of an enumeration cost ten times as much to compare.
_FRAME, _POSE, _TWIST, _OBSERVED, _ENABLE, _TRY_AGAIN, _TAKES_OVER = (
    int(Flag[name])
    for name in ("frame", "pose", "twist", "observed", "enable", "try_again", "takes_over")
)
_STEP, _TOLD = int(Ask.step), int(Tell.step)
_CONNECTING: Final = 5.0
"""How long the first connection and the description may take [s]."""
_MOST: Final = 4e9
"""Most periods of a stop that a request can say."""
_ASK: Final = "call reset() once it stands, or reset(twist=) with its measured twist"


class ServiceError(ErgoqpError):
    """There is no service at an address, or it refused the description of the loop.

    Example:
        >>> from ergoqp.errors import ErgoqpError
        >>> issubclass(ServiceError, ErgoqpError)
        True
    """


class Client:
    """A loop of the service, with the calls of `ergoqp.Stepper`.

    Every answer comes with the stop that was certified with it. If the next answer is late, if the
    service ends, hangs or is started anew, `step` returns the next twist of that stop, and the
    service is told what the robot executed. No call raises because of the service once the client
    is made. A client belongs to one thread.

    The service never assumes that a robot stands. So begin with `reset`, and call it again when
    `waits` is true: the service does not know any more what the robot does.

    Args:
        address: name of the loop, such as ``"screwing"``, in the service's usual folder, or the
            path of its socket.
        dt: control period [s]. None: that of the loop.
        timeout: how long a call of `step` may wait for the answer [s]. None: half a period. Beyond
            the ``longest_dt`` of the description, a late answer is a pause that was too long.
        explain: whether the service writes reasons in full, which takes it some 60 us for each new
            one. Otherwise `ClientStep.reason` is a sentence without numbers.
        relay: path of the socket of `ergoqp relay`, or its name, such as ``"relay"``, in the
            service's usual folder. The relay then moves the robot, also when this program is late,
            hangs or dies, and `ClientStep.twist` is for information. It knows how far the stop has
            gone, so a pause of any length costs nothing but the stop. None: this program sends the
            twists itself.

    Attributes:
        description: what the loop is, as the service says it.
        dt, timeout: as of the arguments.

    Raises:
        ServiceError: if no service answers there.
        InputError: if an argument is out of range.

    Example:
        >>> from pathlib import Path
        >>> try:
        ...     Client(Path("/nowhere/screwing.sock"))
        ... except ServiceError as error:
        ...     print(error)
        service: nobody answers at '/nowhere/screwing.sock'; start `ergoqp serve`
    """

    def __init__(
        self,
        address: str | Path,
        dt: float | None = None,
        timeout: float | None = None,
        explain: bool = True,
        relay: str | Path | None = None,
    ) -> None:
        """Connect, and read what the loop is."""
        self._service = Stream("service", _path_of(address), HEAD, VERSION)
        self._relay = None if relay is None else RelayLink(_path_of(relay))
        self.description = self._read_description()
        self.dt = float(self.description["dt"] if dt is None else dt)
        check_number("dt", self.dt, 1e-5, float(self.description["longest_dt"]), "s")
        self.timeout = self.dt / 2 if timeout is None else float(timeout)
        check_number("timeout", self.timeout, 1e-5, 10.0, "s")
        rows, coordinates = self.description["rows"], self.description["coordinates"]
        self._names = {"rows": tuple(rows), "coordinates": tuple(coordinates)}
        self._reasons = {int(key): text for key, text in self.description["reasons"].items()}
        self._n, self._digest = len(coordinates), int(self.description["digest"])
        self._longest = float(self.description["longest_dt"])
        self._explain = int(Flag.explain) if explain else 0
        request = request_frame(self._n)
        self._request, self._given = bytearray(request.length), dict[str, np.ndarray]()
        for name in ("pose", "twist", "guide", "promise", "posture", "observed"):
            self._given[name] = request.numbers(self._request, name)
        self._posture = memoryview(self._request)[request.at["posture"]].cast("d")
        layout = answer_frame(self._n, len(rows))
        # The answer that is executed, and the one that arrives; they change places.
        self._kept, self._next = Answer(layout), Answer(layout)
        self._in_c = asking_of(self._request, layout)
        # What the robot executes, and how far, in periods of the answer.
        self._plan: Plan = self._kept
        self._followed, self._dt_of_answer = 0.0, self.dt
        self._session = self._sequence = self._acted = 0
        self._begin = self._hold = self._again = self._place = 0
        self._paused = False  # since it moved, and nobody has reported what the robot does
        self._head = ANSWER_HEAD.unpack_from(self._next.view)
        self._pending: tuple[int, int, float] | None = None
        self._acceleration = np.array(self.description["acceleration"], dtype=float)
        self._returned = -np.inf  # when the last twist was returned
        # Where the line of `twist_at` begins, since which step, and what it gave last.
        self._line_from = self._line_at = np.zeros(6)
        self._line_since = self._returned
        self._why = f"the service was not told yet what the robot does: {_ASK}"

    @property
    def late(self) -> int:
        """Answers that did not come in time, of the service and of the relay."""
        return self._counted("late")

    @property
    def lost(self) -> int:
        """Connections that were lost, or could not be made."""
        return self._counted("lost")

    @property
    def refused(self) -> int:
        """Answers that could not be used, and refusals."""
        return self._counted("refused")

    def _counted(self, name: str) -> int:
        relay = 0 if self._relay is None else getattr(self._relay.stream, name)
        return getattr(self._service, name) + relay

    @property
    def relay_stands(self) -> bool:
        """Whether the relay said in the last call that it sends zero, until it is told otherwise.

        It is false without a relay, and if the relay did not answer.
        """
        return self._relay is not None and self._relay.known and self._relay.stands

    @property
    def relay_twist(self) -> np.ndarray | None:
        """The twist (6,) that the relay sent when it was asked in the last call [m/s, rad/s].

        It is None without a relay, and if the relay did not answer.
        """
        return self._relay.twist.copy() if self._relay is not None and self._relay.known else None

    @property
    def waits(self) -> bool:
        """Whether the service has to be told what the robot does; see `reset`."""
        return not self._session and not self._begin

    def step(
        self,
        posture: Any,
        pose: Any = None,
        twist: Any = None,
        *,
        dt: float | None = None,
        age: float = 0.0,
        enable: bool = True,
        observed: Any = None,
    ) -> ClientStep:
        """Return the next twist of the object; the arguments are those of `Stepper.step`.

        An input that is no array of the right shape counts as one of NaN, which the step names.
        """
        start = time.perf_counter()
        bits, given = _ENABLE if enable is True or _is_one(enable) else 0, self._given
        if posture is not None:
            bits |= _FRAME
            try:
                # The fastest way for an array of the right length; it takes nothing else.
                self._posture[:] = posture
            except (TypeError, ValueError, BufferError):
                _put(given["posture"], posture, given["posture"].shape)
        if pose is not None:
            bits |= _POSE
            _put(given["pose"], pose, (4, 4))
        if twist is not None:
            bits |= _TWIST
            _put(given["twist"], twist, (6,))
        if observed is not None:
            bits |= _OBSERVED
            _put(given["observed"], observed, given["observed"].shape)
        return self._ask(start, bits, self.dt if dt is None else _number(dt), _number(age))

    def brake(self, dt: float | None = None) -> ClientStep:
        """Return the next braking twist without new data; see `Stepper.brake`."""
        period = self.dt if dt is None else _number(dt)
        return self._ask(time.perf_counter(), int(Flag.brake), period, 0.0)

    def stop(self) -> np.ndarray:
        """Return the twists that are left of the stop of the last answer (k, 6), one per period."""
        twists = []
        for number in range(1, 100_000):
            twists.append(self._plan.at((self._followed + number) * self._dt_of_answer))
            if not twists[-1].any():
                break
        return np.array(twists)

    def twist_at(self, seconds: float) -> np.ndarray:
        """Return the twist (6,) for a robot that is faster than the loop [m/s, rad/s].

        It follows a straight line from the last twist that this gave before the step to the twist
        of the step, within one period, and then the stop. So the robot is one period later than one
        that holds each twist: add `dt` to ``delay`` of the problem's ``[robot]``.

        Args:
            seconds: time since `step` returned [s].
        """
        if self._line_since != self._returned:
            self._line_since, self._line_from = self._returned, self._line_at
        seconds, executed = max(0.0, _number(seconds)), self._followed * self._dt_of_answer
        if seconds < self.dt:
            start, end = self._line_from, self._plan.at(executed)
            self._line_at = start + (end - start) * (seconds / self.dt)
        else:
            self._line_at = self._plan.at(executed + seconds - self.dt)
        return self._line_at.copy()

    def reset(self, twist: Any = None) -> None:
        """Report what the robot does, and begin anew with the next step.

        The stop of before is dropped. Until the service has answered, the twists of `step` are zero
        for a robot that stands. For one that moves they are a straight line from the measured twist
        to zero, and the service takes over what this line has come to.

        Args:
            twist: measured twist (6,) of a robot that moves [m/s, rad/s]. None: it stands.

        Raises:
            InputError: if `twist` is not six finite numbers.
        """
        self._returned = -np.inf
        if twist is None:
            begin, moves = int(Flag.stands), np.zeros(6)
        else:
            begin, moves = _TAKES_OVER, read_array("twist", twist, (6,), "6 finite numbers")
            # From here on its time counts. A robot that stands may do so for any time.
            self._returned = time.perf_counter()
        self._plan = ramp(moves, self._acceleration, self.dt)
        self._line_from = self._line_at = moves
        self._begin, self._followed, self._dt_of_answer = begin, 0.0, self.dt
        self._session = self._again = self._hold = 0
        self._pending, self._paused = None, False

    def hold(self) -> None:
        """Bring the object to rest and keep it there until `try_again` or `reset`."""
        self._hold, self._again = int(Flag.hold), 0

    def try_again(self) -> None:
        """Allow motion again after `hold`, after a fault of the robot, and after wrong frames."""
        self._hold, self._again = 0, _TRY_AGAIN

    def guide(self, pose: Any, promise: float = -1e9) -> None:
        """Have the object drawn to another place, or to none; see `Stepper.guide`.

        Args:
            pose: the place (4, 4) [m]. None: none.
            promise: expected cost there [points], or -1e9 for unknown.

        Raises:
            InputError: if the loop was started without a guide, or `pose` is no array (4, 4).
        """
        if not self.description["guided"]:
            raise InputError("guide: the loop was started without one; `ergoqp serve --guide`")
        self._place = int(Flag.no_guide)
        if pose is not None:
            place = read_array("guide", pose, (4, 4), "a pose (4, 4)")
            self._given["guide"][:], self._given["promise"][:] = place.ravel(), promise
            self._place = int(Flag.guide)

    def close(self) -> None:
        """Give the loop and the relay free; the robot has to be at rest."""
        self._service.close()
        if self._relay is not None:
            self._relay.stream.close()
        self._forget()
        self._why = f"the client was closed: {_ASK}"

    def __enter__(self) -> Client:
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def _ask(self, start: float, bits: int, dt: float, age: float) -> ClientStep:
        """Exchange a request for an answer, or go on with the stop."""
        gap = start - self._returned
        service, relay, longest = self._service, self._relay, self._longest
        period = dt if SHORTEST_DT <= dt <= longest else self.description["dt"]
        passed = gap > longest and relay is None and self._pass(gap)
        # The usual case first: nothing is wrong.
        if self._session and service.socket is not None and not service.outstanding and not relay:
            fresh = self._exchange(start, bits, dt, age)
        else:
            fresh = self._ready(start) and self._exchange(start, bits, dt, age)
            if fresh and relay is not None:
                fresh = self._hand_over(relay, start, period)
        gap, self._returned = (now := time.perf_counter()) - self._returned, now
        # This program may have been stopped while it waited.
        if gap > longest and relay is None and not passed:
            fresh = not self._pass(gap) and fresh
        if not fresh:
            if period == self._dt_of_answer:
                self._followed += 1.0
            else:
                self._followed += period / self._dt_of_answer
            twist = self._plan.at(self._followed * self._dt_of_answer)
            why, send = self._why, relay is None and not self._paused
            kept, names = self._kept, self._names
            return ClientStep(twist, "braking", why, False, start, kept, names, send=send)
        _, _, _, session, sequence, _, drawn, status, _, reason, _, _, _, _, computed = self._head
        self._adopt(session, sequence, period)
        self._again = 0
        kept = self._kept
        text = self._words(reason) if reason else ""
        return ClientStep(
            kept.twist.copy(),
            STATUSES[status],
            text,
            True,
            start,
            kept,
            self._names,
            computed,
            drawn,
            relay is None,
        )

    def _pass(self, gap: float) -> bool:
        """Go along the stop by the time between two twists, and lose the session.

        A robot that has a timeout slowed down meanwhile. It must not be sent its old speed again.
        Returns whether the robot moved, as far as is known.
        """
        moves = self._session != 0 or self._begin == _TAKES_OVER
        # Without a session the robot goes on with the stop.
        if moves or self._plan.at(self._followed * self._dt_of_answer).any():
            self._forget()
            self._paused = True
            self._why = f"{gap:.2f} s passed between two twists: {_ASK}"
            periods = self._followed + max(0.0, gap / self._dt_of_answer - 1.0)
            self._followed = min(periods, _MOST)
            return True
        return False

    def _forget(self) -> None:
        """Lose the session: from now on the service does not know what the robot does."""
        self._session = self._begin = 0

    def _periods(self) -> int:
        """Return how many periods of the stop were executed."""
        return int(min(self._followed, _MOST) + 0.5)

    def _adopt(self, session: int, sequence: int, period: float) -> None:
        """Take over the answer that was received: from now on it is executed."""
        self._kept, self._next = self._next, self._kept
        self._plan, self._session, self._acted = self._kept, session, sequence
        self._followed, self._begin, self._dt_of_answer = 0.0, 0, period

    def _words(self, reason: int) -> str:
        """Return the reason of the answer in words."""
        if self._explain:
            place = self._kept.layout.at["text"]
            if text := bytes(self._kept.view[place]).rstrip(b"\0"):
                return text.decode(errors="replace")
        return self._reasons.get(reason, "")

    def _ready(self, start: float) -> bool:
        """Ask the relay, connect, and drop what came too late; return whether a request can go."""
        if self._relay is not None and not self._continue_from(self._relay, start):
            return False
        if not self._session and not self._begin:
            return False
        service = self._service
        # An answer that comes now is too late: something else was executed meanwhile.
        if service.connect() and (
            not service.outstanding or service.receive(self._next.view, until=0.0)
        ):
            return True
        self._why = service.why
        return False

    def _exchange(self, start: float, bits: int, dt: float, age: float) -> bool:
        """Send a request; return whether its answer is a step that came in time."""
        self._sequence += 1
        begins = 0 if self._session else self._begin
        if begins == _TAKES_OVER:
            # Since it was measured the robot has been sent what this client gave for it.
            bits |= _TWIST
            self._given["twist"][:] = self._plan.at(self._followed * self._dt_of_answer)
        REQUEST_HEAD.pack_into(
            self._request,
            0,
            len(self._request),
            VERSION,
            _STEP,
            self._session,
            self._sequence,
            0 if begins else self._acted,
            self._digest,
            0 if begins or not self._followed else self._periods(),
            bits | begins | self._hold | self._again | self._place | self._explain,
            self._n,
            0,
            age,
            dt,
        )
        service, answer, until = self._service, self._next, start + self.timeout
        if self._in_c is not None:
            told = self._in_c(service.number, answer.address, until)
            if told > 0 and told & 1:
                self._head = head = ANSWER_HEAD.unpack_from(answer.view)
                answer.knots = head[13]
                return True
            sent = service.sent(self._sequence, told >> 1)
        else:
            sent = service.send(self._request, self._sequence)
        length = service.receive(answer.view, until) if sent else service.lose()
        if not length:
            self._why = service.why
            return False
        self._head = _, _, kind, _, _, _, _, status, *_, knots, _ = ANSWER_HEAD.unpack_from(
            answer.view
        )
        if kind != _TOLD or length != len(answer.view):
            self._not_done(kind, bytes(answer.view[ANSWER_HEAD.size : length]))
            return False
        if wrong := answer.wrong(status, knots):
            service.refused += 1
            self._why = f"service: an answer {wrong}"
            return False
        return True

    def _not_done(self, kind: int, text: bytes) -> None:
        """Note why the service did not carry out a request."""
        self._service.refused += 1
        if kind == _TOLD:
            self._why = "service: an answer of another length"
            return
        self._why = "service: " + text.rstrip(b"\0").decode(errors="replace")
        if kind == Tell.unknown:
            self._forget()
            self._why += f": {_ASK}"

    def _continue_from(self, relay: RelayLink, start: float) -> bool:
        """Ask the relay what it executes, and continue from that; return whether it said so."""
        if not relay.ask(start + self.timeout):
            self._why = relay.stream.why
            return False
        executed, pending = (relay.session, relay.sequence), self._pending
        self._pending = None
        if pending is not None and executed == pending[:2]:
            # It did get the last answer.
            self._adopt(*pending)
            self._followed = float(relay.begun)
        elif self._session and executed != (self._session, self._acted):
            self._forget()
            self._why = f"relay: it does not execute what was sent to it: {_ASK}"
        elif self._session:
            # The next line begins where the last of these periods ends.
            self._followed = float(relay.begun)
        return True

    def _hand_over(self, relay: RelayLink, start: float, period: float) -> bool:
        """Give the answer that was received to the relay; return whether it is executed."""
        base, continued, moves = Base.continues, (self._acted, self._periods()), self._plan.twist
        if not self._session:
            continued, base = (0, 0), Base.rest
            if self._begin == _TAKES_OVER:
                base = Base.motion
                moves = self._plan.at(self._followed * self._dt_of_answer)
        executed = self._head[3], self._sequence
        # Until it answers, nobody knows whether it executes this.
        self._pending = (*executed, period)
        until = start + self.timeout
        kind = relay.execute(self._next, executed, base, continued, moves, period, until)
        if kind:
            self._pending = None
        if kind != RelayTell.accepted:
            self._why = relay.stream.why
        return kind == RelayTell.accepted

    def _read_description(self) -> dict[str, Any]:
        """Return what the service says about the loop."""
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
                connection.settimeout(_CONNECTING)
                connection.connect(self._service.path)
                connection.sendall(HEAD.pack(HEAD.size, VERSION, Ask.describe, 0, 1))
                frame = b""
                while len(frame) < HEAD.size or len(frame) < HEAD.unpack_from(frame)[0] <= LONGEST:
                    if not (more := connection.recv(65536)):
                        break
                    frame += more
        except OSError:
            raise ServiceError(
                f"service: nobody answers at {self._service.path!r}; start `ergoqp serve`"
            ) from None
        kind = HEAD.unpack_from(frame)[2] if len(frame) > ANSWER_HEAD.size else 0
        text = frame[ANSWER_HEAD.size :].rstrip(b"\0").decode(errors="replace")
        if kind != Tell.described:
            raise ServiceError(
                f"service: {self._service.path!r} did not describe its loop: {text or 'no'}"
            )
        return json.loads(text)


def _path_of(address: str | Path) -> Path:
    """Return the path of a socket; a bare name is in the service's usual folder."""
    path = Path(address)
    if path.suffix != ".sock" and len(path.parts) == 1:
        return socket_path(default_folder(), str(address))
    return path


def _put(target: np.ndarray, value: Any, shape: tuple[int, ...]) -> None:
    """Write an argument into the request; NaN, which the step names, for what is none."""
    if type(value) is not np.ndarray:
        try:
            value = np.asarray(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            value = np.empty(0)
    if value.shape == shape and value.dtype.kind in "biuf":
        target[:] = value if len(shape) == 1 else value.ravel()
    else:
        target[:] = np.nan


def _number(value: Any) -> float:
    """Return a number; NaN, which the step detects, for anything else."""
    try:
        return value if type(value) is float else float(value)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def _is_one(value: Any) -> bool:
    """Return whether a flag is 1; any other value enables nothing."""
    return isinstance(value, (int, float, np.bool_)) and value == 1


__all__ = ["Client", "ClientStep", "ServiceError"]
