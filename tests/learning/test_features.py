"""Features: steps are found where they are, made soft, flat far away; relevances are the slope of
the evidence, and true."""

import casadi as ca
import numpy as np
import pytest

from ergoqp.errors import ModelError
from ergoqp.learning.kernels import Columns, Steps, features_from
from ergoqp.learning.pipelines import _cost, relevance

pytest.importorskip("sklearn")

WIDTHS, SHARES = (0.05, 0.4), (0.8, 0.2)


def stepped(n=2000, seed=0):
    """Labels that jump at 0.3 in column 0 and at -0.5 and 0.5 in column 2; column 1 does not
    matter."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (n, 3))
    labels = (
        1 + 2.0 * (points[:, 0] > 0.3) + (np.abs(points[:, 2]) > 0.5) + 0.3 * rng.normal(size=n)
    )
    return points, labels


def test_steps_are_found_and_nothing_else():
    steps = Steps.fit(*stepped(), WIDTHS, SHARES)
    assert steps.column.tolist() == [0, 2, 2]
    np.testing.assert_allclose(steps.place, [0.3, -0.5, 0.5], atol=0.01)
    np.testing.assert_allclose(steps.height, [2, -1, 1], atol=0.05)
    assert steps.used == [0, 2]
    assert (
        len(Steps.fit(stepped()[0], np.random.default_rng(1).normal(size=2000), WIDTHS, SHARES))
        == 0
    )


@pytest.mark.parametrize(
    "features", [Steps.fit(*stepped(), WIDTHS, SHARES), Columns((2, 0)), Columns((0, 1, 2))]
)
def test_numbers_and_expression_are_the_same(features):
    x = ca.MX.sym("x", 3)
    function = ca.Function("f", [x], [features.expression(x)])
    points = 3 * np.random.default_rng(1).normal(size=(50, 3))
    found = np.array([function(point).full().ravel() for point in points])
    assert found.shape == (50, len(features))
    np.testing.assert_allclose(found, features.values(points), rtol=0, atol=1e-13)
    settings, arrays = features.parts()
    np.testing.assert_array_equal(
        features_from(settings, arrays).values(points), features.values(points)
    )
    np.testing.assert_allclose(
        features.part([1]).values(points), features.values(points)[:, [1]], rtol=0, atol=1e-14
    )


def test_soft_steps_reach_the_levels_and_are_flat_outside():
    steps = Steps.fit(*stepped(), (0.05,), (1.0,))
    low, high = steps.values(np.array([[-0.5, 0, 0], [0.8, 0, 0.9]]))
    np.testing.assert_allclose(high - low, [2, 1], atol=0.05)
    beyond = steps.values(np.array([[50, 0, 50.0], [60, 0, 60.0]]))
    np.testing.assert_array_equal(beyond[0], beyond[1])
    half = steps.values(np.array([[steps.place[0], 0, 0]]))[0, 0]
    assert abs(half - steps.height[0] / 2) < 1e-12


def test_relevance_tells_which_columns_matter():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(300, 4))
    labels = np.sin(2 * points[:, 0]) + 0.3 * points[:, 2] + 0.05 * rng.normal(size=300)
    factors, slopes, cost = relevance(points, labels, rounds=60)
    assert factors[0] > 10 * factors[2] > 100 * max(factors[[1, 3]])
    assert slopes[0] > 3 * slopes[2] > 30 * max(slopes[[1, 3]])
    assert cost < relevance(points, rng.permutation(labels))[2] - 0.5
    np.testing.assert_array_equal(relevance(points, labels, rounds=60)[0], factors)


def test_slope_of_the_evidence():
    rng = np.random.default_rng(0)
    points, labels = rng.normal(size=(40, 3)), rng.normal(size=40)
    logs = rng.normal(size=5) - 0.5
    value, gradient = _cost(logs, points, labels)
    for i, step in enumerate(1e-5 * np.eye(5)):
        difference = (
            _cost(logs + step, points, labels)[0] - _cost(logs - step, points, labels)[0]
        ) / 2e-5
        assert abs(difference - gradient[i]) < 1e-7
    scaled = points * np.exp(logs[:3] / 2)
    distances = ((scaled[:, np.newaxis] - scaled) ** 2).sum(axis=2)
    covariance = np.exp(logs[3] - distances) + np.exp(logs[4]) * np.eye(40)
    likelihood = (
        0.5 * labels @ np.linalg.solve(covariance, labels) + 0.5 * np.linalg.slogdet(covariance)[1]
    )
    np.testing.assert_allclose(40 * value, likelihood, rtol=1e-10)


@pytest.mark.parametrize(
    ("widths", "shares"),
    [((), ()), ((0.1,), (0.5,)), ((0.1, 0.2), (1.0,)), ((0.0,), (1.0,)), ((0.1, 0.2), (1.5, -0.5))],
)
def test_widths_that_do_not_do_are_named(widths, shares):
    with pytest.raises(ModelError, match=r"steps: got widths .*allowed positive widths"):
        Steps.fit(*stepped(100), widths, shares)
