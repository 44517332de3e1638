"""The EPFL report's plain way, for comparison: NumPy, scikit-learn, no constraint, no certificate.

x_d = -eps dV/dq dq/dx (its equation 3.3) with V a support vector regression on the 20 joints, the
gradient of a one-class SVM added, gradients in NumPy over the support vectors, and dq/dx by a
damped pseudo-inverse of the hand's Jacobian from MuJoCo.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ergoqp.coordinates import REPORT_JOINTS
from ergoqp.datasets.postures import balanced_postures
from ergoqp.joints import INDEX
from ergoqp.problem.problem import Problem

SAMPLES = 2000
"""Labelled postures that the machines are fitted to, a fifth of the report's."""

_EPS, _DAMPING = 0.02, 0.02


def plain_step_us(problem: Problem, calls: Sequence[tuple[Any, Any, float]]) -> np.ndarray | None:
    """Return the time of every step of a recorded loop [us], None without scikit-learn."""
    try:
        from sklearn.svm import SVR, OneClassSVM
    except ImportError:
        return None
    columns = [INDEX[joint] for joint in REPORT_JOINTS]
    postures, scores = balanced_postures(SAMPLES // 10, np.random.default_rng(0))
    regression = SVR().fit(postures[:, columns], scores)
    boundary = OneClassSVM(gamma="scale", nu=0.1).fit(postures[:, columns])
    slopes = [_slope(machine) for machine in (regression, boundary)]
    model = problem.response.body.model  # type: ignore[attr-defined]
    data, site = mujoco.MjData(model), model.site("right_grip").id
    jacobian = np.zeros((6, model.nv))
    times = []
    for _ in ("warm-up", "counted"):
        times = []
        for posture, _, _ in calls:
            if np.ndim(posture) == 0:
                continue
            start = time.perf_counter()
            sample = posture[columns]
            cost, inside = (
                regression.predict(sample[None])[0],
                boundary.decision_function(sample[None])[0],
            )
            gradient = np.zeros(len(posture))
            gradient[columns] = slopes[0](sample) - (slopes[1](sample) if inside < 0 else 0.0)
            data.qpos[4:] = posture
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
            J = jacobian[:, 4:]
            S = J.T @ np.linalg.inv(J @ J.T + _DAMPING**2 * np.eye(6))
            twist = -_EPS * cost * (S.T @ gradient)
            times.append(time.perf_counter() - start)
            if not np.isfinite(twist).all():
                raise RuntimeError("the plain way gave no number")
    return 1e6 * np.array(times)


def _slope(machine: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Gradient of a radial machine of scikit-learn, in NumPy."""
    vectors, weights, gamma = machine.support_vectors_, machine.dual_coef_[0], machine._gamma

    def slope(x: np.ndarray) -> np.ndarray:
        apart = vectors - x
        kernel = weights * np.exp(-gamma * np.einsum("ij,ij->i", apart, apart))
        return 2 * gamma * (kernel @ apart)

    return slope
