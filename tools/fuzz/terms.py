"""Users' terms of the fuzzer that give no number in a part of their domain, and where that is.

The cost, the response or a limit of a user becomes NaN or infinite in a band: of one joint's angle,
or of one coordinate of the object. The band is either switched on after the problem was made, or
lies where the trials of the construction (`ergoqp.problem.validate`, `ergoqp.limits.custom`) do not
draw: a problem that is refused is drawn again. `Spoiled` says in numpy what a step has to name.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.errors import ProblemError
from ergoqp.joints import INDEX, JOINTS
from ergoqp.limits import LimitContext, Rows, WorkspaceBox
from ergoqp.limits.limit import straight_margins
from ergoqp.problem.problem import Problem

Rng = np.random.Generator

_ROUNDING: Final = 1e-7
"""So near an end of a band both answers are right [rad, m]."""

_PARTS: Final = ("to_lower", "to_upper", "rate", "curvature_margin", "matrix", "margins", "ahead")
"""Numbers of a limit; ``ahead``: its margins where a displacement leads into the band."""


@dataclass
class Band:
    """Where a term gives no number.

    Attributes:
        at: number of the joint or of the object's coordinate.
        low: lower end [rad, m].
        high: upper end [rad, m].
        bad: what the term gives within.
        on: whether it does so already.
    """

    at: int
    low: float
    high: float
    bad: float = np.nan
    on: bool = False

    def inward(self, of: Any) -> Any:
        """Return the expression of how deep the entry of `of` is within the band."""
        return ca.fmin(of[self.at] - self.low, self.high - of[self.at])

    def instead(self, value: Any, of: Any) -> Any:
        """Return an expression, or what is bad where the entry of `of` is within the band."""
        return ca.if_else(self.inward(of) > 0, self.bad, value) if self.on else value

    def depth(self, values: np.ndarray) -> float:
        """How deep an entry is within the band; negative outside."""
        return float(min(values[self.at] - self.low, self.high - values[self.at]))


class _Wrapped:
    """A term with the members of another one."""

    def __init__(self, usual: Any, band: Band, part: str) -> None:
        self._usual, self._band, self._part = usual, band, part

    def __getattr__(self, name: str) -> Any:
        """Return a member of the other term."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._usual, name)


class SpoiledCost(_Wrapped):
    """A cost of which the value, or the slope alone, is no number in a band of one joint."""

    def __call__(self, postures: Any) -> np.ndarray:
        """Return the costs of postures (n, 32)."""
        return self._usual(postures)

    def expression(self, q: Any) -> Any:
        """Return the expression of a posture (32,)."""
        value = self._usual.expression(q)
        if self._part == "slope":
            # The root of zero has no slope.
            return value + ca.sqrt(ca.fmax(0, -self._band.inward(q))) if self._band.on else value
        return self._band.instead(value, q)


class SpoiledResponse(_Wrapped):
    """A response of which one entry, of S or E, is no number in a band of one joint."""

    def expression(self, q: Any) -> Any:
        """Return S (32, 6) of a posture (32,)."""
        return self.sensitivity()(q, 0)[0]

    def sensitivity(self) -> ca.Function:
        """Return ``(posture, locked) -> (S, E)``."""
        q, locked = ca.SX.sym("q", 32), ca.SX.sym("locked", 32)
        S, E = (ca.SX(part) for part in self._usual.sensitivity()(q, locked))
        if self._part == "S":
            row = INDEX[self._usual.joints[0]]
            S[row, 0] = self._band.instead(S[row, 0], q)
        else:
            E[0, 0] = self._band.instead(E[0, 0], q)
        return ca.Function("sensitivity", [q, locked], [ca.densify(S), ca.densify(E)])


@dataclass(frozen=True, eq=False)
class SpoiledLimit:
    """A limit far away, of which one number is none in a band.

    Attributes:
        names: name of its row.
        hard: whether it is one of the object, else of the posture.
        band: where.
        part: one of `_PARTS`.
    """

    names: tuple[str]
    hard: bool
    band: Band
    part: str
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    unit: str = "m"
    recovers: tuple[bool] = (False,)
    yield_zone: float = 0.0
    margin_is_lower_bound: bool = False
    linear: bool = False

    def measure(self) -> None:
        """Return nothing: it needs no reading."""

    def _instead(self, value: Any, context: LimitContext) -> Any:
        of = context.pose[:3, 3] if self.hard else context.posture
        return self.band.instead(value, of)

    def rows(self, context: LimitContext) -> Rows:
        """Return the one row."""
        at = self.band.at
        if self.hard:
            place, matrix = context.pose[at, 3], ca.SX(1, 6)
            matrix[0, at] = 1
        else:
            place, matrix = (
                context.posture[at] + context.shift[at],
                context.sensitivity[at, :],
            )
        zero = 0 * place
        ends = {
            "to_lower": 200 + place,
            "to_upper": 200 - place,
            "rate": zero + ca.inf,
            "curvature_margin": zero,
        }
        if self.part in ends:
            ends[self.part] = self._instead(ends[self.part], context)
        if self.part == "matrix":
            matrix = self._instead(ca.densify(matrix), context)
        rows = Rows(matrix, **ends)
        return context.reduced(self.names[0], rows) if self.hard else rows

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        """Return the margin (1,) after a displacement (6,)."""
        least = straight_margins(self.rows(context), displacement)
        if self.part == "ahead" and self.hard:
            return self.band.instead(least, context.pose[:3, 3] + displacement[:3])
        return self._instead(least, context) if self.part in ("margins", "ahead") else least


@dataclass(frozen=True)
class Spoiled:
    """What a step has to say of a problem's own term.

    Attributes:
        words: with which its reason names the term; empty: every term gives numbers.
        band: where it gives none.
        of_object: whether the band is one of the object's place, else of the posture.
        stop: how far a stop leads at most, if the band counts there too (6,) [m, rad].
        ahead: words for a cost that gives no number where the step looks ahead.
    """

    words: str = ""
    band: Band = field(default_factory=lambda: Band(0, 0.0, 0.0))
    of_object: bool = False
    stop: np.ndarray = field(default_factory=lambda: np.zeros(6))
    ahead: str = ""

    def must(self, posture: np.ndarray, pose: np.ndarray) -> bool:
        """Whether a step has to brake: the term is no number here."""
        return bool(self.words) and self._depth(posture, pose) > _ROUNDING

    def may(self, posture: np.ndarray, pose: np.ndarray, under_way: np.ndarray) -> bool:
        """Whether a step may name the term: it is no number here, where the object lands or stops.

        Args:
            posture: joint angles (32,) [rad].
            pose: of the object (4, 4).
            under_way: by how much the object may move on yet (6,) [m, rad].
        """
        on = float((under_way + self.stop)[self.band.at]) if self.of_object else 0.0
        return bool(self.words) and self._depth(posture, pose) > -_ROUNDING - on

    def may_ahead(self, posture: np.ndarray, rate: np.ndarray) -> bool:
        """Whether a cost may be named for a value ahead; `rate` is the largest of each joint."""
        return (
            bool(self.ahead) and self._depth(posture, np.eye(4)) > -_ROUNDING - rate[self.band.at]
        )

    def _depth(self, posture: np.ndarray, pose: np.ndarray) -> float:
        return self.band.depth(pose[:3, 3] if self.of_object else posture)


def spoiled(problem: Problem, rng: Rng) -> tuple[Problem, Spoiled]:
    """Return a problem of which one term gives no number somewhere, and where that is."""
    while True:
        made, spoils = _drawn(problem, rng, rng.random() < 0.5)
        if made is not None:
            spoils.band.on = True
            return made, spoils


_KINDS: Final = ("cost", "slope", "S", "E", "object", "posture")


def _drawn(problem: Problem, rng: Rng, on: bool) -> tuple[Problem | None, Spoiled]:
    """Return a problem with a spoiled term, None if the construction refuses it."""
    response: Any = problem.response
    kind = _KINDS[rng.choice(len(_KINDS), p=[0.2, 0.1, 0.1, 0.1, 0.3, 0.2])]
    band = _of_object(problem, rng) if kind == "object" else _of_posture(response.comfort, rng)
    band.on = on
    try:
        if kind == "cost":
            band.bad = float(rng.choice([np.nan, np.inf, -np.inf, 1e200]))
            cost = SpoiledCost(problem.cost, band, kind)
            told = Spoiled("cost: got a value of", band, ahead="cost: got a value on the way ahead")
            made = problem.replace(cost=cost)
        elif kind == "slope":
            # The slope along joints that the object does not move is not used.
            if JOINTS[band.at] not in response.joints:
                return None, Spoiled()
            made = problem.replace(cost=SpoiledCost(problem.cost, band, kind))
            told = Spoiled("cost: got a slope of", band)
        elif kind in ("S", "E"):
            band.bad = float(rng.choice([np.nan, np.inf]))
            made = problem.replace(response=SpoiledResponse(response, band, kind))
            part = "a sensitivity" if kind == "S" else "contact motion that cannot be followed"
            told = Spoiled(f"response: got {part} that is NaN or infinite", band)
        else:
            hard, part = kind == "object", str(rng.choice(_PARTS))
            name = "beam" if hard else "strain"
            limit = SpoiledLimit((name,), hard, band, part, unit="m" if hard else "rad")
            made = problem.replace(limits=[*problem.limits, limit])
            words = f"limits: got NaN in rows or margins of {name}, allowed numbers"
            told = Spoiled(words, band, hard, _stop(problem) * (part == "ahead"))
    except ProblemError:
        return None, Spoiled()
    return made.replace(name=f"{problem.name} {band.bad} of {kind}"), told


def _stop(problem: Problem) -> np.ndarray:
    """Return how far the object can move at most (6,) until it stands, by more than it does."""
    limit, robot = problem.twist_limit, problem.robot
    seconds = float(np.max(limit.speed / limit.acceleration)) / 2
    seconds += 2 * problem.average + 6 * problem.dt + robot.longest_hold
    return (1 + robot.gain_error) * limit.speed * seconds


def _of_posture(comfort: Any, rng: Rng) -> Band:
    """Return a band of one joint near the comfort posture."""
    joint = int(rng.integers(len(JOINTS)))
    middle = float(comfort[joint]) + np.radians(15) * rng.normal()
    half = np.radians(rng.uniform(1, 15))
    return Band(joint, middle - half, middle + half)


def _of_object(problem: Problem, rng: Rng) -> Band:
    """Return a band of one coordinate of the place where the object moves."""
    box, axis = problem.limit_of(WorkspaceBox), int(rng.integers(3))
    response: Any = problem.response
    middle = float(np.array(response.contact()(response.comfort)[0])[axis, 3])
    ends = (middle - 0.3, middle + 0.3) if box is None else (box.lower[axis], box.upper[axis])
    centre, half = rng.uniform(*ends), rng.uniform(0.002, 0.1)
    return Band(axis, centre - half, centre + half)
