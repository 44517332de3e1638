import numpy as np
import pytest
from scipy.stats import spearmanr

from ergoqp.costs.load import cross_validate, quality_of, spearman
from ergoqp.datasets.data import DataSet
from ergoqp.errors import InputError


def test_measures_of_a_small_case():
    found = quality_of(np.array([1.0, 2.4, 5.0, 3.6]), np.array([1, 2, 3, 3]))
    assert found.mae == pytest.approx((0 + 0.4 + 2.0 + 0.6) / 4)
    assert (found.exact, found.within1, found.worst) == (0.5, 0.75, 2.0)


def test_rank_correlation_is_that_of_scipy():
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, 9, 300), rng.normal(size=300).round(1)
    assert spearman(first, second) == pytest.approx(spearmanr(first, second).statistic, abs=1e-12)
    assert spearman(np.ones(5), np.arange(5)) == 0.0


class Mean:
    """Predicts the mean label of what it was fitted to."""

    def __init__(self, data):
        self.seen = {tuple(row) for row in data.points}
        self.mean = data.labels.mean()

    def predict(self, points):
        assert not any(tuple(row) in self.seen for row in points)
        return np.full(len(points), self.mean)


def test_no_point_is_predicted_by_a_model_that_has_seen_it():
    rng = np.random.default_rng(1)
    data = DataSet(
        rng.normal(size=(53, 2)), rng.integers(1, 5, 53), ("trunk_flexion", "trunk_twist")
    )
    shares = []
    values, found = cross_validate(Mean, data, 4, progress=shares.append)
    assert len(found) == 4
    assert (values != 0).all()
    assert shares == [0.25, 0.5, 0.75, 1.0]
    for folds in (1, 54):
        with pytest.raises(InputError, match="folds"):
            cross_validate(Mean, data, folds)
