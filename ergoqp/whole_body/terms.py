"""The control step's own terms, evaluated for the whole-body formulation: its QP's data, and how person and pelvis follow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import ProblemError
from ergoqp.joints import JOINTS
from ergoqp.problem import Problem
from ergoqp.step_data import qp_data
from ergoqp.step_objective import cost_function

_CAUTION_EPS: Final = 0.1
"""As in the control step: keeps the Gauss-Newton curvature finite where the cost is at its least."""


def terms_function(problem: Problem) -> ca.Function:
    """Return everything that the whole-body QP takes from the control step, as one function.

    Takes what `ergoqp.step_data.qp_data` takes and returns, beside its data,

    - ``slope`` (32,): T dV/dq, what the cost says about each joint [points s/rad];
    - ``root`` (33, 32): a matrix whose Gram matrix is T^2 B, the step's curvature in the posture;
    - ``pelvis`` (4,): pelvis x, y, z [m] and yaw [rad] at the posture;
    - ``carried`` (4, 6): how the pelvis follows the object, from the model's stance and S.

    Raises:
        ProblemError: if the state is not a person's posture.
    """
    if tuple(problem.coordinates) != JOINTS:
        raise ProblemError(
            f"whole body: got a problem of {', '.join(problem.coordinates[:3])} ..., allowed one of a person's 32 joints"
        )
    data = qp_data(problem)
    given = [ca.MX.sym(data.name_in(i), data.sparsity_in(i)) for i in range(data.n_in())]
    posture, observed = given[0], given[1]
    parts = dict(zip((data.name_out(i) for i in range(data.n_out())), data(*given), strict=True))
    _, value, gradient = cost_function(problem)(posture, observed)
    ahead, control = problem.control.look_ahead, problem.control
    excess = ca.fmax(value - problem.cost.minimum, 0) + _CAUTION_EPS
    caution = ahead * np.sqrt(control.caution * problem.response.weight_vector)
    parts["slope"] = ahead * gradient
    parts["root"] = ca.vertcat(ahead * gradient.T / ca.sqrt(2 * excess), ca.MX(ca.diag(ca.DM(caution))))
    pelvis = _pelvis_function(problem)
    parts["pelvis"], turning = pelvis(posture)
    parts["carried"] = turning @ parts["S"]
    names = [data.name_in(i) for i in range(data.n_in())]
    return ca.Function("terms", given, [ca.densify(part) for part in parts.values()], names, list(parts))


def _pelvis_function(problem: Problem) -> ca.Function:
    """``q -> (pelvis x, y, z, yaw (4,), its derivative (4, 32))``."""
    q = ca.SX.sym("q", len(JOINTS))
    pose = problem.response.contact()(q)[1]
    place = ca.densify(ca.vertcat(pose[:3, 3], ca.atan2(pose[1, 0], pose[0, 0])))
    return ca.Function("pelvis", [q], [place, ca.densify(ca.jacobian(place, q))])


class Evaluator:
    """Calls a CasADi function through its buffers and hands out its results as NumPy arrays, without copies of copies."""

    def __init__(self, function: ca.Function) -> None:
        """Lay the buffers out once."""
        self._buffer, self._call = function.buffer()
        self._into = {function.name_in(i): np.zeros(function.numel_in(i)) for i in range(function.n_in())}
        self._out = {function.name_out(i): np.zeros(function.numel_out(i)) for i in range(function.n_out())}
        self._shapes = {function.name_out(i): function.size_out(i) for i in range(function.n_out())}
        for i, array in enumerate(self._into.values()):
            self._buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue] (the stub asks for a length)
        for i, array in enumerate(self._out.values()):
            self._buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, values: Mapping[str, np.ndarray | float]) -> dict[str, np.ndarray]:
        """Return the results by name, matrices in their shape, columns flat; they are the caller's own."""
        for name, array in self._into.items():
            array[:] = np.ravel(values[name], order="F")
        self._call()
        results = {}
        for name, array in self._out.items():
            rows, columns = self._shapes[name]
            results[name] = array.copy() if columns == 1 else array.reshape((rows, columns), order="F").copy()
        return results
