"""Joint centres that tremble are smoothed, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.made_motions import Places, fitted, read_angles, stoop, walk
from ergoqp.recordings.fitting.smoothing import smoothed, tremble_of


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
        assert f"{len(places)} of {len(places)} joint centres tremble" in said[0]
        told = int(said[0].split(", by ")[1].split(" mm")[0])
        assert told == pytest.approx(1000 * size, rel=0.2)


def test_angles_are_nearer_too() -> None:
    places = {c: np.concatenate([walk()[0][c], stoop()[0][c]]) for c in walk()[0]}
    truth, found = read_angles(fitted(places).postures), fitted(trembling(places, 0.01))
    assert "joint centres tremble" in " ".join(found.assumptions)
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
    np.testing.assert_allclose(kept[:200], alone, atol=0.003)


def test_few_frames_tell_no_trembling() -> None:
    generator = np.random.default_rng(0)
    assert tremble_of(generator.standard_normal((49, 3)), np.arange(49) / 60) == 0
    assert tremble_of(generator.standard_normal((50, 3)), np.arange(50) / 60) > 0.5
