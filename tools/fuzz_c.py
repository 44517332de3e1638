"""A fuzz of the exported step in C, with the sanitizers of addresses and undefined behaviour.

Run ``python -m tools.fuzz_c [--quick | --full] [--json FILE]``; ``--full`` takes ten minutes
for each of two exports. ``tools/fuzz_c.c`` turns bytes into calls of the whole interface with
wrong, late and hostile arguments, and judges every answer: finite, within speed and acceleration,
status and causes that agree, the same answer to the same call, and a stop that is what braking
gives and changes nothing. With clang, libFuzzer looks for inputs that reach new code; without it
the inputs are random.

- ``PROBLEM.calls``: calls that were judged. ``PROBLEM.inputs``: inputs, of many calls each.
- ``breaches``: exports in which a judgement or a sanitizer ended the run; its output is printed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.report import Report, run
from ergoqp.export.folder import export_step
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.seeking.seeker import a_place

TARGET = Path(__file__).with_suffix(".c")
CORE, OTHERS = "src/ergoqp_core.c", ("src/ergoqp_step.c", "src/ergoqp_names.c", "src/qp.c")
SANITIZERS = "address,undefined,float-cast-overflow"


@dataclass(frozen=True)
class Fuzzed:
    """What a run found.

    Attributes:
        inputs: number of inputs.
        calls: number of judged calls.
        breach: output of the run if it was ended; empty otherwise.
    """

    inputs: int
    calls: int
    breach: str


def engine() -> str:
    """Return ``libFuzzer``, ``random`` or, without a compiler, an empty text."""
    clang = shutil.which("clang")
    if clang is not None:
        with tempfile.TemporaryDirectory() as scratch:
            probe = Path(scratch) / "probe.c"
            probe.write_text(
                "int LLVMFuzzerTestOneInput(const char* d, long n) { return !d + !n; }"
            )
            command = [clang, "-fsanitize=fuzzer", str(probe), "-o", f"{scratch}/probe"]
            if subprocess.run(command, capture_output=True, check=False).returncode == 0:
                return "libFuzzer"
    return "random" if shutil.which("gcc") or clang else ""


def fuzz(problem: Problem, seconds: int, how: str, guide: Any = None) -> Fuzzed:
    """Export a problem, build the target with sanitizers, and run it.

    Args:
        problem: the task.
        seconds: how long to run.
        how: what `engine` returns.
        guide: as for `export_step`.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "step"
        export_step(problem, folder, guide)
        if how == "libFuzzer":
            compiler, kinds = "clang", f"fuzzer-no-link,{SANITIZERS}"
            core, end = ["-fsanitize=address", "-mllvm", "-asan-stack=0"], f"fuzzer,{SANITIZERS}"
            begin = ["./fuzz", f"-max_total_time={seconds}", "-max_len=4096", "-seed=1"]
            begin += ["-print_final_stats=1", "-rss_limit_mb=4096", "-len_control=0"]
        else:
            compiler = "gcc" if shutil.which("gcc") else "clang"
            kinds, end, begin = SANITIZERS, SANITIZERS, ["./fuzz"]
            core = ["-fsanitize=address"]
            core += (
                ["--param", "asan-stack=0"] if compiler == "gcc" else ["-mllvm", "-asan-stack=0"]
            )
        flags = ["-std=c99", "-g1", "-Wall", "-fno-sanitize-recover=all", f"-DSECONDS={seconds}"]
        flags = flags[:-1] if how == "libFuzzer" else flags
        flags += [f"-I{name}" for name in ("include", "src", "daqp/include")]
        # The generated function is straight code with thousands of variables: with all of this a
        # compiler takes half an hour for it, and every call sets guards around each of them.
        for source in (CORE, *OTHERS, str(TARGET)):
            own = ["-O0", *core] if source == CORE else ["-O1", f"-fsanitize={kinds}"]
            command = [compiler, *own, *flags, "-c", source, "-o", f"{Path(source).stem}.o"]
            subprocess.run(command, cwd=folder, check=True, capture_output=True)
        objects = [f"{Path(source).stem}.o" for source in (CORE, *OTHERS, str(TARGET))]
        command = [compiler, f"-fsanitize={end}", *objects, "daqp/lib/libdaqpstat.a", "-lm"]
        command += ["-o", "fuzz"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        done = subprocess.run(begin, cwd=folder, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    inputs = _number(r"(?:inputs|stat::number_of_executed_units:)\s+(\d+)", said)
    return Fuzzed(inputs, _number(r"^calls (\d+)", said), said if done.returncode else "")


def _number(pattern: str, text: str) -> int:
    found = re.search(pattern, text, re.MULTILINE)
    return int(found[1]) if found else 0


def measure(report: Report) -> None:
    """Fuzz a step with everything in it, and one along a surface."""
    if not (how := engine()):
        report.say("no C compiler: nothing is fuzzed")
        return
    seconds, breaches = report.pick(8, 600), 0
    screwing = load_problem("screwing")
    robot = DeclaredRobot(delay=0.02, lag=0.05, pose_delay=0.01, pose_noise=0.001)
    exports = {
        "screwing": (screwing.replace(robot=robot), a_place(screwing)),
        "forearm": (load_problem("forearm"), None),
    }
    if not report.full:
        exports.pop("screwing")  # which takes minutes to compile
    report.say(f"inputs: {how}, {seconds} s for each export")
    for name, (problem, guide) in exports.items():
        found = fuzz(problem, seconds, how, guide)
        report.figure(f"{name}.inputs", found.inputs)
        report.figure(f"{name}.calls", found.calls)
        if found.breach:
            breaches += 1
            report.say(found.breach)
    report.figure("breaches", breaches)


def main() -> None:
    """Run the command line."""
    run(measure, __doc__ or "")


if __name__ == "__main__":
    main()
