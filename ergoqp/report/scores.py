"""The scores and joint angles of a recording as files: one row per frame, and a summary.

``scores.csv`` has one row per frame:

- ``time_s``: time stamp [s];
- ``reba_low``, ``reba``, ``reba_high``: final score 1 to 15 of the likeliest posture, and the
  lowest and highest over what is not seen or in doubt; 0 if the frame is not scored;
- ``risk``: action levels of ``reba_low`` and ``reba_high`` in words, as ``low to high``, or one if
  they are equal; ``not scored`` for 0;
- ``arm``: the arm with the higher score B, empty if either may have it, or if not scored;
- four columns per segment (``neck``, ``trunk``, ``legs``, ``right_upper_arm``, ...): its score
  ``<segment>_low``, ``<segment>``, ``<segment>_high``, 0 if not scored, and
  ``<segment>_observed``, the share of the joints it reads that are observed, 0 to 1;
- ``fit_error_mm``: distance of the fitted body from the recording, RMS [mm];
- ``valid``: 1 or 0;
- ``not_scored``: why not, causes separated by semicolons;
- ``doubts``: why some of the angles are not used, the same;
- ``outside``: joints beyond their range, separated by spaces.

``scores.json`` holds the result of `summary_of`. The joint angles of a recording as files for other
programs.

``angles.csv`` has one row per frame: ``time_s``; ``scored`` 1 or 0; every joint of
`ergoqp.joints.JOINTS` as ``<joint>_deg``, empty where it is not observed; ``<side>_elevation_deg``
and ``<side>_elevation_plane_deg`` of both upper arms (see `ergoqp.sheets.description`), empty where
flexion or abduction of that shoulder is not observed; and
``<centre>_error_mm``, the distance of the fitted body's joint centre from that of the
recording, empty if it is not seen.

``angles.mot`` has the same joints and elevations in degrees, in OpenSim's format for motions. It
must have numbers, so angles that are not observed are those of the likeliest posture.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ergoqp._version import __version__
from ergoqp.arguments import Progress, unseen
from ergoqp.files.atomic import atomic_write, write_json
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.report import palette
from ergoqp.report.between import risk_between
from ergoqp.report.seen import blocks, frames_of, observed_shares
from ergoqp.sheets import reba
from ergoqp.sheets.description import elevation_of
from ergoqp.sheets.reba import Assessment

if TYPE_CHECKING:
    from ergoqp.mocap import Recording


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
        parts = [
            f"{name}{end}"
            for name in palette.SEGMENTS
            for end in ("_low", "", "_high", "_observed")
        ]
        head = ["time_s", "reba_low", "reba", "reba_high", "risk", "arm", *parts]
        writer.writerow([*head, "fit_error_mm", "valid", "not_scored", "doubts", "outside"])
        for block, part in blocks(assessment, progress):
            columns = _columns(recording, block, part)
            writer.writerows(zip(*columns, strict=True))
    write_json(summary, summary_of(recording, assessment))
    return rows, summary


_RISKS: Final = np.array(
    [
        [risk_between(low, high) for high in (0, *palette.LEVEL_STARTS)]
        for low in (0, *palette.LEVEL_STARTS)
    ],
    dtype=object,
)
"""Words of the action levels of the lowest and the highest score, by level + 1; 0: not scored."""


def _columns(recording: Recording, rows: slice, part: Assessment) -> list[list[Any]]:
    """Return the columns of ``scores.csv`` for the frames of a block and their assessment."""
    valid = part.valid
    columns: list[list[Any]] = [[f"{each:.6f}" for each in recording.time[rows].tolist()]]
    columns += [(end * valid).tolist() for end in (part.final_low, part.final, part.final_high)]
    low, high = (palette.level_of_score(e * valid) for e in (part.final_low, part.final_high))
    columns.append(_RISKS[low + 1, high + 1].tolist())
    columns.append(np.where(valid & part.arm_known, part.arm, "").tolist())
    shares = observed_shares(recording, rows, part)
    for name in palette.SEGMENTS:
        ends = (part.segments_low, part.segments, part.segments_high)
        columns += [(end[name] * valid).tolist() for end in ends]
        columns.append(_decimals(shares[name]))
    columns.append([f"{1e3 * each:.2f}" for each in recording.fit_error[rows].tolist()])
    columns.append(valid.astype(int).tolist())
    for causes in (recording.not_scored, recording.doubts):
        here = {cause: frames[rows] for cause, frames in causes.items()}
        columns.append(_named(here, len(valid), "; "))
    columns.append(_named(dict(zip(JOINTS, part.outside.T, strict=True)), len(valid), " "))
    return columns


def _decimals(shares: np.ndarray) -> list[str]:
    """Return shares (n,) with two decimals at most; there are only few different ones."""
    values, places = np.unique(shares, return_inverse=True)
    words = np.array([f"{value:.2f}".rstrip("0").rstrip(".") for value in values], dtype=object)
    return words[places].tolist()


def _named(causes: Mapping[str, np.ndarray], count: int, between: str) -> list[str]:
    """Return the causes of each of some frames, in words.

    Args:
        causes: cause -> the frames that have it (count,) bool.
        count: number of frames.
        between: what separates the causes.
    """
    words = [""] * count
    for cause, frames in causes.items():
        for i in np.flatnonzero(frames).tolist():
            words[i] += f"{between}{cause}" if words[i] else cause
    return words


def summary_of(recording: Recording, assessment: Assessment) -> dict[str, Any]:
    """Return the summary of a scored recording.

    Keys, stable: ``version``, ``sheet``, ``frames``, ``valid_frames``, ``exact_frames`` (lowest and
    highest score are equal), ``not_scored`` {cause: frames}, ``doubts`` {cause: frames},
    ``duration_s``, ``stature_m``; ``mean``, ``median``, ``p95``, ``max`` of the score of the
    likeliest postures over valid frames (null without one), and each with ``_low`` and ``_high``,
    of the lowest and of the highest scores; ``share`` {action level: share of the valid frames},
    ``share_low`` and ``share_high``, the same of the lowest and highest scores; ``worst``
    {``frame``, ``time_s``, ``reba``, ``reba_low``, ``reba_high``, ``risk``, ``arm``, ``reasons``,
    ``others``} or null: the frame with the highest likeliest score, see `Assessment.worst`, and how
    many others have that score; ``risk`` and ``arm`` as in ``scores.csv``; ``segments`` {segment:
    {``mean``, ``mean_low``, ``mean_high``, ``max``, ``max_low``,
    ``max_high``, ``share`` {score: share of the valid frames}, ``usual`` {``low``, ``high``,
    ``share``} or null: the most frequent pair of lowest and highest score, and how often it is,
    ``observed``: share of the joints that it reads which are observed, mean over the valid
    frames}}; ``outside`` {joint: frames beyond its range}; ``fit_error_mm`` {``median``, ``max``}
    (null when unknown), ``centre_error_mm`` {centre: the same}; ``markers`` {marker: {``frame`` of
    the body that it sits on, ``residual_mm``, null if it is never seen}}; ``read`` {name in the
    file: what it was used as, empty if it was not}; ``assumptions``. Frames count from 0.

    Args:
        recording: the recording that was scored.
        assessment: assessment of its n postures.
    """
    valid, count = assessment.valid, int(assessment.valid.sum())
    finals = {
        "": assessment.final[valid],
        "_low": assessment.final_low[valid],
        "_high": assessment.final_high[valid],
    }
    outside = assessment.outside.sum(axis=0)
    error = 1e3 * recording.fit_error[np.isfinite(recording.fit_error)]
    statistics: dict[str, Any] = {}
    for name, of in _STATISTICS.items():
        for end, final in finals.items():
            statistics[f"{name}{end}"] = of(final) if count else None
    for end, final in finals.items():
        levels = palette.level_of_score(final)
        statistics[f"share{end}"] = {
            name: _share(levels == level, count) for level, name in enumerate(reba.ACTION_LEVELS)
        }
    return {
        "version": __version__,
        "sheet": "REBA",
        "frames": len(assessment.final),
        "valid_frames": count,
        "exact_frames": int(np.sum(finals["_low"] == finals["_high"])),
        "not_scored": {cause: int(frames.sum()) for cause, frames in recording.not_scored.items()},
        "doubts": {cause: int(frames.sum()) for cause, frames in recording.doubts.items()},
        "duration_s": round(float(recording.time[-1] - recording.time[0]), 6),
        "stature_m": round(float(recording.person.stature), 4),
        **statistics,
        "worst": _worst(recording, assessment) if count else None,
        "segments": _segments(recording, assessment),
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


_STATISTICS: Final[Mapping[str, Callable[[np.ndarray], float]]] = {
    "mean": lambda scores: round(float(scores.mean()), 4),
    "median": lambda scores: float(np.median(scores)),
    "p95": lambda scores: round(float(np.percentile(scores, 95)), 4),
    "max": lambda scores: int(scores.max()),
}
"""Statistics of scores (n,) over the frames."""


def _worst(recording: Recording, assessment: Assessment) -> dict[str, Any]:
    i = assessment.worst(recording.time)
    return {
        "frame": i,
        "time_s": round(float(recording.time[i]), 6),
        "reba": int(assessment.final[i]),
        "reba_low": int(assessment.final_low[i]),
        "reba_high": int(assessment.final_high[i]),
        "risk": risk_between(int(assessment.final_low[i]), int(assessment.final_high[i])),
        "arm": str(assessment.arm[i]) if assessment.arm_known[i] else "",
        "reasons": assessment.reasons(i),
        "others": int(np.sum(assessment.final == assessment.final[i])) - 1,
    }


_MOST: Final = 8
"""More than the highest score of a segment."""


def _segments(recording: Recording, assessment: Assessment) -> dict[str, dict[str, Any]]:
    """Return the statistics of every segment."""
    # How often each lowest, likeliest and highest score are together.
    counts = {name: np.zeros(_MOST**3, dtype=np.int64) for name in palette.SEGMENTS}
    observed = dict.fromkeys(palette.SEGMENTS, 0.0)
    for rows, part in blocks(assessment):
        shares = observed_shares(recording, rows, part)
        for name, each in counts.items():
            ends = (part.segments_low, part.segments, part.segments_high)
            low, likeliest, high = (end[name][part.valid] for end in ends)
            places = (low * _MOST + likeliest) * _MOST + high
            each += np.bincount(places, minlength=_MOST**3)
            observed[name] += float(shares[name][part.valid].sum())
    return {
        name: _segment(name, each.reshape((_MOST,) * 3), observed[name])
        for name, each in counts.items()
    }


def _segment(name: str, counts: np.ndarray, observed: float) -> dict[str, Any]:
    """Return the statistics of a segment.

    Args:
        name: its name.
        counts: number of frames with each lowest, likeliest and highest score.
        observed: sum of the shares of its joints that are observed, over these frames.
    """
    count, found = int(counts.sum()), {}
    likeliest = counts.sum(axis=(0, 2))
    if not count:
        ends = ("", "_low", "_high")
        return {
            **{f"{what}{end}": None for what in ("mean", "max") for end in ends},
            "share": {str(score): 0.0 for score in range(1, palette.segment_highest(name) + 1)},
            "usual": None,
            "observed": None,
        }
    scores = np.arange(_MOST)
    for end, each in (
        ("", likeliest),
        ("_low", counts.sum(axis=(1, 2))),
        ("_high", counts.sum(axis=(0, 1))),
    ):
        found[f"mean{end}"] = round(float(scores @ each) / count, 4)
        found[f"max{end}"] = int(np.flatnonzero(each)[-1])
    together = counts.sum(axis=1)
    low, high = (int(each) for each in np.unravel_index(together.argmax(), together.shape))
    return {
        **found,
        "share": {
            str(score): round(int(likeliest[score]) / count, 6)
            for score in range(1, palette.segment_highest(name) + 1)
        },
        "usual": {"low": low, "high": high, "share": round(int(together.max()) / count, 6)},
        "observed": round(observed / count, 6),
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
    size = (f"nRows={len(recording.time)}", f"nColumns={1 + len(_ANGLES)}")
    lines = ["ergoqp", "version=1", *size, "inDegrees=yes", "endheader", ""]
    formats = ["%.6f", "%d", *["%.4f"] * len(_ANGLES), *["%.2f"] * len(recording.errors)]
    with (
        atomic_write(table) as table_scratch,
        atomic_write(motion) as motion_scratch,
        table_scratch.open("w", encoding="utf-8") as as_table,
        motion_scratch.open("w", encoding="utf-8") as as_motion,
    ):
        as_table.write(",".join(head) + "\n")
        as_motion.write("\n".join(lines) + "\t".join(["time", *_ANGLES]) + "\n")
        for rows in frames_of(len(recording.time), progress):
            time, degrees = recording.time[rows, None], _degrees(recording, rows)
            values = np.hstack([time, degrees])
            as_motion.write(_text(values, "\t".join(["%.6f", *["%.6f"] * len(_ANGLES)])))
            np.copyto(degrees, np.nan, where=~_observed(recording, rows))
            scored = recording.scored[rows].astype(float)[:, None]
            errors = [1e3 * each[rows, None] for each in recording.errors.values()]
            values = np.hstack([time, scored, degrees, *errors])
            as_table.write(_text(values, ",".join(formats)).replace("nan", ""))
    return table, motion


def _degrees(recording: Recording, rows: slice) -> np.ndarray:
    """Return the columns of `_ANGLES` [deg]."""
    postures = recording.postures[rows]
    return np.degrees(np.hstack([postures, *elevation_of(postures)]))


def _observed(recording: Recording, rows: slice) -> np.ndarray:
    """Return whether the columns of `_ANGLES` are observed."""
    observed = recording.observed[rows]
    raised = [
        observed[:, INDEX[f"{side}_shoulder_flexion"]]
        & observed[:, INDEX[f"{side}_shoulder_abduction"]]
        for side in SIDES
    ]
    return np.column_stack([observed, *raised, *raised])


def _text(values: np.ndarray, line: str) -> str:
    """Return rows (n, m) as lines of text."""
    return ((line + "\n") * len(values)) % tuple(values.ravel().tolist())
