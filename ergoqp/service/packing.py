"""Frames to the inputs of the step and back in machine code, where there is a C compiler.

In a loop that sleeps most of the time every line of Python costs about ten times what it costs in a
benchmark without pauses, because the processor has forgotten it. This does in two calls what takes
some thirty lines in `ergoqp.service.loop`, to the last bit.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from ergoqp.native.compiled import CompilerError, c_text, shared_library
from ergoqp.service.schema import Frame
from ergoqp.step.certification import longest_stop
from ergoqp.step.stepper import Stepper

_PLACES = (
    *("n", "pose", "twist", "posture", "observed"),
    *("to_posture", "to_observed", "to_pose", "to_has_pose", "to_executed", "to_has_twist"),
    *("to_dt", "to_age", "to_frame", "to_enable"),
    *("from_twist", "from_pose", "from_state", "from_rate", "from_copied"),
    *("copied", "planned", "sent"),
    *("at_twist", "at_pose", "at_rate", "at_copied", "at_times", "at_stop"),
)


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
    )


class Packing:
    """The way of one loop from frames to its stepper and back.

    Args:
        stepper: of a problem without a surface, see `packing_of`.
        request: layout of the request.
        answer: layout of the answer.
        out: memory of the answer.
        copied: the outputs of the step that are copied as one, as a slice.

    Raises:
        CompilerError: if there is no C compiler.
    """

    def __init__(
        self, stepper: Stepper, request: Frame, answer: Frame, out: bytearray, copied: slice
    ) -> None:
        """Compile, and find all places."""
        source = (Path(__file__).parent / "c/exchange.c").read_text(encoding="utf-8")
        sources = {"exchange.c": source, "stop.h": c_text("stop.h")}
        library = ctypes.CDLL(str(shared_library("exchange", sources, [], [])))
        problem, found, into = stepper.problem, stepper.slices, stepper.places
        given, results = stepper.arrays
        into_frame, from_frame = (
            {name: at.start for name, at in frame.at.items()} for frame in (request, answer)
        )
        places = {
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
        }
        memory = (ctypes.c_char * len(out)).from_buffer(out)
        self._exchange = _Exchange(
            given=given.ctypes.data,
            results=results.ctypes.data,
            answer=ctypes.addressof(memory),
            average=problem.average,
            acceleration=tuple(problem.twist_limit.acceleration),
            **places,
        )
        self._kept = given, results, memory  # as long as their addresses are used
        self._reference = ctypes.byref(self._exchange)
        self._problem, self._most = problem, {problem.dt: longest_stop(problem, problem.dt)}
        self._take, self._tell = library.ergoqp_take, library.ergoqp_tell
        self._take.argtypes = [
            ctypes.c_void_p,
            ctypes.c_uint32,
            ctypes.c_double,
            ctypes.c_double,
        ]
        self._tell.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_int]

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
