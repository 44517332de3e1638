from dataclasses import FrozenInstanceError

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from step_samples import held_pose

import ergoqp
from benchmarks.boundary import FirstOrder, Outward, draw_case, unchecked
from ergoqp.coordinates import FOREARM, SCORED_JOINTS
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import InputError, ProblemError
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.learning.one_class import OneClass
from ergoqp.limits import ArmLength, LimitContext, OneClassBoundary, TwistLimit
from ergoqp.responses import LinearResponse
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import run_loop
from ergoqp.simulation.points import run_points
from ergoqp.step.stepper import Stepper

LENGTH = 0.26


@pytest.fixture(scope="module")
def case():
    return draw_case(6, np.random.default_rng(4))


@pytest.fixture(scope="module")
def arm():
    """Pairs of points one forearm apart, and the boundary around them."""
    rng = np.random.default_rng(1)
    elbow, way = (
        rng.normal(size=(900, 3)) * 0.12,
        np.array([0.8, 0.3, 0.0]) + rng.normal(size=(900, 3)),
    )
    points = np.hstack([elbow, elbow + LENGTH * way / np.linalg.norm(way, axis=1, keepdims=True)])
    return points, OneClass.fit(points, FOREARM, nu=0.05, gamma=0.5)


def outward(model, *limits, response=None):
    control = ergoqp.Control(
        comfort=0.0, rest_below=0.0, stall_after=1e6, effort_linear=0.1, effort_angular=0.1
    )
    return ergoqp.Problem(
        cost=Outward(model),
        response=response or LinearResponse(),
        limits=list(limits),
        control=control,
    )


@given(seed=st.integers(0, 10**6), size=st.floats(1e-4, 30.0))
@settings(max_examples=300, deadline=None)
def test_the_bound_holds_for_every_displacement(case, seed, size):
    rng = np.random.default_rng(seed)
    start = case.inside[rng.integers(len(case.inside))] + rng.normal(
        size=6
    ) * case.model.scale * rng.choice([0.1, 3.0])
    step = rng.normal(size=6) * case.model.scale * size
    value, slope = (np.array(part).ravel() for part in case.model.margin_and_slope(start))
    scaled = step / case.model.scale
    bound = value[0] + slope @ step - case.model.gamma * scaled @ scaled
    assert case.model.margin(start + step)[0] >= bound - 1e-9 * (1 + abs(bound))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [OneClassBoundary, FirstOrder])
def test_only_the_whole_row_stays_inside(case, kind):
    names = case.model.coordinates.names
    with unchecked():
        problem = outward(
            case.model,
            TwistLimit(0.8, 0.8, 0.8, 0.8),
            kind(case.model, hard=True, name="edge"),
            response=LinearResponse(names, largest=100.0),
        )
        stepper = Stepper(problem, dt=0.05)
        least = min(
            case.margin(
                run_points(problem, start, 5.0, stepper=stepper, stop_when_still=None).states
            ).min()
            for start in case.inside[:6]
        )
    # A linear row believes the slope and leaves; that it does shows that this way out is an attack.
    assert least > 0 if kind is OneClassBoundary else least < -1e-6


@pytest.mark.slow
def test_it_reaches_the_boundary_and_not_only_its_neighbourhood(case):
    names = case.model.coordinates.names
    problem = outward(
        case.model,
        TwistLimit(),
        OneClassBoundary(case.model, hard=True),
        response=LinearResponse(names, largest=100.0),
    )
    run = run_points(problem, case.inside[0], 12.0, stop_when_still=None)
    assert 0 <= case.margin(run.states[-1:])[0] < 1e-3
    assert set(run.statuses) == {"optimal"}
    assert not any(run.violations.values())


@pytest.mark.slow
def test_on_a_bent_way_it_holds_too(arm):
    points, model = arm
    problem = outward(
        model,
        TwistLimit(0.15, 0.15, 1.5, 1.5),
        ArmLength(LENGTH),
        OneClassBoundary(model, hard=True),
    )
    stepper, inside = Stepper(problem), points[model.margin(points) > 0.01]
    for start in inside[:5]:
        run = run_points(problem, start, 5.0, stepper=stepper, stop_when_still=None)
        assert model.margin(run.states).min() >= 0
        assert (
            np.abs(np.linalg.norm(run.states[:, 3:] - run.states[:, :3], axis=1) - LENGTH).max()
            < 1e-12
        )
        assert not any(run.violations.values())
        assert "braking" not in run.statuses


@pytest.mark.parametrize("seed", range(4))
def test_from_outside_it_comes_back_and_stays(arm, seed):
    points, model = arm
    limit = ArmLength(LENGTH)
    rng = np.random.default_rng(seed)
    somewhere = limit.project(points[:50] + rng.normal(size=(50, 6)) * 0.12)
    start = somewhere[model.margin(somewhere) < -0.05][0]
    problem = outward(
        model, TwistLimit(0.15, 0.15, 1.5, 1.5), limit, OneClassBoundary(model, hard=True)
    )
    run = run_points(problem, start, 4.0, stop_when_still=None)
    margin = model.margin(run.states)
    first = int(np.argmax(margin >= 0))
    assert run.statuses[0] == "recovering"
    assert 0 < first * run.dt <= 2.0
    assert (np.diff(margin[:first]) > -1e-12).all()
    assert margin[first:].min() >= 0


def in_data():
    postures, _ = balanced_postures(60, np.random.default_rng(0))
    model = OneClass.fit(
        postures[:, [INDEX[name] for name in SCORED_JOINTS]], SCORED_JOINTS, nu=0.05, gamma=0.05
    )
    plain = ergoqp.load_problem("screwing")
    return (
        plain,
        plain.replace(
            limits=[*plain.limits, OneClassBoundary(model, tolerance=0.05, recovery_time=1.0)]
        ),
        model,
    )


@pytest.mark.slow
def test_a_persons_posture_stays_in_the_data():
    """In the full problem the row goes through S: kept as far as braking allows, and announced."""
    plain, problem, model = in_data()
    step = Stepper(problem).step(problem.response.comfort)
    assert step.margins["boundary"] == pytest.approx(
        model.margin(model.coordinates.read(problem.response.comfort))[0]
    )
    person, checker = sample_person(plain, 0), Checker(problem)
    posture = problem.response.comfort.copy()
    posture[INDEX["right_shoulder_flexion"]] = np.radians(100)
    trace = run_loop(
        problem, person.holding(person.start_at(posture)), duration=4.0, seed=0, checker=checker
    )
    assert not any(checker.violations.values())
    assert trace.steps[-1].margins["boundary"] >= min(0.0, trace.steps[0].margins["boundary"])


@pytest.mark.slow
def test_a_persons_posture_outside_the_data_is_named_not_made_worse_and_moves_nothing_by_itself():
    plain, problem, model = in_data()
    # Far from all data, though no joint is near its end; the cost alone would lead further out.
    ends, middle = np.random.default_rng(0).choice([-0.4, 0.4], (100, 32)), (LOWER + UPPER) / 2
    posture = (middle + ends * (UPPER - LOWER))[4]
    point = model.coordinates.read(posture)
    outside, slope = (
        float(model.margin(point)[0]),
        np.array(model.margin_and_slope(point)[1]).ravel(),
    )
    assert outside < -0.5
    fastest = {}
    for kind, stepper in (("with", Stepper(problem)), ("without", Stepper(plain))):
        steps = [
            stepper.step(posture, held_pose("screwing") if number == 0 else None)
            for number in range(50)
        ]
        fastest[kind] = min(slope @ step.posture_rate[model.coordinates.indices] for step in steps)
        assert {step.status for step in steps} <= {"optimal", "settled", "relaxed"}
        # The other joints go on: the object is not held.
        assert sum(np.abs(step.twist).max() > 1e-3 for step in steps) > 20
        sentence = f"boundary measured {-outside:.3g} beyond its limit, held at the limit"
        assert all((sentence in step.reason) == (kind == "with") for step in steps)
    assert fastest["without"] < -0.05
    # To the solver's rounding.
    assert fastest["with"] > -1e-9


def test_only_a_state_that_is_commanded_asks_to_come_back(case):
    assert OneClassBoundary(case.model, hard=True).recovers == (True,)
    assert OneClassBoundary(case.model).recovers == (False,)


def test_terms_that_do_not_fit_are_refused(arm):
    _, model = arm
    with pytest.raises(InputError, match="recovery_time"):
        OneClassBoundary(model, recovery_time=0.0)
    with pytest.raises(InputError, match="tolerance"):
        OneClassBoundary(model, tolerance=-1.0)
    plain = ergoqp.load_problem("screwing")
    with pytest.raises(ProblemError, match="elbow_x"):
        plain.replace(limits=[*plain.limits, OneClassBoundary(model)])


def test_readings_stay_matrices(case):
    """Thousands of kernels must not become scalars: the function calls them as they are."""
    assert OneClassBoundary(case.model).measure().n_instructions() < 20
    assert isinstance(OneClassBoundary(case.model).measure()(ca.MX.sym("q", 6)), ca.MX)


def test_a_boundary_cannot_be_changed_unnoticed(case):
    with pytest.raises(FrozenInstanceError):
        OneClassBoundary(case.model).tolerance = 1.0


def asked(limit, model, start, step, ahead, swing, change, surface=None):
    """The limit's own margin of a way, its row and what the row reserves, of a state that the twist
    leads."""
    q, parts = ca.SX.sym("q", len(start)), {"displacement": 6, "ahead": 6, "swing": 6, "change": 6}
    given = {name: ca.SX.sym(name, size) for name, size in parts.items()}
    reading = ca.SX.sym("reading", len(start) + 1)
    nothing = {
        "observed": ca.SX.ones(len(start)),
        "pose": ca.SX.eye(4),
        "sensitivity": ca.SX.eye(6),
    }
    context = LimitContext(
        posture=q,
        **nothing,
        stop_displacement=given["swing"],
        change=given["change"],
        readings={limit.name: reading},
        pending_displacement=given["ahead"],
        shift=given["ahead"],
        surface=surface,
    )
    rows = limit.rows(context)
    outputs = [
        limit.margins(context, given["displacement"]),
        rows.matrix,
        rows.to_lower,
        rows.curvature_margin,
    ]
    function = ca.Function(
        "asked", [q, reading, *given.values()], [ca.densify(ca.SX(part)) for part in outputs]
    )
    value, slope = (np.array(part).ravel() for part in model.margin_and_slope(start))
    found = function(start, np.r_[value, slope], step, ahead, swing, change)
    return [np.array(part).ravel() for part in found], value[0], slope


def test_a_way_bends_where_the_points_move_apart_and_not_where_both_move_alike(arm):
    points, model = arm
    start, still, shift = points[3], np.zeros(6), np.array([0.01, -0.02, 0.015])
    limit, surfaces = OneClassBoundary(model, hard=True), (ArmLength(LENGTH), None)

    def margins(way):
        return [
            asked(limit, model, start, way, still, still, still, each)[0][0][0] for each in surfaces
        ]

    for way in (np.r_[shift, shift], -np.r_[shift, shift]):
        bent, straight = margins(way)
        assert bent == pytest.approx(straight, abs=1e-12)
    lost = [np.subtract(*margins(way)) for way in (np.r_[shift, -shift], np.r_[-shift, shift])]
    assert max(lost) <= 0
    assert min(lost) < -1e-6


@given(seed=st.integers(0, 10**6), size=st.floats(1e-3, 10.0))
@settings(max_examples=100, deadline=None)
def test_the_margin_of_a_way_is_the_bound_at_its_end_and_the_row_reserves_as_much(case, seed, size):
    rng, scale, gamma = np.random.default_rng(seed), case.model.scale, case.model.gamma
    start = case.inside[rng.integers(len(case.inside))]
    step, ahead, swing = (rng.normal(size=6) * scale * size * share for share in (1.0, 0.3, 0.7))
    change = np.abs(rng.normal(size=6)) * scale * size * 0.1
    limit = OneClassBoundary(case.model, hard=True)
    (margin, matrix, below, reserve), value, slope = asked(
        limit, case.model, start, step, ahead, swing, change
    )
    moved = step + ahead
    assert margin[0] == pytest.approx(
        value + min(0.0, slope @ moved - gamma * ((moved / scale) ** 2).sum()), rel=1e-9
    )
    # Nowhere on the way is the true margin below it.
    way = start + np.linspace(0, 1, 20)[:, None] * moved
    assert case.model.margin(way).min() >= margin[0] - 1e-9 * (1 + abs(margin[0]))
    np.testing.assert_allclose(matrix, slope, rtol=1e-12)
    assert below[0] == pytest.approx(value + slope @ ahead, rel=1e-9, abs=1e-12)
    longest = np.linalg.norm((swing + ahead) / scale) + (change / scale).sum()
    assert reserve[0] == pytest.approx(gamma * longest**2, rel=1e-9)
