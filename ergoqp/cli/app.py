"""The application at which the commands register, and the options that they share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer


class Up(StrEnum):
    """Possible vertical axes of a recording."""

    x = "x"
    y = "y"
    z = "z"
    minus_x = "-x"
    minus_y = "-y"
    minus_z = "-z"


class UpperArm(StrEnum):
    """What the bands of the upper arm read."""

    flexion = "flexion"
    elevation = "elevation"


class Side(StrEnum):
    """The arm that an option refers to."""

    right = "right"
    left = "left"
    both = "both"


app = typer.Typer(
    name="ergoqp",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)

ProblemName = Annotated[
    str,
    typer.Argument(
        metavar="PROBLEM",
        help=(
            "dentist, desk, low_bin, overhead, screwing, screwing_learned, or the path of a TOML"
            " file."
        ),
        show_default=False,
    ),
]
AnyProblem = Annotated[
    str,
    typer.Argument(
        metavar="PROBLEM",
        help="A name, as for run, or forearm, or the path of a TOML file.",
        show_default=False,
    ),
]
At = Annotated[
    float | None,
    typer.Option("--at", metavar="SECONDS", help="When in the recording [its worst-scored frame]."),
]
Unit = Annotated[
    float | None,
    typer.Option(
        "--unit-to-m", metavar="M", help="Size of the recording's unit of length in metres [found]."
    ),
]
UpAxis = Annotated[
    Up | None,
    typer.Option("--up", help="The recording's vertical axis [found].", show_default=False),
]
Person = Annotated[
    str | None,
    typer.Option(
        "--person",
        metavar="M|FILE",
        help="Stature in metres, or a person file (TOML) [measured in the recording].",
    ),
]
Neutral = Annotated[
    str | None,
    typer.Option(
        "--neutral",
        metavar="SECONDS|FILE|vertical",
        help="When the person stands straight, or another recording in which they do; vertical: the"
        " trunk is measured to the vertical [found].",
    ),
]
Window = Annotated[
    str | None,
    typer.Option("--window", metavar="FROM:TO", help="Seconds of the recording to read [all]."),
]
Mapping = Annotated[
    Path | None,
    typer.Option(
        "--mapping",
        metavar="FILE",
        help="TOML file that names the recording's joints or markers [known namings].",
    ),
]
Subject = Annotated[
    str | None,
    typer.Option(
        "--subject",
        metavar="NAME",
        help="Whose posture, where there are several people [the only one].",
    ),
]
Thing = Annotated[
    str | None,
    typer.Option(
        "--thing", metavar="NAME", help="The object that is held, where there are several."
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="NAMES",
        help="Names of the points of a table without any, three columns each: neck,right_elbow.",
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(
        "--rate", metavar="HZ", help="Frames per second of a recording that has no times."
    ),
]

Guide = Annotated[
    str | None,
    typer.Option(
        "--guide",
        metavar="best|FILE",
        help="A place for the object to go to: best (searched first) or an optimum.json [none].",
    ),
]


def out_option(*folders: str) -> Any:
    """Return the option ``--out`` of a command.

    Args:
        folders: names of the default folders in ``ergoqp-out``.
    """
    default = "ergoqp-out/" + ", ".join(folders)
    return typer.Option(
        "--out", metavar="DIR", parser=folder_of, help=f"Folder for the results [{default}]."
    )


def folder_of(text: str) -> Path:
    """Return the folder of a text, but refuse an empty one, which would be the current folder."""
    if not text:
        raise typer.BadParameter("got an empty text, allowed a folder")
    return Path(text)


def pair(side: Side | None) -> tuple[bool, bool]:
    """Return whether the right and whether the left arm is selected."""
    return side in (Side.right, Side.both), side in (Side.left, Side.both)
