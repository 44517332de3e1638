"""The MuJoCo model of one person with mass: segments, inertias, muscles, and their numbers.

Masses and inertias of a person's segments, by sex. The numbers are those of P. de Leva (1996),
"Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomechanics 29 (9): masses
as shares of the body's mass, and centres of mass and radii of gyration as shares of the segments'
lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import mujoco
import numpy as np

from ergoqp.human import FRACTIONS, Body
from ergoqp.human.body import NOMINAL_STATURE
from ergoqp.joints import JOINTS, SIDES
from ergoqp.lab.people.habits import Sex
from ergoqp.limits import AXES
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.registry import data_folder


class Segment(NamedTuple):
    """One row of the table.

    Attributes:
        mass: share of the body's mass.
        centre: centre of mass, from the upper end (of a foot: from the heel), as a share of
            the length.
        sagittal: radius of gyration about the axis forward, as a share of the length.
        transverse: the same about the axis to the left.
        longitudinal: the same about the segment's own axis.
    """

    mass: float
    centre: float
    sagittal: float
    transverse: float
    longitudinal: float


SEGMENTS: Final[dict[Sex, dict[str, Segment]]] = {
    "female": {
        "head": Segment(0.0668, 0.5894, 0.330, 0.359, 0.318),
        "upper_trunk": Segment(0.1545, 0.2077, 0.746, 0.502, 0.718),
        "middle_trunk": Segment(0.1465, 0.4512, 0.433, 0.354, 0.415),
        "lower_trunk": Segment(0.1247, 0.4920, 0.433, 0.402, 0.444),
        "upper_arm": Segment(0.0255, 0.5754, 0.278, 0.260, 0.148),
        "forearm": Segment(0.0138, 0.4559, 0.261, 0.257, 0.094),
        "hand": Segment(0.0056, 0.3427, 0.244, 0.208, 0.154),
        "thigh": Segment(0.1478, 0.3612, 0.369, 0.364, 0.162),
        "shank": Segment(0.0481, 0.4352, 0.267, 0.263, 0.092),
        "foot": Segment(0.0129, 0.4014, 0.299, 0.279, 0.139),
    },
    "male": {
        "head": Segment(0.0694, 0.5976, 0.362, 0.376, 0.312),
        "upper_trunk": Segment(0.1596, 0.2999, 0.716, 0.454, 0.659),
        "middle_trunk": Segment(0.1633, 0.4502, 0.482, 0.383, 0.468),
        "lower_trunk": Segment(0.1117, 0.6115, 0.615, 0.551, 0.587),
        "upper_arm": Segment(0.0271, 0.5772, 0.285, 0.269, 0.158),
        "forearm": Segment(0.0162, 0.4574, 0.276, 0.265, 0.121),
        "hand": Segment(0.0061, 0.3624, 0.288, 0.235, 0.184),
        "thigh": Segment(0.1416, 0.4095, 0.329, 0.329, 0.149),
        "shank": Segment(0.0433, 0.4395, 0.251, 0.246, 0.102),
        "foot": Segment(0.0137, 0.4415, 0.257, 0.245, 0.124),
    },
}
"""The rows by sex and segment.

The head includes the neck and is measured from the vertex over the head's own length. The
trunk has three parts. The hand is measured from the wrist over its whole length, the foot from
the heel.
"""

_TRUNK_PARTS: Final[dict[Sex, tuple[float, float, float]]] = {
    "female": (142.5, 205.3, 181.5),
    "male": (170.7, 215.5, 145.7),
}
"""Lengths of the upper, middle and lower trunk in the same sample [mm].

Together they reach from the suprasternal notch, where `Body` has the base of the neck, to the
middle of the hip centres.
"""

_HEEL: Final = 0.20
"""Distance of the heel behind the ankle, as a share of the foot's length, as in the model."""


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre (3,) [m] and principal inertia (3,) about it [kg m^2] of a rigid body."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray


def inertias(body: Body, sex: Sex) -> dict[str, Inertia]:
    """Return the inertia of every body of ``models/person_with_mass.xml``, in its own axes."""
    rows, length = SEGMENTS[sex], body.lengths
    # The shares of the table are rounded, so they are scaled to the whole body.
    sides = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
    whole = body.mass / sum(row.mass * (1 + (name in sides)) for name, row in rows.items())

    def along(name: str, upper: np.ndarray, down: np.ndarray, long: float) -> Inertia:
        row = rows[name]
        radii = np.array([row.sagittal, row.transverse, row.longitudinal])
        if down[0]:  # The longitudinal axis of a foot points forward.
            radii = radii[[2, 1, 0]]
        mass = row.mass * whole
        return Inertia(mass, upper + row.centre * long * down, mass * (radii * long) ** 2)

    below, nothing = np.array([0.0, 0.0, -1.0]), np.zeros(3)
    parts = np.array(_TRUNK_PARTS[sex])
    parts *= length["trunk"] / parts.sum()
    ends = length["trunk"] - np.concatenate([[0.0], np.cumsum(parts)])
    trunk = [
        along(name, np.array([0.0, 0.0, end]), below, long)
        for name, end, long in zip(
            ("upper_trunk", "middle_trunk", "lower_trunk"), ends[:3], parts, strict=True
        )
    ]
    top = np.array([0.0, 0.0, length["neck"] + length["head"]])
    found = {
        "pelvis": trunk[2],
        "trunk": _joined(trunk[0], trunk[1]),
        "head": along("head", top, below, length["head"]),
    }
    heel = np.array([-_HEEL * length["foot_length"], 0.0, -0.55 * length["foot_height"]])
    for side in SIDES:
        for name in ("upper_arm", "forearm", "hand", "thigh", "shank"):
            found[f"{side}_{name}"] = along(name, nothing, below, length[name])
        found[f"{side}_foot"] = along("foot", heel, np.array([1.0, 0, 0]), length["foot_length"])
    return found


def _joined(one: Inertia, other: Inertia) -> Inertia:
    """Return one body that is equivalent to two, one above the other."""
    mass = one.mass + other.mass
    centre = (one.mass * one.centre + other.mass * other.centre) / mass
    inertia = one.inertia + other.inertia
    for part in (one, other):
        away = part.centre - centre
        inertia = inertia + part.mass * (away @ away - away**2)
    return Inertia(mass, centre, inertia)


FRICTION: Final = 0.8
"""Friction of soles on the floor and trousers on the seat; see ``models/person_with_mass.xml``."""


class Muscle(NamedTuple):
    """How a joint is held.

    Attributes:
        stiffness: stiffness toward the wanted posture [N m/rad].
        damping: damping [N m s/rad].
        strength: greatest torque [N m].
        effort: cost of a deviation from comfort, per rad^2; relative.
    """

    stiffness: float
    damping: float
    strength: float
    effort: float


MUSCLES: Final[dict[str, Muscle]] = {
    "trunk_flexion": Muscle(500.0, 60.0, 350.0, 3.0),
    "trunk_side_bend": Muscle(500.0, 50.0, 250.0, 7.0),
    "trunk_twist": Muscle(250.0, 20.0, 150.0, 5.0),
    "neck_flexion": Muscle(30.0, 2.0, 50.0, 2.0),
    "neck_side_bend": Muscle(30.0, 2.0, 50.0, 4.0),
    "neck_twist": Muscle(20.0, 1.0, 25.0, 2.0),
    "shoulder_flexion": Muscle(30.0, 6.0, 90.0, 1.2),
    "shoulder_abduction": Muscle(30.0, 6.0, 80.0, 2.5),
    "shoulder_rotation": Muscle(15.0, 2.0, 50.0, 1.0),
    "elbow_flexion": Muscle(20.0, 3.0, 70.0, 0.7),
    "forearm_pronation": Muscle(6.0, 0.3, 12.0, 0.5),
    "wrist_flexion": Muscle(8.0, 0.4, 18.0, 1.2),
    "wrist_deviation": Muscle(10.0, 0.4, 18.0, 1.8),
    "hip_flexion": Muscle(500.0, 50.0, 250.0, 1.5),
    "hip_abduction": Muscle(500.0, 50.0, 200.0, 4.0),
    "hip_rotation": Muscle(150.0, 10.0, 80.0, 4.0),
    "knee_flexion": Muscle(400.0, 30.0, 280.0, 2.5),
    "ankle_flexion": Muscle(300.0, 20.0, 200.0, 2.0),
    "ankle_inversion": Muscle(100.0, 6.0, 60.0, 4.0),
}
"""By joint, the same for both sides.

Stiffness: shoulder and elbow are those of a hand that is led and does not resist, at the lower
end of the values of Mussa-Ivaldi, Hogan and Bizzi (1985) for hands that keep their place, of
the order of tens. The wrist is that of a firm grasp, several times the passive one of Formica
et al. (2012), which is of the order of one. The ankles are those of quiet standing (Loram and
Lakie 2002: both together about nine tenths of the body's toppling stiffness). The trunk is
active, of the order of hundreds as in the lumbar spines of Cholewicki and McGill (1996). Knees
and hips are such that the stance is not softer than the ankles. Damping: 0.2 to 0.7 of
critical with the distal segments. Strength: of the order of the greatest voluntary torques of
untrained adults. Effort: the trunk carries half the body, the forearm nothing.
"""


def per_joint(field: str) -> np.ndarray:
    """Return one column of `MUSCLES` for every joint (32,)."""
    without_side = [name.removeprefix("right_").removeprefix("left_") for name in JOINTS]
    return np.array([getattr(MUSCLES[name], field) for name in without_side])


@dataclass(frozen=True)
class MotorParameters:
    """How a person of this kind plans, balances and holds; the same for all unless noted.

    Attributes:
        grasp_stiffness: stiffness of a hand's grasp of the object [N/m]; fingertips are of the
            order of 1000, a whole fist several times that.
        grasp_damping: damping of the grasp [N s/m].
        grasp_lever: half the width of what the hand closes around, along the tool axis [m].
        slip_force: force at which the hand slides along the object [N]: a moderate squeeze of
            80 N from both sides at a friction of 0.5.
        body_time: time constant with which trunk, neck and legs follow the planned posture
            [s].
        arm_time: the same of the arms, which only have to yield to what they hold [s]: of the
            order of an arm's long-latency reflex.
        plan_period: time between two updates of the plan [s].
        tick: time between two commands to the muscles [s].
        grip_used: share of the available friction that a person uses, so that nothing slides.
        sway_stiffness: stiffness of the centre of mass over the soles, per mass [1/s^2].
        sway_damping: damping of the same [1/s].
        load_time: time constant with which a load in the hand is felt, or a load to come is
            taken over [s].
        lift_time: time constant with which a sinking load is lifted again [s].
        bracing: share of a felt load that the legs brace against.
        ahead: distance ahead of the ankles of the place over which the centre of mass is kept,
            as a share of the foot's length: in quiet standing it is of the order of 50 mm.
        farthest_over: largest distance from that place to which anybody moves their centre of
            mass by themselves [m]: somewhat less than half the way to the toes.
        eye_range: angle that the eyes turn without the neck [rad].
    """

    grasp_stiffness: float = 3000.0
    grasp_damping: float = 60.0
    grasp_lever: float = 0.05
    slip_force: float = 80.0
    body_time: float = 0.4
    arm_time: float = 0.1
    plan_period: float = 0.05
    tick: float = 0.01
    grip_used: float = 0.9
    sway_stiffness: float = 8.0
    sway_damping: float = 4.0
    load_time: float = 0.15
    lift_time: float = 3.0
    bracing: float = 0.7
    ahead: float = 0.17
    farthest_over: float = 0.05
    eye_range: float = 0.35


HABITS: Final = MotorParameters()


@dataclass(frozen=True)
class SoftRobot:
    """The impedance with which the simulated robot holds the object.

    Its damping is to the ground, so it lags by damping over stiffness, 50 ms in shift and
    turn.

    Attributes:
        stiffness: stiffness of a shift [N/m].
        damping: damping of a shift [N s/m].
        turn_stiffness: stiffness of a turn [N m/rad].
        turn_damping: damping of a turn [N m s/rad].
        load: mass of the object [kg], which the robot carries.
    """

    stiffness: float = 5000.0
    damping: float = 250.0
    turn_stiffness: float = 200.0
    turn_damping: float = 10.0
    load: float = 3.0


SOFT_ROBOT: Final = SoftRobot()

SOFT_ROBOT_DECLARED: Final = DeclaredRobot(lag=0.08, pose_noise=0.010, pose_noise_deg=1.0)
"""The declaration of that robot for a controller, as upper bounds.

It contains the lag with a body on the robot, and how far a person who is led pulls and pushes
it off its path (at full speed mostly below 30 N, up to 80 N). When led people pulled half as
hard again, one loop in three had a robot fault with 60 ms and 5 mm, and none with these
values.
"""


PERSON_DOFS: Final = 6 + len(JOINTS)
"""Pelvis (shift in the world, turn in its own axes), then the joints. The object's come after."""

ROBOT_GROUP: Final = 1
HAND_GROUP: Final = 2
"""Actuator groups of the robot and of the hands, so that each can let go."""

BALL_END: Final = 0.18 / (FRACTIONS["foot_length"] * NOMINAL_STATURE)
"""How far the sole reaches ahead of the ankle, as a share of the foot's length."""

ON_OBJECT: Final = "_object"
"""Ending of the name of the site on the object that a site of a hand holds."""

# Scales of the x, y and z offsets of everything that is attached to a body of the model.
_SCALED_BY: Final = {
    "pelvis": ("girth", "hip_width", "girth"),
    "trunk": ("girth", "shoulder_width", "trunk"),
    "head": ("girth", "girth", "head"),
    "upper_arm": ("girth", "girth", "upper_arm"),
    "forearm": ("girth", "girth", "forearm"),
    "hand": ("girth", "girth", "hand"),
    "thigh": ("girth", "girth", "thigh"),
    "shank": ("girth", "girth", "shank"),
    "foot": ("foot_length", "girth", "foot_height"),
}
_NOT_PERSON: Final = ("world", "robot", "object")


def build(
    body: Body, sex: Sex, hands: tuple[str, ...], axis: np.ndarray, free: bool, seat: float | None
) -> mujoco.MjModel:
    """Return the model of a person with the object, the robot and, when seated, the seat.

    Args:
        body: lengths and mass.
        sex: sex, for the shares of mass.
        hands: hands that hold the object.
        axis: axis of the tool in the frame of the grip (3,).
        free: whether a hand may turn about it.
        seat: height of the hip centres above the floor [m]; None: the person stands.
    """
    spec = mujoco.MjSpec.from_string(_nominal_xml())
    _scale(spec, body)
    for name, own in inertias(body, sex).items():
        part = spec.body(name)
        part.explicitinertial, part.mass = True, own.mass
        part.ipos, part.inertia = own.centre, own.inertia
    _place_seat(spec, body, seat)
    _add_muscles(spec)
    _add_grasps(spec, hands, axis, free)
    _add_robot(spec)
    return spec.compile()


def holding_points(model: mujoco.MjModel) -> list[str]:
    """Return the names of the sites with which the hands hold, those of the right hand first."""
    names = (model.site(number).name for number in range(model.nsite))
    return [name for name in names if "_hold_" in name and not name.endswith(ON_OBJECT)]


@lru_cache(maxsize=1)
def _nominal_xml() -> str:
    return (data_folder("models") / "person_with_mass.xml").read_text(encoding="utf-8")


def _scale(spec: mujoco.MjSpec, body: Body) -> None:
    girth = body.stature / NOMINAL_STATURE
    factor = {
        name: length / (FRACTIONS[name] * NOMINAL_STATURE) for name, length in body.lengths.items()
    }
    factor["girth"] = girth

    def scale_of(owner: str) -> np.ndarray:
        key = owner.removeprefix("right_").removeprefix("left_")
        return np.array([factor[name] for name in _SCALED_BY[key]])

    for child in spec.bodies[1:]:
        if child.name not in (*_NOT_PERSON, "pelvis"):
            scale = scale_of(child.parent.name)
            if child.name.endswith("upper_arm"):
                scale[2] = factor["shoulder_height"]
            child.pos = np.asarray(child.pos) * scale
    for site in spec.sites:
        if site.parent.name not in _NOT_PERSON:
            site.pos = np.asarray(site.pos) * scale_of(site.parent.name)
    for name in ("eyes", "head_top"):
        # From the base of the neck upward, first the neck is scaled, then the head.
        site = spec.site(name)
        above = float(site.pos[2]) / factor["head"] - FRACTIONS["neck"] * NOMINAL_STATURE
        site.pos = [site.pos[0], 0.0, body.lengths["neck"] + above * factor["head"]]
    for geom in spec.geoms:
        if geom.parent.name in _NOT_PERSON:
            continue
        scale = scale_of(geom.parent.name)
        if geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom.fromto = np.asarray(geom.fromto) * np.tile(scale, 2)
            geom.size = np.asarray(geom.size) * girth
        elif geom.parent.name.endswith("foot"):
            geom.pos, geom.size = np.asarray(geom.pos) * scale, np.asarray(geom.size) * scale
        else:
            geom.pos, geom.size = np.asarray(geom.pos) * girth, np.asarray(geom.size) * girth


def _place_seat(spec: mujoco.MjSpec, body: Body, seat: float | None) -> None:
    geom = spec.geom("seat")
    if seat is None:
        spec.delete(geom)
        return
    under = spec.geom("buttocks")
    top = seat + float(under.pos[2]) - float(under.size[2])
    geom.size, geom.pos = [0.25, 0.25, 0.02], [0.0, 0.0, top - 0.02]


def _add_muscles(spec: mujoco.MjSpec) -> None:
    """Give every joint an actuator that pulls to an angle, and the strength of its muscles."""
    columns = (per_joint(name) for name in ("stiffness", "damping", "strength"))
    for name, stiffness, damping, strength in zip(JOINTS, *columns, strict=True):
        joint = spec.joint(name)
        joint.actfrclimited, joint.actfrcrange = True, [-strength, strength]
        _spring(spec, name, stiffness, damping).target = name


def _add_grasps(spec: mujoco.MjSpec, hands: tuple[str, ...], axis: np.ndarray, free: bool) -> None:
    """Let every hand hold points of the object by springs in three directions."""
    held = spec.body("object")
    offsets = HABITS.grasp_lever * np.array([axis, -axis])
    if not free:
        # With a third point beside the axis the hand cannot turn about it.
        beside = np.cross(axis, [0.0, 1.0, 0.0])
        offsets = np.vstack([offsets, HABITS.grasp_lever * beside])
    count = len(offsets)
    stiffness, damping = HABITS.grasp_stiffness / count, HABITS.grasp_damping / count
    for side in hands:
        grip = spec.site(f"{side}_grip")
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, grip.quat)
        for number, offset in enumerate(offsets):
            name = f"{side}_hold_{number}"
            at = np.asarray(grip.pos) + turn.reshape(3, 3) @ offset
            grip.parent.add_site(name=name, pos=at, group=4)
            # The position on the object is set when the hand takes hold. A site at the origin
            # could not be moved.
            held.add_site(name=f"{name}{ON_OBJECT}", pos=offset, group=4)
            for direction, letter in enumerate("xyz"):
                spring = _spring(spec, f"{name}_{letter}", stiffness, damping)
                spring.trntype = mujoco.mjtTrn.mjTRN_SITE
                spring.target, spring.refsite = name, f"{name}{ON_OBJECT}"
                spring.gear, spring.group = np.eye(6)[direction], HAND_GROUP


def _add_robot(spec: mujoco.MjSpec) -> None:
    """Let the robot hold the object by an impedance toward its target."""
    spec.body("object").mass = SOFT_ROBOT.load
    shift = SOFT_ROBOT.stiffness, SOFT_ROBOT.damping
    turn = SOFT_ROBOT.turn_stiffness, SOFT_ROBOT.turn_damping
    for number, axis in enumerate(AXES):
        spring = _spring(spec, f"robot_{axis}", *(shift if number < 3 else turn))
        spring.trntype = mujoco.mjtTrn.mjTRN_SITE
        spring.target, spring.refsite = "object", "robot"
        spring.gear, spring.group = np.eye(6)[number], ROBOT_GROUP


def _spring(spec: mujoco.MjSpec, name: str, stiffness: float, damping: float) -> mujoco.MjsActuator:
    """Add a spring and damper. Its control is its rest length."""
    actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gainprm[0] = stiffness
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[1], actuator.biasprm[2] = -stiffness, -damping
    return actuator


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of vectors (..., 3)."""
    return a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
