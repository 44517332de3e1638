"""The QP of a step, in locking passes.

Each pass solves, locks joints that would leave their range, and solves again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import Shape, by_name, is_set, written_out
from ergoqp.solvers.solver import QpSolver
from ergoqp.step.model import StepModel
from ergoqp.step.program.data import QP_DATA, pass_data
from ergoqp.step.program.qp import TOLERANCE, build_qp

PASSES: Final = 3
"""Largest number of locking passes."""

_PULL: Final = ("pull_H", "pull_g")


def solve_passes(
    model: StepModel, solver: QpSolver, known: Mapping[str, ca.MX], shape: Shape
) -> dict[str, ca.MX]:
    """Return the answer of the QP after as many passes as there are joints to lock.

    Args:
        model: model of the step.
        solver: solver of the QP.
        known: the inputs of `ergoqp.step.program.data.pass_data` except the lock; with a guide also
            ``pull_H`` and ``pull_g``, which are added to the objective.
        shape: how functions are written, see `ergoqp.expressions.linear`.

    Returns:
        ``xi`` (6,), ``S`` and ``E`` of the last pass, ``slack`` and ``multipliers`` of the movable
        rows, the largest ``residual`` of the QP, which joints are ``locked``, whether there are
        more to lock, and ``shift``, see `ergoqp.limits.Situation`.
    """
    one_pass = _one_pass(model, solver, shape)
    unlocked = {"locked": ca.MX(ca.DM.zeros(*model.size("locked"))), "final": ca.MX(0)}
    first = by_name(one_pass, {**known, **unlocked}, written=True)
    fixed = [known[name] for name in one_pass.name_in()[:-2]]
    found = written_out(_further_passes(model, one_pass, 1), *fixed, *first.values())
    result = dict(zip(first, found, strict=True))
    return result | {"locked": result.pop("next_locked")}


def _further_passes(model: StepModel, one_pass: ca.Function, number: int) -> ca.Function:
    """``(inputs of a pass, its result) -> result`` after the passes that joints to lock require.

    Each pass is inside the branch of the one before. So a step without such a joint checks only
    once.
    """
    inputs = [ca.MX.sym("i", one_pass.sparsity_in(i)) for i in range(one_pass.n_in() - 2)]
    result = [ca.MX.sym("r", one_pass.sparsity_out(i)) for i in range(one_pass.n_out())]
    named = dict(zip(one_pass.name_out(), result, strict=True))
    last = number == PASSES - 1
    next_one = list(one_pass(*inputs, named["next_locked"], float(last)))
    if last:
        after = next_one
    else:
        after = list(_further_passes(model, one_pass, number + 1)(*inputs, *next_one))
    again = ca.Function("again", [*inputs, *result], after)
    enough = ca.Function("enough", [*inputs, *result], result)
    choose = ca.Function.if_else("next_pass", again, enough)
    everything = list(choose(model.if_needed(named["newly"]), *inputs, *result))
    return ca.Function("further_passes", [*inputs, *result], everything)


def _one_pass(model: StepModel, solver: QpSolver, shape: Shape) -> ca.Function:
    """Return one QP with a given lock set; the last inputs are ``locked`` and ``final``."""
    data = shape(pass_data(model))
    names = [*data.name_in()[:-2], *(_PULL if model.guided else ()), "locked", "final"]
    mx = model.symbols(names, ca.MX)
    found = by_name(data, mx, written=True)
    if model.guided:
        found |= {"H": found["H"] + mx["pull_H"], "g": found["g"] + mx["pull_g"]}
    exact = np.flatnonzero(model.values("hard")[model.movable])
    qp = build_qp(solver, len(model.movable), shape, exact.tolist(), model.if_needed)
    answer = dict(zip(_ANSWER, written_out(qp, *(found[name] for name in QP_DATA)), strict=True))
    # Solvers keep bounds up to their tolerance. The twist bounds must hold exactly.
    xi = ca.fmin(ca.fmax(answer["xi"], found["lb"]), found["ub"])
    lock = shape(_newly_locked(model))
    newly = by_name(lock, {**mx, **answer, "xi": xi, "S": found["S"]}, written=True)["newly_locked"]
    result = {
        "xi": xi,
        "S": found["S"],
        "E": found["E"],
        "slack": answer["slack"],
        "multipliers": answer["multipliers"],
        "residual": answer["residual"],
        "next_locked": ca.fmax(mx["locked"], newly),
        "newly": ca.mmax(newly),
        "shift": found["shift"],
    }
    return ca.Function("one_pass", list(mx.values()), list(result.values()), list(mx), list(result))


_ANSWER: Final = ("xi", "slack", "multipliers", "residual")


def _newly_locked(model: StepModel) -> ca.Function:
    """Return the function for unlocked joints at their end that would move outward."""
    mx = model.symbols(("posture", "observed", "readings", "locked", "S", "xi", "residual"), ca.MX)
    known = {name: mx[name] for name in ("posture", "observed", "readings")}
    situation = model.situation(known, mx["S"])
    outward = ca.MX(ca.DM.zeros(*model.size("locked")))
    for limit in model.problem.row_limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        rate = rows.matrix @ mx["xi"]
        up = ca.logic_and(rows.above < limit.yield_zone, rate > 1e-6)
        down = ca.logic_and(rows.below < limit.yield_zone, rate < -1e-6)
        outward = ca.logic_or(outward, ca.logic_or(up, down))
    free = ca.logic_and(outward, ca.logic_not(is_set(mx["locked"])))
    newly = ca.densify(ca.logic_and(free, mx["residual"] < TOLERANCE))
    return ca.Function("newly_locked", list(mx.values()), [newly], list(mx), ["newly_locked"])
