"""Reduced sets: exact where nothing is lost, better with more centres, their error true and
kept."""

import numpy as np
import pytest
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR

from ergoqp.costs.from_sklearn import from_sklearn
from ergoqp.costs.load import load_cost
from ergoqp.costs.svr import Svr, reduced
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError
from ergoqp.learning.kernels import Columns, Kernel, KernelSum


def smooth_cost(n=300, distinct=None, seed=0):
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(distinct or n, 3))[np.arange(n) % (distinct or n)]
    model = KernelSum(
        Kernel("rbf", 0.2),
        centres,
        rng.normal(size=n),
        4.0,
        np.array([0.1, 0.2, 0.3]),
        np.array([1.0, 2.0, 3.0]),
    )
    data = DataSet(rng.normal(size=(900, 3)) * 2, np.zeros(900), ("a", "b", "c"))
    return Svr(Columns((0, 1, 2)), model, ("a", "b", "c"), 1.0), data


@pytest.mark.parametrize("method", ["clusters", "largest"])
def test_the_stated_error_is_the_error(method, tmp_path):
    full, data = smooth_cost()
    small, difference = reduced(full, 60, data, method=method)
    error = small.predict(data.points) - full.predict(data.points)
    assert len(small.model) == 60
    np.testing.assert_allclose(difference.rms, np.sqrt(np.mean(error**2)), rtol=1e-9)
    np.testing.assert_allclose(difference.largest, np.abs(error).max(), rtol=1e-9)
    assert (difference.method, difference.centres, difference.of, difference.points) == (
        method,
        60,
        300,
        900,
    )
    assert f"60 of 300 kernels ({method}): {difference.rms:.3g} points rms" in str(difference)
    small.save(tmp_path / "small.npz")
    loaded = load_cost(tmp_path / "small.npz")
    assert loaded.reduction == small.reduction == difference
    np.testing.assert_array_equal(loaded.predict(data.points), small.predict(data.points))
    assert full.reduction is None


def test_unseen_points_agree_as_well():
    full, data = smooth_cost()
    small, difference = reduced(full, 100, data)
    unseen = smooth_cost(seed=5)[1].points
    error = small.predict(unseen) - full.predict(unseen)
    assert np.sqrt(np.mean(error**2)) < 2 * difference.rms
    assert difference.rms < 0.02 * full.predict(data.points).std()


@pytest.mark.parametrize("method", ["clusters", "largest"])
def test_more_centres_are_better(method):
    full, data = smooth_cost()
    errors = [reduced(full, count, data, method=method)[1].rms for count in (5, 15, 45)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2] > 0


def test_repeated_centres_cost_nothing():
    full, data = smooth_cost(n=300, distinct=20)
    _, difference = reduced(full, 20, data)
    assert difference.largest < 1e-4 * full.predict(data.points).std()


def test_same_seed_same_groups():
    full, data = smooth_cost()
    one, two, three = (reduced(full, 40, data, seed)[0].model.centres for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert (one != three).any()


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["rbf", "poly"])
def test_an_estimator_of_scikit_learn_can_be_reduced(kernel, tmp_path):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(400, 3))
    estimator = make_pipeline(
        StandardScaler(), SVR(kernel=kernel, C=10, coef0=1, epsilon=0.01)
    ).fit(points, np.sin(points).sum(axis=1))
    data = DataSet(points, np.zeros(400), ("a", "b", "c"))
    small, difference = reduced(from_sklearn(estimator, data.coordinates), 60, data)
    error = small.predict(points) - estimator.predict(points)
    np.testing.assert_allclose(difference.rms, np.sqrt(np.mean(error**2)), rtol=1e-6)
    assert difference.rms < 0.05
    small.save(tmp_path / "small.npz")
    assert load_cost(tmp_path / "small.npz").reduction == difference


def test_what_does_not_do_is_named():
    full, data = smooth_cost()
    with pytest.raises(
        ModelError, match="got 300 centres, allowed at least 1 and fewer than the 300"
    ):
        reduced(full, 300, data)
    with pytest.raises(ModelError, match="got 0 centres"):
        reduced(full, 0, data)
    with pytest.raises(ModelError, match="got 50 points, allowed at least 60"):
        reduced(full, 60, data.part(np.arange(50)))
    with pytest.raises(ModelError, match="got the method 'best', allowed clusters, largest"):
        reduced(full, 60, data, method="best")
    network = MLPRegressor(hidden_layer_sizes=(3,), solver="lbfgs", max_iter=2000, tol=1e-2).fit(
        data.points, data.points[:, 0]
    )
    with pytest.raises(
        ModelError, match="got a SklearnCost, allowed a cost that is a sum of kernels"
    ):
        reduced(from_sklearn(network, data.coordinates), 2, data)
    with pytest.raises(ModelError, match="got a DataSet, allowed a cost that is a sum of kernels"):
        reduced(data, 60, data)
