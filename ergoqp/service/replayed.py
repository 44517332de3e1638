"""Compute the steps of a record again, and compare them with what the service answered."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import ErgoqpError, RecordingError
from ergoqp.native.compiled import CompilerError
from ergoqp.problem.problem import Problem
from ergoqp.service.loop import Loop, Request
from ergoqp.service.record import Record, Recorded, has_compiler, machine, versions
from ergoqp.service.schema import (
    ANSWER_HEAD,
    ENGINES,
    HEAD,
    REQUEST_HEAD,
    Flag,
    Frame,
    Mark,
    Tell,
    answer_frame,
)
from ergoqp.service.served import Served, served_text
from ergoqp.step.guide import Guide
from ergoqp.step.rest import FIRM, UNKNOWN
from ergoqp.step.stepper import Stepper

TOLERANCE: Final = 1e-9
"""Largest difference on another machine or version, of numbers up to 1, else relative."""

STATE: Final = "state before"
"""Stands for the recorded state among the fields that differ."""

_OF_THE_MOMENT: Final = ("computed", "text")
"""Fields of an answer that are not computed from the request: the duration, and older words."""

_OF_KNOTS: Final = {"times": 8, "stop": 48}
"""Fields of which an answer has as many parts as it has knots, and the bytes of a part."""

_ELSEWHERE: Final = (
    "status",
    "causes",
    "knots",
    "twist",
    "pose",
    "posture_rate",
    "cost",
    "margins",
    "times",
    "stop",
)
"""Fields that are compared on another machine or version."""

_BEGINS: Final = int(Flag.stands | Flag.takes_over)


@dataclass(frozen=True)
class Difference:
    """A step that is not what the service answered.

    Attributes:
        loop: name of the loop.
        number: its place among the answers of its worker.
        time_ns: when it was answered, since 1970 [ns].
        fields: fields of the answer that differ; ``state before`` stands for the recorded state.
        recorded: the twist that was sent (6,) [m/s, rad/s]; None if that answer was no step.
        computed: the twist that is computed now, likewise.
    """

    loop: str
    number: int
    time_ns: int
    fields: tuple[str, ...]
    recorded: np.ndarray | None
    computed: np.ndarray | None


@dataclass
class ReplayedLoop:
    """Outcome for one loop.

    Attributes:
        steps: answers in the record.
        equal: those that were computed again and are the same.
        wrong: those that were computed again and differ.
        not_computed: those whose state before is not known, because steps before are missing.
        missing: steps that are missing in the record.
        counted: those that the recording itself has counted as missing.
        first: the first difference; None if there is none.
    """

    steps: int = 0
    equal: int = 0
    wrong: int = 0
    not_computed: int = 0
    missing: int = 0
    counted: int = 0
    first: Difference | None = None


@dataclass
class Replayed:
    """Outcome of a replay.

    Attributes:
        loops: outcome by name of the loop.
        exact: whether the answers were compared bit for bit, and not within `TOLERANCE`.
        notes: what else is to be known, one sentence each.

    Example:
        >>> from ergoqp.service.replayed import Replayed
        >>> Replayed().steps  # those of a record: replay_record(path).steps
        0
    """

    loops: dict[str, ReplayedLoop] = field(default_factory=dict)
    exact: bool = True
    notes: list[str] = field(default_factory=list)

    @property
    def steps(self) -> int:
        """Number of answers in the record."""
        return sum(each.steps for each in self.loops.values())

    @property
    def equal(self) -> int:
        """Number of those that are the same."""
        return sum(each.equal for each in self.loops.values())

    @property
    def wrong(self) -> int:
        """Number of those that differ."""
        return sum(each.wrong for each in self.loops.values())

    @property
    def first(self) -> Difference | None:
        """The first answer that differs; None if none does."""
        found = [each.first for each in self.loops.values() if each.first is not None]
        return min(found, key=lambda each: each.time_ns, default=None)


def replay_record(path: str | Path) -> Replayed:
    """Compute every step of a record again, as the service did, and compare the answers.

    The problem comes from the record. On the machine and with the versions of the record the
    answers have to be the same, bit for bit; elsewhere within `TOLERANCE`. Where steps are missing
    it continues at the next recorded state.

    Args:
        path: a file of ``ergoqp serve --record``.

    Raises:
        RecordingError: if it is no record, holds no step, or none can be computed.
        ProblemError: if its problem cannot be loaded.
        MissingExtraError: if the package for records is not installed.

    Example:
        >>> from ergoqp.errors import RecordingError
        >>> from ergoqp.service.replayed import replay_record
        >>> try:
        ...     replay_record("nowhere.mcap")
        ... except RecordingError as error:
        ...     print(error)
        nowhere.mcap: cannot be read (No such file or directory)
    """
    record, replayed = Record(Path(path)), Replayed()
    replays: dict[str, _Replay] = {}
    for step in record.messages():
        replay = replays.get(step.loop)
        if replay is None:
            told = record.loops.get(step.loop)
            if told is None:
                raise RecordingError(f"{record.path.name}: says nothing about loop {step.loop}")
            replay = replays[step.loop] = _Replay(step.loop, told, replayed, record.path.name)
        replay.take(step)
    for name, counts in record.counts.items():
        if name in replayed.loops:
            replayed.loops[name].counted = sum(counts.get(k, 0) for k in ("lost", "dropped"))
    if record.cut_off:
        replayed.notes.append("The file was cut off; it is read up to there.")
    if damaged := record.unreadable - record.cut_off:
        replayed.notes.append(f"{damaged} damaged parts of the file are left out.")
    if not replayed.steps:
        raise RecordingError(f"{record.path.name}: holds no step")
    if not replayed.equal + replayed.wrong:
        raise RecordingError(
            f"{record.path.name}: no state is recorded from which a step could be computed"
        )
    return replayed


def record_wrong(*paths: str | Path) -> int:
    """Return how many steps of a recording differ when they are computed again.

    Args:
        paths: its files.

    Raises:
        ErgoqpError: as for `replay_record`.
    """
    return sum(replay_record(path).wrong for path in paths)


class _Replay:
    """One loop that is computed again, step by step."""

    def __init__(self, name: str, told: dict[str, str], replayed: Replayed, where: str) -> None:
        self.outcome = replayed.loops.setdefault(name, ReplayedLoop())
        self._told, self._replayed, self._where = told, replayed, where
        self._served = self._load(name)
        self._steppers: dict[int, Stepper] = {}
        self._worker, self._end, self._known = 0, 0, False
        self._kept: set[int] = set()
        self._engine = 0
        self._loop: Loop | None = None
        self._request: Request | None = None
        self._frame: Frame | None = None

    def _load(self, name: str) -> Served:
        """Return the problem of the record; note where the last bits may differ."""
        told = self._told
        try:
            guide = None
            if told["guide"]:
                place = json.loads(told["guide"])
                expected = float(place["expected"])
                firm = expected == FIRM
                promise = None if firm or expected == UNKNOWN else expected
                guide = Guide(np.array(place["pose"]), promise, firm)
            folder, dt = Path(told["folder"]) if told["folder"] else None, float(told["dt"])
            served = served_text(told["text"], told["problem"], folder, dt, guide=guide)
            if told["ergoqp"] == versions()["ergoqp"] and int(told["digest"]) != served.digest:
                raise RecordingError(
                    f"{self._where}: the problem of loop {name} is not the one that was served"
                )
            here = {"machine": machine(), "compiler": has_compiler(), **versions()}
            other = {each: (told[each], now) for each, now in here.items() if told[each] != now}
        except (KeyError, ValueError, TypeError) as error:
            if isinstance(error, ErgoqpError):
                raise
            raise RecordingError(
                f"{self._where}: what it says about loop {name} cannot be used ({error})"
            ) from None
        for what, (then, now) in other.items():
            self._note(f"Recorded with {what} {then}, computed with {now}.")
        return served

    def _note(self, words: str) -> None:
        """Say why the answers are not compared bit for bit."""
        self._replayed.exact = False
        if words not in self._replayed.notes:
            self._replayed.notes.append(words)

    def take(self, step: Recorded) -> None:
        """Compute a step again, if what was before it is known."""
        outcome, head = self.outcome, ANSWER_HEAD.unpack_from(step.answer)
        kind, session, sequence, engine, marks = head[2], head[3], head[4], head[5], head[10]
        if step.worker != self._worker:
            outcome.missing += step.number if self._worker else 0
            self._begin(engine if kind == Tell.step else ENGINES.index(self._told["engine"]))
            self._worker, self._end, self._known = step.worker, step.number, step.number == 0
        if kind == Tell.step and engine != self._engine:
            self._begin(engine)  # before its first step a worker does not tell
        missing, self._end = step.number - self._end, step.number + 1
        outcome.missing += missing
        outcome.steps += 1
        self._known = self._known and not missing
        loop, request, begun = self._loop, self._request, bool(marks & Mark.begun)
        masked = int(Mark.unrecorded)
        assert loop is not None
        assert request is not None
        if len(step.request) != request.length:
            raise RecordingError(f"{self._where}: the requests of loop {step.loop} do not fit it")
        request.buffer[:] = step.request
        acted = REQUEST_HEAD.unpack_from(step.request)[5]
        if kind == Tell.step and not (self._known and (begun or acted in self._kept)):
            if step.state is None:
                self._known = False
            else:
                plain = not marks & (Mark.begun | Mark.undone)
                self._resume(loop, request.buffer, step, session, acted if plain else 0)
                masked |= Mark.begun | Mark.undone
                self._kept = {acted} if plain else set()
                self._known, begun = True, False
        if not self._known:
            outcome.not_computed += 1
            return
        computed = bytes(loop.answer(request))
        differs = self._compare(step.answer, computed, masked, begun)
        if kind == Tell.step:
            if step.state is not None and not self._same_state(loop.before, step.state):
                differs = (*differs, STATE)
            loop.session = session
            self._kept = ({acted} & self._kept if not begun else set()) | {sequence}
        if not differs:
            outcome.equal += 1
            return
        outcome.wrong += 1
        if outcome.first is None:
            outcome.first = Difference(
                step.loop,
                step.number,
                step.time_ns,
                differs,
                self._twist(step.answer),
                self._twist(computed),
            )

    def _begin(self, engine: int) -> None:
        """Begin with a loop as a worker does."""
        if engine not in self._steppers:
            problem, guide = self._served.problem, self._served.guide
            self._steppers[engine] = self._stepper(problem, guide, engine)
        stepper, self._engine = self._steppers[engine].sibling(), engine
        self._loop = Loop(self._told["loop"], stepper, engine, int(self._told["digest"]))
        self._request = self._loop.new_request()
        self._frame = answer_frame(self._loop.coordinates, self._loop.rows)
        self._kept = set()

    def _stepper(self, problem: Problem, guide: Guide | None, engine: int) -> Stepper:
        try:
            stepper = Stepper(problem, compiled=bool(engine), guide=guide)
        except CompilerError as error:
            self._note(f"Recorded with the compiled step, computed interpreted: {error}.")
            stepper = Stepper(problem, compiled=False, guide=guide)
        stepper.warm_up()
        return stepper

    def _resume(
        self, loop: Loop, buffer: bytearray, step: Recorded, session: int, acted: int
    ) -> None:
        """Set the state before a step, and a request that continues from there."""
        assert step.state is not None
        try:
            loop.resume(session, acted, step.state, step.guide)
        except ErgoqpError as error:
            raise RecordingError(f"{self._where}: a state of loop {step.loop}: {error}") from None
        head = list(REQUEST_HEAD.unpack_from(buffer))
        head[3], head[5], head[7], head[8] = session, acted, 0, head[8] & ~_BEGINS
        REQUEST_HEAD.pack_into(buffer, 0, *head)

    def _same_state(self, ours: np.ndarray | None, theirs: np.ndarray) -> bool:
        if ours is None or ours.shape != theirs.shape:
            return False
        if self._replayed.exact:
            return ours.tobytes() == theirs.tobytes()
        return _near(ours, theirs)

    def _compare(
        self, recorded: bytes, computed: bytes, masked: int, begun: bool
    ) -> tuple[str, ...]:
        """Return the fields of two answers that differ."""
        if len(recorded) != len(computed):
            return ("kind",)
        assert self._frame is not None
        if len(recorded) != self._frame.length:
            # What was refused has the session of the moment, which is not recorded before.
            session = self._frame.at["session"]
            same = recorded[: session.start] == computed[: session.start]
            same = same and recorded[session.stop :] == computed[session.stop :]
            return () if same else ("text",)
        exact, found = self._replayed.exact, []
        knots = ANSWER_HEAD.unpack_from(recorded)[-2]
        for each in self._frame.fields:
            at = self._frame.at[each.name]
            if each.name in _OF_KNOTS:  # what follows the last knot is of older answers
                at = slice(at.start, at.start + knots * _OF_KNOTS[each.name])
            ours, theirs = computed[at], recorded[at]
            if ours == theirs or each.name in _OF_THE_MOMENT:
                continue
            if each.name == "marks":
                changed = int.from_bytes(ours, "little") ^ int.from_bytes(theirs, "little")
                if not changed & ~masked:
                    continue
            if each.name == "session" and begun:
                continue  # it is drawn
            if not exact and (each.name not in _ELSEWHERE or self._close(each.kind, ours, theirs)):
                continue
            found.append(each.name)
        return tuple(found)

    @staticmethod
    def _close(kind: str, ours: bytes, theirs: bytes) -> bool:
        return kind == "f64" and _near(np.frombuffer(ours), np.frombuffer(theirs))

    def _twist(self, answer: bytes) -> np.ndarray | None:
        if HEAD.unpack_from(answer)[2] != Tell.step or self._frame is None:
            return None
        return self._frame.numbers(answer, "twist")


def _near(ours: np.ndarray, theirs: np.ndarray) -> bool:
    return bool(np.allclose(ours, theirs, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True))
