"""A run as files: ``run.json`` with what it comes down to, ``run.npz`` with every array. ``docs/run_json.md`` has the keys."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ergoqp import __version__
from ergoqp.files.whole import whole, write_whole
from ergoqp.joints import JOINTS
from ergoqp.simulation.run import Run
from ergoqp.step.place import Guide


def write_run(run: Run, folder: Path) -> Path:
    """Write both files and return the path of ``run.json``.

    Args:
        run: what happened.
        folder: where to; it is made if it is not there.

    Raises:
        OSError: if they cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with whole(folder / "run.npz") as scratch:
        np.savez_compressed(scratch, allow_pickle=False, **arrays_of(run))
    path = folder / "run.json"
    text = json.dumps(summary_of_run(run), indent=2, ensure_ascii=False, allow_nan=False)
    write_whole(path, text + "\n")
    return path


def summary_of_run(run: Run) -> dict[str, Any]:
    """Return what ``run.json`` holds: plain numbers, texts, lists and dicts; what is not known or not finite is None."""
    before, after = ({name: int(scores[row]) for name, scores in run.assessment.segments.items()} for row in (0, -1))
    microseconds = 1e6 * run.step_time
    return {
        "version": __version__,
        "problem": run.problem,
        "title": run.title,
        "recording": run.recording,
        "start_time_s": _seconds(run.start_time),
        "seed": run.seed,
        "dt": run.dt,
        "steps": len(run.time),
        "duration_s": round(len(run.time) * run.dt, 9),
        "reba_before": int(run.reba[0]),
        "reba_after": int(run.reba[-1]),
        "reba_best": int(run.reba[run.reba > 0].min(initial=15)),
        "reba_standing_still": run.reba_standing_still,
        "segments_before": before,
        "segments_after": after,
        "status_counts": dict(Counter(run.statuses)),
        "step_time_us": {
            "median": float(np.median(microseconds)),
            "p99": float(np.percentile(microseconds, 99)),
            "max": float(microseconds.max()),
        },
        "settle_s": _seconds(run.settle),
        "guide": _place(run.guide),
        "let_go_s": _seconds(run.let_go),
        "violations": dict(run.violations),
        "max_violation": {name: _finite(value) for name, value in run.max_violation.items()},
        "units": dict(run.units),
        "person_outside": dict(run.person_outside),
        "person": {
            "stature_m": float(run.body.stature),
            "mass_kg": float(run.body.mass),
            "lengths_m": {name: float(length) for name, length in run.body.lengths.items()},
        },
        "unobserved": list(run.unobserved),
        "options": dict(run.options),
        "assumptions": list(run.assumptions),
    }


def arrays_of(run: Run) -> dict[str, np.ndarray]:
    """Return what ``run.npz`` holds; texts are arrays of fixed-width strings, so that nothing needs pickle."""
    names = sorted({name for active in run.active for name in active})
    return {
        "time": run.time,
        "postures": run.postures,
        "base_poses": run.base_poses,
        "poses": run.poses,
        "twists": run.twists,
        "reba": run.reba,
        "cost": run.cost,
        "step_time": run.step_time,
        "statuses": np.array(run.statuses, dtype=np.str_),
        "reasons": np.array(run.reasons, dtype=np.str_),
        "active": np.array([[name in active for name in names] for active in run.active], dtype=bool),
        "active_names": np.array(names, dtype=np.str_),
        "joints": np.array(JOINTS, dtype=np.str_),
    }


def _place(guide: Guide | None) -> dict[str, Any] | None:
    if guide is None:
        return None
    wxyz = np.zeros(4)
    mujoco.mju_mat2Quat(wxyz, guide.pose[:3, :3].ravel())
    return {
        "position_m": guide.pose[:3, 3].tolist(),
        "quaternion_xyzw": np.roll(wxyz, -1).tolist(),
        "promise": guide.promise,
    }


def _seconds(value: float | None) -> float | None:
    """A moment without the rounding that multiples of the period have."""
    return None if value is None else round(float(value), 9)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
