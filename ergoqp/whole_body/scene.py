"""Person, robot and object in one MuJoCo model, and the pairs that keep a distance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import mujoco
import numpy as np

from ergoqp.errors import InputError
from ergoqp.expressions import quaternion_of
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.whole_body.robot import Robot, joints_before

BASE_JOINTS: Final = ("base_x", "base_y", "base_z", "base_yaw")
"""Position of the person's pelvis in the world: three shifts [m] and a turn [rad]."""

_HAND_PARTS: Final = ("palm", "fingers", "thumb")
_SHORTEST: Final = 1e-3  # tool between object and hand [m]
_HOLDS: Final = 2
"""Links fewer joints than this from the object need no distance to the hand at the tool."""
_JOINTS_AWAY: Final = 4
"""Pairs of the object and a link begin this many joints up the arm.

The object cannot avoid the links that carry it.
"""


@dataclass(frozen=True)
class Load:
    """What the end-effector frame carries: a box on the frame, and the tool in it.

    The person holds the other end of the tool.

    Attributes:
        tool_frame: the contact frame in the end-effector frame (4, 4) [m]; its x is the tool's
            axis, out of the fist.
        size: side lengths of the box along the axes of the end-effector frame [m]. The box begins
            at the frame and extends along z.
    """

    tool_frame: np.ndarray
    size: tuple[float, float, float] = (0.12, 0.12, 0.10)


def default_tool_frame(turn: float, length: float = 0.20) -> np.ndarray:
    """Return a contact frame (4, 4) that faces the end-effector frame, `length` [m] before it.

    It is turned about the tool by `turn` [rad].

    Its x axis points back along the z of the end-effector frame, because the person works toward
    the robot.
    """
    z = np.array([np.cos(turn), np.sin(turn), 0.0])
    x = np.array([0.0, 0.0, -1.0])
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    frame[2, 3] = length
    return frame


class ModelColumns(Protocol):
    """What tasks and limits need of a model: the columns of the velocities, see `Scene`."""

    model: mujoco.MjModel
    person: np.ndarray
    arm: np.ndarray
    idle: np.ndarray


class Scene:
    """One MuJoCo model of person, robot and object.

    Args:
        body: the person.
        robot: the arm.
        base: base of the robot in the world of the problem (4, 4) [m].
        load: what the arm carries.
        hands: hands of the person that hold the tool, ``"right"``, ``"left"`` or both. They may
            touch object and tool.

    Attributes:
        model: person first, with the prefix ``person/``, then the robot with ``robot/``. Object and
            tool are the geoms ``robot/object`` and ``robot/tool``. The contact frame is the site
            ``robot/contact``.
        person: columns of pelvis x, y, z, yaw and the 32 joints among the velocities (36,).
        arm: columns of the arm's joints (k,).
        idle: columns of all other joints of the robot's file, such as fingers. They do not move.

    Example:
        >>> import ergoqp
        >>> from ergoqp.whole_body import WholeBody
        >>> scene = WholeBody(ergoqp.load_problem("screwing")).scene
        >>> len(scene.person), len(scene.arm), scene.pairs.shape[1]
        (36, 7, 2)
    """

    def __init__(
        self, body: Body, robot: Robot, base: np.ndarray, load: Load, hands: tuple[str, ...]
    ) -> None:
        """Combine the descriptions and compile them once."""
        self.body, self.robot, self.load, self.hands = body, robot, load, hands
        self.base = np.asarray(base, dtype=float)
        self.model = _compiled(body, robot, self.base, load)
        self.person = self._columns([f"person/{name}" for name in (*BASE_JOINTS, *JOINTS)])
        self.arm = self._columns([f"robot/{name}" for name in robot.joints])
        self.idle = np.setdiff1d(np.arange(self.model.nv), np.concatenate([self.person, self.arm]))
        self.arm_qpos = self.model.jnt_qposadr[self.model.dof_jntid[self.arm]]
        self.person_qpos = self.model.jnt_qposadr[self.model.dof_jntid[self.person]]
        self.contact_site = self.model.site("robot/contact").id

    def _columns(self, names: list[str]) -> np.ndarray:
        return np.array([int(self.model.joint(name).dofadr[0]) for name in names])

    @cached_property
    def pairs(self) -> np.ndarray:
        """Geoms that keep the distance, two per row (n, 2), the robot's or object's first.

        - every collision geom of the robot, and its pedestal, with every part of the person; the
          hands that hold the tool are left out for the last two links, which move as the object
          does;
        - the object with every part of the person except the hands that hold the tool, and the tool
          with every part except those hands and their forearms;
        - object and tool with the links at least four joints up the arm.

        Pairs of the arm's own links are left to the robot's joint ranges and controller.
        """
        model = self.model
        names = [model.geom(i).name for i in range(model.ngeom)]
        skin = [name.startswith("person/") and not name.endswith("nose") for name in names]
        person = np.flatnonzero(skin).tolist()
        load = [names.index("robot/object"), names.index("robot/tool")]
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        owners = [model.body(int(body)).name for body in model.geom_bodyid]
        links = [
            i
            for i, owner in enumerate(owners)
            if owner.startswith("robot/") and solid[i] and i not in load
        ]
        links += [i for i, name in enumerate(names) if name == "pedestal"]
        hands = {f"person/{hand}_{part}" for hand in self.hands for part in _HAND_PARTS}
        holding = {
            load[0]: hands,
            load[1]: hands | {f"person/{hand}_forearm" for hand in self.hands},
        }
        end = len(joints_before(model, int(model.geom_bodyid[load[0]])))
        before = (len(joints_before(model, int(model.geom_bodyid[link]))) for link in links)
        up = {link: end - count for link, count in zip(links, before, strict=True)}
        pairs = [
            (link, part)
            for link in links
            for part in person
            if up[link] >= _HOLDS or names[part] not in hands
        ]
        pairs += [
            (piece, part) for piece in load for part in person if names[part] not in holding[piece]
        ]
        pairs += [(piece, link) for piece in load for link in links if up[link] >= _JOINTS_AWAY]
        return np.array(pairs)

    def contact_pose(self, data: mujoco.MjData) -> np.ndarray:
        """Return the contact frame (4, 4) [m] at the positions of `data`."""
        pose, site = np.eye(4), self.contact_site
        pose[:3, :3], pose[:3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
        return pose

    def pair_name(self, pair: np.ndarray) -> str:
        """Return a pair (2,) in words, for a message."""
        first, second = (
            self.model.geom(int(i)).name.split("/")[-1].replace("_", " ") for i in pair
        )
        return f"{first} and {second}"

    def qpos(self, pelvis: np.ndarray, posture: np.ndarray, arm: np.ndarray) -> np.ndarray:
        """Return the model's positions: pelvis x, y, z, yaw (4,), posture (32,) and arm (k,)."""
        positions = self.model.qpos0.copy()
        positions[self.person_qpos] = np.concatenate([pelvis, posture])
        positions[self.arm_qpos] = arm
        return positions


def _compiled(body: Body, robot: Robot, base: np.ndarray, load: Load) -> mujoco.MjModel:
    root = mujoco.MjSpec()
    root.modelname = "whole body"
    world = root.worldbody
    light = {"pos": [0, 0, 4], "dir": [0.1, 0.15, -1], "diffuse": [0.4, 0.4, 0.4]}
    world.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, **light)
    floor = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [4, 4, 0.1]}
    world.add_geom(name="floor", contype=0, conaffinity=0, rgba=[0.93, 0.93, 0.91, 1], **floor)
    root.attach(body.spec(), prefix="person/", frame=world.add_frame())
    arm = robot.spec.copy()
    carry(arm, robot, load)
    root.attach(
        arm,
        prefix="robot/",
        frame=world.add_frame(pos=base[:3, 3], quat=quaternion_of(base[:3, :3])),
    )
    if base[2, 3] > 0.10:
        low, high = [*base[:2, 3], 0.05], [*base[:2, 3], base[2, 3] - 0.05]
        column = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "fromto": [*low, *high]}
        column |= {"size": [0.05, 0, 0], "rgba": [0.6, 0.6, 0.62, 1]}
        world.add_geom(name="pedestal", contype=0, conaffinity=0, **column)
    return root.compile()


def carry(arm: mujoco.MjSpec, robot: Robot, load: Load) -> None:
    """Fix object, tool and contact frame to the end-effector frame of an arm's description.

    Raises:
        InputError: if the object ends at the contact point, so that there is no tool between them.
    """
    pose = robot.frame_pose
    carrier = arm.body(robot.frame_body).add_body(
        name="load", pos=pose[:3, 3], quat=quaternion_of(pose[:3, :3])
    )
    x, y, z = load.size
    solid = {"contype": 0, "conaffinity": 1, "mass": 0.2}
    box = {
        "type": mujoco.mjtGeom.mjGEOM_BOX,
        "size": [x / 2, y / 2, z / 2],
        "pos": [0, 0, z / 2],
        "rgba": [0.85, 0.55, 0.2, 1],
    }
    carrier.add_geom(name="object", **box, **solid)
    end = load.tool_frame[:3, 3]
    if np.linalg.norm(end - [0, 0, z]) < _SHORTEST:
        raise InputError(
            f"object_size: got {z:g} m along z, where tool_frame has the contact point, allowed"
            " less or more"
        )
    rod = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "fromto": [0, 0, z, *end], "size": [0.008, 0, 0]}
    carrier.add_geom(name="tool", rgba=[0.2, 0.2, 0.22, 1], **rod, **solid)
    carrier.add_site(name="contact", pos=end, quat=quaternion_of(load.tool_frame[:3, :3]))
