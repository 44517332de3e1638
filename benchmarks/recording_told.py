"""How far lost markers are put from where they were: each of a real take is taken away for a while.

Figures of `benchmarks.recordings`, by hand: for the second after a quarter of the take, and for its
second half, each marker by itself. ``told.gaps``: how many that are; ``told.share``: the share of
them that is told at all; of these, ``told.median_mm`` and ``told.most_mm``: how far the told places
are from where the marker was, root of the mean square over a gap; ``told.beyond``: the share in
which that is more than what is promised, 25 mm.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.report import Report
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.markers.fit import completed
from ergoqp.mocap.naming import best_set
from ergoqp.mocap.readers import read_motion
from ergoqp.mocap.recording import JointMotion

PROMISED = 0.025


def measure_told(report: Report, paths: list[Path]) -> None:
    """Print the figures of some takes, those in which a person moves."""
    every = report.pick(6, 1)
    gaps, off = 0, []
    for path in paths:
        motion = _alone(read_motion(path))
        for name in motion.names[::every]:
            count, rate = len(motion.time), 1 / float(np.median(np.diff(motion.time)))
            second = slice(count // 4, count // 4 + min(round(rate), count // 2))
            for rows in (second, slice(count // 2, None)):
                gaps += 1
                told = told_off(motion, name, rows)
                if told.size:
                    off.append(float(np.sqrt(np.mean(told**2))))
    report.figure("told.gaps", gaps)
    if off:
        report.figure("told.share", len(off) / gaps)
        report.figure("told.median_mm", 1000 * float(np.median(off)))
        report.figure("told.most_mm", 1000 * max(off))
        report.figure("told.beyond", float(np.mean(np.array(off) > PROMISED)))


def told_off(motion: JointMotion, name: str, rows: slice) -> np.ndarray:
    """Return how far a marker is put from where it was (k,) [m], of the frames in which it is.

    Args:
        motion: of the markers [m], z up.
        name: the marker.
        rows: frames in which it is lost.
    """
    i = motion.names.index(name)
    positions = motion.positions.copy()
    positions[rows, i] = np.nan
    gappy = replace(motion, positions=positions)
    alone = recording_of(gappy, name, ReadOptions(up="z", unit=1.0, completed=True))
    poses = alone.base_poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    pelvis = np.column_stack([poses[:, :3, 3], yaw])
    given = (alone.markers, alone.person, pelvis, alone.postures, np.eye(3), {})
    found = completed(gappy, *given)
    if found is None:
        return np.empty(0)
    off = np.linalg.norm(found.positions[rows, i] - motion.positions[rows, i], axis=1)
    return off[np.isfinite(off)]


def _alone(motion: JointMotion) -> JointMotion:
    """Return the markers of a take's set [m], those that are seen."""
    best = best_set(motion.names)
    assert best is not None
    wanted = set(best[0].found_in(motion.names).values())
    wanted |= {name for more in best[0].more_in(motion.names).values() for name in more}
    kept = [i for i, name in enumerate(motion.names) if name in wanted]
    return JointMotion(
        tuple(motion.names[i] for i in kept),
        motion.positions[:, kept].astype(float) * (motion.unit or 1.0),
        motion.time,
        markers=True,
    )
