"""The model person as inverse kinematics: keep the contact, move the joints that cost least.

All rates of pelvis, trunk, neck and arms together minimise 1/2 v' W v + 1/2 |A v - a|^2 / s^2. The
rows A v = a are those of the hands, which follow the object, and those of the gaze, which follows
the work. A row with a smaller softness s is kept more exactly. With K for the rows, v = W^-1 K' (K
W^-1 K' + s^2)^-1 a: a soft row has a nonzero entry on the diagonal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import Annotated, Any, Final, Literal

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_kind, check_parameters, names_of, shown
from ergoqp.errors import InputError
from ergoqp.expressions import ldl, ldl_solve, pose_matrix, spd_inverse
from ergoqp.human import Body, Kinematics
from ergoqp.human.body import base_jacobian, offsets_of
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER, UPPER_BODY
from ergoqp.responses.stance_and_gaze import (
    HANGING_DEG,
    LEG_JOINTS,
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


def sensitivity_function(
    geometry: ca.Function, chain: list[int], hanging: list[int], hands: int
) -> ca.Function:
    """Return ``(q, locked, ...) -> (S, E)`` from the geometry, as products of matrices.

    Args:
        geometry: ``(q (32,), locked (32,), ...) -> (K', W^-1 K', softness, wanted, legs, swing,
            damping^2)`` of `ergoqp.responses.stance_and_gaze`. The damping is that of the rows of
            the hands [m, rad]; further inputs are those of the function too.
        chain: joints from the trunk up for which K has columns, after the four of the pelvis; those
            of the trunk come first.
        hanging: joints that swing with those of the trunk.
        hands: number of the rows of the hands, which come first.
    """
    inputs, names = geometry.mx_in(), geometry.name_in()
    K, pull, softness, wanted, legs, swing, damped = geometry.call(inputs)
    M, right = ca.SX.sym("M", *softness.shape), ca.SX.sym("right", *wanted.shape)
    solve = ca.Function("solve", [M, right], [ca.densify(ldl_solve(ldl(M), right))])
    multipliers = solve(K.T @ pull + softness, wanted)
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
    E = damped * multipliers[:hands, :]
    return ca.Function("sensitivity", inputs, [S, ca.densify(E)], names, ["sensitivity", "unmet"])


class _Numbers:
    """The numbers of a person, written into the functions or as further inputs of them."""

    def __init__(self, person: IkResponse, shared: bool) -> None:
        """Make symbols of the numbers of `IkResponse.constants` if the functions are shared."""
        parts = person.constants()
        self.inputs = {n: ca.SX.sym(n, len(value)) for n, value in parts.items()} if shared else {}
        given = self.inputs or {name: ca.SX(ca.DM(value)) for name, value in parts.items()}
        self.kinematics = person.kinematics
        if shared:
            self.kinematics = Kinematics(person.body, offsets=given["offsets"])
        self.weights, self.comfort, self.seat = given["weights"], given["comfort"], given["seat"]
        self.balance, self.relaxation_time = given["balance"], given["relaxation_time"]
        self.damping, self.attention = given["damping"], given["attention"]


def functions_of(person: IkResponse, shared: bool = False) -> tuple[ca.Function, ...]:
    """Return sensitivity, drift, contact, grips and reach, as `IkResponse` describes them.

    Args:
        person: the person.
        shared: whether the functions have the numbers of `IkResponse.constants` as further inputs,
            so that they are those of every person of this kind.
    """
    q, locked = ca.SX.sym("q", len(JOINTS)), ca.SX.sym("locked", len(JOINTS))
    numbers = _Numbers(person, shared)
    weights, kinematics, more = numbers.weights, numbers.kinematics, numbers.inputs
    chain = [INDEX[joint] for joint in person.chain if joint in UPPER_BODY]
    wish = (numbers.comfort - q) / numbers.relaxation_time * (1 - locked)
    if person.stance == "seated":
        stance = seated(numbers.seat)
    else:
        balance, time = numbers.balance, numbers.relaxation_time
        stance = standing(kinematics, q, weights, locked, wish, balance, time)
    hands = [kinematics.at(f"{hand}_grip", q) for hand in person.hands]
    position, rotation = contact_frame([(p, r) for p, r, _ in hands], person.tool)
    if person.looks:
        seen = gaze(kinematics, q, position, chain)
    else:
        seen = Gaze(ca.SX(0, 1), ca.SX(0, len(chain)), ca.SX(0, 3))
    rows = _rows(person, numbers, chain, stance, hands, position, rotation[:, 0], seen)
    K, softness, wanted, kept = rows
    free = (1 - locked[chain]) / weights[chain]
    pelvis = spd_inverse(stance.weight) if stance.moves else ca.SX(4, 4)
    pull = ca.diagcat(pelvis, ca.diag(free)) @ K.T
    factors = ldl(K @ pull + softness)
    swing, fall = _swing(person, numbers, q)
    side = len(hands)

    def in_joints(rates: ca.SX) -> ca.SX:
        """Return the rates of all 32 joints from those of pelvis and chain."""
        spread = stance.legs @ rates[:4, :] if stance.moves else ca.SX(len(JOINTS), rates.shape[1])
        spread[chain, :] = rates[4:, :]
        if person.hanging is not None:
            joints = swinging(person.hanging)
            spread[joints, :] = swing @ rates[4:7, :] * (1 - locked[joints])
        return spread

    own = ca.vertcat(stance.relax, wish[chain])
    asked = ca.vertcat(ca.SX(6 * side, 1), -seen.residual / numbers.relaxation_time)
    relax = in_joints(own + pull @ ldl_solve(factors, asked - K @ own))
    if person.hanging is not None:
        relax[arm_of(person.hanging)] += fall * (1 - locked[arm_of(person.hanging)])

    error = ca.SX.sym("e", 6 * side)
    to_hands = ca.diagcat(*[stance.yaw.T] * (2 * side)) @ error
    work = sum((to_hands[6 * i : 6 * i + 3] for i in range(side)), ca.SX(3, 1)) / side
    asked = ca.vertcat(kept @ to_hands, -seen.by_work @ work)
    reach = in_joints(pull @ ldl_solve(factors, asked))

    parts = {
        "K": K.T,
        "pull": pull,
        "softness": softness,
        "wanted": wanted @ ca.diagcat(stance.yaw.T, stance.yaw.T),
        "legs": stance.legs[LEGS, :],
        "swing": swing * (1 - locked[swinging(person.hanging)]) if person.hanging else swing,
        "damped": numbers.damping**2,
    }

    def function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
        inputs = inputs | more
        dense = ca.cse(list(map(ca.densify, outputs.values())))
        return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))

    both = {"q": q, "locked": locked}
    base = pose_matrix(stance.position, stance.yaw)
    grips = ca.horzcat(*(base @ pose_matrix(p, r) for p, r, _ in hands))
    poses = {"contact": base @ pose_matrix(position, rotation), "pelvis": base}
    return (
        sensitivity_function(
            function("geometry", both, parts),
            chain,
            [] if person.hanging is None else swinging(person.hanging),
            6 * side,
        ),
        function("drift", both, {"rates": relax}),
        function("contact", {"q": q}, poses),
        function("grips", {"q": q}, {"grips": grips}),
        function("reach", {**both, "e": error}, {"step": reach}),
    )


def _swing(person: IkResponse, numbers: _Numbers, q: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return how a hanging arm turns with the trunk (2, 3), and its rates toward hanging (7,).

    The rates are in rad/s.
    """
    if person.hanging is None:
        return ca.SX(0, 3), ca.SX(0, 1)
    joints, arm = swinging(person.hanging), arm_of(person.hanging)
    trunk = ca.SX.sym("trunk", 3)
    ease = ca.SX.sym("ease", 2)
    hangs = hanging(trunk, person.hanging, ease)
    both = ca.Function("hangs", [trunk, ease], [hangs, ca.jacobian(hangs, trunk)])
    down, swing = both(q[TRUNK], numbers.comfort[joints])
    goal = numbers.comfort[arm]
    goal[[arm.index(joint) for joint in joints]] = down
    return swing, (goal - q[arm]) / numbers.relaxation_time


def _rows(
    person: IkResponse,
    numbers: _Numbers,
    chain: list[int],
    stance: Stance,
    hands: list[tuple[ca.SX, ca.SX, ca.SX]],
    work: ca.SX,
    axis: ca.SX,
    seen: Gaze,
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the rows of hands and eyes that the rates keep, in pelvis axes.

    Returns:
        K (r, 4 + n), the rate of the rows per rate of pelvis and chain; their softness (r, r);
        their wanted rate (r, 6) per twist; and (6 k, 6 k) the part of a motion that the hands
        keep: all except turns about a free tool.
    """
    moves, wants, about = [], [], []
    for p, _, jacobian in hands:
        moves.append(ca.horzcat(base_jacobian(p), jacobian[:, chain]))
        wants.append(carried_to(p - work))
        about.append(about_tool(axis, person.free_about_tool))
    turning = ca.diagcat(*about)
    kept = ca.SX.eye(6 * len(hands)) - turning
    firm = turning + numbers.damping**2 * ca.SX.eye(6 * len(hands))
    # In pelvis axes, the work moves opposite to the pelvis.
    by_pelvis = -seen.by_work @ base_jacobian(work)[:3, :]
    if not stance.moves:
        by_pelvis = ca.SX(*by_pelvis.shape)
    count = seen.residual.shape[0]
    lenient = ca.SX.eye(count) / numbers.attention if count else ca.SX(0, 0)
    return (
        ca.vertcat(kept @ ca.vertcat(*moves), ca.horzcat(by_pelvis, seen.by_joints)),
        ca.diagcat(firm, lenient),
        ca.vertcat(kept @ ca.vertcat(*wants), ca.horzcat(-seen.by_work, ca.SX(count, 3))),
        kept,
    )


@dataclass(frozen=True)
class IkResponse:
    """S(q) of a person who keeps the contact and moves the joints that cost least.

    The joint rates minimise 1/2 v' W v subject to J v = G xi. So v = S xi with S = W^-1 J' (J W^-1
    J')^-1 G: the weighted pseudo-inverse of Whitney (1972). If the person stands, the rows of the
    soles are eliminated exactly (`ergoqp.responses.stance_and_gaze`). The rows of the hands are
    damped, and looking at the work adds soft rows. A locked joint has a zero in W^-1, and the
    others follow without it.

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
            share what the eyes do not turn, see `ergoqp.responses.stance_and_gaze`. Otherwise the
            neck stays as it is.
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
        chains = ("trunk", *(("neck",) if self.looks else ()), *self.hands)
        moved = [joint for joint in UPPER_BODY if joint.startswith(chains)]
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
        return functions_of(self)

    def constants(self) -> dict[str, np.ndarray]:
        """Return the numbers of the person, by name: all in which two of one kind differ.

        They are the further inputs of the functions of `shared`: ``offsets`` (m,) [m],
        ``weights`` and ``comfort`` (32,), and single numbers (1,).
        """
        seat = self.seat if self.stance == "seated" else 0.0
        names = ("balance", "relaxation_time", "damping", "attention")
        found = {"offsets": offsets_of(self.body), "weights": self.weight_vector}
        found |= {"comfort": self.comfort, "seat": np.array([seat])}
        return found | {name: np.array([getattr(self, name)]) for name in names}

    def structure(self) -> tuple[Any, ...]:
        """Return all that decides which operations the functions of `shared` have."""
        return self.hands, self.stance, self.tool, self.free_about_tool, self.looks, self.hanging

    def shared(self) -> tuple[ca.Function, ca.Function]:
        """Return `sensitivity` and `contact` with the `constants` as further inputs."""
        return _shared(*self.structure())


@lru_cache(maxsize=16)
def _shared(
    hands: tuple[str, ...],
    stance: Literal["standing", "seated"],
    tool: Literal["along", "thumb"],
    free_about_tool: bool,
    looks: bool,
    hanging: str | None,
) -> tuple[ca.Function, ca.Function]:
    """Return the functions of every person of a kind, see `IkResponse.shared`."""
    kind = IkResponse(
        hands=hands,
        stance=stance,
        tool=tool,
        free_about_tool=free_about_tool,
        looks=looks,
        free_arm="rests" if hanging is None else "hangs",
    )
    found = functions_of(kind, shared=True)
    return found[0], found[2]


_OTHERS = ("body", "weights", "comfort_deg")
_TERMS = tuple(each.name for each in fields(IkResponse) if each.name not in _OTHERS)
"""Fields of a response that are written as they are."""


def response_as_dict(response: IkResponse) -> dict[str, Any]:
    """Return a response as numbers, texts and lists. `response_from_dict` makes an equal one."""
    return {
        **response.body.as_dict(),
        "weights": dict(zip(JOINTS, response.weight_vector.tolist(), strict=True)),
        "comfort_deg": {name: float(degrees) for name, degrees in response.comfort_deg.items()},
        **{name: plain(getattr(response, name)) for name in _TERMS},
    }


def response_from_dict(values: Mapping[str, Any]) -> IkResponse:
    """Return the response from the result of `response_as_dict`.

    Raises:
        KeyError, TypeError, InputError: if it does not describe a response.
    """
    body = Body(values["stature_m"], values["lengths_m"], values["mass_kg"])
    terms = {name: values[name] for name in (*_TERMS, "weights", "comfort_deg")}
    return IkResponse(body=body, **terms)


def plain(value: Any) -> Any:
    """Return arrays and tuples as lists, NumPy numbers as Python numbers, all else unchanged."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return list(value)
    return value.item() if isinstance(value, np.generic) else value
