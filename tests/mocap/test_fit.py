"""The fit itself: any posture is found, gaps are bridged, and shoulders keep to one way of turning.

Truth is the kinematics of the body, which its own tests hold against MuJoCo and Pinocchio.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.made_motions import SHOULDERS
from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.mocap.fitting import posture as fitting
from ergoqp.mocap.fitting.posture import fit
from ergoqp.mocap.fitting.validity import steady
from ergoqp.mocap.naming import CENTRES, centres_of
from ergoqp.sheets.description import elevation_of

BODY = Body.of_lengths({"upper_arm": 0.33, "forearm": 0.24, "thigh": 0.40, "trunk": 0.50})
KINEMATICS = Kinematics(BODY)
SHOULDER = [INDEX[f"right_shoulder_{name}"] for name in ("flexion", "abduction", "rotation")]
FROM_BONES = ("elbow_flexion", "knee_flexion", "wrist_flexion", "ankle_flexion")
"""Joints that nothing shows but the bones on both sides of them."""
REST = np.radians([5, 2, 3, 4, 1, 2, *2 * [15, 10, 5, 40, 10, 5, 4], *2 * [15, 5, 4, 25, 5, 3]])


def places(pelvis: np.ndarray, postures: np.ndarray) -> dict[str, np.ndarray]:
    """Where the centres are, by the kinematics of the body."""
    found: dict[str, list[np.ndarray]] = {centre: [] for centre in CENTRES}
    for (x, y, z, yaw), posture in zip(pelvis, postures, strict=True):
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        for centre in CENTRES:
            place = np.array(KINEMATICS.at(centre, ca.DM(posture))[0]).ravel()
            found[centre].append(turn @ place + [x, y, z])
    return {centre: np.array(path) for centre, path in found.items()}


def pelvis_of(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-2, -2, 0.5, -3], [2, 2, 1.5, 3], (count, 4))


def axes_of(posture: np.ndarray, frame: str) -> np.ndarray:
    return np.array(KINEMATICS.at(frame, ca.DM(posture))[1])


def test_the_centres_are_those_of_the_body() -> None:
    generator = np.random.default_rng(3)
    postures = generator.uniform(LOWER, UPPER, (5, 32))
    pelvis = pelvis_of(5)
    truth = places(pelvis, postures)
    for centre, path in centres_of(BODY, pelvis, postures).items():
        np.testing.assert_allclose(path, truth[centre], atol=1e-12)


def test_any_posture_is_found_without_a_frame_before() -> None:
    generator = np.random.default_rng(1)
    postures = LOWER + (UPPER - LOWER) * generator.uniform(0.2, 0.8, (40, 32))
    pelvis = pelvis_of(40)
    found = fit(BODY, places(pelvis, postures), 10.0 * np.arange(40))
    assert found.error.max() < 0.002
    assert found.observed.all()
    np.testing.assert_allclose(found.pelvis[:, :3], pelvis[:, :3], atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * found.pelvis[:, 3]), np.exp(1j * pelvis[:, 3]))
    exact = [i for i, name in enumerate(JOINTS) if name.startswith(("trunk", "neck"))]
    exact += [
        i for i, name in enumerate(JOINTS) if name.endswith(("elbow_flexion", "knee_flexion"))
    ]
    np.testing.assert_allclose(found.postures[:, exact], postures[:, exact], atol=1e-9)
    for truth, posture in zip(postures, found.postures, strict=True):
        for frame in ("right_knuckles", "left_knuckles", "right_toe", "left_toe"):
            turned = axes_of(truth, frame).T @ axes_of(posture, frame)
            assert np.degrees(np.arccos(min((np.trace(turned) - 1) / 2, 1))) < 2.0


def moved(angles: list[tuple[float, float, float]], elbow: float, count: int = 181) -> np.ndarray:
    """Smooth postures through shoulder angles [deg], both arms alike."""
    keys = np.radians(angles)
    share = np.linspace(0, len(keys) - 1, count)
    at = np.minimum(share.astype(int), len(keys) - 2)
    part = (1 - np.cos(np.pi * (share - at))) / 2
    path = keys[at] + part[:, None] * (keys[at + 1] - keys[at])
    postures = np.tile(REST, (count, 1))
    for side in ("right", "left"):
        for i, name in enumerate(("flexion", "abduction", "rotation")):
            postures[:, INDEX[f"{side}_shoulder_{name}"]] = path[:, i]
        postures[:, INDEX[f"{side}_elbow_flexion"]] = np.radians(elbow)
    return postures


@pytest.mark.slow
@pytest.mark.parametrize("elbow", [3.0, 30.0, 90.0])
@pytest.mark.parametrize("name", SHOULDERS)
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_shoulders_keep_to_one_way_of_turning(name: str, elbow: float, noise: float) -> None:
    truth = moved(SHOULDERS[name], elbow)
    pelvis = np.tile([0.3, 0.1, 0.9, 0.7], (len(truth), 1))
    where = places(pelvis, truth)
    generator = np.random.default_rng(5)
    where = {c: path + noise * generator.standard_normal(path.shape) for c, path in where.items()}
    found = fit(BODY, where, np.arange(len(truth)) / 60).postures
    for side in ("right", "left"):
        off = np.degrees(found - truth)[:, [INDEX[f"{side}_shoulder_flexion"]]].ravel()
        shows = np.cos(truth[:, INDEX[f"{side}_shoulder_abduction"]])
        # Never the other way, and as exact as the direction of the arm shows the flexion.
        assert np.abs(off).max() < 90
        assert np.sqrt(np.mean((shows * off) ** 2)) < (0.3 if noise == 0 else 1.5)
        elevations = [
            np.degrees(np.arccos(np.cos(q[:, i]) * np.cos(q[:, i + 1])))
            for q, i in ((each, INDEX[f"{side}_shoulder_flexion"]) for each in (found, truth))
        ]
        assert np.sqrt(np.mean((elevations[0] - elevations[1]) ** 2)) < (0.1 if not noise else 1.5)


@pytest.mark.parametrize("name", SHOULDERS)
def test_blocks_are_as_the_whole(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = moved(SHOULDERS[name], 30.0, 720)
    where = centres_of(BODY, pelvis_of(1).repeat(720, axis=0), truth)
    where["left_wrist"][300:330] = np.nan
    where["right_elbow"][100:110] = np.nan
    time = np.arange(720) / 40
    whole = fit(BODY, where, time)
    monkeypatch.setattr(fitting, "_BLOCK", 97)
    parts = fit(BODY, where, time)
    np.testing.assert_allclose(parts.postures, whole.postures, atol=np.radians(0.05))
    np.testing.assert_allclose(parts.error, whole.error, atol=1e-4)
    np.testing.assert_array_equal(parts.observed, whole.observed)
    assert set(parts.not_scored) == set(whole.not_scored)
    for cause, frames in whole.not_scored.items():
        np.testing.assert_array_equal(parts.not_scored[cause], frames)


def test_an_arm_that_is_held_up_goes_on_in_the_next_block(monkeypatch: pytest.MonkeyPatch) -> None:
    raised = moved(SHOULDERS["raised sideways"], 30.0)[:75]
    held = np.concatenate([raised, np.repeat(raised[-1:], 800, axis=0)])
    where = centres_of(BODY, np.tile([0.0, 0, 0.9, 0], (875, 1)), held)
    monkeypatch.setattr(fitting, "_BLOCK", 97)
    found = fit(BODY, where, np.arange(875) / 40).postures
    assert np.degrees(raised[-1, SHOULDER[1]]) > 110
    np.testing.assert_allclose(found[100:, SHOULDER], held[100:, SHOULDER], atol=np.radians(2))


def test_an_arm_that_is_lost_where_a_block_begins_forces_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = np.arange(600) / 40
    raised = moved([(10, 10, 0), (10, 130, 85)], 90.0, 100)
    truth = np.concatenate([raised, np.repeat(raised[-1:], 500, axis=0)])
    where = centres_of(BODY, np.tile([0.0, 0, 0.9, 0], (600, 1)), truth)
    monkeypatch.setattr(fitting, "_BLOCK", 300)
    lost = int(np.searchsorted(time, time[300] - fitting._AROUND))
    where["right_elbow"][lost - 3 : lost + 3] = np.nan
    found = fit(BODY, where, time).postures
    off = np.degrees(np.abs(found - truth))[:, SHOULDER[0]]
    assert off.max() < 5


def test_an_arm_that_circles_around_the_side_points_where_it_does() -> None:
    count = 240
    postures = np.tile(REST, (count, 1))
    postures[:, SHOULDER[0]] = np.linspace(0, 2 * np.pi, count)
    postures[:, SHOULDER[1]] = np.radians(75.0)
    where = centres_of(BODY, np.tile([0.0, 0, 0.9, 0], (count, 1)), postures)
    found = fit(BODY, where, np.arange(count) / 60)
    assert (found.postures >= LOWER).all()
    seen = found.observed[:, SHOULDER[0]]
    off = np.degrees(elevation_of(found.postures)[0] - elevation_of(postures)[0])[seen, 0]
    assert seen.mean() > 0.85
    assert np.abs(off).max() < 20.5
    assert np.sqrt(np.mean(off**2)) < 6


def test_an_arm_up_backwards_is_not_one_up_forwards() -> None:
    truth = moved([(0, 10, 0), (-58, 30, 0), (-58, 40, 0), (0, 10, 0)], 20.0)
    found = fit(BODY, places(np.zeros((181, 4)), truth), np.arange(181) / 60).postures
    np.testing.assert_allclose(found[:, SHOULDER], truth[:, SHOULDER], atol=np.radians(2))


def test_an_arm_up_backwards_is_one_at_the_first_frame_too() -> None:
    for elbow in (2.0, 40.0):
        truth = moved([(-58, 34, 0), (-58, 34, 0)], elbow, 3)
        truth[:, SHOULDER[0]] = np.radians(-78)
        found = fit(BODY, places(np.zeros((3, 4)), truth), np.arange(3) / 60).postures
        assert np.degrees(found[:, SHOULDER[0]]) == pytest.approx(-60, abs=0.1)


def test_a_single_frame_is_within_the_ranges_and_the_plain_one() -> None:
    for angles in ((20, 10, 0), (170, 10, 0), (0, 90, 0), (100, 30, 45)):
        truth = moved([angles, angles], 60.0, 2)[:1]
        found = fit(BODY, places(np.zeros((1, 4)), truth), np.zeros(1)).postures
        np.testing.assert_allclose(found[:, SHOULDER], truth[:, SHOULDER], atol=np.radians(1))


def test_points_that_are_lost_for_a_while() -> None:
    postures = np.tile(REST, (12, 1))
    elbow = INDEX["left_elbow_flexion"]
    postures[:, elbow] = np.radians(30 + 2 * np.arange(12))
    where = places(np.zeros((12, 4)), postures)
    for name in ("wrist", "knuckles", "thumb"):
        where[f"left_{name}"][4:7] = np.nan
    for path in where.values():
        path[9] = np.nan
    found = fit(BODY, where, np.arange(12) / 50)
    told = np.isin(np.arange(12), [4, 5, 6, 9], invert=True)
    np.testing.assert_array_equal(found.observed[:, elbow], told)
    assert found.observed[[4, 5, 6], INDEX["left_shoulder_flexion"]].all()
    # What is lost goes on between what was seen.
    np.testing.assert_allclose(found.postures[:, elbow], postures[:, elbow], atol=np.radians(0.2))
    assert np.isnan(found.error[9])
    assert np.nanmax(found.error) < 1e-3


def test_what_is_never_told_is_zero() -> None:
    postures = np.tile(REST, (5, 1))
    where = places(np.zeros((5, 4)), postures)
    for centre in ("nose", "right_elbow", "left_toe"):
        del where[centre]
    found = fit(BODY, where, np.arange(5) / 50)
    lost = [
        i for i, name in enumerate(JOINTS) if name.startswith(("right_shoulder", "right_elbow"))
    ]
    lost += [INDEX["neck_twist"], INDEX["left_ankle_flexion"], INDEX["left_ankle_inversion"]]
    assert not found.observed[:, lost].any()
    assert (found.postures[:, lost] == 0).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nothing_breaks_the_fit(seed: int) -> None:
    """Random points, on each other, lost, far away: finite angles within the ranges."""
    generator = np.random.default_rng(seed)
    count = int(generator.integers(1, 8))
    where = {
        centre: generator.choice([0.0, 1e-9, 1.0, 1e6]) * generator.standard_normal((count, 3))
        for centre in generator.permutation(CENTRES)[: generator.integers(1, len(CENTRES))]
    }
    for path in where.values():
        path[generator.random(count) < 0.3] = np.nan
    found = fit(BODY, where, np.cumsum(generator.uniform(1e-4, 1e3, count)))
    assert np.isfinite(found.postures).all()
    assert np.isfinite(found.pelvis).all()
    assert (found.postures >= LOWER).all()
    assert (found.postures <= UPPER).all()
    never = ~found.observed.any(axis=0)
    never[[INDEX[joint] for joint in JOINTS if not joint.endswith(FROM_BONES)]] = False
    assert (found.postures[:, never] == 0).all()


def test_what_does_not_show_is_what_was_before_and_comes_after() -> None:
    time = np.arange(101) / 50
    truth = 0.5 + 0.2 * time
    measured = truth + np.where(np.arange(101) % 2, 2.0, -2.0) * (np.abs(time - 1) < 0.3)
    shows = np.where(np.abs(time - 1) < 0.3, 0.01, 1.0)
    np.testing.assert_allclose(steady(measured, shows, time), truth, atol=0.03)
    np.testing.assert_allclose(steady(truth, np.ones(101), time), truth, atol=1e-3)
    assert (steady(np.full(3, np.nan), np.ones(3), time[:3]) == 0).all()
