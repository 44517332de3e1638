"""S(q) of a person who keeps the contact, from the geometry of hands, pelvis and legs."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import spd_inverse
from ergoqp.joints import JOINTS
from ergoqp.responses.stance import LEGS


def sensitivity_function(
    geometry: ca.Function, chain: list[int], hanging: list[int], damping: float, hands: int
) -> ca.Function:
    """Return ``(q, locked) -> (S, E)`` from the geometry, as products of matrices.

    Args:
        geometry: ``(q (32,), locked (32,)) -> (K', W^-1 K', softness, wanted, legs, swing)`` of
            `ergoqp.responses.following`.
        chain: joints from the trunk up for which K has columns, after the four of the pelvis; those
            of the trunk come first.
        hanging: joints that swing with those of the trunk.
        damping: damping of the rows of the hands [m, rad].
        hands: number of the rows of the hands, which come first.
    """
    q, locked = ca.MX.sym("q", len(JOINTS)), ca.MX.sym("locked", len(JOINTS))
    K, pull, softness, wanted, legs, swing = geometry(q, locked)
    M = ca.SX.sym("M", softness.shape[0], softness.shape[0])
    inverse = ca.Function("inverse", [M], [spd_inverse(M)])
    multipliers = inverse(K.T @ pull + softness) @ wanted
    rates = pull @ multipliers
    swung = ca.vec(swing @ rates[4:7, :]) if hanging else ca.MX(0, 1)
    moved = ca.vertcat(ca.vec(rates), ca.vec(legs @ rates[:4, :]), swung, 0)
    # The legs follow the pelvis, and a hanging arm follows the trunk. All other joints are rates
    # themselves. Joints that are none of these stay zero, the last entry.
    height, at_legs = 4 + len(chain), 6 * (4 + len(chain))
    places = np.full((len(JOINTS), 6), moved.numel() - 1)
    places[chain] = np.arange(6 * height).reshape(6, height).T[4:]
    places[LEGS] = at_legs + np.arange(6 * len(LEGS)).reshape(6, -1).T
    places[hanging] = at_legs + 6 * len(LEGS) + np.arange(6 * len(hanging)).reshape(6, -1).T
    S = ca.reshape(moved[places.ravel(order="F").tolist()], len(JOINTS), 6)
    # G xi - J S xi: the rest due to damping, which is everything where the joints cannot follow.
    E = damping**2 * multipliers[:hands, :]
    return ca.Function(
        "sensitivity",
        [q, locked],
        [S, ca.densify(E)],
        ["q", "locked"],
        ["sensitivity", "unmet"],
    )
