"""The equations of the posture in which the person comes to rest.

They are the optimality conditions of the person, with relaxed complementarity.

A person who holds an object comes to rest at

    q = argmin 1/2 |q - c|^2_W + B/2 |pelvis - middle of the feet|^2 + a/2 |r(q)|^2 + |e(q)|^2 / d^2
    s.t.  soles stay, l <= q <= u

with c the comfort posture, B the weight of balance, a that of looking, r the residual between
eyes and work, and e the residual between grips and object, without the rotation about a free
tool. This is the fixed point of `ergoqp.simulation.people.alike.Alike.settle`. With the
damping d the hands yield by less than a millimetre. With the multipliers y = e/d^2 of the
hands and m of the soles the conditions are

    W (s - c) = 2 J' y - a R' r - A' m,    e = d^2 y,    soles where they stand,    q = clip(s)

A hanging arm does not depend on the object. Its angles are a function of those of the trunk.

The unknown s is the posture before it is clipped to its ranges. W (s - q) is the multiplier of
the ranges (Robinson's normal map), so no inequality and no further unknown is needed. The clip
is made smooth after Chen, Harker, Kanzow and Smale. This relaxes complementarity to exactly
(q - l) (q - s) = relaxation^2 / 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.responses.holding import Holding, Situated, hang
from ergoqp.responses.ik import IkResponse
from ergoqp.responses.stance import LEG_JOINTS


@dataclass(frozen=True)
class Rest:
    """The conditions of rest.

    Attributes:
        moved: positions of the moving joints in the posture.
        aims: s of the moving joints, symbols (n,).
        pelvis: x, y, z and yaw of a standing person, symbols (4,); else empty.
        multipliers: y of the hands, then m of the soles, symbols.
        posture: q (32,).
        balance: equations that are linear in the multipliers, one per joint and pelvis
            coordinate, in this order.
        contact: the other equations: hands and soles.
    """

    moved: list[int]
    aims: ca.SX
    pelvis: ca.SX
    multipliers: ca.SX
    posture: ca.SX
    balance: ca.SX
    contact: ca.SX


def rest_conditions(response: IkResponse, place: Situated) -> Rest:
    """Return the conditions under which a person is at rest with the object at a place."""
    standing, hands = response.stance == "standing", len(response.hands)
    moved = [INDEX[joint] for joint in response.chain]
    chain = [joint for joint in moved if joint < 20]
    aims, pelvis = ca.SX.sym("s", len(moved)), ca.SX.sym("b", 4 if standing else 0)
    y, m = ca.SX.sym("y", 6 * hands), ca.SX.sym("m", 12 if standing else 0)
    wanted, posture = ca.SX(place.posture), ca.SX(place.posture)
    for number, joint in enumerate(moved):
        wanted[joint] = aims[number]
        posture[joint] = soft_clip(aims[number], LOWER[joint], UPPER[joint], place.relaxation)
    hang(response, posture)
    holding = Holding(response, place, posture, pelvis)
    discomfort = ca.DM(response.weight_vector) * (wanted - ca.DM(response.comfort))

    compliance, forces, contact = response.damping**2, [], []
    for number, error in enumerate(holding.errors):
        force = y[6 * number : 6 * number + 6]
        free = holding.along_tool(force)
        forces.append(2 * (force - free))
        contact.append(compliance * force + free - (error - holding.along_tool(error)))
    on_chain, on_pelvis = holding.pull(forces, chain)
    seen, seen_by_pelvis = holding.looking(chain)
    balance = [discomfort[chain] - on_chain - seen]
    if standing:
        on_legs, on_base = holding.legs(m)
        for side, on_leg in zip(SIDES, on_legs, strict=True):
            balance.append(discomfort[[INDEX[name] for name in LEG_JOINTS[side]]] + on_leg)
        balance.append(on_base - on_pelvis - seen_by_pelvis)
    contact.append(holding.slipping())
    return Rest(
        moved, aims, pelvis, ca.vertcat(y, m), posture, ca.vertcat(*balance), ca.vertcat(*contact)
    )


def soft_clip(value: ca.SX, lower: float, upper: float, relaxation: ca.SX) -> ca.SX:
    """Return a value clipped to a range, smoothly.

    It is always strictly inside. At an end it is `relaxation` / 2 away from it.
    """
    below = ca.sqrt((value - lower) ** 2 + relaxation**2)
    above = ca.sqrt((upper - value) ** 2 + relaxation**2)
    return (lower + upper + below - above) / 2
