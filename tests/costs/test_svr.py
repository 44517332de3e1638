"""Support vector regression: scikit-learn's own prediction, expression and slope the same, and
better than plain angles."""

import casadi as ca
import numpy as np
import pytest

from ergoqp import reba
from ergoqp.coordinates import REPORT_JOINTS, Coordinates
from ergoqp.costs.cost import Cost
from ergoqp.costs.load import load_cost
from ergoqp.costs.svr import Svr
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import ModelError
from ergoqp.learning.kernels import Columns, Steps

svm = pytest.importorskip("sklearn.svm")


def sheet_data(per_score, seed=0):
    """Postures of the EPFL report's 20 joints, the others zero, by the sheet."""
    names = Coordinates(REPORT_JOINTS)
    points = names.read(balanced_postures(per_score, np.random.default_rng(seed))[0])
    return DataSet(points, reba.assess(names.spread(points)).final, REPORT_JOINTS)


@pytest.fixture(scope="module")
def data():
    return sheet_data(50)


@pytest.fixture(scope="module", params=["steps", "plain"])
def cost(request, data):
    return Svr.fit(data, features=request.param)


@pytest.mark.slow
def test_predicts_what_scikit_learn_predicts(cost, data):
    points = sheet_data(10, 1).points
    estimator = svm.SVR(C=3.0, epsilon=0.3, gamma=3.0)

    def scaled(rows):
        return (cost.features.values(rows) - cost.model.mean) / cost.model.scale

    expected = estimator.fit(scaled(data.points), data.labels).predict(scaled(points))
    np.testing.assert_allclose(cost.predict(points), expected, rtol=0, atol=1e-10)
    postures = cost.coordinates.spread(points)
    np.testing.assert_allclose(cost(postures), expected, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        [float(cost.function(posture)) for posture in postures], expected, rtol=0, atol=1e-10
    )


def test_the_slope_is_the_gradient(cost):
    q = ca.MX.sym("q", 32)
    value = cost.expression(q)
    differentiated = ca.Function("g", [q], [value, ca.gradient(value, q)])
    for posture in cost.coordinates.spread(sheet_data(2, 2).points):
        (value, slope), (expected, gradient) = (
            cost.value_and_gradient(posture),
            differentiated(posture),
        )
        assert float(value) == float(expected)
        np.testing.assert_allclose(slope.full(), gradient.full(), rtol=0, atol=1e-11)


def test_several_places_at_once(cost):
    x = ca.MX.sym("x", 20, 3)
    points = sheet_data(1, 3).points[:3]
    values = ca.Function("v", [x], [cost.values(x)])(points.T).full().ravel()
    np.testing.assert_allclose(values, cost.predict(points), rtol=0, atol=1e-10)


def test_saved_and_loaded_is_the_same(cost, tmp_path):
    cost.save(tmp_path / "svr.npz")
    loaded = load_cost(tmp_path / "svr.npz")
    assert isinstance(loaded, Svr)
    postures = cost.coordinates.spread(sheet_data(3, 4).points)
    np.testing.assert_array_equal(loaded(postures), cost(postures))
    assert (loaded.minimum, loaded.coordinates.names) == (1.0, REPORT_JOINTS)


def test_is_a_cost_of_postures(cost):
    assert isinstance(cost, Cost)
    assert (cost.name, cost.minimum) == ("svr", 1.0)
    assert cost.function.n_instructions() < 60, "matrices stay matrices"
    assert np.isnan(cost(np.full((1, 32), np.nan))[0])


@pytest.mark.slow
def test_steps_are_chosen_for_the_sheet_and_predict_it_better(data):
    unseen = sheet_data(50, 5)
    automatic = Svr.fit(data)
    assert isinstance(automatic.features, Steps)
    error, plain, constant = (
        np.abs(values - unseen.labels).mean()
        for values in (
            automatic.predict(unseen.points),
            Svr.fit(data, features="plain").predict(unseen.points),
            5.5,
        )
    )
    assert error < 0.85 * plain
    assert plain < 0.55 * constant


def test_steps_are_flat_far_outside(cost):
    far = np.array([[1.0], [1.5]]) * np.full(20, 100.0)
    one, two = cost.predict(far)
    assert one == two
    assert 0 < one < 12


def test_plain_features_are_chosen_for_a_smooth_label():
    rng = np.random.default_rng(0)
    points = rng.uniform(-2, 2, (400, 2))
    labels = np.sin(2 * points[:, 0]) + points[:, 1]
    cost = Svr.fit(DataSet(points, labels, ("a", "b")), epsilon=0.02)
    assert isinstance(cost.features, Columns)
    grid = rng.uniform(-1.8, 1.8, (100, 2))
    assert np.abs(cost.predict(grid) - np.sin(2 * grid[:, 0]) - grid[:, 1]).mean() < 0.03


def test_columns_that_never_change_or_matter_are_left_out():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, (200, 2)), np.full(200, 3.0)])
    cost = Svr.fit(DataSet(points, np.sin(points[:, 0]), ("a", "b", "c")), epsilon=0.01)
    assert cost.features == Columns((0,))
    assert cost.value_and_gradient(points[0])[1].full().ravel()[1:].tolist() == [0, 0]


def test_a_most_of_support_vectors(tmp_path):
    data = sheet_data(15)
    cost = Svr.fit(data, max_vectors=100)
    assert len(cost.model) == 100
    assert cost.reduction is not None
    cost.save(tmp_path / "svr.npz")
    assert load_cost(tmp_path / "svr.npz").reduction == cost.reduction
    assert Svr.fit(data, max_vectors=10_000).reduction is None


@pytest.mark.parametrize(
    ("points", "labels", "settings", "sentence"),
    [
        (np.eye(3), np.arange(3), {}, "svr: got 3 points, allowed at least 20"),
        (np.ones((30, 3)), np.ones(30), {}, "got the label 1 everywhere"),
        (np.ones((30, 3)), np.arange(30), {}, "the same point everywhere"),
        (
            np.random.default_rng(0).normal(size=(30, 3)),
            np.arange(30),
            {"features": "steps"},
            "no input has a step",
        ),
        (
            np.random.default_rng(0).normal(size=(30, 3)),
            np.arange(30),
            {"features": "bands"},
            "allowed auto, steps, plain",
        ),
        (
            np.random.default_rng(0).normal(size=(30, 3)),
            np.arange(30),
            {"epsilon": 1e3},
            "use a smaller epsilon",
        ),
        (np.eye(30)[:, :3], np.arange(30), {"C": 0.0}, "C: got 0.0"),
        (np.eye(30)[:, :3], np.arange(30), {"gamma": np.inf}, "gamma: got inf"),
        (np.eye(30)[:, :3], np.arange(30), {"epsilon": -1.0}, "epsilon: got -1.0"),
        (np.eye(30)[:, :3], np.arange(30), {"max_vectors": 0}, "max_vectors: got 0"),
    ],
)
def test_what_does_not_do_is_named(points, labels, settings, sentence):
    with pytest.raises(ModelError, match=sentence):
        Svr.fit(DataSet(points, labels, ("a", "b", "c")), **settings)


def test_features_and_kernels_must_fit(cost):
    with pytest.raises(ModelError, match="svr: got 1 features, allowed"):
        Svr(Columns((0,)), cost.model, REPORT_JOINTS, 1.0)


def test_it_tells_how_far_it_is():
    told = []
    Svr.fit(sheet_data(8), features="plain", progress=told.append)
    assert len(told) > 5
    assert told == sorted(told)
    assert 0 < told[0] < 0.5
    assert told[-1] == 1.0
