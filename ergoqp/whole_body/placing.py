"""Where the robot stands, and the joint positions with which it holds the object at a pose."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ergoqp.expressions.quaternions import quaternion_of
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.whole_body.scene import Scene
from ergoqp.whole_body.terms import person_of

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
    middle = (
        comfort_contact(problem)[:3, 3]
        if box is None
        else (np.asarray(box.lower) + np.asarray(box.upper)) / 2
    )
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
        error = pose_error(data.site_xpos[site], data.site_xmat[site].reshape(3, 3), pose)
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


def pose_error(position: np.ndarray, rotation: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return the displacement (6,) [m, rad] from a position and rotation to a pose (4, 4).

    It is along the axes of the world.
    """
    vector = np.zeros(3)
    mujoco.mju_quat2Vel(vector, quaternion_of(pose[:3, :3] @ rotation.T), 1.0)
    return np.concatenate([pose[:3, 3] - position, vector])
