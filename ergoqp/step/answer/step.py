"""The answer of one control step: the twist to send, and its account, which is read on demand."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.step.answer.account import Account
from ergoqp.step.answer.reasons import reason_of


class Step:
    """The answer of one control step.

    Attributes:
        twist: twist to send: velocity of the object at the contact frame, world-aligned, linear
            first (6,) [m/s, rad/s].
        status: ``optimal``, ``settled``, ``relaxed``, ``recovering``, ``braking`` or ``invalid``.
        solve_time: duration of the call [s].

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> step = ergoqp.Stepper(problem).step(problem.response.comfort)
        >>> step.status, step.posture_rate.shape
        ('optimal', (32,))
        >>> round(step.margins["workspace z"], 2)
        0.37
        >>> step.reason
        ''
    """

    def __init__(
        self,
        twist: np.ndarray,
        status: str,
        problem: Problem,
        account: np.ndarray,
        parts: Mapping[str, slice],
        seen: tuple[np.ndarray, float, float],
        notes: Mapping[str, str],
        start: float,
    ) -> None:
        """Keep the outputs of the step function; the members are read from them on demand."""
        self.twist, self.status = twist, status
        self._problem, self._outputs = problem, (status, account, parts)
        self._seen, self._notes = seen, notes
        self.solve_time = time.perf_counter() - start

    def __repr__(self) -> str:
        """Show twist, status and reason."""
        twist = np.array2string(self.twist, precision=4, suppress_small=True)
        return f"Step(twist={twist}, status={self.status!r}, reason={self.reason!r})"

    @cached_property
    def _account(self) -> Account:
        return Account(*self._outputs)

    def account(self, name: str) -> np.ndarray:
        """Return an output (k,) of the step function, by its name.

        The names are those of `ergoqp.step.inputs.OUTPUTS`.
        """
        return self._account(name)

    @property
    def pose(self) -> np.ndarray:
        """Contact frame in the world that the step used (4, 4) [m]."""
        return self.account("pose_used").reshape(4, 4).T

    @property
    def posture_rate(self) -> np.ndarray:
        """How the model person follows (32,) [rad/s], or the rate of another state."""
        return self.account("posture_rate")

    @property
    def cost(self) -> float:
        """V of the posture [points]."""
        return float(self.account("cost")[0])

    @property
    def gain(self) -> float:
        """Predicted improvement within one second at full speed, comfort included [points]."""
        return float(self.account("gain")[0])

    @property
    def residuals(self) -> dict[str, float]:
        """Residuals of the step by name: ``qp``, ``contact`` and ``accepted``.

        ``qp`` is the largest KKT residual. ``contact`` is the contact motion that the posture
        cannot follow [m/s, rad/s]. ``accepted`` is the certified share of the way from braking to
        the QP's answer.
        """
        return self._account.residuals

    @property
    def drawn(self) -> int:
        """Phase of `ergoqp.step.guide.trial` in which the guide leads; else 0.

        The guide leads on the way to the place, during the wait there, and on the way back.
        """
        return self._account.drawn

    @cached_property
    def reason(self) -> str:
        """One sentence that names the cause; empty for a plain optimal step."""
        posture, dt, age = self._seen
        notes = self._notes
        if "slow" in notes and self.solve_time > dt:
            late = f"the step took {1e3 * self.solve_time:.3g} ms of its period of {1e3 * dt:g} ms"
            notes = {**notes, "late": f"{late}; the slowest term is {notes['slow']}"}
        return reason_of(self._problem, self._account, posture, dt, age, notes)

    @cached_property
    def margins(self) -> dict[str, float]:
        """Distance of every row to its nearer end, negative outside, in the unit of the row."""
        return dict(zip(self._problem.row_names, self.account("margins").tolist(), strict=True))

    @cached_property
    def slack(self) -> dict[str, float]:
        """By how much the QP missed a row, in its unit per second; only missed rows.

        Of a row of the object it only means that coming back was asked for faster than possible.
        """
        values = self.account("slack").tolist()
        return {
            name: value
            for name, value in zip(self._problem.row_names, values, strict=True)
            if value > 1e-7
        }

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold the object back, and of the joints that yield."""
        pushing = np.abs(self.account("multipliers")) > 1e-6
        rows = [name for name, push in zip(self._problem.row_names, pushing, strict=True) if push]
        return (*rows, *(joint for joint in self.locked if joint not in rows))

    @cached_property
    def locked(self) -> tuple[str, ...]:
        """Joints at their end that the model person holds still while the others follow."""
        return tuple(
            self._problem.coordinates[i] for i in np.flatnonzero(self.account("locked") > 0.5)
        )
