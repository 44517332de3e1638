"""A group's place as files; see ``docs/group_json.md``.

``group.json`` has the keys ``version``, ``problem``, ``title``, ``objective``, ``people``, ``position_m`` (x, y, z),
``quaternion_xyzw``, ``maximum``, ``mean``, ``own_mean``, ``grid_maximum``, ``grid_mean``, ``grid_spacing_m``, ``free``
{axis: {``maximum``, ``mean``}}, ``placements``, ``seconds``, ``members`` and ``assumptions``; each member ``label``,
``stature_m``, ``reba``, ``cost``, ``own_reba``, ``pays``, ``reach``, ``segments``, ``reasons``, ``own_position_m`` and
``own_quaternion_xyzw``.

``group.npz`` has the arrays: ``pose`` (4, 4), ``postures`` (people, 32) [rad], ``labels``, and of the grid ``x``, ``y``,
``z`` [m], ``tilts`` (k, 3, 3) and ``scores`` (people, x, y, z, k), 0 where the person does not reach.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ergoqp import __version__
from ergoqp.files.whole import whole, write_whole
from ergoqp.placing.group.optimum import GroupOptimum, Member


def write_group(found: GroupOptimum, folder: Path) -> Path:
    """Write both files and return the path of ``group.json``.

    Args:
        found: what was found.
        folder: where to; it is made if it is not there.

    Raises:
        OSError: if they cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    grid = found.grid
    with whole(folder / "group.npz") as scratch:
        np.savez_compressed(
            scratch,
            allow_pickle=False,
            pose=found.pose,
            postures=np.array([member.posture for member in found.members]),
            labels=np.array([member.label for member in found.members], dtype=np.str_),
            x=grid.x,
            y=grid.y,
            z=grid.z,
            tilts=grid.tilts,
            scores=grid.scores.reshape(-1, *grid.shape),
        )
    path = folder / "group.json"
    write_whole(path, json.dumps(summary_of_group(found), indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    return path


def summary_of_group(found: GroupOptimum) -> dict[str, Any]:
    """Return what ``group.json`` holds: plain numbers, texts, lists and dicts."""
    return {
        "version": __version__,
        "problem": found.problem,
        "title": found.title,
        "objective": found.objective,
        "people": len(found.members),
        **_place("", found.pose),
        "maximum": found.maximum,
        "mean": round(found.mean, 6),
        "own_mean": round(found.own_mean, 6),
        "grid_maximum": int(found.grid_reba.max()),
        "grid_mean": round(float(found.grid_reba.mean()), 6),
        "grid_spacing_m": found.spacing,
        "free": {axis: {"maximum": highest, "mean": round(mean, 6)} for axis, (highest, mean) in found.free.items()},
        "placements": found.placements,
        "seconds": round(found.seconds, 3),
        "members": [_member(member) for member in found.members],
        "assumptions": list(found.assumptions),
    }


def _member(member: Member) -> dict[str, Any]:
    return {
        "label": member.label,
        "stature_m": round(member.body.stature, 6),
        "reba": member.reba,
        "cost": round(member.cost, 6),
        "own_reba": member.own_reba,
        "pays": member.pays,
        "reach": round(member.reach, 6),
        "segments": member.segments,
        "reasons": member.reasons,
        **_place("own_", member.own_pose),
    }


def _place(prefix: str, pose: np.ndarray) -> dict[str, list[float]]:
    w, x, y, z = quaternion_of(pose[:3, :3])
    return {
        f"{prefix}position_m": np.round(pose[:3, 3], 6).tolist(),
        f"{prefix}quaternion_xyzw": np.round([x, y, z, w], 9).tolist(),
    }


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Return the quaternion (4,), w first, of a rotation (3, 3)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion
