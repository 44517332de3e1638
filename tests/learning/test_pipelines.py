"""What a fitted estimator says of its inputs is compared with the stated coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sklearn.compose import TransformedTargetRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.kernel_ridge import KernelRidge
from sklearn.mixture import GaussianMixture
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler, StandardScaler
from sklearn.svm import SVR, OneClassSVM

from ergoqp.costs.from_sklearn import from_sklearn
from ergoqp.costs.gmr import Gmr
from ergoqp.errors import ModelError
from ergoqp.joints import INDEX
from ergoqp.learning.one_class import OneClass

pandas = pytest.importorskip("pandas")

STATED = ["trunk_flexion", "neck_flexion", "right_elbow_flexion"]
TURNED = ["right_elbow_flexion", "trunk_flexion", "neck_flexion"]
RNG = np.random.default_rng(3)
POINTS = RNG.normal(size=(80, 3)) * [0.3, 0.1, 0.5] + [0.2, 0.1, 1.2]
"""In the order of STATED [rad]."""
LABELS = 1 + POINTS[:, 0] + 0.2 * POINTS[:, 2]


def table(names: list[str], order: list[str] = TURNED, factor: float = 1.0) -> Any:
    columns = factor * POINTS[:, [STATED.index(name) for name in order]]
    return pandas.DataFrame(columns, columns=names)


def postures() -> np.ndarray:
    states = np.zeros((len(POINTS), 32))
    states[:, [INDEX[name] for name in STATED]] = POINTS
    return states


COSTS = {
    "svr": SVR(),
    "pipeline": make_pipeline(StandardScaler(), SVR()),
    "target": TransformedTargetRegressor(make_pipeline(MinMaxScaler(), SVR()), check_inverse=False),
    "ridge": KernelRidge(kernel="rbf"),
    "process": GaussianProcessRegressor(optimizer=None, alpha=0.1),
    "network": make_pipeline(
        StandardScaler(),
        MLPRegressor(hidden_layer_sizes=(4,), solver="lbfgs", max_iter=3000, random_state=0),
    ),
}


@pytest.mark.parametrize("name", COSTS)
def test_columns_in_another_order_are_put_in_the_stated_one(name: str) -> None:
    columns = table(TURNED)
    estimator = COSTS[name].fit(columns, LABELS)
    cost = from_sklearn(estimator, STATED)
    assert cost.coordinates.names == tuple(STATED)
    np.testing.assert_allclose(cost(postures()), estimator.predict(columns), atol=1e-9)
    np.testing.assert_allclose(cost.predict(POINTS), estimator.predict(columns), atol=1e-9)


@pytest.mark.parametrize("kernel", ["linear", "poly", "sigmoid"])
def test_other_kernels_are_put_in_order_too(kernel: str) -> None:
    columns = table(TURNED)
    estimator = SVR(kernel=kernel).fit(columns, LABELS)
    cost = from_sklearn(estimator, STATED)
    np.testing.assert_allclose(cost.predict(POINTS), estimator.predict(columns), atol=1e-9)


@pytest.mark.parametrize(
    "machine",
    [OneClassSVM(nu=0.2), make_pipeline(StandardScaler(), OneClassSVM(nu=0.2))],
    ids=["alone", "pipeline"],
)
def test_a_boundary_is_read_in_the_order_of_its_columns(machine: Any) -> None:
    columns = table(["Right elbow flexion [rad]", "Trunk Flexion", "neck-flexion"])
    model = OneClass.from_estimator(machine.fit(columns), STATED)
    known = model.decision(POINTS)
    np.testing.assert_allclose(known, machine.decision_function(columns), atol=1e-9)


def test_a_mixture_is_read_in_the_order_of_its_columns() -> None:
    columns = table(TURNED).assign(score=LABELS)
    mixture = GaussianMixture(2, random_state=0).fit(columns)
    plain = GaussianMixture(2, random_state=0).fit(np.column_stack([columns]))
    for cost in (Gmr.from_estimator(mixture, STATED), from_sklearn(mixture, STATED)):
        expected = Gmr.from_estimator(plain, TURNED)(postures())
        np.testing.assert_allclose(cost.predict(POINTS), expected, atol=1e-9)
        np.testing.assert_allclose(cost(postures()), expected, atol=1e-9)


def test_names_without_a_coordinate_say_nothing() -> None:
    estimator = SVR().fit(table(["a", "b", "c"], STATED), LABELS)
    assert from_sklearn(estimator, STATED).coordinates.names == tuple(STATED)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["neck_twist", "trunk_flexion", "neck_flexion"], "neck_twist, right_elbow_flexion differ"),
        (["x", "trunk_flexion", "neck_flexion"], "right_elbow_flexion, x differ"),
        (
            ["right_elbow_flexion", "trunk_flexion_deg", "neck_flexion"],
            "trunk_flexion_deg, allowed",
        ),
        (["right elbow flexion (deg)", "trunk flexion", "neck flexion"], "columns in radians"),
        (["right elbow flexion \N{DEGREE SIGN}", "a", "b"], "columns in radians"),
    ],
)
def test_other_columns_are_refused(names: list[str], words: str) -> None:
    columns = table(names)
    with pytest.raises(ModelError, match=f"^estimator: .*{words}"):
        from_sklearn(SVR().fit(columns, LABELS), STATED)
    with pytest.raises(ModelError, match=f"^estimator: .*{words}"):
        OneClass.from_estimator(OneClassSVM().fit(columns), STATED)


@pytest.mark.parametrize("name", COSTS)
def test_a_cost_fitted_to_degrees_is_refused(name: str) -> None:
    estimator = COSTS[name].fit(np.degrees(POINTS), LABELS)
    with pytest.raises(ModelError, match=r"fitted to values of about [\d.]+ for .* \(degrees\?\)"):
        from_sklearn(estimator, STATED)


def test_a_boundary_and_a_mixture_fitted_to_degrees_are_refused() -> None:
    points = np.degrees(POINTS)
    for machine in (OneClassSVM(gamma=1e-3), make_pipeline(StandardScaler(), OneClassSVM())):
        with pytest.raises(ModelError, match=r"degrees\?"):
            OneClass.from_estimator(machine.fit(points), STATED)
    with pytest.raises(ModelError, match=r"degrees\?"):
        OneClass.fit(points, STATED)
    mixture = GaussianMixture(2).fit(np.column_stack([points, LABELS]))
    with pytest.raises(ModelError, match=r"degrees\?"):
        Gmr.from_estimator(mixture, STATED)


def test_points_in_metres_may_be_far() -> None:
    names = ["elbow_x", "wrist_x"]
    estimator = SVR().fit(np.degrees(POINTS[:, :2]), LABELS)
    assert from_sklearn(estimator, names).coordinates.names == tuple(names)
