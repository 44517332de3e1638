"""A robot arm from an MJCF or URDF file.

It has its kinematic tree, the frame that carries the object, and the limits of its joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import check_kind, shown
from ergoqp.errors import InputError
from ergoqp.expressions import matrix_of
from ergoqp.registry import data_folder

DEFAULT_FRAME: Final = "flange"
"""The default end-effector frame."""

MARGIN: Final = 1e-3
"""Joints stay this far inside the ranges of the file [rad or m], as room for the controller."""


@dataclass(frozen=True)
class Robot:
    """An arm, as a description that can be put into a larger model.

    Attributes:
        name: name of the file.
        spec: its MuJoCo description; every scene contains a copy.
        frame: name of the end-effector frame, a site or a body.
        frame_body: name of the body that carries this frame.
        frame_pose: the frame in that body (4, 4) [m].
        joints: names of the k joints from base to frame.
        lower: lower ends of the joint positions (k,) [rad, or m for slides].
        upper: upper ends of the joint positions (k,) [rad, or m for slides].
        velocity: largest joint speeds (k,) [rad/s].
        acceleration: largest joint accelerations (k,) [rad/s^2].
        rest: joint positions toward which the null space moves (k,) [rad].

    Example:
        >>> from ergoqp.whole_body import load_robot
        >>> robot = load_robot("panda")
        >>> len(robot.joints), robot.lower.shape
        (7, (7,))
    """

    name: str
    spec: mujoco.MjSpec
    frame: str
    frame_body: str
    frame_pose: np.ndarray
    joints: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    rest: np.ndarray


def load_robot(
    robot: str | Path = "panda",
    frame: str | None = None,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    rest: ArrayLike | None = None,
) -> Robot:
    """Return a robot from a file.

    Args:
        robot: ``"panda"``, which comes with the package, or the path of an MJCF or URDF file.
        frame: the end-effector frame, a site or a body of the file. The object is fixed to it, and
            its z axis points out of the hand. None: ``"flange"``.
        velocity: largest joint speeds, one number or (k,), one per joint [rad/s]. None: the custom
            numeric ``joint_velocity`` of the file.
        acceleration: largest joint accelerations, one number or (k,) [rad/s^2]. None:
            ``joint_acceleration`` of the file.
        rest: joint positions (k,) toward which the null space moves [rad]. None: ``joint_rest`` of
            the file, or the middle of the ranges.

    Raises:
        InputError: if the frame is not a name; if the file cannot be read, has no such frame (the
            message lists its frames), no joint before it, or a joint without a range or with
            several axes; or if speeds or accelerations are neither in the file nor given.

    Example:
        >>> from ergoqp.whole_body import load_robot
        >>> load_robot("panda", velocity=0.5).velocity.tolist()
        [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]
    """
    frame = DEFAULT_FRAME if frame is None else frame
    # MuJoCo takes any argument for a text.
    if not isinstance(frame, str):
        raise InputError(
            f"frame: got {shown(frame)}, allowed the name of a site or body, or None for"
            f" {DEFAULT_FRAME!r}"
        )
    path = _path_of(robot)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        # The links of fixed joints keep their names: one of them may be the frame.
        spec.compiler.fusestatic = False
        model = spec.compile()
    except (ValueError, OSError) as error:
        cause = str(error).strip().splitlines()[0]
        raise InputError(
            f"robot: got {str(path)!r}, which MuJoCo cannot read ({cause}), allowed an MJCF or URDF"
            " file"
        ) from error
    body, pose = _frame_of(model, frame, path)
    joints = _chain(model, body, frame, path)
    names = tuple(model.joint(j).name for j in joints)
    if not all(names):
        raise InputError(
            f"robot: got {path.name} with joints without a name, allowed only joints with names"
        )
    for j, name in zip(joints, names, strict=True):
        if not model.jnt_limited[j]:
            raise InputError(
                f"robot: got joint {name!r} of {path.name} without a range, allowed only joints"
                " with one"
            )
    ranges = model.jnt_range[joints]
    lower, upper = ranges[:, 0] + MARGIN, ranges[:, 1] - MARGIN
    speeds, accelerations = (
        _per_joint(spec, model, joints, what, given, path)
        for what, given in (("velocity", velocity), ("acceleration", acceleration))
    )
    if rest is None and "joint_rest" not in _numerics(spec):
        wished = (lower + upper) / 2
    else:
        wished = _per_joint(spec, model, joints, "rest", rest, path, positive=False)
    held, carrier = np.clip(wished, lower, upper), model.body(body).name
    return Robot(
        path.stem,
        spec,
        frame,
        carrier,
        pose,
        names,
        lower,
        upper,
        speeds,
        accelerations,
        held,
    )


def _path_of(robot: str | Path) -> Path:
    check_kind("robot", robot, (str, Path), "'panda' or the path of an MJCF or URDF file")
    packaged = data_folder("models") / f"{robot}.xml"
    if isinstance(robot, str) and Path(robot).name == robot and packaged.is_file():
        return packaged
    path = Path(robot)
    if not path.is_file():
        raise InputError(
            f"robot: got {str(robot)!r}, allowed 'panda' or the path of an MJCF or URDF file"
        )
    return path


def _frame_of(model: mujoco.MjModel, frame: str, path: Path) -> tuple[int, np.ndarray]:
    """Return the body of the named site or body, and the frame's pose in it."""
    pose = np.eye(4)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, frame)
    if site >= 0:
        pose[:3, :3], pose[:3, 3] = matrix_of(model.site_quat[site]), model.site_pos[site]
        return int(model.site_bodyid[site]), pose
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, frame)
    if body > 0:
        return body, pose
    sites = [model.site(i).name for i in range(model.nsite)]
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    known = ", ".join(name for name in (*sites, *bodies) if name)
    raise InputError(
        f"robot: {path.name} has no frame {frame!r}, allowed one of its sites and bodies: {known}"
    )


def joints_before(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the numbers of the joints from the world to a body."""
    joints: list[int] = []
    while body > 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = [*range(first, first + count), *joints]
        body = int(model.body_parentid[body])
    return joints


def _chain(model: mujoco.MjModel, body: int, frame: str, path: Path) -> list[int]:
    """Return the joints from base to frame."""
    joints = joints_before(model, body)
    if not joints:
        raise InputError(
            f"robot: no joint of {path.name} moves the frame {frame!r}, allowed a frame that some"
            " joint moves"
        )
    simple = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for j in joints:
        if int(model.jnt_type[j]) not in simple:
            raise InputError(
                f"robot: got joint {model.joint(j).name!r} of several axes in {path.name}, allowed"
                " hinges and slides"
            )
    return joints


def _numerics(spec: mujoco.MjSpec) -> dict[str, np.ndarray]:
    return {numeric.name: np.array(numeric.data) for numeric in spec.numerics}


def _per_joint(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    joints: Sequence[int],
    what: str,
    given: ArrayLike | None,
    path: Path,
    positive: bool = True,
) -> np.ndarray:
    """Return one number per joint of the chain: the given one, or the file's custom numeric."""
    if given is None:
        found = _numerics(spec).get(f"joint_{what}")
        if found is None:
            raise InputError(
                f"{what}: {path.name} does not say it; give {what}=... or its custom numeric"
                f" 'joint_{what}'"
            )
        # The list of the file has all its joints, in order.
        given = found[list(joints)] if found.size == model.njnt else found
    try:
        values = np.broadcast_to(np.asarray(given, dtype=float), (len(joints),)).copy()
    except (TypeError, ValueError):
        raise InputError(
            f"{what}: got {shown(given)}, allowed one number or {len(joints)}, one per joint"
        ) from None
    if not np.isfinite(values).all() or (positive and not (values > 0).all()):
        raise InputError(
            f"{what}: got {values.tolist()}, allowed {'positive' if positive else 'finite'} numbers"
        )
    return values
