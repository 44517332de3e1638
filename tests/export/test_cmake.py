"""The CMake file of an export: installed and found by other projects, or a part of them."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_step import load_wrapper
from step_calls import start_of

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.errors import InputError
from ergoqp.export.folder import export_step
from ergoqp.problem.problem import Problem
from ergoqp.step.stepper import Stepper

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake"),
    pytest.mark.skipif(shutil.which("g++") is None, reason="no g++"),
]

STEPS = 20
PROGRAM = """
#include <stdio.h>
#include <string.h>
#include "PREFIX_step.h"

static PREFIX_stepper stepper;

int main(void) {
    static const double posture[PREFIX_COORDINATES] = {POSTURE};
    PREFIX_input input;
    PREFIX_output output;
    int number, axis;
    PREFIX_init(&stepper);
    PREFIX_input_defaults(&input);
    memcpy(input.posture, posture, sizeof posture);
    for (number = 0; number < STEPS; ++number) {
        PREFIX_step(&stepper, &input, &output);
        for (axis = 0; axis < 6; ++axis) printf("%.17g ", output.twist[axis]);
    }
    memset(output.twist, 0xff, sizeof output.twist); /* no numbers */
    printf("%d", PREFIX_take_over(&stepper, output.twist));
    return 0;
}
"""
CONSUMER = """
cmake_minimum_required(VERSION 3.13)
project(consumer LANGUAGES LANGUAGE)
find_package(ergoqp_step 0.1 REQUIRED)
foreach(kind static shared)
  add_executable(with_${kind} SOURCE)
  target_compile_options(with_${kind} PRIVATE STANDARD -Wall -Wextra -Wpedantic -Werror)
  target_link_libraries(with_${kind} PRIVATE ergoqp_step::${kind})
endforeach()
"""
PARENT = """
cmake_minimum_required(VERSION 3.13)
project(parent LANGUAGES C)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_C_VISIBILITY_PRESET hidden)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}")
set(CMAKE_LIBRARY_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}")
set(CMAKE_ARCHIVE_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}")
add_compile_options(-Wall -Wextra -Wconversion -Werror -ffast-math)
include_directories(another)
add_library(objects OBJECT objects.c)
add_library(daqpstat STATIC $<TARGET_OBJECTS:objects>)
set(CMAKE_UNITY_BUILD ON)
add_subdirectory(step)
add_subdirectory(left_arm)
set(CMAKE_UNITY_BUILD OFF)
add_executable(main main.c)
target_link_libraries(main PRIVATE ergoqp_step::static left_arm_step::static daqpstat)
add_executable(replay replay.c)
target_link_libraries(replay PRIVATE left_arm_step::shared)
"""


def cmake(*words: str | Path) -> None:
    done = subprocess.run(["cmake", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def posture_of(problem: Problem) -> np.ndarray:
    """A state from which the object moves at once."""
    return start_of(problem) + 0.03 * np.random.default_rng(1).normal(size=len(problem.coordinates))


def program(problem: Problem, prefix: str = "ergoqp") -> str:
    """A program in C and C++ that prints the twists of an export for one state, and whether it
    takes over a twist of no numbers."""
    text = PROGRAM.replace("PREFIX_COORDINATES", f"{prefix.upper()}_COORDINATES")
    text = text.replace("PREFIX", prefix).replace("STEPS", str(STEPS))
    return text.replace("POSTURE", ", ".join(map(repr, posture_of(problem).tolist())))


def check_twists(program: Path, problem: Problem) -> None:
    """A program prints the twists that the step in Python gives, and refuses one of no numbers."""
    said = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    stepper, posture = Stepper(problem), posture_of(problem)
    expected = np.array([stepper.step(posture).twist for _ in range(STEPS)])
    assert np.abs(expected).max() > 1e-3
    *words, taken = said.split()
    found = np.array(words, dtype=float).reshape(-1, 6)
    np.testing.assert_allclose(found, expected, atol=1e-12, rtol=0)
    assert taken == "0"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, Path]:
    problem, folder = ergoqp.load_problem("forearm"), tmp_path_factory.mktemp("cmake") / "step"
    export_step(problem, folder)
    return problem, folder


@pytest.fixture(scope="module")
def prefix(exported: tuple[Problem, Path]) -> Path:
    """A folder in which the export was installed, moved since."""
    _, folder = exported
    built, first, second = (folder.parent / name for name in ("build", "first", "second"))
    cmake("-S", folder, "-B", built, "-DCMAKE_INSTALL_LIBDIR=lib")
    cmake("--build", built)
    cmake("--install", built, "--prefix", first)
    assert (built / "main").is_file()
    assert (built / "replay").is_file()
    # What is installed needs neither the folder that it was installed to nor the build.
    shutil.rmtree(built)
    return first.rename(second)


def test_it_installs_what_a_package_holds(prefix: Path) -> None:
    found = {path.relative_to(prefix).as_posix() for path in prefix.rglob("*") if path.is_file()}
    package = "lib/cmake/ergoqp_step/ergoqp_step"
    assert found == {
        "include/ergoqp_step.h",
        "include/ergoqp_memory.h",
        "lib/libergoqp_step.a",
        "lib/libergoqp_step.so",
        "lib/ergoqp_step/libdaqpstat.a",
        f"{package}Config.cmake",
        f"{package}ConfigVersion.cmake",
        f"{package}Targets.cmake",
        f"{package}Targets-release.cmake",
        "share/doc/ergoqp_step/LICENSE",
        "share/doc/ergoqp_step/LICENSE.daqp",
    }
    # A program may bring another version of DAQP.
    assert not hasattr(ctypes.CDLL(str(prefix / "lib/libergoqp_step.so")), "daqp_ldp")
    for path in (prefix / "lib/cmake").rglob("*"):
        assert path.is_dir() or str(prefix.parent) not in path.read_text(), path


@pytest.mark.parametrize(
    ("language", "standard", "source"),
    [("C", "-std=c99", "use.c"), ("CXX", "-std=c++17", "use.cpp")],
)
def test_a_project_finds_it(
    exported: tuple[Problem, Path],
    prefix: Path,
    tmp_path: Path,
    language: str,
    standard: str,
    source: str,
) -> None:
    problem, _ = exported
    (tmp_path / source).write_text(program(problem))
    text = CONSUMER.replace("LANGUAGES LANGUAGE", f"LANGUAGES {language}")
    text = text.replace("SOURCE", source).replace("STANDARD", standard)
    (tmp_path / "CMakeLists.txt").write_text(text)
    cmake("-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={prefix}")
    cmake("--build", tmp_path / "build")
    for kind in ("static", "shared"):
        check_twists(tmp_path / f"build/with_{kind}", problem)


def test_two_of_them_are_parts_of_a_project(
    exported: tuple[Problem, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem, folder = exported
    other = problem.replace(dt=0.005)
    shutil.copytree(folder, tmp_path / "step")
    second = ["export", "forearm", "--out", str(tmp_path / "left_arm"), "--dt", "0.005"]
    assert execute([*second, "--prefix", "left_arm"]) == 0
    assert "left_arm/include/left_arm_step.h" in capsys.readouterr().out
    (tmp_path / "CMakeLists.txt").write_text(PARENT)
    (tmp_path / "objects.c").write_text("int theirs(void);\nint theirs(void) { return 0; }\n")
    # The program calls the first step and has the second one inside.
    inside = "\n#include <left_arm_step.h>\nvoid* other = (void*)left_arm_step;\n"
    (tmp_path / "main.c").write_text(program(problem).replace("\nstatic", inside + "static", 1))
    (tmp_path / "replay.c").write_text(program(other, "left_arm"))
    # Another version of DAQP's headers comes first in what the project includes.
    (tmp_path / "another/daqp").mkdir(parents=True)
    (tmp_path / "another/daqp/api.h").write_text("#error another version\n")
    build = tmp_path / "build"
    cmake("-S", tmp_path, "-B", build)
    cmake("--build", build)
    check_twists(build / "main", problem)
    check_twists(build / "replay", other)
    stepper = load_wrapper(tmp_path / "left_arm", "left_arm").Stepper(
        str(build / "libleft_arm_step.so")
    )
    answer, step = stepper.step(posture_of(other)), Stepper(other).step(posture_of(other))
    np.testing.assert_allclose(answer.twist[:], step.twist, atol=1e-12, rtol=0)

    commands: list[dict[str, Any]] = json.loads((build / "compile_commands.json").read_text())
    own = {Path(one["file"]).name: one["command"].split() for one in commands}
    assert {"main.c", "objects.c", "replay.c", "ergoqp_core.c", "left_arm_core.c"} <= set(own)
    for name in ("main.c", "objects.c", "replay.c"):
        flags = {flag for flag in own[name] if flag.startswith(("-O", "-std", "-f", "-w", "-D"))}
        assert flags == {"-ffast-math", "-fvisibility=hidden"}
    for name in ("ergoqp_core.c", "left_arm_core.c"):
        assert {"-O3", "-ffp-contract=off"} <= set(own[name])
    # Examples and rules to install are not of interest to a project that did not ask for them.
    assert all("/example/" not in one["file"] for one in commands)
    assert "ergoqp_step.h" not in (build / "step/cmake_install.cmake").read_text()


def test_a_prefix_begins_all_names(exported: tuple[Problem, Path], tmp_path: Path) -> None:
    problem, folder = exported
    files = export_step(problem, tmp_path / "step", prefix="left_arm")
    assert not [file for file in files if "ergoqp_" in file.name or b"ergoqp_" in file.read_bytes()]
    # The files of both would lie beside each other.
    with pytest.raises(InputError, match=r"an earlier export whose prefix is left_arm$"):
        export_step(problem, folder, prefix="left_arm")
    export_step(problem, tmp_path / "step", prefix="left_arm")


@pytest.mark.parametrize("wrong", ["", "Left", "1st", "left-arm", "left_", 3])
def test_a_prefix_is_a_name_of_c(
    exported: tuple[Problem, Path], tmp_path: Path, wrong: Any
) -> None:
    problem, _ = exported
    with pytest.raises(InputError, match=r"^prefix: got .*, allowed lower-case letters"):
        export_step(problem, tmp_path / "step", prefix=wrong)
    assert not list(tmp_path.iterdir())
