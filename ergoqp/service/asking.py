"""A question of `ergoqp.Client` and its answer in machine code, where there is a C compiler."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ergoqp.native.compiled import CompilerError, loaded, shared_library
from ergoqp.service.schema import KNOTS, VERSION, Frame, Tell
from ergoqp.step.causes import Status

_PLACES = (
    *("request_length", "answer_length", "version", "step", "statuses"),
    *("at_sequence", "at_status", "at_knots", "at_twist", "at_times", "at_stop"),
    *("numbers", "knots"),
)


class _Asking(ctypes.Structure):
    """The struct ``asking`` of ``c/ask.c``."""

    _fields_ = (
        ("request", ctypes.c_void_p),
        *((name, ctypes.c_int32) for name in _PLACES),
    )


def address_of(memory: bytearray) -> int:
    """Return where memory is, which must not be resized from now on."""
    return ctypes.addressof(ctypes.c_char.from_buffer(memory))


def asking_of(request: bytearray, answer: Frame) -> Callable[[int, int, float], int] | None:
    """Return the call that sends a request and waits for its answer; None without a compiler.

    It takes the descriptor of the connection, the address for the answer, and until when to wait by
    `time.perf_counter`. It returns twice the number of bytes that arrived, plus 1 if they are a
    usable step; -1 if the request was not sent as a whole.

    Args:
        request: memory of the request.
        answer: layout of the answer.
    """
    if time.get_clock_info("perf_counter").implementation != "clock_gettime(CLOCK_MONOTONIC)":
        return None
    source = (Path(__file__).parent / "c/ask.c").read_text(encoding="utf-8")
    try:
        library = loaded(shared_library("ask", {"ask.c": source}, [], []))
    except CompilerError:
        return None
    at = {name: place.start for name, place in answer.at.items()}
    asking = _Asking(
        request=address_of(request),
        request_length=len(request),
        answer_length=answer.length,
        version=VERSION,
        step=int(Tell.step),
        statuses=len(Status),
        numbers=(answer.at["posture_rate"].stop - at["twist"]) // 8,
        knots=KNOTS,
        **{name: at[name[3:]] for name in _PLACES if name.startswith("at_")},
    )
    ask = library.ergoqp_ask
    ask.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_double]
    return partial(ask, ctypes.byref(asking))
