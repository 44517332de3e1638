"""A question of `ergoqp.Client` and its answer in machine code, where there is a C compiler."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path

from ergoqp.native.compiled import CompilerError, shared_library
from ergoqp.service.schema import KNOTS, VERSION, Frame, Tell

_PLACES = (
    *("request_length", "answer_length", "version", "step", "at_sequence", "at_knots"),
    *("at_twist", "at_times", "at_stop", "numbers", "knots"),
)


class _Asking(ctypes.Structure):
    """The struct ``asking`` of ``c/ask.c``."""

    _fields_ = (
        ("request", ctypes.c_void_p),
        *((name, ctypes.c_int32) for name in _PLACES),
    )


def asking_of(request: bytearray, answer: Frame) -> Callable[[int, int, float], int] | None:
    """Return the call that sends a request and waits for its answer; None without a compiler.

    It takes the descriptor of the connection, the address for the answer and the seconds to wait.
    It returns twice the number of bytes that arrived, plus 1 if they are a usable step; -1 if the
    request was not sent as a whole.

    Args:
        request: memory of the request, which must stay where it is.
        answer: layout of the answer.
    """
    source = (Path(__file__).parent / "c/ask.c").read_text(encoding="utf-8")
    try:
        library = ctypes.CDLL(str(shared_library("ask", {"ask.c": source}, [], [])))
    except CompilerError:
        return None
    at = {name: place.start for name, place in answer.at.items()}
    memory = (ctypes.c_char * len(request)).from_buffer(request)
    asking = _Asking(
        request=ctypes.addressof(memory),
        request_length=len(request),
        answer_length=answer.length,
        version=VERSION,
        step=int(Tell.step),
        at_sequence=at["sequence"],
        at_knots=at["knots"],
        at_twist=at["twist"],
        at_times=at["times"],
        at_stop=at["stop"],
        numbers=(answer.at["posture_rate"].stop - at["twist"]) // 8,
        knots=KNOTS,
    )
    call, reference = library.ergoqp_ask, ctypes.byref(asking)
    call.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_double]

    def ask(service: int, address: int, seconds: float) -> int:
        return call(reference, service, address, seconds)

    ask.kept = memory, asking  # type: ignore[attr-defined]
    return ask
