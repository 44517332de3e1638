"""Problems of equal structure have one function, see `structure_of`."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import ergoqp
from benchmarks.drawn import KINDS, REGIONS, drawn, kind_of, postures
from ergoqp.errors import ErgoqpError, InputError
from ergoqp.limits import Ball, KeepOut
from ergoqp.native.compiled import CompilerError, short_key
from ergoqp.problem.load import problem_from_dict
from ergoqp.problem.problem import Problem
from ergoqp.registry import data_folder
from ergoqp.solvers import solver_named
from ergoqp.step.engine import check_layout, read_choice
from ergoqp.step.function import build_shared_step
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Stepper
from ergoqp.step.structure import structure_of

_Tables = dict[str, Any]


def key(problem: Problem, guided: bool = False) -> str:
    found = short_key("step", structure_of(StepModel(problem, guided)))
    assert found is not None
    return found


def function(problem: Problem, guided: bool = False) -> str:
    """Return the interpreted step as a text. The compiled one is made from the same expressions."""
    return build_shared_step(problem, solver_named("daqp"), guided=guided).serialize()


def made(raw: _Tables) -> Problem:
    return problem_from_dict(raw, "made", data_folder("problems"))


def leaves(tables: _Tables, path: tuple = ()) -> Iterator[tuple]:
    """Give the path of every number of a problem file."""
    pairs = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for name, value in pairs:
        if isinstance(value, (dict, list)):
            yield from leaves(value, (*path, name))
        elif type(value) is float:
            yield (*path, name)


def put(tables: Any, path: tuple, value: Any) -> _Tables:
    tables = deepcopy(tables)
    inner = tables
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value
    return tables


def at(tables: Any, path: tuple) -> Any:
    for name in path:
        tables = tables[name]
    return tables


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_number_of_a_problem_file_changes_the_structure(kind: str) -> None:
    """Each by itself. The shares of a mixture have the sum 1, and are drawn together elsewhere."""
    raw = kind_of(kind)
    usual, tried = key(made(raw)), 0
    for path in leaves(raw):
        # Longer averages and shorter periods need another size of the history.
        scale = 1.04 if path == ("dt",) else 0.97
        try:
            other = made(put(raw, path, scale * at(raw, path)))
        except ErgoqpError:
            continue
        assert key(other) == usual, path
        tried += 1
    assert tried > 20


@pytest.mark.parametrize("kind", KINDS)
def test_drawn_problems_have_one_structure(kind: str) -> None:
    assert len({key(drawn(kind, seed)) for seed in range(6)}) == 1


_CHANGES: dict[str, Callable[[_Tables], object]] = {
    "left hand": lambda raw: raw["response"]["ik"].update(hands=["left"]),
    "both hands": lambda raw: raw["response"]["ik"].update(hands=["left", "right"]),
    "tool": lambda raw: raw["response"]["ik"].update(tool="thumb"),
    "firm tool": lambda raw: raw["response"]["ik"].update(free_about_tool=False),
    "no gaze": lambda raw: raw["response"]["ik"].update(looks=False),
    "free arm": lambda raw: raw["response"]["ik"].update(free_arm="rests"),
    "average": lambda raw: raw["control"].update(average=0.0),
    "long average": lambda raw: raw["control"].update(average=0.3),
    "axes": lambda raw: raw["limits"]["twist"].update(axes=["x", "y", "z"]),
    "no yielding": lambda raw: raw["limits"]["joints"].update(yield_zone_deg=0.0),
    "no recovery": lambda raw: raw["limits"]["joints"].update(recover=False),
    "another joint": lambda raw: raw["limits"]["joints"].update(
        ranges_deg={"neck_flexion": [-10.0, 40.0], "trunk_flexion": [0.0, 60.0]}
    ),
    "one region": lambda raw: raw["limits"].update(keep_out=deepcopy(REGIONS[:1])),
    "three regions": lambda raw: raw["limits"].update(keep_out=deepcopy(REGIONS)),
    "flat region": lambda raw: raw["limits"].update(
        keep_out=[{"name": "wall", "half_space": {"normal": [1.0, 0.0, 0.0], "offset": -3.0}}]
    ),
    "delay": lambda raw: raw.update(robot={"delay": 0.02}),
    "pose delay": lambda raw: raw.update(robot={"pose_delay": 0.02}),
    "lag": lambda raw: raw.update(robot={"lag": 0.05}),
    "gain": lambda raw: raw.update(robot={"gain_error": 0.02}),
    "hold": lambda raw: raw.update(robot={"longest_hold": 0.05}),
    "noise": lambda raw: raw.update(robot={"pose_noise": 0.001}),
    "turned": lambda raw: raw.update(robot={"pose_noise_deg": 0.2}),
    "frames": lambda raw: raw.update(frames={"base": [0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}),
    "no comparison": lambda raw: raw.update(frames={"compare": False}),
    "one scale": lambda raw: raw.update(
        cost={"smooth_reba": {"taus_deg": [3.0], "weights": [1.0]}}
    ),
    "narrow scale": lambda raw: raw["cost"]["smooth_reba"].update(taus_deg=[1.2, 12.0]),
    "arms": lambda raw: raw["task"]["method"].update(arms="segments"),
    "additive": lambda raw: raw["task"]["method"].update(additive=True),
    "trunk": lambda raw: raw["task"]["method"].update(trunk_extension="mirrored"),
    "capped trunk": lambda raw: raw["task"]["method"].update(trunk_extension="capped"),
    "adduction": lambda raw: raw["task"]["method"].update(adduction=True),
    "no deep knee": lambda raw: raw["task"]["method"].update(knee_deep_deg=180.0),
    "one leg": lambda raw: raw["task"].update(one_leg=True),
    "supported": lambda raw: raw["task"].update(arm_supported=[True, False]),
    "raised": lambda raw: raw["task"].update(shoulder_raised=[True, False]),
    "load": lambda raw: raw["task"].update(load_kg=12.0, shock=True, coupling=2, activity=1),
    "band ends": lambda raw: raw["task"]["method"].update(band_ends="higher"),
    "highest score": lambda raw: raw["task"]["method"].update(final_max=12),
    "comfort": lambda raw: raw["response"]["ik"].update(comfort_deg={"neck_flexion": 10.0}),
    "weights": lambda raw: raw["response"]["ik"].update(weights={}),
    "no caution": lambda raw: raw["control"].update(caution=0.0, comfort=0.0, smoothing=0.1),
}


def changed(names: tuple[str, ...]) -> Problem:
    raw = kind_of("plain")
    for name in names:
        _CHANGES[name](raw)
    return made(raw)


_SAME = (
    "no deep knee",
    "load",
    "band ends",
    "highest score",
    "comfort",
    "weights",
    "no caution",
    "pose delay",
)
"""Changes of the list that leave the structure as it is; the last one beside `delay`."""


@pytest.mark.slow
def test_equal_keys_are_equal_functions_and_others_are_others() -> None:
    """Over every change alone, and pairs of them."""
    rng, names = np.random.default_rng(0), list(_CHANGES)
    pairs = [tuple(rng.choice(names, 2, replace=False).tolist()) for _ in range(40)]
    found: dict[str, str] = {}
    for some in [(), *((name,) for name in names), *pairs]:
        try:
            problem = changed(some)
        except ErgoqpError:
            continue
        text = function(problem)
        assert found.setdefault(key(problem), text) == text, some
    assert len(found) > 50
    # A key that tells apart what is one function only costs time; it is none of the usual ones.
    assert len(set(found.values())) == len(found)


@pytest.mark.parametrize("name", _SAME[:-1])
def test_these_numbers_and_options_are_no_structure(name: str) -> None:
    assert key(changed((name,))) == key(changed(()))


def test_delays_are_one() -> None:
    assert key(changed(("pose delay",))) == key(changed(("delay",)))


@pytest.mark.parametrize("name", [name for name in _CHANGES if name not in _SAME])
def test_these_changes_are_another_structure(name: str) -> None:
    assert key(changed((name,))) != key(changed(()))


def test_a_guide_and_own_names_and_seats() -> None:
    plain = drawn("plain", 1)
    assert key(plain, guided=True) != key(plain)
    assert key(plain) != key(drawn("seated", 1))
    named = plain.replace(name="other", title="Another one")
    assert key(named) == key(plain)
    post = KeepOut(Ball((0.5, 0.3, 1.0), 0.05), name="post")
    pole = replace(post, name="pole", tolerance=1e-5)
    with_post, with_pole = (plain.replace(limits=[*plain.limits, each]) for each in (post, pole))
    assert key(with_post) == key(with_pole)


def test_of_terms_of_a_user_only_the_code_tells_what_they_are() -> None:
    class Own(type(ergoqp.load_problem("screwing").response)):  # type: ignore[misc]
        pass

    problem = drawn("plain", 1)
    mine = problem.replace(response=Own(hands=("left",)))
    assert short_key("step", structure_of(StepModel(mine))) is None


def test_a_learned_cost_counts_with_all_its_numbers() -> None:
    one = ergoqp.load_problem("screwing_learned")
    assert key(one) == key(ergoqp.load_problem("screwing_learned"))
    assert key(one) != key(ergoqp.load_problem("screwing"))


def test_a_step_of_another_layout_is_refused() -> None:
    plain, robot = drawn("plain", 1), drawn("robot", 1)
    step = build_shared_step(plain, solver_named("daqp"))
    check_layout(step, StepModel(drawn("plain", 2)))
    for model in (StepModel(robot), StepModel(plain, guided=True)):
        with pytest.raises(InputError, match="another layout"):
            check_layout(step, model)


@pytest.mark.slow
def test_a_person_whom_the_cache_never_saw_is_served_by_it(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("ergoqp.step.stepper.read_choice", read_choice)
    Stepper(drawn("plain", 20), compiled=True)

    def never(*args: Any, **options: Any) -> None:
        raise AssertionError("an expression of the step was built")

    for seed in (21, 22):
        problem = drawn("plain", seed)
        own = Stepper(problem, compiled=False)
        with monkeypatch.context() as without:
            without.setattr("ergoqp.step.stepper.shared_step", never)
            without.setattr("ergoqp.step.engine.shared_step", never)
            lent = Stepper(problem)
        assert lent.engine == "compiled"
        for posture in postures(problem, seed):
            expected, found = own.step(posture), lent.step(posture)
            np.testing.assert_array_equal(found.values, expected.values)

    def none() -> tuple[str, ...]:
        raise CompilerError("no C compiler")

    monkeypatch.setattr("ergoqp.native.compiled.compiler", none)
    assert Stepper(drawn("plain", 23)).engine == "compiled"


def test_noise_that_is_no_number_of_radians_is_none():
    least = ergoqp.DeclaredRobot(pose_noise_deg=5e-324)
    problem = ergoqp.load_problem("screwing")
    declared = problem.replace(robot=ergoqp.DeclaredRobot(pose_noise_deg=0.1))
    assert key(problem.replace(robot=least)) != key(declared)
