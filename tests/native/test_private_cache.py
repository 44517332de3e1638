"""The cache of compiled code: what others could have put there is not run, nothing is compiled
twice, and what was left behind is removed."""

import ctypes
import json
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ergoqp.native import cache
from ergoqp.native import compiled as native_compiler
from ergoqp.native.compiled import CompilerError, shared_library

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler"
)
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")

SMALL = {"small.c": "int answer(void) { return 42; }"}
EVIL = {"small.c": "int answer(void) { return 666; }"}


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """The folder of the compiled files of an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache/ergoqp/compiled"


def built() -> Path:
    return shared_library("small", SMALL, [], [])


def answer(library: Path) -> int:
    return ctypes.CDLL(str(library)).answer()


def planted() -> Path:
    """Put a library in the place of another one, with the name and the record that fit it."""
    place, evil = built(), shared_library("small", EVIL, [], [])
    other = place.with_name(evil.name)
    shutil.copy(evil, other)
    other.chmod(0o700)
    record = json.loads(place.with_suffix(".json").read_text()) | {"file": evil.name}
    other.with_suffix(".json").write_text(json.dumps(record))
    place.unlink()
    return other


@needs_root
def test_a_planted_library_of_another_user_is_not_loaded():
    evil = planted()
    assert built() == evil  # nothing but its owner tells it from an own one
    os.chown(evil, 12345, -1)
    again = built()
    assert again != evil
    assert answer(again) == 42
    assert not evil.exists()


def test_a_library_that_others_can_write_to_is_not_loaded():
    evil = planted()
    evil.chmod(0o722)
    assert answer(built()) == 42
    assert not evil.exists()


def test_a_link_is_not_loaded(tmp_path):
    evil = planted()
    evil.rename(tmp_path / "elsewhere.so")
    evil.symlink_to(tmp_path / "elsewhere.so")
    assert answer(built()) == 42


@needs_root
def test_what_is_in_a_folder_of_another_user_is_not_loaded():
    evil = planted()
    os.chown(evil.parent, 12345, -1)
    assert answer(built()) == 42


@needs_root
@pytest.mark.parametrize("owned", ["cache", "cache/ergoqp", "cache/ergoqp/compiled"])
def test_a_cache_of_another_user_is_refused(tmp_path, owned):
    built()
    os.chown(tmp_path / owned, 12345, -1)
    with pytest.raises(
        CompilerError,
        match=r"compiled small: the cache '.*' cannot be used: .*(belongs to another user|other"
        r" users can write to).*; give a folder of your own with room in XDG_CACHE_HOME$",
    ):
        built()


def test_a_cache_in_a_folder_that_others_can_write_to_is_refused(tmp_path):
    built()
    (tmp_path / "cache").chmod(0o777)
    with pytest.raises(CompilerError, match=r"other users can write to '.*/cache'; give a folder"):
        built()
    (tmp_path / "cache").chmod(0o1777)  # sticky, as /tmp
    assert answer(built()) == 42


def test_the_cache_is_made_private(home):
    old = os.umask(0)
    try:
        library = built()
    finally:
        os.umask(old)
    for path in (library, library.parent, home, home.parent, home.parent.parent):
        assert stat.S_IMODE(path.stat().st_mode) == 0o700
    home.chmod(0o777)
    built()
    assert stat.S_IMODE(home.stat().st_mode) == 0o700


def test_a_relative_cache_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    assert built().is_relative_to(tmp_path / "home/.cache/ergoqp/compiled")


@pytest.mark.parametrize("other", ["version", "machine", "key"])
def test_a_library_of_another_version_or_machine_or_use_is_compiled_again(other, monkeypatch):
    library = built()
    record = library.with_suffix(".json")
    told = json.loads(record.read_text())
    record.write_text(json.dumps(told | {other: "another"}))
    calls = []
    run = native_compiler._run
    monkeypatch.setattr(native_compiler, "_run", lambda *given: (calls.append(1), run(*given)))
    assert built() == library
    assert len(calls) == 1
    assert json.loads(record.read_text()) == told
    built()
    assert len(calls) == 1


def test_two_processes_compile_a_library_once(tmp_path):
    said = tmp_path / "said"
    slow = tmp_path / "slow-cc"
    slow.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] || {{ echo x >> {said}; sleep 0.5; }}\nexec cc "$@"\n'
    )
    slow.chmod(0o755)
    code = (
        "from ergoqp.native.compiled import shared_library\n"
        f"print(shared_library('small', {SMALL!r}, [], []))"
    )
    jobs = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            env={**os.environ, "CC": str(slow)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    paths = {job.communicate()[0] for job in jobs}
    assert len(paths) == 1
    assert said.read_text() == "x\n"


def test_what_killed_compilers_left_is_removed(home):
    built()
    left = [home / name for name in ("scratch-abc", "tmpold1", "0123.lock")]
    for path in left[:2]:
        path.mkdir()
        (path / "made").write_text("half")
    left[2].touch()
    for path in left[1:]:
        os.utime(path, (0, time.time() - 2 * 3600))
    shared_library("other", {"other.c": SMALL["small.c"]}, [], [])
    assert [path.exists() for path in left] == [True, False, False]


def test_the_least_recently_used_libraries_are_removed(home, monkeypatch):
    monkeypatch.setattr(cache, "LARGEST", 3)

    def make(number: int) -> Path:
        return shared_library("small", {"small.c": f"int n = {number};"}, [], [])

    made = [make(number) for number in range(4)]
    assert all(path.exists() for path in made)  # nothing that is in use
    for age, path in enumerate(made):
        os.utime(path.parent, (0, time.time() - 2 * 3600 + age))
    make(0)
    last = make(4)
    assert [path.exists() for path in [*made, last]] == [True, False, False, True, True]


def test_a_cache_that_is_only_read_is_used(monkeypatch):
    library = built()

    def refuse(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    for name in ("mkdir", "utime", "open", "chmod"):
        monkeypatch.setattr(os, name, refuse)
    assert built() == library
    with pytest.raises(CompilerError, match=r"cannot be used: Read-only file system; give a folde"):
        shared_library("small", EVIL, [], [])
