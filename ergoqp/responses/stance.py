"""Where the pelvis is: fixed on a seat, or carried by legs whose soles stay on the floor.

The world of a problem is anchored to the stance, so that a posture alone says where the person is.
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
"""Their numbers, the right leg's first."""

STRAIGHT_KNEE: Final = 0.10
"""Knee flexion [rad] below which the legs respond as if bent by this much.

At a straight knee its sign is lost.
"""

_BESIDE_FLOOR: Final = 0.02
"""How far from the floor a sole counts as on it [m]: a shoe's worth."""

_LOCK: Final = 1e8


@dataclass(frozen=True)
class Stance:
    """How the pelvis moves with the posture; everything in the pelvis frame unless said otherwise.

    Attributes:
        moves: whether the pelvis moves (standing).
        yaw: rotation of the pelvis in the world (3, 3), about z.
        position: pelvis in the world (3,) [m].
        weight: (4, 4) what it costs to move the pelvis by x, y, z, yaw: the cost of the leg joints
            that must follow.
        legs: (32, 4) leg joint rates per pelvis rate.
        relax: (4,) pelvis rates that best serve the legs' own wishes.
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

    With the soles fixed, each leg's six rates follow exactly from the four of the pelvis, so the
    legs and the twelve contact rows disappear from the problem; what remains of them is the weight
    of moving the pelvis.

    Args:
        kinematics: of the person.
        q: posture (32,) [rad].
        weights: cost of each joint's rate (32,).
        locked: 1 for joints that may not move (32,).
        wish: joint rates that the legs would choose (32,) [rad/s].
        balance: cost of moving the pelvis over the floor, per (m/s)^2.
        relaxation_time: in which the pelvis would come back to above the feet [s].
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
    # The pelvis wants to be above the middle of the feet as the joints want their comfort.
    over_floor = ca.diag(ca.DM([balance, balance, 0, 0]))
    weight += over_floor
    pull += over_floor @ ca.vertcat(middle[:2], 0, 0) / relaxation_time
    cos_sin = heading / ca.sqrt(ca.sumsqr(heading) + 1e-12)
    yaw = ca.SX.eye(3)
    yaw[0, 0], yaw[0, 1], yaw[1, 0], yaw[1, 1] = cos_sin[0], cos_sin[1], -cos_sin[1], cos_sin[0]
    return Stance(True, yaw, -(yaw @ middle), weight, legs, spd_inverse(weight) @ pull)


def with_bent_knees(q: ca.SX) -> ca.SX:
    """Return the posture with straight knees bent a little, for Jacobians: see `STRAIGHT_KNEE`."""
    bent = ca.SX(q)
    for side in SIDES:
        knee = INDEX[f"{side}_knee_flexion"]
        bent[knee] = ca.fmax(q[knee], STRAIGHT_KNEE)
    return bent


def _leg_rates(kinematics: Kinematics, q: ca.SX, side: str) -> ca.SX:
    """Return (6, 4): the leg's joint rates per pelvis rate that keep the sole where it is."""
    hip = kinematics.at(f"{side}_hip", q)[0]
    return -move_sole(kinematics, q, side, base_jacobian(hip))


def move_sole(kinematics: Kinematics, q: ca.SX, side: str, motion: ca.SX) -> ca.SX:
    """Return the leg's joint steps (6, k) that move its sole by `motion` (6, k).

    The motion is given at the hip centre in pelvis axes.

    Written at the hip centre, which the three hip axes do not move: knee and ankle carry that
    point, then the hip turns the sole. Two systems of three instead of one of six.
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
    """Return what carries a person who sits, as a clause for people.

    Args:
        seat: height of the hip centres above the floor [m].
        feet: height of the lower foot's sole above the floor [m].
    """
    seated = f"the pelvis stays on its seat, {seat:.2f} m high"
    if feet > _BESIDE_FLOOR:
        return f"{seated}; at that height the feet hang {feet:.2f} m above the floor"
    if feet < -_BESIDE_FLOOR:
        return f"{seated}; the legs need {-feet:.2f} m more, and are not modelled folded"
    return f"{seated}, with the feet on the floor"
