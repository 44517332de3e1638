"""The stop that a step was certified for, told before it is needed."""

from __future__ import annotations

import numpy as np
import pytest

import ergoqp


def moving(average: float | None, log: list | None = None) -> ergoqp.Stepper:
    problem = ergoqp.load_problem("screwing")
    if average is not None:
        problem = problem.replace(control=ergoqp.Control(average=average))
    stepper = ergoqp.Stepper(problem, log=None if log is None else log.append)
    bent = problem.response.comfort.copy()
    bent[0] = 0.9
    for _ in range(15):
        step = stepper.step(bent)
    assert np.abs(step.twist).max() > 0.05
    return stepper


@pytest.mark.parametrize("average", [None, 0.0, 0.1])
def test_it_is_what_brake_returns_until_the_object_stands(average: float | None) -> None:
    stepper = moving(average)
    ahead = stepper.stop()
    assert ahead.shape[1] == 6
    assert len(ahead) > 5
    assert not ahead[-1].any()
    assert ahead[:-1].any(axis=1).all()
    np.testing.assert_array_equal(ahead, [stepper.brake().twist for _ in ahead])


def test_nothing_changes_by_asking_for_it() -> None:
    log: list = []
    asked, other = moving(None, log), moving(None)
    entries = len(log)
    asked.stop()
    assert len(log) == entries
    comfort = asked.problem.response.comfort
    np.testing.assert_array_equal(asked.step(comfort).twist, other.step(comfort).twist)
    assert len(log) == entries + 1


def test_at_rest_it_is_one_zero() -> None:
    stepper = ergoqp.Stepper(ergoqp.load_problem("screwing"))
    np.testing.assert_array_equal(stepper.stop(), np.zeros((1, 6)))
