"""The robot from its file: kinematics and limits as published, and what is said of files that
cannot be used."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest

pytest.importorskip("mink")

from ergoqp.errors import InputError
from ergoqp.whole_body import load_robot

# Modified Denavit-Hartenberg parameters of Franka's documentation: a [m], d [m], alpha [rad], the
# flange last.
DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
    (0.0, 0.107, 0.0),
)

PLANAR = """<mujoco><worldbody><body name="arm"><joint name="turn" axis="0 0 1" range="-1 1"/>
<geom size="0.05"/>
<body name="tip" pos="0.5 0 0"><joint name="push" type="slide" axis="1 0 0" range="0 0.2"/>
<geom size="0.05"/>
<site name="end" pos="0.1 0 0"/></body></body></worldbody>{}</mujoco>"""
RATES = """<custom><numeric name="joint_velocity" data="1 0.5"/>
<numeric name="joint_acceleration" data="5 2"/></custom>"""

URDF = """<robot name="two"><link name="base"/><link name="upper"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
<joint name="mount" type="fixed"><parent link="upper"/><child link="tool"/>
<origin xyz="0.3 0 0"/></joint></robot>"""


def _chain(angles):
    pose = np.eye(4)
    for (a, d, alpha), theta in zip(DH, [*angles, 0.0], strict=True):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        pose = pose @ np.array(
            [
                [ct, -st, 0, a],
                [st * ca, ct * ca, -sa, -d * sa],
                [st * sa, ct * sa, ca, d * ca],
                [0, 0, 0, 1],
            ]
        )
    return pose


def test_panda_is_the_product_of_its_published_parameters():
    robot = load_robot("panda")
    model = robot.spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(50):
        angles = rng.uniform(robot.lower, robot.upper)
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        site, expected = data.site("flange"), _chain(angles)
        assert np.abs(site.xpos - expected[:3, 3]).max() < 1e-12
        assert np.abs(site.xmat.reshape(3, 3) - expected[:3, :3]).max() < 1e-12


def test_panda_has_the_limits_of_its_data_sheet():
    robot = load_robot("panda")
    ranges = robot.spec.compile().jnt_range
    assert ranges[:, 0].tolist() == [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    assert ranges[:, 1].tolist() == [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    assert (robot.lower > ranges[:, 0]).all()
    assert (robot.upper < ranges[:, 1]).all()
    assert robot.velocity.tolist() == [2.175] * 4 + [2.61] * 3
    assert robot.acceleration.tolist() == [15, 7.5, 10, 12.5, 15, 20, 20]


def test_any_mjcf_with_a_site_or_a_body_as_frame(tmp_path):
    path = tmp_path / "planar.xml"
    path.write_text(PLANAR.format(RATES))
    at_site, at_body = load_robot(path, "end"), load_robot(path, "tip")
    assert at_site.joints == at_body.joints == ("turn", "push")
    assert at_site.frame_pose[:3, 3].tolist() == [0.1, 0, 0]
    assert at_body.frame_pose[:3, 3].tolist() == [0, 0, 0]
    assert at_site.velocity.tolist() == [1, 0.5]
    assert np.allclose(at_site.rest, [0, 0.1])
    assert load_robot(path, "arm").joints == ("turn",)


def test_a_urdf_keeps_the_links_of_fixed_joints(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(URDF)
    robot = load_robot(path, "tool", velocity=2.0, acceleration=8.0)
    assert robot.joints == ("lift",)
    assert robot.frame_body == "tool"


def test_a_missing_frame_is_named_with_those_that_exist():
    with pytest.raises(
        InputError,
        match=r"panda\.xml has no frame 'hand', allowed one of its sites and bodies: flange, link0",
    ):
        load_robot("panda", "hand")


def test_a_frame_is_a_name_or_none():
    assert load_robot("panda", None).frame == "flange"
    with pytest.raises(
        InputError, match="frame: got 3, allowed the name of a site or body, or None for 'flange'"
    ):
        load_robot("panda", 3)


def test_what_cannot_be_used_is_said_in_one_sentence(tmp_path):
    path = tmp_path / "planar.xml"
    path.write_text(PLANAR.format(""))
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody>")
    with pytest.raises(InputError, match=r"velocity: planar\.xml does not say it; give velocity="):
        load_robot(path, "end")
    with pytest.raises(InputError, match=r"velocity: got .* allowed one number or 2"):
        load_robot(path, "end", velocity=[1, 2, 3], acceleration=1)
    with pytest.raises(InputError, match=r"acceleration: got .* allowed positive numbers"):
        load_robot(path, "end", velocity=1, acceleration=-1)
    with pytest.raises(InputError, match="allowed 'panda' or the path of an MJCF or URDF file"):
        load_robot("ur5")
    with pytest.raises(InputError, match="which MuJoCo cannot read"):
        load_robot(broken)
    path.write_text(PLANAR.format(RATES).replace('range="-1 1"', ""))
    with pytest.raises(InputError, match=r"joint 'turn' of planar\.xml without a range"):
        load_robot(path, "end")


def test_without_mink_the_extra_is_named():
    code = "import sys; sys.modules['mink'] = None; import ergoqp.whole_body"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "the whole-body formulation needs the package 'mink': install it with" in done.stderr
    assert "[mink]'`" in done.stderr
