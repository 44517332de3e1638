"""The problems that the service was started with, ready to be forked into workers."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ergoqp._version import __version__
from ergoqp.arguments import shown
from ergoqp.errors import InputError, ProblemError
from ergoqp.files.read import toml_of, toml_text
from ergoqp.problem.load import find_problem, problem_from_dict
from ergoqp.problem.problem import Problem
from ergoqp.service.loop import Loop
from ergoqp.service.reasons import reason_table
from ergoqp.service.schema import ENGINES, SPOKEN, VERSION
from ergoqp.step.stepper import Stepper

_NAMES: Final = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-"
_LONGEST_NAME: Final = 64

JSON_DOOR: Final = "json"
"""Name of the socket for lines of JSON, which no loop can have."""


@dataclass
class Served:
    """A problem, its loops, and the stepper that they start from.

    Attributes:
        name: name of the problem, also that of its loop; several loops are NAME.0, NAME.1, ...
        text: the problem file.
        folder: folder that its paths are relative to; None: it names models alone.
        problem: the problem.
        count: number of loops.
        guide: a place for the object, as for `Stepper`.
        engine: place in `ENGINES` of how its steps are computed.
    """

    name: str
    text: str
    folder: Path | None
    problem: Problem
    count: int = 1
    guide: Any = None
    engine: int = 0
    _stepper: Stepper | None = field(default=None, repr=False)

    @property
    def digest(self) -> int:
        """Number that stands for this problem, period and version of the package; never 0."""
        told = f"{__version__}\0{self.problem.dt!r}\0{self.guide is not None}\0{self.text}"
        return int.from_bytes(hashlib.sha256(told.encode()).digest()[:7], "little") + 1

    @property
    def loop_names(self) -> list[str]:
        """Names of the loops."""
        if self.count == 1:
            return [self.name]
        return [f"{self.name}.{number}" for number in range(self.count)]

    def prepare(self, compiled: bool) -> None:
        """Build the step, as far as it is not built."""
        if self._stepper is None or compiled != bool(self.engine):
            self._stepper = Stepper(self.problem, compiled=compiled, guide=self.guide)
            self.engine = int(compiled)
            self._stepper.warm_up()

    def loops(self) -> dict[str, Loop]:
        """Return the loops of a worker by name; they share the memory of one stepper."""
        self.prepare(bool(self.engine))
        assert self._stepper is not None
        return {
            name: Loop(name, self._stepper.sibling(), self.engine, self.digest)
            for name in self.loop_names
        }

    def description(self, loop: str, recorded: bool = False) -> str:
        """Return what a client has to know about a loop, an object of JSON."""
        problem = self.problem
        units = [limit.unit for limit in problem.row_limits for _ in limit.names]
        told = {
            "loop": loop,
            "problem": problem.name,
            "title": problem.title,
            "digest": self.digest,
            "version": __version__,
            "frames": VERSION,
            "spoken": list(SPOKEN),
            "engine": ENGINES[self.engine],
            "dt": problem.dt,
            "longest_dt": problem.longest_period,
            "guided": self.guide is not None,
            "coordinates": list(problem.coordinates),
            "rows": list(problem.row_names),
            "units": units,
            "speed": problem.twist_limit.speed.tolist(),
            "acceleration": problem.twist_limit.acceleration.tolist(),
            "recorded": recorded,
            "reasons": reason_table(problem.row_names),
        }
        return json.dumps(told)


def served(name: str, dt: float | None = None, count: int = 1, guide: Any = None) -> Served:
    """Return the problem of a name or path, as the service keeps it.

    Raises:
        ProblemError: if there is no such problem, it has mistakes, or its name is none for a file.
    """
    path = find_problem(name)
    try:
        text = toml_text(path, "problem")
    except InputError as error:
        raise ProblemError(str(error)) from None
    return served_text(text, path.stem, path.parent, dt, count, guide)


def check_name(name: str) -> None:
    """Check the name of a problem, which names sockets too.

    Raises:
        ProblemError: if it is none for a file, or that of the socket for lines of JSON.
    """
    if not name or set(name) - set(_NAMES) or len(name) > _LONGEST_NAME:
        raise ProblemError(
            f"problem: got the name {shown(name)}, allowed 1 to {_LONGEST_NAME} letters, digits, -"
            " and _"
        )
    if name == JSON_DOOR:
        raise ProblemError(f"problem: got the name {name!r}, allowed another one")


def served_text(
    text: str,
    name: str,
    folder: Path | None = None,
    dt: float | None = None,
    count: int = 1,
    guide: Any = None,
) -> Served:
    """Return the problem that the text of a problem file describes.

    Raises:
        ProblemError: if it has mistakes, or `name` is none for a file.
    """
    check_name(name)
    try:
        raw = toml_of(text, name)
    except InputError as error:
        raise ProblemError(str(error)) from None
    problem = problem_from_dict(raw, name, folder)
    if dt is not None:
        try:
            problem = problem.replace(dt=dt)
        except InputError as error:
            raise ProblemError(f"{name}: {error}") from None
    return Served(name, text, folder, problem, count, guide)
