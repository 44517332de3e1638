"""Estimators of scikit-learn as costs: the same numbers, expression and file; what cannot be read
is named."""

from inspect import signature
from warnings import catch_warnings, simplefilter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)
from sklearn.kernel_ridge import KernelRidge
from sklearn.mixture import GaussianMixture
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler, PolynomialFeatures, StandardScaler
from sklearn.svm import SVR, OneClassSVM

from ergoqp.coordinates import REPORT_JOINTS
from ergoqp.costs.from_sklearn import from_sklearn
from ergoqp.costs.load import load_cost
from ergoqp.errors import ModelError

NAMES = REPORT_JOINTS[:4]
RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(120, 4)) * [0.2, 1.0, 3.0, 0.5] + [0.1, -0.2, 1.0, 0.0]
LABELS = 4 + 2 * np.sin(POINTS[:, 0] * 3) + np.abs(POINTS[:, 1]) - 0.3 * POINTS[:, 2]
NEW = RNG.normal(size=(40, 4)) * [0.3, 1.2, 4.0, 0.7]

MLP = {
    "hidden_layer_sizes": (9, 5),
    "solver": "lbfgs",
    "max_iter": 2000,
    "tol": 1e-3,
    "random_state": 0,
}
ESTIMATORS = {
    "svr": SVR(),
    "svr_rbf": SVR(C=30, gamma=0.2, epsilon=0.05),
    "svr_poly": SVR(kernel="poly", degree=2, coef0=1.0),
    "svr_linear": SVR(kernel="linear"),
    "svr_sigmoid": SVR(kernel="sigmoid", gamma=0.05, coef0=0.1),
    "ridge": KernelRidge(kernel="rbf", alpha=0.1),
    "ridge_poly": KernelRidge(kernel="polynomial", degree=2, gamma=0.3),
    "process": GaussianProcessRegressor(
        ConstantKernel(2.0) * RBF(1.3), alpha=0.1, optimizer=None, normalize_y=True
    ),
    "process_ard": GaussianProcessRegressor(
        RBF([0.5, 1.0, 2.0, 4.0]) * 3.0 + WhiteKernel(0.2), optimizer=None
    ),
    "process_matern32": GaussianProcessRegressor(Matern(1.1, nu=1.5), alpha=0.1, optimizer=None),
    "process_matern52": GaussianProcessRegressor(
        Matern([1, 2, 3, 1.5], nu=2.5), alpha=0.1, optimizer=None
    ),
    "process_rational": GaussianProcessRegressor(
        RationalQuadratic(1.2, 0.7), alpha=0.1, optimizer=None
    ),
    "mlp_tanh": MLPRegressor(activation="tanh", **MLP),
    "mlp_relu": MLPRegressor(activation="relu", **MLP),
    "mlp_logistic": MLPRegressor(activation="logistic", **MLP),
    "mlp_identity": MLPRegressor(activation="identity", **MLP),
}


def agrees(cost, expected):
    """Numbers, expression, and the file all give what the estimator gives, to 1e-10 of its size."""
    allowed = 1e-10 * max(1.0, np.abs(expected).max())
    states = cost.coordinates.spread(NEW)
    assert np.abs(cost(states) - expected).max() <= allowed
    written = [float(cost.function(state)) for state in states]
    assert np.abs(np.array(written) - expected).max() <= allowed


@pytest.mark.parametrize("scaler", [StandardScaler, MinMaxScaler, None])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_it_predicts_what_scikit_learn_predicts(name, scaler, tmp_path):
    estimator = make_pipeline(*([scaler()] if scaler else []), ESTIMATORS[name]).fit(POINTS, LABELS)
    cost = from_sklearn(estimator, NAMES)
    agrees(cost, estimator.predict(NEW))
    cost.save(tmp_path / "cost.npz")
    agrees(load_cost(tmp_path / "cost.npz"), estimator.predict(NEW))


@pytest.mark.parametrize(
    "name", ["svr_rbf", "svr_poly", "process_matern52", "process_rational", "mlp_tanh"]
)
def test_its_gradient_is_that_of_differences(name):
    estimator = make_pipeline(StandardScaler(), ESTIMATORS[name]).fit(POINTS, LABELS)
    cost = from_sklearn(estimator, NAMES)
    for point in NEW[:5]:
        state = cost.coordinates.spread(point)[0]
        slope = np.array(cost.value_and_gradient(state)[1]).ravel()[cost.coordinates.indices]
        steps = 1e-5 * np.eye(4)
        differences = (estimator.predict(point + steps) - estimator.predict(point - steps)) / 2e-5
        assert slope == pytest.approx(differences, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("name", ["svr_rbf", "ridge_poly", "process", "mlp_tanh"])
@pytest.mark.parametrize("target", [StandardScaler(), MinMaxScaler((-1, 2)), None])
def test_a_scaled_score_is_scaled_back(name, target):
    inner = make_pipeline(MinMaxScaler(), ESTIMATORS[name])
    estimator = make_pipeline(
        StandardScaler(), TransformedTargetRegressor(inner, transformer=target)
    ).fit(POINTS, LABELS)
    agrees(from_sklearn(estimator, NAMES), estimator.predict(NEW))


@pytest.mark.skipif(
    "loss" not in signature(MLPRegressor).parameters, reason="this scikit-learn has one loss only"
)
def test_an_exponential_output_is_refused():
    estimator = MLPRegressor(**MLP, loss="poisson").fit(POINTS, 10 + LABELS)
    with pytest.raises(ModelError, match="got the loss 'poisson', allowed 'squared_error'"):
        from_sklearn(estimator, NAMES)


def test_a_linear_machine_is_one_kernel():
    cost = from_sklearn(SVR(kernel="linear").fit(POINTS, LABELS), NAMES)
    assert len(cost.model) == 1


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    gamma=st.floats(1e-3, 2.0),
    C=st.floats(1e-2, 1e3),
    kernel=st.sampled_from(["rbf", "poly", "sigmoid", "linear"]),
)
def test_any_machine_is_read_exactly(seed, gamma, C, kernel):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 4)) * rng.uniform(0.1, 3, 4) + rng.normal(size=4)
    svr = SVR(kernel=kernel, gamma=gamma, C=C, coef0=0.3, max_iter=200)
    estimator = make_pipeline(StandardScaler(), svr)
    with catch_warnings():
        simplefilter("ignore")  # a fit that was stopped early is read as well as any
        estimator.fit(points, rng.normal(size=30) * 3 + 5)
    agrees(from_sklearn(estimator, NAMES), estimator.predict(NEW))


def test_a_one_class_machine_costs_more_outside():
    estimator = make_pipeline(StandardScaler(), OneClassSVM(nu=0.1)).fit(POINTS)
    agrees(from_sklearn(estimator, NAMES), -estimator.decision_function(NEW))


def test_a_mixture_is_a_regression_on_its_last_column():
    from ergoqp.costs.gmr import Gmr

    mixture = GaussianMixture(3, random_state=0).fit(np.column_stack([POINTS, LABELS]))
    cost = from_sklearn(mixture, NAMES)
    assert isinstance(cost, Gmr)
    agrees(cost, cost.predict(NEW))


@pytest.mark.parametrize(
    ("estimator", "said"),
    [
        (
            RandomForestRegressor(3).fit(POINTS, LABELS),
            "got a RandomForestRegressor, allowed SVR, KernelRidge",
        ),
        (
            TransformedTargetRegressor(SVR(), func=np.log, inverse_func=np.exp).fit(
                POINTS, 10 + LABELS
            ),
            "got the step FunctionTransformer, allowed",
        ),
        (
            TransformedTargetRegressor(RandomForestRegressor(3)).fit(POINTS, LABELS),
            "got a RandomForestRegressor, allowed",
        ),
        (TransformedTargetRegressor(SVR()), "got a TransformedTargetRegressor that is not fitted"),
        (
            make_pipeline(StandardScaler(), GaussianMixture(2)).fit(
                np.column_stack([POINTS, LABELS])[:, :4]
            ),
            "got a GaussianMixture after other steps",
        ),
        (SVR(), "got a SVR that is not fitted"),
        (
            make_pipeline(PolynomialFeatures(), SVR()).fit(POINTS, LABELS),
            "got the step PolynomialFeatures",
        ),
        (SVR(kernel=lambda a, b: a @ b.T).fit(POINTS, LABELS), "got the kernel <function"),
        (KernelRidge(kernel="laplacian").fit(POINTS, LABELS), "got the kernel 'laplacian'"),
        (
            GaussianProcessRegressor(DotProduct(), alpha=1.0).fit(POINTS, LABELS),
            "got the kernel DotProduct",
        ),
        (SVR().fit(POINTS[:, :3], LABELS), "got one of 3 inputs, allowed 4"),
        (
            MLPRegressor(**MLP).fit(POINTS, np.column_stack([LABELS, LABELS])),
            "got 2 outputs, allowed 1",
        ),
        (KernelRidge().fit(POINTS, np.column_stack([LABELS, LABELS])), "got 2 outputs, allowed 1"),
        ("a text", "got a str, allowed an estimator of scikit-learn"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(estimator, said):
    with pytest.raises(ModelError) as caught:
        from_sklearn(estimator, NAMES)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
