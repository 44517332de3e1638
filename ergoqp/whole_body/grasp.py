"""How the robot holds the object at the start of a loop: grasp and joints."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ergoqp.errors import InputError
from ergoqp.responses.ik import IkResponse
from ergoqp.whole_body.placing import arms_at
from ergoqp.whole_body.robot import Robot
from ergoqp.whole_body.scene import Load, Scene, default_tool_frame
from ergoqp.whole_body.separation import Separation
from ergoqp.whole_body.terms import pelvis_function

_TURNS: Final = 8


def grasp(
    person: IkResponse,
    robot: Robot,
    base: np.ndarray,
    tool_frame: np.ndarray | None,
    size: tuple[float, float, float],
    posture: np.ndarray,
    apart: float | None,
) -> tuple[Scene, np.ndarray]:
    """Return the scene, and joints of the arm (k,) that hold the object at the person's hand.

    Of all joint positions found, and of all turns of the object in the robot's hand if these are
    free, it takes the joints that are farthest from the ends of their ranges.

    Args:
        person: the controller's model of the person.
        robot: the arm.
        base: base of the robot (4, 4) [m].
        tool_frame: the contact frame in the end-effector frame (4, 4) [m]. None: in front of it, at
            one of eight turns.
        size: side lengths of the object [m].
        posture: posture of the person (32,) [rad].
        apart: distance from the person that must be kept [m]. None: any.

    Raises:
        InputError: if the arm cannot hold the object there.
    """
    frames = (
        [default_tool_frame(2 * np.pi * i / _TURNS) for i in range(_TURNS)]
        if tool_frame is None
        else [tool_frame]
    )
    pose, pelvis = (
        np.array(person.contact()(posture)[0]),
        np.array(pelvis_function(person)(posture)[0]).ravel(),
    )
    middle, width = (robot.lower + robot.upper) / 2, robot.upper - robot.lower
    best, found, nearest = np.inf, None, -np.inf
    for frame in frames:
        scene = Scene(person.body, robot, base, Load(frame, size), person.hands)
        separation, data = Separation(scene), mujoco.MjData(scene.model)
        for arm in arms_at(scene, pose, robot.rest):
            off = float(np.max(np.abs(arm - middle) / width))
            if apart is not None:
                data.qpos[:] = scene.qpos(pelvis, posture, arm)
                mujoco.mj_kinematics(scene.model, data)
                kept = separation.smallest(data)[0]
                nearest = max(nearest, kept)
                if kept < apart:
                    continue
            if off < best:
                best, found = off, (scene, arm)
    if found is not None:
        return found
    at, wanted = base[:3, 3].round(2).tolist(), pose[:3, 3].round(2).tolist()
    where = f"base: from a base at {at} the arm cannot hold the object at {wanted}"
    if apart is None or nearest == -np.inf:
        raise InputError(f"{where}, allowed a base within reach")
    raise InputError(f"{where} at {apart:g} m from everything, at most at {nearest:.3f} m")
