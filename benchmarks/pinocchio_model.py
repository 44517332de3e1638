"""A Pinocchio model made body by body from a loaded MuJoCo model: an independent kinematics check.

Pinocchio's own MJCF reader is not used: it was seen to merge hinges and to drop the offset of the
root.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ergoqp.expressions import matrix_of


def pinocchio_model(model: mujoco.MjModel) -> Any:
    """Return the `pin.Model` of a MuJoCo model; sites become frames.

    Each of its bodies carries one hinge, one slide or no joint.

    Raises:
        ImportError: if Pinocchio (package ``pin``) is absent.
        ValueError: if a body carries several joints, or one of another kind.
    """
    import pinocchio as pin

    made = pin.Model()
    carrier = {
        0: (0, pin.SE3.Identity())
    }  # per body: its joint, and its pose in that joint's frame
    for body in range(1, model.nbody):
        parent, offset = carrier[int(model.body_parentid[body])]
        here = offset * pin.SE3(matrix_of(model.body_quat[body]), np.array(model.body_pos[body]))
        if model.body_jntnum[body] > 1:
            raise ValueError(
                f"body {model.body(body).name}: got {model.body_jntnum[body]} joints, allowed at"
                " most one"
            )
        carrier[body] = (parent, here)
        if model.body_jntnum[body] == 1:
            number = int(model.body_jntadr[body])
            anchor = pin.SE3(np.eye(3), np.array(model.jnt_pos[number]))
            joint = made.addJoint(
                parent, _kind(pin, model, number), here * anchor, model.joint(number).name
            )
            carrier[body] = (joint, anchor.inverse())
        if carrier[body][0]:
            made.appendBodyToJoint(carrier[body][0], _inertia(pin, model, body), carrier[body][1])
    for site in range(model.nsite):
        joint, offset = carrier[int(model.site_bodyid[site])]
        placed = offset * pin.SE3(matrix_of(model.site_quat[site]), np.array(model.site_pos[site]))
        made.addFrame(pin.Frame(model.site(site).name, joint, 0, placed, pin.FrameType.OP_FRAME))
    return made


def _kind(pin: Any, model: mujoco.MjModel, number: int) -> Any:
    axis = np.array(model.jnt_axis[number])
    if model.jnt_type[number] == mujoco.mjtJoint.mjJNT_HINGE:
        return pin.JointModelRevoluteUnaligned(axis)
    if model.jnt_type[number] == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.JointModelPrismaticUnaligned(axis)
    raise ValueError(f"joint {model.joint(number).name}: allowed a hinge or a slide")


def _inertia(pin: Any, model: mujoco.MjModel, body: int) -> Any:
    turn = matrix_of(model.body_iquat[body])
    moment = turn @ np.diag(model.body_inertia[body]) @ turn.T
    return pin.Inertia(float(model.body_mass[body]), np.array(model.body_ipos[body]), moment)
