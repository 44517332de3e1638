"""The whole step as a C99 folder that builds without ergoqp or Python and allocates no memory."""

from __future__ import annotations

import platform
import re
import shutil
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp._version import __version__
from ergoqp.arguments import path_of, read_array, shown
from ergoqp.errors import InputError
from ergoqp.export.layout import (
    defines,
    header,
    input_fields,
    memory_header,
    names_source,
    output_fields,
    python_fields,
)
from ergoqp.files.atomic import atomic_directory
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.limits import ArmLength, OneClassBoundary
from ergoqp.native.compiled import (
    CompilerError,
    NativeDaqp,
    c_text,
    compiler,
    daqp_archive,
    daqp_include,
    generated,
    licence_of,
    sizes_source,
)
from ergoqp.problem.problem import Problem
from ergoqp.step.certification import longest_stop
from ergoqp.step.constants import stand_in
from ergoqp.step.function import build_step
from ergoqp.step.guide import read_guide
from ergoqp.step.rest import UNKNOWN

_RAISED: Final = {"shoulder_flexion": 95.0, "elbow_flexion": 30.0}
"""Angles of the working arms [deg]."""


def example_start(problem: Problem, given: ArrayLike | None = None) -> np.ndarray:
    """Return the state (n,) at which the example starts.

    Args:
        problem: the task.
        given: the user's state. None: comfort with the working arms raised, or, where the state is
            points within a learned boundary, the centre with the highest cost.

    Raises:
        InputError: if the user's state is not valid.
    """
    n = len(problem.coordinates)
    if given is not None:
        return read_array("start", given, (n,), f"{n} finite numbers")
    start = stand_in(problem).copy()
    if problem.coordinates == JOINTS:
        for side in getattr(problem.response, "hands", SIDES):
            for joint, angle in _RAISED.items():
                start[INDEX[f"{side}_{joint}"]] = np.radians(angle)
        return start
    boundary, length = problem.limit_of(OneClassBoundary), problem.limit_of(ArmLength)
    if boundary is None or tuple(boundary.model.coordinates.names) != tuple(problem.coordinates):
        return start
    model = boundary.model
    points = model.mean + model.scale * model.centres
    points = points if length is None else length.project(points)
    inside = points[model.margin(points) > 0]
    points = inside if len(inside) else points
    return points[int(np.argmax(problem.cost(points)))]


def start_header(start: np.ndarray) -> str:
    """Return ``start.h``: the state as the initialiser of an array in C."""
    return f"#define START {{{', '.join(f'{value:.6g}' for value in start.tolist())}}}\n"


CORE: Final = "ergoqp_core"
"""Name of the generated function."""

PREFIX: Final = "ergoqp"
"""Beginning of the exported names and files, unless the caller gives another."""


_DRAWN: Final = (
    "The step was exported with a guide: where descent comes to rest at a worse place, the object\n"
    "  goes to that of the guide. `ergoqp_guide` sets another place, or none. The promise of a\n"
    "  place is its expected cost, or one of `ERGOQP_PROMISE_...`."
)
_DESCENT: Final = (
    "The step descends the cost. To have it go to a given place too, export it with a guide\n"
    "  (`--guide`, `guide=`)."
)


def export_step(
    problem: Problem,
    folder: Path,
    guide: Any = None,
    *,
    start: ArrayLike | None = None,
    prefix: str = PREFIX,
) -> list[Path]:
    """Write the step of a problem as C99 with a header.

    A CMake file, the solver's library and licence, and examples are written too.

    Args:
        problem: the task; its control period becomes the default one.
        folder: target folder. It must be missing or empty, or hold an earlier export of the same
            prefix.
        guide: a place that the object is drawn to, as for `ergoqp.Stepper`; the caller in C can
            change it. None: the exported step has descent only, and is smaller.
        start: state at which the example starts, such as a posture (32,) [rad]. None: the working
            arms raised, or a place with a high cost where the state is points.
        prefix: what the names of functions, types, macros, files and CMake targets begin with, in
            lower case. Two steps in one program need two.

    Returns:
        The files.

    Raises:
        InputError: if the folder holds something else, or the guide, the start or the prefix cannot
            be used.
        CompilerError: if there is no C compiler to build the solver's interface with, or no DAQP
            library.

    Example:
        >>> import ergoqp
        >>> import tempfile
        >>> from pathlib import Path
        >>> from ergoqp.export.folder import export_step
        >>> problem = ergoqp.load_problem("screwing")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = export_step(problem, Path(folder))
        >>> "ergoqp_step.h" in {file.name for file in files}
        True
    """
    compiler()
    folder = path_of("folder", folder)
    if not (isinstance(prefix, str) and re.fullmatch(r"[a-z]([a-z0-9_]*[a-z0-9])?", prefix)):
        raise InputError(
            f"prefix: got {shown(prefix)}, allowed lower-case letters, digits and _ between them,"
            " such as left_arm"
        )
    earlier = (folder / f"include/{prefix}_step.h", folder / "src/qp_daqp.h")
    if folder.exists() and (
        not folder.is_dir()
        or (any(folder.iterdir()) and not all(file.is_file() for file in earlier))
    ):
        raise InputError(
            f"--out: {str(folder)!r} holds something else; give a new folder or an earlier export"
            f" whose prefix is {prefix}"
        )
    place = None if guide is None else read_guide(problem, guide)
    begin = example_start(problem, start)
    guided, solver = place is not None, NativeDaqp()
    core = generated(build_step(problem, solver, name=CORE, guided=guided, unrolled=True), CORE)
    memory = memory_header(problem, core[f"{CORE}.h"], place)
    texts = {
        "include/ergoqp_step.h": header(problem, guided),
        "include/ergoqp_memory.h": memory,
        f"src/{CORE}.c": '#include "inline.h"\n' + core[f"{CORE}.c"],
        f"src/{CORE}.h": core[f"{CORE}.h"],
        "src/inline.h": c_text("inline.h"),
        "src/stop.h": c_text("stop.h"),
        "src/ergoqp_step.c": c_text("ergoqp_step.c"),
        "src/ergoqp_names.c": names_source(problem),
        "src/qp.c": sizes_source(solver.sizes),
        "src/qp_daqp.h": c_text("qp_daqp.h"),
        "example/main.c": c_text("main.c"),
        "example/start.h": start_header(begin),
        "example/replay.c": c_text("replay.c"),
        "python/ergoqp_step.py": _filled("ergoqp_step.py.txt", problem, memory, guided),
        "CMakeLists.txt": _filled("CMakeLists.txt", problem, memory, guided),
        "cmake/ergoqp_stepConfig.cmake.in": c_text("ergoqp_stepConfig.cmake.in"),
        "README.md": _filled("README.md", problem, memory, guided),
    }
    texts = {_begun(name, prefix): _begun(text, prefix) for name, text in texts.items()}
    texts["daqp/LICENSE"] = licence_of("daqp")
    if not texts["daqp/LICENSE"]:
        raise CompilerError(
            "DAQP's licence: the package 'daqp' has no LICENSE; install it as published:"
            " `pip install daqp`"
        )
    if licence := licence_of("ergoqp"):
        texts["LICENSE"] = licence
    with atomic_directory(folder) as scratch:
        for name, text in texts.items():
            (scratch / name).parent.mkdir(parents=True, exist_ok=True)
            (scratch / name).write_text(text, encoding="utf-8")
        copied = _daqp_files(scratch)
    return [folder / name for name in (*texts, *copied)]


def _begun(text: str, prefix: str) -> str:
    """Return a text in which the names of the export begin with the prefix."""
    lower, upper = f"{PREFIX}_", f"{PREFIX.upper()}_"
    return text.replace(lower, f"{prefix}_").replace(upper, f"{prefix.upper()}_")


def _daqp_files(folder: Path) -> list[str]:
    """Copy the library and the headers of DAQP; return the names of the files in the folder."""
    sources = {f"daqp/lib/{daqp_archive().name}": daqp_archive()}
    for source in sorted((daqp_include() / "daqp").glob("*.h")):
        sources[f"daqp/include/daqp/{source.name}"] = source
    for name, source in sources.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, folder / name)
    return list(sources)


def _filled(name: str, problem: Problem, memory: str, guided: bool) -> str:
    """Return a text of the package with its @WORDS@ replaced."""
    size = stepper_bytes(problem, memory)
    words = {
        "PROBLEM": problem.name,
        "VERSION": __version__,
        "DT": f"{problem.dt:g}",
        "COORDINATES": str(len(problem.coordinates)),
        "KILOBYTES": f"{size / 1000:.0f}",
        "MACHINE": f"{platform.system()} {platform.machine()}",
        "INPUT_FIELDS": python_fields(input_fields(problem)),
        "OUTPUT_FIELDS": python_fields(output_fields(problem, guided)),
        "GUIDED": str(guided),
        "UNKNOWN": repr(UNKNOWN),
        "GUIDE": _DRAWN if guided else _DESCENT,
        "STEPPER_BYTES": str(size),
        "STOP": str(longest_stop(problem, problem.dt)),
    }
    text = c_text(name)
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    return text


def stepper_bytes(problem: Problem, memory: str) -> int:
    """Return an upper bound of the size of an ``ergoqp_stepper`` [bytes] from its memory header."""
    found = defines(memory)
    kinds = ("INPUT_DOUBLES", "OUTPUT_DOUBLES", "STATE", "SZ_W", "SZ_IW", "SZ_ARG", "SZ_RES")
    return 8 * (sum(found[f"ERGOQP_{kind}"] for kind in kinds) + 2 + 18 * ("ERGOQP_TRIAL" in found))
