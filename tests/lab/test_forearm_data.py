"""The forearm's data set: the elitist choice, empty points, the cache, and the report's
nearest-sample rule."""

import numpy as np
import pytest

from ergoqp.coordinates import FOREARM
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import InputError, MissingExtraError
from ergoqp.human import Body
from ergoqp.human.forearm import forearm_length, forearm_points
from ergoqp.lab.forearm import forearm_data, nearest_sample_cost, true_cost
from ergoqp.lab.forearm_models import EMPTY_DISTANCE


def distances(first, second):
    return np.sqrt(((first[:, None] - second[None]) ** 2).sum(axis=2))


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "ergoqp" / "forearm"


def test_points_of_postures_with_their_scores():
    data = forearm_data(100, seed=1)
    assert data.coordinates == FOREARM
    postures, scores = balanced_postures(100, np.random.default_rng(1))
    apart = distances(data.points, forearm_points(postures))
    np.testing.assert_allclose(apart.min(axis=1), 0, atol=1e-7)
    np.testing.assert_array_equal(data.labels, scores[apart.argmin(axis=1)])
    assert (true_cost(data.points[:60]) <= data.labels[:60]).all()


def test_only_the_lowest_score_of_a_cluster_is_kept():
    everything, few, one = (forearm_data(60, clusters=clusters) for clusters in (600, 40, 1))
    assert len(one) == 60
    np.testing.assert_array_equal(one.labels, 1)
    assert len(one) < len(few) < len(everything) <= 600
    assert few.labels.mean() < everything.labels.mean()
    assert np.bincount(few.labels.astype(int), minlength=11)[1] == 60, (
        "all postures of score 1 are the lowest somewhere"
    )


def test_usual_size_has_all_scores():
    data = forearm_data()
    counts = np.bincount(data.labels.astype(int), minlength=11)
    assert 2000 <= len(data) <= 5000
    assert (counts[1:] >= 100).all()


def test_empty_points_are_far_from_all_postures():
    data, plain = forearm_data(80, empty=150), forearm_data(80)
    assert len(data) == len(plain) + 150
    points = forearm_points(balanced_postures(80, np.random.default_rng(0))[0])
    apart = distances(data.points, points).min(axis=1)
    empty = apart > 1e-7
    assert empty.sum() == 150
    assert apart[empty].min() > EMPTY_DISTANCE
    np.testing.assert_allclose(data.labels[empty], 10 + 10 * (apart[empty] - EMPTY_DISTANCE))
    lengths = np.linalg.norm(data.points[:, 3:] - data.points[:, :3], axis=1)
    np.testing.assert_allclose(lengths, forearm_length(), rtol=0, atol=1e-12)


def test_seed_body_and_cache_tell_data_apart(own_cache):
    first = forearm_data(20)
    files = list(own_cache.iterdir())
    assert len(files) == 1
    np.testing.assert_array_equal(forearm_data(20).points, first.points)
    np.testing.assert_array_equal(forearm_data(20, cache=False).points, first.points)
    assert list(own_cache.iterdir()) == files
    for other in (
        forearm_data(20, seed=1),
        forearm_data(20, body=Body.of_stature(1.6)),
        forearm_data(20, clusters=30),
    ):
        assert other.points.shape != first.points.shape or (other.points != first.points).any()


def test_progress_reaches_the_end():
    for _ in range(2):  # made, then read
        shares = []
        forearm_data(20, progress=shares.append)
        assert shares == sorted(shares)
        assert shares[-1] == 1


@pytest.mark.parametrize(
    "options",
    [{"per_score": 0}, {"clusters": 0}, {"per_score": 10, "clusters": 101}, {"empty": -1}],
)
def test_impossible_numbers_are_refused(options):
    with pytest.raises(InputError, match=r"got .*, allowed a whole number from"):
        forearm_data(**options)


def test_clustering_needs_the_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "sklearn.cluster", None)
    with pytest.raises(MissingExtraError, match=r"\[learn\]'`"):
        forearm_data(10, cache=False)


def test_nearest_sample():
    data = forearm_data(60)
    rng = np.random.default_rng(0)
    points = data.points[rng.integers(len(data), size=700)] + rng.normal(scale=0.05, size=(700, 6))
    expected = data.labels[distances(points, data.points).argmin(axis=1)]
    np.testing.assert_array_equal(nearest_sample_cost(points, data), expected)
    np.testing.assert_array_equal(nearest_sample_cost(data.points[:5], data), data.labels[:5])
    assert len(nearest_sample_cost(np.empty((0, 6)), data)) == 0
