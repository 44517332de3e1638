"""What every benchmark shares: its options, and its figures on the screen and as flat JSON."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

Size = TypeVar("Size")


class Report:
    """The figures of one run, printed as they are measured.

    Attributes:
        full: the whole measurement is wanted, not the smaller sample that ends within 45 s.
        keep: folder in which a long run keeps what it found, so that it goes on where it was ended.
        figures: what was measured so far.
    """

    def __init__(self, full: bool, keep: Path | None = None) -> None:
        """Start without figures."""
        self.full, self.keep = full, keep
        self.figures: dict[str, float] = {}

    def pick(self, quick: Size, full: Size) -> Size:
        """Return the size of the sample: `quick` or `full`."""
        return full if self.full else quick

    def figure(self, name: str, value: float, meaning: str = "", *, quiet: bool = False) -> None:
        """Keep and print a figure.

        Args:
            name: its key in the JSON file.
            value: a number; infinite only where the measure says what never means.
            meaning: unit or explanation, for the reader only.
            quiet: for the JSON file alone, where there are too many to be read.

        Raises:
            ValueError: for a value that is not a number, or a name given twice.
        """
        value = float(value)
        if math.isnan(value) or name in self.figures:
            raise ValueError(f"figure {name}: got {value}, allowed: a number, once")
        self.figures[name] = value
        if not quiet:
            print(f"{name:<32} {value:>14.6g}  {meaning}".rstrip(), flush=True)

    def say(self, text: str) -> None:
        """Print a line that is no figure."""
        print(text, flush=True)


def run(
    measure: Callable[[Report], None], description: str, arguments: Sequence[str] | None = None
) -> Report:
    """Read the options, measure, write the JSON file.

    Args:
        measure: takes a :class:`Report` and gives it figures.
        description: one sentence for ``--help``.
        arguments: command line without the program's name; default: the real one.
    """
    parser = argparse.ArgumentParser(description=description)
    size = parser.add_mutually_exclusive_group()
    size.add_argument(
        "--quick", action="store_true", help="a smaller sample, within 45 s (the default)"
    )
    size.add_argument("--full", action="store_true", help="the whole measurement")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="also write the figures there, flat"
    )
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="keep what is found there, so that a long run that was ended goes on (fuzz, frames,"
        " mutants, tracking)",
    )
    options = parser.parse_args(arguments)
    report = Report(full=options.full, keep=options.keep)
    start = time.perf_counter()
    measure(report)
    report.say(
        f"measured in {time.perf_counter() - start:.1f} s ({'full' if report.full else 'quick'})"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(report.figures, indent=1) + "\n", encoding="utf-8")
    return report


def shared_folder() -> Path | None:
    """Return the project's shared folder of reference data; None if absent.

    It is ``shared/`` in the checkout or beside it.
    """
    found = (parent / "shared" for parent in Path(__file__).resolve().parents)
    return next((folder for folder in found if (folder / "reba" / "tables.json").is_file()), None)
