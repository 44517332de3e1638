"""The tree of coordinate frames that ROS nodes publish piece by piece (tf2_msgs/TFMessage).

Trackers publish a person's joints as coordinate frames in the frame of their camera.
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
        names: names of the coordinate frames (m,).
        within: their root, in whose axes the positions are.
        positions: positions (n, m, 3), NaN where unknown.
        turns: name -> unit quaternions (n, 4), NaN where unknown.
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
    """Coordinate frames, each given in its parent."""

    def __init__(self, where: str) -> None:
        """Begin without coordinate frames; `where` is the file's name."""
        self.where = where
        self._moving: dict[str, dict[str, Series]] = {}
        self._still: dict[str, tuple[str, tuple[float, ...]]] = {}

    @property
    def names(self) -> list[str]:
        """The coordinate frames that move."""
        return list(self._moving)

    def take(self, message: Any, recorded: int, still: bool) -> None:
        """Add a message that was recorded at a time [ns]; `still`: whether it is static."""
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
                    f"{self.where}: got more than {MOST} moving frames of tf, allowed at most that"
                    " many"
                )

    def joints(self) -> Moved:
        """Return the frames that move, at the times of the one that is published most often.

        Raises:
            RecordingError: if the tree has a cycle, or time runs backwards.
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
            f"The positions are those of the {len(names)} moving frames of tf, in the axes of their"
            f" root {short(root)} and at the times of {short(clock)}.",
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
        """Return a frame's pose in another (n, 7), NaN where unknown; None if not connected."""
        parents, _ = self._parents()
        one, other = (_chain(self.where, each, parents)[::-1] for each in (name, target))
        if one[0] != other[0]:
            return None
        # The poses of the common ancestors are not needed.
        while len(one) > 1 and len(other) > 1 and one[1] == other[1]:
            one, other = one[1:], other[1:]
        below, above = (self._along(chain, frames) for chain in (one, other))
        return onto(_reversed(above), below)

    def _along(self, chain: list[str], frames: Frames) -> np.ndarray:
        """Return the pose of the last frame of a chain in the first one (n, 7)."""
        pose = np.tile(np.array([0, 0, 0, 0, 0, 0, 1], np.float32), (len(frames.time), 1))
        for parent, child in pairwise(chain):
            pose = onto(pose, self._pose(child, parent, frames))
        return pose

    def _parents(self) -> tuple[dict[str, str], list[str]]:
        """Return child -> parent, and sentences about children with several parents."""
        parents = {child: parent for child, (parent, _) in self._still.items()}
        notes = []
        for child, series in self._moving.items():
            # The usual parent counts, if the frame is sometimes published in another one.
            parents[child] = max(series, key=lambda parent: len(series[parent]))
            if len(series) > 1:
                notes.append(
                    f"The frame {short(child)} of tf has {len(series)} different parents; it is"
                    f" read in {short(parents[child])}."
                )
        return parents, notes

    def _pose(self, child: str, parent: str, frames: Frames) -> np.ndarray:
        """Return a frame's pose in its parent (n, 7), NaN where unknown."""
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
    """Return quaternions (n, 4) of length 1 in 32 bits, NaN where they have no direction."""
    # The square of a large number would overflow 32 bits.
    return unit_turns(rows.astype(float)).astype(np.float32)


def _chain(where: str, name: str, parents: Mapping[str, str]) -> list[str]:
    """Return a frame, its parent and so on up to the root."""
    chain: dict[str, None] = {name: None}
    while (parent := parents.get(next(reversed(chain)))) is not None:
        if parent in chain:
            raise RecordingError(
                f"{where}: got the frame {short(parent)} of tf inside itself, allowed a tree"
            )
        chain[parent] = None
    return list(chain)


def onto(above: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return the product of two poses (n, 7): that of a frame, and a pose in that frame."""
    # scipy is loaded here only, because most files need no rotations.
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(above).all(axis=1) & np.isfinite(pose).all(axis=1)
    out = np.full_like(pose, np.nan)
    if seen.any():
        turn = Rotation.from_quat(above[seen, 3:])
        out[seen, :3] = above[seen, :3] + turn.apply(pose[seen, :3])
        out[seen, 3:] = (turn * Rotation.from_quat(pose[seen, 3:])).as_quat()
    return out


def _reversed(pose: np.ndarray) -> np.ndarray:
    """Return the inverse of poses (n, 7)."""
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(pose).all(axis=1)
    out = np.full_like(pose, np.nan)
    if seen.any():
        turn = Rotation.from_quat(pose[seen, 3:]).inv()
        out[seen, :3] = -turn.apply(pose[seen, :3])
        out[seen, 3:] = turn.as_quat()
    return out
