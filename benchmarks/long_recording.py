"""An hour of motion capture from file to page: how long it takes, and how much memory.

Run ``python -m benchmarks.long_recording [--quick | --full] [--json FILE]``. A person walks and
stoops at 120 Hz, over and over, as a BVH file, as a table of joint centres and as a C3D file of 39
markers; ``ergoqp score`` runs on each in a process of its own. ``--quick``: two minutes;
``--full``: an hour.

``minutes``: from the command to the page, of a BVH file of ``recorded_minutes``; ``csv.`` and
``c3d.``: of the others. ``peak_mb``: the largest resident memory of the process; ``.empty``: that
of a recording of a second, which is what the libraries take. ``file_mb``: size of the file.
``frames_per_s``: all of it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.made_markers import markers_of, write_c3d, write_table
from benchmarks.made_motions import BODY, fitted, moved, stoop, walk
from benchmarks.report import Report, run
from ergoqp.mocap.formats.bvh import write_bvh
from ergoqp.mocap.naming import centres_of

RATE = 120.0

_MEASURED = """
import resource, sys
from ergoqp.cli.main import main
try:
    sys.argv = ["ergoqp", "score", sys.argv[1], "--out", sys.argv[2]]
    main()
except SystemExit as end:
    assert not end.code, end.code
finally:
    print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def write_recording(path: Path, seconds: float, rate: float = RATE) -> int:
    """Write a recording of some seconds at a rate [Hz]; return its number of frames."""
    parts = [fitted(walk(6.0)[0]).postures, fitted(stoop(4.0)[0]).postures]
    once = np.concatenate(parts)
    poses = np.tile(np.eye(4), (len(once), 1, 1))
    write_bvh(path, once, poses, BODY, 1 / rate)
    head, rows = path.read_text(encoding="utf-8").split("Frame Time:")
    frame_time, *rows = rows.strip().splitlines()
    count = int(seconds * rate)
    head = head.replace(f"Frames: {len(once)}", f"Frames: {count}")
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{head}Frame Time: {frame_time.strip()}\n")
        for start in range(0, count, len(rows)):
            file.write("\n".join(rows[: count - start]) + "\n")
    return count


def scored(path: Path, out: Path) -> tuple[float, float]:
    """Return how long scoring a recording takes [s], and the largest memory [MB]."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED, str(path), str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    took = time.perf_counter() - begin
    if done.returncode:
        raise RuntimeError(done.stderr)
    if not (out / "report.html").is_file():
        raise RuntimeError("no page was written: install the extra report")
    peak = float(done.stdout.rpartition("peak ")[2])
    return took, peak / 1024


def write_table_of(path: Path, seconds: float) -> int:
    """Write joint centres as a table; return the number of frames."""
    pelvis, postures = moved()
    paths = centres_of(BODY, pelvis, postures)
    places = np.stack(list(paths.values()), axis=1)
    return write_table(path, tuple(paths), places, RATE, _times(seconds, len(postures)))


def write_c3d_of(path: Path, seconds: float) -> int:
    """Write markers as a C3D file; return the number of frames."""
    names, places = markers_of(BODY, *moved())
    return write_c3d(path, names, places, RATE, _times(seconds, len(places)))


def _times(seconds: float, frames: int) -> int:
    return max(1, round(seconds * RATE / frames))


def measure(report: Report) -> None:
    """Print all figures."""
    seconds = report.pick(120.0, 3600.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.bvh"
        write_recording(path, 1.0)
        _, empty = scored(path, Path(folder) / "empty")
        report.figure("recorded_minutes", seconds / 60)
        report.figure("peak_mb.empty", empty)
        for kind, write in (
            ("", write_recording),
            ("csv.", write_table_of),
            ("c3d.", write_c3d_of),
        ):
            path = Path(folder) / f"long.{kind.strip('.') or 'bvh'}"
            frames = write(path, seconds)
            took, peak = scored(path, Path(folder) / "out")
            report.figure(f"{kind}minutes", took / 60)
            report.figure(f"{kind}peak_mb", peak)
            report.figure(f"{kind}file_mb", path.stat().st_size / 1e6)
            report.figure(f"{kind}frames_per_s", frames / took)
            path.unlink()


if __name__ == "__main__":
    run(measure, __doc__ or "")
