"""Gaussian mixture regression of scores: both variants, their prediction, descent, files and
errors."""

import sys

import casadi as ca
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from sklearn.mixture import GaussianMixture

from ergoqp.coordinates import REPORT_JOINTS, Coordinates
from ergoqp.costs.cost import Cost
from ergoqp.costs.gmr import Gmr, bic_curve
from ergoqp.costs.load import load_cost
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import MissingExtraError, ModelError
from ergoqp.sheets import reba

JOINTS20 = Coordinates(REPORT_JOINTS)


def postures(per_score, seed):
    """Return balanced data of the report's 20 joints, the others at zero, labelled by the sheet."""
    drawn, _ = balanced_postures(4 * per_score, np.random.default_rng(seed))
    points = JOINTS20.read(drawn)
    scores = reba.assess(JOINTS20.spread(points)).final
    rows = np.concatenate([np.flatnonzero(scores == score)[:per_score] for score in range(1, 11)])
    assert np.bincount(scores[rows]).tolist() == [0] + [per_score] * 10
    return DataSet(points[rows], scores[rows].astype(float), REPORT_JOINTS)


@pytest.fixture(scope="module")
def data():
    return postures(300, 0)


@pytest.fixture(scope="module")
def unseen():
    return postures(200, 1)


@pytest.fixture(scope="module")
def costs(data):
    return {"per_score": Gmr.fit(data), "joint": Gmr.fit(data, variant="joint", components=8)}


def predicted_by_the_book(cost, point):
    """Return E[score | point] with dense normal densities and plain inverses."""
    logs, means = [], []
    for weight, mean, covariance in zip(
        cost.mixture.weights, cost.mixture.means, cost.mixture.covariances, strict=True
    ):
        inputs, cross = covariance[:-1, :-1], covariance[-1, :-1]
        logs.append(np.log(weight) + multivariate_normal(mean[:-1], inputs).logpdf(point))
        means.append(mean[-1] + cross @ np.linalg.inv(inputs) @ (point - mean[:-1]))
    value = 0.0
    for temperature, share in zip(
        cost.regression.temperatures, cost.regression.shares, strict=True
    ):
        h = np.exp((np.array(logs) - max(logs)) / temperature)
        value += share * (h @ np.array(means)) / h.sum()
    return value


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["per_score", "joint"])
def test_prediction_equals_dense_normal_densities(costs, unseen, variant):
    cost = costs[variant]
    expected = [predicted_by_the_book(cost, point) for point in unseen.points[::40]]
    np.testing.assert_allclose(cost.predict(unseen.points[::40]), expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("variant", ["per_score", "joint"])
def test_expression_equals_prediction(costs, unseen, variant):
    cost = costs[variant]
    assert isinstance(cost, Cost)
    states = JOINTS20.spread(unseen.points[::20])
    found = [float(cost.function(state)) for state in states]
    np.testing.assert_allclose(found, cost(states), rtol=0, atol=1e-10)
    x = ca.MX.sym("x", 20)
    function = ca.Function(
        "f", [x], [cost.slope(x), ca.gradient(cost.value(x), x), cost.prediction(x).covariance]
    )
    for point in unseen.points[::50]:
        slope, by_casadi, variance = (np.asarray(out) for out in function(point))
        np.testing.assert_allclose(slope, by_casadi, rtol=0, atol=1e-10)
        h = 1e-5 * np.eye(20)
        differences = (cost.predict(point + h) - cost.predict(point - h)) / 2e-5
        np.testing.assert_allclose(
            slope.ravel(), differences, rtol=0, atol=1e-6 * (1 + np.abs(differences).max())
        )
        np.testing.assert_allclose(variance[0, 0], cost.variance(point)[0], rtol=0, atol=1e-10)


def test_predicts_unseen_postures(costs, unseen):
    """Far fewer points than the published figures are from, so the bounds are loose; the constant's
    error is 2.5."""
    errors = {
        name: np.abs(cost.predict(unseen.points) - unseen.labels).mean()
        for name, cost in costs.items()
    }
    assert errors["per_score"] < 0.95
    assert errors["joint"] < 1.25
    assert errors["per_score"] < errors["joint"]


@pytest.mark.slow
def test_the_mixture_per_score_can_be_descended(costs, unseen):
    """What the joint mixture cannot do: its gradient leads down to the lowest scores."""
    ends = {}
    for name, cost in costs.items():
        x = unseen.points[unseen.labels >= 5][:60]
        box = unseen.points.min(axis=0), unseen.points.max(axis=0)
        for _ in range(800):
            x = np.clip(x - 0.02 * cost.regression.derivative(x)[:, 0], *box)
        ends[name] = reba.assess(JOINTS20.spread(x)).final.mean()
    assert ends["per_score"] < 1.8
    assert ends["joint"] > 3.0


def test_never_below_its_minimum(costs):
    cost = costs["per_score"]
    far = (
        np.random.default_rng(0).normal(size=(2000, 20))
        * np.geomspace(0.01, 100, 2000)[:, np.newaxis]
    )
    values = cost.predict(far)
    assert (values >= cost.minimum - 1e-12).all()
    assert np.isfinite(values).all()


def test_unbiased_on_its_data(costs, data):
    """The line through the predictions: slope 1, offset 0."""
    slope, offset = np.polyfit(costs["per_score"].predict(data.points), data.labels, 1)
    np.testing.assert_allclose([slope, offset], [1, 0], atol=1e-9)


def test_same_seed_same_model(data):
    one, other, third = (
        Gmr.fit(data, components=20, seed=seed).predict(data.points[:50]) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, other)
    assert (one != third).any()


@pytest.mark.parametrize("variant", ["per_score", "joint"])
def test_a_file_keeps_everything(costs, unseen, variant, tmp_path):
    cost = costs[variant]
    cost.save(tmp_path / "gmr.npz")
    again = load_cost(tmp_path / "gmr.npz")
    assert isinstance(again, Gmr)
    assert (again.variant, again.minimum, again.coordinates.names) == (
        variant,
        cost.minimum,
        REPORT_JOINTS,
    )
    np.testing.assert_array_equal(again.predict(unseen.points), cost.predict(unseen.points))


@pytest.mark.parametrize("kind", ["full", "tied", "diag", "spherical"])
def test_takes_any_fitted_mixture(kind):
    rng = np.random.default_rng(0)
    x = rng.uniform(-2, 2, (400, 2))
    columns = np.column_stack([x, x[:, 0] ** 2 + 0.1 * rng.normal(size=400)])
    estimator = GaussianMixture(4, covariance_type=kind, random_state=0).fit(columns)
    cost = Gmr.from_estimator(estimator, ("trunk_flexion", "neck_flexion"))
    assert cost.minimum == estimator.means_[:, 2].min()
    grid = np.linspace(-2, 6, 4001)
    for point in x[:5]:
        # E[score | x] from the estimator's own density along the score.
        rows = np.column_stack([np.tile(point, (len(grid), 1)), grid])
        density = np.exp(estimator.score_samples(rows))
        np.testing.assert_allclose(
            cost.predict(point)[0], (grid * density).sum() / density.sum(), atol=2e-3
        )


def test_bic_finds_the_number_of_clusters():
    rng = np.random.default_rng(0)
    centres = np.array([[0.0, 0.0], [2.0, 5.0], [-2.0, 9.0]])
    columns = np.concatenate([centre + 0.1 * rng.normal(size=(80, 2)) for centre in centres])
    shares = []
    curve = bic_curve(
        DataSet(columns[:, :1], columns[:, 1], ("x",)), range(1, 7), progress=shares.append
    )
    assert np.argmin(curve) == 2
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


def test_full_covariances_per_score(data, unseen):
    cost = Gmr.fit(data, components=10, covariance="full")
    assert np.abs(cost.mixture.covariances[:, 0, 1]).max() > 0
    assert np.abs(cost.predict(unseen.points) - unseen.labels).mean() < 1.2


def test_a_score_with_one_posture_is_fitted():
    rng = np.random.default_rng(0)
    data = DataSet(
        np.r_[rng.normal(0, 0.1, 50), 3.0][:, np.newaxis],
        np.r_[np.ones(25), np.full(25, 2.0), 9.0],
        ("x",),
    )
    assert (
        Gmr.fit(data, components=3, temperatures=(1.0,), shares=(1.0,)).predict(np.array([[3.0]]))[
            0
        ]
        > 8
    )


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (
            {"n": 100},
            {"components": 60},
            "gmr with 60 Gaussians: got 100 points, allowed at least 240",
        ),
        (
            {"n": 100},
            {"components": 24, "variant": "joint"},
            "gmr with 24 Gaussians: got 100 points, allowed at least 528",
        ),
        ({"same": True}, {}, "got the label 3 everywhere, allowed at least two different labels"),
        ({}, {"variant": "best"}, "variant: got 'best', allowed per_score, joint"),
        ({}, {"covariance": "round"}, "covariance: got 'round', allowed full, diag"),
        ({}, {"components": 0}, "components: got 0, allowed a whole number"),
        ({}, {"components": 2.5}, "components: got 2.5, allowed a whole number"),
        ({}, {"regularisation": -1.0}, "regularisation: got -1.0, allowed 1e-12 to 1e"),
        ({}, {"temperatures": (1.0, -2.0)}, "temperatures: got -2.0, allowed 0.001 to 1e"),
        (
            {"any": True},
            {},
            "got 3000 different labels, allowed at most 40 .*variant 'joint' takes any",
        ),
    ],
)
def test_bad_data_and_options_are_named(data, change, options, message):
    given = data.part(np.arange(change.get("n", len(data))))
    if change.get("same"):
        given = DataSet(given.points, np.full(len(given), 3.0), REPORT_JOINTS)
    if change.get("any"):
        given = DataSet(given.points, np.linspace(0, 1, len(given)), REPORT_JOINTS)
    with pytest.raises(ModelError, match=message):
        Gmr.fit(given, **options)


def test_a_missing_package_is_named(data, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.mixture", None)
    with pytest.raises(
        MissingExtraError,
        match=r"fitting a Gaussian mixture needs the package 'sklearn'.*\[learn\]'`",
    ):
        Gmr.fit(data)


def test_bad_estimators_are_named(data):
    with pytest.raises(ModelError, match="not fitted, allowed a fitted one"):
        Gmr.from_estimator(GaussianMixture(2), REPORT_JOINTS)
    with pytest.raises(ModelError, match="a mixture of 20 columns, allowed 21: inputs and score"):
        Gmr.from_estimator(GaussianMixture(2).fit(data.points[:200]), REPORT_JOINTS)
    with pytest.raises(ModelError, match="BIC curve up to 500 Gaussians: got 3000 points"):
        bic_curve(data, range(1, 501))
