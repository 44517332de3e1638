"""The scores and joint angles of a recording as files: one row per frame, and a summary.

``scores.csv`` has one row per frame:

- ``time_s``: time stamp [s];
- ``reba``: final score 1 to 15, 0 if the frame could not be scored;
- ``risk``: its action level in words, ``not scored`` for 0;
- ``arm``: the arm with the higher score B, empty if not scored;
- one column per segment (``neck``, ``trunk``, ``legs``, ``right_upper_arm``, ...): its score, 0
  if not scored;
- ``fit_error_mm``: distance of the fitted body from the recording, RMS [mm];
- ``valid``: 1 or 0;
- ``not_scored``: why not, causes separated by semicolons;
- ``outside``: joints beyond their range, separated by spaces.

``scores.json`` holds the result of `summary_of`. The joint angles of a recording as files for other
programs.

``angles.csv`` has one row per frame: ``time_s``; ``scored`` 1 or 0; every joint of
`ergoqp.joints.JOINTS` as ``<joint>_deg``; ``<side>_elevation_deg`` and
``<side>_elevation_plane_deg`` of both upper arms (see `ergoqp.sheets.description`); and
``<centre>_error_mm``, the distance of the fitted body's joint centre from that of the
recording, empty if it is not seen.

``angles.mot`` has the same joints and elevations in degrees, in OpenSim's format for motions.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp._version import __version__
from ergoqp.arguments import Progress, part_of, unseen
from ergoqp.files.atomic import atomic_write, write_json
from ergoqp.joints import JOINTS, SIDES
from ergoqp.mocap import Recording
from ergoqp.report import palette
from ergoqp.sheets import reba
from ergoqp.sheets.description import elevation_of
from ergoqp.sheets.reba import Assessment

_BLOCK: Final = 4096
"""Number of frames between two reports of progress."""


def write_scores(
    recording: Recording, assessment: Assessment, folder: Path, progress: Progress = unseen
) -> tuple[Path, Path]:
    """Write ``scores.csv`` and ``scores.json``.

    Args:
        recording: the recording that was scored.
        assessment: assessment of its n postures.
        folder: folder of the files; it is created if needed.
        progress: called with the share that is written.

    Returns:
        The two files.

    Raises:
        OSError: if they cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows, summary = folder / "scores.csv", folder / "scores.json"
    with atomic_write(rows) as scratch, scratch.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        head = ["time_s", "reba", "risk", "arm", *palette.SEGMENTS]
        writer.writerow([*head, "fit_error_mm", "valid", "not_scored", "outside"])
        for i, valid in enumerate(assessment.valid.tolist()):
            writer.writerow(
                [
                    f"{recording.time[i]:.6f}",
                    int(assessment.final[i]),
                    palette.risk_of_level(int(assessment.band[i])),
                    assessment.arm[i] if valid else "",
                    *(int(assessment.segments[name][i]) for name in palette.SEGMENTS),
                    f"{1e3 * recording.fit_error[i]:.2f}",
                    int(valid),
                    "; ".join(recording.causes(i)),
                    " ".join(JOINTS[j] for j in np.flatnonzero(assessment.outside[i])),
                ]
            )
            if i % _BLOCK == 0:
                progress(i / len(assessment.final))
    write_json(summary, summary_of(recording, assessment))
    return rows, summary


def summary_of(recording: Recording, assessment: Assessment) -> dict[str, Any]:
    """Return the summary of a scored recording.

    Keys, stable: ``version``, ``sheet``, ``frames``, ``valid_frames``, ``not_scored`` {cause:
    frames}, ``duration_s``, ``stature_m``; ``mean``, ``median``, ``p95``, ``max`` of the score over
    valid frames (null without one); ``share`` {action level: share of the valid frames}; ``worst``
    {``frame``, ``time_s``, ``reba``, ``risk``, ``arm``, ``reasons``, ``others``} or null: the worst
    frame, see `Assessment.worst`, and how many others have its score; ``segments`` {segment:
    {``mean``, ``max``, ``share`` {score: share of the valid frames}}}; ``outside`` {joint: frames
    beyond its range}; ``fit_error_mm`` {``median``, ``max``} (null when unknown),
    ``centre_error_mm`` {centre: the same}; ``markers`` {marker: {``frame`` of the body that it sits
    on, ``residual_mm``, null if it is never seen}}; ``read`` {name in the file: what it was used
    as, empty if it was not}; ``assumptions``. Frames count from 0.

    Args:
        recording: the recording that was scored.
        assessment: assessment of its n postures.
    """
    final, count = assessment.final[assessment.valid], int(assessment.valid.sum())
    levels = assessment.band[assessment.valid]
    outside = assessment.outside.sum(axis=0)
    error = 1e3 * recording.fit_error[np.isfinite(recording.fit_error)]
    return {
        "version": __version__,
        "sheet": "REBA",
        "frames": len(assessment.final),
        "valid_frames": count,
        "not_scored": {cause: int(frames.sum()) for cause, frames in recording.not_scored.items()},
        "duration_s": round(float(recording.time[-1] - recording.time[0]), 6),
        "stature_m": round(float(recording.person.stature), 4),
        "mean": round(float(final.mean()), 4) if count else None,
        "median": float(np.median(final)) if count else None,
        "p95": round(float(np.percentile(final, 95)), 4) if count else None,
        "max": int(final.max()) if count else None,
        "share": {
            name: _share(levels == level, count) for level, name in enumerate(reba.ACTION_LEVELS)
        },
        "worst": _worst(recording, assessment) if count else None,
        "segments": {name: _segment(assessment, name, count) for name in palette.SEGMENTS},
        "outside": {JOINTS[j]: int(outside[j]) for j in np.flatnonzero(outside)},
        "fit_error_mm": _spread(error) if error.size else None,
        "centre_error_mm": {
            centre: _spread(1e3 * each[np.isfinite(each)])
            for centre, each in recording.errors.items()
            if np.isfinite(each).any()
        },
        "markers": {
            name: {
                "frame": marker.frame,
                "residual_mm": round(1e3 * marker.residual, 3)
                if np.isfinite(marker.residual)
                else None,
            }
            for name, marker in recording.markers.items()
        },
        "read": dict(recording.read),
        "assumptions": list(recording.assumptions),
    }


def _worst(recording: Recording, assessment: Assessment) -> dict[str, Any]:
    i = assessment.worst(recording.time)
    return {
        "frame": i,
        "time_s": round(float(recording.time[i]), 6),
        "reba": int(assessment.final[i]),
        "risk": palette.risk_of_level(int(assessment.band[i])),
        "arm": str(assessment.arm[i]),
        "reasons": assessment.reasons(i),
        "others": int(np.sum(assessment.final == assessment.final[i])) - 1,
    }


def worst_in_words(worst: dict[str, Any]) -> str:
    """Return the worst frame of a summary, and how many more have its score."""
    more = f" and {worst['others']} more" if worst["others"] else ""
    where = f"frame {worst['frame']} at {worst['time_s']:.2f} s{more}"
    return f"{where}: REBA {worst['reba']}, {worst['risk']}"


def _segment(assessment: Assessment, name: str, count: int) -> dict[str, Any]:
    scores = assessment.segments[name][assessment.valid]
    return {
        "mean": round(float(scores.mean()), 4) if count else None,
        "max": int(scores.max()) if count else None,
        "share": {
            str(score): _share(scores == score, count)
            for score in range(1, palette.segment_highest(name) + 1)
        },
    }


def _spread(values: np.ndarray) -> dict[str, float]:
    return {"median": round(float(np.median(values)), 3), "max": round(float(values.max()), 3)}


def _share(here: np.ndarray, count: int) -> float:
    return round(float(here.sum()) / count, 6) if count else 0.0


_ANGLES: Final = (
    *JOINTS,
    *(f"{side}_{what}" for what in ("elevation", "elevation_plane") for side in SIDES),
)


def write_angles(
    recording: Recording, folder: Path, progress: Progress = unseen
) -> tuple[Path, Path]:
    """Write ``angles.csv`` and ``angles.mot``.

    Args:
        recording: recording with n frames.
        folder: folder of the files; it exists.
        progress: called with the share that is written.

    Returns:
        The two files.

    Raises:
        OSError: if they cannot be written.
    """
    table, motion = folder / "angles.csv", folder / "angles.mot"
    head = ["time_s", "scored", *(f"{name}_deg" for name in _ANGLES)]
    head += [f"{centre}_error_mm" for centre in recording.errors]
    with atomic_write(table) as scratch, scratch.open("w", encoding="utf-8") as file:
        file.write(",".join(head) + "\n")
        for rows in _blocks(recording, part_of(progress, 0.0, 0.5)):
            scored = recording.scored[rows].astype(float)[:, None]
            errors = [1e3 * each[rows, None] for each in recording.errors.values()]
            values = np.hstack(
                [recording.time[rows, None], scored, _degrees(recording, rows), *errors]
            )
            formats = ["%.6f", "%d", *["%.4f"] * len(_ANGLES), *["%.2f"] * len(errors)]
            lines = _text(values, ",".join(formats))
            file.write(lines.replace("nan", ""))
    with atomic_write(motion) as scratch, scratch.open("w", encoding="utf-8") as file:
        size = (f"nRows={len(recording.time)}", f"nColumns={1 + len(_ANGLES)}")
        file.write("\n".join(["ergoqp", "version=1", *size, "inDegrees=yes", "endheader\n"]))
        file.write("\t".join(["time", *_ANGLES]) + "\n")
        for rows in _blocks(recording, part_of(progress, 0.5, 1.0)):
            values = np.hstack([recording.time[rows, None], _degrees(recording, rows)])
            file.write(_text(values, "\t".join(["%.6f", *["%.6f"] * len(_ANGLES)])))
    return table, motion


def _blocks(recording: Recording, progress: Progress) -> Iterator[slice]:
    count = len(recording.time)
    for start in range(0, count, _BLOCK):
        yield slice(start, start + _BLOCK)
        progress(min(1.0, (start + _BLOCK) / count))


def _degrees(recording: Recording, rows: slice) -> np.ndarray:
    """Return the columns of `_ANGLES` [deg]."""
    postures = recording.postures[rows]
    return np.degrees(np.hstack([postures, *elevation_of(postures)]))


def _text(values: np.ndarray, line: str) -> str:
    """Return rows (n, m) as lines of text."""
    return ((line + "\n") * len(values)) % tuple(values.ravel().tolist())
