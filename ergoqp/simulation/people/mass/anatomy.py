"""The MuJoCo model of one person: ``models/person_with_mass.xml`` scaled, with mass and muscles."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import mujoco
import numpy as np

from ergoqp.human import FRACTIONS, Body
from ergoqp.human.body import NOMINAL_STATURE
from ergoqp.joints import JOINTS
from ergoqp.paths import data_folder
from ergoqp.simulation.people.mass.segments import Sex, inertias
from ergoqp.simulation.people.mass.table import HABITS, SOFT_ROBOT, per_joint

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
    geom.size = [0.25, 0.25, 0.02]
    geom.pos = [0.0, 0.0, top - 0.02]


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
            for direction in range(3):
                spring = _spring(
                    spec,
                    f"{name}_{'xyz'[direction]}",
                    HABITS.grasp_stiffness / len(offsets),
                    HABITS.grasp_damping / len(offsets),
                )
                spring.trntype = mujoco.mjtTrn.mjTRN_SITE
                spring.target, spring.refsite = name, f"{name}{ON_OBJECT}"
                spring.gear, spring.group = np.eye(6)[direction], HAND_GROUP


def _add_robot(spec: mujoco.MjSpec) -> None:
    """Let the robot hold the object by an impedance toward its target."""
    spec.body("object").mass = SOFT_ROBOT.load
    for number in range(6):
        shift = number < 3
        spring = _spring(
            spec,
            f"robot_{['x', 'y', 'z', 'rx', 'ry', 'rz'][number]}",
            SOFT_ROBOT.stiffness if shift else SOFT_ROBOT.turn_stiffness,
            SOFT_ROBOT.damping if shift else SOFT_ROBOT.turn_damping,
        )
        spring.trntype = mujoco.mjtTrn.mjTRN_SITE
        spring.target, spring.refsite = "object", "robot"
        spring.gear = np.eye(6)[number]
        spring.group = ROBOT_GROUP


def _spring(spec: mujoco.MjSpec, name: str, stiffness: float, damping: float) -> mujoco.MjsActuator:
    """Add a spring and damper. Its control is its rest length."""
    actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gainprm[0] = stiffness
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[1], actuator.biasprm[2] = -stiffness, -damping
    return actuator
