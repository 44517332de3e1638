"""Markers of limbs that do not keep their distances are told from those that do."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.mocap.markers.rigid import Links, usual_distance

COUNT = 200
LEG = {
    "right_hip": (0.0, 0.0, 0.0),
    "right_thigh": (0.0, -0.08, -0.25),
    "right_outer_knee": (0.0, -0.057, -0.42),
    "right_shank": (0.05, -0.06, -0.63),
    "right_outer_ankle": (0.0, -0.043, -0.84),
    "right_heel": (-0.05, 0.0, -0.89),
    "right_forefoot": (0.16, 0.0, -0.89),
}
"""A hip and markers of a leg [m]."""
WHILE = slice(60, 90)


def leg(noise: float = 0.003, seed: int = 1) -> dict[str, np.ndarray]:
    """They walk away, tremble, and keep their distances."""
    generator = np.random.default_rng(seed)
    way = np.linspace(0, 3, COUNT)[:, None] * [1.0, 0.3, 0.0]
    return {
        name: way + place + noise * generator.standard_normal((COUNT, 3))
        for name, place in LEG.items()
    }


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01])
def test_those_that_keep_them_are_left(noise: float) -> None:
    at = leg(noise)
    assert Links(at).astray(at) == {}


@pytest.mark.parametrize("name", [name for name in LEG if name != "right_hip"])
@pytest.mark.parametrize("far", [(0.4, 0.0, 0.0), (0.0, 0.3, 0.3), (0.0, 0.0, 0.15)])
def test_one_that_is_elsewhere_for_a_while(name: str, far: tuple[float, float, float]) -> None:
    at = leg(0.001)
    at[name][WHILE] += far
    found = Links(at).astray(at)
    meanwhile = np.isin(np.arange(COUNT), np.r_[WHILE])
    np.testing.assert_array_equal(found[name], meanwhile)
    # Where only one distance tells it, its other end is not taken, either.
    assert len(found) <= 2
    assert not any(frames[~meanwhile].any() for frames in found.values())


def test_one_that_falls_off_early() -> None:
    at = leg()
    at["right_outer_ankle"][60:] += np.linspace(0.2, 2, 140)[:, None] * [0.5, 1, 0.2]
    found = Links(at).astray(at)
    assert found["right_outer_ankle"][60:].all()
    assert not any(frames[:60].any() for frames in found.values())
    assert not any(frames[80:].any() for name, frames in found.items() if "ankle" not in name)


def test_of_two_that_are_apart_neither_is_taken() -> None:
    at = {name: path for name, path in leg().items() if name.endswith(("knee", "ankle"))}
    at["right_outer_knee"][WHILE] += [0.0, 0.0, 0.1]
    found = Links(at).astray(at)
    assert set(found) == set(at)
    assert all(frames.sum() == 30 for frames in found.values())


def test_two_of_a_leg_that_are_exchanged() -> None:
    at = leg()
    thigh, ankle = at["right_thigh"].copy(), at["right_outer_ankle"].copy()
    at["right_thigh"][WHILE], at["right_outer_ankle"][WHILE] = ankle[WHILE], thigh[WHILE]
    found = Links(at).astray(at)
    assert {"right_thigh", "right_outer_ankle"} <= set(found)


def test_what_is_lost_or_not_there_does_not_count() -> None:
    at = leg()
    at["right_shank"][:] = np.nan
    at["right_thigh"][WHILE] = np.nan
    del at["right_heel"]
    links = Links(at)
    assert links.astray(at) == {}
    at["right_outer_knee"][100:110] += 0.3
    found = links.astray(at)
    assert list(found) == ["right_outer_knee"]
    assert found["right_outer_knee"].sum() == 10
    assert Links({}).astray({}) == {}
    assert Links({"c7": at["right_thigh"]}).astray({"c7": at["right_thigh"]}) == {}


def test_a_shoulder_blade_may_turn() -> None:
    at = leg()
    arm = {
        "left_shoulder": at["right_hip"],
        "left_upper_arm": at["right_thigh"],
        "left_outer_elbow": at["right_outer_knee"],
    }
    arm["left_shoulder"][WHILE] += [0.0, 0.0, 0.045]
    assert Links(arm).astray(arm) == {}
    arm["left_shoulder"][WHILE] += [0.0, 0.0, 0.1]
    assert list(Links(arm).astray(arm)) == ["left_shoulder"]


def test_a_deep_bend_brings_hip_and_knee_together() -> None:
    # By 5 cm at the pelvis, whose markers the thigh pushes, and by the skin over the knee.
    at = leg()
    at["right_hip"][WHILE] += [0.0, 0.0, -0.04]
    at["right_outer_knee"][WHILE] += [0.0, 0.0, 0.02]
    assert Links(at).astray(at) == {}
    at["right_outer_knee"][WHILE] += [0.0, 0.0, 0.04]
    assert set(Links(at).astray(at)) == {"right_outer_knee"}


def test_the_skin_slides_over_a_bent_knee() -> None:
    at = leg(0.001)
    at["right_outer_knee"][WHILE] += [0.0, 0.0, -0.03]
    assert Links(at).astray(at) == {}
    at["right_outer_knee"][WHILE] += [0.0, 0.0, -0.02]
    assert set(Links(at).astray(at)) == {"right_outer_knee"}


def test_a_marker_that_always_moves_on_the_skin_is_not_let_go_anywhere() -> None:
    at = leg(0.0)
    at["right_shank"] += 0.035 * np.sin(np.arange(COUNT))[:, None] * [0.0, 0.0, 1.0]
    links = Links(at)
    assert links.astray(at) == {}
    # It is farther away than skin moves, though not than six times what it mostly does.
    at["right_shank"][WHILE] += [0.0, 0.0, 0.15]
    assert links.astray(at)["right_shank"][WHILE].mean() > 0.6


def test_the_distance_is_where_most_of_the_time_is_nearest() -> None:
    at = np.linspace(0, 1, COUNT)[:, None] * [1.0, 0, 0]
    other = at + np.array([0.3, 0, 0])
    other[60:] += np.linspace(0.1, 3, 140)[:, None] * [0, 1.0, 0]
    assert usual_distance(at, other) == pytest.approx(0.3)
    other[:] = np.nan
    assert np.isnan(usual_distance(at, other))
