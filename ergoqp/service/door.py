"""What the service answers to a line of JSON: one line in, one line out, whatever carries them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.service.command import Command, Ended, Refused
from ergoqp.service.lines import (
    LineError,
    flag,
    id_of,
    number,
    numbers,
    pose,
    posture,
    read_line,
    table,
    text,
    write_line,
)
from ergoqp.service.links import Link
from ergoqp.service.loads import LONGEST_PROBLEM
from ergoqp.sheets import reba
from ergoqp.step.formulate import formulate

VERBS: Final = ("step", "score", "describe", "health", "formulate", "load")

_FORMULATE: Final = ("loop", "posture", "pose", "twist", "dt", "age", "enable", "state")


def _verb(request: Mapping[str, Any]) -> tuple[str, Any]:
    """Return what a request asks for, and what it says."""
    asked = [key for key in request if key != "id"]
    if len(asked) != 1 or asked[0] not in VERBS:
        got = ", ".join(shown(key) for key in asked[:4]) or "none"
        raise LineError(f"line: got {got}, allowed exactly one of {', '.join(VERBS)}")
    return asked[0], request[asked[0]]


def _number(what: str, value: Any) -> float:
    return number(what, value, "")


def _flags(what: str, value: Any) -> tuple[bool, bool]:
    if not isinstance(value, list) or len(value) != 2:
        raise LineError(f"{what}: got {shown(value)}, allowed [right, left], each true or false")
    return flag(what, value[0]), flag(what, value[1])


_OPTIONS: Final[dict[str, Callable[[str, Any], Any]]] = {
    "load_kg": _number,
    "shock": flag,
    "coupling": _number,
    "activity": _number,
    "seated": flag,
    "one_leg": flag,
    "arm_supported": _flags,
    "shoulder_raised": _flags,
}
"""Options of the sheet, each with its reader."""

_ONE_FORMULATES: Final = threading.Lock()
"""What formulates keeps its arrays for the next call."""

_MOST_POSTURES: Final = 100
_LONGEST_NAME: Final = 100


class Loops(Protocol):
    """The loops behind a door."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the loops."""
        ...

    def link(self, loop: str) -> Link:
        """Return a new way to a loop.

        Raises:
            LinkError: if it gives no answer.
        """
        ...

    def problem(self, loop: str) -> Problem:
        """Return the problem of a loop."""
        ...

    def load(self, name: str, problem: str) -> None:
        """Serve the problem of a text.

        Raises:
            ErgoqpError: if it cannot be served.
        """
        ...

    def commander(self, loop: str, words: str) -> str:
        """Return the words of a refusal, with the commander by a name that the user knows."""
        ...


class Answer:
    """What is answered to a line.

    Attributes:
        line: the answer, with its line end.
        bad: whether the line was no request.
    """

    def __init__(self, told: Mapping[str, Any], bad: bool = False) -> None:
        """Write the line."""
        self.line, self.bad = write_line(told), bad


class Handler:
    """The answers to the lines of one connection, which commands one loop at most."""

    def __init__(self, loops: Loops, clock: Callable[[], float] | None) -> None:
        """Begin a connection.

        Args:
            loops: the loops.
            clock: gives the time [s]. None: steps may come at any time.
        """
        self._loops, self._clock = loops, clock
        self._command: Command | None = None

    @property
    def commands(self) -> str | None:
        """Name of the loop that takes this connection's steps; None: no loop does."""
        return self._command.loop if self._command is not None and self._command.begun else None

    def answer(self, line: bytes) -> Answer:
        """Return the answer to a line. It never raises."""
        told: dict[str, Any] = {}
        try:
            request = read_line(line)
            told = id_of(request)
            verb, said = _verb(request)
            return Answer(told | getattr(self, f"_{verb}")(said))
        except LineError as error:
            return Answer(told | {"error": str(error)}, bad=True)
        except ErgoqpError as error:
            words = str(error).replace(":\n  ", ": ").replace("\n  ", "; ")  # a list of mistakes
            return Answer(told | {"error": words})
        except Exception as error:  # a fault of the service must not end the connection's loop
            kind = type(error).__name__
            return Answer(told | {"error": f"internal fault, {kind}: {error}; please report it"})

    def close(self) -> None:
        """Give the loop free."""
        if self._command is not None:
            self._command.close()
        self._command = None

    def _step(self, said: Any) -> dict[str, Any]:
        loop = self._loop("step", said)
        if self._command is None:
            self._command = self._new_command(loop)
        elif self._command.loop != loop:
            raise Refused(
                f"step: got loop {loop}, but this connection commands {self._command.loop}; open"
                " another one"
            )
        try:
            return self._command.step(said)
        except Ended as error:
            self._command = None
            raise Refused(self._loops.commander(loop, str(error))) from None

    def _new_command(self, loop: str) -> Command:
        link = self._loops.link(loop)
        description = link.describe()
        link.close()
        return Command(loop, lambda: self._loops.link(loop), description, self._clock)

    def _describe(self, said: Any) -> dict[str, Any]:
        table("describe", said, ("loop",))
        told = self._asked(self._loop("describe", said))
        del told["health"]
        return told | {"loops": list(self._loops.names)}

    def _health(self, said: Any) -> dict[str, Any]:
        table("health", said, ("loop",))
        names = [self._loop("health", said)] if said else self._loops.names
        return {"health": {name: self._asked(name)["health"] for name in names}}

    def _score(self, said: Any) -> dict[str, Any]:
        table("score", said, ("postures", *_OPTIONS))
        rows = said.get("postures")
        if not isinstance(rows, list) or not 1 <= len(rows) <= _MOST_POSTURES:
            got = f"{len(rows)} entries" if isinstance(rows, list) else shown(rows)
            raise LineError(
                f"score.postures: got {got}, allowed a list of 1 to {_MOST_POSTURES} postures, each"
                f" of {len(JOINTS)} numbers"
            )
        options = {key: _OPTIONS[key](f"score.{key}", said[key]) for key in said if key in _OPTIONS}
        given = np.array(
            [posture(f"score.postures, number {i + 1}", row, JOINTS) for i, row in enumerate(rows)]
        )
        unseen = np.isnan(given)
        low, high = np.where(unseen, LOWER, given), np.where(unseen, UPPER, given)
        # Where a joint is not seen, the posture may be any of those between.
        likely = np.where(unseen, (LOWER + UPPER) / 2, given)
        found = reba.assess(likely, low=low, high=high, **options)
        finals: list[int | None] = found.final.tolist()
        for i in np.flatnonzero(unseen.any(axis=1)):
            finals[i] = None
        return {
            "final": finals,
            "final_low": found.final_low.tolist(),
            "final_high": found.final_high.tolist(),
            "reasons": [found.reasons(i) for i in range(len(rows))],
        }

    def _formulate(self, said: Any) -> dict[str, Any]:
        table("formulate", said, _FORMULATE)
        loop = self._loop("formulate", said)
        problem = self._loops.problem(loop)
        given: dict[str, Any] = {}
        found = state = None
        if said.get("posture") is not None:
            found = posture("formulate.posture", said["posture"], problem.coordinates)
            if (unseen := np.isnan(found)).any():
                found, given["observed"] = np.where(unseen, 0.0, found), ~unseen
        if said.get("pose") is not None:
            given["pose"] = pose("formulate.pose", said["pose"])
        if said.get("twist") is not None:
            given["twist"] = np.array(numbers("formulate.twist", said["twist"], 6, "6 numbers"))
        for name in ("dt", "age"):
            if name in said:
                given[name] = number(f"formulate.{name}", said[name], "s")
        if "enable" in said:
            given["enable"] = flag("formulate.enable", said["enable"])
        if said.get("state") is not None:
            state = np.array(numbers("formulate.state", said["state"], None, "a list of numbers"))
        with _ONE_FORMULATES:
            return formulate(problem, state, found, **given).as_dict()

    def _load(self, said: Any) -> dict[str, Any]:
        table("load", said, ("name", "problem"))
        name = text("load.name", said.get("name"), _LONGEST_NAME)
        self._loops.load(name, text("load.problem", said.get("problem"), LONGEST_PROBLEM))
        return {"loaded": name} | self._describe({"loop": name})

    def _asked(self, loop: str) -> dict[str, Any]:
        link = self._loops.link(loop)
        try:
            return link.describe()
        finally:
            link.close()

    def _loop(self, verb: str, said: Any) -> str:
        """Return the loop that a request is for."""
        names, loop = self._loops.names, said.get("loop") if isinstance(said, dict) else None
        if loop is None:
            if self._command is not None:
                return self._command.loop
            if len(names) == 1:
                return names[0]
            raise LineError(f'{verb}: got no "loop", allowed {", ".join(names)}')
        if loop not in names:
            raise LineError(f"{verb}.loop: got {shown(loop)}, allowed {', '.join(names)}")
        return loop
