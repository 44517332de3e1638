"""Parts that the commands share: the folder of results, and the options of recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.text import Text

from ergoqp.arguments import check_whole
from ergoqp.cli.commands.screen import working
from ergoqp.errors import InputError, MissingExtraError, ProblemError
from ergoqp.joints import JOINTS
from ergoqp.mocap import Recording, load_recording
from ergoqp.placing.program import check_names
from ergoqp.problem.problem import Problem
from ergoqp.problem_files.load import load_problem, problem_names


@dataclass(frozen=True)
class RecordingOptions:
    """How to read a recording, as given on the command line.

    Attributes:
        person: stature [m] or path of a person file, None to measure the recording.
        unit_to_m: size of the file's unit of length [m].
        up: vertical axis of the file.
        mapping: path of a file that names joints.
        neutral: when the person stands straight, as text.
        window: seconds to read, as text.
        subject: the person to read, by the prefix of the names.
        thing: the held object.
        columns: names of the points of a table without names, separated by commas.
        rate: frame rate of a file without times [Hz].
    """

    person: str | None
    unit_to_m: float | None
    up: str | None
    mapping: Path | None
    neutral: str | None = None
    window: str | None = None
    subject: str | None = None
    thing: str | None = None
    columns: str | None = None
    rate: float | None = None

    @property
    def person_value(self) -> float | Path | None:
        """The stature as a number, or the path."""
        return _number_or_path(self.person)

    @property
    def window_value(self) -> tuple[float, float] | None:
        """First and last time [s].

        Raises:
            InputError: if the text is not two times.
        """
        if self.window is None:
            return None
        begin, colon, end = self.window.partition(":")
        try:
            if not colon:
                raise ValueError
            return float(begin or "-inf"), float(end or "inf")
        except ValueError:
            raise InputError(
                f"--window: got {self.window!r}, allowed two times in seconds such as 2:10, or one"
                " such as 2: or :10"
            ) from None

    @property
    def columns_value(self) -> tuple[str, ...]:
        """The names of the points of a table."""
        return tuple(name.strip() for name in self.columns.split(",")) if self.columns else ()

    def load(self, path: Path, progress: Callable[[float], None] | None = None) -> Recording:
        """Read a recording.

        Args:
            path: the recording.
            progress: called with the share that is done.

        Raises:
            ErgoqpError: if it cannot be read with these options.
        """
        neutral = self.neutral
        return load_recording(
            path,
            self.person_value,
            self.unit_to_m,
            self.up,
            mapping=self.mapping,
            neutral=neutral if neutral == "vertical" else _number_or_path(neutral),
            window=self.window_value,
            subject=self.subject,
            thing=self.thing,
            columns=self.columns_value,
            rate=self.rate,
            progress=progress,
        )

    def refuse_without_recording(self) -> None:
        """Raise an error for options that need a recording.

        Raises:
            InputError: if one is given; the message names it.
        """
        given = {
            "--unit-to-m": self.unit_to_m,
            "--up": self.up,
            "--mapping": self.mapping,
            "--neutral": self.neutral,
            "--window": self.window,
            "--subject": self.subject,
            "--thing": self.thing,
            "--columns": self.columns,
            "--rate": self.rate,
        }
        for option, value in given.items():
            if value is not None:
                raise InputError(
                    f"{option}: got {str(value)!r}, but there is no recording; name one with --from"
                )


def _number_or_path(text: str | None) -> float | Path | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        return Path(text)


@dataclass(frozen=True)
class SearchOptions:
    """How `ergoqp.placing.optimise.optimise` searches for a place, as given on the command line.

    Attributes:
        starts: number of starts.
        jobs: number of processes.
        seed: seed of the starts.
        mode: who chooses the posture.
        solver: name of the nonlinear solver.
        scheduler: address of a Dask scheduler, None for this machine.
    """

    starts: int
    jobs: int
    seed: int
    mode: str
    solver: str
    scheduler: str | None

    def check(self) -> None:
        """Check the options, before anything is read or written.

        Raises:
            InputError: if one cannot be used; the message names it.
        """
        check_names(self.mode, self.solver)
        for name, value, least in (
            ("starts", self.starts, 1),
            ("seed", self.seed, 0),
            ("jobs", self.jobs, 1),
        ):
            check_whole(name, value, least)


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
        raise InputError(f"problem {problem.name}: moves {moved}, allowed problems of a person")
    return problem


def _is_of_a_person(problem: Problem) -> bool:
    return tuple(problem.coordinates) == JOINTS


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
