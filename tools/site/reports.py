"""One of each page that the commands write, for `tools.site.axe`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from ergoqp.mocap.demo_recording import demo_recording

QUICK: Final = {
    "run": "run screwing --duration 3",
    "score": "score take.bvh",
}
FULL: Final = {
    **QUICK,
    "seek": "run screwing --seek --duration 40",
    "lag": "run screwing --robot lag=0.1 --duration 5",
    "mass": "run screwing --follower mass --duration 3",
    "from": "run screwing --from take.bvh --duration 3",
    "optimise": "optimise desk --starts 4",
    "group": "group desk --people 1.55,1.70,1.85",
}
"""Commands by the folder that they write to."""
PEOPLE: Final = "--problems desk --kinds follower --page --out"


@contextmanager
def write_reports(full: bool) -> Iterator[list[Path]]:
    """Give the pages of the commands, which are gone afterwards; all of them with `full`."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo_recording(folder / "take.bvh")
        for out, command in (FULL if full else QUICK).items():
            words = [sys.executable, "-m", "ergoqp", *command.split(), "--out", out]
            subprocess.run(words, cwd=folder, check=True, capture_output=True)
        if full:
            words = [sys.executable, "-m", "benchmarks.people", *PEOPLE.split(), folder / "people"]
            subprocess.run(words, check=True, capture_output=True)
        yield sorted(folder.rglob("*.html"))
