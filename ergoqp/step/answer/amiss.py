"""Which terms of the problem gave no usable number in a step.

A minimum drops NaN, so a limit whose margin is NaN would never be broken. The step detects NaN by
comparisons that fail with it, and then finds here which terms it came from.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca

from ergoqp.limits.limit import Expression
from ergoqp.step.model import PLACE, StepModel
from ergoqp.step.program.margins import with_nan

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
