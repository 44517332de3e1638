"""A loop that begins interpreted goes on compiled, with the same twists; failures are warnings."""

import logging
import os
import re
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from step_calls import wandering_steps

import ergoqp
from ergoqp.errors import InputError
from ergoqp.native import compiled as native_compiler
from ergoqp.native.compiled import one_at_a_time
from ergoqp.step import engine, stepper
from ergoqp.step.engine import Engine
from ergoqp.step.function import shared_step
from ergoqp.step.stepper import Stepper

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler"
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """An empty cache, and steppers as a user makes them."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("ERGOQP_COMPILE", raising=False)
    monkeypatch.setattr(stepper, "read_choice", engine.read_choice)
    return tmp_path / "cache"


@pytest.fixture
def at_once(monkeypatch):
    monkeypatch.setattr(engine, "PATIENCE", 0.0)


@pytest.fixture
def stand_in(monkeypatch, at_once):
    """Another function object in the place of the compiled step."""
    made = []

    def found(_: Engine):
        return made[-1] if made else None

    def compile_apart(problem, guided):
        made.append(shared_step(problem, guided=guided))

    monkeypatch.setattr(Engine, "_found", found)
    monkeypatch.setattr(engine, "_compile_apart", compile_apart)
    monkeypatch.setattr(
        engine, "engine_of", lambda function: "compiled" if function in made else "interpreted"
    )
    monkeypatch.setattr(stepper, "engine_of", engine.engine_of)


def finish(one: Stepper) -> None:
    """Step once, so that compiling begins, and wait for its end."""
    assert one._later is not None
    one.step(None)
    one._later._thread.join(120)


def warnings_of(caplog) -> list[str]:
    return [each.getMessage() for each in caplog.records if each.levelno >= logging.WARNING]


def test_a_loop_changes_in_mid_run_without_a_difference(stand_in):
    problem = ergoqp.load_problem("screwing")
    log = []
    plain, changing = Stepper(problem, compiled=False), Stepper(problem, log=log.append)
    names = list(changing._inputs)
    places = {name: changing._inputs[name].ctypes.data for name in names}
    for number, (call, one) in enumerate(wandering_steps(problem, plain, 60, seed=3)):
        if number == 30:
            changing._later._thread.join(120)
        other = changing.step(**call)
        np.testing.assert_array_equal(one.twist, other.twist)
        np.testing.assert_array_equal(plain.state(), changing.state())
    assert changing._later is None
    assert changing.engine == "compiled"
    engines = [each["engine"] for each in log]
    assert engines[0] == "interpreted"
    assert engines[30:] == ["compiled"] * 30
    # A worker of the service keeps the places of the arrays.
    assert {name: changing._inputs[name].ctypes.data for name in names} == places
    for step, entry in zip(ergoqp.replay(problem, log), log, strict=True):
        assert step.twist.shape == (6,)
        assert entry["loop"] == {"dt": problem.dt, "solver": "daqp"}


def test_loops_that_share_their_memory_change_one_after_the_other(stand_in):
    problem = ergoqp.load_problem("screwing")
    posture = problem.response.comfort + 0.1
    first, plain = Stepper(problem), Stepper(problem, compiled=False)
    loops = [first, first.sibling(), first.sibling()]
    finish(first)
    first.reset()
    want = [plain.step(posture).twist, plain.step(posture).twist]
    for loop in loops:
        for twist in want:
            np.testing.assert_array_equal(loop.step(posture).twist, twist)
        assert loop.engine == "compiled"
        loops[-1].reset()


def test_nothing_is_compiled_before_ten_seconds_of_stepping(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(engine.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(Engine, "_work", lambda _: None)
    one = Stepper(ergoqp.load_problem("forearm"))
    now[0] = 1000.0  # a long pause is not stepping
    for _ in range(90):
        one.step(None)
        now[0] += 0.1
    assert one._later._thread is None
    for _ in range(20):
        one.step(None)
        now[0] += 0.1
    assert one._later._thread is not None


def test_the_environment_forbids_it(monkeypatch, at_once):
    monkeypatch.setenv("ERGOQP_COMPILE", "never")
    one = Stepper(ergoqp.load_problem("forearm"))
    assert one._later is None
    assert one.step(None).status == "braking"


@pytest.mark.parametrize("solver", ["osqp", "daqp"])
def test_only_what_can_be_compiled_waits_for_it(solver):
    one = Stepper(ergoqp.load_problem("forearm"), solver=solver)
    assert (one._later is not None) == (solver == "daqp")


def test_a_wrong_choice_is_one_sentence():
    with pytest.raises(InputError, match="compiled: got 'fast', allowed 'auto', True or False"):
        Stepper(ergoqp.load_problem("forearm"), compiled="fast")  # type: ignore[arg-type]


FAILURES = {
    "no compiler": "C compiler: found CC='.*nothing', which is not a program here; install one",
    "failing": "C compiler '.*failing' failed: it is tired",
    "no cache": "compiled step: the cache '.*' cannot be used: .*; give a folder of your own",
    "killed": "the process that compiled it was ended by SIGKILL",
    "no process": "FileNotFoundError",
}


@needs_compiler
@pytest.mark.parametrize("failure", FAILURES)
def test_what_fails_is_a_warning_and_the_loop_goes_on(
    failure, cache, tmp_path, monkeypatch, caplog, at_once
):
    problem = ergoqp.load_problem("forearm")
    one, plain = Stepper(problem), Stepper(problem, compiled=False)
    command = tmp_path / failure
    if failure == "no compiler":
        monkeypatch.setenv("CC", str(tmp_path / "nothing"))
    if failure == "failing":
        command.write_text(
            "#!/bin/sh\necho error: it is tired >&2; exit 1\n".replace("error: ", "")
        )
        command.chmod(0o755)
        monkeypatch.setenv("CC", str(command))
    if failure == "no cache":
        cache.write_text("a file where a folder belongs")
    if failure == "killed":
        command.write_text("#!/bin/sh\nkill -9 $$\n")
        command.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(command))
    if failure == "no process":
        monkeypatch.setattr(sys, "executable", str(tmp_path / "nothing"))
    with caplog.at_level(logging.INFO):
        finish(one)
    plain.step(None)
    [warning] = warnings_of(caplog)
    assert warning.startswith("the step of forearm goes on interpreted: ")
    caplog.clear()
    assert re.search(FAILURES[failure], warning)
    posture = np.full(len(problem.coordinates), 0.1)
    for _ in range(3):
        np.testing.assert_array_equal(one.step(posture).twist, plain.step(posture).twist)
    assert one.engine == "interpreted"
    assert one._later is None
    assert not warnings_of(caplog)


def test_terms_of_the_users_are_compiled_only_by_request(caplog, at_once):
    problem = ergoqp.load_problem("forearm")

    class Own(type(problem.cost)):
        """A cost whose code is not that of the package."""

    cost = object.__new__(Own)
    vars(cost).update(vars(problem.cost))
    one = Stepper(problem.replace(cost=cost))
    finish(one)
    [warning] = warnings_of(caplog)
    assert "only its C code tells what it computes" in warning


def test_a_cache_that_is_not_the_users_alone_is_a_warning(cache, caplog):
    (cache / "ergoqp/compiled").mkdir(parents=True)
    cache.chmod(0o777)
    one = Stepper(ergoqp.load_problem("forearm"))
    [warning] = warnings_of(caplog)
    assert "other users can write to" in warning
    assert one.engine == "interpreted"
    assert one._later is None


@needs_compiler
def test_one_process_of_a_user_compiles_at_a_time():
    code = (
        "from ergoqp.native.compiled import one_at_a_time\n"
        "with one_at_a_time('step'): print('its turn', flush=True)"
    )
    with one_at_a_time("step"):
        other = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        time.sleep(1.0)
        assert other.poll() is None
    assert other.communicate(timeout=60)[0] == "its turn\n"


@pytest.mark.slow
@needs_compiler
def test_a_step_is_compiled_beside_the_loop(monkeypatch, at_once, caplog):
    problem = ergoqp.load_problem("screwing")
    plain, changing = Stepper(problem, compiled=False), Stepper(problem)
    assert changing.engine == "interpreted"
    with caplog.at_level(logging.INFO):
        for number, (call, one) in enumerate(wandering_steps(problem, plain, 400, seed=3)):
            if number == 150:
                changing._later._thread.join(120)
            other = changing.step(**call)
            np.testing.assert_array_equal(one.twist, other.twist)
            assert one.status == other.status
    assert changing.engine == "compiled"
    said = [each.getMessage() for each in caplog.records]
    assert said[0] == "the step of screwing is compiled in the background"
    assert said[1].startswith("the step of screwing is compiled, after ")
    np.testing.assert_allclose(changing.stop(), plain.stop(), atol=1e-12)

    # From now on it is there at once, without a word of C.
    monkeypatch.setattr(native_compiler, "generated", lambda *_: pytest.fail("wrote C"))
    again = Stepper(ergoqp.load_problem("screwing"))
    assert again.engine == "compiled"
    assert again._later is None
    assert Stepper(problem, compiled=True).engine == "compiled"
    number, structure = ergoqp.Control(max_age=0.123), ergoqp.Control(average=0.3)
    assert Stepper(problem.replace(control=number)).engine == "compiled"
    assert Stepper(problem.replace(control=structure)).engine == "interpreted"


def test_the_process_that_compiles_has_the_lowest_priority(monkeypatch):
    found = []
    monkeypatch.setattr(os, "nice", found.append)
    monkeypatch.setattr(engine.pickle, "load", lambda _: sys.exit("enough"))
    with pytest.raises(SystemExit, match="enough"):
        engine.compile_ordered()
    assert found == [19]


@pytest.mark.parametrize(("switch", "calls"), [("never", 0), ("", 1)])
def test_the_service_compiles_beside_serving_unless_that_is_forbidden(
    switch, calls, monkeypatch, tmp_path
):
    from typer.testing import CliRunner

    from ergoqp.cli import serve
    from ergoqp.cli.main import app

    class Supervised:
        listeners = ()
        begun = 0

        def __init__(self, *_):
            pass

        def open_json_door(self, _):
            return []

        def compile_beside(self):
            Supervised.begun += 1

        def run(self):
            pass

    monkeypatch.setattr(serve, "Supervisor", Supervised)
    monkeypatch.setenv("ERGOQP_COMPILE", switch)
    done = CliRunner().invoke(app, ["serve", "forearm", "--dir", str(tmp_path / "s")])
    assert (done.exit_code, Supervised.begun) == (0, calls), done.output
