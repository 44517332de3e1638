"""Pose of every frame of the body, and how it moves with the joints.

Both are CasADi functions that are built from the loaded model.
"""

from __future__ import annotations

from typing import Final, TypeVar, cast

import casadi as ca
import mujoco
import numpy as np

from ergoqp.errors import InputError
from ergoqp.expressions.rigid import matrix_of
from ergoqp.human.body import Body, Offsets
from ergoqp.joints import INDEX, JOINTS

Expression = TypeVar("Expression", ca.SX, ca.MX, ca.DM)

FRAMES: Final[tuple[str, ...]] = (
    "pelvis",
    "trunk",
    "neck",
    "head",
    "head_top",
    "nose",
    "eyes",
    *(
        f"{side}_{name}"
        for side in ("right", "left")
        for name in ("shoulder", "elbow", "wrist", "grip", "knuckles", "fingertips", "thumb")
    ),
    *(
        f"{side}_{name}"
        for side in ("right", "left")
        for name in ("hip", "knee", "ankle", "toe", "heel", "sole")
    ),
)
"""Names of the frames (sites of ``models/human.xml``).

``grip`` is where a tool is held. Its x axis points out of the fist along the hand, z to the
thumb. With the elbow at 90 degrees and all other angles at zero it has the axes of the world.
All other frames have the axes of their segment.

Example:
    >>> from ergoqp.human import FRAMES
    >>> "right_grip" in FRAMES, len(FRAMES)
    (True, 33)
"""


class Kinematics:
    """Frames of a body in its pelvis frame, as functions of the posture.

    The pelvis frame is upright: x forward, y left, z up. `at` gives the pose and the geometric
    Jacobian of a frame. `base_jacobian` gives the Jacobian with respect to the motion of the
    pelvis.

    Args:
        body: the person; all numbers come from its loaded MuJoCo model.
        growth: relative growth of the person over `body`, in the order of
            `ergoqp.human.body.GROWTH`; None: no growth.

    Example:
        >>> import numpy as np
        >>> import casadi as ca
        >>> from ergoqp.human import Body, Kinematics
        >>> position, rotation, jacobian = Kinematics(Body()).at("right_grip", ca.DM.zeros(32))
        >>> position.full().ravel().round(2).tolist(), jacobian.shape
        ([0.0, -0.16, -0.17], (6, 32))
    """

    def __init__(self, body: Body, growth: ca.SX | None = None) -> None:
        """Read the tree of the loaded model."""
        self.body, self._growth = body, growth
        self._offsets = Offsets.of(body, growth)
        self._q = ca.SX.sym("q", len(JOINTS))
        self._bodies = _forward(body.model, self._offsets, self._q)
        self._functions: dict[str, ca.Function] = {}

    def function(self, frame: str) -> ca.Function:
        """Return ``q (32,) -> (p (3,), R (3, 3), J (6, 32))`` of a frame, in the pelvis frame.

        If the body has a growth, it is a second input.

        The rows of ``J`` are linear first, at the origin of the frame, along the axes of the
        pelvis.

        Raises:
            InputError: if there is no such frame.
        """
        if frame not in FRAMES:
            raise InputError(f"frame: got {frame!r}, allowed one of {', '.join(FRAMES)}")
        if frame not in self._functions:
            self._functions[frame] = self._build(frame)
        return self._functions[frame]

    def at(self, frame: str, q: Expression) -> tuple[Expression, Expression, Expression]:
        """Return position (3,) [m], rotation (3, 3) and Jacobian (6, 32) of a frame.

        They are those at the posture `q` (32,) [rad].
        """
        # If the body has a growth, growth and posture are symbols of the same type.
        function, growth = self.function(frame), self._growth
        frames = function(q) if growth is None else function(cast("ca.SX", q), growth)
        position, rotation, jacobian = cast("tuple[Expression, Expression, Expression]", frames)
        return position, rotation, jacobian

    def _build(self, frame: str) -> ca.Function:
        model = self.body.model
        site = model.site(frame)
        owner = int(site.bodyid[0])
        position, rotation, axes = self._bodies[owner]
        origin = position + rotation @ self._offsets.site(frame)
        orientation = _clean(rotation @ ca.DM(_matrix(site.quat)))
        jacobian = ca.SX(6, len(JOINTS))
        for joint, axis, anchor in axes:
            jacobian[:3, joint] = ca.cross(axis, origin - anchor)
            jacobian[3:, joint] = axis
        outputs = ca.cse([_clean(origin), orientation, _clean(jacobian)])
        given = {"q": self._q} | ({} if self._growth is None else {"growth": self._growth})
        return ca.Function(
            frame, list(given.values()), outputs, list(given), ["position", "rotation", "jacobian"]
        )


def base_jacobian(position: Expression) -> Expression:
    """Return the Jacobian of a point of the pelvis frame with respect to the pelvis rates, (6, 4).

    The rates are x, y, z [m/s] and yaw [rad/s].
    """
    kind = type(position)
    jacobian = kind(6, 4) if kind is not ca.MX else ca.MX(6, 4)
    jacobian[:3, :3] = ca.DM.eye(3)
    jacobian[0, 3] = -position[1]
    jacobian[1, 3] = position[0]
    jacobian[5, 3] = 1
    return cast("Expression", jacobian)


_Axis = tuple[int, ca.SX, ca.SX]


def _forward(
    model: mujoco.MjModel, offsets: Offsets, q: ca.SX
) -> dict[int, tuple[ca.SX, ca.SX, list[_Axis]]]:
    """Return the pose of each body, and (joint, axis, anchor) of each hinge above it."""
    pelvis = model.body("pelvis").id
    bodies: dict[int, tuple[ca.SX, ca.SX, list[_Axis]]] = {pelvis: (ca.SX(3, 1), ca.SX.eye(3), [])}
    for body in range(pelvis + 1, model.nbody):
        position, rotation, axes = bodies[int(model.body_parentid[body])]
        position = position + rotation @ offsets.body(body)
        rotation = rotation @ ca.DM(_matrix(model.body_quat[body]))
        for number in range(
            model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]
        ):
            joint = INDEX[model.joint(number).name]
            axis = ca.DM(model.jnt_axis[number])
            axes = [*axes, (joint, _clean(rotation @ axis), position)]
            rotation = _clean(rotation @ _about(axis, q[joint]))
        bodies[body] = (_clean(position), rotation, axes)
    return bodies


def _about(axis: ca.DM, angle: ca.SX) -> ca.SX:
    """Return the rotation by `angle` about a unit `axis` (Rodrigues)."""
    cross = ca.skew(axis)
    return _clean(ca.SX.eye(3) + ca.sin(angle) * cross + (1 - ca.cos(angle)) * (cross @ cross))


def _clean(expression: ca.SX) -> ca.SX:
    """Drop entries that are zero by structure, so that later products do not contain them."""
    return ca.sparsify(ca.simplify(expression))


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    matrix = matrix_of(quaternion)
    # Quarter turns give 2e-16 instead of 0. Such entries would only make the expressions
    # larger.
    matrix[np.abs(matrix) < 1e-14] = 0.0
    return matrix
