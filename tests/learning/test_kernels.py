"""Sums of kernels: scikit-learn's kernels, the same in numpy and as an expression, the slope by
hand, and bad parts named."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp.errors import ModelError
from ergoqp.learning.kernels import PRODUCT, RADIAL, Kernel, KernelSum

pairwise = pytest.importorskip("sklearn.metrics.pairwise")
gaussian = pytest.importorskip("sklearn.gaussian_process.kernels")

THEIRS = {
    "rbf": lambda k: lambda a, b: pairwise.rbf_kernel(a, b, gamma=k.gamma),
    "matern32": lambda k: gaussian.Matern(k.gamma**-0.5, nu=1.5),
    "matern52": lambda k: gaussian.Matern(k.gamma**-0.5, nu=2.5),
    "rational": lambda k: gaussian.RationalQuadratic((2 * k.gamma) ** -0.5, alpha=k.alpha),
    "linear": lambda k: pairwise.linear_kernel,
    "poly": lambda k: (
        lambda a, b: pairwise.polynomial_kernel(
            a, b, degree=k.degree, gamma=k.gamma, coef0=k.offset
        )
    ),
    "sigmoid": lambda k: lambda a, b: pairwise.sigmoid_kernel(a, b, gamma=k.gamma, coef0=k.offset),
}


def random_sum(kind, seed=0, n=40, d=5, gamma=0.2, shift=0.0):
    rng = np.random.default_rng(seed)
    kernel = Kernel(kind, gamma, offset=0.7, degree=3, alpha=1.3)
    centres, weights = rng.normal(size=(n, d)) + shift, rng.normal(size=n)
    return KernelSum(
        kernel, centres, weights, rng.normal(), rng.normal(size=d), rng.uniform(0.3, 3, d)
    ), rng


def functions(model):
    x = ca.MX.sym("x", len(model.scale))
    return ca.Function(
        "f",
        [x],
        [model.expression(x), *model.value_and_slope(x), ca.gradient(model.expression(x), x)],
    )


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from(RADIAL + PRODUCT),
    seed=st.integers(0, 10**6),
    gamma=st.floats(1e-3, 3.0),
    n=st.integers(1, 60),
    d=st.integers(1, 20),
)
def test_equals_the_kernels_of_scikit_learn(kind, seed, gamma, n, d):
    model, rng = random_sum(kind, seed, n, d, gamma)
    scaled = np.vstack([rng.normal(size=(10, d)) * 2, model.centres[:2]])
    points = scaled * model.scale + model.mean
    expected = THEIRS[kind](model.kernel)(scaled, model.centres) @ model.weights + model.bias
    size = THEIRS[kind](model.kernel)(scaled, model.centres) @ np.abs(model.weights) + 1
    np.testing.assert_array_less(np.abs(model.values(points) - expected), 1e-11 * np.abs(size))
    function = functions(model)
    for point, value, span in zip(points, expected, size, strict=True):
        by_itself, value_too, slope, differentiated = (
            out.full().ravel() for out in function(point)
        )
        assert abs(by_itself[0] - value) < 1e-11 * abs(span)
        assert by_itself[0] == value_too[0]
        np.testing.assert_allclose(
            slope, differentiated, rtol=0, atol=1e-9 * (np.abs(differentiated).max() + abs(span))
        )


@pytest.mark.parametrize("kind", RADIAL)
def test_precise_where_the_data_are_far_from_zero(kind):
    model, rng = random_sum(kind, shift=1e4)
    scaled = model.centres[:10] + 0.1 * rng.normal(size=(10, 5))
    distances = ((scaled[:, np.newaxis] - model.centres) ** 2).sum(
        axis=2
    )  # as differences, without cancellation
    expected = model.kernel.profile(distances, np)[0] @ model.weights + model.bias
    points = scaled * model.scale + model.mean
    np.testing.assert_allclose(model.values(points), expected, rtol=0, atol=1e-9)
    found = [functions(model)(point)[0].full().item() for point in points]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_far_away_only_the_bias_is_left():
    model, _ = random_sum("rbf")
    far = np.full(5, 1e6)
    assert model.values(far)[0] == model.bias
    value, _, slope, _ = (out.full().ravel() for out in functions(model)(far))
    assert value[0] == model.bias
    assert not slope.any()


def test_stays_a_few_operations_on_whole_matrices():
    model, _ = random_sum("rbf", n=2000, d=20)
    x = ca.MX.sym("x", 20)
    assert ca.Function("f", [x], list(model.value_and_slope(x))).n_instructions() < 40


@pytest.mark.parametrize("kind", RADIAL + PRODUCT)
def test_several_points_at_once(kind):
    model, rng = random_sum(kind)
    x = ca.MX.sym("x", 5, 3)
    together = ca.Function("f", [x], [model.expression(x)])
    points = rng.normal(size=(3, 5))
    np.testing.assert_allclose(together(points.T).full().ravel(), model.values(points), rtol=1e-12)
    assert together.n_instructions() < 100


def test_features_times_weights_are_the_values():
    model, rng = random_sum("matern52")
    points = rng.normal(size=(7, 5))
    np.testing.assert_allclose(
        model.features(points) @ model.weights + model.bias, model.values(points), rtol=1e-13
    )
    assert model.values(np.empty((0, 5))).shape == (0,)


@pytest.mark.parametrize("kind", RADIAL + PRODUCT)
def test_parts_make_the_same_sum(kind):
    model, rng = random_sum(kind)
    points = rng.normal(size=(5, 5))
    np.testing.assert_array_equal(
        KernelSum.from_parts(*model.parts()).values(points), model.values(points)
    )


def test_what_does_not_fit_is_named():
    with pytest.raises(ModelError, match="kernel: got 'laplacian', allowed rbf"):
        Kernel("laplacian")
    with pytest.raises(ModelError, match=r"kernel: got gamma -1.0"):
        Kernel("rbf", -1.0)
    with pytest.raises(ModelError, match="finite numbers"):
        Kernel("poly", np.inf)
    good = {
        "centres": np.ones((3, 2)),
        "weights": np.ones(3),
        "bias": 0.0,
        "mean": np.zeros(2),
        "scale": np.ones(2),
    }
    for name, bad, sentence in [
        ("centres", np.ones((3, 4)), "shapes"),
        ("centres", np.ones((0, 2)), "shapes"),
        ("weights", np.ones(2), "shapes"),
        ("weights", np.array([1, np.nan, 1]), "not finite"),
        ("scale", np.array([1.0, 0.0]), "not positive"),
        ("bias", np.nan, "not finite"),
    ]:
        with pytest.raises(ModelError, match=sentence):
            KernelSum(Kernel("rbf"), **{**good, name: bad})
    model = KernelSum(Kernel("rbf"), **good)
    with pytest.raises(ModelError, match=r"shape \(3, 1\), allowed \(2, k\)"):
        model.expression(ca.MX.sym("x", 3))
    with pytest.raises(ModelError, match=r"shape \(2, 3\), allowed \(2, 1\)"):
        model.value_and_slope(ca.MX.sym("x", 2, 3))
