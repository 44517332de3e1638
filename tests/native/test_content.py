"""The key of a compiled step without its C code: another step has another key, or none."""

import shutil
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError
from ergoqp.native import compiled as native_compiler
from ergoqp.native import content
from ergoqp.native.compiled import NativeDaqp, found, keep, short_key
from ergoqp.native.content import content_key
from ergoqp.problem.load import problem_names
from ergoqp.problem.settings import Control


@pytest.mark.parametrize("name", problem_names())
def test_a_problem_that_is_loaded_again_has_the_same_key(name):
    problem = ergoqp.load_problem(name)
    key = content_key(problem)
    assert key is not None
    for name_of in dir(problem):  # what was asked of it makes no difference
        if not name_of.startswith("_"):
            getattr(problem, name_of)
    assert content_key(problem) == key
    assert content_key(ergoqp.load_problem(name)) == key


def test_every_problem_has_its_own_key():
    keys = {content_key(ergoqp.load_problem(name)) for name in problem_names()}
    assert len(keys) == len(problem_names())


def test_the_last_bit_of_every_number_counts():
    problem = ergoqp.load_problem("screwing")
    others = [problem]
    for each in fields(Control):
        value = getattr(problem.control, each.name)
        if isinstance(value, float):
            for changed in (np.nextafter(value, np.inf), np.nextafter(value, -np.inf)):
                try:
                    others.append(
                        problem.replace(control=replace(problem.control, **{each.name: changed}))
                    )
                except ErgoqpError:  # beyond its range
                    continue
    response = problem.response
    joints = {**response.comfort_deg, "elbow_flexion": 80.0}
    others += [
        problem.replace(dt=0.0101),
        problem.replace(response=replace(response, comfort_deg=joints)),
        problem.replace(title="another title"),
    ]
    assert len({content_key(each) for each in others}) == len(others) > 10
    assert content_key("step", problem, True) != content_key("step", problem, False)


ALIKE = [
    *(None, True, 1, 1.0, 1 + 0j, "1", b"1", "True", "None", 0.0, -0.0, float("nan"), ""),
    *((), [], {}, set(), (1, 2), [1, 2], ((1,), 2), (1, (2,)), {1: 2}, {2: 1}, {1, 2}),
    *("12", ("1", "2"), ("12",), ("", "12"), [[]], [()], (None,)),
    *(np.arange(4), np.arange(4).reshape(2, 2), np.arange(4.0), np.arange(4, dtype=np.int32)),
    *(np.float64(1.0), np.float32(1.0), np.array(1.0), np.array([1.0]), np.bool_(True)),
    *(Control, SmoothReba, partial(Control), partial(Control, average=0.1), content_key),
]


def test_no_two_values_have_one_key():
    keys = [content_key(value) for value in ALIKE]
    assert None not in keys
    assert len(set(keys)) == len(ALIKE)
    assert content_key(MappingProxyType({1: 2})) == content_key({1: 2})
    assert content_key({1, "a"}) == content_key({"a", 1})
    array = np.arange(6.0).reshape(2, 3)
    assert content_key(np.asfortranarray(array)) == content_key(array)


class OwnCost(SmoothReba):
    """A cost whose code is not that of the package."""


def _own_function() -> None: ...


UNKNOWN = [
    *(object(), lambda: 1, _own_function, OwnCost, ca.SX.sym("x"), ca.DM(1), np.sin, np, Path()),
    *(np.array([object()]), ca.Function("f", [], []), [[object()]], partial(_own_function)),
    np.ma.masked_array([1.0]),
]


@pytest.mark.parametrize("value", UNKNOWN, ids=lambda value: type(value).__name__)
def test_what_is_not_known_has_no_key(value):
    assert content_key(value) is None


def test_terms_of_the_users_have_no_key():
    problem = ergoqp.load_problem("screwing")
    cost = problem.cost
    assert isinstance(cost, SmoothReba)
    own = OwnCost(cost.taus_deg, cost.weights, cost.method, **cost.task)
    assert content_key(problem.replace(cost=own)) is None
    for term, method in (("response", "contact"), ("cost", "expression"), ("cost", "minimum")):
        changed = ergoqp.load_problem("screwing")
        object.__setattr__(getattr(changed, term), method, lambda: None)  # of one object alone
        assert content_key(changed) is None


def test_a_circle_has_no_key():
    circle: list[object] = []
    circle.append(circle)
    assert content_key(circle) is None


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of one file, which this process has loaded."""
    monkeypatch.setattr(content, "_PACKAGE", tmp_path)
    (tmp_path / "code.py").write_text("pass")
    monkeypatch.setattr(content, "LOADED", (tmp_path / "code.py").stat().st_ctime + 10.0)
    return tmp_path


def test_every_file_of_the_package_counts(package):
    keys = [content_key(1)]
    (package / "code.py").write_text("0000")
    keys.append(content_key(1))
    (package / "more.toml").touch()
    keys.append(content_key(1))
    assert None not in keys
    assert len(set(keys)) == 3


def test_a_package_that_was_changed_since_it_was_loaded_has_no_key(package, monkeypatch):
    monkeypatch.setattr(content, "LOADED", (package / "code.py").stat().st_ctime)
    assert content_key(1) is None


@pytest.mark.parametrize(
    "name", ["casadi.CasadiMeta.version", "numpy.__version__", "scipy.__version__"]
)
def test_the_libraries_count(name, monkeypatch):
    before = content_key(1)
    monkeypatch.setattr(name, "another" if name.endswith("__") else lambda: "another")
    assert content_key(1) not in (before, None)


def test_compiler_flags_and_processor_count(monkeypatch, tmp_path):
    keys = [short_key(1)]
    for name, value in (
        ("FLAGS", ("-O0",)),
        ("processor_flags", lambda: ("-mnew",)),
        ("abilities", lambda: ("new",)),
        ("compiler", lambda: ("sh",)),
        ("compiler", lambda: ("sh", "-c")),
    ):
        monkeypatch.setattr(native_compiler, name, value)
        keys.append(short_key(1))
    assert None not in keys
    assert len(set(keys)) == len(keys)


@pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler")
def test_a_function_is_found_by_its_short_key(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    function = NativeDaqp().active_set(2, 1)
    key, name = short_key("a small one"), function.name()
    assert key is not None
    assert found(name, key) is None
    keep(function, key)
    again = found(name, key)
    assert again is not None
    assert again.size_in(0) == function.size_in(0)
    assert found(name, short_key("another one") or "") is None
    note = tmp_path / f"ergoqp/compiled/{key}.key"
    for text in ("", "../elsewhere", note.read_text()[:-1]):
        note.write_text(text)
        assert found(name, key) is None
