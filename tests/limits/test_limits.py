"""Every limit alone: rows against differences, margins against brute force, and what is refused."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import casadi as ca
import numpy as np
import pytest
from contexts import ask
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp.errors import InputError, ProblemError
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.limits import AXES, ArmLength, AxisCone, JointLimit, Rows, TwistLimit, WorkspaceBox
from ergoqp.simulation.robot import moved

BOX = WorkspaceBox((0.2, -0.5, 0.7), (0.8, 0.4, 1.7))
NARROW = JointLimit(ranges_deg={"trunk_flexion": (-5, 40)}, rate_deg=60)


def pose_of(rng: np.random.Generator) -> np.ndarray:
    pose = np.eye(4)
    # QR alone gives only half of all directions.
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.choice([-1, 1], 3)
    if np.linalg.det(pose[:3, :3]) < 0:
        pose[:3, 1] *= -1
    pose[:3, 3] = rng.uniform([0, -0.7, 0.5], [1.0, 0.6, 1.9])
    return pose


def angle(axis: np.ndarray, direction: Any) -> float:
    toward = np.asarray(direction)
    return float(np.arctan2(np.linalg.norm(np.cross(toward, axis)), toward @ axis))


# --- the box --------------------------------------------------------------------------------------


def test_box_rows_are_the_distances_and_their_derivatives() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        pose = pose_of(rng)
        matrix, below, above, rate, margins = ask(BOX, pose=pose)
        np.testing.assert_allclose(below, pose[:3, 3] - BOX.lower, atol=1e-15)
        np.testing.assert_allclose(above, BOX.upper - pose[:3, 3], atol=1e-15)
        np.testing.assert_allclose(margins, np.minimum(below, above), atol=1e-15)
        assert np.isinf(rate).all()
        for axis, step in enumerate(1e-6 * np.eye(6)):
            change = (ask(BOX, pose=moved(pose, step))[1] - below) / 1e-6
            np.testing.assert_allclose(matrix[:, axis], change, atol=1e-8)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=60)
def test_box_margins_are_the_least_on_the_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, displacement = pose_of(rng), rng.normal(size=6) * 0.3
    line = pose[:3, 3] + np.linspace(0, 1, 101)[:, None] * displacement[:3]
    # Whoever is outside one end is so much further out beyond the other.
    below, above = line - BOX.lower, BOX.upper - line
    brute = np.minimum(below + np.minimum(above[0], 0), above + np.minimum(below[0], 0)).min(axis=0)
    np.testing.assert_allclose(ask(BOX, pose=pose, displacement=displacement)[4], brute, atol=1e-12)


@pytest.mark.parametrize("end", ["upper", "lower"])
def test_a_way_through_a_box_counts_as_further_out_than_where_it_began(end: str) -> None:
    pose, through, sign = np.eye(4), np.zeros(6), 1 if end == "upper" else -1
    pose[:3, 3] = np.add(getattr(BOX, end), (0.01 * sign, 0, 0))
    through[0] = -sign * (BOX.upper[0] - BOX.lower[0] + 0.015)
    began, ended = (ask(BOX, pose=pose, displacement=way)[4][0] for way in (np.zeros(6), through))
    assert began == pytest.approx(-0.01)
    assert ended == pytest.approx(-0.015)


# --- the cone -------------------------------------------------------------------------------------

CONES = [
    AxisCone((1, 0, 0), 35),
    AxisCone((1.0, 0.3, -0.2), 50),
    AxisCone((0, 0, 2), 3),
    AxisCone((-1, 1, 1), 120),
]


def axes_on_the_way(pose: np.ndarray, turn: np.ndarray, count: int) -> np.ndarray:
    """The tool's axis at shares of a turn (count, 3), by Rodrigues' formula."""
    length = np.linalg.norm(turn)
    u, a = (turn / length if length else turn), pose[:3, 0]
    phi = np.linspace(0, length, count)[:, None]
    return a * np.cos(phi) + np.cross(u, a) * np.sin(phi) + u * (u @ a) * (1 - np.cos(phi))


@pytest.mark.slow
@given(st.sampled_from(CONES), st.integers(0, 2**32 - 1), st.floats(0, 5))
@settings(deadline=None, max_examples=300)
def test_cone_margin_is_the_least_on_the_way(cone: AxisCone, seed: int, length: float) -> None:
    rng = np.random.default_rng(seed)
    pose, turn = pose_of(rng), rng.normal(size=3)
    if seed % 5 == 0:
        # The axis starts on the cone itself, where it matters most.
        pose[:3, :3] = moved(
            frame_along(cone.direction),
            np.array([0, 0, 0, *(np.radians(cone.half_angle_deg) * _level(cone))]),
        )[:3, :3]
    turn *= length / np.linalg.norm(turn)
    displacement = np.concatenate([rng.normal(size=3), turn])
    samples = [angle(axis, cone.direction) for axis in axes_on_the_way(pose, turn, 401)]
    margin = ask(cone, pose=pose, displacement=displacement)[4][0]
    brute = np.radians(cone.half_angle_deg) - max(samples)
    # Never above the truth, and not below it by more than the sampling can miss.
    assert margin <= brute + 1e-7
    assert margin >= brute - 1e-7 - length / 800


def frame_along(direction: Any) -> np.ndarray:
    x = np.asarray(direction) / np.linalg.norm(direction)
    y = np.cross([0.3, -0.5, 0.8], x)
    y /= np.linalg.norm(y)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    return pose


def _level(cone: AxisCone) -> np.ndarray:
    return frame_along(cone.direction)[:3, 1]


def test_cone_margin_sees_the_axis_swing_out_and_back() -> None:
    # A whole turn ends where it began; on its way the axis was 80 degrees off.
    cone, pose = AxisCone((1, 0, 0), 60), np.eye(4)
    about = np.array([np.cos(np.radians(40)), np.sin(np.radians(40)), 0])
    margin = ask(cone, pose=pose, displacement=np.concatenate([np.zeros(3), 2 * np.pi * about]))[4][
        0
    ]
    assert margin == pytest.approx(np.radians(60 - 80), abs=1e-9)


def test_cone_row_is_the_derivative_amid_the_swing_and_never_promises_room_that_is_not_there() -> (
    None
):
    cone = AxisCone((1.0, 0.3, -0.2), 50)
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        pose, swing = pose_of(rng), rng.normal(size=6) * 0.3
        now = angle(pose[:3, 0], cone.direction)
        if not 0.02 < now < 3.1:
            continue
        matrix, below, above, _, margins = ask(cone, pose=pose, stop_displacement=swing)
        assert np.isinf(below).all()
        margin = np.radians(50) - now
        assert margins[0] == pytest.approx(margin, abs=1e-9)
        if margin > 0:
            inside += 1
            assert above[0] <= margin + 1e-9
        else:
            assert above[0] == pytest.approx(margin, abs=1e-9)
        middle = moved(pose, swing / 2)
        there = angle(middle[:3, 0], cone.direction)
        change = [
            (angle(moved(middle, step)[:3, 0], cone.direction) - there) / 1e-6
            for step in 1e-6 * np.eye(6)
        ]
        np.testing.assert_allclose(matrix[0], change, atol=1e-5)
    assert inside > 3


def test_cone_on_its_own_axis_and_opposite_to_it_is_finite() -> None:
    for sign in (1, -1):
        pose = np.diag([sign, sign, 1.0, 1.0])
        matrix, _, above, _, margins = ask(
            AxisCone((1, 0, 0), 35),
            pose=pose,
            stop_displacement=np.ones(6),
            displacement=np.ones(6) * 0.1,
        )
        assert np.isfinite(matrix).all()
        assert np.isfinite(above).all()
        assert np.isfinite(margins).all()
        assert margins[0] < np.radians(35)


# --- what a declared robot may have done already, or not ------------------------------------------


def test_distances_that_cannot_be_counted_on_are_not_there() -> None:
    rng = np.random.default_rng(4)
    for limit in (BOX, CONES[0]):
        m, pose, displacement = len(limit.names), pose_of(rng), rng.normal(size=6) * 0.2
        lost = rng.uniform(0, 0.1, m), rng.uniform(0, 0.1, m)
        matrix, below, above, _, margins = ask(limit, pose=pose, displacement=displacement)
        found = ask(limit, pose=pose, displacement=displacement, lost=lost, turn=0.0)
        np.testing.assert_array_equal(found[0], matrix)
        np.testing.assert_allclose(found[1], below - lost[0], atol=1e-15)
        np.testing.assert_allclose(found[2], above - lost[1], atol=1e-15)
        if limit is BOX:
            line = pose[:3, 3] + np.linspace(0, 1, 101)[:, None] * displacement[:3]
            brute = np.minimum(line - BOX.lower - lost[0], BOX.upper - lost[1] - line).min(axis=0)
            np.testing.assert_allclose(found[4], brute, atol=1e-12)
        else:
            np.testing.assert_allclose(found[4], margins - lost[1], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("largest", [0.01, 0.03, 0.08])
@pytest.mark.parametrize("cone", CONES, ids=lambda cone: f"{cone.half_angle_deg} deg")
def test_a_cone_holds_whatever_share_of_each_turn_under_way_is_done(
    cone: AxisCone, largest: float
) -> None:
    for seed in range(200):
        rng = np.random.default_rng(seed)
        tilt = rng.uniform(0, 1) * np.radians(cone.half_angle_deg)
        pose = moved(frame_along(cone.direction), np.array([0, 0, 0, *(tilt * _level(cone))]))
        turns = [rng.normal(size=3) * rng.uniform(0, largest) for _ in range(rng.integers(1, 4))]
        landed = moved(pose, np.array([0, 0, 0, *sum(turns)]))
        matrix = ask(cone, pose=landed)[0][0, 3:]
        # A turn that leads away from the end is not counted on: see
        # `ergoqp.step.delay`.
        lost = sum(max(0.0, -matrix @ turn) for turn in turns)
        turn = sum(float(np.linalg.norm(turn)) for turn in turns)
        further = np.array([0, 0, 0, *(rng.normal(size=3) * rng.uniform(0, 0.2))])
        margin = ask(cone, pose=landed, displacement=further, lost=([0.0], [lost]), turn=turn)[4][0]
        for _ in range(40):
            at = pose
            for part in turns:
                at = moved(at, rng.choice([0.0, 1.0, rng.random()]) * np.array([0, 0, 0, *part]))
            at = moved(at, rng.choice([0.0, 1.0, rng.random()]) * further)
            left = np.radians(cone.half_angle_deg) - angle(at[:3, 0], cone.direction)
            assert left >= margin - 1e-9, (seed, np.degrees(left), np.degrees(margin))


# --- the joints -----------------------------------------------------------------------------------


def test_joint_rows_are_the_joints() -> None:
    rng = np.random.default_rng(2)
    q, S = rng.uniform(LOWER - 0.2, UPPER + 0.2), rng.normal(size=(32, 6))
    matrix, below, above, rate, margins = ask(NARROW, posture=q, sensitivity=S)
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[INDEX["trunk_flexion"]], upper[INDEX["trunk_flexion"]] = np.radians([-5, 40])
    np.testing.assert_allclose(matrix, S)
    np.testing.assert_allclose(below, q - lower, atol=1e-15)
    np.testing.assert_allclose(above, upper - q, atol=1e-15)
    np.testing.assert_allclose(rate, np.radians(60))
    np.testing.assert_allclose(margins, np.minimum(below, above), atol=1e-15)


def test_joint_rows_are_where_the_joints_will_be_when_what_is_under_way_is_done() -> None:
    rng = np.random.default_rng(5)
    q, S, shift = rng.uniform(LOWER, UPPER), rng.normal(size=(32, 6)), rng.normal(size=32) * 0.1
    ahead, there = (
        ask(NARROW, posture=q, sensitivity=S, shift=shift),
        ask(NARROW, posture=q + shift, sensitivity=S),
    )
    for found, same in zip(ahead, there, strict=True):
        np.testing.assert_allclose(found, same, atol=1e-15)


def test_only_what_was_narrowed_is_asked_back_and_only_where_that_is_wanted() -> None:
    assert not any(NARROW.recovers)
    assert not any(JointLimit(recover=True).recovers)
    asking = JointLimit(ranges_deg={"trunk_flexion": (-5, 40)}, recover=True)
    assert [name for name, returns in zip(JOINTS, asking.recovers, strict=True) if returns] == [
        "trunk_flexion"
    ]
    assert all(BOX.recovers)
    assert all(CONES[0].recovers)


def test_joint_margins_look_along_the_way() -> None:
    rng = np.random.default_rng(3)
    q, S, displacement = (
        rng.uniform(LOWER, UPPER),
        rng.normal(size=(32, 6)),
        rng.normal(size=6) * 0.2,
    )
    line = q + np.linspace(0, 1, 101)[:, None] * (S @ displacement)
    lower, upper = NARROW.range
    brute = np.minimum(line - lower, upper - line).min(axis=0)
    np.testing.assert_allclose(
        ask(NARROW, posture=q, sensitivity=S, displacement=displacement)[4], brute, atol=1e-12
    )


def test_a_joint_that_nobody_sees_has_no_margin() -> None:
    q, seen = np.full(32, 3.0), np.ones(32)
    seen[[0, 7]] = 0
    q[0] = np.nan
    _, below, above, _, margins = ask(
        NARROW, posture=q, observed=seen, sensitivity=np.ones((32, 6)), displacement=np.ones(6)
    )
    for part in (below, above, margins):
        assert np.isposinf(part[[0, 7]]).all()
        assert np.isfinite(np.delete(part, [0, 7])).all()


# --- construction ---------------------------------------------------------------------------------


def test_twist_limit_gives_vectors_with_frozen_axes_at_zero() -> None:
    limit = TwistLimit(0.1, 0.5, 0.3, 1.5, axes=("z", "ry"))
    np.testing.assert_array_equal(limit.speed, [0, 0, 0.1, 0, 0.5, 0])
    np.testing.assert_array_equal(limit.acceleration, [0.3] * 3 + [1.5] * 3)
    np.testing.assert_array_equal(TwistLimit(0.1, 0.5).speed, [0.1] * 3 + [0.5] * 3)
    assert AXES == ("x", "y", "z", "rx", "ry", "rz")


def test_names_tell_rows_apart() -> None:
    names = [*BOX.names, *AxisCone((1, 0, 0), 30).names, *NARROW.names]
    assert len(set(names)) == len(names)
    assert NARROW.names == JOINTS
    assert (BOX.hard, AxisCone((1, 0, 0), 30).hard, NARROW.hard) == (True, True, False)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: WorkspaceBox((0, 0, 0), (1, -1, 1)),
            "workspace: got lower .* above upper .*, allowed lower <= upper",
        ),
        (
            lambda: WorkspaceBox((0, 0), (1, 1, 1)),
            "workspace lower: got .* allowed three finite numbers",
        ),
        (
            lambda: WorkspaceBox((0, 0, 0), (1, np.inf, 1)),
            "workspace upper: got .* allowed three finite numbers",
        ),
        (
            lambda: WorkspaceBox((0, np.nan, 0), (1, 1, 1)),
            "workspace lower: got .* allowed three finite numbers",
        ),
        (
            lambda: AxisCone((0, 0, 0), 30),
            "tool axis direction: got .* allowed any vector from 1e-9",
        ),
        (
            lambda: AxisCone((np.nan, 0, 1), 30),
            "tool axis direction: got .* allowed three finite numbers",
        ),
        (lambda: AxisCone((1, 0, 0), 0), "half_angle_deg: got 0 deg, allowed 1e-06 to 170 deg"),
        (lambda: AxisCone((1, 0, 0), 180), "half_angle_deg: got 180"),
        (lambda: AxisCone((1, 0, 0), np.nan), "half_angle_deg: got nan"),
        (lambda: TwistLimit(linear_speed=0), "linear_speed: got 0 m/s, allowed 1e-09 to 1e"),
        (lambda: TwistLimit(angular_speed=-1), "angular_speed: got -1"),
        (lambda: TwistLimit(linear_acceleration=np.inf), "linear_acceleration: got inf"),
        (lambda: TwistLimit(angular_acceleration=np.nan), "angular_acceleration: got nan"),
        (lambda: TwistLimit(axes=()), "axes: got"),
        (
            lambda: TwistLimit(axes=("x", "roll")),
            "axes: got .* allowed some of x, y, z, rx, ry, rz",
        ),
        (
            lambda: JointLimit(ranges_deg={"tail": (0, 1)}),
            "ranges_deg: got 'tail', allowed a joint",
        ),
        (
            lambda: JointLimit(ranges_deg={"trunk_flexion": (40, -5)}),
            "ranges_deg of trunk_flexion: got 40 to -5",
        ),
        (
            lambda: JointLimit(ranges_deg={"trunk_flexion": (0, 200)}),
            "allowed within -30 to 110 deg",
        ),
        (
            lambda: JointLimit(ranges_deg={"trunk_flexion": (np.nan, 20)}),
            "ranges_deg of trunk_flexion: got .nan, 20., allowed two numbers",
        ),
        (lambda: JointLimit(rate_deg=0), "rate_deg: got 0 deg/s, allowed 0.001"),
        (lambda: JointLimit(rate_deg=np.nan), "rate_deg: got nan"),
        (lambda: JointLimit(recovery_time=-1), "recovery_time: got -1"),
        (lambda: JointLimit(rate_deg=np.inf), "rate_deg: got inf deg/s, allowed 0.001 to 10000"),
        (lambda: JointLimit(yield_zone_deg=np.inf), "yield_zone_deg: got inf deg, allowed 0 to 20"),
        (lambda: JointLimit(tolerance_deg=np.nan), "tolerance_deg: got nan"),
        (lambda: JointLimit(rate_deg="a"), "rate_deg: got 'a'"),  # type: ignore[arg-type]
        (lambda: TwistLimit(aside=10**400), "aside: got 1000"),
        (lambda: JointLimit(tolerance_deg="a"), "tolerance_deg: got 'a'"),  # type: ignore[arg-type]
        (
            lambda: WorkspaceBox((0, 0, 0), (1, 1, 1), tolerance=np.nan),
            "workspace tolerance: got nan m, allowed",
        ),
        (
            lambda: WorkspaceBox((0, 0, 0), (1, 1, 1), recovery_time=0.0),
            "workspace recovery_time: got 0.0",
        ),
        (
            lambda: WorkspaceBox((0, 0, 0), (1, 1, 1), recovery_time=np.inf),
            "workspace recovery_time: got inf",
        ),
        (lambda: AxisCone((1, 0, 0), 20, tolerance=None), "tool axis tolerance: got None"),
        (lambda: AxisCone((1, 0, 0), 20, recovery_time=-1.0), "tool axis recovery_time: got -1.0"),
        (lambda: TwistLimit(aside=-1.0), "aside: got -1.0"),
        (lambda: TwistLimit(aside=1000.5), "aside: got 1000.5 m/s\\^2, allowed 0 to 1000 m/s"),
    ],
)
def test_wrong_limits_are_refused(make: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()


@pytest.mark.parametrize("part", ["matrix", "to_lower", "to_upper", "rate", "curvature_margin"])
def test_rows_of_several_sizes_are_refused(part: str) -> None:
    parts = {
        name: ca.SX(2, 6 if name == "matrix" else 1)
        for name in ("matrix", "to_lower", "to_upper", "rate", "curvature_margin")
    }
    Rows(**parts)
    with pytest.raises(ProblemError, match=f"rows whose {part} has shape"):
        Rows(**parts | {part: ca.SX(2, 2)})


@pytest.mark.parametrize(
    "limit", [BOX, NARROW, TwistLimit(), AxisCone((1, 0, 0), 20), ArmLength(0.27)], ids=type
)
def test_limits_cannot_be_changed_unnoticed(limit: Any) -> None:
    with pytest.raises(FrozenInstanceError):
        limit.tolerance = 1.0
