"""The exported step: built by its own CMake file, run without ergoqp, and equal to the step in
Python."""

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from exported_step import SOURCES, build, load_wrapper
from step_calls import start_of, wandering_steps

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.errors import InputError
from ergoqp.export.folder import example_start, export_step, start_header
from ergoqp.export.layout import c_string, header
from ergoqp.step.causes import Status
from ergoqp.step.frames_check import DOUBTED
from ergoqp.step.stepper import Stepper

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")

COUNTED = """
#include <stdlib.h>
static long taken;
void* __real_malloc(size_t n);
void* __real_calloc(size_t n, size_t m);
void* __real_realloc(void* p, size_t n);
void* __wrap_malloc(size_t n) { ++taken; return __real_malloc(n); }
void* __wrap_calloc(size_t n, size_t m) { ++taken; return __real_calloc(n, m); }
void* __wrap_realloc(void* p, size_t n) { ++taken; return __real_realloc(p, n); }
#include "ergoqp_step.h"
static ergoqp_stepper stepper;
int main(void) {
    ergoqp_input input;
    ergoqp_output output;
    int i;
    ergoqp_init(&stepper);
    ergoqp_input_defaults(&input);
    for (i = 0; i < 500; ++i) ergoqp_step(&stepper, &input, &output);
    return (int)taken;
}
"""
CPLUSPLUS = """
#include "ergoqp_step.h"
static ergoqp_stepper stepper;
int main() {
    ergoqp_input input;
    ergoqp_output output;
    ergoqp_init(&stepper);
    ergoqp_input_defaults(&input);
    return ergoqp_step(&stepper, &input, &output) > ERGOQP_RECOVERING;
}
"""


FAULTS = """
#define main example
#include "main.c"
#undef main
int main(void) {
    static ergoqp_output output;
    int i;
    output.status = ERGOQP_BRAKING;
    output.causes = 1 << ERGOQP_CAUSE_ROBOT;
    for (i = 0; i < ERGOQP_FAULTS; ++i) {
        output.fault = i;
        output.fault_amount = *ergoqp_fault_units[i] || i == ERGOQP_FAULT_FACTOR ? 0.25 : 0.0;
        print_reason(&output);
        printf("\\n");
    }
    return 0;
}
"""


@pytest.fixture(scope="module", params=["screwing", "forearm"])
def exported(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export") / "step"
    problem = ergoqp.load_problem(request.param)
    export_step(problem, folder)
    library = build(folder)
    return problem, folder, library


def away_from_rest(problem):
    """A state from which the object moves at once."""
    return start_of(problem) + 0.03 * np.random.default_rng(1).normal(size=len(problem.coordinates))


def c_call(call):
    """Keyword arguments of `Stepper.step` as the wrapper of the exported step takes them."""
    given = {name: value for name, value in call.items() if name != "posture"}
    return call["posture"], given


@pytest.mark.slow
def test_the_exported_step_gives_what_python_gives(exported):
    problem, folder, library = exported
    stepper, other = Stepper(problem), load_wrapper(folder).Stepper(str(library))
    seen, off = set(), 1e-12
    for call, step in wandering_steps(problem, stepper, 300, seed=5):
        posture, given = c_call(call)
        answer = other.step(posture, **given)
        seen.add(step.status)
        assert Status(answer.status).name == step.status
        # Where rows give way, their penalty makes more of the last digits, and the loop goes on
        # from there.
        off = 1e-9 if step.slack else off
        np.testing.assert_allclose(answer.twist[:], step.twist, atol=off, rtol=0)
        np.testing.assert_allclose(answer.posture_rate[:], step.posture_rate, atol=off, rtol=0)
        np.testing.assert_allclose(answer.pose[:], step.pose.ravel(), atol=off, rtol=0)
        np.testing.assert_allclose(answer.margins[:], list(step.margins.values()), atol=off, rtol=0)
        assert answer.causes == step.account("causes")[0]
        kind, amount = step.account("fault")
        assert answer.fault == kind
        assert answer.fault_amount == pytest.approx(amount, abs=1e-9)
        frames = step.account("frames")
        assert (answer.apart, answer.apart_angle) == pytest.approx(tuple(frames[4:]), abs=1e-9)
        assert answer.doubted == (frames[2] >= DOUBTED)
    assert {"braking", "invalid"} < seen


def test_the_wrapper_names_what_it_cannot_take(exported):
    problem, folder, library = exported
    stepper, posture = load_wrapper(folder).Stepper(str(library)), start_of(problem)
    with pytest.raises(ValueError, match="pose: got 3 numbers, allowed 16"):
        stepper.step(posture, pose=[1, 2, 3])
    with pytest.raises(ValueError, match=f"posture: got 2 numbers, allowed {len(posture)}"):
        stepper.step([0.0, 0.0])
    with pytest.raises(
        ValueError, match="speed: got no member of that name, allowed posture, observed"
    ):
        stepper.step(posture, speed=1)


def test_names_of_any_letters_are_literals_of_c(tmp_path):
    wild = 'we"ird \\ \n ??/ */ é'
    (tmp_path / "main.c").write_text(
        f"#include <stdio.h>\nint main(void) {{ fputs({c_string(wild)}, stdout); return 0; }}\n"
    )
    subprocess.run(
        ["gcc", "-std=c99", "-Wall", "-Werror", "main.c", "-o", "main"], cwd=tmp_path, check=True
    )
    assert (
        subprocess.run(["./main"], cwd=tmp_path, capture_output=True, check=True).stdout.decode()
        == wild
    )
    assert c_string("\x1f ~\x7f") == '"\\037 ~\\177"'
    quoted = 'we"ird ?? é'
    named = header(replace(ergoqp.load_problem("screwing"), name=quoted))
    assert named.startswith(f'/* The control step of problem "{quoted}", exported by')
    assert f"#define ERGOQP_PROBLEM {c_string(quoted)}\n" in named


def test_reset_starts_again_from_standstill(exported):
    problem, folder, library = exported
    stepper = load_wrapper(folder).Stepper(str(library))
    posture = away_from_rest(problem)
    first = [stepper.step(posture).twist[:] for _ in range(5)]
    stepper.reset()
    assert [stepper.step(posture).twist[:] for _ in range(5)] == first
    assert first[0] != first[1]


def state_of(folder, other):
    """The state within the memory of the exported step."""
    text = (folder / "include/ergoqp_memory.h").read_text()
    sizes = (f"ERGOQP_{kind}" for kind in ("INPUT_DOUBLES", "OUTPUT_DOUBLES", "STATE"))
    before, after, count = (int(re.search(rf"{name} (\d+)\n", text)[1]) for name in sizes)
    return np.frombuffer(other._memory, offset=8 * (before + after), count=count)


def test_it_tells_the_stop_in_advance_as_python_does(exported):
    problem, folder, library = exported
    stepper, other = Stepper(problem), load_wrapper(folder).Stepper(str(library))
    assert other.stop() == [[0.0] * 6]
    posture, longest = away_from_rest(problem), 0
    for number in range(40):
        stepper.step(posture, dt=0.004 + 0.002 * (number % 5))
        other.step(posture, dt=0.004 + 0.002 * (number % 5))
        expected, found = stepper.stop(), np.array(other.stop())
        assert not found[-1].any()
        both, longest = min(len(expected), len(found)), max(longest, len(found))
        np.testing.assert_allclose(found[:both], expected[:both], atol=1e-12, rtol=0)
        assert not (np.abs(expected[both:]) > 1e-12).any()
    assert longest > 5
    # Nothing has changed, and it is what brake gives.
    stop = other.stop()
    braked = [other.brake().twist[:] for _ in stop]
    np.testing.assert_allclose(stop, braked, atol=1e-12, rtol=0)


def test_it_takes_over_a_moving_object_as_python_does(exported):
    problem, folder, library = exported
    stepper, other, posture = (
        Stepper(problem),
        load_wrapper(folder).Stepper(str(library)),
        start_of(problem),
    )
    speed = problem.twist_limit.speed
    # The last one is clipped. Elbow and wrist move alike: a twist that would change the forearm's
    # length cannot be kept.
    for moving in (0.3 * speed, -speed, np.array([3.0, -1, 1, 3.0, -1, 1]) * speed):
        stepper.reset(twist=moving)
        other.take_over(moving)
        np.testing.assert_array_equal(state_of(folder, other), stepper.state())
        for number in range(12):
            step, answer = stepper.step(posture), other.step(posture)
            np.testing.assert_allclose(answer.twist[:], step.twist, atol=1e-12, rtol=0)
            if number == 0:
                assert (
                    np.abs(step.twist - np.clip(moving, -speed, speed)).max()
                    < 0.2 * np.abs(moving).max()
                )
    with pytest.raises(ValueError, match="twist: got a number that is not finite"):
        other.take_over([0.0, np.nan, 0, 0, 0, 0])
    # What was refused has changed nothing.
    step, answer = stepper.step(posture), other.step(posture)
    np.testing.assert_allclose(answer.twist[:], step.twist, atol=1e-12, rtol=0)


def test_a_copy_shows_the_stop_in_advance(exported):
    problem, folder, library = exported
    wrapper, stepper, posture = load_wrapper(folder), Stepper(problem), away_from_rest(problem)
    other, copy = wrapper.Stepper(str(library)), wrapper.Stepper(str(library))
    for _ in range(10):
        stepper.step(posture)
        other.step(posture)
    ctypes.memmove(copy._memory, other._memory, len(other._memory))
    ahead = stepper.stop()
    told = np.array([copy.brake().twist[:] for _ in ahead])
    np.testing.assert_allclose(told, ahead, atol=1e-12, rtol=0)
    np.testing.assert_allclose(other.brake().twist[:], ahead[0], atol=1e-12, rtol=0)


def test_it_brakes_without_data_as_python_does(exported):
    problem, folder, library = exported
    stepper, other, posture = (
        Stepper(problem),
        load_wrapper(folder).Stepper(str(library)),
        away_from_rest(problem),
    )

    def both(call, *arguments, **given):
        step, answer = (getattr(one, call)(*arguments, **given) for one in (stepper, other))
        assert Status(answer.status).name == step.status
        assert answer.causes == step.account("causes")[0]
        np.testing.assert_allclose(answer.twist[:], step.twist, atol=1e-12, rtol=0)
        np.testing.assert_allclose(answer.pose[:], step.pose.ravel(), atol=1e-12, rtol=0)
        return step

    moving = 0.5 * problem.twist_limit.speed
    # Braking once, with another period, after the robot's own ramp, and going on from there.
    for calls in (
        [{}, {}],
        [{"dt": 0.003}],
        [{"elapsed": 0.013}],
        [{"dt": 0.02, "elapsed": 0.1}, {}],
        [{"elapsed": 100.0}],
    ):
        stepper.reset(twist=moving)
        other.take_over(moving)
        both("step", posture)
        for given in calls:
            assert both("brake", **given).status == "braking"
        for _ in range(5):
            both("step", posture)
    for elapsed in (-1.0, float("nan")):
        assert both("brake", elapsed=elapsed).status == "invalid"
    stepper.reset(twist=moving)
    other.take_over(moving)
    while both("brake").twist.any():
        pass


def test_it_tries_again_after_wrong_frames_as_python_does(exported):
    problem, folder, library = exported
    stepper, other = Stepper(problem), load_wrapper(folder).Stepper(str(library))
    if not stepper._model.compares:
        pytest.skip("the problem has no person, so no frames are compared")
    posture = problem.response.comfort
    wrong = np.array(problem.response.contact()(posture)[0])
    wrong[:3, 3] += [0.3, 0.5, 0.0]
    said = []
    for number in range(120):
        step = stepper.step(posture, wrong)
        answer = other.step(posture, pose=wrong.ravel())
        assert answer.causes == step.account("causes")[0]
        said.append("frames:" in step.reason)
        if number == 90:
            stepper.try_again()
            other.try_again()
    assert said[90]
    assert not said[91]


def test_the_wrapper_reserves_enough_memory(exported, tmp_path):
    _, folder, _ = exported
    (tmp_path / "size.c").write_text(
        '#include <stdio.h>\n#include "ergoqp_step.h"\n'
        'int main(void) { printf("%zu %zu %zu",'
        " sizeof(ergoqp_stepper), sizeof(ergoqp_input), sizeof(ergoqp_output)); return 0; }"
    )
    subprocess.run(["gcc", f"-I{folder}/include", "size.c", "-o", "size"], cwd=tmp_path, check=True)
    sizes = [
        int(word)
        for word in subprocess.run(
            ["./size"], cwd=tmp_path, capture_output=True, text=True
        ).stdout.split()
    ]
    wrapper = load_wrapper(folder)
    reserved = int(
        re.search(
            r"create_string_buffer\((\d+)\)", (folder / "python/ergoqp_step.py").read_text()
        ).group(1)
    )
    assert sizes == [
        min(reserved, sizes[0]),
        ctypes.sizeof(wrapper.Input),
        ctypes.sizeof(wrapper.Output),
    ]


@pytest.mark.slow
def test_no_memory_is_allocated(exported, tmp_path):
    _, folder, _ = exported
    (tmp_path / "counted.c").write_text(COUNTED)
    wrapped = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc")]
    sources = [str(folder / source) for source in SOURCES]
    folders = [f"-I{folder}/{name}" for name in ("include", "src", "daqp/include")]
    library = str(folder / "daqp/lib/libdaqpstat.a")
    subprocess.run(
        ["gcc", *folders, "counted.c", *sources, library, "-lm", *wrapped, "-o", "counted"],
        cwd=tmp_path,
        check=True,
    )
    assert subprocess.run(["./counted"], cwd=tmp_path, check=False).returncode == 0


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_the_header_is_for_cplusplus_too(exported, tmp_path):
    _, folder, library = exported
    (tmp_path / "main.cpp").write_text(CPLUSPLUS)
    command = [
        "g++",
        "-Wall",
        "-Werror",
        f"-I{folder}/include",
        "main.cpp",
        str(library),
        f"-Wl,-rpath,{library.parent}",
    ]
    subprocess.run([*command, "-o", "main"], cwd=tmp_path, check=True)
    assert subprocess.run(["./main"], cwd=tmp_path, check=False).returncode == 0


@pytest.mark.parametrize("exported", ["forearm"], indirect=True)
def test_the_example_names_a_fault_and_its_amount(exported, tmp_path):
    _, folder, library = exported
    (tmp_path / "faults.c").write_text(FAULTS)
    flags = ["-std=c99", "-Wall", "-Werror", f"-I{folder}/include", f"-I{folder}/example"]
    command = ["gcc", *flags, "faults.c", str(library), f"-Wl,-rpath,{library.parent}"]
    subprocess.run([*command, "-o", "faults"], cwd=tmp_path, check=True)
    said = subprocess.run(["./faults"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert said.stdout.splitlines() == [
        " robot",
        " robot (stands_still)",
        " robot (factor 0.25)",
        " robot (another_axis)",
        " robot (late 0.25 s)",
        " robot (unasked)",
        " robot (pose_jumps 0.25 m)",
        " robot (pose_turns 0.25 rad)",
        " robot (speed_jumps 0.25 m/s, rad/s)",
        " robot (position_scatters 0.25 m)",
        " robot (orientation_scatters 0.25 rad)",
    ]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")
def test_the_command_writes_what_its_cmake_file_builds(tmp_path, capsys):
    folder = tmp_path / "step"
    assert execute(["export", "screwing", "--out", str(folder), "--dt", "0.005"]) == 0
    assert "ergoqp_step.h" in capsys.readouterr().out
    for command in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]):
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    assert re.search(r"^build/main$", (folder / "README.md").read_text(), re.MULTILINE)

    def shown(*arguments):
        return subprocess.run(
            ["build/main", *arguments], cwd=folder, check=True, capture_output=True, text=True
        ).stdout

    said = shown()
    assert re.search(r"^ +0\.0 s +\w+ +cost", said)
    costs = [float(value) for value in re.findall(r" s +\w+ +cost +([\d.]+)", said)]
    assert len(costs) == 11
    assert costs[-1] < costs[0] - 2
    assert "settled" in said
    assert "rad/s moving would gain too little\n" in said
    summary = f"cost of the posture: {costs[0]:.2f} at the start, {costs[-1]:.2f} after 10 s\n"
    assert said.endswith(summary + "without a frame: braking, no_frame\n")
    # Far from the workspace the object comes back: the reason names the rows.
    other = shown("right_shoulder_flexion=2.9", "right_elbow_flexion=0.1")
    assert re.search(r"recovering .* workspace y outside by [\d.]+ m;", other)
    for wrong in ("right_elbow=1", "right_elbow_flexion", "right_elbow_flexion=x"):
        done = subprocess.run(
            ["build/main", wrong], cwd=folder, check=False, capture_output=True, text=True
        )
        assert (done.returncode, done.stdout) == (2, "")
        assert "allowed NAME=VALUE, such as trunk_flexion=0.5" in done.stderr
    assert "@" not in (folder / "README.md").read_text()

    (folder / "inputs").write_bytes(b"\0" * 10)
    assert (
        subprocess.run(
            ["build/replay", "inputs", "outputs"], cwd=folder, capture_output=True, check=False
        ).returncode
        == 2
    )


def configured(folder, *options):
    """Whether CMake can build an export with these options, and what it says if not."""
    done = subprocess.run(
        ["cmake", "-S", str(folder), *options], capture_output=True, text=True, check=False
    )
    return done.returncode == 0, " ".join(done.stderr.split())


@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")
@pytest.mark.parametrize("exported", ["forearm"], indirect=True)
def test_a_library_for_another_machine_is_told_with_the_way_out(exported, tmp_path):
    _, folder, _ = exported
    library = bytearray((folder / "daqp/lib/libdaqpstat.a").read_bytes())
    for part in re.finditer(b"\x7fELF", bytes(library)):
        library[part.start() + 18] = 243  # the field of the machine: RISC-V
    (tmp_path / "other.a").write_bytes(library)
    well, said = configured(
        folder, "-B", str(tmp_path / "build"), f"-DDAQP_LIBRARY={tmp_path / 'other.a'}"
    )
    assert not well
    assert "other.a', which cannot be linked for Linux" in said
    assert "-DDAQP_SOURCE=/path/to/daqp" in said


@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")
@pytest.mark.parametrize("exported", ["forearm"], indirect=True)
def test_daqp_is_built_from_the_sources_that_are_named(exported, tmp_path):
    _, folder, _ = exported
    # No package brings the sources; its headers and one file stand in for them.
    source, build = tmp_path / "daqp/csrc", tmp_path / "build"
    shutil.copytree(folder / "daqp/include/daqp", source / "include")
    (source / "src").mkdir()
    (source / "src/daqp.c").write_text(
        '#include "types.h"\nint stand_in(void) { return (int)sizeof(DAQPSettings); }\n'
    )
    options = "-B", str(build), f"-DDAQP_SOURCE={tmp_path / 'daqp'}"
    assert configured(folder, *options) == (True, "")
    command = ["cmake", "--build", str(build), "--target", "ergoqp_step_daqp"]
    subprocess.run(command, check=True, capture_output=True)
    assert b"stand_in" in (build / "libdaqpstat.a").read_bytes()

    (source / "include/types.h").write_text("of another version")
    well, said = configured(folder, *options)
    assert not well
    assert "without the include/types.h of DAQP 0.5, allowed the folder of its sources" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["desk", "dentist", "forearm", "overhead", "screwing"])
def test_the_example_begins_where_the_step_makes_the_cost_fall(name):
    problem = ergoqp.load_problem(name)
    state = start = example_start(problem)
    stepper = Stepper(problem)
    for _ in range(500):
        step = stepper.step(state)
        state = state + step.posture_rate * problem.dt
    before, after = problem.cost(np.array([start, state]))
    assert after < before - 0.5


def test_the_example_begins_where_the_user_says(tmp_path):
    problem = ergoqp.load_problem("screwing")
    start = np.linspace(-0.5, 0.5, len(problem.coordinates))
    text = start_header(example_start(problem, start))
    numbers = [float(word) for word in text.removeprefix("#define START {")[:-2].split(",")]
    np.testing.assert_allclose(numbers, start, atol=1e-6)
    with pytest.raises(InputError, match=r"^start: got .* allowed 32 finite numbers"):
        export_step(problem, tmp_path / "step", start=[0.0, 1.0])
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    mine = tmp_path / "include/motor_step.h"
    mine.parent.mkdir()
    mine.write_text("keep")
    with pytest.raises(InputError, match="holds something else"):
        export_step(ergoqp.load_problem("screwing"), tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]


def test_a_period_out_of_range_is_one_sentence(tmp_path, capsys):
    assert execute(["export", "screwing", "--out", str(tmp_path / "step"), "--dt", "1"]) == 2
    assert "--dt: got 1.0 s, allowed 0.0001 to 0.1 s" in capsys.readouterr().err


def test_the_header_says_which_pose_is_given():
    problem, base = ergoqp.load_problem("screwing"), np.eye(4)
    base[0, 3] = 0.5
    assert "measured contact frame in the world, row-major" in header(problem)
    moved = problem.replace(frames=ergoqp.Frames(base))
    assert "measured flange in the base, row-major" in header(moved)


def test_flags_and_codes_are_whole_numbers_in_c():
    text = header(ergoqp.load_problem("screwing"))
    for name in ("frame", "has_pose", "has_twist", "enable", "status", "causes", "fault"):
        assert re.search(rf"^ *int {name};", text, re.MULTILINE), name
    for name in ("dt", "age", "cost", "fault_amount"):
        assert re.search(rf"^ *double {name};", text, re.MULTILINE), name
