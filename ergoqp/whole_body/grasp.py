"""Where the robot stands, and how it holds the object: joint positions and grasp."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ergoqp.errors import InputError
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import pose_error
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.whole_body.robot import Robot
from ergoqp.whole_body.scene import Load, Scene, default_tool_frame
from ergoqp.whole_body.state import Separation, pelvis_function, person_of

AHEAD: Final = 0.45
"""Distance of the robot's frame in front of its base, with the object in mid-workspace [m]."""
ABOVE: Final = 0.40
"""Height of the robot's frame above its base, for the same case [m]."""
_SEEDS: Final = 24
_ITERATIONS: Final = 60
_EXACT: Final = 1e-10


def tool_direction(problem: Problem) -> np.ndarray:
    """Return the axis of the tool's cone in the world (3,).

    Without a cone it is the tool's axis at the comfort posture.
    """
    cone = problem.limit_of(AxisCone)
    if cone is not None:
        return np.asarray(cone.direction)
    return comfort_contact(problem)[:3, 0]


def comfort_contact(problem: Problem) -> np.ndarray:
    """Return the contact frame (4, 4) at the person's comfort posture."""
    return np.array(problem.response.contact()(person_of(problem).comfort)[0])


def default_base(problem: Problem, length: float) -> np.ndarray:
    """Return the default base of the robot (4, 4).

    It stands beyond the object, seen from the person, and faces the person. With the object in the
    middle of its workspace (or at the contact point of the comfort posture if there is none) and
    the tool along the axis of its cone, the robot's frame is 0.45 m in front of the base and 0.40 m
    above it. The base is never below the floor.

    Args:
        problem: the task.
        length: distance from the robot's frame to the contact point [m].
    """
    direction, box = tool_direction(problem), problem.limit_of(WorkspaceBox)
    middle = comfort_contact(problem)[:3, 3] if box is None else np.add(box.lower, box.upper) / 2
    away = np.array([direction[0], direction[1], 0.0])
    # A tool that points up or down does not show where the person is; x is in front of them.
    away = away / np.linalg.norm(away) if np.linalg.norm(away) > 0.2 else np.array([1.0, 0.0, 0.0])
    frame = middle + length * direction
    base = np.eye(4)
    base[:3, :3] = np.column_stack([-away, np.cross([0.0, 0.0, 1.0], -away), [0.0, 0.0, 1.0]])
    base[:3, 3] = frame + AHEAD * away - [0.0, 0.0, ABOVE]
    base[2, 3] = max(base[2, 3], 0.0)
    return base


def arms_at(
    scene: Scene, pose: np.ndarray, first: np.ndarray, seeds: int = _SEEDS
) -> list[np.ndarray]:
    """Return joint positions (k,) that hold the contact frame at a pose (4, 4).

    Positions closest to `first` come first.

    The search uses damped Newton steps within the joint ranges, from `first` and from seeded random
    starts. It gives the same result every time.
    """
    rng, robot = np.random.default_rng(0), scene.robot
    data = mujoco.MjData(scene.model)
    starts = [first, *rng.uniform(robot.lower, robot.upper, (seeds, len(robot.joints)))]
    found: list[np.ndarray] = []
    for start in starts:
        arm = _solved(scene, data, pose, start)
        if arm is not None and all(np.abs(arm - other).max() > 1e-3 for other in found):
            found.append(arm)
    width = robot.upper - robot.lower
    return sorted(found, key=lambda arm: float(np.sum(((arm - first) / width) ** 2)))


def _solved(
    scene: Scene, data: mujoco.MjData, pose: np.ndarray, start: np.ndarray
) -> np.ndarray | None:
    model, robot, site = scene.model, scene.robot, scene.contact_site
    jacobian, arm = np.zeros((6, model.nv)), start.copy()
    for _ in range(_ITERATIONS):
        data.qpos[scene.arm_qpos] = arm
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        error = pose_error(scene.contact_pose(data), pose)
        if np.abs(error).max() < _EXACT:
            return arm
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        J = jacobian[:, scene.arm]
        damping = 1e-3 * min(1.0, float(error @ error)) + 1e-12
        step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), error)
        arm = np.clip(
            arm + step * min(1.0, 0.5 / (np.abs(step).max() + 1e-12)), robot.lower, robot.upper
        )
    return None


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
    turned = [default_tool_frame(2 * np.pi * i / _TURNS) for i in range(_TURNS)]
    frames = turned if tool_frame is None else [tool_frame]
    pose = np.array(person.contact()(posture)[0])
    pelvis = np.array(pelvis_function(person)(posture)[0]).ravel()
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
