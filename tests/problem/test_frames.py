"""Frames of robot, tool and camera: read, applied, written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError, ProblemError
from ergoqp.problem.settings import Frames
from ergoqp.simulation.robot import moved

BASE = [0.9, 0.2, 0.7, 0.1, 0.2, 0.3, np.sqrt(0.86)]
FLANGE = [0.03, -0.02, 0.15, 0.5, -0.5, 0.5, 0.5]


def flange_somewhere() -> np.ndarray:
    return moved(np.eye(4), np.array([0.4, -0.3, 0.2, 0.5, -1.1, 0.4]))


def test_frames_of_identity_move_nothing() -> None:
    assert Frames(camera=BASE).moved is False
    assert Frames(BASE).moved is Frames(flange=FLANGE).moved is True


def test_the_contact_is_reached_by_base_pose_and_flange() -> None:
    frames = Frames(BASE, FLANGE)
    pose = flange_somewhere()
    contact = frames.contact_pose(pose)
    np.testing.assert_allclose(contact, frames.base @ pose @ frames.flange, atol=1e-12)
    np.testing.assert_allclose(frames.reported_pose(contact), pose, atol=1e-12)


def test_quaternions_are_x_y_z_w() -> None:
    quarter = Frames(base=[1, 2, 3, 0, 0, np.sqrt(0.5), np.sqrt(0.5)]).base
    np.testing.assert_allclose(quarter[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(quarter[:3, 3], [1, 2, 3])


def test_the_twist_of_the_flange_moves_the_contact_as_asked() -> None:
    frames, pose, dt = Frames(BASE, FLANGE), flange_somewhere(), 1e-6
    twist = np.array([0.1, -0.2, 0.05, 0.7, -0.4, 0.3])
    sent = frames.twist_for_robot(twist, pose)
    before = frames.contact_pose(pose)
    after = frames.contact_pose(moved(pose, sent * dt))
    np.testing.assert_allclose((after[:3, 3] - before[:3, 3]) / dt, twist[:3], atol=1e-5)
    turn = (after[:3, :3] @ before[:3, :3].T - np.eye(3)) / dt
    np.testing.assert_allclose([turn[2, 1], turn[0, 2], turn[1, 0]], twist[3:], atol=1e-5)
    np.testing.assert_allclose(frames.twist_from_robot(sent, pose), twist, atol=1e-12)


def test_points_of_the_camera_in_the_world() -> None:
    frames = Frames(camera=BASE)
    point = np.array([[0.1, 0.2, 2.0]])
    expected = (frames.camera @ np.array([0.1, 0.2, 2.0, 1.0]))[:3]
    np.testing.assert_allclose(frames.from_camera(point), expected[None], atol=1e-12)
    for wrong in ([1.0, 2.0], [1.0, 2.0, 3.0], [[1.0, 2.0]], np.zeros((1, 1, 3)), "here"):
        with pytest.raises(InputError, match=r"points: got .* allowed rows of three numbers"):
            frames.from_camera(wrong)


def test_a_file_gives_what_python_gives(tmp_path: Path) -> None:
    frames = Frames(BASE, FLANGE, offset=[0.01, 0.02, 0.03], spread=0.05, spread_deg=12.5)
    path = tmp_path / "task.toml"
    path.write_text("[response.ik]\n" + frames.toml())
    read = ergoqp.load_problem(path).frames
    for name in ("base", "flange", "camera", "offset"):
        np.testing.assert_allclose(getattr(read, name), getattr(frames, name), atol=1e-8)
    assert (read.spread, read.spread_deg) == (0.05, 12.5)
    assert read.moved
    assert not Frames(camera=BASE).moved
    assert Frames() == Frames(base=np.eye(4))
    assert Frames(BASE) != Frames()


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"base": [0, 0, 0, 0, 0, 0, 2]}, "quaternion x, y, z, w of length 1"),
        ({"base": [0, 0, np.nan, 0, 0, 0, 1]}, "frames.base: got nan"),
        ({"flange": np.diag([1, -1, 1, 1])}, "frames.flange: got a pose that is a mirror"),
        ({"camera": "there"}, "frames.camera: got 'there'"),
        ({"base": [[1, 2], [3]]}, "frames.base: got .*or x, y, z .m. and a quaternion"),
        ({"base": [400, 0, 300, 0, 0, 0, 1]}, "within 100 m"),
        ({"offset": [1, 2]}, "frames.offset: got"),
        ({"spread": 0.1}, "got one of spread and spread_deg"),
        ({"spread": -0.1, "spread_deg": 1.0}, "frames.spread: got -0.1"),
    ],
)
def test_what_is_no_frame_is_refused(keys: dict[str, Any], says: str) -> None:
    with pytest.raises(ProblemError, match=says):
        Frames(**keys)


def test_frames_are_for_problems_with_a_person() -> None:
    with pytest.raises(ProblemError, match="frames: got one, allowed only where an object"):
        ergoqp.load_problem("forearm").replace(frames=Frames(BASE))
    with pytest.raises(ProblemError, match=r"frames: got .* allowed a Frames"):
        ergoqp.load_problem("screwing").replace(frames=np.eye(4))


@pytest.mark.slow
def test_simulated_runs_are_in_the_world() -> None:
    problem = ergoqp.load_problem("screwing")
    plain, framed = (
        ergoqp.simulate(each, problem.response.comfort, duration=0.2, seed=0)
        for each in (problem, problem.replace(frames=Frames(BASE, FLANGE)))
    )
    np.testing.assert_array_equal(plain.twists, framed.twists)
