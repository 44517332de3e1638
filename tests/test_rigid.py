"""One reader of poses: what is a rigid motion, and the nearest one to what is almost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from step_samples import comfort_of, held_pose, near_comfort, problem_of

from ergoqp.errors import InputError
from ergoqp.expressions import read_pose
from ergoqp.limits import AxisCone
from ergoqp.placing.optimise import optimise
from ergoqp.simulation.robot import moved
from ergoqp.step.stepper import Stepper

MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])
DOUBLED = np.diag([1.0, 1.0, 1.0, 2.0])
SHEARED = np.eye(4) + np.outer([1, 0, 0, 0], [0, 0.01, 0, 0])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_a_rounded_rotation_is_read_as_the_nearest_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = moved(np.eye(4), np.concatenate([rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3)]))
    rounded = np.round(pose, 4)
    read = read_pose("pose", rounded.tolist())
    left, _, right = np.linalg.svd(rounded[:3, :3])
    np.testing.assert_allclose(read[:3, :3], left @ right, atol=1e-12)
    np.testing.assert_array_equal(read[:3, 3], rounded[:3, 3])
    np.testing.assert_array_equal(read[3], [0, 0, 0, 1])


BAD = [
    (MIRROR, "a mirror"),
    (DOUBLED, r"not a rigid motion: its last row is \[0.0, 0.0, 0.0, 2.0\]"),
    (SHEARED, "not a rigid motion"),
    (np.full((4, 4), np.nan), "not finite"),
    (np.diag([1.0, 1, 1, 1]) + np.outer([200, 0, 0, 0], [0, 0, 0, 1]), "far away"),
    (np.eye(3), "shape"),
    ("here", "got 'here', allowed a pose"),
]


@pytest.mark.parametrize(
    ("wrong", "said"), BAD, ids=["mirror", "row", "sheared", "nan", "far", "shape", "text"]
)
@pytest.mark.parametrize("where", ["guide", "optimise", "whole body", "step"])
def test_everybody_refuses_the_same_poses(where: str, wrong: Any, said: str) -> None:
    problem = problem_of("screwing")
    if where == "step":
        step = Stepper(problem).step(comfort_of("screwing"), wrong)
        assert step.status == "invalid"
        assert "pose" in step.reason
        return
    if where == "whole body":
        whole_body = pytest.importorskip(
            "ergoqp.whole_body", reason="the extra mink is not installed"
        )
    given = {
        "guide": lambda: Stepper(problem, guide=wrong),
        "optimise": lambda: optimise(problem, comfort_of("screwing"), pose=wrong, starts=1),
        "whole body": lambda: whole_body.WholeBody(problem, "panda", base=wrong),
    }[where]
    with pytest.raises(InputError, match=said):
        given()


def test_the_cone_holds_for_a_pose_of_four_decimals() -> None:
    """A column that is too long looked nearer to the middle of the cone: 0.4 deg outside of 1 deg,
    and `optimal`."""
    problem = problem_of("screwing")
    cone = problem.limit_of(AxisCone)
    tight = AxisCone(cone.direction, 1.0)
    problem = problem.replace(
        limits=[tight if limit is cone else limit for limit in problem.limits]
    )
    stepper, rng, farthest = Stepper(problem), np.random.default_rng(0), 0.0
    for _ in range(30):
        axis = rng.normal(size=3)
        pose = moved(
            held_pose("screwing"),
            np.concatenate([np.zeros(3), np.radians(0.98) * axis / np.linalg.norm(axis)]),
        )
        stepper.reset()
        # As it is rounded, and stretched by as much as passes for a rotation.
        given = np.round(pose, 4)
        given[:3, 0] *= 1 + 4e-4
        step = stepper.step(near_comfort("screwing", rng, 20), given)
        left, _, right = np.linalg.svd(given[:3, :3])
        np.testing.assert_allclose(step.pose[:3, :3], left @ right, atol=1e-12)
        true = np.degrees(
            np.arccos(np.clip((left @ right)[:, 0] @ np.asarray(cone.direction), -1, 1))
        )
        assert step.margins["tool axis"] == pytest.approx(np.radians(1.0 - true), abs=1e-9)
        farthest = max(farthest, true)
    assert farthest > 0.9
