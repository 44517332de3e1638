"""The model person as inverse kinematics: keep the contact, move the joints that cost least."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Final, Literal

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_kind, check_parameters, names_of, shown
from ergoqp.errors import InputError
from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.responses.following import (
    HANGING_DEG,
    LEG_JOINTS,
    Following,
    Stance,
    arm_of,
    seat_in_words,
    seated,
    standing,
    swinging,
)

DEFAULT_WEIGHTS: Final[dict[str, float]] = {
    "trunk_flexion": 3.5,
    "trunk_side_bend": 8.0,
    "trunk_twist": 5.0,
    "shoulder_flexion": 1.0,
    "shoulder_abduction": 3.0,
    "shoulder_rotation": 0.8,
    "elbow_flexion": 0.6,
    "forearm_pronation": 0.4,
    "wrist_flexion": 1.0,
    "wrist_deviation": 1.5,
    "hip_flexion": 2.0,
    "hip_abduction": 5.0,
    "hip_rotation": 5.0,
    "knee_flexion": 3.5,
    "ankle_flexion": 3.0,
    "ankle_inversion": 5.0,
}
"""Relative cost of moving each joint, the same on both sides.

The trunk carries half of the body; the forearm carries little.
"""

DEFAULT_COMFORT_DEG: Final[dict[str, dict[str, float]]] = {
    "standing": {"hip_flexion": 4.0, "knee_flexion": 8.0, "ankle_flexion": 4.0},
    "seated": {"hip_flexion": 85.0, "knee_flexion": 85.0},
}
"""Comfort angles of the legs if a problem does not give them [deg].

People do not stand with locked knees, and locked knees cannot follow.
"""


def per_joint(
    given: Mapping[str, float], defaults: Mapping[str, float], rest: float, what: str
) -> np.ndarray:
    """Return one value per joint (32,) from values by name.

    A name without a side means both sides.

    Raises:
        InputError: if a name is not the name of a joint.
    """
    values = np.full(len(JOINTS), rest)
    for table in (defaults, given):
        # Names with a side come last. So they override the name of both sides in any order.
        for name in sorted(table, key=lambda key: key in INDEX):
            targets = [name] if name in INDEX else [f"{side}_{name}" for side in SIDES]
            if any(target not in INDEX for target in targets):
                raise InputError(
                    f"{what}: got {name!r}, allowed a joint such as 'trunk_flexion' or"
                    " 'elbow_flexion'"
                )
            for target in targets:
                values[INDEX[target]] = table[name]
    return values


_ARM: Final = ("shoulder", "elbow", "forearm", "wrist")


@dataclass(frozen=True)
class IkResponse:
    """S(q) of a person who keeps the contact and moves the joints that cost least.

    The joint rates minimise 1/2 v' W v subject to J v = G xi. So v = S xi with S = W^-1 J' (J W^-1
    J')^-1 G: the weighted pseudo-inverse of Whitney (1972). If the person stands, the rows of the
    soles are eliminated exactly (`ergoqp.responses.following`). The rows of the hands are damped,
    and looking at the work adds soft rows. A locked joint has a zero in W^-1, and the others follow
    without it.

    Attributes:
        body: the body of the model person.
        hands: ``("right",)``, ``("left",)`` or both, in any order; kept as ``("right", "left")``.
            The contact frame is at the grip, or midway between the two.
        stance: ``"standing"`` or ``"seated"``.
        seat_height: height of the hip centres above the floor when seated [m]. None: the seat is
            set to the person, so that the feet stand on the floor with the legs in comfort, see
            `seat` and `feet`.
        tool: axis of the tool in the hand, a key of `TOOL_AXES`.
        free_about_tool: whether the hand may turn about the tool's axis.
        weights: cost of moving a joint (dimensionless), by name with or without its side. Default:
            `DEFAULT_WEIGHTS`.
        comfort_deg: posture toward which the person relaxes, by joint name, with or without the
            side [deg]. Default: `DEFAULT_COMFORT_DEG` for the legs, zero for the others.
        balance: cost of moving the pelvis away from above the feet when standing, per (m/s)^2 in
            the units of `weights`.
        relaxation_time: time constant of the relaxation toward the comfort posture [s].
        damping: damping of the rows of the hands [m, rad], so that singular arms do not ask for
            infinite rates.
        looks: whether the person looks at the work. The neck then follows it, and trunk and neck
            share what the eyes do not turn, see `ergoqp.responses.following`. Otherwise the neck
            stays as it is.
        attention: cost of not seeing the work with ease, per rad^2 beyond the easy turn of the
            eyes, in the units of `weights`.
        free_arm: position of an arm that holds nothing. It ``"hangs"``, or it ``"rests"`` on a
            thigh or a desk, where it stays as it is. None: it hangs when standing and rests when
            seated. An arm that holds the object too is one of `hands`.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Source:
        Whitney's weighted pseudo-inverse (1972).

    Example:
        >>> import numpy as np
        >>> from ergoqp.human import Body
        >>> from ergoqp.responses import IkResponse
        >>> response = IkResponse(body=Body(1.68), comfort_deg={"elbow_flexion": 90.0})
        >>> rates, unmet = response.sensitivity()(response.comfort, np.zeros(32))
        >>> rates.shape, response.hands
        ((32, 6), ('right',))
    """

    body: Body = field(default_factory=Body)
    hands: tuple[str, ...] = ("right",)
    stance: Literal["standing", "seated"] = "standing"
    seat_height: Annotated[float, Range(0.2, 1.2, "m")] | None = None
    tool: Literal["along", "thumb"] = "along"
    free_about_tool: bool = True
    weights: Mapping[str, Annotated[float, Range(1e-9, 1e9)]] = field(default_factory=dict)
    comfort_deg: Mapping[str, Annotated[float, Range(-360.0, 360.0, "deg")]] = field(
        default_factory=dict
    )
    balance: Annotated[float, Range(0.0, 1e6)] = 60.0
    relaxation_time: Annotated[float, Range(1e-2, 1e3, "s")] = 1.0
    damping: Annotated[float, Range(1e-6, 1.0)] = 0.02
    looks: bool = True
    attention: Annotated[float, Range(1e-3, 1e6)] = 8.0
    free_arm: Literal["hangs", "rests"] | None = None

    def __post_init__(self) -> None:
        """Check the terms, so that errors are raised here and not in the loop."""
        check_kind("body", self.body, Body, "a Body")
        allowed = "'right', 'left' or both, each once, in a list"
        hands = names_of("hands", self.hands, allowed)
        if not set(hands) <= set(SIDES) or len(set(hands)) < len(hands):
            raise InputError(f"hands: got {shown(hands)}, allowed {allowed}")
        # The contact frame is made from the right grip to the left one.
        object.__setattr__(self, "hands", tuple(side for side in SIDES if side in hands))
        for name, unit in (("comfort_deg", "its angle [deg]"), ("weights", "its weight")):
            check_kind(name, getattr(self, name), Mapping, f"a table of joints, each with {unit}")
        check_parameters(self)
        outside = ~((self.comfort >= LOWER - 1e-9) & (self.comfort <= UPPER + 1e-9))
        if outside.any():
            j = int(np.argmax(outside))
            got, low, high = np.degrees([self.comfort[j], LOWER[j], UPPER[j]])
            raise InputError(
                f"comfort_deg: {JOINTS[j]}: got {got:g}, which is beyond its range, allowed {low:g}"
                f" to {high:g}"
            )
        per_joint(self.weights, DEFAULT_WEIGHTS, 1.0, "weights")
        if self.stance == "standing" and self.seat_height is not None:
            raise InputError(
                f"seat_height: got {self.seat_height!r} of a person who stands, allowed none, or"
                " stance 'seated'"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields only; another process builds the expressions again."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    coordinates = JOINTS
    largest = float(np.pi)

    @cached_property
    def chain(self) -> tuple[str, ...]:
        """Joints that follow by themselves, in the order of `ergoqp.JOINTS`.

        These are the trunk, the neck of a person who looks at the work, the working arms and, when
        standing, the legs.
        """
        chains = ("trunk", *(("neck",) if self.looks else ()))
        chains += tuple(f"{hand}_{part}" for hand in self.hands for part in _ARM)
        moved = [joint for joint in JOINTS[:20] if joint.startswith(chains)]
        if self.stance == "standing":
            moved += [joint for side in SIDES for joint in LEG_JOINTS[side]]
        return tuple(moved)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that the object can move: the chain, and the shoulder of an arm that hangs."""
        swings = () if self.hanging is None else [JOINTS[i] for i in swinging(self.hanging)]
        return tuple(joint for joint in JOINTS if joint in self.chain or joint in swings)

    @property
    def hanging(self) -> str | None:
        """Side of the arm that hangs, or None."""
        free = next((side for side in SIDES if side not in self.hands), None)
        stays = self.free_arm == "rests" or (self.free_arm is None and self.stance == "seated")
        return None if stays else free

    @cached_property
    def comfort(self) -> np.ndarray:
        """The comfort posture (32,) [rad]."""
        given, defaults = dict(self.comfort_deg), dict(DEFAULT_COMFORT_DEG[self.stance])
        if self.hanging is not None:
            # Names without a side mean the working arm. Only names with its side mean this one.
            for joint in (JOINTS[i] for i in arm_of(self.hanging)):
                angle = HANGING_DEG.get(joint.removeprefix(f"{self.hanging}_"), 0.0)
                given.setdefault(joint, angle)
        return np.radians(per_joint(given, defaults, 0.0, "comfort_deg"))

    @property
    def weight_vector(self) -> np.ndarray:
        """Cost of the rate of each joint (32,)."""
        return per_joint(self.weights, DEFAULT_WEIGHTS, 1.0, "weights")

    @cached_property
    def kinematics(self) -> Kinematics:
        """Kinematics of the modelled body."""
        return Kinematics(self.body)

    @cached_property
    def seat(self) -> float:
        """Height of the hip centres above the floor when seated [m].

        If no height is given, the lower foot stands on the floor.

        Raises:
            InputError: if no height is given and the comfort posture of the legs gives a height
                outside 0.05 to 1.2 m.
        """
        if self.seat_height is not None:
            return self.seat_height
        height = -self._sole_below_pelvis
        if not 0.05 <= height <= 1.2:
            raise InputError(
                "seat_height: got none, and with the feet on the floor comfort_deg puts the seat"
                f" at {height:.2f} m, allowed 0.05 to 1.2, or a seat_height"
            )
        return height

    @property
    def feet(self) -> float:
        """Height of the lower sole above the floor when seated, with the legs in comfort [m].

        A negative value means below the floor.
        """
        return self.seat + self._sole_below_pelvis

    @property
    def footing(self) -> str:
        """What carries the person, as a clause for messages."""
        if self.stance == "standing":
            return "the soles stay where they stand"
        return seat_in_words(self.seat, self.feet)

    @property
    def _sole_below_pelvis(self) -> float:
        return min(
            float(self.kinematics.at(f"{side}_sole", ca.DM(self.comfort))[0][2]) for side in SIDES
        )

    def expression(self, q: ca.MX) -> ca.MX:
        """Return S (32, 6) at `q` (32,) [rad] with no joint locked.

        The twist is world-aligned, linear first.
        """
        return self.sensitivity()(q, 0)[0]

    def sensitivity(self) -> ca.Function:
        """Return ``(q (32,), locked (32,)) -> (S (32, 6), E (k, 6))``.

        See `ergoqp.responses.Response`.
        """
        return self._functions[0]

    def drift(self) -> ca.Function:
        """Return ``(q (32,), locked (32,)) -> rates (32,)`` [rad/s].

        The rates relax toward comfort without moving hands or soles.
        """
        return self._functions[1]

    def contact(self) -> ca.Function:
        """Return ``q (32,) -> (contact pose (4, 4), pelvis pose (4, 4))``.

        Both are in the world, which is fixed to the stance.
        """
        return self._functions[2]

    def grips(self) -> ca.Function:
        """Return ``q (32,) -> grip poses side by side (4, 4 k)`` in the world, one per hand."""
        return self._functions[3]

    def reach(self) -> ca.Function:
        """Return ``(q (32,), locked (32,), e (6 k,)) -> step (32,)``.

        It is the smallest step that moves the grips by e, in world axes.
        """
        return self._functions[4]

    @cached_property
    def _functions(self) -> tuple[ca.Function, ...]:
        return Following(
            kinematics=self.kinematics,
            hands=self.hands,
            tool=self.tool,
            free_about_tool=self.free_about_tool,
            damping=self.damping,
            weights=self.weight_vector,
            comfort=self.comfort,
            relaxation_time=self.relaxation_time,
            chain=[INDEX[joint] for joint in self.chain if joint in JOINTS[:20]],
            stand=self._stance,
            attention=self.attention if self.looks else 0.0,
            hanging=self.hanging,
        ).functions

    def _stance(self, q: ca.SX, weights: ca.SX, locked: ca.SX, wish: ca.SX) -> Stance:
        if self.stance == "seated":
            return seated(self.seat)
        return standing(
            self.kinematics, q, weights, locked, wish, self.balance, self.relaxation_time
        )
