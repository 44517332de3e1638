"""``ergoqp export``: the control step of a problem as C99."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from rich.text import Text

from ergoqp.arguments import check_number
from ergoqp.cli.common import console, working, writing
from ergoqp.cli.options import AnyProblem, Guide, folder_of, option
from ergoqp.cli.run import guide_named
from ergoqp.errors import InputError
from ergoqp.export.folder import PREFIX, export_step
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.validate import PERIODS
from ergoqp.responses import IkResponse
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import ModelPerson

ABOUT = """Write the control step of a problem as C99.

The folder holds sources, header, CMake file, the QP solver's library and examples.

\b
Examples:
  ergoqp export screwing --out step
  cmake -S step -B step/build && cmake --build step/build && step/build/main
"""


def command(
    name: AnyProblem,
    out: Annotated[Path, option("DIR", "Folder for the sources.", parser=folder_of)],
    dt: Annotated[float | None, option("S", "Control period [the problem's].")] = None,
    guide: Guide = None,
    prefix: Annotated[str, option("NAME", "Beginning of the names and files in C.")] = PREFIX,
) -> None:
    """Write the folder and print what to do with it.

    Raises:
        ErgoqpError: if an argument cannot be used, or there is no C compiler.
    """
    problem = load_problem(name)
    if dt is not None:
        check_number("--dt", dt, *PERIODS, "s")
        problem = problem.replace(dt=dt)
    place = None if guide is None else guide_named(problem, guide)
    with working(f"exporting {problem.name}"), writing(out):
        files = export_step(problem, out, place, start=_awkward(problem), prefix=prefix)
    screen = console()
    size = sum(file.stat().st_size for file in files)
    screen.print(Text(f"{len(files)} files, {size / 1e6:.1f} MB, in {out}"), soft_wrap=True)
    build = f"cmake -S {out} -B {out}/build && cmake --build {out}/build && {out}/build/main"
    screen.print(Text(build), soft_wrap=True)
    header = f"{out}/include/{prefix}_step.h"
    screen.print(Text(f"what goes in and comes out: {header}"), soft_wrap=True)


def _awkward(problem: Problem) -> np.ndarray | None:
    """Return an awkward posture for the example, if the problem defines where the object may be."""
    if not isinstance(problem.response, IkResponse):
        return None
    try:
        return awkward_start(problem, ModelPerson(problem.response), 0)
    except InputError:
        return None
