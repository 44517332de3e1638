"""The tree of coordinate frames that ROS nodes publish piece by piece (tf2_msgs/TFMessage).

Trackers publish a person's joints as frames in that of their camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.bag_series import MOST, Frames, Series, finite, plain, stamp_of
from ergoqp.recordings.formats.opening import short, some
from ergoqp.recordings.formats.poses import unit_turns
from ergoqp.recordings.formats.stamps import repeated


@dataclass(frozen=True)
class Moved:
    """The coordinate frames that move, all in their common root.

    Attributes:
        names: of the coordinate frames (m,).
        within: their root, in whose axes they are.
        positions: where they are (n, m, 3), NaN where not known.
        turns: name -> unit quaternions (n, 4), NaN where not known.
        frames: the frames in time.
        notes: sentences about them.
    """

    names: tuple[str, ...]
    within: str
    positions: np.ndarray
    turns: Mapping[str, np.ndarray]
    frames: Frames
    notes: tuple[str, ...]


class Tree:
    """Coordinate frames, each in its parent's."""

    def __init__(self, where: str) -> None:
        """Begin without any, of the file of this name."""
        self.where = where
        self._moving: dict[str, dict[str, Series]] = {}
        self._still: dict[str, tuple[str, tuple[float, ...]]] = {}

    @property
    def names(self) -> list[str]:
        """The frames that move."""
        return list(self._moving)

    def take(self, message: Any, recorded: int, still: bool) -> None:
        """Add a message, recorded at this time [ns]; whether it holds for ever."""
        for each in message.transforms:
            parent, child = (n.lstrip("/") for n in (each.header.frame_id, each.child_frame_id))
            row = pose_row(each.transform.translation, each.transform.rotation)
            if still:
                self._still[child] = (parent, row)
                continue
            parents = self._moving.setdefault(child, {})
            parents.setdefault(parent, Series(7)).add(stamp_of(each.header), recorded, row)
            if len(self._moving) > MOST or len(parents) > MOST:
                raise RecordingError(
                    f"{self.where}: got more than {MOST} moving frames of tf, allowed so many"
                )

    def joints(self) -> Moved:
        """Return the frames that move, at the times of the one that is told most often.

        Raises:
            RecordingError: the tree has a circle, or time runs backwards.
        """
        parents, notes = self._parents()
        chains = {name: _chain(self.where, name, parents) for name in self._moving}
        roots = [chain[-1] for chain in chains.values()]
        root = max(dict.fromkeys(roots), key=roots.count)
        names = tuple(name for name, chain in chains.items() if chain[-1] == root)
        own = {name: self._moving[name][parents[name]] for name in names}
        clock = max(own, key=lambda name: len(own[name]))
        frames = own[clock].frames(self.where)
        others = [plain(name) for name in chains if name not in names]
        notes = [
            *frames.notes,
            *notes,
            f"The positions are those of the {len(names)} moving frames of tf in their root"
            f" {short(root)}, and in its axes, at the times of {short(clock)}.",
        ]
        if others:
            notes.append(f"The frames {some(others)} of tf have another root and are not read.")
        known: dict[str, np.ndarray] = {}
        for name in names:
            for link in reversed(chains[name][:-1]):
                if link not in known:
                    pose = self._pose(link, parents[link], frames)
                    above = known.get(parents[link])
                    known[link] = pose if above is None else onto(above, pose)
        positions = np.stack([known[name][:, :3] for name in names], axis=1)
        turns = {name: known[name][:, 3:] for name in names}
        return Moved(names, root, positions, turns, frames, (*notes, *repeated(positions)))

    def between(self, name: str, target: str, frames: Frames) -> np.ndarray | None:
        """Return a frame's pose in another one (n, 7), NaN where not known; None if apart."""
        parents, _ = self._parents()
        one, other = (_chain(self.where, each, parents)[::-1] for each in (name, target))
        if one[0] != other[0]:
            return None
        # What both hang from need not be known.
        while len(one) > 1 and len(other) > 1 and one[1] == other[1]:
            one, other = one[1:], other[1:]
        below, above = (self._along(chain, frames) for chain in (one, other))
        return onto(_reversed(above), below)

    def _along(self, chain: list[str], frames: Frames) -> np.ndarray:
        """Return the pose of the last of some frames, each in the one before, in the first."""
        pose = np.tile(np.array([0, 0, 0, 0, 0, 0, 1], np.float32), (len(frames.time), 1))
        for parent, child in pairwise(chain):
            pose = onto(pose, self._pose(child, parent, frames))
        return pose

    def _parents(self) -> tuple[dict[str, str], list[str]]:
        """Return child -> parent, and what is said of children with several."""
        parents = {child: parent for child, (parent, _) in self._still.items()}
        notes = []
        for child, series in self._moving.items():
            # Told once in a while in another frame, and else in its usual one.
            parents[child] = max(series, key=lambda parent: len(series[parent]))
            if len(series) > 1:
                notes.append(
                    f"The frame {short(child)} of tf is told in {len(series)} others; it is read in"
                    f" {short(parents[child])}."
                )
        return parents, notes

    def _pose(self, child: str, parent: str, frames: Frames) -> np.ndarray:
        """Return a frame's pose in its parent (n, 7), NaN where not known."""
        if child in self._moving:
            rows = self._moving[child][parent].at(frames, f"{self.where}: {plain(child)}")
        else:
            row = np.array([self._still[child][1]], dtype=np.float32)
            rows = np.tile(finite(row, f"{self.where}: {plain(child)}"), (len(frames.time), 1))
        return np.concatenate([rows[:, :3], turns_of(rows[:, 3:])], axis=1)


def pose_row(place: Any, turn: Any) -> tuple[float, ...]:
    """Return a message's position and quaternion x, y, z, w in a row."""
    return (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)


def turns_of(rows: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) of length 1 as 32 bit numbers, NaN where they are none."""
    # The square of a large number is none of 32 bits.
    return unit_turns(rows.astype(float)).astype(np.float32)


def _chain(where: str, name: str, parents: Mapping[str, str]) -> list[str]:
    """Return a frame, its parent and so on up to the root."""
    chain: dict[str, None] = {name: None}
    while (parent := parents.get(next(reversed(chain)))) is not None:
        if parent in chain:
            raise RecordingError(
                f"{where}: got the frame {short(parent)} of tf within itself, allowed a tree"
            )
        chain[parent] = None
    return list(chain)


def onto(above: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return poses (n, 7) in a frame, given the frame's own (n, 7)."""
    # scipy's are loaded where they are needed: most files have none.
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(above).all(axis=1) & np.isfinite(pose).all(axis=1)
    out = np.full_like(pose, np.nan)
    if seen.any():
        turn = Rotation.from_quat(above[seen, 3:])
        out[seen, :3] = above[seen, :3] + turn.apply(pose[seen, :3])
        out[seen, 3:] = (turn * Rotation.from_quat(pose[seen, 3:])).as_quat()
    return out


def _reversed(pose: np.ndarray) -> np.ndarray:
    """Return poses (n, 7) of what is seen from them, in them."""
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(pose).all(axis=1)
    out = np.full_like(pose, np.nan)
    if seen.any():
        turn = Rotation.from_quat(pose[seen, 3:]).inv()
        out[seen, :3] = -turn.apply(pose[seen, :3])
        out[seen, 3:] = turn.as_quat()
    return out
