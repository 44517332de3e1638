"""The kinematics three times over: our CasADi expressions, MuJoCo and Pinocchio.

Run ``python -m benchmarks.kinematics``.

Random postures over the whole joint ranges (and 20 degrees beyond), a random place and yaw of the
pelvis, three statures and one body of measured lengths; position, rotation and Jacobian of every
frame, the columns of the pelvis's own motion included. MuJoCo and Pinocchio see the same loaded
model; the Pinocchio model is built from it joint by joint (`benchmarks.pinocchio_model`), not by
its reader of MJCF. ``max_error`` is the largest difference of any entry between any two of the
three, in metres and radians.
"""

from __future__ import annotations

import importlib.util

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.pinocchio_model import pinocchio_model
from benchmarks.report import Report, run
from ergoqp.human import FRAMES, Body, Kinematics
from ergoqp.human.body import base_jacobian
from ergoqp.joints import JOINTS, LOWER, UPPER

Array = NDArray[np.float64]
Frames = dict[str, tuple[Array, Array, Array]]
"""Per frame: position (n, 3), rotation (n, 3, 3) and Jacobian (n, 6, 36), world-aligned.

The Jacobian is that of x, y, z, yaw and the 32 joints.
"""

MEASURED = {
    "upper_arm": 0.36,
    "forearm": 0.23,
    "thigh": 0.40,
    "trunk": 0.55,
    "shoulder_width": 0.40,
    "foot_length": 0.30,
}


def bodies() -> dict[str, Body]:
    """Return the bodies that are compared."""
    return {f"{stature:.2f} m": Body.of_stature(stature) for stature in (1.50, 1.75, 2.00)} | {
        "measured lengths": Body.of_lengths(MEASURED)
    }


def random_states(count: int, seed: int = 0) -> Array:
    """Return states (n, 36): pelvis x, y, z [m] and yaw [rad], then the posture [rad].

    Some of the posture is beyond the ranges.
    """
    rng = np.random.default_rng(seed)
    beyond = np.radians(20)
    base = rng.uniform([-2, -2, -2, -np.pi], [2, 2, 2, np.pi], (count, 4))
    return np.hstack([base, rng.uniform(LOWER - beyond, UPPER + beyond, (count, len(JOINTS)))])


def by_casadi(body: Body, states: Array) -> Frames:
    """Return every frame by our expressions, carried from the pelvis to the world."""
    kinematics, count = Kinematics(body), len(states)
    c, s = np.cos(states[:, 3]), np.sin(states[:, 3])
    yaw = np.zeros((count, 3, 3))
    yaw[:, 0, 0], yaw[:, 0, 1], yaw[:, 1, 0], yaw[:, 1, 1], yaw[:, 2, 2] = c, -s, s, c, 1
    both = np.zeros((count, 6, 6))
    both[:, :3, :3] = both[:, 3:, 3:] = yaw
    found: Frames = {}
    for frame in FRAMES:
        positions, rotations, jacobians = (
            np.array(part.full()) for part in kinematics.function(frame)(states[:, 4:].T)
        )
        position = positions.T
        rotation = rotations.reshape(3, count, 3).transpose(1, 0, 2)
        jacobian = jacobians.reshape(6, count, len(JOINTS)).transpose(1, 0, 2)
        pelvis = np.stack([base_jacobian(here).full() for here in map(ca.DM, position)])
        # The base moves along the axes of the world, the rest was given along those of the pelvis.
        pelvis = both @ pelvis
        pelvis[:, :3, :3] = np.eye(3)
        world = np.concatenate([pelvis, both @ jacobian], axis=2)
        found[frame] = (
            states[:, :3] + np.einsum("nij,nj->ni", yaw, position),
            yaw @ rotation,
            world,
        )
    return found


def by_mujoco(body: Body, states: Array) -> Frames:
    """Return every frame by MuJoCo."""
    model = body.model
    data = mujoco.MjData(model)
    sites = {frame: model.site(frame).id for frame in FRAMES}
    found: Frames = {
        f: (
            np.zeros((len(states), 3)),
            np.zeros((len(states), 3, 3)),
            np.zeros((len(states), 6, 36)),
        )
        for f in FRAMES
    }
    for i, state in enumerate(states):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for frame, site in sites.items():
            position, rotation, jacobian = found[frame]
            position[i], rotation[i] = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
            mujoco.mj_jacSite(model, data, jacobian[i, :3], jacobian[i, 3:], site)
    return found


def by_pinocchio(body: Body, states: Array) -> Frames:
    """Return every frame by Pinocchio."""
    import pinocchio as pin

    model = pinocchio_model(body.model)
    names = [model.names[i] for i in range(1, model.njoints)]
    if names != ["base_x", "base_y", "base_z", "base_yaw", *JOINTS]:
        raise ValueError(f"joints of the Pinocchio model: got {names}")
    data = model.createData()
    numbers = {frame: model.getFrameId(frame) for frame in FRAMES}
    found: Frames = {
        f: (
            np.zeros((len(states), 3)),
            np.zeros((len(states), 3, 3)),
            np.zeros((len(states), 6, 36)),
        )
        for f in FRAMES
    }
    for i, state in enumerate(states):
        pin.computeJointJacobians(model, data, state)
        pin.updateFramePlacements(model, data)
        for frame, number in numbers.items():
            position, rotation, jacobian = found[frame]
            position[i], rotation[i] = data.oMf[number].translation, data.oMf[number].rotation
            jacobian[i] = pin.getFrameJacobian(model, data, number, pin.LOCAL_WORLD_ALIGNED)
    return found


def largest_difference(first: Frames, second: Frames) -> float:
    """Return the largest difference of any entry of any frame [m, rad]; infinite if one is NaN."""
    apart = [
        float(np.abs(a - b).max())
        for frame in FRAMES
        for a, b in zip(first[frame], second[frame], strict=True)
    ]
    return max(apart) if np.isfinite(apart).all() else float("inf")


def has_pinocchio() -> bool:
    """Return whether the package ``pin`` is installed."""
    return importlib.util.find_spec("pinocchio") is not None


def measure(report: Report) -> None:
    """Compare the three on all bodies."""
    states = random_states(report.pick(1000, 10_000))
    worst = {"casadi_mujoco": 0.0}
    if has_pinocchio():
        worst |= {"casadi_pinocchio": 0.0, "mujoco_pinocchio": 0.0}
    else:
        report.say(
            "Pinocchio (package pin, extra 'pinocchio') is absent: only CasADi and MuJoCo are"
            " compared"
        )
    for name, body in bodies().items():
        found = {"casadi": by_casadi(body, states), "mujoco": by_mujoco(body, states)}
        if has_pinocchio():
            found["pinocchio"] = by_pinocchio(body, states)
        apart = {
            pair: largest_difference(*(found[part] for part in pair.split("_"))) for pair in worst
        }
        report.say(
            f"{name:<18}" + "  ".join(f"{pair} {value:.1e}" for pair, value in apart.items())
        )
        worst = {pair: max(worst[pair], value) for pair, value in apart.items()}
    for pair, value in worst.items():
        report.figure(f"{pair}.error", value, "m, rad")
    report.figure("frames", len(FRAMES))
    report.figure("postures", len(states), f"random, of {len(bodies())} bodies each")
    report.figure(
        "max_error",
        max(worst.values()),
        "m, rad: any two of the three, any frame, pose and Jacobian",
    )


if __name__ == "__main__":
    run(measure, "CasADi, MuJoCo and Pinocchio: poses and Jacobians of every frame.")
