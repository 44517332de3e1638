"""Functions through their buffers give what they give by themselves."""

import casadi as ca
import numpy as np
import pytest

from ergoqp.expressions import Evaluator, evaluated_once


@pytest.fixture
def function():
    a, b = ca.SX.sym("a", 2, 3), ca.SX.sym("b")
    return ca.Function("f", [a, b], [b * a, ca.sum2(a)], ["a", "b"], ["scaled", "sums"])


def test_the_whole_call(function):
    matrix = np.arange(6.0).reshape(2, 3)
    evaluator = Evaluator(function)
    found = evaluator({"a": matrix, "b": 2.0, "not asked for": 0.0})
    np.testing.assert_array_equal(found["scaled"], 2 * matrix)
    np.testing.assert_array_equal(found["sums"], matrix.sum(axis=1))
    evaluator({"a": 0 * matrix, "b": 2.0})
    np.testing.assert_array_equal(found["scaled"], 2 * matrix)


def test_in_place(function):
    evaluator = Evaluator(function)
    evaluator.inputs["a"][:] = range(6)
    evaluator.inputs["b"][0] = 3.0
    evaluator.evaluate()
    assert evaluator.slices == {"scaled": slice(0, 6), "sums": slice(6, 8)}
    np.testing.assert_array_equal(evaluator.results[:6], 3.0 * np.arange(6))
    np.testing.assert_array_equal(evaluator.outputs["sums"], [6.0, 9.0])
    evaluator.inputs["b"][0] = 1.0
    evaluator.evaluate()
    np.testing.assert_array_equal(evaluator.outputs["scaled"], np.arange(6))


def test_the_nonzeros_of_what_is_sparse():
    x = ca.SX.sym("x", 3)
    evaluator = Evaluator(ca.Function("f", [x], [ca.diag(x)], ["x"], ["diagonal"]))
    evaluator.inputs["x"][:] = [1.0, 2.0, 3.0]
    evaluator.evaluate()
    np.testing.assert_array_equal(evaluator.results, [1.0, 2.0, 3.0])


def test_once():
    x = ca.SX.sym("x", 2)
    rows = np.array([[1.0, 2.0], [3.0, 4.0]])
    doubled = ca.Function("f", [x], [ca.sumsqr(x)]).map(2)
    np.testing.assert_array_equal(evaluated_once(doubled, rows), [5.0, 25.0])
