"""Lower and upper ends of joint angles that a recording does not show, or not for certain.

For up to a second, an angle that is lost stays near the last and the next one that are seen. How
far it may move in that time is measured in the rest of the recording. After that it may be anywhere
in the range of its joint: nothing says that a person keeps a hidden arm where it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.mocap.fitting.coupled import TURNS, TWIST, by_pronation, by_rotation, by_twist

NEAR: Final = 1.0
"""Time from an angle that is seen after which nothing is known of it any more [s]."""
_TIMES: Final = (0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.6, NEAR)
"""Times over which the movement of an angle is measured [s]."""
_MOST: Final = 0.99
"""Share of the movements of a recording that stay within the ends."""
FASTEST: Final = 12.0
"""Largest speed of a part of the body at work [m/s]."""
_PAIRS: Final = 100
"""Number of movements from which they are measured; a shorter recording says nothing of them."""
_EXTREME: Final = 0.98
"""Share of the angles that are seen beyond which one is at the end of them."""
_WIDE: Final = np.radians(1.0)
"""Least distance of such an angle from the median [rad]."""
_HOLE: Final = 0.05
"""Time from a frame that is seen up to which an interpolated angle is as good [s]."""
_FREE: Final = 0.25
"""Time in which an angle may move through its whole range if its movements are not measured [s]."""
_ASIDE: Final = np.radians(20.0)
"""Change of an arm's flexion above which its direction hardly shows it."""
_KEPT: Final = 0.05
"""Time in which a body whose hips and shoulders are lost has not turned [s]."""
_ARMS: Final = tuple(f"{side}_upper_arm" for side in SIDES)
_LEANS: Final = tuple(
    INDEX[f"{segment}_{joint}"]
    for segment in ("trunk", "neck")
    for joint in ("flexion", "side_bend")
)
_TOLD: Final = np.radians(10.0)
"""Distance between the ends of an angle up to which it is determined, if it depends on others."""
_SAME: Final = 0.3
"""Share by which a time between two frames may differ from one of these."""
_SAMPLE: Final = 4000
"""Number of movements that are measured, about."""

Ends = tuple[np.ndarray, np.ndarray]
"""Lower and upper ends of an angle, each (n,) [rad]."""

Spans = dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Number of a joint -> the frames in which its angle is not known (k,), and its lower and upper
ends there (k,) [rad]; joints that are known at every moment are left out."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """How far a recording's own angles may be from those of the person.

    Attributes:
        neck: lowest and highest change of the neck's flexion [rad].
        trunk: largest angle between the trunk and the recorded one (n,) [rad]; None: zero.
        arms: ``right_upper_arm``, ``left_upper_arm`` -> largest angle between the arm and the
            recorded one (n,) [rad].
        axes: ``right_elbow_axis``, ``left_elbow_axis`` -> inward rotation of the upper arm by the
            axis of the elbow beyond that by the forearm (n,) [rad].
        others: other postures that the recording may show (n, 32) [rad].
    """

    neck: tuple[float, float] = (0.0, 0.0)
    trunk: np.ndarray | None = None
    arms: Mapping[str, np.ndarray] = field(default_factory=dict)
    axes: Mapping[str, np.ndarray] = field(default_factory=dict)
    others: tuple[np.ndarray, ...] = ()


def spans_of(
    postures: np.ndarray,
    observed: np.ndarray,
    time: np.ndarray,
    doubt: Doubt | None = None,
    pairs: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[Spans, np.ndarray]:
    """Return the ends of every angle that is not known at every moment, and which are known.

    The latter (n, 32) are those that are seen, without those that depend on others that are not.

    Args:
        postures: joint angles (n, 32) [rad].
        observed: which of them are seen (n, 32) bool.
        time: times of the frames (n,) [s].
        doubt: how far those that are seen may be off.
        pairs: frames in which both hips are seen, and those with both shoulders, each (n,) bool;
            None: all.
    """
    found: Spans = {}
    told = observed.copy()
    changes = {} if doubt is None else changes_by(postures, doubt, time)
    others = () if doubt is None else doubt.others
    parts, hands = {}, by_pronation(postures, observed)
    # What depends on others comes after them.
    for joint in sorted(range(len(JOINTS)), key=lambda each: (each != TWIST, each not in TURNS)):
        low = high = angles = postures[:, joint]
        for other in others:
            low, high = np.minimum(low, other[:, joint]), np.maximum(high, other[:, joint])
        if joint in changes:
            least, most = changes[joint]
            low, high = np.maximum(low + least, LOWER[joint]), np.minimum(high + most, UPPER[joint])
        if not observed[:, joint].all():
            seen = observed[:, joint]
            ends = _unseen(angles, seen, time, float(LOWER[joint]), float(UPPER[joint]))
            low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
        for rows, least, most in [hands[joint]] if joint in hands else parts.pop(joint, ()):
            low, high = low.copy(), high.copy()
            low[rows], high[rows] = np.minimum(low[rows], least), np.maximum(high[rows], most)
            if joint not in hands and joint not in TURNS.values():
                told[rows[most - least > _TOLD], joint] = False
        frames = np.flatnonzero(low < high).astype(np.int32)
        if joint == TWIST and pairs is not None:
            turned = away_from(pairs[0] | pairs[1], time) > _KEPT
            for other, part in by_twist((low, high), postures, observed, pairs, turned).items():
                parts.setdefault(other, []).append(part)
        if not len(frames):
            continue
        span = found[joint] = (
            frames,
            low[frames].astype(np.float32),
            high[frames].astype(np.float32),
        )
        if joint in TURNS:
            for other, part in by_rotation(joint, span, postures, observed).items():
                parts.setdefault(other, []).append(part)
    return found, told


def away_from(frames: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the time from the nearest of some frames (n,) bool (n,) [s]; infinite without one."""
    known = np.flatnonzero(frames)
    if not len(known):
        return np.full(len(time), np.inf)
    before, after = _neighbours(known, np.arange(len(time)))
    return np.minimum(np.abs(time - time[before]), np.abs(time[after] - time))


def pieces_of(places: Mapping[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Return times (n,) [s] in which frames on both sides of a cut are not near each other.

    A cut is where the whole body is elsewhere at once. Frames between in which nobody is seen are
    near neither side.

    Args:
        places: centre -> positions (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s].
    """
    shown = np.logical_or.reduce([np.isfinite(path[:, 0]) for path in places.values()])
    frames = np.flatnonzero(shown)
    most = (FASTEST * np.diff(time[frames])) ** 2
    fast, seen = np.zeros(len(most), dtype=int), np.zeros(len(most), dtype=int)
    for path in places.values():
        moved = (np.diff(path[frames], axis=0) ** 2).sum(axis=1)
        fast += moved > most
        seen += np.isfinite(moved)
    cut, cuts = 2 * fast > seen, np.zeros(len(time))
    cuts[frames[:-1][cut] + 1] += 1
    cuts[frames[1:][cut]] += 1
    return time + 2 * NEAR * np.cumsum(cuts)


def _neighbours(known: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the last of some known frames before each of others, and the first after it."""
    after = np.searchsorted(known, frames)
    return known[np.maximum(after - 1, 0)], known[np.minimum(after, len(known) - 1)]


def _unseen(
    angles: np.ndarray, seen: np.ndarray, time: np.ndarray, lower: float, upper: float
) -> Ends:
    """Return the ends of an angle (n,), which is seen in some of the frames."""
    if not seen.any():
        return np.full(len(angles), lower), np.full(len(angles), upper)
    low, high = angles.copy(), angles.copy()
    lost, known = np.flatnonzero(~seen), np.flatnonzero(seen)
    before, after = _neighbours(known, lost)
    since, until = np.abs(time[lost] - time[before]), np.abs(time[after] - time[lost])
    near = np.minimum(since, until)
    between = np.interp(time[lost], time[known], angles[known])
    # A smooth movement is as far from the line across a gap as in the middle of a gap of this half.
    half = np.sqrt(since * until)
    inside = (before < lost) & (lost < after) & (since + until < 2 * NEAR)
    between = np.where(inside, between, angles[np.where(since < until, before, after)])
    alone, across = _moves(angles, seen, time, upper - lower)
    reach = np.where(inside, np.interp(half, _TIMES, across), np.interp(near, _TIMES, alone))
    # Where the angle changes faster than it ever does, it may jump anywhere in the gap.
    change = np.abs(angles[after] - angles[before])
    leaps = inside & (change > np.interp(since + until, _TIMES, alone))
    reach = np.where(leaps, np.maximum(reach, change), reach)
    reach[near > NEAR] = np.inf
    # A part may be hidden just because of its posture: what is lost at the end of all that is seen
    # of an angle may be anywhere beyond.
    around = np.stack([angles[before], angles[after]])
    least, middle, most = np.quantile(angles[known], (1 - _EXTREME, 0.5, _EXTREME))
    below = ((around <= least) & (around < middle - _WIDE)).any(axis=0)
    above = ((around >= most) & (around > middle + _WIDE)).any(axis=0)
    # What the frames around suggest is within the ends, too.
    ends = (
        np.where(below, lower, np.maximum(between - reach, lower)),
        np.where(above, upper, np.minimum(between + reach, upper)),
    )
    low[lost], high[lost] = np.minimum(ends[0], angles[lost]), np.maximum(ends[1], angles[lost])
    return low, high


def _moves(
    angles: np.ndarray, seen: np.ndarray, time: np.ndarray, whole: float
) -> tuple[list[float], list[float]]:
    """Return how far an angle (n,) gets in the times of `_TIMES` [rad].

    First from where it was, then from the middle between where it was and where it will be.
    """
    # Where single frames are lost, hardly any two at some distance are seen.
    seen = away_from(seen, time) < _HOLE
    step = 1.01 * float(np.median(np.diff(time))) if len(time) > 1 else NEAR
    every = np.flatnonzero(seen)
    every = every[:: max(1, len(every) // _SAMPLE)]
    alone, across = [0.0], [0.0]
    for lag in _TIMES[1:]:
        free = whole * min(1.0, lag / _FREE) ** 0.5
        near = max(step, _SAME * lag)
        before, told_before = _partners(every, seen, time, -lag, near)
        after, told_after = _partners(every, seen, time, lag, near)
        for found, moved in (
            (alone, np.abs(angles[every] - angles[after])[told_after]),
            (
                across,
                np.abs(angles[every] - (angles[before] + angles[after]) / 2)[
                    told_before & told_after
                ],
            ),
        ):
            found.append(float(np.quantile(moved, _MOST)) if len(moved) >= _PAIRS else free)
    return np.maximum.accumulate(alone).tolist(), np.maximum.accumulate(across).tolist()


def _partners(
    frames: np.ndarray, seen: np.ndarray, time: np.ndarray, away: float, near: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames nearest to some time away from others, and which are seen, each (k,).

    Rates may change, so they are found by time. They are other frames, even if the time is short.

    Args:
        frames: the others (k,).
        seen: frames that are seen (n,) bool.
        time: times of the frames (n,) [s].
        away: that time [s].
        near: how far from it they may be [s].
    """
    then, last = time[frames] + away, len(time) - 1
    at = np.clip(np.searchsorted(time, then), min(1, last), last)
    at -= then - time[at - 1] < time[at] - then
    at = np.maximum(at, frames + 1) if away > 0 else np.minimum(at, frames - 1)
    at = np.clip(at, 0, last)
    return at, seen[at] & (np.abs(time[at] - then) < near) & (at != frames)


def changes_by(postures: np.ndarray, doubt: Doubt, time: np.ndarray) -> dict[int, Ends]:
    """Return by how much angles may be off: joint -> lowest and highest change (n,) [rad]."""
    found, count = {}, len(postures)
    if doubt.neck[0] < doubt.neck[1]:
        found[INDEX["neck_flexion"]] = tuple(np.full(count, end) for end in doubt.neck)
    trunk, arms = np.zeros(count), dict(doubt.arms)
    if doubt.trunk is not None and doubt.trunk.any():
        # What hangs from the trunk is measured from it.
        trunk = doubt.trunk.astype(float)
        arms = {arm: arms.get(arm, np.zeros(count)) for arm in _ARMS}
        for joint in _LEANS:
            least, most = found.get(joint, (0.0, 0.0))
            found[joint] = least - trunk, most + trunk
    for arm, half in arms.items():
        side, half = arm.partition("_")[0], half.astype(float)
        off = np.hypot(half, trunk)
        flexion, abduction, rotation, elbow = (
            INDEX[f"{side}_{joint}"]
            for joint in (
                "shoulder_flexion",
                "shoulder_abduction",
                "shoulder_rotation",
                "elbow_flexion",
            )
        )
        # An arm that points straight to the side has no flexion, and a straight arm no rotation.
        swing = _about(off, np.cos(postures[:, abduction]))
        turn = _about(half, np.sin(postures[:, elbow]))
        turn = turn + _about(trunk, np.cos(postures[:, abduction]))
        found[flexion] = _passing(postures[:, flexion], swing, time)
        for joint, each in ((abduction, off), (rotation, turn), (elbow, half)):
            found[joint] = (-each, each)
    for axis, turn in doubt.axes.items():
        side = axis.partition("_")[0]
        rotation, elbow, pronation = (
            INDEX[f"{side}_{joint}"]
            for joint in ("shoulder_rotation", "elbow_flexion", "forearm_pronation")
        )
        # The forearm's pronation is measured from the axis of the elbow.
        about = -turn * np.cos(postures[:, elbow])
        for joint, each in ((rotation, turn), (pronation, about)):
            least, most = found.get(joint, (0.0, 0.0))
            found[joint] = least + np.minimum(each, 0.0), most + np.maximum(each, 0.0)
    return found


def _passing(flexion: np.ndarray, swing: np.ndarray, time: np.ndarray) -> Ends:
    """Return the lowest and highest change of an arm's flexion (n,) [rad].

    An arm that passes straight sideways has any flexion there by its direction alone. It is between
    those before and after, as the likeliest one is: nobody turns an arm about its own length by
    half a turn and back within a second.

    Args:
        flexion: the likeliest one (n,) [rad].
        swing: largest change by which the direction of the arm stays within its doubt (n,) [rad].
        time: times of the frames (n,) [s].
    """
    low, high = -swing, swing.copy()
    aside = swing > _ASIDE
    known, rows = np.flatnonzero(~aside), np.flatnonzero(aside)
    if not len(known):
        return low, high
    before, after = _neighbours(known, rows)
    passes = (before < rows) & (rows < after) & (time[after] - time[before] < 2 * NEAR)
    rows = rows[passes]
    for end, each in ((low, flexion - swing), (high, flexion + swing)):
        end[rows] = np.interp(time[rows], time[known], each[known]) - flexion[rows]
    return np.minimum(low, 0.0), np.maximum(high, 0.0)


def _about(off: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the largest turn about an axis of a direction that is off by some angle (n,) [rad].

    Args:
        off: that angle (n,) [rad].
        radius: sine of the angle between direction and axis (n,).
    """
    share = np.sin(np.minimum(off, np.pi / 2)) / np.maximum(np.abs(radius), 1e-9)
    return np.where(share < 1, np.arcsin(np.minimum(share, 1)), np.where(off > 0, np.pi, 0.0))


def spans_within(spans: Spans, start: int, stop: int) -> Spans:
    """Return the ends of the angles in the frames from one number to before another."""
    found: Spans = {}
    for joint, (frames, low, high) in spans.items():
        # In the type of the frames, or all of them would be converted.
        first, last = np.searchsorted(frames, np.array([start, stop], dtype=frames.dtype))
        if first < last:
            found[joint] = (frames[first:last] - start, low[first:last], high[first:last])
    return found


def with_spans(postures: np.ndarray, spans: Spans, upper: bool) -> np.ndarray:
    """Return the lower or the upper ends of joint angles (n, 32) [rad], read-only.

    Args:
        postures: the likeliest angles (n, 32) [rad].
        spans: ends of those that are not known.
        upper: whether the upper ends are returned.
    """
    ends, limits, beyond = postures.copy(), UPPER if upper else LOWER, np.fmax if upper else np.fmin
    for joint, (frames, *both) in spans.items():
        # The ends are rounded to single precision: the end of a range is the range's own, and the
        # posture is between them.
        given = both[upper].astype(float)
        given[both[upper] == np.float32(limits[joint])] = limits[joint]
        ends[frames, joint] = beyond(given, postures[frames, joint])
    ends.setflags(write=False)
    return ends
