"""Frames to the inputs of the step and back in machine code, where there is a C compiler.

In a loop that sleeps most of the time every line of Python costs about ten times what it costs in a
benchmark without pauses, because the processor has forgotten it. This does in two calls what takes
some thirty lines in `ergoqp.service.loop`, to the last bit.
"""

from __future__ import annotations

import ctypes
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.native.compiled import (
    CompilerError,
    c_text,
    library_of,
    loaded,
    shared_library,
)
from ergoqp.service.reasons import SETTLED
from ergoqp.service.schema import TEXT, VERSION, Ask, Frame, Mark, Tell
from ergoqp.step.certification import longest_stop
from ergoqp.step.frames_check import DOUBTED
from ergoqp.step.function import INPUTS
from ergoqp.step.guide import GUIDE_INPUTS
from ergoqp.step.layout import FRAMES, SHORTEST_DT, places
from ergoqp.step.rows import limit_values
from ergoqp.step.stepper import Stepper

DOUBT = places(FRAMES)["doubted"].start

_PLACES = (
    *("n", "pose", "twist", "posture", "observed"),
    *("to_posture", "to_observed", "to_pose", "to_has_pose", "to_executed", "to_has_twist"),
    *("to_dt", "to_age", "to_frame", "to_enable"),
    *("from_twist", "from_pose", "from_state", "from_rate", "from_copied"),
    *("copied", "planned", "sent"),
    *("at_twist", "at_pose", "at_rate", "at_copied", "at_times", "at_stop"),
    *("at_text", "text", "rows", "from_margins", "from_status", "from_causes"),
    *("from_doubted", "from_drawn", "inputs", "to_state", "states"),
    *("request_length", "answer_length", "settled", "still", "armed"),
    *("version", "ask", "told", "engine"),
)
_NUMBERS = ("session", "sequence", "digest")
_REALS = ("dt", "shortest", "longest", "stop_seconds", "doubted")
_POINTERS = ("usual", "state", "tolerance", "step", "arguments", "outputs", "work", "indices")


class _Exchange(ctypes.Structure):
    """The struct ``exchange`` of ``c/exchange.c``."""

    _fields_ = (
        ("request", ctypes.c_void_p),
        ("given", ctypes.c_void_p),
        ("results", ctypes.c_void_p),
        ("answer", ctypes.c_void_p),
        ("average", ctypes.c_double),
        ("acceleration", ctypes.c_double * 6),
        *((name, ctypes.c_int32) for name in _PLACES),
        *((name, ctypes.c_uint64) for name in _NUMBERS),
        *((name, ctypes.c_double) for name in _REALS),
        *((name, ctypes.c_void_p) for name in _POINTERS),
    )


class Packing:
    """The way of one loop from frames to its stepper and back.

    Args:
        stepper: of a problem without a surface, see `packing_of`.
        request: layout of the request.
        answer: layout of the answer.
        out: memory of the answer.
        copied: the outputs of the step that are copied as one, as a slice.
        engine: of the step, see `ergoqp.service.schema.ENGINES`.
        digest: of the problem.

    Attributes:
        exchange: receives from a client and answers a plain request, see ``c/exchange.c``, given
            the descriptor of the connection, the address of the request and how many bytes of it
            have arrived before; None if the step is not compiled.

    Raises:
        CompilerError: if there is no C compiler.
    """

    def __init__(
        self,
        stepper: Stepper,
        request: Frame,
        answer: Frame,
        out: bytearray,
        copied: slice,
        engine: int,
        digest: int,
    ) -> None:
        """Compile, and find all places."""
        source = (Path(__file__).parent / "c/exchange.c").read_text(encoding="utf-8")
        sources = {"exchange.c": source, "stop.h": c_text("stop.h")}
        library = loaded(shared_library("exchange", sources, [], []))
        problem, evaluator = stepper.problem, stepper.evaluator
        found, into = evaluator.slices, evaluator.places
        given, results = evaluator.given, evaluator.results
        into_frame, from_frame = (
            {name: at.start for name, at in frame.at.items()} for frame in (request, answer)
        )
        where = {
            "n": len(problem.coordinates),
            **{name: into_frame[name] for name in ("pose", "twist", "posture", "observed")},
            **{f"to_{name}": into[name].start for name in into if f"to_{name}" in _PLACES},
            "from_twist": found["twist"].start,
            "from_pose": found["pose_used"].start,
            "from_state": found["next_state"].start,
            "from_rate": found["posture_rate"].start,
            "from_copied": copied.start,
            "copied": copied.stop - copied.start,
            "planned": stepper.history.planned,
            "sent": stepper.history.sent,
            "at_twist": from_frame["twist"],
            "at_pose": from_frame["pose"],
            "at_rate": from_frame["posture_rate"],
            "at_copied": from_frame["fault"],
            "at_times": from_frame["times"],
            "at_stop": from_frame["stop"],
            "at_text": from_frame["text"],
            "text": TEXT,
            "rows": len(problem.row_names),
            "from_margins": found["margins"].start,
            "from_status": found["status"].start,
            "from_causes": found["causes"].start,
            "from_doubted": found["frames"].start + DOUBT,
            "from_drawn": found["drawn"].start if "drawn" in found else -1,
            # The numbers of the problem come after them, and stay.
            "inputs": max(into[name].stop for name in (*INPUTS, *GUIDE_INPUTS) if name in into),
            "to_state": into["state"].start,
            "states": into["state"].stop - into["state"].start,
            "request_length": request.length,
            "answer_length": answer.length,
            "settled": SETTLED,
            "still": Mark.still,
            "version": VERSION,
            "ask": Ask.step,
            "told": Tell.step,
        }
        memory = (ctypes.c_char * len(out)).from_buffer(out)
        self._exchange = _Exchange(
            given=given.ctypes.data,
            results=results.ctypes.data,
            answer=ctypes.addressof(memory),
            average=problem.average,
            acceleration=tuple(problem.twist_limit.acceleration),
            engine=engine,
            digest=digest,
            **where,
        )
        tolerance = np.array(limit_values(problem.row_limits, "tolerance"), dtype=float)
        self._exchange.tolerance = tolerance.ctypes.data
        self._exchange.dt, self._exchange.shortest = problem.dt, SHORTEST_DT
        self._exchange.longest, self._exchange.doubted = problem.longest_period, DOUBTED
        self._exchange.stop_seconds = problem.stop.duration
        self._kept = given, results, memory, tolerance  # as long as their addresses are used
        self._reference = ctypes.byref(self._exchange)
        exchange = library.ergoqp_exchange
        exchange.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_int]
        bound = self._bind(stepper, given, results)
        self.exchange = partial(exchange, self._reference) if bound else None
        self._problem, self._most = problem, {problem.dt: longest_stop(problem, problem.dt)}
        self._take, self._tell = library.ergoqp_take, library.ergoqp_tell
        self._take.argtypes = [
            ctypes.c_void_p,
            ctypes.c_uint32,
            ctypes.c_double,
            ctypes.c_double,
        ]
        self._tell.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_int]

    def _bind(self, stepper: Stepper, given: np.ndarray, results: np.ndarray) -> bool:
        """Find the step function in its library; return whether it is compiled."""
        path = library_of(stepper.function)
        if path is None:
            return False
        library, name = loaded(path), stepper.function.name()
        sizes = [ctypes.c_longlong() for _ in range(4)]
        library[f"{name}_work"](*map(ctypes.byref, sizes))
        arguments, outputs, indices, work = (np.zeros(each.value + 1, np.int64) for each in sizes)
        for i, at in enumerate(stepper.evaluator.places.values()):
            arguments[i] = given.ctypes.data + 8 * at.start
        for i, at in enumerate(stepper.evaluator.slices.values()):
            outputs[i] = results.ctypes.data + 8 * at.start
        there = self._exchange
        there.step = ctypes.cast(library[name], ctypes.c_void_p)
        there.arguments, there.outputs = arguments.ctypes.data, outputs.ctypes.data
        there.indices, there.work = indices.ctypes.data, work.ctypes.data
        self._kept = *self._kept, library, arguments, outputs, indices, work
        return True

    def arm(self, usual: np.ndarray | None, state: np.ndarray, session: int, sequence: int) -> None:
        """Say what a plain request continues from.

        Args:
            usual: inputs that a step begins with; None: no request is plain.
            state: the state (n,).
            session: the session.
            sequence: number of the last answer.
        """
        there = self._exchange
        there.armed = usual is not None
        if usual is not None:
            self._from = usual, state
            there.usual, there.state = usual.ctypes.data, state.ctypes.data
            there.session, there.sequence = session, sequence

    def take(self, address: int, flags: int, dt: float, age: float) -> bool:
        """Write a request into the inputs of the step; return whether its mask is one.

        Args:
            address: of the request.
            flags: what it contains.
            dt: for how long the twist will be executed [s].
            age: age of the posture [s].
        """
        self._exchange.request = address
        return self._take(self._reference, flags, dt, age) != 0

    def tell(self, dt: float) -> int:
        """Write the last step and its stop into the answer; return the number of knots."""
        most = self._most.get(dt) or longest_stop(self._problem, dt)
        return self._tell(self._reference, dt, most)


def packing_of(stepper: Stepper, *where: Any) -> Packing | None:
    """Return the packing of a loop; None where the stop is no closed form or nothing compiles."""
    if stepper.problem.surface is not None:
        return None
    try:
        return Packing(stepper, *where)
    except CompilerError:
        return None
