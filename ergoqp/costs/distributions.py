"""Distributions of scores: the operations of a sheet on probabilities instead of numbers.

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
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.sheets.description import StepFunction

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
    if isinstance(tau, ca.SX) or 2 * max(_WIDEST, abs(edge)) / tau > _LARGEST_EXPONENT:
        # The tanh form cannot overflow at any scale.
        return 0.5 + 0.5 * ca.tanh(x * (1 / tau) - edge / tau)
    # All edges of a joint share one exponential. Simplifying the whole expression merges it.
    scale = math.exp(-2 * edge / tau)
    return scale / (scale + ca.exp(x * (-2 / tau)))


def of_step(step: StepFunction, x: ca.SX, tau: float | ca.SX) -> Distribution:
    """Return the distribution of a step function's score if its joint has noise of scale tau.

    Args:
        step: the bands.
        x: the joint's angle [rad].
        tau: scale of the logistic noise [rad].
    """
    beyond = [1, *(past(x, edge, tau) for edge in step.edges), 0]
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


def certain(score: int) -> Distribution:
    """Return the distribution of a known score."""
    return {score: ca.SX(1)}


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


def _sum(terms: Iterable[ca.SX]) -> ca.SX:
    return sum(terms, start=ca.SX(0))
