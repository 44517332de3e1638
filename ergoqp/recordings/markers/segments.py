"""Pelvis, trunk and head as rigid shapes of markers, from the take and a person file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.human.person_file import Marker
from ergoqp.joints import SIDES
from ergoqp.recordings.markers.landmarks import RIGID
from ergoqp.recordings.markers.rigid import brought_to, follow, shape_of
from ergoqp.recordings.motion import JointMotion

_THREE: Final = 0.012
"""Largest distance of three common markers from the person file's shape [m]; it is small, because
three markers also fit the file of a similar person well."""
_MORE: Final = 0.02
"""The same for more than three markers, which show the difference between people better [m]."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A rigid segment with its markers.

    Attributes:
        name: its name in `ergoqp.recordings.markers.landmarks.RIGID`.
        names: its landmarks and further markers.
        places: for each, the indices of the points whose middle it is.
        shape: their positions in the segment (m, 3) [m]; NaN for an unknown one.
    """

    name: str
    names: tuple[str, ...]
    places: tuple[tuple[int, ...], ...]
    shape: np.ndarray

    def complete(
        self,
        at: dict[str, np.ndarray],
        block: np.ndarray,
        unit: float,
        filled: Counter[str],
        inside: slice,
    ) -> dict[str, np.ndarray]:
        """Place landmarks that are not seen, or in a wrong place, by the others.

        Args:
            at: landmark -> positions (n, 3) [m], changed in place.
            block: block of the recording's points (n, m, 3).
            unit: unit of length [m].
            filled: landmark -> number of frames in which it is not seen and placed, added to.
            inside: the frames that are counted.

        Returns:
            Landmark or marker -> the frames in which it is in a wrong place (n,) bool.
        """
        points = np.stack([middle_of(block, each, unit) for each in self.places], axis=1)
        followed = follow(points, self.shape)
        for i, name in enumerate(self.names):
            if name not in at:
                continue
            lost = np.isnan(at[name]).any(axis=1) & np.isfinite(followed.points[:, i, 0])
            filled[name] += int(lost[inside].sum())
            put = (lost | followed.astray[:, i])[:, None]
            at[name] = np.where(put, followed.points[:, i], at[name])
        return {name: followed.astray[:, i] for i, name in enumerate(self.names)}


def rigid_segments(
    motion: JointMotion,
    landmarks: Mapping[str, tuple[int, ...]],
    more: Mapping[str, tuple[int, ...]],
    given: Mapping[str, Marker],
    unit: float,
    every: int,
) -> tuple[list[Segment], list[str]]:
    """Return the segments of which three or more points are known, and sentences.

    Args:
        motion: the markers.
        landmarks: landmark -> indices of the markers whose middle it is.
        more: rigid segment -> indices of its further markers.
        given: marker -> its place on the body, from a person file.
        unit: unit of length [m].
        every: step between the frames that are used.
    """
    found, said = [], []
    for segment, parts in RIGID.items():
        which = {name: landmarks[name] for name in parts if name in landmarks}
        which |= {motion.names[i]: (i,) for i in more.get(segment, ())}
        if len(which) < 3:
            continue
        points = [middle_of(motion.positions[::every], each, unit) for each in which.values()]
        shape = shape_of(np.stack(points, axis=1))
        if shape is None:
            continue
        theirs = _given_shape([[motion.names[i] for i in each] for each in which.values()], given)
        lacking = np.isnan(shape[:, 0]) & np.isfinite(theirs[:, 0])
        both = brought_to(theirs, shape) if lacking.any() else None
        shared = int((np.isfinite(shape[:, 0]) & np.isfinite(theirs[:, 0])).sum())
        if both is not None and both[1] > (_THREE if shared == 3 else _MORE):
            said.append(
                f"The {segment}'s markers are not where the person file has them, by"
                f" {1000 * both[1]:.0f} mm: those that are never seen are not placed by it."
            )
        elif both is not None:
            names = [
                name.replace("_", " ") for name, lacks in zip(which, lacking, strict=True) if lacks
            ]
            said.append(
                f"Never seen and placed as in the person file: {', '.join(names)}; the others of"
                f" the {segment} agree with it to {1000 * both[1]:.0f} mm."
            )
            shape = np.where(lacking[:, None], both[0], shape)
        found.append(Segment(segment, tuple(which), tuple(which.values()), shape))
    return found, said


def pelvis_size(segments: list[Segment]) -> tuple[float, float]:
    """Return the width between the ASIS and the depth to the PSIS [m]; NaN where unknown."""
    pelvis = next((each for each in segments if each.name == "pelvis"), None)
    if pelvis is None:
        return float("nan"), float("nan")
    lost = np.full(3, np.nan)
    place = dict(zip(pelvis.names, pelvis.shape, strict=True))
    right, left = place.get("right_asis", lost), place.get("left_asis", lost)
    across, front = left - right, (right + left) / 2
    width = float(np.linalg.norm(across))
    backs = [place.get(f"{side}_psis", lost) for side in SIDES]
    for back in (sum(backs) / 2, place.get("sacrum", lost), *backs):
        deep = front - back
        # Only the part perpendicular to the width counts, so one PSIS is enough.
        deep = deep - (deep @ across) / width**2 * across
        if np.isfinite(deep).all():
            return width, float(np.linalg.norm(deep))
    return width, float("nan")


def middle_of(positions: np.ndarray, which: tuple[int, ...], unit: float) -> np.ndarray:
    """Return the middle of some points over time (n, 3) [m].

    Args:
        positions: positions of all points (n, m, 3), in the file's unit.
        which: indices of the points.
        unit: unit of length [m].
    """
    return unit * positions[:, list(which)].astype(float).mean(axis=1)


def _given_shape(names: list[list[str]], given: Mapping[str, Marker]) -> np.ndarray:
    """Return the places of points, as middles of markers, in a person file (m, 3) [m]; NaN: none.

    Only markers on the same segment as most of them count, because only these move as one.
    """
    frames = Counter(given[name].frame for each in names for name in each if name in given)
    shape = np.full((len(names), 3), np.nan)
    if frames:
        frame = frames.most_common(1)[0][0]
        for i, each in enumerate(names):
            if all(name in given and given[name].frame == frame for name in each):
                shape[i] = np.mean([given[name].offset for name in each], axis=0)
    return shape
