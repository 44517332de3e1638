"""The generated kinematics against the loaded MuJoCo model and an independently built Pinocchio
model."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ergoqp.errors import InputError
from ergoqp.human import FRAMES, Body, Kinematics
from ergoqp.joints import JOINTS

bench = pytest.importorskip(
    "benchmarks.kinematics", reason="the benchmarks of the checkout are not importable here"
)


@pytest.mark.parametrize("name", bench.bodies())
def test_expressions_agree_with_mujoco(name: str) -> None:
    body, states = bench.bodies()[name], bench.random_states(15, seed=1)
    assert (
        bench.largest_difference(bench.by_casadi(body, states), bench.by_mujoco(body, states))
        < 1e-12
    )


@pytest.mark.parametrize("name", bench.bodies())
def test_expressions_agree_with_pinocchio(name: str) -> None:
    pytest.importorskip("pinocchio", reason="Pinocchio (package pin, extra 'pinocchio') is absent")
    body, states = bench.bodies()[name], bench.random_states(15, seed=2)
    assert (
        bench.largest_difference(bench.by_casadi(body, states), bench.by_pinocchio(body, states))
        < 1e-12
    )


def test_pinocchio_weighs_what_mujoco_weighs() -> None:
    pin = pytest.importorskip(
        "pinocchio", reason="Pinocchio (package pin, extra 'pinocchio') is absent"
    )
    from benchmarks.pinocchio_model import pinocchio_model

    body = Body.of_stature(1.62, mass=61.0)
    model = pinocchio_model(body.model)
    data = model.createData()
    state = bench.random_states(1, seed=3)[0]
    centre = pin.centerOfMass(model, data, state)
    other = mujoco.MjData(body.model)
    other.qpos[:] = state
    mujoco.mj_forward(body.model, other)
    assert data.mass[0] == pytest.approx(61.0, abs=1e-3)
    np.testing.assert_allclose(centre, other.subtree_com[0], atol=1e-12)


def test_a_model_with_two_hinges_in_one_body_is_refused_by_the_check() -> None:
    pytest.importorskip("pinocchio", reason="Pinocchio (package pin, extra 'pinocchio') is absent")
    from benchmarks.pinocchio_model import pinocchio_model

    joints = "<joint axis='1 0 0'/><joint axis='0 1 0'/><geom size='.1'/>"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body name='two'>{joints}</body></worldbody></mujoco>"
    )
    with pytest.raises(ValueError, match="two: got 2 joints"):
        pinocchio_model(model)


def test_jacobians_are_the_derivatives_of_the_poses() -> None:
    kinematics = Kinematics(Body())
    q = bench.random_states(1, seed=4)[0, 4:]
    h = 1e-6
    for frame in ("head_top", "right_grip", "left_sole"):
        _, rotation, jacobian = (np.array(part) for part in kinematics.function(frame)(q))
        for joint in range(len(JOINTS)):
            step = h * np.eye(len(JOINTS))[joint]
            ahead, behind = (
                kinematics.function(frame)(q + step),
                kinematics.function(frame)(q - step),
            )
            linear = (np.array(ahead[0]) - np.array(behind[0])).ravel() / (2 * h)
            turn = (np.array(ahead[1]) - np.array(behind[1])) / (2 * h) @ rotation.T
            angular = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
            np.testing.assert_allclose(
                jacobian[:, joint], np.concatenate([linear, angular]), atol=1e-8
            )


def test_every_site_of_the_model_is_a_frame() -> None:
    model = Body().model
    assert sorted(FRAMES) == sorted(model.site(i).name for i in range(model.nsite))


def test_an_unknown_frame_is_named() -> None:
    with pytest.raises(InputError, match="got 'tail', allowed one of pelvis"):
        Kinematics(Body()).function("tail")
