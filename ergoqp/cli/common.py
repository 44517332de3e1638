"""What the commands share: problems by name, folders of results, tables and progress."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from ergoqp.errors import InputError, MissingExtraError, ProblemError
from ergoqp.joints import JOINTS
from ergoqp.problem.load import load_problem, problem_names
from ergoqp.problem.problem import Problem
from ergoqp.sheets.reba import ACTION_LEVELS

PLAIN_WIDTH = 120
"""Number of columns of tables if the width of the output is unknown."""

PAUSE = 5.0
"""Time between two lines of progress, if there is no terminal for a bar [s]."""


def counted(count: int, one: str, many: str) -> str:
    """Return a number with its noun, such as ``1 start`` or ``2 starts``."""
    return f"{count} {one if count == 1 else many}"


def load_person_problem(name: str) -> Problem:
    """Return a problem whose state is the posture of a person.

    Raises:
        ProblemError: if the problem does not exist, or its file is not one.
        InputError: if its state is something else.
    """
    if name not in problem_names() and Path(name).name == name and Path(name).suffix != ".toml":
        of_people = [known for known in problem_names() if _is_of_a_person(load_problem(known))]
        raise ProblemError(
            f"problem: got {name!r}, allowed {', '.join(of_people)} or the path of a .toml file"
        )
    problem = load_problem(name)
    if not _is_of_a_person(problem):
        moved = ", ".join(problem.coordinates)
        raise InputError(f"problem {problem.name}: moves {moved}; choose a problem of a person")
    return problem


def _is_of_a_person(problem: Problem) -> bool:
    return tuple(problem.coordinates) == JOINTS


def score_words(problem: Problem, posture: np.ndarray) -> str:
    """Return the score of a posture (32,) [rad] and its risk, such as ``4, medium risk``."""
    assessment = problem.assess(posture)
    return f"{assessment.final[0]}, {ACTION_LEVELS[assessment.band[0]]} risk"


def make_folder(out: Path | None, name: str) -> Path:
    """Return the folder for results, and create it if needed.

    By default it is ``ergoqp-out/<name>`` in the current directory.

    Raises:
        InputError: if it cannot be created.
    """
    folder = Path("ergoqp-out") / name if out is None else out
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn an error while writing files into a message of one sentence.

    Raises:
        InputError: naming the file and the cause.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            f"--out: cannot write {str(error.filename or folder)!r}: {error.strerror}"
        ) from None


def write_report(
    out: Console, folder: Path, files: Sequence[str], write: Callable[[Path], None]
) -> None:
    """Write ``report.html``, or print which extra it needs. Then print where all files are.

    Args:
        out: console for the messages.
        folder: folder of the results.
        files: files that the command has already written there.
        write: writes the page to a path.
    """
    page = folder / "report.html"
    try:
        with working("report"), writing(folder):
            write(page)
    except MissingExtraError as missing:
        # An older page could be mistaken for that of this run.
        page.unlink(missing_ok=True)
        Console(stderr=True).print(Text(f"report.html was not written: {missing}"), soft_wrap=True)
    for name in (*files, *([page.name] if page.is_file() else [])):
        out.print(Text(f"{name:<12} {folder / name}"), soft_wrap=True)


def console() -> Console:
    """Return the console for results: standard output, as wide as the terminal or a log needs.

    ``COLUMNS`` sets the width if it is given.
    """
    out = Console()
    return out if out.is_terminal or _width_is_given() else Console(width=PLAIN_WIDTH)


def _width_is_given() -> bool:
    return os.environ.get("COLUMNS", "").isdecimal()


@contextmanager
def working(words: str) -> Iterator[Callable[[float], None]]:
    """Report on standard error what is being done: a bar on a terminal, plain lines otherwise.

    Long work prints another line with its progress every few seconds.

    Yields:
        A function to call with the share that is done, 0 to 1.
    """
    error = Console(stderr=True)
    if not error.is_terminal:
        yield _lines(words, error)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    # No refresh thread, because it would disturb the measured durations.
    with Progress(*columns, console=error, transient=True, auto_refresh=False) as bar:
        task = bar.add_task(words, total=None)
        bar.refresh()

        def done(share: float) -> None:
            bar.update(task, total=1.0, completed=share)
            bar.refresh()

        yield done


def _lines(words: str, error: Console) -> Callable[[float], None]:
    """Return a function that prints the share that is done, in lines that are `PAUSE` apart."""
    began = last = time.monotonic()
    error.print(Text(f"{words} ..."), soft_wrap=True)

    def done(share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= PAUSE and share < 1:
            last = now
            line = f"{words}: {100 * share:.0f} % after {now - began:.0f} s ..."
            error.print(Text(line), soft_wrap=True)

    return done


def print_assumptions(out: Console, sentences: Sequence[str], title: str = "assumed") -> None:
    """Print sentences as a list below a title, each on its own line."""
    whole = not (out.is_terminal or _width_is_given())
    if sentences:
        out.print(Text(title), soft_wrap=whole)
    for sentence in sentences:
        out.print(Text(f"- {sentence}"), soft_wrap=whole)
