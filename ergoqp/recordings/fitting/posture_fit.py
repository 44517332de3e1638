"""The posture behind joint centres: bounded Gauss-Newton, frame by frame, each step a small QP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import daqp
import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import JOINTS
from ergoqp.recordings.fitting.centre_model import BASE, HIGHEST, LOWEST, UNKNOWNS, CentreModel
from ergoqp.recordings.fitting.observe import observable_joints
from ergoqp.recordings.fitting.starts import starts
from ergoqp.recordings.fitting.weighting import PULL_NEUTRAL, PULL_PREVIOUS, weight_matrix

# m and rad: the joints only as far as the linear picture holds, the pelvis anywhere, but finite, as
# the solver wants it.
_LONGEST_STEP: Final = np.concatenate([np.full(BASE - 1, 1e3), np.full(UNKNOWNS - BASE + 1, 0.6)])
_STEPS: Final = 40
_SETTLED: Final = 1e-5  # rad or m
# m: an error that rises by more than this over the frame before is tried again from the start
# postures
_JUMP: Final = 0.01
_PROFIT: Final = 0.8  # a fresh start replaces the continued posture only when it is clearly better


@dataclass(frozen=True)
class Fit:
    """The fitted movement.

    Attributes:
        configurations: pelvis x, y, z [m], yaw [rad] and posture [rad] per frame, shape (n, 36).
        observed: which joints the seen centres determine, shape (n, 32).
        error: root of the mean squared distance of the seen centres per frame, shape (n,) [m].
    """

    configurations: np.ndarray
    observed: np.ndarray
    error: np.ndarray


def fit(model: CentreModel, targets: np.ndarray) -> Fit:
    """Fit the body to joint centres, every joint within its range and unobservable ones at zero.

    Args:
        model: the body's centres.
        targets: measured positions in the order of the model's centres, shape (n, m, 3) [m]; NaN
            where not seen.

    Returns:
        The configuration of every frame. A frame in which nothing is seen keeps the one before,
        with error NaN.
    """
    seen = np.asarray(np.isfinite(targets).all(axis=2))
    observed = np.zeros((len(targets), len(JOINTS)), dtype=bool)
    for pattern in np.unique(seen, axis=0):
        observed[(seen == pattern).all(axis=1)] = observable_joints(model, pattern)
    configurations = np.zeros((len(targets), UNKNOWNS))
    error = np.full(len(targets), np.nan)
    previous: np.ndarray | None = None
    last_error = np.inf
    for i, (target, mask) in enumerate(zip(targets, seen, strict=True)):
        if not mask.any():
            configurations[i] = 0.0 if previous is None else previous
            continue
        frame = _Frame(model, target, mask, observed[i])
        z = None if previous is None else frame.solve(previous, previous)
        if z is None or frame.error(z) > last_error + _JUMP:
            fresh = min(
                (frame.solve(start, None) for start in starts(model, target, mask)), key=frame.error
            )
            if z is None or frame.error(fresh) < _PROFIT * frame.error(z):
                z = fresh
        configurations[i] = previous = z
        error[i] = last_error = frame.error(z)
    return Fit(configurations, observed, error)


class _Frame:
    """The least-squares problem of one frame."""

    def __init__(
        self, model: CentreModel, target: np.ndarray, seen: np.ndarray, observed: np.ndarray
    ) -> None:
        self._model = model
        self._target = target[seen]
        self._seen = seen
        self._rows = np.repeat(seen, 3)
        self._free = np.flatnonzero(np.concatenate([np.ones(BASE, dtype=bool), observed]))
        self._weights = weight_matrix(model.centres, seen)
        self._no_rows = np.zeros((0, len(self._free)))
        self._sense = np.zeros(len(self._free), dtype=np.int32)

    def error(self, z: np.ndarray) -> float:
        """Return the root mean square distance of the seen centres [m]."""
        return float(
            np.sqrt(((self._model(z)[0][self._seen] - self._target) ** 2).sum(axis=1).mean())
        )

    def solve(self, start: np.ndarray, previous: np.ndarray | None) -> np.ndarray:
        """Return the best configuration near `start`, pulled weakly to `previous` and to zero."""
        pull = np.zeros(UNKNOWNS)
        centre = np.zeros(UNKNOWNS)
        pull[BASE:] = PULL_NEUTRAL**2
        if previous is not None:
            pull[BASE:] += PULL_PREVIOUS**2
            centre[BASE:] = PULL_PREVIOUS**2 / pull[BASE:] * previous[BASE:]
        pull, centre = pull[self._free], centre[self._free]
        low, high, reach = LOWEST[self._free], HIGHEST[self._free], _LONGEST_STEP[self._free]

        z = np.zeros(UNKNOWNS)
        z[self._free] = np.clip(start[self._free], low, high)
        damping = 1e-6
        cost, hessian, gradient = self._expand(z, pull, centre)
        for _ in range(_STEPS):
            at = z[self._free]
            step = self._step(
                hessian + damping * np.eye(len(at)),
                gradient,
                np.maximum(low - at, -reach),
                np.minimum(high - at, reach),
            )
            trial = z.copy()
            trial[self._free] = np.clip(at + step, low, high)
            new_cost, new_hessian, new_gradient = self._expand(trial, pull, centre)
            if new_cost <= cost:
                z, cost, hessian, gradient = trial, new_cost, new_hessian, new_gradient
                damping = max(damping / 10, 1e-9)
            else:
                damping = 10 * damping
            if np.abs(step).max() < _SETTLED:
                break
        return z

    def _expand(
        self, z: np.ndarray, pull: np.ndarray, centre: np.ndarray
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Return half the squared residual with the pulls.

        Its Gauss-Newton Hessian and its gradient at `z` follow.
        """
        positions, jacobian = self._model(z)
        residual = (positions[self._seen] - self._target).ravel()
        jacobian = jacobian[self._rows][:, self._free]
        off = z[self._free] - centre
        weighted = jacobian.T @ self._weights
        cost = 0.5 * float(residual @ self._weights @ residual + off @ (pull * off))
        return cost, weighted @ jacobian + np.diag(pull), weighted @ residual + pull * off

    def _step(
        self, hessian: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray:
        step, _, flag, _ = daqp.solve(hessian, gradient, self._no_rows, high, low, self._sense)
        if flag <= 0:
            raise RecordingError(
                f"the posture of a frame could not be fitted (QP solver flag {flag})"
            )
        return np.asarray(step)
