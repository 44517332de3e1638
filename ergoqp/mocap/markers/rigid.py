"""Rigid shapes of markers: pelvis, trunk and head, their shape, and its pose in each frame.

The rotation that fits a shape to points by least squares is Kabsch's (1976). Of four or more
markers, one that does not fit is left out: it is another marker, or has fallen off. Two markers
that fit after an exchange are exchanged. If none of this fits, or the others are in a line, the
pose is unknown.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, compress
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation

from ergoqp.human.body import Marker
from ergoqp.joints import SIDES, spoken
from ergoqp.mocap.naming import RIGID
from ergoqp.mocap.recording import JointMotion

_TOGETHER: Final = (
    ("shoulder", "upper_arm", "outer_elbow", "inner_elbow"),
    ("outer_elbow", "inner_elbow", "forearm", "wrist_thumb", "wrist_small"),
    ("wrist_thumb", "wrist_small", "hand"),
    ("hip", "thigh", "outer_knee", "inner_knee"),
    ("outer_knee", "inner_knee", "shank", "outer_ankle", "inner_ankle"),
    ("outer_ankle", "inner_ankle", "heel", "forefoot"),
)
"""Groups of landmarks and joint centres of a side in which any two keep their distance: markers
beside a joint are near its axis."""


_SHARE: Final = 0.25
"""Least share of the time in which a marker is in its right place."""


_TIMES: Final = 6.0
"""Factor on the usual deviation of a distance by which it may differ."""


_LEEWAY: Final = (0.025, 0.08)
"""Limits of that difference: the smallest because skin moves, and the largest [m]."""


_SLIDES: Final = {"hip": 0.07, "shoulder": 0.06, "knee": 0.035}
"""Part of a name -> its smallest limit for distances from there, the first that is in it [m].

In a deep bend the thigh pushes the markers of the pelvis, by which the hip is placed, and the skin
slides over the knee. The shoulder blade turns with a raised arm, and its marker is not at the
joint.
"""


class Links:
    """The distances that markers of a person keep.

    Args:
        at: landmark -> positions (n, 3) [m] in a sample of frames; NaN where not seen.
    """

    def __init__(self, at: Mapping[str, np.ndarray]) -> None:
        """Measure the distances."""
        pairs = {
            (f"{side}_{one}", f"{side}_{other}")
            for side in SIDES
            for group in _TOGETHER
            for one, other in combinations(group, 2)
        }
        self._usual: dict[tuple[str, str], tuple[float, float]] = {}
        for one, other in sorted(pairs):
            if one in at and other in at:
                middle = usual_distance(at[one], at[other])
                if np.isfinite(middle):
                    slides = (most for part, most in _SLIDES.items() if part in one + other)
                    least = next(slides, _LEEWAY[0])
                    off = np.abs(np.linalg.norm(at[one] - at[other], axis=1) - middle)
                    varies = 1.4826 * float(np.nanmedian(off))
                    leeway = float(np.clip(_TIMES * varies, least, _LEEWAY[1]))
                    self._usual[one, other] = (middle, leeway)

    def astray(self, at: Mapping[str, np.ndarray], around: int = 0) -> dict[str, np.ndarray]:
        """Return the landmarks in a wrong place -> those frames (n,) bool.

        A landmark with the most wrong distances is in a wrong place. Its distances are removed, and
        this is repeated until no distance is wrong. Landmarks with equally many are all taken, so
        of two landmarks that only disagree with each other neither is used.

        Args:
            at: landmark -> positions (n, 3) [m]; NaN where not seen.
            around: number of frames before and after, in which a marker moves there and back.
        """
        if not self._usual:
            return {}
        names = sorted({name for pair in self._usual for name in pair})
        which = np.array([[names.index(name) for name in pair] for pair in self._usual])
        usual, leeway = np.array(list(self._usual.values())).T
        length = np.stack(
            [np.linalg.norm(at[one] - at[other], axis=1) for one, other in self._usual], axis=1
        )
        seen = np.isfinite(length)
        broken = seen & (np.abs(np.where(seen, length, usual) - usual) > leeway)
        rows = np.flatnonzero(broken.any(axis=1))
        found = np.zeros((len(length), len(names)), dtype=bool)
        if len(rows):
            found[rows] = _out(broken[rows], which, len(names))
            found = binary_dilation(found, np.ones((2 * around + 1, 1), dtype=bool))
        return {name: found[:, i] for i, name in enumerate(names) if found[:, i].any()}


def _out(broken: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return which of some markers are in a wrong place (n, count) bool.

    Args:
        broken: links whose distance is wrong (n, links) bool.
        which: ends of the links (links, 2).
        count: number of markers.
    """
    ends = np.zeros((len(which), count))
    ends[np.arange(len(which))[:, None], which] = 1.0
    out = np.zeros((len(broken), count), dtype=bool)
    for _ in range(count):
        bad = broken @ ends
        now = (bad == bad.max(axis=1, keepdims=True)) & (bad > 0)
        if not now.any():
            break
        out |= now
        broken = broken & ((now @ ends.T) == 0)
    return out


def usual_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the usual distance between two points (n, 3); NaN if they are never seen together.

    It is the median of the quarter of the frames in which the distance varies least, because either
    marker may fall off later.
    """
    length = np.linalg.norm(one - other, axis=1)
    ordered = np.sort(length[np.isfinite(length)])
    if not len(ordered):
        return float("nan")
    count = max(1, round(_SHARE * len(ordered)))
    first = int(np.argmin(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))
    return float(np.median(ordered[first : first + count]))


_SAMPLE: Final = 2000
"""Frames from which a shape is found, about."""
_ROUNDS: Final = 5
_CANDIDATES: Final = 9
"""Number of frames from which the first estimate of a shape is chosen."""
_STEADY: Final = 0.25
"""Share of the frames from which a point's place is taken, because it may fall off later."""
_FLAT: Final = 0.02
"""Least width of a shape [m]; narrower points are a line, with an unknown rotation about it."""
_ASTRAY: Final = 0.03
"""Distance from the shape above which a point is left out, if the others fit [m]."""
_UNLIKE: Final = 0.04
"""Distance from the shape above which the pose is unknown, if it is unclear which point is wrong
[m]."""
_THREE: Final = 0.02
"""The same for three points, because these fit every similar triangle [m]."""


@dataclass(frozen=True, eq=False)
class Followed:
    """A rigid shape in each frame.

    Attributes:
        turn: its axes in the world (n, 3, 3); NaN where unknown.
        place: its origin in the world (n, 3) [m]; NaN where unknown.
        points: positions of its points in that pose (n, m, 3) [m].
        astray: points that were seen in a wrong place (n, m) bool; all seen points in frames that
            do not fit the shape.
    """

    turn: np.ndarray
    place: np.ndarray
    points: np.ndarray
    astray: np.ndarray


def shape_of(points: np.ndarray) -> np.ndarray | None:
    """Return the shape (m, 3) that points (n, m, 3) keep, about their middle; None if too few.

    The frames are aligned, and each point is where it is most of the time.
    """
    seen = _seen(points)
    whole = np.flatnonzero(seen.sum(axis=1) == seen.sum(axis=1).max(initial=0))
    if not len(whole) or seen[whole[0]].sum() < 3:
        return None
    # Frames with at least three points; the first estimate is from the most complete frames.
    rows = np.flatnonzero(seen.sum(axis=1) >= 3)
    sample = _finite(points[rows[:: max(1, len(rows) // _SAMPLE)]])
    shape = _first(_finite(points[whole]), sample)
    for _ in range(_ROUNDS):
        turn, place, _ = _fitted(sample, shape)
        back = np.einsum("nji,nmj->nmi", turn, sample - place[:, None])
        found = np.stack([_mostly(path) for path in np.moveaxis(back, 1, 0)])
        shape = np.where(np.isfinite(found), found, shape)
    return shape - np.nanmean(shape, axis=0)


def follow(points: np.ndarray, shape: np.ndarray) -> Followed:
    """Return the pose of a shape in each frame.

    Args:
        points: seen positions (n, m, 3) [m]; NaN where not seen.
        shape: its points (m, 3) [m]; NaN for an unknown one.
    """
    points, known = _finite(points), np.isfinite(shape).all(axis=1)
    turn, place, astray = _fitted(points, shape)
    there = _placed(turn, place, shape)
    seen = _seen(points) & known & ~astray
    miss = np.where(seen, np.linalg.norm(points - there, axis=2), 0.0).max(axis=1, initial=0.0)
    unlike = miss > np.where(seen.sum(axis=1) > 3, _UNLIKE, _THREE)
    turn[unlike], place[unlike], there[unlike] = np.nan, np.nan, np.nan
    astray[unlike] |= seen[unlike]
    there[:, ~known] = np.nan
    return Followed(turn, place, there, astray)


def brought_to(shape: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Return a shape (m, 3) that is aligned with points (m, 3), and the largest distance left.

    None if they have too few points in common. Both may have NaN.
    """
    seen = _seen(points[None])
    turn, place = _brought(points[None].astype(float), shape, seen)
    there = _placed(turn, place, shape)[0]
    if np.isnan(place).any():
        return None
    miss = np.linalg.norm(points - there, axis=1)
    there[~np.isfinite(shape).all(axis=1)] = np.nan
    return there, float(np.nanmax(miss[seen[0] & np.isfinite(shape).all(axis=1)]))


def _first(whole: np.ndarray, sample: np.ndarray) -> np.ndarray:
    """Return the frame of (k, m, 3) that fits most of a sample (n, m, 3), about its middle.

    With a frame in which two points are exchanged, all others would look exchanged.
    """
    count = min(_CANDIDATES, len(whole))
    shapes = whole[(len(whole) * (np.arange(count) + 0.5) / count).astype(int)]
    shapes = shapes - np.nanmean(shapes, axis=1, keepdims=True)
    unlike = []
    for shape in shapes:
        seen = _seen(sample) & np.isfinite(shape).all(axis=1)
        away = np.linalg.norm(sample - _placed(*_brought(sample, shape, seen), shape), axis=2)
        miss = np.where(seen, np.nan_to_num(away, nan=np.inf), 0.0).max(axis=1)
        # The distance of a frame that does not fit is cut off, because its size means nothing.
        unlike.append(np.minimum(miss, _ASTRAY).sum())
    return shapes[int(np.argmin(unlike))]


def _fitted(points: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pose of a shape in each frame, and the points in a wrong place (n, m) bool."""
    seen = _seen(points) & np.isfinite(shape).all(axis=1)
    turn, place = _brought(points, shape, seen)
    away = np.linalg.norm(points - _placed(turn, place, shape), axis=2)
    miss = np.where(seen, np.nan_to_num(away), 0.0).max(axis=1, initial=0.0)
    astray = np.zeros_like(seen)
    bad = np.flatnonzero((miss > _ASTRAY / 2) & (seen.sum(axis=1) >= 4))
    if not len(bad):
        return turn, place, astray
    # An exchange explains all points, so it is tried before one point is left out.
    turn[bad], place[bad], astray[bad] = _exchanged(
        points[bad], shape, seen[bad], turn[bad], place[bad]
    )
    bad = bad[~astray[bad].any(axis=1)]
    astray[bad] = _astray(points[bad], shape, seen[bad])
    bad = bad[astray[bad].any(axis=1)]
    turn[bad], place[bad] = _brought(points[bad], shape, seen[bad] & ~astray[bad])
    return turn, place, astray


def _finite(points: np.ndarray) -> np.ndarray:
    """Return points (n, m, 3), with NaN for points with a missing coordinate."""
    return np.where(_seen(points)[:, :, None], points, np.nan).astype(float)


def _seen(points: np.ndarray) -> np.ndarray:
    """Return the points (n, m, 3) that are seen (n, m) bool."""
    return np.asarray(np.isfinite(points).all(axis=2))


def _mostly(path: np.ndarray) -> np.ndarray:
    """Return where a point (n, 3) is most of the time: the mean of the densest share of it."""
    found = np.full(3, np.nan)
    path = path[np.isfinite(path).all(axis=1)]
    if not len(path):
        return found
    count = max(1, round(_STEADY * len(path)))
    for _ in range(2):
        # First about the median, then about the mean that was found.
        middle = np.median(path, axis=0) if np.isnan(found).any() else found
        away = np.linalg.norm(path - middle, axis=1)
        found = path[np.argsort(away)[:count]].mean(axis=0)
    return found


def _astray(points: np.ndarray, shape: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the point of each frame without which the others fit (n, m) bool, if there is one."""
    left = np.full(points.shape[:2], np.inf)
    miss = np.zeros(points.shape[:2])
    for i in range(points.shape[1]):
        without = seen.copy()
        without[:, i] = False
        turn, place = _brought(points, shape, without)
        away = np.linalg.norm(points - _placed(turn, place, shape), axis=2)
        told = seen[:, i] & np.isfinite(place[:, 0])
        total = (np.where(without, np.nan_to_num(away), 0.0) ** 2).sum(axis=1)
        left[told, i] = np.sqrt(total / without.sum(axis=1).clip(1))[told]
        miss[told, i] = away[told, i]
    best = np.argmin(left, axis=1)
    rows = np.arange(len(points))
    found = np.zeros_like(seen)
    found[rows, best] = (left[rows, best] < _ASTRAY / 2) & (miss[rows, best] > _ASTRAY)
    return found


def _exchanged(
    points: np.ndarray, shape: np.ndarray, seen: np.ndarray, turn: np.ndarray, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses after an exchange of two points, where all points then fit, and those points.

    If left and right of a shape are alike, exchanging the front points is equivalent to exchanging
    the back points and turning the shape over. If two exchanges fit, the pose is unknown.
    """
    best, ways = np.full(len(points), _ASTRAY / 2), np.zeros(len(points), dtype=int)
    away = np.linalg.norm(points - _placed(turn, place, shape), axis=2)
    wrong = np.where(seen, away, 0.0).max(axis=1, initial=0.0) > _ASTRAY
    turn, place, which = turn.copy(), place.copy(), np.zeros_like(seen)
    for one, other in combinations(range(points.shape[1]), 2):
        both = seen[:, one] & seen[:, other]
        swapped = points.copy()
        swapped[both, one], swapped[both, other] = points[both, other], points[both, one]
        turned, placed = _brought(swapped, shape, seen)
        away = np.linalg.norm(swapped - _placed(turned, placed, shape), axis=2)
        miss = np.where(seen, np.nan_to_num(away, nan=np.inf), 0.0).max(axis=1)
        miss[~both] = np.inf
        ways += miss < _ASTRAY
        better = wrong & (miss < best)
        best[better] = miss[better]
        turn[better], place[better], which[better] = turned[better], placed[better], False
        which[better, one], which[better, other] = True, True
    unsure = which.any(axis=1) & (ways > 1)
    turn[unsure], place[unsure], which[unsure] = np.nan, np.nan, seen[unsure]
    return turn, place, which


def _placed(turn: np.ndarray, place: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return the positions of a shape's points in its poses (n, m, 3)."""
    return place[:, None] + np.einsum("nij,mj->nmi", turn, np.nan_to_num(shape))


def _brought(
    points: np.ndarray, shape: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (n, 3, 3) and places (n, 3) that fit a shape to points; NaN: too few."""
    told = seen & np.isfinite(shape).all(axis=1)
    weight = told.astype(float)
    total = weight.sum(axis=1)
    share = weight / np.where(total > 0, total, 1)[:, None]
    here, own = np.where(told[:, :, None], points, 0.0), np.nan_to_num(shape)
    middle = np.einsum("nm,nmi->ni", share, here)
    centre = share @ own
    across = np.einsum(
        "nm,nmi,nmj->nij",
        weight,
        here - middle[:, None],
        own[None] - centre[:, None],
        optimize=True,
    )
    left, _, right = np.linalg.svd(across)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    turn = left @ right
    place = middle - np.einsum("nij,nj->ni", turn, centre)
    lost = ~_spread(own, told)
    turn[lost], place[lost] = np.nan, np.nan
    return turn, place


def _spread(shape: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Return the frames in which the usable points (n, m) of a shape span a plane (n,) bool."""
    # Only few different sets of points occur.
    sets, which = np.unique(told, axis=0, return_inverse=True)
    wide = np.zeros(len(sets), dtype=bool)
    for i, some in enumerate(sets):
        if some.sum() >= 3:
            points = shape[some] - shape[some].mean(axis=0)
            wide[i] = np.linalg.svd(points, compute_uv=False)[1] >= _FLAT
    return wide[which.ravel()]


_THREE_COMMON: Final = 0.012
"""Largest distance of three common markers from the person file's shape [m]; it is small, because
three markers also fit the file of a similar person well."""
_MORE: Final = 0.02
"""The same for more than three markers, which show the difference between people better [m]."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A rigid segment with its markers.

    Attributes:
        name: its name in `ergoqp.mocap.naming.RIGID`.
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
        if both is not None and both[1] > (_THREE_COMMON if shared == 3 else _MORE):
            said.append(
                f"The {segment}'s markers are not where the person file has them, by"
                f" {1000 * both[1]:.0f} mm: those that are never seen are not placed by it."
            )
        elif both is not None:
            names = map(spoken, compress(which, lacking))
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
