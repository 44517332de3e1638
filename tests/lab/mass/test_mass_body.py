"""The body of people with mass: ergoqp's kinematics, published masses, and an upright pelvis."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.lab.mass.body import FRICTION, MUSCLES, SEGMENTS, SOFT_ROBOT, Sex, build, inertias
from ergoqp.lab.mass.control import reported, upright
from ergoqp.lab.people.habits import AXIS, contact_of

FRAMES = ("trunk", "neck", "head_top", "right_shoulder", "left_elbow", "right_wrist", "left_grip")
FRAMES_BELOW = ("right_hip", "left_knee", "right_ankle", "left_sole")


def model_of(body: Body, sex: Sex = "female", seat: float | None = None) -> mujoco.MjModel:
    return build(body, sex, ("right", "left"), np.array(AXIS["along"]), True, seat)


def take(model: mujoco.MjModel, rotation: np.ndarray, posture: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:3] = 0.1, -0.2, 0.9
    mujoco.mju_mat2Quat(data.qpos[3:7], rotation.ravel())
    data.qpos[7 : 7 + len(JOINTS)] = posture
    mujoco.mj_kinematics(model, data)
    return data


@pytest.mark.parametrize("stature", [1.50, 1.95])
def test_the_same_angles_put_every_frame_in_the_same_place(stature: float) -> None:
    body, yaw = Body.of_stature(stature), 0.4
    model, theirs = model_of(body), mujoco.MjData(body.model)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    rng = np.random.default_rng(0)
    for _ in range(5):
        posture = rng.uniform(LOWER, UPPER)
        data = take(model, turn, posture)
        theirs.qpos[:] = np.concatenate([[0.1, -0.2, 0.9, yaw], posture])
        mujoco.mj_kinematics(body.model, theirs)
        for name in FRAMES + FRAMES_BELOW:
            np.testing.assert_allclose(data.site(name).xpos, theirs.site(name).xpos, atol=1e-12)
            np.testing.assert_allclose(data.site(name).xmat, theirs.site(name).xmat, atol=1e-12)


def test_hinges_are_those_of_the_postures() -> None:
    model = model_of(Body())
    hinges = [model.joint(number) for number in range(1, 1 + len(JOINTS))]
    assert tuple(hinge.name for hinge in hinges) == JOINTS
    np.testing.assert_allclose([hinge.range for hinge in hinges], np.stack([LOWER, UPPER], axis=1))
    assert set(MUSCLES) == {name.removeprefix("right_").removeprefix("left_") for name in JOINTS}


def test_a_tilted_pelvis_is_carried_by_trunk_and_hips() -> None:
    body = Body.of_stature(1.7)
    model, theirs = model_of(body), mujoco.MjData(body.model)
    quaternion, rotation = np.zeros(4), np.zeros(9)
    mujoco.mju_euler2Quat(quaternion, np.array([0.2, 0.4, 0.5]), "XYZ")
    mujoco.mju_quat2Mat(rotation, quaternion)
    rotation = rotation.reshape(3, 3)
    angles = np.random.default_rng(1).uniform(LOWER / 2, UPPER / 2)
    data = take(model, rotation, angles)
    heading = upright(rotation)
    yaw = np.arctan2(heading[1, 0], heading[0, 0])
    theirs.qpos[:] = np.concatenate([[0.1, -0.2, 0.9, yaw], reported(rotation, angles)])
    mujoco.mj_kinematics(body.model, theirs)
    for name in FRAMES:
        np.testing.assert_allclose(data.site(name).xpos, theirs.site(name).xpos, atol=1e-12)
    for name in FRAMES_BELOW:  # The hip centres tilt with the pelvis; directions are the same.
        np.testing.assert_allclose(data.site(name).xmat, theirs.site(name).xmat, atol=1e-12)


def test_an_upright_pelvis_changes_nothing() -> None:
    angles = np.random.default_rng(2).uniform(LOWER * 0.9, UPPER * 0.7)
    np.testing.assert_allclose(reported(np.eye(3), angles), angles, atol=1e-12)


@pytest.mark.parametrize("sex", ["female", "male"])
def test_segments_weigh_what_the_table_says(sex: Sex) -> None:
    body = Body.of_stature(1.68, mass=61.0)
    model = model_of(body, sex)
    pelvis, rows = model.body("pelvis").id, SEGMENTS[sex]
    np.testing.assert_allclose(model.body_subtreemass[pelvis], 61.0, rtol=1e-12)
    for name, segment in (("left_thigh", "thigh"), ("right_hand", "hand"), ("head", "head")):
        # The table's own shares add up to 0.9999 to 1.
        np.testing.assert_allclose(
            model.body_mass[model.body(name).id], rows[segment].mass * 61.0, rtol=2e-4
        )
    thigh = inertias(body, sex)["left_thigh"]
    length = body.lengths["thigh"]
    np.testing.assert_allclose(thigh.centre, [0, 0, -rows["thigh"].centre * length])
    np.testing.assert_allclose(
        thigh.inertia[1], thigh.mass * (rows["thigh"].transverse * length) ** 2
    )


def test_the_trunk_in_two_bodies_balances_as_the_table_has_it_in_one() -> None:
    body = Body.of_stature(1.74)
    found = inertias(body, "male")
    parts = [found["pelvis"], found["trunk"]]
    mass = sum(part.mass for part in parts)
    height = sum(part.mass * part.centre[2] for part in parts) / mass
    # De Leva has it 44.86 % of the way from the notch down, of the trunk as a whole.
    np.testing.assert_allclose(height / body.lengths["trunk"], 1 - 0.4486, atol=0.01)


def test_only_soles_and_seat_touch() -> None:
    model = model_of(Body(), seat=0.5)
    touching = {
        model.geom(number).name
        for number in range(model.ngeom)
        if model.geom_contype[number] or model.geom_conaffinity[number]
    }
    soles = {f"{side}_{part}" for side in ("right", "left") for part in ("heel", "ball")}
    assert touching == soles | {"buttocks", "floor", "seat"}
    for name in touching:
        assert model.geom(name).friction[0] == FRICTION
    assert model.neq == 0
    assert not model.body_gravcomp.any()
    assert model.body("object").mass[0] == SOFT_ROBOT.load


def test_the_contact_frame_of_two_hands_is_midway() -> None:
    right, left = np.eye(4), np.eye(4)
    right[:3, 3], left[:3, 3] = (0.4, -0.2, 1.0), (0.4, 0.1, 1.0)
    frame = contact_of([right, left], "along")
    np.testing.assert_allclose(frame[:3, 3], [0.4, -0.05, 1.0])
    np.testing.assert_allclose(frame[:3, :3], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(contact_of([right], "thumb")[:3, 0], [0, 0, 1])
