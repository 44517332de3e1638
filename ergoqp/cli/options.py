"""Arguments and options that several commands share, each stated once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.human.person_file import given_person

if TYPE_CHECKING:
    from ergoqp.mocap import Recording

Up = StrEnum(
    "Up", {"x": "x", "y": "y", "z": "z", "minus_x": "-x", "minus_y": "-y", "minus_z": "-z"}
)
"""Possible vertical axes of a recording."""


def argument(metavar: str, words: str) -> Any:
    """Return an argument of a command that must be given, with its help."""
    return typer.Argument(metavar=metavar, help=words, show_default=False)


def option(metavar: str | None, words: str, *names: str, **more: Any) -> Any:
    """Return an option of a command, named after its parameter if no names are given.

    Args:
        metavar: what its value is. None: it is a switch, or one of a few words.
        words: text of the help.
        names: names such as ``--from``.
        more: as for `typer.Option`.
    """
    return typer.Option(*names, metavar=metavar, help=words, **more)


ProblemName = Annotated[
    str,
    argument(
        "PROBLEM",
        "dentist, desk, low_bin, overhead, screwing, screwing_learned, or the path of a TOML file.",
    ),
]
AnyProblem = Annotated[
    str, argument("PROBLEM", "A name, as for run, or forearm, or the path of a TOML file.")
]
At = Annotated[float | None, option("SECONDS", "When in the recording [its worst-scored frame].")]
Guide = Annotated[
    str | None,
    option(
        "best|FILE",
        "A place for the object to go to: best (searched first) or an optimum.json [none].",
    ),
]
Jobs = Annotated[int, option("N", "Number of processes.")]
Starts = Annotated[int, option("N", "Number of starts.")]


@dataclass(frozen=True)
class RecordingOptions:
    """How to read a recording."""

    person: Annotated[
        str | None,
        option("M|FILE", "Stature in metres, or a person file (TOML) [measured in the recording]."),
    ] = None
    unit_to_m: Annotated[
        float | None, option("M", "Size of the recording's unit of length in metres [found].")
    ] = None
    up: Annotated[Up | None, option(None, "The recording's vertical axis [found].")] = None
    mapping: Annotated[
        Path | None,
        option("FILE", "TOML file that names the recording's joints or markers [known namings]."),
    ] = None
    neutral: Annotated[
        str | None,
        option(
            "SECONDS|FILE|vertical",
            "When the person stands straight, or another recording in which they do;"
            " vertical: the trunk is measured to the vertical [found].",
        ),
    ] = None
    window: Annotated[
        str | None,
        option("FROM:TO", "Seconds of the recording to read [all]."),
    ] = None
    subject: Annotated[
        str | None, option("NAME", "Whose posture, where there are several people [the only one].")
    ] = None
    thing: Annotated[
        str | None, option("NAME", "The object that is held, where there are several.")
    ] = None
    columns: Annotated[
        str | None,
        option(
            "NAMES",
            "Names of the points of a table without any, three columns each: neck,right_elbow.",
        ),
    ] = None
    rate: Annotated[
        float | None, option("HZ", "Frames per second of a recording that has no times.")
    ] = None
    trust: Annotated[
        str | None,
        option(
            "WHAT",
            "What is right although it looks impossible: names (of markers), sides (left and"
            " right), angles (unit and sign of the file's own), neutral (the other recording),"
            " precision (of the coordinates); several with commas.",
        ),
    ] = None

    @property
    def person_value(self) -> float | Path | None:
        """The stature as a number, or the path."""
        return _number_or_path(self.person)

    @property
    def body(self) -> Body | None:
        """Body of the person that is given.

        Raises:
            InputError: if it is no stature, and no file that describes a person.
        """
        person = self.person_value
        return None if person is None else given_person(person)

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

    def load(self, path: Path, progress: Callable[[float], None] | None = None) -> Recording:
        """Read a recording.

        Args:
            path: the recording.
            progress: called with the share that is done.

        Raises:
            ErgoqpError: if it cannot be read with these options.
        """
        from ergoqp.mocap import load_recording  # what some commands do not need is slow to import

        read: dict[str, Any] = {
            "person": self.person_value,
            "up": self.up and self.up.value,
            "neutral": "vertical" if self.neutral == "vertical" else _number_or_path(self.neutral),
            "window": self.window_value,
            "columns": _listed(self.columns),
            "trust": _listed(self.trust),
        }
        return load_recording(path, **vars(self) | read, progress=progress)

    def refuse_without_recording(self, at: float | None) -> None:
        """Raise an error for options that need a recording, ``--at`` among them.

        Raises:
            InputError: if one is given; the message names it.
        """
        for name, value in vars(self).items():
            if name != "person" and value is not None:
                raise InputError(
                    f"--{name.replace('_', '-')}: got {str(value)!r}, but there is no recording;"
                    " name one with --from"
                )
        if at is not None:
            raise InputError(f"--at: got {at:g} s, but there is no recording; name one with --from")


@dataclass(frozen=True)
class SearchOptions:
    """How `ergoqp.placing.optimise.optimise` searches for a place."""

    starts: Starts = 8
    jobs: Jobs = 1
    seed: Annotated[int, option("N", "Seed of the starts.")] = 0
    mode: Annotated[
        str, option("NAME", "stackelberg; or cooperative: the posture is chosen too.")
    ] = "stackelberg"
    solver: Annotated[str, option("NAME", "ipopt, fatrop or sqpmethod.")] = "ipopt"

    def check(self) -> None:
        """Check the options, before anything is read or written.

        Raises:
            InputError: if one cannot be used; the message names it.
        """
        from ergoqp.placing.optimise import check_search

        check_search(**asdict(self))


def grouped(**groups: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the fields of dataclasses as options; it is called with the dataclasses.

    Args:
        groups: the dataclass of each parameter that stands for several options.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(command, include_extras=True)
        options: list[inspect.Parameter] = []
        for each in inspect.signature(command).parameters.values():
            own = each.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[each.name])
            if own.name not in groups:
                options.append(own)
                continue
            kind = groups[own.name]
            types = get_type_hints(kind, include_extras=True)
            options += [
                own.replace(name=each.name, default=each.default, annotation=types[each.name])
                for each in fields(kind)
            ]

        def call(**values: Any) -> None:
            for name, kind in groups.items():
                values[name] = kind(**{each.name: values.pop(each.name) for each in fields(kind)})
            command(**values)

        vars(call).update(__signature__=inspect.Signature(options))
        call.__annotations__ = {each.name: each.annotation for each in options}
        return call

    return decorate


def out_option(*folders: str) -> Any:
    """Return the option ``--out`` of a command.

    Args:
        folders: names of the default folders in ``ergoqp-out``.
    """
    default = "ergoqp-out/" + ", ".join(folders)
    return option("DIR", f"Folder for the results [{default}].", parser=folder_of)


def folder_of(text: str) -> Path:
    """Return the folder of a text, but refuse an empty one, which would be the current folder."""
    if not text:
        raise typer.BadParameter("got an empty text, allowed a folder")
    return Path(text)


def _listed(text: str | None) -> tuple[str, ...]:
    return tuple(map(str.strip, text.split(","))) if text else ()


def _number_or_path(text: str | None) -> float | Path | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        return Path(text)
