"""Problems of one structure have one function: their numbers are inputs, see `constants_of`."""

import numpy as np
import pytest

import ergoqp
from benchmarks.drawn import KINDS, drawn, postures
from ergoqp.expressions import Evaluator
from ergoqp.solvers import solver_named
from ergoqp.step.constants import constants_of
from ergoqp.step.function import INPUTS, OUTPUTS, build_shared_step, step_function
from ergoqp.step.layout import History
from ergoqp.step.stepper import Stepper


@pytest.mark.parametrize("kind", KINDS)
def test_problems_of_one_structure_have_one_function(kind: str) -> None:
    texts = [
        build_shared_step(drawn(kind, seed), solver_named("daqp"), guided=kind == "plain")
        for seed in (1, 2)
    ]
    assert texts[0].serialize() == texts[1].serialize()


@pytest.mark.parametrize("kind", KINDS)
def test_the_function_of_one_problem_steps_another_with_its_numbers(kind: str) -> None:
    one, other = drawn(kind, 3), drawn(kind, 4)
    own, lent = Stepper(other), Stepper(other)
    lent._bind(build_shared_step(one, solver_named("daqp")))
    for posture in postures(other, 5):
        expected, found = own.step(posture), lent.step(posture)
        np.testing.assert_array_equal(found.values, expected.values)
        assert found.reason == expected.reason


@pytest.mark.parametrize("kind", ["plain", "robot"])
def test_every_number_is_one_that_the_step_reads(kind: str) -> None:
    """None is an input for nothing, and none is written into the function in two places."""
    function = build_shared_step(drawn(kind, 1), solver_named("daqp"), guided=True)
    numbers = set(constants_of(drawn(kind, 1)))
    assert numbers <= set(function.name_in())


def test_the_function_with_its_numbers_answers_as_the_stepper_to_the_bit() -> None:
    problem = drawn("plain", 6)
    function, stepper = step_function(problem), Stepper(problem)
    assert tuple(function.name_in()) == INPUTS
    assert tuple(function.name_out()) == OUTPUTS
    evaluator = Evaluator(function)
    for posture in postures(problem, 7):
        step = stepper.step(posture)
        for name in INPUTS:
            evaluator.inputs[name][:] = stepper._inputs[name]
        evaluator.evaluate()
        np.testing.assert_array_equal(evaluator.results, step.values)


def test_the_numbers_of_a_problem_change_its_answers() -> None:
    """Each of them reaches the step: with the numbers of another problem it answers otherwise."""
    problem = drawn("plain", 8)
    stepper, other = Stepper(problem), Stepper(drawn("plain", 9))
    twists = [[each.step(q).twist for q in postures(problem, 1)] for each in (stepper, other)]
    assert not np.allclose(*twists, atol=1e-4)


@pytest.mark.parametrize(("average", "entries"), [(0.05, 12), (0.07, 24), (0.2, 48)])
def test_histories_are_rounded_up_and_as_many_count_as_before(average: float, entries: int) -> None:
    problem = ergoqp.load_problem("screwing")
    control = ergoqp.Control(average=average)
    history = History(problem.replace(control=control))
    assert history.planned == entries
    assert history.counted["planned"] == 2 + int(np.ceil(1.5 * average / problem.dt))
    assert history.constants()["planned"].sum() == history.counted["planned"]


def test_what_is_recorded_are_the_inputs_of_a_user() -> None:
    log: list = []
    stepper = Stepper(drawn("plain", 1), log=log.append)
    stepper.step(None)
    assert set(log[0]) == {"loop", "notes", "engine", *INPUTS}
