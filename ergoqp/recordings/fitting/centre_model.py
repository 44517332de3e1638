"""The body's joint centres in the world and how pelvis and joints move them, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.evaluator import Evaluator
from ergoqp.human import Body, Kinematics
from ergoqp.joints import JOINTS, LOWER, UPPER

BASE: Final = 4
"""The pelvis comes first among the unknowns: x, y, z [m] and yaw [rad]."""

UNKNOWNS: Final = BASE + len(JOINTS)
"""Pelvis, then the joints in the order of `JOINTS`."""


class CentreModel:
    """The chosen joint centres of one body as a function of its configuration.

    Args:
        body: the person.
        centres: names of frames of `ergoqp.human.FRAMES`.
    """

    def __init__(self, body: Body, centres: Sequence[str]) -> None:
        """Build the expression once and reserve its buffers."""
        self.centres = tuple(centres)
        kinematics = Kinematics(body)
        z = ca.SX.sym("z", UNKNOWNS)
        cos, sin = ca.cos(z[3]), ca.sin(z[3])
        yaw = ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.horzcat(0, 0, 1))
        across = ca.vertcat(
            ca.horzcat(-sin, -cos, 0), ca.horzcat(cos, -sin, 0), ca.horzcat(0, 0, 0)
        )
        positions, jacobians = [], []
        for centre in centres:
            position, _, jacobian = kinematics.at(centre, z[BASE:])
            positions.append(z[:3] + yaw @ position)
            jacobians.append(ca.horzcat(ca.SX.eye(3), across @ position, yaw @ jacobian[:3, :]))
        outputs = ca.cse([ca.vertcat(*positions), ca.densify(ca.vertcat(*jacobians))])
        outputs = [ca.densify(outputs[0]), outputs[1]]
        function = ca.Function("centres", [z], outputs, ["z"], ["positions", "jacobian"])
        self._evaluator = Evaluator(function)
        self._z = self._evaluator.inputs["z"]
        self._positions = self._evaluator.outputs["positions"].reshape(-1, 3)
        self._jacobian = self._evaluator.outputs["jacobian"].reshape((-1, UNKNOWNS), order="F")

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the centres and their Jacobian.

        Args:
            z: pelvis x, y, z, yaw and the posture, shape (36,).

        Returns:
            Positions (m, 3) [m] and Jacobian (3 m, 36), rows centre by centre. Both are overwritten
            by the next call.
        """
        self._z[:] = z
        self._evaluator.evaluate()
        return self._positions, self._jacobian


LOWEST: Final = np.concatenate([np.full(BASE, -np.inf), LOWER])
"""Lower bounds of the unknowns, shape (36,): the pelvis is free, the joints keep their ranges."""

HIGHEST: Final = np.concatenate([np.full(BASE, np.inf), UPPER])
"""Upper bounds of the unknowns, shape (36,)."""
