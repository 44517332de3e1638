"""A client of the service in Python: the calls of `Stepper`, and a stop that needs no service."""

from __future__ import annotations

import json
import os
import select
import socket
import struct
import time
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import check_number, read_array
from ergoqp.errors import ErgoqpError, InputError
from ergoqp.service.folder import default_folder, socket_path
from ergoqp.service.schema import (
    ANSWER_HEAD,
    HEAD,
    KNOTS,
    LONGEST,
    REQUEST_HEAD,
    VERSION,
    Ask,
    Flag,
    Frame,
    Tell,
    answer_frame,
    request_frame,
)

# Plain numbers, because those of an enumeration cost ten times as much to compare.
_FRAME, _POSE, _TWIST, _OBSERVED, _ENABLE, _TRY_AGAIN, _TAKES_OVER = (
    int(Flag[name])
    for name in ("frame", "pose", "twist", "observed", "enable", "try_again", "takes_over")
)
_STEP, _TOLD, _QUIET = int(Ask.step), int(Tell.step), int(socket.MSG_NOSIGNAL)
_REST: Final = struct.Struct("<HHIIIIIIId")
"""The head of an answer behind that of all frames."""
_STATUSES: Final = ("optimal", "settled", "relaxed", "recovering", "braking", "invalid")
_CONNECTING: Final = 5.0
"""How long the first connection and the description may take [s]."""
_HUGE: Final = 1e12
_SELECTED: Final = 1024
"""Descriptors from this number on cannot be given to `select.select`."""
_ASK: Final = "call reset() once it stands, or reset(twist=) with its measured twist"


class ServiceError(ErgoqpError):
    """There is no service at an address, or it refused the description of the loop.

    Example:
        >>> from ergoqp.errors import ErgoqpError
        >>> issubclass(ServiceError, ErgoqpError)
        True
    """


class Answer:
    """Memory for one answer, and views of its numbers.

    Attributes:
        layout: where its fields are.
        view: all its bytes.
        twist: the twist (6,); times: of the knots [s]; stop: their twists (k, 6).
    """

    def __init__(self, layout: Frame) -> None:
        """Allocate it, with zeros."""
        buffer = bytearray(layout.length)
        self.layout, self.view = layout, memoryview(buffer)
        self.twist = layout.numbers(buffer, "twist")
        self.times = layout.numbers(buffer, "times")
        self.stop = layout.numbers(buffer, "stop").reshape(KNOTS, 6)
        self._sent = layout.numbers(buffer, "twist", "posture_rate")
        self._knots = layout.numbers(buffer, "times", "stop")

    @property
    def usable(self) -> bool:
        """Whether what a robot and a person execute are finite numbers."""
        # A product with itself is infinite or NaN if any number is.
        sent, knots = self._sent, self._knots
        return bool(sent.dot(sent) < _HUGE and knots.dot(knots) < _HUGE)


class ClientStep:
    """The answer of one step, with the members of `ergoqp.Step`.

    Attributes:
        twist: twist to send (6,) [m/s, rad/s].
        status: as of `ergoqp.Step`. An answer that did not come in time gives ``braking``.
        reason: one sentence; empty for a plain optimal step.
        fresh: whether the service answered in time. Otherwise the twist is the next one of the
            stop that came with the last answer.
        solve_time: duration of the call [s].
        computed: time that the step took in the service [s]; 0 if it is not fresh.
    """

    def __init__(
        self,
        twist: np.ndarray,
        status: str,
        reason: str,
        fresh: bool,
        start: float,
        answer: Answer,
        names: Mapping[str, tuple[str, ...]],
        computed: float = 0.0,
        drawn: int = 0,
    ) -> None:
        """Keep the bytes of the last answer; members are read from them on demand."""
        self.twist, self.status, self.reason, self.fresh = twist, status, reason, fresh
        self.computed, self.drawn = computed, drawn
        self._frame, self._layout, self._names = bytes(answer.view), answer.layout, names
        self.solve_time = time.perf_counter() - start

    def __repr__(self) -> str:
        """Show twist, status and reason."""
        twist = np.array2string(self.twist, precision=4, suppress_small=True)
        return f"ClientStep(twist={twist}, status={self.status!r}, reason={self.reason!r})"

    def _value(self, name: str) -> np.ndarray:
        return self._layout.numbers(self._frame, name).copy()

    @property
    def pose(self) -> np.ndarray:
        """Contact frame in the world that the last answered step used (4, 4) [m]."""
        return self._value("pose").reshape(4, 4)

    @property
    def posture_rate(self) -> np.ndarray:
        """How the model person follows [rad/s]; zero if the step is not fresh."""
        rate = self._value("posture_rate")
        return rate if self.fresh else np.zeros_like(rate)

    @property
    def cost(self) -> float:
        """V of the posture, at the last answer [points]."""
        return float(self._value("cost")[0])

    @property
    def gain(self) -> float:
        """Predicted improvement within one second at full speed, at the last answer [points]."""
        return float(self._value("gain")[0])

    @property
    def residuals(self) -> dict[str, float]:
        """Residuals by name, see `ergoqp.Step`."""
        return dict(
            zip(("qp", "contact", "accepted"), self._value("residuals").tolist(), strict=True)
        )

    @cached_property
    def margins(self) -> dict[str, float]:
        """Distance of every row to its nearer end, in the unit of the row."""
        return dict(zip(self._names["rows"], self._value("margins").tolist(), strict=True))

    @cached_property
    def slack(self) -> dict[str, float]:
        """By how much the QP missed a row, in its unit per second; only missed rows."""
        found = zip(self._names["rows"], self._value("slack").tolist(), strict=True)
        return {name: value for name, value in found if value > 1e-7}

    @cached_property
    def locked(self) -> tuple[str, ...]:
        """Joints at their end that the model person holds still."""
        held = np.flatnonzero(self._value("locked") > 0.5)
        return tuple(self._names["coordinates"][i] for i in held)

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold the object back, and of the joints that yield."""
        pushing = np.flatnonzero(np.abs(self._value("multipliers")) > 1e-6)
        rows = [self._names["rows"][i] for i in pushing]
        return (*rows, *(joint for joint in self.locked if joint not in rows))


class Client:
    """A loop of the service, with the calls of `ergoqp.Stepper`.

    Every answer comes with the stop that was certified with it. If the next answer is late, if the
    service ends, hangs or is started anew, `step` returns the next twist of that stop, and the
    service is told what the robot executed. No call raises because of the service once the client
    is made.

    The service never assumes that a robot stands. So begin with `reset`, and call it again when
    `waits` is true: the service does not know any more what the robot does.

    Args:
        address: name of the loop, such as ``"screwing"``, in the service's usual folder, or the
            path of its socket.
        dt: control period [s]. None: that of the loop.
        timeout: how long a call of `step` may wait for the answer [s]. None: half a period.
        explain: whether the service writes reasons in full, which takes it some 60 us for each new
            one. Otherwise `ClientStep.reason` is a sentence without numbers.

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
    ) -> None:
        """Connect, and read what the loop is."""
        path = Path(address)
        if path.suffix != ".sock" and len(path.parts) == 1:
            path = socket_path(default_folder(), str(address))
        self._path, self._socket = os.fspath(path), None
        self._outstanding, self._got = 0, 0
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
        layout = answer_frame(self._n, len(rows))
        # The answer that is executed, and the one that arrives; they change places.
        self._kept, self._next = Answer(layout), Answer(layout)
        self._length = layout.length
        self._session = self._sequence = self._acted = self._followed = self._knots = 0
        self._begin = self._hold = self._again = self._place = 0
        self._start_twist, self._dt_of_answer = np.zeros(6), self.dt
        self._called = -np.inf
        self._why = f"the service was not told yet what the robot does: {_ASK}"
        self.late = self.lost = self.refused = 0

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
        for number in range(self._followed + 1, self._followed + 100_000):
            twists.append(self._stop_twist(number * self._dt_of_answer))
            if not twists[-1].any():
                break
        return np.array(twists)

    def reset(self, twist: Any = None) -> None:
        """Report what the robot does, and begin anew with the next step.

        Args:
            twist: measured twist (6,) of a robot that moves [m/s, rad/s]. None: it stands.

        Raises:
            InputError: if `twist` is not six finite numbers.
        """
        if twist is None:
            self._begin = int(Flag.stands)
        else:
            self._start_twist[:] = read_array("twist", twist, (6,), "6 finite numbers")
            self._begin = _TAKES_OVER
        self._session = self._again = self._hold = 0

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
        """Give the loop free; the robot has to be at rest."""
        self._disconnect()

    def __enter__(self) -> Client:
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def _ask(self, start: float, bits: int, dt: float, age: float) -> ClientStep:
        """Exchange a request for an answer, or go on with the stop."""
        gap, self._called = start - self._called, start
        if gap > self._longest and self._session:
            self._session = self._begin = 0
            self._why = f"{gap:.2f} s passed between two calls: {_ASK}"
        # The usual case first: nothing is wrong.
        usual = self._session and self._socket is not None and not self._outstanding
        if not ((usual or self._ready()) and self._exchange(start, bits, dt, age)):
            self._followed += 1
            twist = self._stop_twist(self._followed * self._dt_of_answer)
            return ClientStep(twist, "braking", self._why, False, start, self._kept, self._names)
        kept = self._kept
        _, drawn, status, _, reason, _, _, _, knots, computed = _REST.unpack_from(
            kept.view, HEAD.size
        )
        self._knots = knots
        text = self._words(reason) if reason else ""
        return ClientStep(
            kept.twist.copy(),
            _STATUSES[status],
            text,
            True,
            start,
            kept,
            self._names,
            computed,
            drawn,
        )

    def _words(self, reason: int) -> str:
        """Return the reason of the answer in words."""
        if self._explain:
            place = self._kept.layout.at["text"]
            if text := bytes(self._kept.view[place]).rstrip(b"\0"):
                return text.decode(errors="replace")
        return self._reasons.get(reason, "")

    def _stop_twist(self, seconds: float) -> np.ndarray:
        """Return the twist of the stop at a time from the answer's own twist on."""
        times, stop = self._kept.times[: self._knots], self._kept.stop
        later = int(np.searchsorted(times, seconds * (1 - 1e-12)))
        if later == self._knots:
            return np.zeros(6)
        if times[later] <= seconds * (1 + 1e-12):
            return stop[later].copy()
        before, old = (times[later - 1], stop[later - 1]) if later else (0.0, self._kept.twist)
        return old + (stop[later] - old) * ((seconds - before) / (times[later] - before))

    def _ready(self) -> bool:
        """Connect, and drop an answer that came too late; return whether a request can be sent."""
        if not self._session and not self._begin:
            return False
        if self._socket is None and not self._connect():
            self.lost += 1
            self._why = f"service: nobody answers at {self._path!r}"
            return False
        if self._outstanding:
            self._receive(0.0)
            if self._outstanding:
                self.late += 1
                self._why = "service: no answer in time"
                return False
        return self._socket is not None

    def _exchange(self, start: float, bits: int, dt: float, age: float) -> bool:
        """Send a request; return whether its answer is a step that came in time."""
        self._sequence += 1
        begins = 0 if self._session else self._begin
        if begins == _TAKES_OVER:
            bits |= _TWIST
            self._given["twist"][:] = self._start_twist
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
            0 if begins else self._followed,
            bits | begins | self._hold | self._again | self._place | self._explain,
            self._n,
            0,
            age,
            dt,
        )
        connection = self._socket
        try:
            if connection is None or connection.send(self._request, _QUIET) != len(self._request):
                return self._lose()
        except OSError:
            return self._lose()
        self._outstanding, self._got = self._sequence, 0
        if not self._receive(start + self.timeout):
            if self._outstanding:
                self.late += 1
                self._why = "service: no answer in time"
            return False
        self._acted, self._followed, self._begin, self._dt_of_answer = self._sequence, 0, 0, dt
        if self._again:
            self._again = 0
        return True

    def _receive(self, until: float) -> bool:
        """Read the answer to the outstanding request.

        Args:
            until: when to give up. One that is read when this is over is dropped: it is late.

        Returns:
            Whether it is a step, which is executed from now on.
        """
        answer = self._next
        while True:
            left = until - time.perf_counter()
            if not self._arrives(left if left > 0.0 else 0.0):
                return False
            try:
                count = self._socket.recv_into(answer.view[self._got :]) if self._socket else 0
            except BlockingIOError:
                continue
            except OSError:
                count = 0
            if not count:
                return self._lose()
            self._got += count
            if self._got < HEAD.size:
                continue
            length, version, kind, session, sequence = HEAD.unpack_from(answer.view)
            if not ANSWER_HEAD.size <= length <= self._length or version != VERSION:
                self.refused += 1
                return self._lose()
            if self._got < length:
                continue
            if self._got > length or sequence != self._outstanding:
                self.refused += 1
                return self._lose()
            self._outstanding = self._got = 0
            if not until:
                return False
            if kind == _TOLD and length == self._length and answer.usable:
                self._session = session
                self._kept, self._next = answer, self._kept
                return True
            self._not_done(kind, bytes(answer.view[ANSWER_HEAD.size : length]))
            return False

    def _arrives(self, seconds: float) -> bool:
        """Wait for bytes, or the end of the connection."""
        if self._socket is None:
            return False
        number = self._socket.fileno()
        if number < _SELECTED:  # this waits to the microsecond, and the other to the millisecond
            return bool(select.select((number,), (), (), seconds)[0])
        poll = select.poll()
        poll.register(number, select.POLLIN)
        return bool(poll.poll(1e3 * seconds))

    def _not_done(self, kind: int, text: bytes) -> None:
        """Note why the service did not carry out a request."""
        self.refused += 1
        if kind == _TOLD:
            self._why = "service: the answer holds twists that are no numbers"
            return
        self._why = "service: " + text.rstrip(b"\0").decode(errors="replace")
        if kind == Tell.unknown:
            self._session, self._begin = 0, 0
            self._why += f": {_ASK}"

    def _lose(self) -> bool:
        """Close a connection that does not work any more; return False."""
        self.lost += 1
        self._why = "service: the connection was lost"
        self._disconnect()
        return False

    def _disconnect(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._outstanding, self._got = None, 0, 0

    def _connect(self) -> bool:
        """Connect without waiting; return whether it worked."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.setblocking(False)
        try:
            connection.connect(self._path)
        except OSError:
            connection.close()
            return False
        self._socket = connection
        return True

    def _read_description(self) -> dict[str, Any]:
        """Return what the service says about the loop."""
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
                connection.settimeout(_CONNECTING)
                connection.connect(self._path)
                connection.sendall(HEAD.pack(HEAD.size, VERSION, Ask.describe, 0, 1))
                frame = b""
                while len(frame) < HEAD.size or len(frame) < HEAD.unpack_from(frame)[0] <= LONGEST:
                    if not (more := connection.recv(65536)):
                        break
                    frame += more
        except OSError:
            raise ServiceError(
                f"service: nobody answers at {self._path!r}; start `ergoqp serve`"
            ) from None
        kind = HEAD.unpack_from(frame)[2] if len(frame) > ANSWER_HEAD.size else 0
        text = frame[ANSWER_HEAD.size :].rstrip(b"\0").decode(errors="replace")
        if kind != Tell.described:
            raise ServiceError(f"service: {self._path!r} did not describe its loop: {text or 'no'}")
        return json.loads(text)


def _put(target: np.ndarray, value: Any, shape: tuple[int, ...]) -> None:
    """Write an argument into the request; NaN, which the step names, for what is none."""
    if type(value) is not np.ndarray:
        try:
            value = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            value = np.empty(0)
    if value.shape == shape and value.dtype.kind in "biuf":
        target[:] = value if len(shape) == 1 else value.ravel()
    else:
        target[:] = np.nan


def _number(value: Any) -> float:
    """Return a number; NaN, which the step detects, for anything else."""
    try:
        return value if type(value) is float else float(value)
    except (TypeError, ValueError):
        return float("nan")


def _is_one(value: Any) -> bool:
    """Return whether a flag is 1; any other value enables nothing."""
    return isinstance(value, (int, float, np.bool_)) and value == 1


__all__ = ["Client", "ClientStep", "ServiceError"]
