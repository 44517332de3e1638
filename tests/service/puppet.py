"""The C client in a process of its own, driven from a test."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.native.compiled import program
from ergoqp.service.c_header import header

N = 32


@dataclass
class Answer:
    """What a step of the C client gave."""

    fresh: bool
    status: str
    causes: int
    marks: int
    twist: np.ndarray
    cost: float
    posture_rate: np.ndarray
    margins: np.ndarray


def puppet_program() -> Path:
    """Return the program."""
    source = Path(__file__).with_name("puppet.c").read_text()
    return program("puppet", {"puppet.c": source, "ergoqp_client.h": header()})


class Puppet:
    """One client; its methods are the calls of the C client."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [puppet_program()], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, *words: Any) -> str:
        """Return the answer to one command."""
        line = " ".join(repr(float(w)) if isinstance(w, float) else str(w) for w in words)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().rstrip("\n")

    def numbers(self, *words: Any) -> np.ndarray:
        return np.array([float.fromhex(word) for word in self.ask(*words).split()])

    def init(
        self,
        path: Any,
        relay: Any = "-",
        dt: float = 0.05,
        timeout: float = 2.0,
        longest: float = 60.0,
        coordinates: int = N,
    ) -> bool:
        return self.ask("init", path, relay, coordinates, dt, timeout, longest) == "1"

    def give(self, name: str, values: Any) -> None:
        self.ask(name, *np.asarray(values, float).ravel().tolist())

    def step(self, posture: Any = None, what: str = "step") -> Answer:
        if posture is not None:
            self.give("posture", posture)
        fresh, status, causes, marks, rows, *rest = self.ask(what).split()
        values = np.array([float.fromhex(word) for word in rest])
        margins = values[-int(rows) :] if int(rows) else values[:0]
        rate = values[7 : len(values) - int(rows)]
        twist, cost = values[:6], float(values[6])
        return Answer(fresh == "1", status, int(causes), int(marks), twist, cost, rate, margins)

    @property
    def waits(self) -> bool:
        return self.ask("waits") == "1"

    @property
    def reason(self) -> str:
        return self.ask("reason")

    @property
    def counters(self) -> tuple[int, ...]:
        """Late, lost, refused."""
        return tuple(int(word) for word in self.ask("counters").split())

    def stop(self) -> np.ndarray:
        return self.numbers("stop").reshape(-1, 6)

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()
