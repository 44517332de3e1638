"""Start of the loop in the exported example: a state with a high cost."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import read_array
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.limits import ArmLength, OneClassBoundary
from ergoqp.problem.problem import Problem
from ergoqp.step.model import stand_in

_RAISED: Final = {"shoulder_flexion": 95.0, "elbow_flexion": 30.0}
"""Angles of the working arms [deg]."""


def example_start(problem: Problem, given: ArrayLike | None = None) -> np.ndarray:
    """Return the state (n,) at which the example starts.

    Args:
        problem: the task.
        given: the user's state. None: comfort with the working arms raised, or, where the state is
            points within a learned boundary, the centre with the highest cost.

    Raises:
        InputError: if the user's state is not valid.
    """
    n = len(problem.coordinates)
    if given is not None:
        return read_array("start", given, (n,), f"{n} finite numbers")
    start = stand_in(problem).copy()
    if problem.coordinates == JOINTS:
        for side in getattr(problem.response, "hands", SIDES):
            for joint, angle in _RAISED.items():
                start[INDEX[f"{side}_{joint}"]] = np.radians(angle)
        return start
    boundary, length = problem.limit_of(OneClassBoundary), problem.limit_of(ArmLength)
    if boundary is None or tuple(boundary.model.coordinates.names) != tuple(problem.coordinates):
        return start
    model = boundary.model
    points = model.mean + model.scale * model.centres
    points = points if length is None else length.project(points)
    inside = points[model.margin(points) > 0]
    points = inside if len(inside) else points
    return points[int(np.argmax(problem.cost(points)))]


def start_header(start: np.ndarray) -> str:
    """Return ``start.h``: the state as the initialiser of an array in C."""
    return f"#define START {{{', '.join(f'{value:.6g}' for value in start.tolist())}}}\n"
