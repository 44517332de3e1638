"""The service on standard input and output: lines of JSON, one process, no socket."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from typing import BinaryIO, Final

from ergoqp.problem.problem import Problem
from ergoqp.service.command import Refused
from ergoqp.service.door import Handler
from ergoqp.service.lines import LONGEST_LINE
from ergoqp.service.links import DirectLink, Link
from ergoqp.service.loads import MOST_LOADED, Text, own_terms
from ergoqp.service.loop import Loop
from ergoqp.service.served import Served

_MORE: Final = 65_536


class OwnLoops:
    """The loops of this process."""

    def __init__(self, problems: Sequence[Served]) -> None:
        """Build the loops."""
        self._own = own_terms(problems)
        self._served: dict[str, Served] = {}
        self._loops: dict[str, Loop] = {}
        self._links: dict[str, DirectLink] = {}
        self._loaded: set[str] = set()
        for each in problems:
            self._add(each)

    @property
    def names(self) -> list[str]:
        """Names of the loops."""
        return list(self._loops)

    def link(self, loop: str) -> Link:
        """Return a way to a loop."""
        return self._links[loop]

    def problem(self, loop: str) -> Problem:
        """Return the problem of a loop."""
        return self._served[loop].problem

    def load(self, name: str, problem: str) -> None:
        """Serve the problem of a text.

        Raises:
            ProblemError: if it has mistakes.
            Refused: if the loop that it would replace is in use, or there are too many.
        """
        if name in self._loops and (self._loops[name].session or self._loops[name].moved):
            raise Refused(f"loop {name}: commanded by this connection; nothing was replaced")
        if len(self._loaded | {name}) > MOST_LOADED:
            raise Refused(f"load: {MOST_LOADED} problems are loaded already, allowed {MOST_LOADED}")
        self._add(Text(name, problem, self._own).load())
        self._loaded.add(name)

    def commander(self, loop: str, words: str) -> str:
        """Return the words of a refusal."""
        return words

    def _add(self, served: Served) -> None:
        loops = served.loops()
        self._loops |= loops
        self._served |= dict.fromkeys(loops, served)
        self._links |= {
            name: DirectLink(loop, served.description(name)) for name, loop in loops.items()
        }


def serve_stdio(problems: Sequence[Served]) -> None:
    """Answer the lines of standard input until it ends.

    Whatever else would be written to standard output, by any library, goes to standard error.

    Raises:
        BrokenPipeError: if nobody reads the answers any more.
    """
    sys.stdout.flush()
    with os.fdopen(os.dup(1), "wb") as told:
        os.dup2(2, 1)
        # A file of requests may be piped, so the time between them says nothing.
        handler = Handler(OwnLoops(problems), clock=None)
        for line in lines_of(sys.stdin.buffer):
            told.write(handler.answer(line).line)
            told.flush()


def lines_of(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of a stream without their ends; of one that is too long its beginning."""
    while line := stream.readline(LONGEST_LINE + 2):
        yield line.rstrip(b"\r\n")
        while not line.endswith(b"\n") and (line := stream.readline(_MORE)):
            pass
