"""The forearm's learned models: what a fit gives leads to cost 1, and the shipped ones are of that
kind."""

import numpy as np
import pytest

from ergoqp.coordinates import FOREARM
from ergoqp.costs.load import load_cost
from ergoqp.human.forearm import forearm_length
from ergoqp.lab.forearm import forearm_data, true_cost
from ergoqp.lab.forearm_models import KERNELS, descend, fit_forearm_models, keep_length, slope_of
from ergoqp.learning.one_class import load_one_class
from ergoqp.registry import data_folder

FILES = ("forearm_svr", "forearm_ladder", "forearm_boundary")


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    patch = pytest.MonkeyPatch()
    patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    yield fit_forearm_models(per_score=150, rows=400, seed=3)
    patch.undo()


def test_files_hold_what_was_fitted(models, tmp_path):
    models.save(tmp_path)
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(FILES)
    points = forearm_data(10, cache=False).points
    for name in ("svr", "ladder"):
        np.testing.assert_array_equal(
            load_cost(tmp_path / f"forearm_{name}.npz")(points), getattr(models, name)(points)
        )
    boundary = load_one_class(tmp_path / "forearm_boundary.npz")
    np.testing.assert_array_equal(boundary.margin(points), models.boundary.margin(points))


def test_empty_places_cost_more_only_where_they_were_seen(models):
    data = forearm_data(60, seed=5, empty=500, cache=False)
    empty = data.labels > 10
    where_nobody_is, report = models.svr(data.points), models.report_svr(data.points)
    assert where_nobody_is[empty].mean() > 9
    assert report[empty].mean() < 9
    assert where_nobody_is[~empty].mean() < 7


def test_ladder_climbs_to_the_cores_of_the_classes(models):
    data = forearm_data(60, seed=5, cache=False)
    values = models.ladder(data.points)
    assert models.ladder.minimum == 1
    assert values.min() >= 1
    assert [values[data.labels == score].mean() for score in (1, 4, 8)] == sorted(
        values[data.labels == score].mean() for score in (1, 4, 8)
    )


@pytest.mark.parametrize("name", FILES)
def test_shipped_files_are_small_and_of_the_forearm(name):
    path = data_folder("models") / f"{name}.npz"
    assert path.stat().st_size < 600_000
    model = load_one_class(path) if name.endswith("boundary") else load_cost(path)
    assert model.coordinates.names == FOREARM


@pytest.mark.slow
def test_shipped_costs_lead_unseen_points_to_true_cost_one():
    folder, length = data_folder("models"), forearm_length()
    boundary = load_one_class(folder / "forearm_boundary.npz")
    points = forearm_data(40, seed=11, cache=False).points
    points = keep_length(points[boundary.margin(points) > 0], length)[:60]
    before = true_cost(points)
    assert (before > 1).sum() > 10
    for name in ("forearm_svr", "forearm_ladder"):
        cost = load_cost(folder / f"{name}.npz")
        assert len(cost.model) == KERNELS if name == "forearm_svr" else len(cost.rungs) == 10
        ends = descend(
            slope_of(cost.value_and_gradient),
            points,
            stop_at=None,
            length=length,
            steps=150,
            longest=0.02,
        ).ends
        after = true_cost(ends)
        assert (after == 1).mean() > 0.9
        assert (after == 1).mean() > (before == 1).mean()
