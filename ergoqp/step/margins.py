"""All rows of a step at once, as vectors, and which terms of the problem gave no number.

All rows of a step at once, as vectors; curved rows go through functions of scalars.

An interpreter computes a vector of forty numbers in the time of four scalars. It computes the few
dozen scalar operations of a curved row in the time of one vector.

Which terms of the problem gave no usable number in a step.

A minimum drops NaN, so a limit whose margin is NaN would never be broken. The step detects NaN by
comparisons that fail with it, and then finds here which terms it came from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import casadi as ca

from ergoqp.expressions.linear import by_name, dense, marked
from ergoqp.limits import Limit, Rows, Situation
from ergoqp.limits.limit import Expression
from ergoqp.step.model import PLACE, StepModel

_HERE = ("posture", "observed", "readings", "pose", "S")
_LANDED = ("posture", "observed", "readings", "landed", "way", "shift", "S")


class Margins:
    """The rows of all limits at the present pose, and their margins from the landing pose.

    Attributes:
        matrices: rate of each quantity per twist, (m, 6) for each limit.
        rates: largest allowed rate, (m,) for each limit; inf if there is none.
        now: present margin of every row (r,).
    """

    def __init__(self, model: StepModel, known: Mapping[str, ca.MX]) -> None:
        """Compute the rows of all limits once.

        Args:
            model: model of the step.
            known: ``posture``, ``observed``, ``readings``, ``pose`` and ``S`` of this step; for
                `ahead` also ``landed``, ``way`` and ``shift``.
        """
        self._model, self._known = model, known
        situation = model.situation(here(known), known["S"])
        self.matrices, self.rates, still = [], [], []
        for limit in model.problem.row_limits:
            if _linear(limit):
                rows = limit.rows(situation)
                matrix, rate, margins = rows.matrix, rows.rate, ca.fmin(rows.below, rows.above)
                margins = with_nan(model, limit, rows, margins)
            else:
                found = by_name(_curved_here(model, limit), known)
                matrix, rate, margins = found["matrix"], found["rate"], found["margins"]
            self.matrices.append(matrix)
            self.rates.append(rate)
            still.append(margins)
        self.now = ca.vertcat(*still)

    def ahead(self, ways: ca.MX) -> ca.MX:
        """Return the smallest margin of each row (r,) on straight paths to further displacements.

        See `Stop.ways`.
        """
        situations = situations_of(self._model, self._known, self._known["S"], ways)
        found = []
        for limit in self._model.problem.row_limits:
            if _linear(limit):
                found.append(smallest_margins(limit, situations, ways))
            else:
                curved = _curved_ahead(self._model, limit, ways.shape[1])
                found.append(by_name(curved, {**self._known, "ways": ways})["margins"])
        return ca.vertcat(*found)


def _linear(limit: Limit) -> bool:
    """Return whether rows and margins accept matrices: see `ergoqp.limits.limit.Limit`."""
    return getattr(limit, "linear", False)


def _curved_here(model: StepModel, limit: Limit) -> ca.Function:
    """``(*_HERE) -> (matrix, rate, present margins)`` of one limit."""
    sx = model.symbols(_HERE)
    situation = model.situation(sx, model.sparse(sx["S"]))
    rows = limit.rows(situation)
    margins = with_nan(model, limit, rows, limit.margins(situation, ca.SX(6, 1)))
    still = [rows.matrix, rows.rate, margins]
    names = ["matrix", "rate", "margins"]
    return ca.Function("curved_here", list(sx.values()), ca.cse(dense(still)), list(sx), names)


def with_nan(model: StepModel, limit: Limit, rows: Rows, margins: Expression) -> Expression:
    """Return margins (m,) that are NaN where any number of a watched row is."""
    if limit.names[0] not in model.watched:
        return margins
    ends = (rows.below, rows.above, rows.rate, rows.reserve)
    return marked(margins, *ends, *ca.horzsplit(rows.matrix))


def _curved_ahead(model: StepModel, limit: Limit, count: int) -> ca.Function:
    """``(*_LANDED, ways) -> margins`` of one limit; ways are (6, count)."""
    sx, ways = model.symbols(_LANDED), ca.SX.sym("ways", 6, count)
    situations = situations_of(model, sx, model.sparse(sx["S"]), ways)
    margins = ca.cse(dense([smallest_margins(limit, situations, ways)]))
    names = [*sx, "ways"]
    return ca.Function("curved_ahead", [*sx.values(), ways], margins, names, ["margins"])


def situations_of(
    model: StepModel, known: Mapping[str, Expression], S: Expression, ways: Expression
) -> tuple[Situation, ...]:
    """Return the situation for each of `Stop.ways`.

    A robot that holds does so either with what is under way, or with the twist.
    """
    law = model.problem.stop
    found = [model.situation(known, S, held=held) for held in (True, False)[: 1 + bool(law.hold)]]
    if law.average:
        found = [replace(situation, lead=ways[:, -2], most=ways[:, -1]) for situation in found]
    return tuple(found)


def smallest_margins(
    limit: Limit, situations: tuple[Situation, ...], ways: Expression
) -> Expression:
    """Return the smallest margins (m,) of a limit on `Stop.ways`.

    The hold of a robot counts for hard limits only.
    """
    margins = None
    for column, situation in enumerate(situations if limit.hard else situations[:1]):
        on = limit.margins(situation, ways[:, column])
        margins = on if margins is None else marked(ca.fmin(margins, on), margins, on)
    return margins


def here(known: Mapping[str, Expression]) -> dict[str, Expression]:
    """Return the symbols of the present pose, without those of the landing pose."""
    return {name: value for name, value in known.items() if name not in ("landed", "way", "shift")}


AHEAD: Final = "a value on the way ahead"

PARTS: Final = (
    ("response", "a sensitivity"),
    ("response", "contact motion that cannot be followed"),
    ("cost", "a value"),
    ("cost", "a slope"),
    ("cost", AHEAD),
)
"""What the first entries of the output ``amiss`` stand for; one for each row of the limits follows.

An entry is 1 if that part is NaN or, except in a row, infinite.
"""

_FINITE: Final = ("S", "E", "total", "gradient", "gain")
"""What each of `PARTS` is called in the step."""


def amiss(model: StepModel, known: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return ``amiss``, see `PARTS`, and whether the answer is ``unusable`` because of it.

    Args:
        model: model of the step.
        known: what the step knows after its certification.
    """
    find = _amiss_function(model)
    none = ca.Function("none", find.mx_in(), [ca.MX(ca.DM.zeros(find.numel_out(0))), ca.MX(0)])
    choose = ca.Function.if_else("none_or_amiss", none, find)
    fine = ca.logic_and(known["whole"], known["solved"])
    flags, unusable = choose.call([fine, *(known[name] for name in find.name_in())])
    return {"amiss": flags, "unusable": unusable}


def _amiss_function(model: StepModel) -> ca.Function:
    names = dict.fromkeys((*_FINITE, "now", "ahead", "shift", *PLACE))
    mx = model.symbols(names, ca.MX)
    sums = ca.vertcat(*(ca.sumsqr(mx[name]) for name in _FINITE))
    rows = [mx["now"], mx["ahead"]]
    if model.watched:
        landed = _landed_rows(model)
        rows.append(landed(*(mx[name] for name in landed.name_in())))
    squares: Expression = sum(row**2 for row in rows)
    flags = ca.logic_not(ca.vertcat(sums < ca.inf, squares <= ca.inf))
    outputs = [ca.densify(flags), ca.mmax(flags)]
    return ca.Function("amiss", list(mx.values()), outputs, list(mx), ["amiss", "unusable"])


def _landed_rows(model: StepModel) -> ca.Function:
    """Return the function for rows (r,) at the landing pose: NaN where a watched one is, or 0."""
    sx = model.symbols((*PLACE, "shift", "S"))
    brake = model.problem.stop.braking(sx["previous"], sx["dt"])
    situation = model.situation(sx, model.sparse(sx["S"]), brake)
    zeros = ((limit, ca.SX.zeros(len(limit.names))) for limit in model.problem.row_limits)
    rows = [with_nan(model, limit, limit.rows(situation), margins) for limit, margins in zeros]
    return ca.Function("landed_rows", list(sx.values()), [ca.vertcat(*rows)], list(sx), ["rows"])
