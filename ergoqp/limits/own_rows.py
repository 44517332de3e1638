"""Limits that are judged by their rows only, such as the limits of users.

The optimum, the place search and the checker judge places and postures, not twists.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.errors import ErgoqpError, ProblemError, in_words
from ergoqp.limits.arm_length import ArmLength
from ergoqp.limits.joints import JointLimit
from ergoqp.limits.limit import Limit, Situation, Surface
from ergoqp.limits.one_class_boundary import OneClassBoundary
from ergoqp.limits.own_rates import judge_rates
from ergoqp.limits.workspace import AxisCone, WorkspaceBox

_ROUNDING = 1e-6

KINDS: Final[Mapping[str, type]] = {
    kind.holds: kind for kind in (WorkspaceBox, AxisCone, JointLimit, OneClassBoundary, ArmLength)
}
"""Kinds of limits that optimum, place search and checker compute by themselves.

The keys are the values of `Limit.holds`.
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
        kind = KINDS.get(getattr(limit, "holds", None) or "")
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
        below, above = (
            np.array(part).ravel() for part in self._functions[limit.names[0]](posture, pose)
        )
        return np.minimum(below, above)

    def broken(self, pose: np.ndarray, posture: np.ndarray | None = None) -> str:
        """Return the first row that is violated, as ``"outside NAME"``, or an empty text.

        A limit may use another word than outside, see `Limit.breach`.

        Args:
            pose: pose of the object (4, 4) [m].
            posture: posture of the person there (n,) [rad]. None: only limits of the object side
                are judged.
        """
        stands_in = np.zeros(self.size) if posture is None else posture
        for limit in self.limits if posture is not None else self.hard:
            for name, margin in zip(limit.names, self.margins(limit, stands_in, pose), strict=True):
                if margin < -(limit.tolerance + _ROUNDING):
                    return f"{getattr(limit, 'breach', 'outside')} {name}"
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
                found = [self._functions[first].numel_out(0), self._margins_of(limit)]
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
            judge_rates(limit, self._place())

    def _margins_of(self, limit: Limit) -> int:
        place, measure = self._place(), limit.measure()
        if measure is not None:
            place = replace(
                place, readings={limit.names[0]: ca.SX.sym("readings", measure.numel_out(0))}
            )
        return limit.margins(place, ca.SX(6, 1)).numel()

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

    def _place(self) -> Situation:
        """Return a symbolic situation with nothing under way."""
        n, still = self.size, ca.SX(6, 1)
        posture, pose = ca.SX.sym("posture", n), ca.SX.sym("pose", 4, 4)
        place = Situation(
            posture, ca.SX.ones(n), pose, ca.SX.zeros(n, 6), still, still, surface=self.surface
        )
        return replace(place, shift=ca.SX(n, 1))

    def _ends_of(self, limit: Limit) -> ca.Function:
        """Return the function ``(posture, pose) -> (below, above)`` of one limit."""
        n, measure, place = self.size, limit.measure(), self._place()
        posture, pose = place.posture, place.pose
        if measure is None:
            rows = limit.rows(place)
            return ca.Function(
                "ends", [posture, pose], [ca.densify(rows.below), ca.densify(rows.above)]
            )
        readings = ca.SX.sym("readings", measure.numel_out(0))
        rows = limit.rows(replace(place, readings={limit.names[0]: readings}))
        inner = ca.Function(
            "inner", [posture, pose, readings], [ca.densify(rows.below), ca.densify(rows.above)]
        )
        at, where = ca.MX.sym("posture", n), ca.MX.sym("pose", 4, 4)
        return ca.Function("ends", [at, where], list(inner.call([at, where, measure(at)])))
