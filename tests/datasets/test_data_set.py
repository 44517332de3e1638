"""Data that a model cannot be fitted to are refused in one sentence."""

import numpy as np
import pytest

from ergoqp.costs.neural import Neural
from ergoqp.costs.quadratic import Quadratic
from ergoqp.datasets.data import DataSet
from ergoqp.errors import InputError, ModelError

NAMES = ("trunk_flexion", "neck_flexion")


def points(count=20):
    return np.random.default_rng(0).uniform(size=(count, 2))


def test_lists_become_arrays_of_numbers():
    data = DataSet([[0, 1], [2, 3]], [1, 2], list(NAMES))
    assert data.points.dtype == data.labels.dtype == float
    assert data.coordinates == NAMES
    assert len(data) == 2


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_rows_that_are_not_finite_are_counted(bad):
    wrong = points()
    wrong[3, 1] = wrong[7, 0] = bad
    with pytest.raises(ModelError, match=r"row 3 is not finite \(2 such rows\)"):
        DataSet(wrong, np.ones(20), NAMES)
    labels = np.ones(20)
    labels[5] = bad
    with pytest.raises(ModelError, match=r"row 5 is not finite \(1 such rows\)"):
        DataSet(points(), labels, NAMES)


def test_wrong_shapes_are_named():
    with pytest.raises(
        ModelError, match=r"points of shape \(20, 2\), allowed \(n, 1\): trunk_flexion"
    ):
        DataSet(points(), np.ones(20), NAMES[:1])
    with pytest.raises(ModelError, match=r"points of shape \(2,\)"):
        DataSet(points()[0], np.ones(1), NAMES)
    with pytest.raises(ModelError, match=r"labels of shape \(19,\), allowed \(20,\)"):
        DataSet(points(), np.ones(19), NAMES)
    with pytest.raises(ModelError, match=r"labels of shape \(20, 1\)"):
        DataSet(points(), np.ones((20, 1)), NAMES)


def test_wrong_columns_are_named():
    with pytest.raises(InputError, match="'elbow_x' among joints"):
        DataSet(points(), np.ones(20), ("trunk_flexion", "elbow_x"))
    with pytest.raises(InputError, match="each once"):
        DataSet(points(), np.ones(20), ("trunk_flexion", "trunk_flexion"))


def test_split_has_every_row_once():
    data = DataSet(points(50), np.arange(50), NAMES, "counted")
    first, second = data.split(0.7, seed=3)
    assert (len(first), len(second)) == (35, 15)
    assert sorted([*first.labels, *second.labels]) == list(range(50))
    np.testing.assert_array_equal(data.points[first.labels.astype(int)], first.points)
    assert first.source == "counted"
    np.testing.assert_array_equal(data.split(0.7, seed=3)[0].labels, first.labels)
    assert (data.split(0.7, seed=4)[0].labels != first.labels).any()


@pytest.mark.parametrize("kind", [Quadratic, Neural])
def test_fits_refuse_constant_labels_and_too_few_points(kind):
    with pytest.raises(
        ModelError, match=f"{kind.name}: got the label 3 everywhere, allowed at least two"
    ):
        kind.fit(DataSet(points(2000), np.full(2000, 3), NAMES))
    with pytest.raises(ModelError, match=rf"{kind.name}: got 5 points, allowed at least \d+"):
        kind.fit(DataSet(points(5), np.arange(5), NAMES))
