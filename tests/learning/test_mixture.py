"""Regression in a mixture: against dense textbook formulas, against sampling, against differences,
in every split."""

import casadi as ca
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ergoqp.errors import ModelError
from ergoqp.learning.mixtures import MixtureRegression


def mixture(columns=5, count=4, seed=0):
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(count, columns, columns))
    weights = rng.dirichlet(np.ones(count))
    return MixtureRegression(
        weights,
        1.5 * rng.normal(size=(count, columns)),
        roots @ roots.swapaxes(1, 2) + 0.2 * np.eye(columns),
    )


def conditional_by_the_book(m, inputs, outputs, x):
    """Return mean and covariance of the outputs at one x: densities by scipy, conditionals by plain
    inverses."""
    densities, means, covariances = [], [], []
    for weight, mean, covariance in zip(m.weights, m.means, m.covariances, strict=True):
        s_ii, s_io = covariance[np.ix_(inputs, inputs)], covariance[np.ix_(inputs, outputs)]
        s_oo = covariance[np.ix_(outputs, outputs)]
        densities.append(weight * multivariate_normal(mean[inputs], s_ii).pdf(x))
        means.append(mean[outputs] + s_io.T @ np.linalg.inv(s_ii) @ (x - mean[inputs]))
        covariances.append(s_oo - s_io.T @ np.linalg.inv(s_ii) @ s_io)
    h = np.array(densities) / np.sum(densities)
    mean = sum(a * b for a, b in zip(h, means, strict=True))
    second = sum(a * (c + np.outer(b, b)) for a, b, c in zip(h, means, covariances, strict=True))
    return np.sum(densities), mean, second - np.outer(mean, mean)


SPLITS = [([0, 1, 2, 3], [4]), ([4], [0, 1, 2, 3]), ([3, 0], [2, 1]), ([1], [4])]


@pytest.mark.parametrize(("inputs", "outputs"), SPLITS)
def test_equals_the_textbook(inputs, outputs):
    m = mixture()
    regression = m.split(inputs, outputs)
    points = np.random.default_rng(1).normal(size=(20, len(inputs))) * 2
    mean, covariance, log_density = (
        regression.mean(points),
        regression.covariance(points),
        regression.log_density(points),
    )
    assert mean.shape == (20, len(outputs))
    for i, x in enumerate(points):
        density, expected, spread = conditional_by_the_book(m, inputs, outputs, x)
        np.testing.assert_allclose(mean[i], expected, rtol=0, atol=1e-10)
        np.testing.assert_allclose(covariance[i], spread, rtol=0, atol=1e-9)
        np.testing.assert_allclose(log_density[i], np.log(density), rtol=0, atol=1e-10)


@pytest.mark.slow
def test_the_covariance_is_that_of_samples():
    """The output's own covariance enters eq. 2.6, not the cross term that the report prints:
    samples decide."""
    m, x = mixture(3, 2, seed=4), 0.4
    rng = np.random.default_rng(0)
    chosen = rng.choice(2, 4_000_000, p=m.weights)
    roots = np.linalg.cholesky(m.covariances)
    samples = m.means[chosen] + np.einsum(
        "nij,nj->ni", roots[chosen], rng.normal(size=(len(chosen), 3))
    )
    near = samples[np.abs(samples[:, 0] - x) < 0.01][:, 1:]
    assert len(near) > 5000
    regression = m.split([0], [1, 2])
    np.testing.assert_allclose(near.mean(axis=0), regression.mean([[x]])[0], atol=0.08)
    np.testing.assert_allclose(np.cov(near.T), regression.covariance([[x]])[0], rtol=0.08, atol=0.1)


@pytest.mark.parametrize("tempered", [False, True])
@pytest.mark.parametrize(("inputs", "outputs"), SPLITS)
def test_derivative_equals_differences(inputs, outputs, tempered):
    regression = mixture().split(inputs, outputs)
    if tempered:
        regression = regression.tempered((0.5, 1.0, 6.0), (0.2, 0.5, 0.3))
    points = np.random.default_rng(2).normal(size=(15, len(inputs)))
    h = 1e-5 * np.eye(len(inputs))
    differences = np.stack(
        [(regression.mean(points + d) - regression.mean(points - d)) / 2e-5 for d in h], axis=2
    )
    np.testing.assert_allclose(regression.derivative(points), differences, rtol=1e-6, atol=1e-7)
    local, switching = regression.terms(points)
    np.testing.assert_allclose(local + switching, differences, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("tempered", [False, True])
@pytest.mark.parametrize(("inputs", "outputs"), SPLITS)
def test_expressions_equal_numbers_and_differentiation(inputs, outputs, tempered):
    regression = mixture().split(inputs, outputs)
    if tempered:
        regression = regression.tempered((1.0, 8.0), (0.7, 0.3))
    x = ca.MX.sym("x", len(inputs))
    found = regression.expression(x)
    function = ca.Function("f", [x], [*found, ca.jacobian(found.mean, x)])
    for point in np.random.default_rng(3).normal(size=(20, len(inputs))):
        mean, covariance, derivative, by_casadi = (np.asarray(out) for out in function(point))
        np.testing.assert_allclose(mean.ravel(), regression.mean(point)[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(covariance, regression.covariance(point)[0], rtol=0, atol=1e-11)
        np.testing.assert_allclose(derivative, regression.derivative(point)[0], rtol=0, atol=1e-11)
        np.testing.assert_allclose(derivative, by_casadi, rtol=0, atol=1e-10)


def test_responsibilities_share_and_temper():
    regression = mixture().split([0, 1], [2])
    points = np.random.default_rng(0).normal(size=(50, 2)) * 3
    densities = np.exp(regression.log_densities(points))
    np.testing.assert_allclose(
        regression.responsibilities(points),
        densities / densities.sum(axis=1, keepdims=True),
        atol=1e-12,
    )
    roots = np.sqrt(densities)
    soft = regression.tempered((2.0,), (1.0,)).responsibilities(points)
    np.testing.assert_allclose(soft, roots / roots.sum(axis=1, keepdims=True), atol=1e-12)


def test_finite_in_many_dimensions_and_far_away():
    """Densities of 40 dimensions at a distance of thousands of deviations underflow; their
    logarithms do not."""
    regression = mixture(41, 6).split(range(40), [40])
    points = (
        np.random.default_rng(0).normal(size=(30, 40)) * np.geomspace(0.1, 1e5, 30)[:, np.newaxis]
    )
    for values in (
        regression.mean(points),
        regression.covariance(points),
        regression.derivative(points),
    ):
        assert np.isfinite(values).all()
    x = ca.MX.sym("x", 40)
    function = ca.Function("f", [x], list(regression.expression(x)))
    for point, expected in zip(points, regression.mean(points), strict=True):
        mean, covariance, derivative = (np.asarray(out) for out in function(point))
        assert np.isfinite(covariance).all()
        assert np.isfinite(derivative).all()
        np.testing.assert_allclose(mean[0], expected, rtol=1e-10)


def test_an_output_may_have_no_variance():
    m = mixture(3, 3)
    covariances = m.covariances.copy()
    covariances[:, 2], covariances[:, :, 2] = 0, 0
    regression = MixtureRegression(m.weights, m.means, covariances).split([0, 1], [2])
    points = np.random.default_rng(0).normal(size=(10, 2))
    np.testing.assert_allclose(
        regression.mean(points)[:, 0],
        regression.responsibilities(points) @ m.means[:, 2],
        atol=1e-12,
    )
    with pytest.raises(ModelError, match="no variance in some direction of the inputs"):
        MixtureRegression(m.weights, m.means, covariances).split([2], [0])


@pytest.mark.parametrize(
    ("inputs", "outputs"),
    [([], [1]), ([0], []), ([0, 1], [1]), ([0, 0], [1]), ([0], [5]), ([-1], [0])],
)
def test_bad_splits_are_named(inputs, outputs):
    with pytest.raises(
        ModelError, match=r"split: got inputs .*, allowed columns 0 to 4, each once"
    ):
        mixture().split(inputs, outputs)


def test_bad_mixtures_are_named():
    m = mixture()
    with pytest.raises(ModelError, match=r"weights: got .* adding up to"):
        MixtureRegression(m.weights * 2, m.means, m.covariances)
    with pytest.raises(ModelError, match=r"mixture: got means \(4, 4\)"):
        MixtureRegression(m.weights, m.means[:, 1:], m.covariances)
    with pytest.raises(ModelError, match="not finite"):
        MixtureRegression(m.weights, m.means * np.nan, m.covariances)
    with pytest.raises(ModelError, match=r"points: got shape \(3, 3\), allowed \(n, 2\)"):
        m.split([0, 1], [2]).mean(np.zeros((3, 3)))
    with pytest.raises(ModelError, match="temperatures: got"):
        m.split([0], [1]).tempered((0.0,), (1.0,))
    with pytest.raises(ModelError, match="shares: got"):
        m.split([0], [1]).tempered((1.0, 2.0), (0.5, 0.6))
