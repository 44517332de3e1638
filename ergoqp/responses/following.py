"""The algebra of `ergoqp.responses.ik`: S(q), and joint rates when the object moves or does not.

The algebra of `ergoqp.responses.ik`: joint rates when the object moves, and when it does not.

All rates of pelvis, trunk, neck and arms together minimise 1/2 v' W v + 1/2 |A v - a|^2 / s^2. The
rows A v = a are those of the hands, which follow the object, and those of the gaze, which follows
the work. A row with a smaller softness s is kept more exactly. With K for the rows, v = W^-1 K' (K
W^-1 K' + s^2)^-1 a: a soft row has a nonzero entry on the diagonal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ergoqp.expressions import spd_inverse
from ergoqp.human import Kinematics
from ergoqp.human.body import base_jacobian
from ergoqp.joints import JOINTS
from ergoqp.responses.stance import (
    LEGS,
    TRUNK,
    Gaze,
    Stance,
    about_tool,
    arm_of,
    carried_to,
    contact_frame,
    gaze,
    hanging,
    pose_matrix,
    swinging,
)


def sensitivity_function(
    geometry: ca.Function, chain: list[int], hanging: list[int], damping: float, hands: int
) -> ca.Function:
    """Return ``(q, locked) -> (S, E)`` from the geometry, as products of matrices.

    Args:
        geometry: ``(q (32,), locked (32,)) -> (K', W^-1 K', softness, wanted, legs, swing)`` of
            `ergoqp.responses.following`.
        chain: joints from the trunk up for which K has columns, after the four of the pelvis; those
            of the trunk come first.
        hanging: joints that swing with those of the trunk.
        damping: damping of the rows of the hands [m, rad].
        hands: number of the rows of the hands, which come first.
    """
    q, locked = ca.MX.sym("q", len(JOINTS)), ca.MX.sym("locked", len(JOINTS))
    K, pull, softness, wanted, legs, swing = geometry(q, locked)
    M = ca.SX.sym("M", softness.shape[0], softness.shape[0])
    inverse = ca.Function("inverse", [M], [spd_inverse(M)])
    multipliers = inverse(K.T @ pull + softness) @ wanted
    rates = pull @ multipliers
    swung = ca.vec(swing @ rates[4:7, :]) if hanging else ca.MX(0, 1)
    moved = ca.vertcat(ca.vec(rates), ca.vec(legs @ rates[:4, :]), swung, 0)
    # The legs follow the pelvis, and a hanging arm follows the trunk. All other joints are rates
    # themselves. Joints that are none of these stay zero, the last entry.
    height, at_legs = 4 + len(chain), 6 * (4 + len(chain))
    places = np.full((len(JOINTS), 6), moved.numel() - 1)
    places[chain] = np.arange(6 * height).reshape(6, height).T[4:]
    places[LEGS] = at_legs + np.arange(6 * len(LEGS)).reshape(6, -1).T
    places[hanging] = at_legs + 6 * len(LEGS) + np.arange(6 * len(hanging)).reshape(6, -1).T
    S = ca.reshape(moved[places.ravel(order="F").tolist()], len(JOINTS), 6)
    # G xi - J S xi: the rest due to damping, which is everything where the joints cannot follow.
    E = damping**2 * multipliers[:hands, :]
    return ca.Function(
        "sensitivity",
        [q, locked],
        [S, ca.densify(E)],
        ["q", "locked"],
        ["sensitivity", "unmet"],
    )


Stand = Callable[[ca.SX, ca.SX, ca.SX, ca.SX], Stance]
"""Returns the stance at a posture, from joint weights, locks and desired rates (32,) each."""


@dataclass(frozen=True, eq=False)
class Following:
    """The properties of an `ergoqp.responses.ik.IkResponse` that its algebra uses.

    Attributes:
        kinematics: kinematics of the body.
        hands: hands that hold the object.
        tool: axis of the tool, a key of `ergoqp.responses.stance.TOOL_AXES`.
        free_about_tool: whether the hand may turn about this axis.
        damping: softness of the rows of the hands [m, rad].
        weights: cost of the rate of each joint (32,).
        comfort: posture toward which the person relaxes (32,) [rad].
        relaxation_time: time constant of the relaxation [s].
        chain: numbers of the joints from the trunk up that are free to follow.
        stand: function for the position and the motion of the pelvis.
        attention: weight of looking at the work; 0: the person does not look at it.
        hanging: side of an arm that hangs, or None.
    """

    kinematics: Kinematics
    hands: tuple[str, ...]
    tool: str
    free_about_tool: bool
    damping: float
    weights: np.ndarray
    comfort: np.ndarray
    relaxation_time: float
    chain: list[int]
    stand: Stand
    attention: float
    hanging: str | None

    @cached_property
    def functions(self) -> tuple[ca.Function, ...]:
        """Sensitivity, drift, contact, grips and reach, as `IkResponse` describes them."""
        q, locked = ca.SX.sym("q", len(JOINTS)), ca.SX.sym("locked", len(JOINTS))
        weights = ca.SX(ca.DM(self.weights))
        wish = (ca.SX(ca.DM(self.comfort)) - q) / self.relaxation_time * (1 - locked)
        stance = self.stand(q, weights, locked, wish)
        hands = [self.kinematics.at(f"{hand}_grip", q) for hand in self.hands]
        position, rotation = contact_frame([(p, r) for p, r, _ in hands], self.tool)
        seen = self._gaze(q, position)
        rows = _Rows.of(self, stance, hands, position, rotation[:, 0], seen)
        free = (1 - locked[self.chain]) / weights[self.chain]
        pelvis = spd_inverse(stance.weight) if stance.moves else ca.SX(4, 4)
        pull = ca.diagcat(pelvis, ca.diag(free)) @ rows.K.T
        inverse_M = spd_inverse(rows.K @ pull + rows.softness)
        swing, fall = self._swing(q)
        side = len(self.hands)

        def in_joints(rates: ca.SX) -> ca.SX:
            """Return the rates of all 32 joints from those of pelvis and chain."""
            spread = (
                stance.legs @ rates[:4, :] if stance.moves else ca.SX(len(JOINTS), rates.shape[1])
            )
            spread[self.chain, :] = rates[4:, :]
            if self.hanging is not None:
                joints = swinging(self.hanging)
                spread[joints, :] = swing @ rates[4:7, :] * (1 - locked[joints])
            return spread

        own = ca.vertcat(stance.relax, wish[self.chain])
        asked = ca.vertcat(ca.SX(6 * side, 1), -seen.residual / self.relaxation_time)
        relax = in_joints(own + pull @ (inverse_M @ (asked - rows.K @ own)))
        if self.hanging is not None:
            relax[arm_of(self.hanging)] += fall * (1 - locked[arm_of(self.hanging)])

        error = ca.SX.sym("e", 6 * side)
        to_hands = ca.diagcat(*[stance.yaw.T] * (2 * side)) @ error
        work = sum((to_hands[6 * i : 6 * i + 3] for i in range(side)), ca.SX(3, 1)) / side
        asked = ca.vertcat(rows.kept @ to_hands, -seen.by_work @ work)
        reach = in_joints(pull @ (inverse_M @ asked))

        parts = {
            "K": rows.K.T,
            "pull": pull,
            "softness": rows.softness,
            "wanted": rows.wanted @ ca.diagcat(stance.yaw.T, stance.yaw.T),
            "legs": stance.legs[LEGS, :],
            "swing": swing * (1 - locked[swinging(self.hanging)]) if self.hanging else swing,
        }
        base = pose_matrix(stance.position, stance.yaw)
        grips = ca.horzcat(*(base @ pose_matrix(p, r) for p, r, _ in hands))
        poses = [base @ pose_matrix(position, rotation), base]
        return (
            sensitivity_function(
                ca.Function("geometry", [q, locked], ca.cse(list(map(ca.densify, parts.values())))),
                self.chain,
                [] if self.hanging is None else swinging(self.hanging),
                self.damping,
                6 * side,
            ),
            ca.Function("drift", [q, locked], ca.cse([ca.densify(relax)])),
            ca.Function(
                "contact", [q], ca.cse(list(map(ca.densify, poses))), ["q"], ["contact", "pelvis"]
            ),
            ca.Function("grips", [q], ca.cse([ca.densify(grips)])),
            ca.Function("reach", [q, locked, error], ca.cse([ca.densify(reach)])),
        )

    def _gaze(self, q: ca.SX, work: ca.SX) -> Gaze:
        if self.attention:
            return gaze(self.kinematics, q, work, self.chain)
        return Gaze(ca.SX(0, 1), ca.SX(0, len(self.chain)), ca.SX(0, 3))

    def _swing(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return how a hanging arm turns with the trunk (2, 3), and its rates toward hanging (7,).

        The rates are in rad/s.
        """
        if self.hanging is None:
            return ca.SX(0, 3), ca.SX(0, 1)
        joints, arm = swinging(self.hanging), arm_of(self.hanging)
        trunk = ca.SX.sym("trunk", 3)
        hangs = hanging(trunk, self.hanging, ca.SX(ca.DM(self.comfort[joints])))
        both = ca.Function("hangs", [trunk], [hangs, ca.jacobian(hangs, trunk)])
        down, swing = both(q[TRUNK])
        goal = ca.SX(ca.DM(self.comfort[arm]))
        goal[[arm.index(joint) for joint in joints]] = down
        return swing, (goal - q[arm]) / self.relaxation_time


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows that the rates keep, in pelvis axes.

    Attributes:
        K: (r, 4 + n) rate of the rows per rate of pelvis and chain.
        softness: (r, r) softness of the rows.
        wanted: (r, 6) rate of the rows per twist.
        kept: (6 k, 6 k) the part of a motion that the hands keep: all except turns about a free
            tool.
    """

    K: ca.SX
    softness: ca.SX
    wanted: ca.SX
    kept: ca.SX

    @classmethod
    def of(
        cls,
        person: Following,
        stance: Stance,
        hands: list[tuple[ca.SX, ca.SX, ca.SX]],
        work: ca.SX,
        axis: ca.SX,
        seen: Gaze,
    ) -> _Rows:
        """Return the rows of hands and eyes."""
        moves, wants, about = [], [], []
        for p, _, jacobian in hands:
            moves.append(ca.horzcat(base_jacobian(p), jacobian[:, person.chain]))
            wants.append(carried_to(p - work))
            about.append(about_tool(axis, person.free_about_tool))
        turning = ca.diagcat(*about)
        kept = ca.SX.eye(6 * len(hands)) - turning
        firm = turning + person.damping**2 * ca.SX.eye(6 * len(hands))
        # In pelvis axes, the work moves opposite to the pelvis.
        by_pelvis = -seen.by_work @ base_jacobian(work)[:3, :]
        if not stance.moves:
            by_pelvis = ca.SX(*by_pelvis.shape)
        count = seen.residual.shape[0]
        lenient = ca.SX.eye(count) / person.attention if count else ca.SX(0, 0)
        return cls(
            ca.vertcat(kept @ ca.vertcat(*moves), ca.horzcat(by_pelvis, seen.by_joints)),
            ca.diagcat(firm, lenient),
            ca.vertcat(kept @ ca.vertcat(*wants), ca.horzcat(-seen.by_work, ca.SX(count, 3))),
            kept,
        )
