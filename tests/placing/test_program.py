"""The program's residual is recomputed, and says so when something is not optimal, whatever a
solver claims."""

import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.placing.optimise import begin_from
from ergoqp.placing.program import Program, smooth_cost
from ergoqp.problem.load import TASKS
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import ModelPerson

FINE = (1e-4, 0.5)


class Solved:
    """A program with its last stage solved from the person's rest at the start."""

    def __init__(self, name, mode="stackelberg"):
        self.problem = ergoqp.load_problem(name)
        person = ModelPerson(self.problem.response)
        posture = awkward_start(self.problem, person, 1)
        begin = begin_from(person, posture, None)
        self.program = Program(self.problem, person.response, mode, "ipopt")
        place = self.program.place
        self.anchor = place.anchor(self.problem, begin.pose)
        unknowns = place.unknowns(begin.pose, self.anchor)
        rest, _ = person.settle(
            posture, place.pose(unknowns, self.anchor), begin.grasp, begin.soles, steps=500
        )
        self.given = self.program.given(posture, begin.grasp, begin.soles, self.anchor, *FINE)
        self.begin = self.program.start(unknowns, rest, person.contact(rest)[1], self.given)
        self.rest = rest


@pytest.fixture(scope="module")
def dentist():
    return Solved("dentist")


def multipliers(solved, x):
    """The solver's own multipliers at its own solution."""
    (low, high), (least, most) = solved.program._bounds
    found = solved.program._solver(x0=x, p=solved.given, lbx=low, ubx=high, lbg=least, ubg=most)
    return tuple(np.array(found[key]).ravel() for key in ("x", "lam_g", "lam_x"))


class TestResidual:
    def test_small_at_a_solution_only(self, dentist):
        x, rows, bounds = multipliers(
            dentist, dentist.program.solve(dentist.begin, dentist.given)[0]
        )
        residual = dentist.program.residual
        assert residual(x, dentist.given, rows, bounds) <= 1e-6
        # Somewhere else, with other multipliers, or out of bounds it is not.
        moved = x.copy()
        moved[0] += 0.01
        assert residual(moved, dentist.given, rows, bounds) > 1e-3
        tilted = bounds.copy()
        tilted[2] += 1e-3
        assert residual(x, dentist.given, rows, tilted) >= 1e-3 * 0.999
        outside = x.copy()
        outside[0] = dentist.program.place.upper[0] + 0.1
        assert residual(outside, dentist.given, rows, bounds) >= 0.1 - 1e-9

    def test_not_a_number_is_not_optimal(self, dentist):
        x, rows, bounds = multipliers(dentist, dentist.begin)
        x[0] = np.nan
        assert dentist.program.residual(x, dentist.given, rows, bounds) == np.inf

    def test_its_slope_is_that_of_differences(self, dentist):
        """The Lagrangian's slope against central differences of cost and rows, at a point that is
        not a solution."""
        program, rng = dentist.program, np.random.default_rng(0)
        x = dentist.begin + 0.01 * rng.normal(size=len(dentist.begin))
        rows, bounds = rng.normal(size=program._nlp["g"].numel()), rng.normal(size=len(x))
        parts = ca.Function(
            "parts", [program._nlp["x"], program._nlp["p"]], [program._nlp["f"], program._nlp["g"]]
        )

        def lagrangian(at):
            value, row = parts(at, dentist.given)
            return float(value) + rows @ np.array(row).ravel() + bounds @ at

        slope = np.array(program._optimality(x, dentist.given, rows, bounds)[0]).ravel()
        step = 1e-6
        for i in range(len(x)):
            aside = np.zeros(len(x))
            aside[i] = step
            assert slope[i] == pytest.approx(
                (lagrangian(x + aside) - lagrangian(x - aside)) / (2 * step), rel=1e-4, abs=1e-4
            )

    def test_a_solver_that_raises_is_not_optimal(self, dentist, monkeypatch):
        def fails(**_):
            raise RuntimeError("NaN")

        program = Program(dentist.problem, dentist.problem.response, "stackelberg", "ipopt")
        monkeypatch.setitem(program.__dict__, "_solver", fails)
        assert program.solve(dentist.begin, dentist.given)[1] == np.inf


@pytest.mark.parametrize("name", TASKS)
def test_starts_near_the_persons_rest(name):
    """What a start begins with nearly satisfies the person's conditions, joints at their ends
    included."""
    solved = Solved(name)
    program = solved.program
    none = np.zeros(program._nlp["g"].numel()), np.zeros(len(solved.begin))
    _, rows = program._optimality(solved.begin, solved.given, *none)
    equations = np.array(rows).ravel()[: program._rows.numel()]
    assert np.abs(equations).max() < 0.5
    np.testing.assert_allclose(
        np.array(program.posture(solved.begin, solved.given)).ravel(), solved.rest, atol=0.01
    )


def test_smooth_cost_is_that_of_the_cost(dentist):
    problem = dentist.problem
    narrow = SmoothReba((2.0,), (1.0,), **problem.task)
    assert smooth_cost(problem, dentist.rest, 2.0) == pytest.approx(
        narrow(dentist.rest)[0], abs=1e-12
    )
