"""Stance, contact, gaze and free arm of the model person.

Where the pelvis is: fixed on a seat, or carried by legs whose soles stay on the floor.

The world of a problem is fixed to the stance, so a posture alone gives the position of the person.
Seated: the origin is on the floor below the pelvis, x along its heading. Standing: the origin is on
the floor midway between the soles, x along their mean heading.

People look at their work: how far the head is from where the eyes see the work with ease.

The eyes turn first, about a comfortable line of sight below the level of the head. The head does
the rest of the turn, and neck and trunk share it. The work also keeps a distance from the eyes: if
it is closer than the viewing distance, the head moves away.

Sources: the normal line of sight 15 degrees below the horizontal with 15 degrees of easy eye motion
about it (MIL-STD-1472, figure of the vertical and horizontal visual field; EN 894-2 has the same
zones); about 0.3 m as the viewing distance of demanding manual work (Grandjean, Fitting the Task to
the Man, 1988: 0.25 to 0.35 m).

An arm that holds nothing: it hangs straight down whatever the trunk does, or stays as it is.

The sheet measures the upper arm relative to the trunk and scores both arms. So an arm that hangs
beside a trunk that leans forward counts as an upper arm in flexion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions import solve3, spd_inverse
from ergoqp.human import Kinematics
from ergoqp.human.body import base_jacobian
from ergoqp.joints import INDEX, JOINTS, SIDES, UPPER_BODY

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


TOOL_AXES: Final[dict[str, tuple[tuple[float, float, float], ...]]] = {
    "along": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "thumb": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}
"""Axes of the contact frame in the grip frame; x is the axis of the tool.

The tool points out of the fist along the forearm, or past the thumb.
"""


def contact_frame(grips: Sequence[tuple[ca.SX, ca.SX]], tool: str) -> tuple[ca.SX, ca.SX]:
    """Return position and rotation of the contact frame from those of the grips.

    One hand: the grip, turned so that x is the axis of the tool. Two hands: midway, with y from the
    right grip to the left one, and x as close to the mean of the two tool axes as possible.
    """
    turn = ca.DM(np.array(TOOL_AXES[tool], dtype=float).T)
    if len(grips) == 1:
        position, rotation = grips[0]
        return position, rotation @ turn
    (right, right_rotation), (left, left_rotation) = grips
    y = _unit(left - right)
    x = (right_rotation @ turn + left_rotation @ turn)[:, 0]
    x = _unit(x - y * ca.dot(x, y))
    return (right + left) / 2, ca.horzcat(x, y, ca.cross(x, y))


def about_tool(axis: ca.SX, free: bool) -> ca.SX:
    """Return the projector (6, 6) on turns about the tool's axis; zero for a rigid grasp."""
    projector = ca.SX(6, 6)
    if free:
        projector[3:, 3:] = axis @ axis.T
    return projector


def carried_to(offset: ca.SX) -> ca.SX:
    """Return the map (6, 6) from a twist to the motion of a fixed point at `offset`."""
    carried = ca.SX.eye(6)
    carried[:3, 3:] = -ca.skew(offset)
    return carried


def _unit(vector: ca.SX) -> ca.SX:
    return vector / ca.sqrt(ca.sumsqr(vector) + 1e-12)


AT_EASE: Final = float(np.radians(15.0))
"""Angle of the comfortable line of sight below the level of the head [rad]."""

EYES_TURN: Final = float(np.radians(15.0))
"""Angle that the eyes turn from there before the head follows [rad]."""

VIEWING_DISTANCE: Final = 0.30
"""Smallest comfortable viewing distance [m]."""

ROWS: Final = 3
"""Number of rows: two for the direction, one for the distance."""

_BEHIND: Final = 0.1
"""Keeps the direction finite if the work is behind the head."""

_SOFT: Final = 0.03
"""Width of the smooth transition at the viewing distance [m]."""


@dataclass(frozen=True)
class Gaze:
    """How far the head is from seeing the work with ease, in pelvis axes.

    Attributes:
        residual: what is missing (3,): to the left and up [rad], and nearness, which is 1 if the
            work is at the eyes.
        by_joints: its change with the joints while the work stays (3, n) [1/rad].
        by_work: its change with the place of the work while the head stays (3, 3) [1/m].
    """

    residual: ca.SX
    by_joints: ca.SX
    by_work: ca.SX


def gaze(kinematics: Kinematics, q: ca.SX, work: ca.SX, joints: Sequence[int]) -> Gaze:
    """Return how far the head is from seeing `work` (3,) [m] with ease at a posture (32,) [rad]."""
    eyes, head, jacobian = kinematics.at("eyes", q)
    way, turned = work - eyes, head @ _line_of_sight()
    seen = ca.SX.sym("seen", 3)
    missing = beyond_ease(seen)
    both = ca.Function("missing", [seen], [missing, ca.jacobian(missing, seen)])
    residual, slope = both(turned.T @ way)
    by_work = slope @ turned.T
    moved = -jacobian[:3, list(joints)] + ca.skew(way) @ jacobian[3:, list(joints)]
    return Gaze(residual, by_work @ moved, by_work)


def beyond_ease(seen: ca.SX) -> ca.SX:
    """Return what is missing (3,) for work seen at (3,) [m], x along the comfortable line of sight.

    The direction is about twice the tangent of half of its angle, so it grows up to 150 deg. Only
    the part beyond the turn of the eyes counts, with a smooth transition.
    """
    distance = ca.sqrt(ca.sumsqr(seen) + 1e-8)
    toward = seen / distance
    aside = (2 + _BEHIND) / (1 + _BEHIND + toward[0]) * toward[1:]
    beyond = 1 - EYES_TURN / ca.sqrt(ca.sumsqr(aside) + EYES_TURN**2)
    near = VIEWING_DISTANCE - distance
    return ca.vertcat(aside * beyond, (near + ca.sqrt(near**2 + _SOFT**2)) / 2 / VIEWING_DISTANCE)


def _line_of_sight() -> ca.DM:
    """Return the rotation (3, 3) from the axes of the head to those of the eyes at ease."""
    c, s = np.cos(AT_EASE), np.sin(AT_EASE)
    return ca.DM(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))


HANGING_DEG: Final[dict[str, float]] = {"shoulder_abduction": 5.0, "elbow_flexion": 12.0}
"""Angles of an arm that hangs beside an upright trunk [deg]; all others are zero."""

TRUNK: Final = [INDEX[joint] for joint in JOINTS if joint.startswith("trunk")]
"""Numbers of the joints of the trunk."""

_ASIDE: Final = {"right": -1.0, "left": 1.0}
_NEARLY: Final = 1 - 1e-9


def arm_of(side: str) -> list[int]:
    """Return the numbers of the seven joints of an arm."""
    return [INDEX[joint] for joint in UPPER_BODY if joint.startswith(side)]


def swinging(side: str) -> list[int]:
    """Return the numbers of the joints that gravity turns: the first two of the shoulder."""
    return [INDEX[f"{side}_shoulder_flexion"], INDEX[f"{side}_shoulder_abduction"]]


def hanging(trunk: ca.SX, side: str, ease: ca.SX) -> ca.SX:
    """Return flexion and abduction (2,) [rad] of an arm that hangs beside a trunk.

    Args:
        trunk: flexion, side bend and twist of the trunk (3,) [rad].
        side: side of the arm.
        ease: the two angles beside an upright trunk (2,) [rad].
    """
    aside = _ASIDE[side]
    flexion, abduction = ease[0], ease[1]
    upright = ca.vertcat(
        ca.sin(flexion) * ca.cos(abduction),
        aside * ca.sin(abduction),
        -ca.cos(flexion) * ca.cos(abduction),
    )
    # The arm turns with the trunk about the vertical, and does not lean with it.
    forward, sideways, twist = trunk[0], trunk[1], trunk[2]
    down = (
        turn_about(2, -twist)
        @ turn_about(0, sideways)
        @ turn_about(1, -forward)
        @ turn_about(2, twist)
        @ upright
    )
    across = ca.fmax(ca.fmin(aside * down[1], _NEARLY), -_NEARLY)
    return ca.vertcat(ca.atan2(down[0], -down[2]), ca.asin(across))


def turn_about(axis: int, angle: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) by an angle [rad] about axis 0, 1 or 2."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = ca.SX.eye(3)
    rotation[i, i] = rotation[j, j] = ca.cos(angle)
    rotation[i, j], rotation[j, i] = -ca.sin(angle), ca.sin(angle)
    return rotation
