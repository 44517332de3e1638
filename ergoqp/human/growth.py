"""Offsets between the parts of a body, for given or unknown lengths.

Every offset of the model is its nominal one times a length (`ergoqp.human.body`). So the
offsets are linear in the lengths, and a few loaded bodies determine them exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human.body import FRACTIONS, Body

GROWTH: Final[tuple[str, ...]] = ("stature", *FRACTIONS)
"""What may be larger than in the loaded body: everything at once, or one length."""

_STEP: Final = 0.1


@dataclass(frozen=True, eq=False)
class Offsets:
    """Offsets of bodies and sites in their parents, as expressions [m].

    Attributes:
        body_model: the loaded body.
        growth: relative growth (14,) in the order of `GROWTH`, or None for none.
        slopes: derivatives of the offsets of bodies and of sites with respect to it (n, 3,
            14).
    """

    body_model: Body
    growth: ca.SX | None
    slopes: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, body: Body, growth: ca.SX | None) -> Offsets:
        """Return the offsets of a body. Their slopes are computed from larger bodies."""
        if growth is None:
            return cls(body, None, (np.zeros(0), np.zeros(0)))
        here = _positions(body)
        slopes = [here]
        for name in FRACTIONS:
            lengths = dict(body.lengths) | {name: (1 + _STEP) * body.lengths[name]}
            larger = _positions(Body(body.stature, lengths, body.mass))
            slopes.append(((larger[0] - here[0]) / _STEP, (larger[1] - here[1]) / _STEP))
        bodies, sites = (np.stack(parts, axis=-1) for parts in zip(*slopes, strict=True))
        return cls(body, growth, (bodies, sites))

    def body(self, number: int) -> ca.SX:
        """Return the position of a body in its parent (3,) [m]."""
        return self._grown(self.body_model.model.body_pos[number], 0, number)

    def site(self, name: str) -> ca.SX:
        """Return the position of a site in its body (3,) [m]."""
        model = self.body_model.model
        number = model.site(name).id
        return self._grown(model.site_pos[number], 1, number)

    def _grown(self, nominal: np.ndarray, which: int, number: int) -> ca.SX:
        if self.growth is None:
            return ca.SX(ca.DM(nominal))
        slope = self.slopes[which][number]
        return ca.SX(ca.DM(nominal)) + ca.sparsify(ca.SX(ca.DM(slope))) @ self.growth


def _positions(body: Body) -> tuple[np.ndarray, np.ndarray]:
    return body.model.body_pos.copy(), body.model.site_pos.copy()
