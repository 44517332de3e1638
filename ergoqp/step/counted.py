"""Where the object lands, and how much of its distance to each end a hard row can count on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.errors import ProblemError
from ergoqp.expressions.linear import Shape, vectors, written_out
from ergoqp.expressions.rigid import shifted
from ergoqp.limits import Situation
from ergoqp.problem.problem import Problem
from ergoqp.step.history import owes
from ergoqp.step.way import UnderWay


def _counts(problem: Problem) -> int:
    """How many hard rows have less than their distance to count on."""
    robot = problem.robot
    uncounted = problem.average or owes(problem) or robot.noise.any() or robot.longest_hold
    return len(hard_names(problem)) if uncounted else 0


def hard_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of the rows on the object side."""
    return tuple(name for limit in problem.row_limits if limit.hard for name in limit.names)


def way_size(problem: Problem) -> int:
    """Return how many numbers say what is under way: see `split_way`."""
    return sum(_sizes(problem))


def _sizes(problem: Problem) -> list[int]:
    """Sizes of the parts of that vector, in the order of `Way`."""
    count, held = _counts(problem), problem.robot.longest_hold > 0
    if not count:
        return [6]
    bent = [1] * (_turns(problem) + 2 * _strays(problem))
    return [6, count, count, *bent, *([count, count, 1] if held else [])]


def _turns(problem: Problem) -> bool:
    """Whether the object may be turned otherwise than it lands."""
    return owes(problem) or bool(problem.robot.pose_noise_deg)


def _strays(problem: Problem) -> bool:
    """Whether the way under way can turn the object about more than one axis, and a row bends."""
    return problem.average > 0 and any(_bends(problem))


def _bends(problem: Problem) -> list[bool]:
    """Whether each hard row bends."""
    hard = (limit for limit in problem.row_limits if limit.hard)
    return [bool(getattr(limit, "bend", 0.0)) for limit in hard for _ in limit.names]


@dataclass(frozen=True)
class Way:
    """What is under way, for `ergoqp.limits.Situation`.

    Attributes:
        ahead: displacement (6,) [m, rad].
        lost: what cannot be counted on of the distance to the (lower, upper) ends, by hard limit.
        turn: angle that a robot may have done already, and by which its pose may be mistaken [rad];
            None: there is none.
        stray: by which angle it leaves the straight line at most [rad]; None: no row bends.
        raised: which angle a mean that rises adds at most [rad]; None: no row bends.
        lost_held: as `lost`, where the robot holds on once with what is under way, if that is
            declared.
        turn_held: and as `turn`.
    """

    ahead: Any
    lost: dict[str, tuple[Any, Any]]
    turn: Any
    stray: Any
    raised: Any
    lost_held: dict[str, tuple[Any, Any]]
    turn_held: Any


def split_way(problem: Problem, way: Any) -> Way:
    """Return what is under way from the vector that `way_of` makes of it."""
    ends = np.cumsum([0, *_sizes(problem)]).tolist()
    ahead, *parts = (way[start:end] for start, end in pairwise(ends))
    if not parts:
        return Way(ahead, {}, None, None, None, {}, None)
    bent = iter(parts[2:])
    lost = _by_limit(problem, *parts[:2])
    strays = _strays(problem)
    turn, stray, raised = (
        next(bent) if there else None for there in (_turns(problem), strays, strays)
    )
    if not problem.robot.longest_hold:
        return Way(ahead, lost, turn, stray, raised, lost, turn)
    return Way(ahead, lost, turn, stray, raised, _by_limit(problem, *parts[-3:-1]), parts[-1])


def _by_limit(problem: Problem, below: Any, above: Any) -> dict[str, tuple[Any, Any]]:
    found, start = {}, 0
    for limit in problem.row_limits:
        if limit.hard:
            end = start + len(limit.names)
            found[limit.names[0]] = below[start:end], above[start:end]
            start = end
    return found


def way_of(
    problem: Problem,
    found: UnderWay,
    pose: ca.MX,
    unsure: ca.MX | None = None,
    shape: Shape = vectors,
) -> tuple[ca.MX, ca.MX]:
    """Return (where the object lands (4, 4), what is under way as numbers, see `split_way`).

    A robot is declared by its upper ends: any share of each piece may be done already. So a piece
    that leads away from an end is not counted on, and one that leads to it counts in full.

    Args:
        problem: the task.
        found: what is under way.
        pose: as measured, or as far as it is known (4, 4).
        unsure: how far the object may be behind that, along each axis and against it (6, 2) [m,
            rad]; None: not at all.
        shape: how functions are written, see `ergoqp.expressions.linear`.
    """
    if not _counts(problem):
        return pose, found.total
    given = {
        name: part for name, part in vars(found).items() if name in _PARTS and part is not None
    }
    if unsure is not None:
        given["unsure"] = unsure
    symbols = {name: ca.MX.sym(name, part.sparsity()) for name, part in given.items()}
    at = ca.MX.sym("pose", 4, 4)
    function = ca.Function("way", [at, *symbols.values()], _counted(problem, at, symbols))
    landed, way = written_out(shape(function), pose, *given.values())
    return landed, way


_PARTS: Final = ("total", "twists", "seconds", "weights", "tail", "clung", "turn")


def _counted(problem: Problem, pose: ca.MX, found: Mapping[str, ca.MX]) -> list[ca.MX]:
    robot = problem.robot
    landed, rows = _hard_rows(problem)(pose, found["total"])
    done = rows @ found["twists"]
    # Of each piece, what leads to the upper ends, and to the lower ones.
    toward = ca.fmax(done, 0)
    toward = ca.vertcat(toward, toward - done)
    sums, many, law = toward @ found["seconds"], rows.shape[0], problem.stop
    if "tail" in found:
        sums += _along(rows, found["tail"])
    # A piece that leads to one end is not counted on at the other.
    up, down = sums[:many], sums[many:]
    below, above = up, down
    n = found["weights"].numel() if "weights" in found else 0
    if n:
        # What a mean that still rises toward the last planned twist adds, see
        # `ergoqp.limits.stop.Stop`.
        rise = ca.fmax(ca.repmat(toward[:, 0], 1, n) - toward[:, :n], 0) @ (
            law.stretch * law.longest * found["weights"]
        )
        below, above = below + rise[many:], above + rise[:many]
    angles = stray = raised = ca.MX(0)
    if robot.longest_hold or _strays(problem):
        angles = ca.sqrt(ca.sum1(found["twists"][3:, :] ** 2))
    if _strays(problem):
        # A way of length L that leads c far leaves its chord by at most sqrt(L^2 - c^2) / 2. Turns
        # do not commute: done one by one, they differ from the turn of their sum by the area
        # between way and chord.
        length = angles @ found["seconds"]
        if "tail" in found:
            length += ca.norm_2(found["tail"][3:, 0] + found["tail"][3:, 1])
        stray = (
            (1 + robot.gain_error)
            / 2
            * ca.sqrt(ca.fmax(length**2 - ca.sumsqr(found["total"][3:]), 0))
        )
        above += (1 + robot.gain_error) * stray * length * ca.DM(_bends(problem))
        turns = found["twists"][3:, :n]
        rises = ca.sqrt(ca.sum1((ca.repmat(turns[:, 0], 1, n) - turns) ** 2))
        raised = law.stretch * law.longest * (rises @ found["weights"])
    if "unsure" in found:
        # The object may be so much less far along each axis than it is reckoned.
        back = _along(rows, found["unsure"])
        below, above = below + back[:many], above + back[many:]
    if robot.gain_error:
        below, above = below + robot.gain_error * down, above + robot.gain_error * up
    if robot.noise.any():
        aside = ca.fabs(rows) @ ca.DM(robot.noise)
        below, above = below + aside, above + aside
    parts = [found["total"], below, above]
    # A turn that is measured with an error is one that may have been done, or not.
    turn = found.get("turn", 0) + ca.MX(np.linalg.norm(robot.noise[3:]))
    if "unsure" in found:
        turn += ca.norm_2(ca.fmax(found["unsure"][3:, 0], found["unsure"][3:, 1]))
    if _turns(problem):
        parts.append(turn)
    if _strays(problem):
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


def _along(rows: ca.MX, ways: ca.MX) -> ca.MX:
    """How far ways (6, 2) lead to the upper ends of rows (m, 6), and then to the lower ones.

    The ways are those along each axis and against it.
    """
    ahead, back = ca.fmax(rows, 0), ca.fmax(-rows, 0)
    return ca.vertcat(
        ahead @ ways[:, 0] + back @ ways[:, 1], ahead @ ways[:, 1] + back @ ways[:, 0]
    )


def _most(values: ca.MX) -> ca.MX:
    """The largest positive entry of each row."""
    most = ca.MX(ca.DM.zeros(values.shape[0]))
    for column in ca.horzsplit(values):
        most = ca.fmax(most, column)
    return most


def _hard_rows(problem: Problem) -> ca.Function:
    """``(pose, displacement under way (6,)) -> (landed, matrices (h, 6) of hard rows there)``."""
    n = len(problem.coordinates)
    pose, total = ca.SX.sym("pose", 4, 4), ca.SX.sym("total", 6)
    posture, S = ca.SX.sym("posture", n), ca.SX.sym("S", n, 6)
    landed = shifted(pose, total)
    situation = Situation(
        posture, ca.SX.ones(n), landed, S, ca.SX(6, 1), ca.SX(6, 1), surface=problem.surface
    )
    rows = ca.densify(
        ca.vertcat(*(limit.rows(situation).matrix for limit in problem.row_limits if limit.hard))
    )
    if ca.depends_on(rows, ca.vertcat(posture, ca.vec(S))):
        names = ", ".join(hard_names(problem))
        raise ProblemError(
            f"limits: got a hard row among {names} that follows the posture, allowed rows of the"
            " object only"
        )
    return ca.Function("hard_rows", [pose, total], [ca.densify(landed), rows])
