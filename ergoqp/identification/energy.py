"""The quantity that a person at rest minimises: discomfort, imbalance, strained gaze, lost contact.

At rest the person minimises 1/2 |r|^2 over joints and pelvis, with the residuals

    sqrt(w_j) (q_j - c_j),   sqrt(B) (pelvis - middle of the feet),   sqrt(a) gaze,
    sqrt(2) e / d  (hands),  slip / s  (soles),  sqrt(k) max(0, q - u), sqrt(k) max(0, l - q)

This is the rest of `ergoqp.responses.ik.IkResponse`, but soles and ranges are slightly soft. So it
is one least-squares problem, and differentiable in all unknown traits of the person.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.evaluator import Evaluator
from ergoqp.human import Kinematics
from ergoqp.human.growth import GROWTH
from ergoqp.identification.traits import Layout
from ergoqp.joints import LOWER, SIDES, UPPER
from ergoqp.responses.gaze import gaze
from ergoqp.responses.holding import Holding, Situated, hang
from ergoqp.responses.ik import IkResponse

_SOLE: Final = 0.004
"""Softness of soles [m, rad]."""
_RANGE: Final = 400.0
"""Stiffness of the ends of ranges, in units of joint weights."""
_ROUND: Final = 0.01
"""Width of the smooth start of an end [rad]."""


class RestEnergy:
    """Residuals of a person who holds an object, as functions of posture, place and person.

    Args:
        response: the person of the problem.

    Attributes:
        joints: numbers of the joints that move (n,). `z` holds these joints, and for a standing
            person then x, y, z and yaw of the pelvis.
    """

    def __init__(self, response: IkResponse) -> None:
        """Build the expressions."""
        self.response, self.layout = response, Layout(response)
        self.joints = self.layout.joints

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        n, hands = len(self.joints), len(self.response.hands)
        shapes = {
            "z": (n + 4 * (self.response.stance == "standing"), 1),
            "posture": (32, 1),
            "grasp": (4, 4 * hands),
            "soles": (4, 8),
            "pose": (4, 4),
            "weights": (n, 1),
            "comfort": (n, 1),
            "growth": (len(GROWTH), 1),
            "seat": (1, 1),
        }
        return {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}

    @cached_property
    def _residuals(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Residuals, the whole posture (32,), and the largest distance of a hand [m]."""
        sx, n, response = self._symbols, len(self.joints), self.response
        angles, pelvis, pose = sx["z"][:n], sx["z"][n:], sx["pose"]
        posture = ca.SX(sx["posture"])
        posture[self.joints] = angles
        hang(response, posture)
        place = Situated(
            posture, sx["grasp"], sx["soles"], pose[:3, 3], pose[:3, :3], relaxation=ca.SX(0)
        )
        kinematics = Kinematics(response.body, sx["growth"])
        seat = None
        if response.stance == "seated":
            seat = response.seat + sx["seat"]
        holding = Holding(response, place, posture, pelvis, kinematics, seat)
        rows = [ca.sqrt(sx["weights"]) * (angles - sx["comfort"])]
        for error in holding.errors:
            rows.append(np.sqrt(2) / response.damping * (error - holding.along_tool(error)))
        if response.stance == "standing":
            rows.append(holding.slipping() / _SOLE)
            feet = [kinematics.at(f"{side}_sole", posture)[0] for side in SIDES]
            rows.append(np.sqrt(response.balance) * (feet[0] + feet[1])[:2] / 2)
        if response.looks:
            work = holding.work
            seen = gaze(kinematics, posture, work, [])
            missed = sum((error[:3] for error in holding.errors), ca.SX(3, 1))
            missed = missed / len(holding.errors)
            rows.append(np.sqrt(response.attention) * (seen.residual + 2 * seen.by_work @ missed))
        for beyond in (angles - ca.DM(UPPER[self.joints]), ca.DM(LOWER[self.joints]) - angles):
            rows.append(np.sqrt(_RANGE) * (beyond + ca.sqrt(beyond**2 + _ROUND**2)) / 2)
        gaps = [ca.norm_2(error[:3]) for error in holding.errors]
        return ca.vertcat(*rows), posture, ca.mmax(ca.vertcat(*gaps))

    @cached_property
    def slope(self) -> Evaluator:
        """``(z, ...) -> residual (m,), by_z (m, k)``."""
        residual, _, _ = self._residuals
        by_z = ca.densify(ca.jacobian(residual, self._symbols["z"]))
        return self._evaluator("slope", {"residual": residual, "by_z": by_z})

    @cached_property
    def by_lengths(self) -> Evaluator:
        """``(z, ...) -> by_growth (m, 14), by_seat (m, 1)``."""
        residual, _, _ = self._residuals
        return self._evaluator(
            "by_lengths",
            {
                "by_growth": ca.densify(ca.jacobian(residual, self._symbols["growth"])),
                "by_seat": ca.densify(ca.jacobian(residual, self._symbols["seat"])),
            },
        )

    @cached_property
    def whole(self) -> Evaluator:
        """``(z, ...) -> whole (32,), gap``, with the joints that do not follow by themselves."""
        _, posture, gap = self._residuals
        return self._evaluator("whole", {"whole": posture, "gap": gap})

    def _evaluator(self, name: str, outputs: dict[str, ca.SX]) -> Evaluator:
        sx = self._symbols
        function = ca.Function(
            name,
            list(sx.values()),
            ca.cse([ca.densify(part) for part in outputs.values()]),
            list(sx),
            list(outputs),
        )
        return Evaluator(function)
