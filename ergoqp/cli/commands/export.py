"""``ergoqp export``: the control step of a problem as C99."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.text import Text

from ergoqp.cli.commands.common import writing
from ergoqp.cli.commands.guide import guide_named
from ergoqp.cli.commands.screen import console, working
from ergoqp.errors import InputError
from ergoqp.export.folder import export_step
from ergoqp.problem.problem import Problem
from ergoqp.problem_files.load import load_problem
from ergoqp.responses import IkResponse
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import Alike


def export(problem_name: str, out: Path, dt: float | None, guide: str | None = None) -> None:
    """Write the folder and print what to do with it.

    Raises:
        ErgoqpError: if an argument cannot be used, or there is no C compiler.
    """
    problem = load_problem(problem_name)
    if dt is not None:
        if not 1e-4 <= dt <= 0.1:
            raise InputError(f"--dt: got {dt:g} s, allowed 0.0001 to 0.1 s")
        problem = problem.replace(dt=dt)
    place = None if guide is None else guide_named(problem, guide)
    with working(f"exporting {problem.name}"), writing(out):
        files = export_step(problem, out, place, start=_awkward(problem))
    screen = console()
    size = sum(file.stat().st_size for file in files)
    screen.print(Text(f"{len(files)} files, {size / 1e6:.1f} MB, in {out}"), soft_wrap=True)
    screen.print(
        Text(f"cmake -S {out} -B {out}/build && cmake --build {out}/build && {out}/build/main"),
        soft_wrap=True,
    )
    screen.print(Text(f"what goes in and comes out: {out}/include/ergoqp_step.h"), soft_wrap=True)


def _awkward(problem: Problem) -> np.ndarray | None:
    """Return an awkward posture for the example, if the problem defines where the object may be."""
    if not isinstance(problem.response, IkResponse):
        return None
    try:
        return awkward_start(problem, Alike(problem.response), 0)
    except InputError:
        return None
