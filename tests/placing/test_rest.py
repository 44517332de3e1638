"""The person's conditions of rest against the person who settles: the same posture."""

import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.placing.program import rest_conditions, soft_clip
from ergoqp.problem.load import TASKS
from ergoqp.responses.holding import Situated
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person

RELAXATION = 1e-4
QUIET = {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}, "print_time": False}


def rest_of(person, begin, pose, guess):
    """Solve the conditions by Newton from a posture near the solution."""
    response = person.response
    k = len(response.hands)
    place = Situated(
        ca.SX.sym("q", 32),
        ca.SX.sym("grasp", 4, 4 * k),
        ca.SX.sym("soles", 4, 8),
        ca.SX.sym("p", 3),
        ca.SX.sym("R", 3, 3),
        ca.SX.sym("eps"),
    )
    rest = rest_conditions(response, place)
    unknowns = ca.vertcat(rest.aims, rest.pelvis, rest.multipliers)
    equations = ca.vertcat(rest.balance, rest.contact)
    given = ca.vertcat(
        place.posture,
        *(ca.vec(part) for part in (place.grasp, place.soles, place.position, place.rotation)),
    )
    given = ca.vertcat(given, place.relaxation)
    solver = ca.nlpsol("rest", "ipopt", {"x": unknowns, "p": given, "g": equations}, QUIET)
    posture = ca.Function("posture", [unknowns, given], [rest.posture])
    numbers = np.concatenate(
        [
            begin,
            np.hstack(list(person.grasp(begin))).ravel(order="F"),
            person.stand(begin).ravel(order="F"),
            pose[:3, 3],
            pose[:3, :3].ravel(order="F"),
            [RELAXATION],
        ]
    )
    x = np.zeros(unknowns.numel())
    moved = [INDEX[joint] for joint in response.chain]
    at = len(moved)
    x[:at] = guess[moved]
    if response.stance == "standing":
        pelvis = person.contact(guess)[1]
        x[at : at + 4] = *pelvis[:3, 3], np.arctan2(pelvis[1, 0], pelvis[0, 0])
        at += 4
    slope = ca.Function(
        "slope", [unknowns, given], [ca.jacobian(rest.balance, rest.multipliers), rest.balance]
    )
    matrix, right = (np.array(part) for part in slope(x, numbers))
    joints = len(moved)
    held = ((guess <= LOWER + 1e-6) | (guess >= UPPER - 1e-6))[moved]
    free = np.append(~held, np.ones(len(right) - joints, dtype=bool))
    x[at:] = np.linalg.lstsq(matrix[free], -right.ravel()[free], rcond=None)[0]
    x[:joints] -= held * (right.ravel() + matrix @ x[at:])[:joints] / response.weight_vector[moved]
    found = solver(x0=x, p=numbers, lbg=0, ubg=0)
    assert float(ca.norm_inf(found["g"])) < 1e-4
    return np.array(posture(found["x"], numbers)).ravel()


def settled_at(person, begin, pose):
    """Where the person comes to rest, to the last digit: `settle` stops when a step is small."""
    grasp, soles = person.grasp(begin), person.stand(begin)
    posture, reached = person.settle(begin, pose, grasp, soles, steps=500)
    assert reached
    targets = np.hstack([pose @ grip for grip in grasp])
    for _ in range(500):
        posture, _, _ = person.move(
            posture, targets, soles, 1.0, 0.5 * person.response.relaxation_time
        )
    return posture


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_same_as_the_person_who_settles(name):
    problem = ergoqp.load_problem(name)
    for seed in range(2):
        person = sample_person(problem, seed)
        begin = awkward_start(problem, person, seed)
        pose = person.contact(begin)[0]
        pose[:3, 3] += 0.01
        settled = settled_at(person, begin, pose)
        found = rest_of(person, begin, pose, settled)
        np.testing.assert_allclose(found, settled, atol=1e-4)


def test_some_of_these_people_are_at_the_end_of_a_joint():
    """The cut to the ranges is part of what was compared above."""
    problem = ergoqp.load_problem("dentist")
    person = sample_person(problem, 0)
    begin = awkward_start(problem, person, 0)
    pose = person.contact(begin)[0]
    pose[:3, 3] += 0.01
    settled = settled_at(person, begin, pose)
    assert ((settled <= LOWER + 1e-9) | (settled >= UPPER - 1e-9)).any()


def test_soft_clip_relaxes_complementarity_exactly():
    s, relaxation = ca.SX.sym("s"), 1e-2
    clip = ca.Function("clip", [s], [soft_clip(s, -1.0, 1e3, ca.SX(relaxation))])
    for value in (-3.0, -1.0, -0.9, 0.5):
        cut = float(clip(value))
        assert cut > -1.0
        # With the far end out of sight the product of distance and multiplier is relaxation^2 / 4.
        assert (cut + 1.0) * (cut - value) == pytest.approx(relaxation**2 / 4, rel=1e-2)
