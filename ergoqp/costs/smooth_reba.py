"""A differentiable REBA score: the expected value under noise of known scale.

It needs no data and no training.

V_tau(q) = E[REBA(q + tau eta)], with an independent logistic eta per joint, P(eta < z) = (1 +
tanh z) / 2. It can be differentiated as often as needed. It has a closed form, because every
joint is read by one segment only. It tends to REBA itself as tau goes to 0, except exactly on
band ends. It is the expected score under sensor noise of standard deviation 0.91 tau. A small
tau follows the sheet closely but is flat between band ends. A large tau shows the direction
from far away. The default cost is therefore a mixture of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeVar, Unpack, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import shown
from ergoqp.costs import distributions as d
from ergoqp.errors import InputError
from ergoqp.expressions import evaluated_once
from ergoqp.joints import JOINTS, SIDES
from ergoqp.sheets.assessment import read_postures
from ergoqp.sheets.description import Segment, Sheet
from ergoqp.sheets.options import (
    DEFAULTS,
    Method,
    Task,
    TaskOptions,
    check_by_joint,
    read_method,
    read_task,
    sheet_of,
)

Expression = TypeVar("Expression", ca.SX, ca.MX)


class SmoothReba:
    """The smooth REBA score: a weighted mean of V_tau over a few widths tau.

    Method and task options change it exactly as they change :func:`ergoqp.sheets.reba.assess`.

    Attributes:
        name: ``"smooth_reba"``.
        minimum: the lowest exact score under these options; the value approaches it but is
            never lower [points].
        taus_deg: scales of the logistic noise [deg].
        weights: share of each scale; the sum is 1.
        method: how the sheet is read.
        function: ``posture (32,) -> cost``, a CasADi Function of scalar operations.

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.smooth_reba import SmoothReba
        >>> cost = SmoothReba(taus_deg=(1.5,), weights=(1.0,))
        >>> cost(np.zeros((2, 32))).round(2).tolist(), cost.minimum
        ([1.0, 1.0], 1.0)
        >>> value, gradient = cost.value_and_gradient(np.zeros(32))
        >>> gradient.shape
        (32, 1)
    """

    name = "smooth_reba"

    def __init__(
        self,
        taus_deg: Sequence[float] = (1.5, 12.0),
        weights: Sequence[float] = (0.8, 0.2),
        method: Method | None = None,
        **task: Unpack[TaskOptions],
    ) -> None:
        """Build the expression.

        Args:
            taus_deg: scales of the noise, above 0 [deg].
            weights: share of each scale, not negative; the sum must be 1.
            method: how the sheet is read; the default follows the publication.
            **task: options of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for
                all postures.

        Raises:
            InputError: if a value is out of its range.
        """
        self.taus_deg, self.weights = _mixture(taus_deg, weights)
        self.method = read_method(method)
        check_by_joint(self.method, "smooth_reba")
        sheet = sheet_of(self.method)
        self.task: TaskOptions = {**DEFAULTS, **task}
        q = ca.SX.sym("q", len(JOINTS))
        self._reading = reading = _Reading(sheet, self.method, read_task(sheet, None, self.task))
        values = [reading.expected(q, np.radians(tau)) for tau in self.taus_deg]
        self._q, self._value = (
            q,
            sum((w * v for w, v in zip(self.weights, values, strict=True)), start=ca.SX(0)),
        )
        self.minimum = reading.lowest()
        self.function = ca.Function(self.name, [q], ca.cse([self._value]), ["posture"], ["cost"])

    def __reduce__(self) -> tuple:
        """Pickle as arguments: expressions cannot be sent to a process, and are rebuilt there."""
        return partial(SmoothReba, self.taus_deg, self.weights, self.method, **self.task), ()

    @cached_property
    def value_and_gradient(self) -> ca.Function:
        """``posture (32,) -> cost, gradient (32,)``, a CasADi Function; gradient in points per rad.

        It computes both in one pass. That takes about 0.7 of the time of differentiating
        :meth:`expression` inside another function.
        """
        outputs = ca.cse([self._value, ca.gradient(self._value, self._q)])
        return ca.Function(
            f"{self.name}_gradient", [self._q], outputs, ["posture"], ["cost", "gradient"]
        )

    @cached_property
    def _at_scale(self) -> ca.Function:
        tau = ca.SX.sym("tau")
        return ca.Function(
            f"{self.name}_at_scale", [self._q, tau], ca.cse([self._reading.expected(self._q, tau)])
        )

    def at_scale(self, q: Expression, tau: Expression) -> Expression:
        """Return V_tau(q) for one scale tau [rad], which may be a symbol too.

        An optimiser can then make it smaller from stage to stage.
        """
        return cast("Expression", self._at_scale(cast("ca.MX", q), cast("ca.MX", tau)))

    def value_at_scale(self, posture: ArrayLike, tau: float) -> float:
        """Return V_tau of one posture (32,) [rad] at one scale tau [rad]."""
        return float(cast("ca.DM", self._at_scale(np.asarray(posture, dtype=float), tau)))

    def expression(self, q: ca.MX) -> ca.MX:
        """Return V(q), see :meth:`ergoqp.costs.cost.Cost.expression`."""
        return self.function(q)

    def __call__(self, postures: ArrayLike) -> NDArray[np.float64]:
        """Return V of each posture, see :meth:`ergoqp.costs.cost.Cost.__call__`. NaN gives NaN."""
        rows = read_postures(postures)
        if not len(rows):
            return np.empty(0)
        # A map over buffers reads the rows in place. It takes half the time of a call with a
        # matrix.
        return evaluated_once(self.function.map(len(rows)), rows)


@dataclass(frozen=True, eq=False)
class _Reading:
    """The sheet evaluated on distributions: one method per line of the worksheet."""

    sheet: Sheet
    method: Method
    task: Task

    def expected(self, q: ca.SX, tau: float | ca.SX) -> ca.SX:
        """Return E[REBA] at a posture, shape (32,) [rad], under noise of scale tau [rad]."""
        return d.expectation(self._final(), *self._scores(q, tau))

    def lowest(self) -> float:
        """Return the lowest score of any posture [points]."""
        score_a, score_b = self._scores(ca.SX.sym("q", len(JOINTS)), 1.0)
        return float(self._final()[min(score_a) - 1, min(score_b) - 1])

    def _final(self) -> np.ndarray:
        """Return table C with the activity, limited to the highest final score."""
        return np.minimum(self.sheet.tables["C"].cells + self._points("C"), self.method.final_max)

    def _scores(self, q: ca.SX, tau: float | ca.SX) -> tuple[d.Distribution, d.Distribution]:
        """Return the distributions of scores A and B."""
        sheet = self.sheet
        table_a = d.through_table(
            sheet.tables["A"].cells,
            [self._segment(segment, q, tau, "") for segment in sheet.of_table("A")],
        )
        arms = [
            [self._segment(segment, q, tau, side) for segment in sheet.of_table("B")]
            for side in SIDES
        ]
        cells = sheet.tables["B"].cells
        if self.method.arms == "whole":
            table_b = d.worse(*(d.through_table(cells, arm) for arm in arms))
        else:
            table_b = d.through_table(
                cells, [d.worse(right, left) for right, left in zip(*arms, strict=True)]
            )
        return d.shift(table_a, self._points("A")), d.shift(table_b, self._points("B"))

    def _points(self, table: str) -> int:
        return int(self.task.points[self.sheet.tables[table].plus])

    def _segment(self, segment: Segment, q: ca.SX, tau: float | ca.SX, side: str) -> d.Distribution:
        points = segment.start
        if segment.skipped_by is not None and self.task.flag(segment.skipped_by):
            scores = d.certain(0)
        elif segment.worse_side:
            scores = d.worse(
                *(d.of_step(segment.base, q[segment.joint(segment.base, s)], tau) for s in SIDES)
            )
        else:
            scores = d.of_step(segment.base, q[segment.joint(segment.base, side)], tau)
        for modifier in segment.modifiers:
            conditions = [
                d.of_step(step, q[segment.joint(step, side)], tau) for step in modifier.conditions
            ]
            for point in conditions if modifier.additive else [d.any_of(conditions)]:
                scores = d.plus(scores, point)
        for option in segment.options:
            blocked = option.not_with is not None and bool(self.task.flag(option.not_with))
            points += option.points * (bool(self.task.flag(option.option, side)) and not blocked)
        return d.shift(scores, points, 1, segment.highest)


def _mixture(
    taus_deg: Sequence[float], weights: Sequence[float]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    taus, shares = (
        np.atleast_1d(np.asarray(taus_deg, float)),
        np.atleast_1d(np.asarray(weights, float)),
    )
    if (
        taus.ndim != 1
        or not taus.size
        or not (np.isfinite(taus) & (taus >= 1e-3) & (taus <= 180)).all()
    ):
        raise InputError(f"taus_deg: got {shown(taus_deg)}, allowed: scales from 0.001 to 180 deg")
    if (
        shares.shape != taus.shape
        or not (shares >= 0).all()
        or not np.isclose(shares.sum(), 1, rtol=0, atol=1e-9)
    ):
        raise InputError(
            f"weights: got {shown(weights)}, allowed: one per tau ({taus.size}), not negative,"
            " adding up to 1"
        )
    return tuple(taus.tolist()), tuple(shares.tolist())
