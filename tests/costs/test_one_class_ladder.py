"""The ladder: counts the rungs below, leads down them, and its value is what its expression
says."""

import numpy as np
import pytest

from ergoqp.costs.load import load_cost, quality_of, spearman
from ergoqp.costs.one_class_ladder import OneClassLadder
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError

NAMES = ("x", "y", "z")
RADII = (0.0, 1.0, 2.0, 3.0)


@pytest.fixture(scope="module")
def data():
    """Shells around the origin: the score is the number of the shell."""
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(4, 250, 3))
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    points = ways * (np.array(RADII)[:, None, None] + rng.uniform(0, 0.8, (4, 250, 1)))
    return DataSet(points.reshape(-1, 3), np.repeat([1, 2, 3, 5], 250), NAMES)


@pytest.fixture(scope="module")
def ladder(data):
    return OneClassLadder.fit(data, gamma=0.5)


def test_it_counts_the_rungs_below(ladder, data):
    values = ladder.predict(data.points)
    assert quality_of(values, data.labels).mae < 0.6
    assert spearman(values, data.labels) > 0.9
    assert (values >= ladder.minimum).all()


def test_bending_changes_how_fast_it_falls_and_not_where_to(ladder, data):
    fitted = {"reach": ladder.reach, "offset": ladder.offset, "height": ladder.height}
    straight = OneClassLadder(
        ladder.rungs, ladder.scores, NAMES, 1.0, ladder.steepness, ladder.pull, **fitted
    )
    assert ladder.curve > 0
    order = np.argsort(straight.predict(data.points))
    assert (np.diff(ladder.predict(data.points)[order]) >= -1e-9).all()
    for point in data.points[::150]:
        bent, plain = (
            np.array(cost.value_and_gradient(point)[1]).ravel() for cost in (ladder, straight)
        )
        assert bent @ plain == pytest.approx(np.linalg.norm(bent) * np.linalg.norm(plain), rel=1e-9)


def test_wide_classes_of_high_scores_are_calibrated():
    rng = np.random.default_rng(0)
    spread = np.repeat([0.3, 0.6, 1.2, 2.4, 4.8], 200)
    shells = DataSet(
        rng.normal(size=(1000, 3)) * spread[:, None] + 3 * spread[:, None],
        np.repeat(np.arange(1, 6), 200),
        NAMES,
    )
    bent = OneClassLadder.fit(shells)
    fitted = {"reach": bent.reach, "curve": 0.0}
    counted = OneClassLadder(bent.rungs, bent.scores, NAMES, 1.0, offset=0.0, **fitted).predict(
        shells.points
    )
    line = np.polyval(np.polyfit(counted, shells.labels, 1), counted)
    assert np.mean((bent.predict(shells.points) - shells.labels) ** 2) < 0.7 * np.mean(
        (line - shells.labels) ** 2
    )


def test_expression_and_numbers_are_one(ladder):
    points = np.random.default_rng(1).normal(size=(60, 3)) * [1.0, 2.0, 8.0]
    written = np.array([float(ladder.function(point)) for point in points])
    assert written == pytest.approx(ladder.predict(points), abs=1e-10)


def test_the_slope_is_that_of_differences_and_never_vanishes_outside_the_lowest_class(ladder, data):
    for point in [*data.points[::97], np.array([9.0, -4.0, 30.0])]:
        slope = np.array(ladder.value_and_gradient(point)[1]).ravel()
        steps = 1e-6 * np.eye(3)
        differences = (ladder.predict(point + steps) - ladder.predict(point - steps)) / 2e-6
        assert slope == pytest.approx(differences, rel=1e-5, abs=1e-5)
        if np.linalg.norm(point) > 1.0:
            assert np.linalg.norm(slope) > 1e-3


def test_descent_goes_down_the_rungs_to_the_lowest(ladder, data):
    points = data.points[data.labels == 5][:20].copy()
    function = ladder.value_and_gradient.map(len(points))
    for _ in range(2000):
        gradient = np.asarray(function(points.T)[1]).T
        points -= 0.02 * gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 0.5)
    assert (ladder.rungs[0].margin(points) > 0).all()


def test_a_saved_ladder_is_the_same(ladder, tmp_path):
    ladder.save(tmp_path / "ladder.npz")
    again = load_cost(tmp_path / "ladder.npz")
    points = np.random.default_rng(2).normal(size=(20, 3))
    assert again.predict(points) == pytest.approx(ladder.predict(points), abs=1e-12)
    assert again.minimum == ladder.minimum


def test_bad_data_are_refused(data):
    few = DataSet(data.points[:260], data.labels[:260], NAMES).part(np.r_[0:30, 250:255])
    for wrong, said in (
        (few, "with at least 5 points each"),
        (DataSet(data.points, np.ones(1000), NAMES), "the label 1 everywhere"),
        (DataSet(data.points, np.arange(1000) // 20, NAMES), "got 50 labels"),
        (data.part(np.arange(12)), "got 12 points, allowed at least 20"),
    ):
        with pytest.raises(ModelError, match=said):
            OneClassLadder.fit(wrong)
    with pytest.raises(ModelError, match=r"got curve -1\.0"):
        OneClassLadder(OneClassLadder.fit(data).rungs, [1, 2, 3, 5], NAMES, 1.0, curve=-1.0)
    with pytest.raises(ModelError, match="steepness"):
        OneClassLadder.fit(data, steepness=0.0)
