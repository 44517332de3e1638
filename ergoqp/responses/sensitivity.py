"""S(q) of a person who keeps the contact, from what the posture makes of hands, pelvis and legs."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import spd_inverse
from ergoqp.joints import JOINTS
from ergoqp.responses.stance import LEGS


def sensitivity_function(geometry: ca.Function, arms: list[int], damping: float) -> ca.Function:
    """Return ``(q, locked) -> (S, E)`` from the geometry: products of matrices, run as such.

    Args:
        geometry: ``(q (32,), locked (32,)) -> (K', W^-1 K', softness, P G, legs)`` of `IkResponse`.
        arms: joints of trunk and arms that K has columns for, after the pelvis's four.
        damping: of the hand rows [m, rad].
    """
    q, locked = ca.MX.sym("q", len(JOINTS)), ca.MX.sym("locked", len(JOINTS))
    K, pull, softness, wanted, legs = geometry(q, locked)
    M = ca.SX.sym("M", softness.shape[0], softness.shape[0])
    inverse = ca.Function("inverse", [M], [spd_inverse(M)])
    multipliers = inverse(K.T @ pull + softness) @ wanted
    rates = pull @ multipliers
    moved = ca.vertcat(ca.vec(rates), ca.vec(legs @ rates[:4, :]), 0)
    # The legs follow the pelvis; all others are rates themselves. What neither has stays zero,
    # the last entry.
    height = 4 + len(arms)
    places = np.full((len(JOINTS), 6), moved.numel() - 1)
    places[arms] = np.arange(6 * height).reshape(6, height).T[4:]
    places[LEGS] = 6 * height + np.arange(6 * len(LEGS)).reshape(6, -1).T
    S = ca.reshape(moved[places.ravel(order="F").tolist()], len(JOINTS), 6)
    # G xi - J S xi: what the damping leaves over, and all of it where the joints cannot follow.
    E = damping**2 * multipliers
    return ca.Function(
        "sensitivity",
        [q, locked],
        [S, ca.densify(E)],
        ["q", "locked"],
        ["sensitivity", "unmet"],
    )
