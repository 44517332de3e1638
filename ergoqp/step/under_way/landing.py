"""The landing pose, and the distance that each hard row can count on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import ProblemError
from ergoqp.expressions.linear import Shape, by_name, dense, vectors
from ergoqp.expressions.rigid import shifted
from ergoqp.limits import Limit, Situation
from ergoqp.step.model import StepModel
from ergoqp.step.robot_watch.memory import ASTRAY
from ergoqp.step.under_way.motion import UnderWay


def landing(
    model: StepModel, found: UnderWay, known: Mapping[str, ca.MX], shape: Shape = vectors
) -> dict[str, ca.MX]:
    """Return ``landed`` (4, 4), the landing pose, and ``way``: see `WayLayout`.

    The declared values of a robot are upper bounds: any share of each piece may be done already. So
    a piece that leads away from an end does not count, and a piece that leads to it counts in full.

    Args:
        model: model of the step.
        found: the motion under way.
        known: ``readings``; ``pose`` as measured, or as far as it is known (4, 4), and ``astray``:
            how far the object may be from it, see `ergoqp.step.robot_watch.memory.ASTRAY`. If the
            declared
            robot may be late also ``doubt``: how far the object may be behind this pose, along each
            axis and against it (6, 2) [m, rad].
        shape: how functions are written, see `ergoqp.expressions.linear`.
    """
    if not model.under_way.count:
        return {"landed": known["pose"], "way": found.total}
    given = {name: part for name, part in found.parts.items() if name in _PARTS}
    if "doubt" in known:
        given["doubt"] = known["doubt"]
    given |= {name: known[name] for name in ("astray", "readings")}
    symbols = {name: ca.MX.sym(name, part.sparsity()) for name, part in given.items()}
    at = ca.MX.sym("pose", 4, 4)
    outputs = _counted(model, at, symbols)
    inputs, names = [at, *symbols.values()], ["pose", *symbols]
    function = ca.Function("way", inputs, outputs, names, ["landed", "way"])
    return by_name(shape(function), {**known, **given}, written=True)


_PARTS: Final = ("total", "twists", "seconds", "weights", "tail", "clung", "turn")


def _counted(model: StepModel, pose: ca.MX, found: Mapping[str, ca.MX]) -> list[ca.MX]:
    problem, robot, parts_of = model.problem, model.problem.robot, model.under_way
    landed, rows, off = _hard_rows(model)(pose, found["total"], found["readings"], found["astray"])
    done = rows @ found["twists"]
    # The part of each piece that leads to the upper ends, and to the lower ends.
    toward = ca.fmax(done, 0)
    toward = ca.vertcat(toward, toward - done)
    sums, many, law = toward @ found["seconds"], rows.shape[0], problem.stop
    if "tail" in found:
        sums += _along(rows, found["tail"])
    # A piece that leads to one end does not count at the other end.
    up, down = sums[:many], sums[many:]
    below, above = up, down
    n = found["weights"].numel() if "weights" in found else 0
    if n:
        # The addition of a mean that still rises toward the last planned twist, see
        # `ergoqp.limits.stop.Stop`.
        rise = ca.fmax(ca.repmat(toward[:, 0], 1, n) - toward[:, :n], 0) @ (
            law.stretch * law.longest * found["weights"]
        )
        below, above = below + rise[many:], above + rise[:many]
    angles = stray = raised = ca.MX(0)
    if robot.longest_hold or parts_of.strays:
        angles = ca.sqrt(ca.sum1(found["twists"][3:, :] ** 2))
    if parts_of.strays:
        # A path of length L with a chord c deviates from the chord by at most sqrt(L^2 - c^2) / 2.
        # Turns do not commute: one after the other, they differ from the turn of their sum by the
        # area between path and chord.
        length = angles @ found["seconds"]
        if "tail" in found:
            length += ca.norm_2(found["tail"][3:, 0] + found["tail"][3:, 1])
        stray = (
            (1 + robot.gain_error)
            / 2
            * ca.sqrt(ca.fmax(length**2 - ca.sumsqr(found["total"][3:]), 0))
        )
        above += (1 + robot.gain_error) * stray * length * ca.DM(parts_of.bends)
        turns = found["twists"][3:, :n]
        rises = ca.sqrt(ca.sum1((ca.repmat(turns[:, 0], 1, n) - turns) ** 2))
        raised = law.stretch * law.longest * (rises @ found["weights"])
    if "doubt" in found:
        # The object may be behind its computed pose by this much along each axis.
        back = _along(rows, found["doubt"])
        below, above = below + back[:many], above + back[many:]
    if robot.gain_error:
        below, above = below + robot.gain_error * down, above + robot.gain_error * up
    if robot.noise.any():
        # The noise counts twice for a row that touches a region at the point nearest to the pose:
        # for the distance and for the direction. With both, it is never measured inside.
        astray = np.linalg.norm(robot.noise[:3]) * np.array(parts_of.tangents, float)
        aside = ca.fabs(rows) @ ca.DM(robot.noise) + ca.DM(astray)
        below, above = below + aside, above + aside
    parts = [found["total"], below + off[many:], above + off[:many]]
    # The error of a measured turn counts like a turn that may be done already or not.
    turn = found.get("turn", 0) + ca.MX(np.linalg.norm(robot.noise[3:]))
    if "doubt" in found:
        turn += ca.norm_2(ca.fmax(found["doubt"][3:, 0], found["doubt"][3:, 1]))
    if parts_of.turns:
        parts.append(turn)
    if parts_of.strays:
        parts += [stray, raised]
    if robot.longest_hold:
        hold = robot.longest_hold * (1 + robot.gain_error)
        held, turned = hold * _most(toward), hold * _most(angles)
        if "clung" in found:
            clung = (1 + robot.gain_error) * found["clung"]
            held, turned = (
                ca.fmax(held, _along(rows, clung)),
                ca.fmax(turned, ca.norm_2(clung[3:, 0] + clung[3:, 1])),
            )
        parts += [below + held[many:], above + held[:many], turn + turned]
    return [landed, ca.densify(ca.vertcat(*parts))]


def off_rows(rows: ca.SX, astray: ca.SX, limits: Sequence[Limit]) -> tuple[ca.SX, ca.SX]:
    """Return how much nearer to the ends (upper, lower) of rows (m, 6) an object may be.

    An object that is turned by an angle, and turns on as commanded, keeps this angle to the
    computed one. So no row of its orientation changes by more; an angle neither where it has no
    slope, in the middle of a cone. The direction of a row that touches a region follows from the
    computed position, and its distance changes by at most the way to the true one.

    Args:
        rows: rows at the computed pose.
        astray: how far the object may be from there, see `ergoqp.step.robot_watch.memory.ASTRAY`.
        limits: the limits of these rows, in order.
    """
    along, against, angle = astray[:3], astray[3:6], astray[6]
    farthest = ca.norm_2(ca.fmax(along, against))
    of_rows = [limit for limit in limits for _ in limit.names]
    upper, lower = [], []
    for row, limit in zip(ca.vertsplit(rows), of_rows, strict=True):
        turn = angle * ca.norm_2(row[3:]) if row[3:].nnz() else 0
        if getattr(limit, "bend", 0.0) and limit.unit == "rad":
            turn = angle
        ahead, back = ca.fmax(row[:3], 0), ca.fmax(-row[:3], 0)
        for ends, one, other in ((upper, along, against), (lower, against, along)):
            tangent = getattr(limit, "tangent", False)
            ends.append(turn + (farthest if tangent else ahead @ one + back @ other))
    return ca.vertcat(*upper), ca.vertcat(*lower)


def _along(rows: ca.MX, ways: ca.MX) -> ca.MX:
    """Return how far displacements (6, 2) lead to the ends of rows (m, 6), upper ends first.

    The displacements are those along each axis and against it.
    """
    ahead, back = ca.fmax(rows, 0), ca.fmax(-rows, 0)
    return ca.vertcat(
        ahead @ ways[:, 0] + back @ ways[:, 1], ahead @ ways[:, 1] + back @ ways[:, 0]
    )


def _most(values: ca.MX) -> ca.MX:
    """Return the largest positive entry of each row, or 0."""
    most = ca.MX(ca.DM.zeros(values.shape[0]))
    for column in ca.horzsplit(values):
        most = ca.fmax(most, column)
    return most


def _hard_rows(model: StepModel) -> ca.Function:
    """Return the hard rows where the object lands.

    Returns:
        Function ``(pose, displacement under way (6,), readings, astray) -> (landed, matrices (h,
        6), distance (2 h,) that cannot be counted on, to the upper ends and then to the lower
        ones)``.
    """
    n, problem = len(model.problem.coordinates), model.problem
    pose, total = ca.SX.sym("pose", 4, 4), ca.SX.sym("total", 6)
    posture, S = ca.SX.sym("posture", n), ca.SX.sym("S", n, 6)
    landed, readings = shifted(pose, total), ca.SX.sym("readings", *model.size("readings"))
    situation = Situation(
        posture,
        ca.SX.ones(n),
        landed,
        S,
        ca.SX(6, 1),
        ca.SX(6, 1),
        readings=model.by_limit(readings),
        surface=problem.surface,
        ahead=total,
    )
    rows = ca.vertcat(*(limit.rows(situation).matrix for limit in model.under_way.limits))
    if ca.depends_on(rows, ca.vertcat(posture, ca.vec(S))):
        names = ", ".join(model.under_way.names)
        raise ProblemError(
            f"limits: got a hard row among {names} that follows the posture, allowed rows of the"
            " object only"
        )
    astray = ca.SX.sym("astray", ASTRAY)
    lost = ca.vertcat(*off_rows(rows, astray, model.under_way.limits))
    inputs = [pose, total, readings, astray]
    return ca.Function("hard_rows", inputs, dense([landed, rows, lost]))
