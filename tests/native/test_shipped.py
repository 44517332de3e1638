"""A library of the package is taken if its record fits, and refused in one sentence otherwise."""

import ctypes
import json
import logging
import os
import shutil

import numpy as np
import pytest

import ergoqp
from ergoqp.native import compiled as native_compiler
from ergoqp.native import shipped as of_package
from ergoqp.native.content import value_key
from ergoqp.native.shipped import digest, machine, shipped
from ergoqp.rest.batch import settling
from ergoqp.rest.model_person import sample_person
from ergoqp.step import engine, stepper
from ergoqp.step.stepper import Stepper

LAYOUT = {"inputs": ["posture"], "state": 3}


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A file in the place of a library, with the record that fits it."""
    folder = tmp_path / "libraries"
    folder.mkdir(mode=0o755)
    monkeypatch.setattr(of_package, "FOLDER", folder)
    monkeypatch.setattr(of_package, "CDLL", lambda _: None)
    path = folder / "step-abc-baseline.so"
    path.write_bytes(b"code")
    record = {"key": "abc", "version": ergoqp.__version__, "machine": machine(), "layout": LAYOUT}
    path.with_suffix(".json").write_text(json.dumps(record | {"sha256": digest(b"code")}))
    for each in folder.iterdir():
        each.chmod(0o644)
    return path


def test_a_library_that_fits_is_taken(library, caplog):
    assert shipped("step", "abc", LAYOUT) == library
    assert shipped("step", "def", LAYOUT) is None
    assert not caplog.records


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"version": "0.0.9"}, "got one for version '0.0.9', allowed"),
        ({"machine": "linux aarch64"}, "got one for machine 'linux aarch64', allowed"),
        ({"key": "def"}, "got one for key 'def', allowed 'abc'"),
        ({"layout": {"inputs": [], "state": 3}}, "got one with other inputs or another state"),
        ({"sha256": "0"}, "it is damaged"),
    ],
)
def test_a_library_is_refused_by_its_record(library, changed, said, caplog):
    record = library.with_suffix(".json")
    record.write_text(json.dumps(json.loads(record.read_text()) | changed))
    assert shipped("step", "abc", LAYOUT) is None
    assert shipped("step", "abc", LAYOUT) is None
    (one,) = caplog.records
    assert one.levelno == logging.WARNING
    assert one.getMessage().startswith(f"shipped library {library.name} is not used: {said}")
    assert one.getMessage().endswith("; reinstall ergoqp")


def test_a_library_that_this_machine_cannot_load_is_refused(library, monkeypatch, caplog):
    monkeypatch.setattr(of_package, "CDLL", ctypes.CDLL)
    assert shipped("step", "abc", LAYOUT) is None
    assert "is not used: this machine cannot load it (" in caplog.text


@pytest.mark.parametrize("which", ["library", "record", "folder"])
def test_a_library_that_others_can_write_to_is_refused(library, which, caplog):
    record = library.with_suffix(".json")
    place = {"library": library, "record": record, "folder": library.parent}[which]
    place.chmod(place.stat().st_mode | 0o002)
    assert shipped("step", "abc", LAYOUT) is None
    assert f"other users can write to {place.name!r}" in caplog.text


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_library_of_another_user_is_refused(library, caplog):
    os.chown(library, 12345, -1)
    assert shipped("step", "abc", LAYOUT) is None
    assert f"{library.name!r} belongs to another user" in caplog.text


def test_a_library_without_a_record_is_refused(library, caplog):
    library.with_suffix(".json").unlink()
    assert shipped("step", "abc", LAYOUT) is None
    assert "its record cannot be read" in caplog.text


has_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))) or not shutil.which("readelf"),
    reason="no C compiler",
)


@pytest.mark.slow
@has_compiler
def test_without_a_compiler_few_places_are_settled_compiled(tmp_path, monkeypatch):
    from tools import libraries

    _, sources = libraries.rests(["desk", "forearm"])
    libraries.write(tmp_path, "rests", value_key(sources), None, sources, "baseline")
    native_compiler.compiler.cache_clear()
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(of_package, "FOLDER", tmp_path)
    person = sample_person(ergoqp.load_problem("desk"), 5)
    settle, comfort = settling(person, places=1), person.comfort
    assert settle != person.settle
    held = person.grasp(comfort), person.stand(comfort)
    pose = person.contact(comfort)[0]
    pose[:3, 3] += [0.02, -0.03, 0.04]
    posture, reached = settle(comfort, pose, *held)
    alone, there = person.settle(comfort, pose, *held)
    np.testing.assert_allclose(posture, alone, atol=1e-6)
    assert reached
    assert there
    native_compiler.compiler.cache_clear()


@pytest.mark.slow
@has_compiler
def test_without_a_compiler_the_first_step_is_compiled(tmp_path, monkeypatch):
    from tools import libraries

    monkeypatch.setattr("sys.argv", ["libraries", "--out", str(tmp_path), "--problems", "forearm"])
    monkeypatch.setattr(libraries, "variants", lambda: {"baseline": ()})
    libraries.main()
    native_compiler.compiler.cache_clear()
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(of_package, "FOLDER", tmp_path)
    monkeypatch.setattr(stepper, "read_choice", engine.read_choice)
    problem = ergoqp.load_problem("forearm").replace(dt=0.011)
    fast, plain = Stepper(problem), Stepper(problem, compiled=False)
    assert fast.engine == "compiled"
    for _ in range(20):
        posture = [0.1, -0.2, 1.2, 0.3, -0.2, 1.3]
        assert fast.step(posture).values.tobytes() == plain.step(posture).values.tobytes()
    assert fast.stop(0.011).shape[1] == 6
    native_compiler.compiler.cache_clear()
