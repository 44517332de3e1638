"""Joint centres that tremble are smoothed, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.made_motions import BODY, Places, fitted, posture, read_angles, stoop, walk
from ergoqp.joints import INDEX
from ergoqp.mocap import fit_postures
from ergoqp.mocap.fitting.jitter import smoothed, tremble_of
from ergoqp.mocap.naming import centres_of


def trembling(places: Places, size: float, seed: int = 5) -> Places:
    generator = np.random.default_rng(seed)
    return {c: path + size * generator.standard_normal(path.shape) for c, path in places.items()}


@pytest.mark.parametrize("size", [0.0, 0.001, 0.003])
def test_what_does_not_tremble_is_left_as_it_is(size: float) -> None:
    places, time = walk()
    shaken = trembling(places, size)
    found, said = smoothed(shaken, time)
    assert not said
    for centre, path in shaken.items():
        np.testing.assert_array_equal(found[centre], path)


@pytest.mark.parametrize("size", [0.004, 0.01, 0.03])
def test_how_much_a_point_trembles_does_not_hang_on_what_it_does(size: float) -> None:
    for places, time in (walk(), stoop()):
        path = trembling(places, size)["right_wrist"]
        assert tremble_of(path, time) == pytest.approx(size, rel=0.15)
        # At uneven times, too.
        kept = np.sort(np.random.default_rng(1).choice(len(time), len(time) // 2, replace=False))
        assert tremble_of(path[kept], time[kept]) == pytest.approx(size, rel=0.35)


@pytest.mark.parametrize("size", [0.01, 0.02])
def test_smoothing_brings_centres_nearer_to_what_they_did(size: float) -> None:
    for places, time in (walk(), stoop()):
        shaken = trembling(places, size)
        found, said = smoothed(shaken, time)
        for centre, path in places.items():
            off = [np.sqrt(((each[centre] - path) ** 2).mean()) for each in (found, shaken)]
            assert off[0] < 0.6 * off[1]
        assert len(said) == 1
        assert f"{len(places)} of {len(places)} joint centres jitter" in said[0]
        told = int(said[0].split(", by ")[1].split(" mm")[0])
        assert told == pytest.approx(1000 * size, rel=0.2)


def test_angles_are_nearer_too() -> None:
    places = {c: np.concatenate([walk()[0][c], stoop()[0][c]]) for c in walk()[0]}
    truth, found = read_angles(fitted(places).postures), fitted(trembling(places, 0.01))
    assert "joint centres jitter" in " ".join(found.assumptions)
    for name, right in truth.items():
        off = np.abs(read_angles(found.postures)[name] - right)[found.scored]
        # 10 mm of each end of a forearm are 3 degrees each.
        assert np.sqrt((off**2).mean()) < 2.5


def test_leaps_and_gaps_are_not_smoothed_over() -> None:
    time = np.arange(400) / 60
    path = np.zeros((400, 3))
    path[200:] = [1.0, 0.0, 0.0]
    shaken = path + 0.01 * np.random.default_rng(2).standard_normal(path.shape)
    leap = smoothed({"neck": shaken}, time)[0]["neck"]
    np.testing.assert_allclose(leap[195:205], path[195:205], atol=0.02)
    shaken[180:200] = np.nan
    gap = smoothed({"neck": shaken}, time)[0]["neck"]
    assert np.isnan(gap[180:200]).all()
    seen = np.r_[170:180, 200:210]
    np.testing.assert_allclose(gap[seen], path[seen], atol=0.02)


def test_what_happened_in_a_long_gap_bends_nothing_around_it() -> None:
    time = np.arange(600) / 60
    path = np.zeros((600, 3))
    path[200:300, 0] = np.linspace(0, 1, 100)
    path[300:, 0] = 1.0
    shaken = path + 0.03 * np.random.default_rng(2).standard_normal(path.shape)
    shaken[200:300] = np.nan
    kept = smoothed({"neck": shaken}, time)[0]["neck"]
    alone = smoothed({"neck": shaken[:200]}, time[:200])[0]["neck"]
    np.testing.assert_allclose(kept[:200], alone, atol=0.006)


def test_few_frames_tell_no_trembling() -> None:
    generator = np.random.default_rng(0)
    assert tremble_of(generator.standard_normal((49, 3)), np.arange(49) / 60) == 0
    assert tremble_of(generator.standard_normal((50, 3)), np.arange(50) / 60) > 0.5


def hammering(rate: float, stands: float = 0.0) -> tuple[Places, np.ndarray]:
    """Somebody who stands for some seconds and hammers for four, 2.5 blows a second."""
    time = np.arange(int((stands + 4.0) * rate)) / rate
    swing = np.where(time >= stands, 1.0, 0.0)
    postures = posture(len(time), trunk_flexion=10.0, arms_elbow_flexion=40.0)
    for joint, middle, far, late in (("elbow", 60, 35, 0.0), ("shoulder", 40, 25, 1.0)):
        angle = middle + swing * far * np.sin(2 * np.pi * 2.5 * time + late)
        postures[:, INDEX[f"right_{joint}_flexion"]] = np.radians(angle)
    return centres_of(BODY, np.tile([0, 0, 0.9, 0.0], (len(time), 1)), postures), postures


def worst(places: Places, truth: np.ndarray, rate: float) -> float:
    """Return how far the angles are off [deg]."""
    positions = np.stack(list(places.values()), axis=1)
    found = fit_postures(list(places), positions, rate, neutral="vertical")
    assert found.scored.mean() > 0.97
    read, right = read_angles(found.postures), read_angles(truth)
    return max(float(np.abs(read[each] - right[each])[found.scored].max()) for each in right)


@pytest.mark.parametrize("stands", [0.0, 4.0])
@pytest.mark.parametrize("rate", [10.0, 15.0, 30.0, 60.0, 200.0])
def test_who_hammers_does_not_tremble(rate: float, stands: float) -> None:
    places, truth = hammering(rate, stands)
    assert worst(places, truth, rate) < 0.1


@pytest.mark.parametrize("size", [0.0, 0.01])
def test_frames_that_are_written_four_times_are_one_moment(size: float) -> None:
    places, truth = hammering(120.0)
    once = np.arange(len(truth)) // 4 * 4
    shaken = {centre: path[once] for centre, path in trembling(places, size).items()}
    assert worst(shaken, truth[once], 120.0) < (0.1 if not size else 14.0)


def test_a_hand_that_trembles_and_hammers_is_not_smoothed_away() -> None:
    places, truth = hammering(60.0, 30.0)
    places["right_wrist"] = trembling({"it": places["right_wrist"]}, 0.015)["it"]
    # 15 mm are 3.4 degrees of a forearm, and 12 in the worst of a thousand.
    assert worst(places, truth, 60.0) < 11


def test_who_hammers_before_a_slow_camera_is_smoothed_as_its_other_points_are() -> None:
    places, truth = hammering(15.0)
    shaken = trembling(places, 0.005)
    assert worst(shaken, truth, 15.0) < 8
    found, _ = smoothed(shaken, np.arange(len(truth)) / 15)
    off = np.linalg.norm(found["right_wrist"] - places["right_wrist"], axis=1)
    assert off.max() < 0.02


def test_nobody_who_moves() -> None:
    still = {"neck": np.zeros((100, 3)), "left_hip": np.ones((100, 3))}
    assert smoothed(still, np.arange(100) / 60) == (still, [])
