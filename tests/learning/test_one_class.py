"""The one-class boundary: scikit-learn's own zero set, a margin without underflow, its bound from
below, its file."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp.coordinates import FOREARM, REPORT_JOINTS
from ergoqp.errors import ErgoqpError, ModelError
from ergoqp.learning.model_file import save_model
from ergoqp.learning.one_class import OneClass, load_one_class

svm = pytest.importorskip("sklearn.svm")
preprocessing = pytest.importorskip("sklearn.preprocessing")
pipeline = pytest.importorskip("sklearn.pipeline")

NAMES = tuple("abcdefghijklmnopqrst")


def cloud(rng, n=200, d=6):
    """Two bent clusters with very different column scales."""
    points = rng.normal(size=(n, d))
    points[: n // 2, 0] += 4
    points[:, 1] += points[:, 0] ** 2
    return points * np.geomspace(0.1, 30, d) + 5


def read(model, point):
    value, slope = model.margin_and_slope(point)
    return float(value), np.asarray(slope).ravel()


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    d=st.integers(1, 20),
    nu=st.floats(0.02, 0.7),
    narrow=st.floats(0.1, 2),
    scaler=st.sampled_from(
        ["StandardScaler", "MinMaxScaler", "MaxAbsScaler", "RobustScaler", None]
    ),
)
def test_equals_the_decision_function_of_scikit_learn(seed, d, nu, narrow, scaler):
    rng = np.random.default_rng(seed)
    points = cloud(rng, 80, d) if d > 1 else rng.normal(size=(80, 1))
    steps = [getattr(preprocessing, scaler)()] if scaler else []
    scaled = steps[0].fit_transform(points) if steps else points
    gamma = narrow / (d * scaled.var())
    estimator = pipeline.make_pipeline(*steps, svm.OneClassSVM(nu=nu, gamma=gamma)).fit(points)
    model = OneClass.from_estimator(estimator, NAMES[:d])
    near = np.vstack([points, points[:20] + 0.5 * points.std(axis=0) * rng.normal(size=(20, d))])
    expected = estimator.decision_function(near)
    np.testing.assert_allclose(model.decision(near), expected, rtol=0, atol=1e-10)
    margin = model.margin(near)
    np.testing.assert_allclose(
        np.exp(model.log_rho) * np.expm1(margin), expected, rtol=0, atol=1e-9
    )
    clear = np.abs(expected) > 1e-9
    np.testing.assert_array_equal((margin >= 0)[clear], (estimator.predict(near) == 1)[clear])
    np.testing.assert_allclose(
        [read(model, point)[0] for point in near], margin, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("away", [0.0, 1.0, 30.0, 1e3, 1e6])
def test_margin_and_slope_are_true_however_far_away(away):
    rng = np.random.default_rng(3)
    model = OneClass.fit(cloud(rng), FOREARM)
    for _ in range(20):
        direction = rng.normal(size=6)
        point = model.mean + model.scale * (
            rng.normal(size=6) + away * direction / np.linalg.norm(direction)
        )
        value, slope = read(model, point)
        assert abs(value - model.margin(point)[0]) <= 1e-12 * (1 + abs(value))
        assert np.isfinite(slope).all()
        # Steps that grow with the distance, so that rounding of a value that grows with its square
        # stays below them.
        h = 1e-3 * (1 + away)
        for axis in range(6):
            step = np.zeros(6)
            step[axis] = h * model.scale[axis]
            difference = (model.margin(point + step)[0] - model.margin(point - step)[0]) / (2 * h)
            assert abs(difference - slope[axis] * model.scale[axis]) <= 2e-5 * (1 + away**1.1)
    if away >= 30:
        assert value < -model.gamma * (away - 12) ** 2, "falls like the squared distance"
        assert np.linalg.norm(slope * model.scale) > model.gamma * away


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    reach=st.sampled_from([1e-3, 0.1, 1.0, 10.0]),
    away=st.sampled_from([0.3, 1.0, 5.0, 100.0]),
)
def test_the_bound_from_below_holds_for_every_displacement(seed, reach, away):
    rng = np.random.default_rng(seed)
    model = OneClass.fit(cloud(rng, 100, 4), NAMES[:4], nu=0.3, gamma=rng.uniform(0.05, 1))
    point = model.mean + model.scale * away * rng.normal(size=4)
    value, slope = read(model, point)
    displacements = reach * rng.normal(size=(50, 4)) * model.scale
    bound = (
        value
        + displacements @ slope
        - model.gamma * ((displacements / model.scale) ** 2).sum(axis=1)
    )
    slack = model.margin(point + displacements) - bound
    assert slack.min() >= -1e-9 * (1 + abs(value))
    first_order = model.margin(point + displacements) - value - displacements @ slope
    if reach <= 0.1 and away >= 5:
        assert first_order.min() < 0, "the slope alone promises too much"


def test_a_fit_keeps_the_points_inside_but_the_share_nu():
    points = cloud(np.random.default_rng(0), 2000)
    for nu in (0.02, 0.2):
        model = OneClass.fit(points, FOREARM, nu=nu)
        assert 0.1 * nu < (model.margin(points) < -1e-6).mean() <= nu
        assert (model.weights > 0).all()
        assert model.coordinates.names == FOREARM
    np.testing.assert_allclose(
        (model.mean, model.scale), (points.mean(axis=0), points.std(axis=0)), rtol=1e-12
    )
    plain = OneClass.fit(points, FOREARM, scale=False)
    assert not plain.mean.any()
    assert (plain.scale == 1).all()


def test_its_inputs_may_be_some_joints():
    model = OneClass.fit(np.random.default_rng(0).normal(size=(100, 20)), REPORT_JOINTS)
    assert len(model.coordinates.state) == 32
    assert model.margin_and_slope.size_out(1) == (20, 1)


def test_stays_a_few_operations_on_whole_matrices():
    model = OneClass.fit(np.random.default_rng(0).normal(size=(1000, 20)), NAMES, nu=0.3)
    assert len(model.weights) > 300
    assert model.margin_and_slope.n_instructions() < 40


def test_sparse_support_vectors():
    sparse = pytest.importorskip("scipy.sparse")
    points = cloud(np.random.default_rng(0), 60, 3)
    estimator = svm.OneClassSVM(nu=0.2, gamma=0.01).fit(sparse.csr_matrix(points))
    model = OneClass.from_estimator(estimator, NAMES[:3])
    np.testing.assert_allclose(
        model.decision(points), estimator.decision_function(sparse.csr_matrix(points)), atol=1e-12
    )


def test_saved_and_loaded_is_the_same(tmp_path):
    model = OneClass.fit(cloud(np.random.default_rng(1)), FOREARM, nu=0.1)
    model.save(tmp_path / "region.npz")
    loaded = load_one_class(tmp_path / "region.npz")
    points = cloud(np.random.default_rng(2), 50)
    np.testing.assert_array_equal(loaded.margin(points), model.margin(points))
    np.testing.assert_array_equal(loaded.decision(points), model.decision(points))
    assert loaded.coordinates.names == FOREARM


def test_other_files_are_named(tmp_path):
    path = tmp_path / "region.npz"
    with pytest.raises(ModelError, match=r"region\.npz: no such file"):
        load_one_class(path)
    save_model(path, {"kind": "svr"}, {})
    with pytest.raises(ModelError, match="holds a model of kind 'svr', allowed 'one_class'"):
        load_one_class(path)
    save_model(path, {"kind": "one_class", "coordinates": ["a"]}, {})
    with pytest.raises(ModelError, match="does not hold what a one-class SVM needs"):
        load_one_class(path)


@pytest.mark.parametrize(
    ("points", "settings", "sentence"),
    [
        (np.zeros((5, 2)), {}, r"shape \(5, 2\), allowed \(n, 3\)"),
        (np.zeros((1, 3)), {}, "n at least 2"),
        (np.array([[1, 2, 3], [1, np.nan, 3.0]]), {}, r"row 1 is not finite \(1 such rows\)"),
        (np.eye(3), {"nu": 1.0}, "nu: got 1.0"),
        (np.eye(3), {"nu": 0.0}, "nu: got 0.0"),
        (np.eye(3), {"gamma": -1.0}, "gamma: got -1.0"),
        (
            np.random.default_rng(0).normal(size=(300, 3)),
            {"gamma": 1e4},
            "nothing is inside with nu 0.02 and gamma 10000",
        ),
    ],
)
def test_data_that_do_not_do_are_named(points, settings, sentence):
    with pytest.raises(ModelError, match=sentence):
        OneClass.fit(points, NAMES[:3], **settings)


def test_estimators_that_do_not_do_are_named():
    points = cloud(np.random.default_rng(0), 50, 3)
    one = svm.OneClassSVM

    def made(*steps):
        return pipeline.make_pipeline(*steps).fit(points, points[:, 0])

    higher = one(gamma=0.01).fit(points)
    higher.intercept_ = -10 * np.abs(higher.intercept_)
    negative = one(gamma=0.01).fit(points)
    negative.intercept_ = np.array([0.5])
    for estimator, sentence in [
        (made(one(kernel="linear")), "got the kernel 'linear', allowed 'rbf'"),
        (made(svm.SVR()), "got a SVR, allowed a OneClassSVM"),
        (one(), "OneClassSVM that is not fitted"),
        (
            made(preprocessing.QuantileTransformer(n_quantiles=10), one()),
            "got the step QuantileTransformer",
        ),
        (made(preprocessing.MinMaxScaler(clip=True), one()), "MinMaxScaler that clips"),
        ("svm", "got a str, allowed an estimator of scikit-learn"),
        (one().fit(points[:, :2]), "got one of 2 inputs, allowed 3"),
        (higher, "nothing is inside with nu 0.5 and gamma 0.01"),
        (negative, "got rho -0.5, allowed a positive number"),
    ]:
        with pytest.raises(ErgoqpError, match=sentence):
            OneClass.from_estimator(estimator, NAMES[:3])


def test_all_support_vectors_may_be_outside():
    points = np.sort(np.random.default_rng(0).normal(size=(80, 1)), axis=0)
    estimator = svm.OneClassSVM(nu=0.5, gamma=0.2).fit(points)
    assert estimator.decision_function(estimator.support_vectors_).max() < -1e-3
    model = OneClass.from_estimator(estimator, ["a"])
    assert 0.3 < (model.margin(points) > 0).mean() < 0.7


def test_parts_that_do_not_fit_are_named():
    with pytest.raises(ModelError, match="negative weights"):
        OneClass(["a"], 1.0, [0], [1], [[0.0], [1.0]], [1, -1], 0.1)
    with pytest.raises(ModelError, match="got 1 inputs, allowed 2"):
        OneClass(["a", "b"], 1.0, [0], [1], [[0.0]], [1], 0.1)
    with pytest.raises(ModelError, match="shapes"):
        OneClass(["a"], 1.0, [0], [1], [[0.0]], [0], 0.1)
    assert ca.is_equal(
        ca.DM(OneClass(["a"], 1.0, [0], [1], [[0.0]], [1], 0.5).margin([[0.0]])), ca.DM(np.log(2))
    )
