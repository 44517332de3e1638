"""Markers that are lost, told by the others: where they are, how surely, and what that is for."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.made_markers import markers_of, plug_in_gait
from benchmarks.made_motions import BODY, fitted, walk
from benchmarks.recording_outcomes import outside, seen
from ergoqp.joints import INDEX
from ergoqp.mocap import Recording, fit_postures
from ergoqp.mocap.markers.fit import SEGMENTS, _placed_with_slope, told_markers
from ergoqp.mocap.naming import growth_of

LOST = slice(100, 200)


@pytest.fixture(scope="module")
def walked() -> tuple[np.ndarray, np.ndarray]:
    """Pelvis and postures of somebody who walks."""
    recording = fitted(walk(6.0)[0])
    poses = recording.base_poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    return np.column_stack([poses[:, :3, 3], yaw]), recording.postures


def test_slopes_are_those_of_finite_differences(walked):
    z = np.hstack(walked)[::100]
    sits = plug_in_gait(BODY)
    frames = np.array([SEGMENTS.index(each.frame) for each in sits.values()])
    offsets, growth = np.array([each.offset for each in sits.values()]), growth_of(BODY)
    place, slope = _placed_with_slope(z, growth, frames, offsets)
    np.testing.assert_allclose(place, markers_of(BODY, z[:, :4], z[:, 4:])[1], atol=1e-12)
    for k in range(36):
        step = np.zeros(36)
        step[k] = 1e-6
        beside = _placed_with_slope(z + step, growth, frames, offsets)[0]
        np.testing.assert_allclose((beside - place) / 1e-6, slope[..., k], atol=1e-5)


@pytest.mark.parametrize("lost", ["RKNE", "LELB", "RWRA", "RASI", "LTIB", "LANK", "C7"])
def test_one_that_is_lost(walked, lost: str):
    names, places = markers_of(BODY, *walked)
    markers = {name: places[:, i] for i, name in enumerate(names)}
    truth = markers[lost]
    markers = markers | {lost: np.full_like(truth, np.nan)}
    generator = np.random.default_rng(4)
    start = np.hstack(walked)
    start = start + 0.1 * generator.standard_normal(start.shape)
    found, spread = told_markers(BODY, start, markers, plug_in_gait(BODY))
    assert np.linalg.norm(found[lost] - truth, axis=1).max() < 0.01
    assert (spread[lost] < 0.025).all()


def test_what_nothing_tells_is_not_sure(walked):
    names, places = markers_of(BODY, *walked)
    hand = ("RWRA", "RWRB", "RFIN", "RFRM")
    markers = {
        name: np.full_like(places[:, i], np.nan) if name in hand else places[:, i]
        for i, name in enumerate(names)
    }
    _, spread = told_markers(BODY, np.hstack(walked), markers, plug_in_gait(BODY))
    assert all(spread[name].min() > 0.05 for name in hand)
    assert spread["LWRA"].max() < 0.025


def test_another_markers_place_is_not_followed(walked):
    names, places = markers_of(BODY, *walked)
    markers = {name: places[:, i].copy() for i, name in enumerate(names)}
    markers["RTIB"], markers["LTIB"] = markers["LTIB"], markers["RTIB"]
    truth, markers["RKNE"] = markers["RKNE"], np.full_like(markers["RKNE"], np.nan)
    found, _ = told_markers(BODY, np.hstack(walked), markers, plug_in_gait(BODY))
    assert np.linalg.norm(found["RKNE"] - truth, axis=1).max() < 0.05


def told(walked, moved: dict[str, np.ndarray], **residuals: float):
    """The lost RKNE: how far from where it was and how surely, and by how much others are off."""
    names, places = markers_of(BODY, *walked)
    markers = {name: places[:, i] + moved.get(name, 0.0) for i, name in enumerate(names)}
    truth, markers["RKNE"] = markers["RKNE"], np.full_like(places[:, 0], np.nan)
    sits = {
        name: replace(each, residual=residuals.get(name, 0.0))
        for name, each in plug_in_gait(BODY).items()
    }
    found, spread = told_markers(BODY, np.hstack(walked), markers, sits)
    return np.linalg.norm(found["RKNE"] - truth, axis=1), spread["RKNE"]


@pytest.mark.slow
def test_how_far_a_marker_was_from_where_it_sits_is_in_its_deviation(walked):
    off, sure = told(walked, {})
    assert (sure > 0.01).all()
    again, unsure = told(walked, {}, RKNE=0.02)
    np.testing.assert_array_equal(again, off)
    # Half as much again as its residual, and a centimetre of skin at least.
    np.testing.assert_allclose(unsure**2 - sure**2, 0.03**2 - 0.01**2, rtol=1e-9)
    np.testing.assert_array_equal(told(walked, {}, RKNE=0.006)[1], sure)


@pytest.mark.slow
def test_markers_that_are_often_elsewhere_tell_less(walked):
    leg = dict.fromkeys(("RTHI", "RTIB", "RANK", "RHEE", "RTOE"), 0.05)
    assert (told(walked, {}, **leg)[1] > 1.5 * told(walked, {})[1]).all()
    aside = {name: np.array([0.0, 0.02, 0.0]) for name in ("RTHI", "RTIB")}
    loosely = dict.fromkeys(aside, 0.05)
    assert told(walked, aside, **loosely)[0].mean() < 0.5 * told(walked, aside)[0].mean()


@pytest.mark.slow
def test_one_that_is_far_away_does_not_draw(walked):
    for far in ([0.5, 0.0, 0.3], [0.0, -1.5, 0.0]):
        assert told(walked, {"RTIB": np.array(far)})[0].max() < 0.012


def test_a_limb_may_begin_far_from_where_it_is(walked):
    names, places = markers_of(BODY, *walked)
    markers = {name: places[:, i] for i, name in enumerate(names)}
    truth, markers["RANK"] = markers["RANK"], np.full_like(places[:, 0], np.nan)
    start = np.hstack(walked)
    start[:, 4 + INDEX["right_hip_flexion"]] += 0.9
    start[:, 4 + INDEX["right_knee_flexion"]] += 0.5
    found, _ = told_markers(BODY, start, markers, plug_in_gait(BODY))
    assert np.linalg.norm(found["RANK"] - truth, axis=1).max() < 0.03


def taken(walked, lost: tuple[str, ...]) -> Recording:
    names, places = markers_of(BODY, *walked)
    places = places + 0.001 * np.random.default_rng(5).standard_normal(places.shape)
    for name in lost:
        places[LOST, names.index(name)] = np.nan
    return fit_postures(names, places, 60.0, neutral="vertical")


def worst(recording: Recording, postures: np.ndarray) -> float:
    """Return how far the angles that score are outside their ends at most [deg]."""
    return float(outside(recording, postures).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "lost", [("RKNE",), ("LELB",), ("RANK",), ("RASI", "LASI"), ("RKNE", "RTHI")]
)
def test_gaps_are_scored_rightly_and_were_not_before(walked, lost, monkeypatch):
    recording, whole = taken(walked, lost), taken(walked, ())
    assert seen(recording)[LOST].all()
    assert worst(recording, whole.postures) < 5
    assert any(
        "lost markers are estimated from the others" in each for each in recording.assumptions
    )
    monkeypatch.setattr("ergoqp.mocap.markers.fit.completed", lambda *given: None)
    alone = taken(walked, lost)
    assert not seen(alone)[LOST].any()


@pytest.mark.slow
def test_what_is_not_told_stays_lost(walked):
    recording, whole = taken(walked, ("LWRA", "LWRB")), taken(walked, ())
    assert not seen(recording)[LOST].all()
    assert worst(recording, whole.postures) < 5
