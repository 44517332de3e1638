"""Compiled rests of many places are those of the interpreter."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.batch import BatchedRests, step_source
from ergoqp.rest.best_place import workspace_poses
from ergoqp.rest.model_person import ModelPerson, sample_person


@cache
def person_of(name: str) -> ModelPerson:
    return ModelPerson(load_problem(name).response)


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_rests_are_those_of_the_interpreter(name: str) -> None:
    person = person_of(name)
    comfort = person.comfort
    held = grasp, soles = person.grasp(comfort), person.stand(comfort)
    poses = workspace_poses(load_problem(name), 0.3)
    poses = poses[np.random.default_rng(1).permutation(len(poses))[:9]]
    poses[3, :3, 3] += 5.0  # out of reach
    poses[5, 0, 3] = np.nan
    alone = [person.settle(comfort, pose, *held) for pose in poses]
    postures, reached = BatchedRests(person).settle(comfort, poses, grasp, soles)
    np.testing.assert_array_equal(reached, [there for _, there in alone])
    assert not reached[3]
    assert not reached[5]
    np.testing.assert_allclose(postures, [q for q, _ in alone], atol=1e-9)


def test_people_of_one_structure_share_one_text() -> None:
    problem = load_problem("dentist")
    (text, numbers), (other, others) = (
        step_source(sample_person(problem, seed)._step) for seed in (1, 2)
    )
    assert text == other
    assert (numbers != others).any()
