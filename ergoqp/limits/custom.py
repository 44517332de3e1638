"""Limits of users, judged by their rows only, and whether these rows agree with each other.

Whether the rows of a user's limit agree with each other, tried at a few places. A limit with a
wrong gradient, or without the distances that must not be used, would let the object through.
Nothing else would notice before the checker of a simulation.

Limits that are judged by their rows only, such as the limits of users.

The optimum, the place search and the checker judge places and postures, not twists.
"""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import of_package
from ergoqp.errors import ErgoqpError, ProblemError, in_words
from ergoqp.limits.joints import JointLimit
from ergoqp.limits.limit import Limit, LimitContext, Rows, Surface
from ergoqp.limits.state import ArmLength, OneClassBoundary
from ergoqp.limits.workspace import AxisCone, WorkspaceBox

_PLACES: Final = 12
"""Number of places where people work, and of places farther away."""
_NEAR: Final = ((0.2, -0.4, 0.5), (0.8, 0.4, 1.7))
_WIDE: Final = ((-0.8, -0.8, 0.3), (0.8, 0.8, 1.8))
"""Corners of the boxes in which the object is tried [m]."""
_STEP: Final = 1e-5
"""Step of the central differences [m, rad]."""
_FAR: Final = 0.05
"""Displacement with which margins are tried [m, rad]."""
_EXACT: Final = 1e-3
"""Largest difference of a rate, relative to 1 + its size."""
_RATES_ROUNDING: Final = 1e-7


def _turn(vector: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) about a vector by its length [rad]."""
    # Slow to import, and only needed for terms of users.
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


@dataclass(frozen=True)
class _Place:
    """A state and what its rows say there.

    Attributes:
        posture: posture (n,) [rad].
        pose: pose of the object (4, 4) [m].
        sensitivity: S (n, 6).
    """

    posture: np.ndarray
    pose: np.ndarray
    sensitivity: np.ndarray

    def moved(self, displacement: np.ndarray) -> _Place:
        """Return the place after a displacement (6,) [m, rad] of the object."""
        pose = self.pose.copy()
        pose[:3, 3] += displacement[:3]
        pose[:3, :3] = _turn(displacement[3:]) @ pose[:3, :3]
        return replace(self, posture=self.posture + self.sensitivity @ displacement, pose=pose)


@dataclass(frozen=True)
class _Told:
    """What a limit says at a place.

    Attributes:
        matrix: rates of the rows (m, 6).
        ends: distances to the lower and the upper ends (2 m,).
        fewer: the same with 1 of each taken away.
        shifted: the same with the posture shifted.
        margins: margins of the rows after the displacement (m,).
        margins_of_fewer: margins at rest with 1 of each distance lost (m,).
        rate: largest rates (m,).
        curvature_margin: reserves (m,).
    """

    matrix: np.ndarray
    ends: np.ndarray
    fewer: np.ndarray
    shifted: np.ndarray
    margins: np.ndarray
    margins_of_fewer: np.ndarray
    rate: np.ndarray
    curvature_margin: np.ndarray

    @staticmethod
    def least(ends: np.ndarray) -> np.ndarray:
        """Return the distance of each row to its nearer end (m,)."""
        return np.minimum(*np.split(ends, 2))


_JUDGED: Final[dict[tuple[int, Any], tuple[weakref.ref[Any], Any]]] = {}
"""Terms that were judged, by identity and state, and what was found: problems are made anew."""


def judged_once(term: Any, state: Any, judge: Callable[[], Any]) -> Any:
    """Return what a judgement of a term gives, which is made once for the same object and state."""
    key = id(term), state
    known = _JUDGED.get(key)
    if known is not None and known[0]() is term:
        return known[1]
    found = judge()
    with contextlib.suppress(TypeError):  # of a class whose objects cannot be referred to weakly
        _JUDGED[key] = weakref.ref(term, lambda _: _JUDGED.pop(key, None)), found
    return found


class OwnRates:
    """The rows of one limit as a function of a place, and what they must satisfy.

    Args:
        limit: a limit whose rows have the right shapes.
        context: a symbolic context with nothing under way.
    """

    def __init__(self, limit: Limit, context: LimitContext) -> None:
        """Build the functions."""
        self.limit, self.first = limit, limit.names[0]
        n, m = context.posture.numel(), len(limit.names)
        sensitivity, shift = ca.SX.sym("sensitivity", n, 6), ca.SX.sym("shift", n)
        displacement = ca.SX.sym("displacement", 6)
        self._measure = limit.measure()
        here, readings = _with_readings(limit, replace(context, sensitivity=sensitivity))
        lost = replace(here, margin_reduction={self.first: (ca.SX.ones(m), ca.SX.ones(m))})
        rows, fewer = limit.rows(here), limit.rows(lost)
        directions = np.random.default_rng(1).normal(size=(6, 6))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self._directions = np.concatenate([np.eye(6), directions])
        shifted = limit.rows(replace(here, shift=shift))
        # A hard limit of a state that the twist moves directly knows of no object under way.
        self._of_object = limit.hard and ca.depends_on(ca.vertcat(*_ends(rows)), here.pose)
        outputs = [rows.matrix, *_ends(rows), *_ends(fewer), *_ends(shifted)]
        outputs += [limit.margins(here, displacement), limit.margins(lost, ca.SX(6, 1))]
        outputs += [rows.rate, rows.curvature_margin]
        symbols = [here.posture, here.pose, sensitivity, readings, shift, displacement]
        self._rows = ca.Function("rows", symbols, [ca.densify(each) for each in outputs])

    def judge(self) -> None:
        """Check the rows at some places.

        Raises:
            ProblemError: if margins are wrong at one of the places, or rows at two of them. Rows
                may have edges, at which no derivative exists.
        """
        found = [set(self._wrong(place)) for place in self._places()]
        for words in sorted(set().union(*found)):
            count = sum(words in each for each in found)
            if count > 1 or words.startswith("margins"):
                raise ProblemError(f"limits: rows of {self.first}: got {words}")

    def _places(self) -> Iterator[_Place]:
        rng, n = np.random.default_rng(0), self._rows.numel_in(0)
        for corners in (_NEAR, _WIDE) * _PLACES:
            pose = np.eye(4)
            pose[:3, :3] = _turn(rng.normal(size=3))
            pose[:3, 3] = rng.uniform(*corners)
            yield _Place(rng.uniform(-0.3, 0.3, n), pose, rng.normal(size=(n, 6)))

    def _wrong(self, place: _Place) -> Iterator[str]:
        """Yield what is wrong at a place, in words that are the same at every place."""
        (here,) = self._at([place])
        if any(np.isnan(each).any() for each in vars(here).values()):
            yield "NaN, allowed numbers, and inf where there is no end"
            return
        finite = np.isfinite(here.ends)
        if (here.rate < 0).any() or (here.curvature_margin < 0).any():
            yield "a negative rate or curvature margin, allowed 0 or more"
        if self._of_object and not np.allclose(here.fewer[finite], here.ends[finite] - 1):
            yield (
                "distances that do not become smaller by context.margin_reduction, allowed rows"
                f" that are returned through context.reduced({self.first!r}, rows)"
            )
        if (here.margins > here.least(here.ends) + _RATES_ROUNDING).any():
            yield "margins above the distances at rest, allowed at most min(to_lower, to_upper)"
        elif (
            not self.limit.margin_is_lower_bound
            and (here.margins < here.least(here.ends) - _RATES_ROUNDING).any()
        ):
            yield (
                "margins below the distances at rest, allowed min(to_lower, to_upper), or"
                " `margin_is_lower_bound`"
            )
        elif (here.margins_of_fewer > here.least(here.fewer) + _RATES_ROUNDING).any():
            yield (
                "margins that do not become smaller by context.margin_reduction, allowed those of"
                " the rows"
            )
        rates = np.concatenate([here.matrix, -here.matrix])
        steps = _STEP * np.concatenate([np.eye(6), -np.eye(6)])
        around = self._at([place.moved(step) for step in steps])
        for axis, further, before in zip(np.eye(6), around[:6], around[6:], strict=True):
            known = np.isfinite(further.ends) & np.isfinite(before.ends)
            true = (further.ends[known] - before.ends[known]) / (2 * _STEP)
            if not np.allclose(rates[known] @ axis, true, rtol=_EXACT, atol=_EXACT):
                yield "a matrix that is not the derivative of the distances, allowed their rates"
                return
        if self.limit.hard:
            yield from self._optimistic(place)
            return
        step = np.full(len(place.posture), 1e-2)
        (there,) = self._at([replace(place, posture=place.posture + step)])
        (told,) = self._at([place], shift=step)
        if not np.allclose(told.shifted[finite], there.ends[finite]):
            yield "distances without context.shift, allowed posture + shift in them"

    def _optimistic(self, place: _Place) -> Iterator[str]:
        """Yield a sentence if a margin exceeds that after the displacement."""
        ways = _FAR * np.concatenate([self._directions, -self._directions])
        there = self._at([place.moved(way) for way in ways])
        promised = self._at([place] * len(ways), displacements=ways)
        if any(
            (promise.margins > after.least(after.ends) + _RATES_ROUNDING).any()
            for promise, after in zip(promised, there, strict=True)
        ):
            yield (
                "margins above those that the object has after the displacement, allowed lower"
                " bounds: curved rows bend along it"
            )

    def _at(
        self,
        places: Sequence[_Place],
        shift: np.ndarray | None = None,
        displacements: np.ndarray | None = None,
    ) -> list[_Told]:
        """Return what the limit says at some places, in one call."""
        count, measure = len(places), self._measure
        inputs = [
            np.stack([place.posture for place in places], axis=1),
            np.hstack([place.pose for place in places]),
            np.hstack([place.sensitivity for place in places]),
            []
            if measure is None
            else np.hstack([np.array(measure(place.posture)).reshape(-1, 1) for place in places]),
            np.zeros((len(places[0].posture), count)) if shift is None else shift[:, np.newaxis],
            np.zeros((6, count)) if displacements is None else displacements.T,
        ]
        matrices, *columns = (np.array(each) for each in self._rows.map(count)(*inputs))
        told = []
        for number in range(count):
            matrix = matrices[:, 6 * number : 6 * number + 6]
            flat = [column[:, number] for column in columns]
            pairs = [np.concatenate(flat[at : at + 2]) for at in (0, 2, 4)]
            told.append(_Told(matrix, *pairs, *flat[6:]))
        return told


def _ends(rows: Rows) -> tuple[ca.SX, ca.SX]:
    return rows.to_lower, rows.to_upper


def _with_readings(limit: Limit, place: LimitContext) -> tuple[LimitContext, ca.SX]:
    """Return a context with symbols for the readings of a limit, and these symbols (k,)."""
    measure = limit.measure()
    if measure is None:
        return place, ca.SX(0, 1)
    readings = ca.SX.sym("readings", measure.numel_out(0))
    return replace(place, readings={limit.names[0]: readings}), readings


_ROUNDING = 1e-6

KINDS: Final[Mapping[str, type]] = {
    each.kind: each for each in (WorkspaceBox, AxisCone, JointLimit, OneClassBoundary, ArmLength)
}
"""Kinds of limits that optimum, place search and checker compute by themselves.

The keys are the values of `Limit.kind`.
"""


@dataclass(frozen=True)
class OwnLimits:
    """The limits of a problem that are judged only by their `rows`, as distances to both ends.

    These are all limits except the first of each of `KINDS`. A first one belongs to them too if a
    user's subclass changed its behaviour.

    Attributes:
        every: all limits of the problem that have rows.
        size: number of entries of the state.
        surface: the limit that is an equality, or None.
    """

    every: tuple[Limit, ...]
    size: int
    surface: Surface | None = None

    def __reduce__(self) -> tuple:
        """Return what another process needs to make this object; it builds the functions again."""
        return OwnLimits, (self.every, self.size, self.surface)

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """The limits that are judged only by their rows."""
        return tuple(limit for limit in self.every if not self._known(limit))

    def _known(self, limit: Limit) -> bool:
        """Return whether a limit is judged as one of `KINDS`."""
        kind = KINDS.get(getattr(limit, "kind", None) or "")
        if kind is None or limit is not next((e for e in self.every if isinstance(e, kind)), None):
            return False
        own = type(limit)
        return all(
            getattr(own, name) is part
            for name, part in vars(kind).items()
            if not name.startswith("__")
            and (callable(part) or isinstance(part, (property, cached_property)))
        )

    @cached_property
    def hard(self) -> tuple[Limit, ...]:
        """The limits of the object side, which do not depend on the posture."""
        return tuple(limit for limit in self.limits if limit.hard)

    def margins(self, limit: Limit, posture: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the distance of each row (m,) to its nearer end, negative outside.

        Args:
            limit: one of `limits`.
            posture: posture of the person (n,) [rad].
            pose: pose of the object (4, 4) [m].
        """
        to_lower, to_upper = (
            np.array(part).ravel() for part in self._functions[limit.names[0]](posture, pose)
        )
        return np.minimum(to_lower, to_upper)

    def broken(self, pose: np.ndarray, posture: np.ndarray | None = None) -> str:
        """Return the first row that is violated, as ``"outside NAME"``, or an empty text.

        A limit may use another word than outside, see `Limit.violation_label`.

        Args:
            pose: pose of the object (4, 4) [m].
            posture: posture of the person there (n,) [rad]. None: only limits of the object side
                are judged.
        """
        stands_in = np.zeros(self.size) if posture is None else posture
        for limit in self.limits if posture is not None else self.hard:
            for name, margin in zip(limit.names, self.margins(limit, stands_in, pose), strict=True):
                if margin < -(limit.tolerance + _ROUNDING):
                    return f"{getattr(limit, 'violation_label', 'outside')} {name}"
        return ""

    def judge(self) -> None:
        """Check rows and margins of every limit: one of each for each name, and consistent.

        Raises:
            ProblemError: if they are not, with the error that the limit raised.
        """
        for limit in self.limits:
            first = limit.names[0]
            allowed = f"ergoqp.limits.limit.Rows of {len(limit.names)}, and as many margins"
            try:
                margins = limit.margins(_with_readings(limit, self._place())[0], ca.SX(6, 1))
                found = [self._functions[first].numel_out(0), margins.numel()]
            except ErgoqpError:
                raise
            except Exception as error:  # any error in the code of a user's limit
                raise ProblemError(
                    f"limits: rows of {first}: got {in_words(error)}, allowed {allowed}"
                ) from None
            if found != [len(limit.names)] * 2:
                raise ProblemError(
                    f"limits: rows of {first}: got {found[0]} rows and {found[1]} margins, allowed"
                    f" {allowed}"
                )
            # Limits of the package, with regions of the package, are judged by its tests instead.
            if not of_package(limit, getattr(limit, "region", None)):
                judged_once(
                    limit, self.size, lambda one=limit: OwnRates(one, self._place()).judge()
                )

    @cached_property
    def ends(self) -> ca.Function | None:
        """``(posture (n,), pose (4, 4)) -> (k,)``: all distances that are not infinite, or None.

        All are at least 0 where all limits hold.
        """
        if not self.limits:
            return None
        scalar = all(limit.measure() is None for limit in self.limits)
        kind: Any = ca.SX if scalar else ca.MX
        posture, pose = kind.sym("posture", self.size), kind.sym("pose", 4, 4)
        found = [
            part for limit in self.limits for part in self._functions[limit.names[0]](posture, pose)
        ]
        ends = ca.vertcat(*found)
        # A row without an end is infinite at every place.
        rng = np.random.default_rng(0)
        values = ca.Function("ends", [posture, pose], [ends])
        sample = np.array(values(rng.uniform(-0.1, 0.1, posture.numel()), np.eye(4))).ravel()
        return ca.Function(
            "ends", [posture, pose], [ends[np.flatnonzero(~np.isinf(sample)).tolist()]]
        )

    @cached_property
    def _functions(self) -> dict[str, ca.Function]:
        return {limit.names[0]: self._ends_of(limit) for limit in self.limits}

    def _place(self) -> LimitContext:
        """Return a symbolic context with nothing under way."""
        n, still = self.size, ca.SX(6, 1)
        posture, pose = ca.SX.sym("posture", n), ca.SX.sym("pose", 4, 4)
        where = posture, ca.SX.ones(n), pose, ca.SX.zeros(n, 6), still, still
        return LimitContext(*where, surface=self.surface, shift=ca.SX(n, 1))

    def _ends_of(self, limit: Limit) -> ca.Function:
        """Return the function ``(posture, pose) -> (to_lower, to_upper)`` of one limit."""
        measure, (place, readings) = limit.measure(), _with_readings(limit, self._place())
        ends = [ca.densify(part) for part in _ends(limit.rows(place))]
        if measure is None:
            return ca.Function("ends", [place.posture, place.pose], ends)
        inner = ca.Function("inner", [place.posture, place.pose, readings], ends)
        at, where = ca.MX.sym("posture", self.size), ca.MX.sym("pose", 4, 4)
        return ca.Function("ends", [at, where], list(inner.call([at, where, measure(at)])))
