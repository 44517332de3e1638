"""The EPFL report's descents: what they follow, where they stop, what they keep."""

import casadi as ca
import numpy as np
import pytest

from ergoqp.lab.forearm_models import added, descend, keep_length, slope_of, toward_class_below

LENGTH = 0.25


def bowl(goal, factor=1.0):
    """|x - goal|^2 times a factor, from an expression."""
    x = ca.MX.sym("x", 6)
    value = factor * ca.sumsqr(x - ca.DM(np.asarray(goal, dtype=float)))
    return slope_of(ca.Function("bowl", [x], [value, ca.gradient(value, x)]))


def pairs(count, seed=0):
    rng = np.random.default_rng(seed)
    elbow, way = rng.uniform(-0.4, 0.4, (count, 3)), rng.normal(size=(count, 3))
    return np.hstack([elbow, elbow + LENGTH * way / np.linalg.norm(way, axis=1, keepdims=True)])


def lengths(points):
    return np.linalg.norm(points[..., 3:] - points[..., :3], axis=-1)


def test_slope_of_many_points():
    points, goal = pairs(4), np.arange(6)
    value, gradient = bowl(goal)(points)
    np.testing.assert_allclose(value, ((points - goal) ** 2).sum(axis=1))
    np.testing.assert_allclose(gradient, 2 * (points - goal))


def test_plain_descent_goes_to_the_minimum_and_tears_the_forearm_apart():
    goal = [0, 0, 0, 0, 0, 1.0]
    descent = descend(bowl(goal), pairs(5), stop_at=None, rate=0.05, longest=0.05)
    np.testing.assert_allclose(descent.ends, np.tile(goal, (5, 1)), atol=1e-3)
    assert descent.path.shape == (501, 5, 6)
    assert (np.diff(descent.values, axis=0) <= 1e-15).all()
    np.testing.assert_allclose(lengths(descent.ends), 1.0, atol=1e-3)


def test_length_is_maintained_at_every_step():
    descent = descend(
        bowl([0, 0, 0, 0, 0, 1.0]), pairs(5), stop_at=None, length=LENGTH, rate=0.05, longest=0.05
    )
    np.testing.assert_allclose(lengths(descent.path), LENGTH, rtol=0, atol=1e-14)
    # The nearest pair to the goal shares what is missing among both ends.
    best = np.array([0, 0, (1 - LENGTH) / 2, 0, 0, (1 + LENGTH) / 2])
    np.testing.assert_allclose(descent.ends, np.tile(best, (5, 1)), atol=1e-3)


def test_projection_is_orthogonal():
    points = pairs(50) + np.random.default_rng(1).normal(scale=0.05, size=(50, 6))
    kept = keep_length(points, LENGTH)
    np.testing.assert_allclose(lengths(kept), LENGTH, rtol=0, atol=1e-14)
    moved = np.linalg.norm(kept - points, axis=1)
    np.testing.assert_allclose(moved, np.abs(lengths(points) - LENGTH) / np.sqrt(2), atol=1e-14)
    np.testing.assert_allclose(keep_length(kept, LENGTH), kept, atol=1e-15)


def test_stops_by_hand_and_for_good():
    starts = pairs(20)
    descent = descend(bowl(np.zeros(6), 10), starts, stop_at=1.0, steps=300)
    before = descent.values[:-1]
    for n in range(20):
        first = int(np.argmax(descent.values[:, n] <= 1))
        assert descent.values[first, n] <= 1
        assert (before[:first, n] > 1).all()
        np.testing.assert_array_equal(
            descent.path[first:, n], np.tile(descent.path[first, n], (301 - first, 1))
        )
    assert descent.values[0].max() > 1


def test_steps_are_never_longer_than_allowed():
    descent = descend(bowl(np.zeros(6), 1e4), pairs(5), stop_at=None, steps=20, longest=0.003)
    assert np.linalg.norm(np.diff(descent.path, axis=0), axis=2).max() <= 0.003 + 1e-15


def test_added_gradient_pulls_inside():
    cost, inside = bowl(np.zeros(6)), np.full(6, 0.3)
    margin = bowl(inside, -1)
    points = pairs(3)
    value, gradient = added(cost, margin, 0.5)(points)
    np.testing.assert_allclose(value, cost(points)[0])
    np.testing.assert_allclose(gradient, 2 * points + 0.5 * 2 * (points - inside))
    ends = descend(added(cost, margin, 0.5), points, stop_at=None, rate=0.05, longest=0.05).ends
    np.testing.assert_allclose(ends, np.tile(inside / 3, (3, 1)), atol=1e-3)


@pytest.mark.parametrize(
    ("place", "score", "goal"),
    [(0.45, 5, 0.2), (0.2, 2, 0.0), (0.0, 1, 0.0), (0.9, 5, 0.2), (0.09, 1, 0.0)],
)
def test_ladder_leads_to_the_class_below(place, score, goal):
    centres = [0.0, 0.2, 0.4]

    def ball(centre):
        def margin(points):
            return 0.1**2 * 6 - ((points - centre) ** 2).sum(axis=1), -2 * (points - centre)

        return margin

    slope = toward_class_below([ball(centre) for centre in centres], [1, 2, 5])
    points = np.full((1, 6), place)
    value, gradient = slope(points)
    assert value[0] == score
    np.testing.assert_allclose(gradient, 2 * (points - goal))
