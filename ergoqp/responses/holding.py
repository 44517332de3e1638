"""A person who holds an object: errors of hands, soles and gaze, and their effect on the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from ergoqp.expressions import pose_matrix
from ergoqp.human import Kinematics
from ergoqp.human.body import base_jacobian
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.responses.ik import IkResponse
from ergoqp.responses.stance_and_gaze import (
    LEG_JOINTS,
    STRAIGHT_KNEE,
    TRUNK,
    arm_of,
    contact_frame,
    gaze,
    hanging,
    swinging,
    turn_about,
)

_ROUND = 1e-3
"""Width of the transition from straight to bent knees [rad].

See `ergoqp.responses.stance_and_gaze.with_bent_knees`.
"""


@dataclass(frozen=True)
class Situated:
    """The data of a start: symbols that become numbers when a program is solved.

    Attributes:
        posture: posture (32,) [rad]; joints that do not move keep these angles.
        grasp: grips in the contact frame side by side (4, 4 k).
        soles: right and left sole in the world (4, 8).
        position: position of the contact frame of the object (3,) [m].
        rotation: rotation of the contact frame of the object (3, 3).
        relaxation: relaxation of complementarity [rad].
    """

    posture: ca.SX
    grasp: ca.SX
    soles: ca.SX
    position: ca.SX
    rotation: ca.SX
    relaxation: ca.SX


def soles_of(response: IkResponse) -> ca.Function:
    """Return the function posture (32,) -> right and left sole in the world (4, 8)."""
    q = ca.SX.sym("q", len(JOINTS))
    pelvis = response.contact()(q)[1]
    poses = []
    for side in SIDES:
        position, rotation, _ = response.kinematics.at(f"{side}_sole", q)
        poses.append(pelvis @ pose_matrix(position, rotation))
    return ca.Function("soles", [q], [ca.densify(ca.horzcat(*poses))])


class Holding:
    """A person who holds the object: contact errors and forces as expressions.

    They depend on posture and pelvis.

    Attributes:
        response: the person.
        posture: expression of the posture (32,).
        pelvis: x, y, z [m] and yaw [rad] of the pelvis (4,), empty if seated.
        kinematics: kinematics of the body.
        work: where the hands hold the object (3,), in pelvis axes [m].
    """

    def __init__(
        self,
        response: IkResponse,
        place: Situated,
        posture: ca.SX,
        pelvis: ca.SX,
        kinematics: Kinematics | None = None,
        seat: ca.SX | None = None,
    ) -> None:
        """Compute hands and soles of the posture; None: body and seat of the response."""
        self.response, self.place, self.posture, self.pelvis = response, place, posture, pelvis
        self.kinematics = kinematics or response.kinematics
        self.standing = response.stance == "standing"
        if self.standing:
            self._base = pelvis[:3]
        else:
            self._base = ca.vertcat(0, 0, ca.SX(response.seat) if seat is None else seat)
        self._turned = turn_about(2, pelvis[3]) if self.standing else ca.SX.eye(3)
        self._hands = [self.kinematics.at(f"{hand}_grip", posture) for hand in response.hands]
        self.work, turned = contact_frame([(p, r) for p, r, _ in self._hands], response.tool)
        self._axis = turned[:, 0]

    @cached_property
    def errors(self) -> list[ca.SX]:
        """Motion (6,) that would bring each hand to the object, in pelvis axes [m, rad]."""
        place, back = self.place, self._turned.T
        errors = []
        for number, (position, rotation, _) in enumerate(self._hands):
            grip = place.grasp[:, 4 * number : 4 * number + 4]
            wanted = back @ (place.position + place.rotation @ grip[:3, 3] - self._base)
            errors.append(
                ca.vertcat(wanted - position, _turn(rotation, back @ place.rotation @ grip[:3, :3]))
            )
        return errors

    def slipping(self) -> ca.SX:
        """Return the displacement of the soles from their places (12,) [m, rad].

        It is empty if the person sits.
        """
        rows = []
        for number, side in enumerate(SIDES if self.standing else ()):
            position, rotation, _ = self.kinematics.at(f"{side}_sole", self.posture)
            sole = self.place.soles[:, 4 * number : 4 * number + 4]
            wanted = self._turned.T @ (sole[:3, 3] - self._base)
            rows += [wanted - position, _turn(rotation, self._turned.T @ sole[:3, :3])]
        return ca.vertcat(*rows)

    def along_tool(self, vector: ca.SX) -> ca.SX:
        """Return the part (6,) of a motion or a force that turns about the tool.

        It is zero unless the hand may turn about the tool.
        """
        free = (
            self._axis * ca.dot(self._axis, vector[3:])
            if self.response.free_about_tool
            else ca.SX(3, 1)
        )
        return ca.vertcat(ca.SX(3, 1), free)

    def about_tool(self, angle: ca.SX) -> ca.SX:
        """Return the turn (6,) by an angle [rad] about the tool."""
        return ca.vertcat(ca.SX(3, 1), self._axis * angle)

    def pull(self, forces: Sequence[ca.SX], joints: Sequence[int]) -> tuple[ca.SX, ca.SX]:
        """Return the effect of forces at the hands (6,) on joints (n,) and on the pelvis (4,)."""
        on_joints, on_pelvis = ca.SX(len(joints), 1), ca.SX(4, 1)
        for force, (position, _, jacobian) in zip(forces, self._hands, strict=True):
            on_joints += jacobian[:, list(joints)].T @ force
            on_pelvis += base_jacobian(position).T @ force
        return on_joints, on_pelvis

    def looking(self, joints: Sequence[int]) -> tuple[ca.SX, ca.SX]:
        """Return the effect of looking at the work on joints (n,) and on the pelvis (4,)."""
        if not self.response.looks:
            return ca.SX(len(joints), 1), ca.SX(4, 1)
        seen = gaze(self.kinematics, self.posture, self.work, joints)
        # As for the forces of the hands: the error counts in full, the cost with a factor 1/2.
        missed = sum((error[:3] for error in self.errors), ca.SX(3, 1)) / len(self.errors)
        pull = -self.response.attention * (seen.residual + 2 * seen.by_work @ missed)
        on_pelvis = -base_jacobian(self.work)[:3, :].T @ (seen.by_work.T @ pull)
        return seen.by_joints.T @ pull, on_pelvis

    def legs(self, multipliers: ca.SX) -> tuple[list[ca.SX], ca.SX]:
        """Return the effect of sole multipliers (12,) on leg joints (6,) each and the pelvis (4,).

        The effect on the pelvis includes balance. It is written at the hip centre, with straight
        knees taken as slightly bent, as in the response.
        """
        kinematics, bent = self.kinematics, self._bent()
        on_legs, on_pelvis, middle = [], ca.SX(4, 1), ca.SX(3, 1)
        for number, side in enumerate(SIDES):
            columns = [INDEX[name] for name in LEG_JOINTS[side]]
            hip = kinematics.at(f"{side}_hip", bent)[0]
            sole, _, jacobian = kinematics.at(f"{side}_sole", bent)
            axes = jacobian[3:, columns]
            at_hip = ca.vertcat(jacobian[:3, columns] + ca.skew(sole - hip) @ axes, axes)
            force = multipliers[6 * number : 6 * number + 6]
            on_legs.append(at_hip.T @ force)
            on_pelvis += base_jacobian(hip).T @ force
            middle += kinematics.at(f"{side}_sole", self.posture)[0] / 2
        return on_legs, on_pelvis - self.response.balance * ca.vertcat(middle[:2], 0, 0)

    def _bent(self) -> ca.SX:
        bent = ca.SX(self.posture)
        for side in SIDES:
            knee = INDEX[f"{side}_knee_flexion"]
            above = bent[knee] - STRAIGHT_KNEE
            bent[knee] = STRAIGHT_KNEE + (above + ca.sqrt(above**2 + _ROUND**2)) / 2
        return bent


def hang(response: IkResponse, posture: ca.SX) -> None:
    """Put a hanging arm, if there is one, to its position at rest beside the trunk."""
    if response.hanging is None:
        return
    arm, swings = arm_of(response.hanging), swinging(response.hanging)
    posture[arm] = ca.DM(response.comfort[arm])
    posture[swings] = hanging(
        posture[TRUNK], response.hanging, ca.SX(ca.DM(response.comfort[swings]))
    )


def _turn(have: ca.SX, want: ca.SX) -> ca.SX:
    return sum((ca.cross(have[:, i], want[:, i]) for i in range(3)), ca.SX(3, 1)) / 2
