"""Compiled rests of many places are those of the interpreter."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ergoqp.joints import LOWER, UPPER
from ergoqp.native.compiled import CompilerError, c_text, loaded, shared_library
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.batch import WORTH_COMPILING, BatchedRests, settling, step_source
from ergoqp.rest.best_place import workspace_poses
from ergoqp.rest.model_person import ModelPerson, person_of, sample_person


@cache
def someone(name: str) -> ModelPerson:
    return ModelPerson(person_of(load_problem(name)))


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_rests_are_those_of_the_interpreter(name: str) -> None:
    person = someone(name)
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
    rests = np.array([posture for posture, _ in alone])
    np.testing.assert_allclose(postures[reached], rests[reached], atol=2e-6)


@pytest.mark.slow
def test_an_arm_that_is_just_too_short_does_not_swing_compiled_either() -> None:
    person, poses = someone("overhead"), workspace_poses(load_problem("overhead"), 0.1)
    comfort = person.comfort
    grasp, soles = person.grasp(comfort), person.stand(comfort)
    chosen = poses[[532, 281, 0, 575]]  # two of them take more than 150 steps
    postures, reached = BatchedRests(person).settle(comfort, chosen, grasp, soles)
    for pose, posture, there in zip(chosen, postures, reached, strict=True):
        rest, said = person.settle(comfort, pose, grasp, soles)
        assert there == said
        if there:
            np.testing.assert_allclose(posture, rest, atol=2e-6)
    assert reached.sum() >= 3
    empty, none = BatchedRests(person).settle(comfort, poses[:0], grasp, soles)
    assert empty.shape == (0, 32)
    assert none.shape == (0,)


@pytest.mark.slow
def test_a_place_that_is_none_leaves_nothing_in_its_lane() -> None:
    person, poses = someone("desk"), workspace_poses(load_problem("desk"), 0.3)[:8]
    comfort, batch = person.comfort, BatchedRests(someone("desk"))
    held = person.grasp(comfort), person.stand(comfort)
    rests, reached = batch.settle(comfort, poses, *held)
    assert reached.all()
    # The places after four that are none are near their rest, so few steps are remembered.
    none = np.full((4, 4, 4), np.nan)
    starts = np.concatenate([np.tile(comfort, (4, 1)), np.clip(rests + 1e-5, LOWER, UPPER)])
    again, there = batch.settle(starts, np.concatenate([none, poses]), *held)
    assert not there[:4].any()
    assert there[4:].all()
    np.testing.assert_allclose(again[4:], rests, atol=1e-5)


def test_a_person_with_a_way_of_their_own_settles_by_it() -> None:
    class Stiff(ModelPerson):
        def move(self, *given: Any) -> tuple[np.ndarray, float, float]:
            return given[0], 0.0, 0.0

    person = Stiff(someone("desk").response)
    assert settling(person, WORTH_COMPILING) == person.settle


def test_sine_and_cosine_in_lanes_are_those_of_the_library(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    source = """#define LANES 4
#include <math.h>
#include "rests.h"
void both(const double* x, long long n, double* s, double* c) {
    for (long long i = 0; i < n; i += LANES) {
        lanes at;
        for (int j = 0; j < LANES; ++j) at[j] = x[i + j];
        lanes up = sine(at), along = cosine(at);
        for (int j = 0; j < LANES; ++j) {
            s[i + j] = up[j];
            c[i + j] = along[j];
        }
    }
}
"""
    sources = {"waves.c": source, "rests.h": c_text("rests.h")}
    both = loaded(shared_library("waves", sources, (), ())).both
    quarters = np.arange(-8, 9) * (np.pi / 4)
    near = np.concatenate([quarters, np.nextafter(quarters, 9), np.nextafter(quarters, -9)])
    x = np.concatenate([np.random.default_rng(0).uniform(-7, 7, 40_001), near])
    sine, cosine = np.empty_like(x), np.empty_like(x)
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (x, sine, cosine)]
    both(pointers[0], ctypes.c_longlong(len(x)), *pointers[1:])
    np.testing.assert_allclose(sine, np.sin(x), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(cosine, np.cos(x), rtol=0, atol=2.3e-16)
    assert sine[40_001 + 8] == 0.0


def test_people_of_one_structure_share_one_text() -> None:
    problem = load_problem("dentist")
    (text, numbers), (other, others) = (
        step_source(sample_person(problem, seed)._step) for seed in (1, 2)
    )
    assert text == other
    assert (numbers != others).any()


def test_without_a_compiler_the_interpreter_settles(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise CompilerError("C compiler: none")

    monkeypatch.setattr("ergoqp.rest.batch.shared_library", none)
    person = someone("dentist")
    comfort = person.comfort
    held = person.grasp(comfort), person.stand(comfort)
    poses = workspace_poses(load_problem("dentist"), 0.3)[:2]
    posture, reached = settling(person, WORTH_COMPILING)(comfort, poses[1], *held)
    alone, there = person.settle(comfort, poses[1], *held)
    np.testing.assert_array_equal(posture, alone)
    assert reached == there


@pytest.mark.slow
def test_many_places_are_settled_compiled_and_few_if_that_is_there(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    problem = load_problem("desk")
    first, second = (sample_person(problem, seed) for seed in (3, 4))
    assert settling(first, 10) == first.settle
    assert settling(first, WORTH_COMPILING) != first.settle
    few = settling(second, 10)
    assert few != second.settle
    held = second.grasp(second.comfort), second.stand(second.comfort)
    pose = workspace_poses(problem, 0.3)[5]
    posture, reached = few(second.comfort, pose, *held)
    alone, there = second.settle(second.comfort, pose, *held)
    np.testing.assert_allclose(posture, alone, atol=1e-6)
    assert reached == there
