"""The shape of the package: circles, climbs, and how far one goes to follow a problem into a step.

Run ``python -m tools.house [--quick | --full] [--json FILE]``, or ``--check`` for circles,
climbs and long lines alone, as ``make check`` does. Imports within functions and for types alone
are counted like all others, and so is every text that names a module, in a file that imports by
text (``import_module``); the facade ``ergoqp/__init__.py``, which names what there is and imports
it when it is asked for, is no room.

- ``circles``: groups of files that import each other.
- ``climbs``: imports of a room from one that is on no lower floor of ``tools/house/floors.toml``,
  but among the files of the ground.
- ``core_imports_others``: files of the core that import from ``mocap`` or ``lab``; command line and
  report stand above all three parts and do not count.
- ``rooms``, ``files``, ``lines``: of the package. ``top_files``, ``longest_top_file``: at the top
  of ``ergoqp/``. ``long_files``: of more than 650 lines.
- ``code_lines``: without docstrings, comments and blank lines; ``core_code_lines``: of these, all
  but ``mocap`` and ``lab``.
- ``long_lines``: lines of more than 100 columns in the whole project, of Python and Markdown;
  rows of Markdown's tables, which cannot be continued, are not counted.
- ``walk.stays``, ``walk.up``, ``walk.again``: the calls of `build_step` that are handed the
  problem, or the `StepModel` that holds it, are followed from file to file in the order of the
  text, see `tools.house.walk`: stays in a file, calls into a room on a higher floor than the
  stay before, and stays in a file that was left before.
- ``runs.FORMAT``, ``runs.load_problem``, ``runs.stepper``: files whose functions run while a
  recording is read, a problem loaded, a `Stepper` made, see `tools.house.runs`; recordings need
  the shared folder.
- ``import_s``: processor time of ``import ergoqp`` beyond NumPy's, the median of five processes
  [s].
"""

from __future__ import annotations

import ast
import io
import statistics
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from importlib.util import resolve_name
from pathlib import Path
from typing import Final

from benchmarks.report import Report, run, shared_folder
from tools.house.runs import runs_of
from tools.house.walk import Walk

ROOT: Final = Path(__file__).resolve().parents[2]
PACKAGE: Final = ROOT / "ergoqp"
COLUMNS: Final = 100
RECORDINGS: Final = {
    "bvh": "bvh/cmu_62_04_screwing_keyframes.bvh",
    "c3d": "c3d/pycgm_Movement_trial.c3d",
    "trc": "trc/pyomeca_comma_badcount.trc",
    "mot": "mot/opencap_squats.mot",
    "mvnx": "mvnx/xsens_kicking_part1.mvnx",
    "csv": "kinect/azure_kinect_body_tracking_part1.csv",
}
"""One recording of each format, below the shared folder of recordings."""
FACADE: Final = "ergoqp"
LONGEST: Final = 650
OTHERS: Final = frozenset({"mocap", "lab"})
"""Rooms beside the core."""
APP: Final = frozenset({"cli", "report", "__main__", FACADE})
"""What stands above the core and the rooms beside it."""


def modules() -> dict[str, Path]:
    """Return the files of the package by the names that they are imported by."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(files: dict[str, Path]) -> dict[str, set[str]]:
    """Return which files each file imports from."""
    return {name: set(_imported(name, files)) - {name} for name in files}


def _imported(name: str, files: dict[str, Path]) -> Iterator[str]:
    nodes = list(ast.walk(ast.parse(files[name].read_text(encoding="utf-8"))))
    inside = name if files[name].stem == "__init__" else name.rpartition(".")[0]
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in files)
        elif isinstance(node, ast.ImportFrom):
            module = resolve_name("." * node.level + (node.module or ""), inside)
            for alias in node.names:
                within = f"{module}.{alias.name}"
                yield from [each for each in (within, module) if each in files][:1]
    if name != FACADE and any(_imports_by_text(node) for node in nodes):
        texts = (node.value for node in nodes if isinstance(node, ast.Constant))
        for text in texts:
            if isinstance(text, str) and (module := _named(text, inside)) in files:
                # The name of the project alone names no file.
                yield from [module] if "." in module else []


def _imports_by_text(node: ast.AST) -> bool:
    called = node.func if isinstance(node, ast.Call) else None
    return getattr(called, "attr", getattr(called, "id", "")) in ("import_module", "__import__")


def _named(text: str, inside: str) -> str:
    """Return the module that a text such as ``"ergoqp.costs.svr:Svr"`` or ``".svr"`` may name."""
    name = text.partition(":")[0]
    try:
        return resolve_name(name, inside) if name.strip(".") else ""
    except ImportError:
        return ""


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of files that import each other.

    They are Tarjan's strongly connected components of more than one file.
    """
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(arrows[name]):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            at = stack.index(name)
            group = sorted(stack[at:])
            del stack[at:]
            if len(group) > 1:
                found.append(group)

    for name in sorted(arrows):
        if name not in index:
            visit(name)
    return found


def floors() -> dict[str, int]:
    """Return the floor of every room."""
    listed = tomllib.loads((ROOT / "tools" / "house" / "floors.toml").read_text(encoding="utf-8"))[
        "floors"
    ]
    return {room: number for number, rooms in enumerate(listed) for room in rooms}


def room_of(name: str) -> str:
    """Return the room of a file: its folder at the top of the package, or itself."""
    return name.split(".")[1] if "." in name else FACADE


def climbs(arrows: dict[str, set[str]]) -> list[str]:
    """Return the imports that do not go down, in words; a file whose room is on no floor is one."""
    found, level = [], floors()
    for name, others in sorted(arrows.items()):
        if name == FACADE:
            continue
        here = room_of(name)
        if here not in level:
            found.append(f"{name} is in no room of tools/house/floors.toml")
            continue
        for other in sorted(others):
            there = room_of(other)
            if (
                there != here
                and level.get(there, len(level)) >= level[here]
                and not _ground(here, there, level)
            ):
                found.append(f"{name} imports {other}")
    return found


def _ground(here: str, there: str, level: dict[str, int]) -> bool:
    """Files of the ground may import each other: there is no circle among them."""
    return level[here] == level.get(there) == 0


def long_lines() -> int:
    """Count the lines of more than `COLUMNS` columns, but rows of Markdown's tables."""
    listed = subprocess.run(
        ["git", "ls-files", "*.py", "*.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    texts = ((ROOT / name).read_text(encoding="utf-8") for name in listed.split("\n") if name)
    lines = (line for text in texts for line in text.splitlines())
    return sum(len(line) > COLUMNS and not line.startswith("|") for line in lines)


def lengths_of(files: dict[str, Path]) -> dict[Path, int]:
    """Return the number of lines of each file."""
    return {path: len(path.read_text(encoding="utf-8").splitlines()) for path in files.values()}


def core_imports_others(arrows: dict[str, set[str]]) -> dict[str, int]:
    """Return how often each file of the core imports from the rooms beside it, if it does."""
    found = {}
    for name, others in arrows.items():
        if room_of(name) not in OTHERS | APP:
            found[name] = sum(room_of(other) in OTHERS for other in others)
    return {name: count for name, count in found.items() if count}


def code_lines(path: Path) -> int:
    """Return the number of lines of a file without docstrings, comments and blank lines."""
    text = path.read_text(encoding="utf-8")
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            value = first.value if isinstance(first, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                lines.difference_update(range(value.lineno, (value.end_lineno or 0) + 1))
    return len(lines)


_NO_CODE: Final = frozenset(
    {
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
    }
)


def samples() -> dict[str, str]:
    """Return what `tools.house.runs` runs, by the names of the figures."""
    found = {"load_problem": "screwing", "stepper": "stepper"}
    shared = shared_folder()
    if shared is not None:
        found |= {name: str(shared / "mocap" / path) for name, path in RECORDINGS.items()}
    return found


def import_seconds() -> float:
    """Return the processor time of ``import ergoqp`` beyond NumPy's."""
    text = (
        "import numpy, time; t = time.process_time(); import ergoqp; print(time.process_time() - t)"
    )
    ran = [
        subprocess.run(
            [sys.executable, "-c", text], capture_output=True, text=True, check=True, cwd=ROOT
        )
        for _ in range(5)
    ]
    return statistics.median(float(each.stdout) for each in ran)


def measure(report: Report) -> None:
    """Print the figures."""
    files = modules()
    arrows = imports(files)
    found, up = circles(arrows), climbs(arrows)
    for group in found:
        report.say("circle: " + ", ".join(group))
    for each in up:
        report.say(f"climb: {each}")
    report.figure("circles", len(found))
    report.figure("climbs", len(up))
    lengths = lengths_of(files)
    top = [lines for path, lines in lengths.items() if path.parent == PACKAGE]
    report.figure("core_imports_others", sum(core_imports_others(arrows).values()))
    report.figure("rooms", len({room_of(name) for name in files}))
    report.figure("files", len(files))
    report.figure("lines", sum(lengths.values()))
    report.figure("top_files", len(top))
    report.figure("longest_top_file", max(top))
    report.figure("longest_file", max(lengths.values()))
    report.figure("long_files", sum(each > LONGEST for each in lengths.values()))
    code = {name: code_lines(path) for name, path in files.items()}
    report.figure("code_lines", sum(code.values()))
    core = {name: count for name, count in code.items() if room_of(name) not in OTHERS}
    report.figure("core_code_lines", sum(core.values()))
    report.figure("long_lines", long_lines(), f"of more than {COLUMNS} columns")
    level = floors()
    levels = {name: level.get(room_of(name), 0) for name in files}
    walk = Walk(files, levels)
    walk.enter("ergoqp.step.function", "build_step", frozenset({"problem"}))
    report.figure(
        "walk.stays", len(walk.stays), "of the problem on its way through a step's construction"
    )
    report.figure("walk.up", walk.up)
    report.figure("walk.again", walk.again)
    for what, path in samples().items():
        report.figure(f"runs.{what}", runs_of(path), "files whose functions run")
    report.figure("import_s", import_seconds(), "s of processor, beyond NumPy")


def check() -> int:
    """Return 1 where an import, a file or a line is not as it should be, having said which."""
    arrows, lengths = imports(modules()), lengths_of(modules())
    long_files = {path: lines for path, lines in lengths.items() if lines > LONGEST}
    said = [
        *("circle: " + ", ".join(group) for group in circles(arrows)),
        *(f"climb: {each}" for each in climbs(arrows)),
        *(f"core: {each} imports mocap or lab" for each in core_imports_others(arrows)),
        *(f"{path.name}: {lines} lines, at most {LONGEST}" for path, lines in long_files.items()),
        *([f"{long} lines of more than {COLUMNS} columns"] if (long := long_lines()) else []),
    ]
    print(
        "\n".join(said)
        if said
        else "no circle, no climb, no import of others by the core, no long file or line"
    )
    return int(bool(said))


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--check"]:
        sys.exit(check())
    run(measure, __doc__ or "")


if __name__ == "__main__":
    main()
