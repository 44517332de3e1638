"""The compiled step gives what the interpreted one gives, and says what is missing when it cannot
be made."""

import errno
import os
import resource
import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from step_calls import wandering_steps

import ergoqp
from ergoqp.errors import InputError
from ergoqp.native import compiled
from ergoqp.native import compiled as native_compiler
from ergoqp.native.compiled import CompilerError, NativeDaqp, generated, shared_library
from ergoqp.solvers import solver_named
from ergoqp.step.qp import TOLERANCE
from ergoqp.step.stepper import Stepper

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler"
)


@pytest.fixture(params=["no-such-compiler", '"'])
def no_compiler(request, monkeypatch):
    native_compiler.compiler.cache_clear()
    monkeypatch.setenv("CC", request.param)
    yield
    native_compiler.compiler.cache_clear()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "low_bin", "forearm"])
def test_compiled_answers_are_those_of_the_interpreted_step_to_the_last_bit(name):
    problem = ergoqp.load_problem(name)
    plain, fast = Stepper(problem), Stepper(problem, compiled=True)
    statuses = set()
    for call, one in wandering_steps(problem, plain, 400, seed=3):
        other = fast.step(**call)
        statuses.add(one.status)
        # What a solver leaves behind when it gives up is its own.
        left = () if one.residuals["qp"] < TOLERANCE else ("slack", "multipliers", "residuals")
        for output in set(fast.evaluator.slices) - set(left):
            assert other.account(output).tobytes() == one.account(output).tobytes(), output
    assert len(statuses) > 2


def test_compiled_products_of_matrices_are_the_interpreted_ones_to_the_last_bit(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    inputs, products = [], []
    for rows, columns, count in ((1, 20, 1), (1, 20, 7), (1, 20, 8), (5, 33, 1), (3, 4, 6)):
        x, y = ca.MX.sym("x", rows, columns), ca.MX.sym("y", columns, count)
        inputs += [x, y]
        products += [x @ y, ca.mac(y.T, x.T, ca.DM.ones(count, rows))]
    function = ca.Function("products", inputs, products)
    fast, rng = compiled.compiled(lambda _: function), np.random.default_rng(0)
    given = [rng.normal(size=each.shape) for each in inputs]
    for one, other in zip(fast(*given), function(*given), strict=True):
        assert np.array(one).tobytes() == np.array(other).tobytes()


@pytest.mark.slow
def test_compiled_it_takes_over_and_brakes_alike():
    problem = ergoqp.load_problem("screwing")
    steppers = Stepper(problem), Stepper(problem, compiled=True)
    moving = 0.6 * problem.twist_limit.speed
    for stepper in steppers:
        stepper.reset(twist=moving)
    for dt, elapsed in ((None, 0.0), (0.02, 0.0), (0.005, 0.07)):
        one, other = (stepper.brake(dt, elapsed) for stepper in steppers)
        assert 0 < np.abs(one.twist).max() < 0.6
        assert other.values.tobytes() == one.values.tobytes()


@pytest.mark.slow
def test_a_second_stepper_finds_the_library_again(monkeypatch):
    problem = ergoqp.load_problem("screwing")
    Stepper(problem, compiled=True)
    monkeypatch.setattr(native_compiler, "_run", lambda *_: pytest.fail("compiled again"))
    Stepper(problem, compiled=True)


def test_only_daqp_is_compiled():
    with pytest.raises(InputError, match="compiled: got the solver 'osqp', allowed only 'daqp'"):
        Stepper(ergoqp.load_problem("screwing"), solver="osqp", compiled=True)


def test_no_compiler_is_one_sentence(no_compiler, monkeypatch, tmp_path):
    """With an empty cache; a library that is there needs none."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(
        CompilerError, match=r"C compiler: found CC='.*', which is not a program here; install"
    ):
        Stepper(ergoqp.load_problem("screwing"), compiled=True)


def test_a_compiler_that_fails_is_quoted(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(CompilerError, match=r"failed: broken\.c:1.*error"):
        shared_library("broken", {"broken.c": "this is not C"}, [], [])
    assert [each.suffix for each in (tmp_path / "ergoqp/compiled").iterdir()] == [".lock"]


@pytest.mark.parametrize("case", ["solvable", "infeasible", "indefinite", "not a number"])
def test_the_solver_in_c_agrees_with_the_plugin(case):
    rng = np.random.default_rng(1)
    native, plugin = NativeDaqp().function(6, 9), solver_named("daqp").function(6, 9)
    for _ in range(50):
        root, A = rng.normal(size=(6, 6)), rng.normal(size=(9, 6))
        H, g = root @ root.T + 0.1 * np.eye(6), rng.normal(size=6)
        lower, upper = -rng.random(9), rng.random(9)
        if case == "infeasible":
            A[1], lower[0], upper[1] = A[0], 1.0, -1.0
            upper[0], lower[1] = 2.0, -2.0
        if case == "indefinite":
            H = -H
        if case == "not a number":
            g[0] = np.nan
        box = np.full(6, 2.0)
        x, rows, bounds = (
            np.array(part).ravel() for part in native(H, g, A, lower, upper, -box, box)
        )
        if case == "solvable":
            expected = [np.array(part).ravel() for part in plugin(H, g, A, lower, upper, -box, box)]
            for have, want in zip((x, rows, bounds), expected, strict=True):
                np.testing.assert_array_equal(have, want)
        else:
            assert np.isnan(x).any()


def test_unknowns_that_are_alone_are_left_out_and_answered_with_zero():
    rng = np.random.default_rng(2)
    n, m, alone = 12, 5, [3, 7, 8, 11]
    native, plugin = NativeDaqp().function(n, m), solver_named("daqp").function(n, m)
    for _ in range(50):
        root, A, g = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
        H = root @ root.T + 0.1 * np.eye(n)
        H[alone, :], H[:, alone], A[:, alone], g[alone] = 0.0, 0.0, 0.0, 0.0
        H[alone, alone] = 1.0
        data = (H, g, A, -rng.random(m), rng.random(m), -np.ones(n), np.ones(n))
        have = [np.array(part).ravel() for part in native(*data)]
        want = [np.array(part).ravel() for part in plugin(*data)]
        assert not have[0][alone].any()
        for one, other in zip(have, want, strict=True):
            np.testing.assert_array_equal(one, other)


def test_leaving_out_unknowns_changes_no_bit_where_every_other_one_is_at_its_end():
    """The relaxed QP of an object outside its limits: all rates at their ends, and one slack."""
    rng, n, m = np.random.default_rng(5), 12, 8
    native, plugin = NativeDaqp().function(n, m), solver_named("daqp").function(n, m)
    H, A, g, lb, ub = np.eye(n), np.zeros((m, n)), np.zeros(n), np.zeros(n), np.ones(n)
    A[0, 6], g[6] = -1.0, 1e4
    free = np.full(m, np.inf)
    for _ in range(3000):
        root = rng.normal(size=(6, 6)) * 10 ** rng.uniform(-2, 1, 6)
        H[:6, :6] = root @ root.T + 1e-3 * np.eye(6)
        A[0, :6], g[:6] = rng.normal(size=6), 10 * rng.normal(size=6)
        middle = 0.1 * rng.normal(size=6)
        lb[:6], ub[:6] = middle - 0.02, middle + 0.02
        upper = free.copy()
        upper[0] = A[0, :6] @ middle - 0.02 * np.abs(A[0, :6]).sum() - 0.01
        data = (H, g, A, -free, upper, lb, ub)
        for one, other in zip(native(*data), plugin(*data), strict=True):
            np.testing.assert_array_equal(np.array(one), np.array(other))


SMALL = {"small.c": "double twice(double x) { return 2 * x; }"}


@pytest.mark.parametrize("left", [0, 100, -1])
def test_a_library_that_was_cut_off_is_compiled_again(left, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = shared_library("small", SMALL, [], [])
    whole = path.read_bytes()
    path.write_bytes(whole[:left])
    again = shared_library("small", SMALL, [], [])
    assert again.read_bytes() == whole
    assert sorted(each.suffix for each in again.parent.iterdir()) == [".json", ".so"]


@pytest.mark.parametrize("command", ["true", "echo"])
def test_a_compiler_that_writes_nothing_is_named(command, tmp_path, monkeypatch):
    native_compiler.compiler.cache_clear()
    monkeypatch.setenv("CC", command)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    try:
        with pytest.raises(
            CompilerError,
            match=f"C compiler: '{command}' wrote no file; name a C compiler",
        ):
            shared_library("small", SMALL, [], [])
    finally:
        native_compiler.compiler.cache_clear()


def test_a_cache_that_cannot_be_written_to_is_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "ergoqp").write_text("a file where a folder belongs")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(
        CompilerError,
        match=r"compiled small: the cache '.*' cannot be used: .*; give a folder of your own",
    ):
        shared_library("small", SMALL, [], [])


def test_a_full_disk_is_one_sentence(tmp_path, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(
        CompilerError,
        match=r"compiled small: the cache .* cannot be used: No space left on device",
    ):
        shared_library("small", SMALL, [], [])


def test_a_library_that_cannot_be_loaded_is_one_sentence(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    other = tmp_path / "other.so"
    other.write_bytes(b"not a library" * 1000)
    monkeypatch.setattr(compiled, "shared_library", lambda *_: other)
    with pytest.raises(
        CompilerError, match=r"compiled \w+: the library '.*other\.so' cannot be loaded: "
    ):
        Stepper(ergoqp.load_problem("forearm"), compiled=True)


def test_code_that_a_full_disk_cut_off_is_not_compiled():
    """CasADi's generator does not say when it cannot write: half of the code went to the
    compiler."""
    x = ca.SX.sym("x", 300)
    function = ca.Function("f", [x], [ca.sin(x) + ca.cos(x)])
    assert generated(function, "f")["f.c"].endswith("#endif\n")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(CompilerError, match=r"is cut off; give a folder with room"):
            generated(function, "f")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("flags\t\t: fpu avx2 bmi1 bmi2 fma sse\n", ("-mavx2", "-mbmi", "-mbmi2", "-mfma")),
        ("flags\t\t: fpu avx2 bmi1 bmi2 sse\n", ()),
        ("Features\t: fp asimd\n", ()),
        (None, ()),
    ],
)
def test_the_flags_are_those_of_the_processor(monkeypatch, text, expected):
    def read(path, **_):
        if text is None:
            raise FileNotFoundError
        return text

    kept = compiled.processor_flags, compiled.abilities
    for each in kept:
        each.cache_clear()
    monkeypatch.setattr(Path, "read_text", read)
    assert compiled.processor_flags() == expected
    for each in kept:
        each.cache_clear()
