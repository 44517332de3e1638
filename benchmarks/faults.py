"""Faults of the service, its clients and what is between them, with a robot of its own clock.

Run ``python -m benchmarks.faults [--quick | --full] [--json FILE] [--keep FOLDER]``.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.faults_judge import Found, back, judge, rest_late, speed_at
from benchmarks.faults_kinds import KINDS
from benchmarks.faults_trial import NotMovingError, Trial, built
from benchmarks.faults_world import draw_world
from benchmarks.report import Report, run

FAULT: Final = (0.05, 1.2)
"""When the fault comes, after the object began to move [s]."""
_SIDE_BY_SIDE: Final = 2
_TRIES: Final = 4


def trial(kind: str, seed: int, keep: str = "") -> dict[str, Any]:
    """Run one trial; return what was found.

    Args:
        kind: name of the kind.
        seed: of everything that is drawn.
        keep: folder that the files of an unsafe trial are moved to; empty: they are removed.
    """
    for again in range(_TRIES):
        folder = Path(tempfile.mkdtemp(prefix="eqf"))
        try:
            found = _trial(kind, seed + 100_000 * again, folder)
            if keep and (found.unsafe or found.wrong):
                shutil.copytree(folder, Path(keep) / f"{kind}-{seed}", dirs_exist_ok=True,
                                ignore=lambda _, names: [n for n in names if n.endswith(".sock")])
            return {"kind": kind, "seed": seed, **asdict(found)}
        except NotMovingError:
            continue
        except Exception:
            return {"kind": kind, "seed": seed, "error": traceback.format_exc()}
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return {"kind": kind, "seed": seed, "error": "the object never moved"}


def _trial(kind: str, seed: int, folder: Path) -> Found:
    rng, spec = np.random.default_rng(seed), KINDS[kind]
    world = draw_world(rng, folder, spec.setup.relayed, spec.setup.hold)
    one = Trial(world, spec.setup, folder, rng)
    try:
        spec.before(one)
        wait = float(rng.uniform(*FAULT))
        one.begin(mischief=0.3 + wait)
        time.sleep(max(0.0, one.moved + wait - time.monotonic()))
        fault = time.monotonic()
        over = spec.inject(one)
        time.sleep(spec.after)
    finally:
        one.end()
    found, rows = judge(world, folder, spec.setup.relayed), one.loop_rows()
    found.wrong += one.notes
    found.fault_speed = speed_at(folder, fault)
    if spec.group:
        found.back_s = back(rows, over)
        found.rest_late_s = rest_late(rows, folder, fault, spec.setup.relayed)
    return found


if __name__ == "__main__":
    for each in sys.argv[1].split(","):
        for number in range(int(sys.argv[2]), int(sys.argv[3])):
            t = time.time()
            found = trial(each, number, "/tmp/w/faults_helper/kept")
            print(round(time.time() - t, 1), json.dumps({k: (round(v, 4) if isinstance(v, float) else v) for k, v in found.items()}), flush=True)
