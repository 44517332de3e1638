"""The quadratic cost: what least squares gives, convex, and the same in numbers, expression and
file."""

import casadi as ca
import numpy as np
import pytest

from ergoqp.coordinates import FOREARM
from ergoqp.costs.cost import Cost
from ergoqp.costs.load import load_cost, quality_of
from ergoqp.costs.quadratic import Quadratic
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import posture_data
from ergoqp.errors import ModelError
from ergoqp.joints import INDEX

NAMES = ("trunk_flexion", "neck_flexion", "left_elbow_flexion")


@pytest.fixture(scope="module")
def fitted():
    return Quadratic.fit(posture_data(100, cache=False))


def made(curvatures, seed=0):
    """Data of a quadratic with the curvatures given."""
    x = np.random.default_rng(seed).uniform(-1, 2, (300, 3))
    return DataSet(x, 2.0 + x @ [1.0, -2.0, 0.5] + x**2 @ curvatures, NAMES)


def test_a_convex_quadratic_is_found_exactly():
    cost = Quadratic.fit(made([3.0, 0.5, 0.0]))
    np.testing.assert_allclose(cost.constant, 2.0, atol=1e-10)
    np.testing.assert_allclose(cost.slopes, [1.0, -2.0, 0.5], atol=1e-10)
    np.testing.assert_allclose(cost.curvatures, [3.0, 0.5, 0.0], atol=1e-10)


def test_where_data_are_concave_it_is_the_best_convex_one():
    data = made([3.0, -1.0, 0.5])
    cost = Quadratic.fit(data)
    assert cost.curvatures[1] == 0
    # The condition of the bounded least-squares problem: free coefficients have no slope left, the
    # held one only inward.
    error = cost.predict(data.points) - data.labels
    columns = np.hstack([np.ones((len(data), 1)), data.points, data.points**2])
    slope = columns.T @ error / len(data)
    np.testing.assert_allclose(np.delete(slope, 5), 0, atol=1e-9)
    assert slope[5] > 1e-3


def test_a_joint_that_never_moves_counts_nothing():
    data = made([3.0, 0.5, 0.2])
    still = data.points.copy()
    still[:, 1] = 0.7
    cost = Quadratic.fit(DataSet(still, still[:, 0] ** 2, NAMES))
    np.testing.assert_allclose([cost.slopes[1], cost.curvatures[1]], 0, atol=1e-12)
    np.testing.assert_allclose(cost.predict(still), still[:, 0] ** 2, atol=1e-9)


def test_expression_gradient_and_hessian_fit_the_prediction(fitted):
    assert isinstance(fitted, Cost)
    data = posture_data(5, seed=1, cache=False)
    states = fitted.coordinates.spread(data.points)
    np.testing.assert_allclose(fitted(states), fitted.predict(data.points), rtol=1e-14)
    q = ca.MX.sym("q", 32)
    value = fitted.expression(q)
    every = ca.Function("every", [q], [value, ca.gradient(value, q), ca.hessian(value, q)[0]])
    for state, expected in zip(states, fitted.predict(data.points), strict=True):
        found, gradient, hessian = (part.full() for part in every(state))
        np.testing.assert_allclose(found, expected, atol=1e-10)
        np.testing.assert_allclose(fitted.value_and_gradient(state)[1], gradient, atol=1e-10)
        assert np.linalg.eigvalsh(hessian).min() >= 0
    assert gradient[INDEX["right_hip_flexion"]] == 0


def test_predicts_unseen_scores_better_than_a_constant(fitted):
    unseen = posture_data(200, seed=2, cache=False)
    quality = quality_of(fitted.predict(unseen.points), unseen.labels)
    assert quality.mae < 1.6 < 2.5 == quality_of(np.full(len(unseen), 5.0), unseen.labels).mae
    assert quality.spearman > 0.75


def test_the_file_holds_all_of_it(fitted, tmp_path):
    fitted.save(tmp_path / "cost.npz", {"data": "100 of each"})
    loaded = load_cost(tmp_path / "cost.npz")
    states = fitted.coordinates.spread(posture_data(5, seed=3, cache=False).points)
    np.testing.assert_array_equal(loaded(states), fitted(states))
    assert loaded.coordinates.names == fitted.coordinates.names
    assert loaded.minimum == fitted.minimum == 1


def test_points_are_a_state_too():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(100, 6))
    cost = Quadratic.fit(DataSet(x, (x**2).sum(axis=1), FOREARM))
    np.testing.assert_allclose(cost.value_and_gradient(x[0])[1].full()[:, 0], 2 * x[0], atol=1e-9)


def test_coefficients_that_do_not_fit_are_refused():
    with pytest.raises(
        ModelError,
        match=(
            r"quadratic: got slopes and curvatures of shapes \(\(2,\), \(3,\)\), allowed \(3,\)"
            r" each"
        ),
    ):
        Quadratic(1.0, np.zeros(2), np.zeros(3), NAMES, 1.0)
    with pytest.raises(ModelError, match="quadratic: got a curvature of -1, allowed 0 or more"):
        Quadratic(1.0, np.zeros(3), np.array([0.0, -1.0, 0.0]), NAMES, 1.0)
