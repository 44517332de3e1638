"""The stop in closed form: its time, and how far it is from braking period by period."""

from __future__ import annotations

import ctypes
import time

import numpy as np

from benchmarks.step_worker import ALL
from ergoqp.native.compiled import c_text, shared_library
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.seeking.seeker import a_place
from ergoqp.step.certification import longest_stop, stop_function
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Stepper

_TIMED = """
#define _POSIX_C_SOURCE 199309L
#include <time.h>
#include "stop.h"
double timed(const double* states, int size, int count, int planned, int sent, double average,
             double dt, const double* acceleration, double (*twists)[6], int most) {
    struct timespec from, to;
    volatile double kept;
    int i;
    clock_gettime(CLOCK_MONOTONIC, &from);
    for (i = 0; i < count; ++i) {
        const double* state = states + (long)i * size;
        ergoqp_stop_twists(state, planned, sent, average, dt, acceleration, twists, most);
        kept = twists[0][0];
    }
    clock_gettime(CLOCK_MONOTONIC, &to);
    (void)kept;
    return (1e9 * (double)(to.tv_sec - from.tv_sec) + (double)(to.tv_nsec - from.tv_nsec)) / count;
}
"""


def kinds(problem: Problem) -> dict[str, Stepper]:
    """Return a stepper of a problem as it is, with a guide, and with a declared robot."""
    return {
        "plain": Stepper(problem, compiled=False),
        "guided": Stepper(problem, compiled=False, guide=a_place(problem)),
        "declared": Stepper(problem.replace(robot=DeclaredRobot(**ALL)), compiled=False),
    }


def states(stepper: Stepper, count: int, seed: int) -> list[np.ndarray]:
    """Return states of a loop with uneven periods, lost frames, ramps and take-overs.

    The object begins outside its workspace again and again, and comes back.
    """
    problem, rng, found = stepper.problem, np.random.default_rng(seed), []
    comfort = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
    pose, posture = a_place(problem), comfort
    away = pose.copy()
    for number in range(count):
        if number % 25 == 0:
            stepper.reset(twist=rng.uniform(-1, 1, 6) * problem.twist_limit.speed)
            posture = comfort + 0.3 * rng.normal(size=len(comfort))
            away[:3, 3] = pose[:3, 3] + rng.uniform(-1, 1, 3)
        if number % 7 == 3:
            stepper.brake(elapsed=rng.uniform(0, 0.1))
        elif number % 7 == 5:
            stepper.step(None, dt=problem.dt * rng.uniform(0.3, 3))
        else:
            period = problem.dt * rng.choice([0.2, 0.5, 1, 1, 1, 2, 3])
            stepper.step(posture, away if number % 50 < 25 else pose, dt=period)
        found.append(stepper.state())
    return found


def stop_difference(count: int) -> tuple[float, int]:
    """Return the largest difference [m/s, rad/s] and the number of stops that were compared."""
    worst, compared = 0.0, 0
    for number, name in enumerate(TASKS):
        problem = load_problem(name)
        if problem.surface is not None:
            continue
        for stepper in kinds(problem).values():
            closed = stop_function(StepModel(stepper.problem, stepper.guided))
            for state in states(stepper, count, number):
                stepper.restore(state)
                one, other = stepper.stop(), closed(state, stepper.dt)
                apart = np.zeros((max(len(one), len(other)), 6))
                apart[: len(one)] += one
                apart[: len(other)] -= other
                worst, compared = max(worst, float(np.abs(apart).max())), compared + 1
    return worst, compared


def from_full_speed(problem: Problem, count: int) -> list[np.ndarray]:
    """Return states with the longest stops."""
    stepper, rng, found = Stepper(problem), np.random.default_rng(0), []
    for _ in range(count):
        signs = rng.choice([-1.0, 1.0], 6)
        stepper.reset(twist=signs * problem.twist_limit.speed)
        stepper.brake()
        found.append(stepper.state())
    return found


def stop_us(stepper: Stepper, given: list[np.ndarray]) -> float:
    """Return the median time [us] of `Stepper.stop`."""
    times = []
    for state in given * 2:
        stepper.restore(state)
        start = time.perf_counter()
        stepper.stop()
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times[len(given) :]))


def stop_c_us(problem: Problem, given: list[np.ndarray]) -> tuple[float, int]:
    """Return the time [us] of the stop within C, and its number of twists."""
    model = StepModel(problem)
    sources = {"stop_time.c": _TIMED, "stop.h": c_text("stop.h")}
    timed = ctypes.CDLL(str(shared_library("stop_time", sources, [], []))).timed
    timed.restype, numbers = ctypes.c_double, ctypes.POINTER(ctypes.c_double)
    timed.argtypes = [numbers, *[ctypes.c_int] * 4, *[ctypes.c_double] * 2, numbers, numbers]
    timed.argtypes += [ctypes.c_int]
    most, together = longest_stop(model.problem, model.problem.dt), np.ascontiguousarray(given)
    limits, twists = np.array(problem.twist_limit.acceleration, float), np.empty((most, 6))
    at = [array.ctypes.data_as(numbers) for array in (together, limits, twists)]
    sizes = (together.shape[1], len(together), model.history.planned, model.history.sent)
    call = (at[0], *sizes, problem.average, problem.dt, at[1], at[2], most)
    rows = len(stop_function(model)(given[-1], model.problem.dt))
    return float(np.median([timed(*call) for _ in range(21)])) / 1e3, rows
