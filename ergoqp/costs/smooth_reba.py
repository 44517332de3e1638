"""A differentiable REBA score: the expected value under noise of known scale.

It needs no data and no training.

V_tau(q) = E[REBA(q + tau eta)], with an independent logistic eta per joint, P(eta < z) = (1 +
tanh z) / 2. It can be differentiated as often as needed. It has a closed form, because every
joint is read by one segment only. It tends to REBA itself as tau goes to 0, except exactly on
band ends. It is the expected score under sensor noise of standard deviation 0.91 tau. A small
tau follows the sheet closely but is flat between band ends. A large tau shows the direction
from far away. The default cost is therefore a mixture of both.

A distribution maps each possible score to its symbolic probability. The noises of the joints
are independent and every joint is read once, so all operations are exact. Adding points shifts
the probabilities. A clamp sums those beyond its ends. "Or" is one minus the product of the
complements. The worse of two scores multiplies the cumulative probabilities. A table maps the
product of its axes to its cells.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any, Final, TypeVar, Unpack, cast

import casadi as ca
import numpy as np
from annotated_types import Len
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import Range, are_shares, shown
from ergoqp.errors import InputError
from ergoqp.expressions import evaluated_once
from ergoqp.joints import JOINTS, SIDES
from ergoqp.sheets.angles import read_postures
from ergoqp.sheets.description import Segment, Sheet, StepFunction
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

_TAU: Final = Range(1e-3, 180.0, "deg", (0.1, 45.0))
"""What the scale of a noise may be."""

_WIDEST: Final = 9.0
"""Largest angle at which the exponential form has a gradient [rad].

Angles beyond about a third of it are refused elsewhere.
"""

_LARGEST_EXPONENT: Final = 700.0
"""Largest exponent of e in double precision."""

Distribution = dict[int, ca.SX]
"""Probability of each possible score, in ascending order; the sum of the probabilities is one."""


def past(x: ca.SX, edge: float, tau: float | ca.SX) -> ca.SX:
    """Return P(x + tau eta > edge) for a logistic eta with P(eta < z) = (1 + tanh z) / 2.

    The standard deviation of eta is pi / sqrt(12) = 0.91, so tau is nearly the standard
    deviation of the noise. The scale parameter of the logistic distribution is tau / 2.
    """
    if isinstance(tau, ca.SX) or _overflows(edge, tau):
        # The tanh form cannot overflow at any scale.
        return 0.5 + 0.5 * ca.tanh(x * (1 / tau) - edge / tau)
    # All edges of a joint share one exponential. Simplifying the whole expression merges it.
    scale = math.exp(-2 * edge / tau)
    return scale / (scale + ca.exp(x * (-2 / tau)))


def _overflows(edge: float, tau: float) -> bool:
    """Return whether the exponential form of `past` overflows at some angle."""
    return 2 * max(_WIDEST, abs(edge)) / tau > _LARGEST_EXPONENT


@dataclass(frozen=True, eq=False)
class _Noise:
    """A scale of the noise whose numbers are symbols: those of `past` for each end of a band.

    Attributes:
        rate: factor of the angle [1/rad].
        ends: what the end of each band becomes (dimensionless), in the order of `_edges`.
        places: place of the first end of each step function in `ends`, by its id.
        overflows: whether the tanh form is taken.
    """

    rate: ca.SX
    ends: ca.SX
    places: dict[int, int]
    overflows: bool

    def past(self, x: ca.SX, step: StepFunction, number: int) -> ca.SX:
        """Return `past` of an end of a step function."""
        end = self.ends[self.places[id(step)] + number]
        if self.overflows:
            return 0.5 + 0.5 * ca.tanh(x * self.rate - end)
        return end / (end + ca.exp(x * self.rate))


def _edges(sheet: Sheet) -> tuple[list[float], dict[int, int]]:
    """Return all ends of bands, and where those of each step function begin, by its id."""
    edges, places = list[float](), dict[int, int]()
    for segment in sheet.segments.values():
        for step in segment.steps:
            places[id(step)] = len(edges)
            edges += step.edges
    return edges, places


def of_step(step: StepFunction, x: ca.SX, tau: Scale) -> Distribution:
    """Return the distribution of a step function's score if its joint has noise of scale tau.

    Args:
        step: the bands.
        x: the joint's angle [rad].
        tau: scale of the logistic noise [rad].
    """
    if isinstance(tau, _Noise):
        ends = [tau.past(x, step, number) for number in range(len(step.edges))]
    else:
        ends = [past(x, edge, tau) for edge in step.edges]
    beyond = [1, *ends, 0]
    if len(set(step.scores)) == 2:
        # With two scores ("twisted" or not), the complement of one saves half the operations.
        inner = step.scores[1]
        (outer,) = set(step.scores) - {inner}
        chance = _sum(
            beyond[i] - beyond[i + 1] for i, score in enumerate(step.scores) if score == inner
        )
        return dict(sorted({inner: chance, outer: 1 - chance}.items()))
    found: dict[int, list[ca.SX]] = defaultdict(list)
    for i, score in enumerate(step.scores):
        found[score].append(beyond[i] - beyond[i + 1])
    return {score: _sum(found[score]) for score in sorted(found)}


def any_of(conditions: Sequence[Distribution]) -> Distribution:
    """Return the distribution of one point for any of independent conditions (each on 0 and 1)."""
    none = conditions[0][0]
    for condition in conditions[1:]:
        none = none * condition[0]
    return {0: none, 1: 1 - none}


def plus(scores: Distribution, point: Distribution) -> Distribution:
    """Return the distribution of a score plus an independent point (a distribution on 0 and 1)."""
    moved = {score: chance * point[1] for score, chance in scores.items()}
    total = defaultdict(lambda: ca.SX(0))
    for score, chance in scores.items():
        total[score] += chance - moved[score]
        total[score + 1] += moved[score]
    return dict(sorted(total.items()))


def shift(scores: Distribution, points: int, low: int = 0, high: int = 99) -> Distribution:
    """Return the distribution of a score with known points added, clamped to low ... high."""
    total = defaultdict(lambda: ca.SX(0))
    for score, chance in scores.items():
        total[min(max(score + points, low), high)] += chance
    return dict(sorted(total.items()))


def worse(one: Distribution, other: Distribution) -> Distribution:
    """Return the distribution of the higher of two independent scores."""
    scores = sorted(set(one) | set(other))
    below = [a * b for a, b in zip(cumulative(one, scores), cumulative(other, scores), strict=True)]
    return {score: below[i] - below[i - 1] if i else below[0] for i, score in enumerate(scores)}


def cumulative(scores: Distribution, at: Sequence[int]) -> list[ca.SX]:
    """Return P(score <= k) for each k in `at`."""
    return [
        (
            ca.SX(1)
            if k >= max(scores)
            else _sum(chance for score, chance in scores.items() if score <= k)
        )
        for k in at
    ]


def through_table(cells: np.ndarray, axes: Sequence[Distribution]) -> Distribution:
    """Return the distribution of a table's cell.

    Args:
        cells: the table, counted from score 1 on every axis.
        axes: independent distributions, one per axis.
    """
    *first, last = axes
    outer = [
        (combo, math.prod((axis[k] for axis, k in zip(first, combo, strict=True)), start=ca.SX(1)))
        for combo in itertools.product(*first)
    ]
    found: dict[int, list[ca.SX]] = defaultdict(list)
    for k, chance in last.items():
        # Sum before multiplying: one product per cell value instead of one per cell.
        by_value: dict[int, list[ca.SX]] = defaultdict(list)
        for combo, weight in outer:
            by_value[int(cells[(*(score - 1 for score in combo), k - 1)])].append(weight)
        for value, weights in by_value.items():
            found[value].append(_sum(weights) * chance)
    return {value: _sum(found[value]) for value in sorted(found)}


def expectation(cells: np.ndarray, rows: Distribution, columns: Distribution) -> ca.SX:
    """Return the expected cell of a two-axis table of numbers.

    Args:
        cells: the table, counted from score 1 on both axes.
        rows: distribution along the first axis.
        columns: independent distribution along the second.
    """
    order = list(columns)
    above = [1 - chance for chance in cumulative(columns, order)]
    total = ca.SX(0)
    for row, chance in rows.items():
        along = [int(cells[row - 1, k - 1]) for k in order]
        # A row of a score table rises by 0 or 1 from cell to cell. So its mean is a sum of few
        # survival probabilities, without products.
        rises = (
            float(b - a) * p for a, b, p in zip(along, along[1:], above, strict=False) if b != a
        )
        total += chance * _sum([ca.SX(along[0]), *rises])
    return total


def _expected(cells: ca.SX, rows: Distribution, columns: Distribution) -> ca.SX:
    """Return `expectation` for cells that are symbols.

    Args:
        cells: the first cell of each row, then the rises from cell to cell.
        rows: distribution along the first axis.
        columns: independent distribution along the second.
    """
    survival = [1 - chance for chance in cumulative(columns, range(1, cells.shape[1]))]
    beyond = ca.vertcat(1, *survival)
    chosen = [row - 1 for row in rows]
    return ca.dot(ca.vertcat(*rows.values()), cells[chosen, :] @ beyond)


def _sum(terms: Iterable[ca.SX]) -> ca.SX:
    return sum(terms, start=ca.SX(0))


Scale = float | ca.SX | _Noise
"""Scale of the noise [rad], or the numbers that follow from one."""

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
        taus_deg: Annotated[Sequence[Annotated[float, _TAU]], Len(1)] = (1.5, 12.0),
        weights: Annotated[Sequence[Annotated[float, Range(0.0, 1.0)]], Len(1)] = (0.8, 0.2),
        method: Method | None = None,
        **task: Unpack[TaskOptions],
    ) -> None:
        """Read the options; the expression is built when it is first asked for.

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
        self._reading = _Reading(sheet, self.method, read_task(sheet, None, self.task))
        self.minimum = self._reading.lowest()

    def __reduce__(self) -> tuple:
        """Pickle as arguments: expressions cannot be sent to a process, and are rebuilt there."""
        return partial(SmoothReba, self.taus_deg, self.weights, self.method, **self.task), ()

    @cached_property
    def _q(self) -> ca.SX:
        return ca.SX.sym("q", len(JOINTS))

    @cached_property
    def _value(self) -> ca.SX:
        values = [self._reading.expected(self._q, np.radians(tau)) for tau in self.taus_deg]
        return _sum(w * v for w, v in zip(self.weights, values, strict=True))

    @cached_property
    def function(self) -> ca.Function:
        """``posture (32,) -> cost``, of scalar operations."""
        return ca.Function(self.name, [self._q], ca.cse([self._value]), ["posture"], ["cost"])

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

    def constants(self) -> dict[str, np.ndarray]:
        """Return the numbers of the cost: all in which two with the same options differ.

        They are the further inputs of `shared`: ``cells`` (a, b), the final table with its rows and
        columns moved by load and coupling, as the first cell and the rises of each row; for each
        scale, one after the other, its ``rates`` (k,) and the ``ends`` of all bands (k n,); and its
        ``shares`` (k,).
        """
        edges = np.array(_edges(self._reading.sheet)[0])
        rates, ends = list[float](), list[np.ndarray]()
        for tau, overflows in zip(np.radians(self.taus_deg), self._overflow, strict=True):
            rates.append(1 / tau if overflows else -2 / tau)
            ends.append(edges / tau if overflows else np.exp(-2 * edges / tau))
        cells = np.asarray(self._reading.moved(), dtype=float)
        rises = np.hstack([cells[:, :1], np.diff(cells, axis=1)])
        found = {"cells": rises, "rates": np.array(rates), "ends": np.concatenate(ends)}
        return found | {"shares": np.array(self.weights)}

    def structure(self) -> tuple[Any, ...]:
        """Return all that decides which operations the function of `shared` has."""
        sheet, task = self._reading.sheet, self._reading.task
        # Everything that the sheet is made of, but the ends of its bands.
        segments = tuple(
            (
                (segment.name, segment.sided, segment.worse_side, segment.start, segment.highest),
                (segment.skipped_by, segment.options),
                tuple((step.joint, step.scores) for step in segment.steps),
                tuple((len(each.conditions), each.additive) for each in segment.modifiers),
            )
            for segment in sheet.segments.values()
        )
        tables = tuple((sheet.tables[name].axes, sheet.tables[name].cells) for name in "AB")
        return self._overflow, segments, tables, self.method.arms, task.flags

    @cached_property
    def _overflow(self) -> tuple[bool, ...]:
        """Whether each scale needs the tanh form, see `past`."""
        widest = max(map(abs, _edges(self._reading.sheet)[0]))
        return tuple(_overflows(widest, tau) for tau in np.radians(self.taus_deg).tolist())

    @cached_property
    def shared(self) -> ca.Function:
        """`function` with the `constants` as further inputs."""
        sizes = {name: value.shape for name, value in self.constants().items()}
        given = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
        edges, places = _edges(self._reading.sheet)
        values = []
        for number, overflows in enumerate(self._overflow):
            ends = given["ends"][number * len(edges) : (number + 1) * len(edges)]
            noise = _Noise(given["rates"][number], ends, places, overflows)
            values.append(_expected(given["cells"], *self._reading.unmoved(self._q, noise)))
        inputs = {"posture": self._q, **given}
        cost = ca.cse([ca.dot(given["shares"], ca.vertcat(*values))])
        return ca.Function(self.name, [*inputs.values()], [*cost], list(inputs), ["cost"])

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

    def expected(self, q: ca.SX, tau: Scale) -> ca.SX:
        """Return E[REBA] at a posture, shape (32,) [rad], under noise of scale tau [rad]."""
        return expectation(self._final(), *self._scores(q, tau))

    def lowest(self) -> float:
        """Return the lowest score of any posture [points]."""
        score_a, score_b = self._scores(ca.SX.sym("q", len(JOINTS)), 1.0)
        return float(self._final()[min(score_a) - 1, min(score_b) - 1])

    def _final(self) -> np.ndarray:
        """Return table C with the activity, limited to the highest final score."""
        return np.minimum(self.sheet.tables["C"].cells + self._points("C"), self.method.final_max)

    def moved(self) -> np.ndarray:
        """Return the final table for scores A and B without load and coupling."""
        rows, columns = (
            np.arange(self.sheet.tables[name].cells.max()) + self._points(name) for name in "AB"
        )
        return self._final()[np.ix_(rows, columns)]

    def _scores(self, q: ca.SX, tau: Scale) -> tuple[Distribution, Distribution]:
        """Return the distributions of scores A and B."""
        table_a, table_b = self.unmoved(q, tau)
        return shift(table_a, self._points("A")), shift(table_b, self._points("B"))

    def unmoved(self, q: ca.SX, tau: Scale) -> tuple[Distribution, Distribution]:
        """Return the distributions of scores A and B without load and coupling."""
        sheet = self.sheet
        table_a = through_table(
            sheet.tables["A"].cells,
            [self._segment(segment, q, tau, "") for segment in sheet.of_table("A")],
        )
        arms = [
            [self._segment(segment, q, tau, side) for segment in sheet.of_table("B")]
            for side in SIDES
        ]
        cells = sheet.tables["B"].cells
        if self.method.arms == "whole":
            table_b = worse(*(through_table(cells, arm) for arm in arms))
        else:
            table_b = through_table(
                cells, [worse(right, left) for right, left in zip(*arms, strict=True)]
            )
        return table_a, table_b

    def _points(self, table: str) -> int:
        return int(self.task.points[self.sheet.tables[table].plus])

    def _segment(self, segment: Segment, q: ca.SX, tau: Scale, side: str) -> Distribution:
        points = segment.start
        if segment.skipped_by is not None and self.task.flag(segment.skipped_by):
            scores = {0: ca.SX(1)}
        elif segment.worse_side:
            scores = worse(
                *(of_step(segment.base, q[segment.joint(segment.base, s)], tau) for s in SIDES)
            )
        else:
            scores = of_step(segment.base, q[segment.joint(segment.base, side)], tau)
        for modifier in segment.modifiers:
            conditions = [
                of_step(step, q[segment.joint(step, side)], tau) for step in modifier.conditions
            ]
            for point in conditions if modifier.additive else [any_of(conditions)]:
                scores = plus(scores, point)
        for option in segment.options:
            blocked = option.not_with is not None and bool(self.task.flag(option.not_with))
            points += option.points * (bool(self.task.flag(option.option, side)) and not blocked)
        return shift(scores, points, 1, segment.highest)


def _mixture(
    taus_deg: Sequence[float], weights: Sequence[float]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    taus = np.atleast_1d(np.asarray(taus_deg, float))
    shares = np.atleast_1d(np.asarray(weights, float))
    within = (taus >= _TAU.low) & (taus <= _TAU.high)
    if taus.ndim != 1 or not taus.size or not within.all():
        raise InputError(
            f"taus_deg: got {shown(taus_deg)}, allowed: scales from {_TAU.low:g} to"
            f" {_TAU.high:g} deg"
        )
    if not are_shares(shares, taus.size):
        raise InputError(
            f"weights: got {shown(weights)}, allowed: one per tau ({taus.size}), not negative,"
            " adding up to 1"
        )
    return tuple(taus.tolist()), tuple(shares.tolist())
