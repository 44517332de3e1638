"""The smooth score is the exact one's expectation: by sampling, in the limit, for every option; its
gradient is true."""

import pickle

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp import JOINTS, reba
from ergoqp.costs.cost import Cost
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import InputError
from ergoqp.joints import LOWER, UPPER
from ergoqp.sheets.options import sheet_of

OPTIONS = [
    {},
    {"load_kg": 7.0},
    {"load_kg": 12.0, "shock": True},
    {"coupling": 3, "activity": 3},
    {"seated": True},
    {"one_leg": True},
    {"seated": True, "one_leg": True},
    {"arm_supported": (True, False)},
    {"arm_supported": (True, True), "shoulder_raised": (False, True)},
]
METHODS = [
    {},
    {"additive": True},
    {"arms": "segments"},
    {"trunk_extension": "capped"},
    {"trunk_extension": "mirrored"},
    {"adduction": True, "band_ends": "higher"},
    {"knees_when_seated": True},
    {"final_max": 12},
    {"trunk_upright_deg": 0.0, "neck_extension_deg": -10.0, "knee_deep_deg": 180.0},
    {
        name: value * 1.3
        for name, value in {
            "neck_twist_deg": 10.0,
            "elbow_high_deg": 100.0,
            "wrist_flexion_deg": 15.0,
        }.items()
    },
]
EVERY_OPTION = [({}, options) for options in OPTIONS]
EVERY_OPTION += [(method, {"seated": "knees_when_seated" in method}) for method in METHODS]
EVERY_OPTION += [
    ({"final_max": 12}, {"load_kg": 20.0, "shock": True, "coupling": 3, "activity": 3})
]
EVERY_OPTION += [
    ({"load_ends": "lower"}, {"load_kg": 5.0}),
    ({"arms": "segments"}, {"arm_supported": (True, False)}),
]


def random_postures(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(LOWER, UPPER, (count, 32)) * rng.choice([0.1, 0.3, 1.0], (count, 1))


def distance_to_band_ends(postures, method):
    """Return each posture's distance to its nearest band end [rad]."""
    distances = [
        np.abs(postures[:, segment.joint(step, side)] - edge)
        for segment in sheet_of(method).segments.values()
        for step in segment.steps
        for side in (("right", "left") if segment.worse_side else segment.sides)
        for edge in step.edges
    ]
    return np.min(distances, axis=0)


@pytest.mark.parametrize(("method", "options"), EVERY_OPTION)
def test_becomes_the_sheet_as_tau_goes_to_zero(method, options):
    method = reba.Method(**method)
    postures = random_postures(2000)
    postures = postures[distance_to_band_ends(postures, method) > np.radians(0.05)]
    assert len(postures) > 1000
    value = SmoothReba((0.002,), (1.0,), method, **options)(postures)
    np.testing.assert_allclose(value, reba.assess(postures, method, **options).final, atol=1e-8)


@pytest.mark.parametrize(("method", "options"), EVERY_OPTION)
def test_is_the_expectation_of_the_sheet(method, options):
    method, tau, draws = reba.Method(**method), np.radians(6.0), 40_000
    rng = np.random.default_rng(5)
    for posture in random_postures(3, seed=9):
        noisy = np.clip(posture + tau * rng.logistic(scale=0.5, size=(draws, 32)), -np.pi, np.pi)
        sampled = reba.assess(noisy, method, **options).final
        expected = SmoothReba((6.0,), (1.0,), method, **options)(posture)[0]
        assert abs(sampled.mean() - expected) < 4.5 * sampled.std() / np.sqrt(draws) + 1e-9


def test_options_shift_the_cost():
    postures = random_postures(200)
    plain = SmoothReba()(postures)
    for options in OPTIONS[1:]:
        assert np.abs(SmoothReba(**options)(postures) - plain).max() > 0.05


@pytest.mark.slow
@given(seed=st.integers(0, 10**6), index=st.integers(0, len(EVERY_OPTION) - 1))
@settings(max_examples=15, deadline=None)
def test_stays_between_the_lowest_and_the_highest_score(seed, index):
    method, options = EVERY_OPTION[index]
    cost = SmoothReba(method=reba.Method(**method), **options)
    value = cost(random_postures(50, seed))
    assert (value >= cost.minimum - 1e-9).all()
    assert (value <= 15 + 1e-9).all()


@pytest.mark.parametrize(
    ("options", "minimum"),
    [
        ({}, 1),
        ({"activity": 2}, 3),
        ({"load_kg": 20.0, "shock": True}, 3),
        ({"one_leg": True}, 1),
        ({"coupling": 3}, 2),
    ],
)
def test_the_minimum_is_reached_by_the_best_posture(options, minimum):
    best = np.zeros(32)
    best[[JOINTS.index("right_elbow_flexion"), JOINTS.index("left_elbow_flexion")]] = np.radians(80)
    cost = SmoothReba((0.1,), (1.0,), **options)
    assert cost.minimum == minimum == reba.assess(best, **options).final[0]
    np.testing.assert_allclose(cost(best), minimum, atol=1e-6)


@pytest.mark.parametrize("taus", [((1.5,), (1.0,)), ((1.5, 12.0), (0.8, 0.2))])
def test_gradient_equals_differences(taus):
    cost = SmoothReba(*taus, method=reba.Method(additive=True), one_leg=True)
    for posture in random_postures(5, seed=3):
        value, gradient = (np.asarray(out).ravel() for out in cost.value_and_gradient(posture))
        np.testing.assert_allclose(value, cost(posture), rtol=0, atol=1e-12)
        one, two, three = (
            (cost(posture + h) - cost(posture - h)) / (2 * h.max())
            for h in (np.radians(0.05) * factor * np.eye(32) for factor in (1, 2, 3))
        )
        differences = 1.5 * one - 0.6 * two + 0.1 * three
        np.testing.assert_allclose(
            gradient, differences, rtol=0, atol=1e-6 * np.linalg.norm(differences)
        )


def test_the_expression_is_the_numeric_call_and_can_be_differentiated_inside_others():
    cost = SmoothReba()
    q = ca.MX.sym("q", 32)
    value = cost.expression(q)
    assert value.shape == (1, 1)
    function = ca.Function("f", [q], [value, ca.gradient(value, q), ca.hessian(value, q)[0]])
    postures = random_postures(20)
    numeric = cost(postures)
    for posture, expected in zip(postures, numeric, strict=True):
        found, gradient, hessian = (np.asarray(out) for out in function(posture))
        assert abs(found[0, 0] - expected) < 1e-12
        np.testing.assert_allclose(
            gradient.ravel(), np.asarray(cost.value_and_gradient(posture)[1]).ravel(), atol=1e-10
        )
        assert np.isfinite(hessian).all()


def test_is_finite_for_any_finite_posture():
    cost = SmoothReba((0.01, 1.5), (0.5, 0.5))
    size = np.array([0, 1e-300, 1e-8, 3.2, 1e3, 1e150, 1e300])[:, np.newaxis]
    extreme = np.concatenate(
        [size * np.ones(32), -size * np.ones(32), size * np.resize([1, -1], 32)]
    )
    assert np.isfinite(cost(extreme)).all()
    # Beyond one and a half turns of a joint nobody asks for a slope.
    within = np.clip(extreme, -8.9, 8.9)
    gradients = np.asarray(cost.value_and_gradient.map(len(within))(within.T)[1])
    assert np.isfinite(gradients).all()


def test_no_posture_above_one_is_without_direction():
    postures, scores = balanced_postures(200, np.random.default_rng(0))
    cost = SmoothReba()
    gradients = np.asarray(cost.value_and_gradient.map(len(postures))(postures.T)[1])
    assert (np.linalg.norm(gradients, axis=0)[scores > 1] > 1e-6).all()


def test_joints_that_do_not_score_do_not_matter():
    gradient = np.asarray(SmoothReba().value_and_gradient(random_postures(1)[0])[1]).ravel()
    silent = [i for i, name in enumerate(JOINTS) if "hip" in name or "ankle" in name]
    assert (gradient[silent] == 0).all()
    assert (np.delete(gradient, silent) != 0).all()


def test_the_mixture_is_the_weighted_mean():
    postures = random_postures(30)
    narrow, wide = SmoothReba((1.5,), (1.0,))(postures), SmoothReba((12.0,), (1.0,))(postures)
    np.testing.assert_allclose(
        SmoothReba()(postures), 0.8 * narrow + 0.2 * wide, rtol=0, atol=1e-12
    )


def test_shapes_and_protocol():
    cost = SmoothReba()
    assert isinstance(cost, Cost)
    assert cost.name == "smooth_reba"
    assert cost(np.zeros(32)).shape == (1,)
    assert cost(np.zeros((0, 32))).shape == (0,)
    assert np.isnan(cost(np.full(32, np.nan))[0])
    with pytest.raises(InputError, match=r"got shape \(3,\)"):
        cost(np.zeros(3))


def test_a_band_end_is_half_way():
    posture = np.zeros(32)
    posture[JOINTS.index("trunk_flexion")] = np.radians(60)
    beyond = posture + np.radians(0.001) * np.eye(32)[JOINTS.index("trunk_flexion")]
    assert (reba.assess(posture).final[0], reba.assess(beyond).final[0]) == (1, 2)
    np.testing.assert_allclose(SmoothReba((0.01,), (1.0,))(posture), 1.5, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"taus_deg": (0.0,), "weights": (1.0,)}, "taus_deg"),
        ({"taus_deg": (), "weights": ()}, "taus_deg"),
        ({"taus_deg": (np.nan,), "weights": (1.0,)}, "taus_deg"),
        ({"weights": (1.0,)}, "weights"),
        ({"weights": (0.8, 0.3)}, "weights"),
        ({"weights": (1.5, -0.5)}, "weights"),
        ({"load_kg": [1.0, 2.0]}, "load_kg"),
        ({"coupling": 9}, "coupling"),
    ],
)
def test_bad_arguments_are_named(arguments, named):
    with pytest.raises(InputError, match=f"{named}.*got .*allowed: "):
        SmoothReba(**arguments)


def test_goes_to_another_process_as_its_arguments():
    cost = SmoothReba((2.0, 9.0), (0.7, 0.3), load_kg=7.0, arm_supported=(True, False))
    posture = np.radians(np.random.default_rng(0).uniform(-20, 60, (5, 32)))
    assert np.array_equal(pickle.loads(pickle.dumps(cost))(posture), cost(posture))
