"""The certified stop in closed form, as machine code; see ``native/c/stop.h``."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from ergoqp.native.compiler import shared_library
from ergoqp.native.daqp import c_text
from ergoqp.step.model import StepModel

_SOURCE = """#include "stop.h"
int ergoqp_stop(const double* history, int planned, int sent, double average, double dt,
                const double* acceleration, double (*twists)[6], int most) {
    return ergoqp_stop_twists(history, planned, sent, average, dt, acceleration, twists, most);
}
"""


def longest_stop(model: StepModel) -> int:
    """Return the largest number of twists of a stop, the last one zero."""
    problem = model.problem
    return int(np.floor(problem.stop.duration / problem.dt * (1 + 1e-9))) + 2


def stop_function(model: StepModel) -> Callable[[np.ndarray], np.ndarray]:
    """Return ``state (n,) -> twists (k, 6)`` [m/s, rad/s], one per period of the problem.

    They are those of braking period by period, up to rounding. The problem must have no surface.

    Raises:
        CompilerError: if there is no C compiler, or it fails.
    """
    library = shared_library("stop", {"stop.c": _SOURCE, "stop.h": c_text("stop.h")}, [], [])
    call = ctypes.CDLL(str(library)).ergoqp_stop
    call.restype, numbers = ctypes.c_int, ctypes.POINTER(ctypes.c_double)
    call.argtypes = [numbers, ctypes.c_int, ctypes.c_int, ctypes.c_double, ctypes.c_double]
    call.argtypes += [numbers, numbers, ctypes.c_int]
    problem, history, most = model.problem, model.history, longest_stop(model)
    acceleration = np.array(problem.twist_limit.acceleration, dtype=float)
    limits = acceleration.ctypes.data_as(numbers)
    fixed = (history.planned, history.sent, problem.average, problem.dt, limits)

    def stop(state: np.ndarray) -> np.ndarray:
        twists = np.empty((most, 6))
        given, found = (array.ctypes.data_as(numbers) for array in (state, twists))
        return twists[: call(given, *fixed, found, most)]

    return stop
