"""Where the pelvis is: fixed on a seat, or carried by legs whose soles stay on the floor.

The world of a problem is fixed to the stance, so a posture alone gives the position of the person.
Seated: the origin is on the floor below the pelvis, x along its heading. Standing: the origin is on
the floor midway between the soles, x along their mean heading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import casadi as ca

from ergoqp.expressions.linear import solve3, spd_inverse
from ergoqp.human import Kinematics
from ergoqp.human.kinematics import base_jacobian
from ergoqp.joints import INDEX, JOINTS, SIDES

LEG_JOINTS: Final = {side: tuple(j for j in JOINTS[20:] if j.startswith(side)) for side in SIDES}
"""The six joints of each leg."""

LEGS: Final = [INDEX[joint] for side in SIDES for joint in LEG_JOINTS[side]]
"""Numbers of the joints of the legs, those of the right leg first."""

STRAIGHT_KNEE: Final = 0.10
"""Knee flexion [rad] below which the legs respond as if bent by this much.

At a straight knee the sign of its motion is lost.
"""

_BESIDE_FLOOR: Final = 0.02
"""Largest distance from the floor at which a sole counts as on it, about a shoe's height [m]."""

_LOCK: Final = 1e8


@dataclass(frozen=True)
class Stance:
    """How the pelvis moves with the posture, in the pelvis frame unless stated otherwise.

    Attributes:
        moves: whether the pelvis moves (standing).
        yaw: rotation of the pelvis in the world (3, 3), about z.
        position: pelvis in the world (3,) [m].
        weight: (4, 4) cost of moving the pelvis by x, y, z, yaw: the cost of the leg joints that
            must follow.
        legs: (32, 4) leg joint rates per pelvis rate.
        relax: (4,) pelvis rates that are best for the desired rates of the legs.
    """

    moves: bool
    yaw: ca.SX
    position: ca.SX
    weight: ca.SX
    legs: ca.SX
    relax: ca.SX


def seated(seat_height: float) -> Stance:
    """Return the stance of a person whose pelvis stays at `seat_height` [m] above the floor."""
    empty = ca.SX(len(JOINTS), 4)
    return Stance(False, ca.SX.eye(3), ca.SX([0, 0, seat_height]), ca.SX.eye(4), empty, ca.SX(4, 1))


def standing(
    kinematics: Kinematics,
    q: ca.SX,
    weights: ca.SX,
    locked: ca.SX,
    wish: ca.SX,
    balance: float,
    relaxation_time: float,
) -> Stance:
    """Return the stance of a person whose soles stay where they are.

    With the soles fixed, the six rates of each leg follow exactly from the four of the pelvis. So
    the legs and the twelve contact rows vanish from the problem. What remains of them is the cost
    of moving the pelvis.

    Args:
        kinematics: kinematics of the person.
        q: posture (32,) [rad].
        weights: cost of the rate of each joint (32,).
        locked: 1 for joints that must not move (32,).
        wish: desired joint rates (32,) [rad/s].
        balance: cost of moving the pelvis over the floor, per (m/s)^2.
        relaxation_time: time constant of the return of the pelvis to above the feet [s].
    """
    bent = with_bent_knees(q)
    legs = ca.SX(len(JOINTS), 4)
    weight = ca.SX(4, 4)
    pull = ca.SX(4, 1)
    heading = ca.SX(2, 1)
    middle = ca.SX(3, 1)
    for side in SIDES:
        columns = [INDEX[name] for name in LEG_JOINTS[side]]
        follow = _leg_rates(kinematics, bent, side)
        legs[columns, :] = follow
        cost = weights[columns] * (1 + _LOCK * locked[columns])
        weighted = follow.T @ ca.diag(cost)
        weight += weighted @ follow
        pull += weighted @ (wish[columns] * (1 - locked[columns]))
        true_position, rotation, _ = kinematics.at(f"{side}_sole", q)
        heading += rotation[:2, 0]
        middle += true_position / 2
    # The pelvis relaxes to above the middle of the feet, as the joints relax to comfort.
    over_floor = ca.diag(ca.DM([balance, balance, 0, 0]))
    weight += over_floor
    pull += over_floor @ ca.vertcat(middle[:2], 0, 0) / relaxation_time
    cos_sin = heading / ca.sqrt(ca.sumsqr(heading) + 1e-12)
    yaw = ca.SX.eye(3)
    yaw[0, 0], yaw[0, 1], yaw[1, 0], yaw[1, 1] = cos_sin[0], cos_sin[1], -cos_sin[1], cos_sin[0]
    return Stance(True, yaw, -(yaw @ middle), weight, legs, spd_inverse(weight) @ pull)


def with_bent_knees(q: ca.SX) -> ca.SX:
    """Return the posture with straight knees slightly bent, for Jacobians: see `STRAIGHT_KNEE`."""
    bent = ca.SX(q)
    for side in SIDES:
        knee = INDEX[f"{side}_knee_flexion"]
        bent[knee] = ca.fmax(q[knee], STRAIGHT_KNEE)
    return bent


def _leg_rates(kinematics: Kinematics, q: ca.SX, side: str) -> ca.SX:
    """Return (6, 4): the leg's joint rates per pelvis rate that keep the sole in place."""
    hip = kinematics.at(f"{side}_hip", q)[0]
    return -move_sole(kinematics, q, side, base_jacobian(hip))


def move_sole(kinematics: Kinematics, q: ca.SX, side: str, motion: ca.SX) -> ca.SX:
    """Return the leg's joint steps (6, k) that move its sole by `motion` (6, k).

    The motion is given at the hip centre in pelvis axes. The three hip axes do not move this point.
    So knee and ankle carry it, and then the hip turns the sole. This gives two systems of three
    equations instead of one of six.
    """
    columns = [INDEX[name] for name in LEG_JOINTS[side]]
    hip = kinematics.at(f"{side}_hip", q)[0]
    sole, _, jacobian = kinematics.at(f"{side}_sole", q)
    axes = jacobian[3:, columns]
    carried = jacobian[:3, columns[3:]] + ca.skew(sole - hip) @ axes[:, 3:]
    knee_and_ankle = solve3(carried, motion[:3, :])
    hip_steps = solve3(axes[:, :3], motion[3:, :] - axes[:, 3:] @ knee_and_ankle)
    return ca.vertcat(hip_steps, knee_and_ankle)


def seat_in_words(seat: float, feet: float) -> str:
    """Return what carries a seated person, as a clause for messages.

    Args:
        seat: height of the hip centres above the floor [m].
        feet: height of the lower sole above the floor [m].
    """
    seated = f"the pelvis stays on its seat, {seat:.2f} m high"
    if feet > _BESIDE_FLOOR:
        return f"{seated}; at that height the feet hang {feet:.2f} m above the floor"
    if feet < -_BESIDE_FLOOR:
        return f"{seated}; the legs need {-feet:.2f} m more, and are not modelled folded"
    return f"{seated}, with the feet on the floor"
