"""What of a recording cannot be right, gaps and jumps.

The accelerations of people are bounded. A bone that turns and turns back faster than a person can
has moved in the recording only.

Joints that are taken as not seen, frames that are not scored, and the causes.

Some frames show what cannot be right: a bone that the body cannot follow within its joints' ranges,
a bone that is suddenly longer or shorter, a body that is far from the recording, or a jump. The
joints that depend on it are then taken as not seen, and the frame is scored, with a range. It is
not scored only if the trunk is not seen in it, nor near it in time. Both kinds of frames are
counted, with their causes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import solveh_banded

from ergoqp.joints import INDEX, JOINTS, SIDES, spoken
from ergoqp.mocap.fitting.unknown import NEAR, away_from
from ergoqp.mocap.formats.times import are_alike

_NOISE: Final = np.radians(1.0) ** 2
"""Variance of a measured angle whose `shows` is sin 45 deg [rad^2]."""
_SURE: Final = 1e-6
"""Share of that variance that a fully determined angle has: it is practically kept as measured."""
_WANDER: Final = 1.0
"""Growth of an angle's variance per second [rad^2/s]."""
_USUAL: Final = 1.0
"""Variance about zero of an angle of which nothing is known [rad^2]."""
_FORGOTTEN: Final = 10.0
"""Time after which nothing is known of an earlier angle [s]."""


def steady(
    measured: np.ndarray, shows: np.ndarray, time: np.ndarray, leaps: np.ndarray | None = None
) -> np.ndarray:
    """Return the likeliest angles (n,) [rad].

    Args:
        measured: angles (n,) [rad], unwrapped; NaN where there is none.
        shows: how much a small change of the angle turns the measured bone (n,), 0 to 1.
        time: times of the frames (n,) [s], increasing.
        leaps: steps between frames in which the angle may jump (n - 1,) bool; None: nowhere.
    """
    seen = np.isfinite(measured) & (shows > 0)
    weight = np.where(seen, shows**2 / np.maximum(1 - shows**2, _SURE), 0.0)
    known = np.where(seen, measured, 0.0)
    if not seen.any():
        return known
    since = np.diff(time)
    links = _NOISE / (_WANDER * since)
    if leaps is not None:
        links = np.where(leaps, 0.0, links)
    unknown = np.minimum(np.concatenate([since, [_FORGOTTEN]]) / _FORGOTTEN, 1.0)
    diagonal = weight + _NOISE / _USUAL * unknown
    diagonal[:-1] += links
    diagonal[1:] += links
    if len(time) == 1:
        return weight * known / diagonal
    banded = np.stack([np.concatenate([[0.0], -links]), diagonal])
    return solveh_banded(banded, weight * known, check_finite=False)


def filled(measured: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles (n,) [rad] as measured, with those of `steady` where there is none (NaN)."""
    seen = np.isfinite(measured)
    if seen.all():
        return measured
    return np.where(seen, measured, steady(measured, seen.astype(float), time))


BRIDGED: Final = 0.2
"""Longest time between two wrong frames that is wrong, too [s]."""
_LEAP: Final = 300.0
"""Change of a bone's angular velocity above which it jumps [rad/s^2]; hammering reaches 130."""
_MOVED: Final = 0.03
"""Smallest relative movement of a jumping bone's ends [m], because noise turns short bones."""
_TURNED: Final = np.radians(10.0)
"""Smallest angle of a jump [rad]."""
_AT_ONCE: Final = 5
"""If more bones than this jump at once, it is a cut or a keyframe, not an error."""


def leaps(bones: Mapping[str, np.ndarray], time: np.ndarray) -> dict[str, np.ndarray]:
    """Return the steps between frames in which bones jump: bone -> (n - 1,) bool.

    Args:
        bones: bone -> vector from one end to the other (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s], increasing.
    """
    if not bones:
        return {}
    # Repeated frames are skipped: a slower sensor is recorded several times.
    new = moments(bones)
    found, since = {}, np.diff(time[new])
    for name, bone in bones.items():
        turn = angle_between(bone[new][:-1], bone[new][1:])
        speed = np.pad(turn / since, 1, constant_values=np.nan)
        faster = speed[1:-1] - np.fmax(speed[:-2], speed[2:])
        moved = np.linalg.norm(np.diff(bone[new], axis=0), axis=1)
        steps = np.zeros(len(time) - 1, dtype=bool)
        leaping = (faster > _LEAP * since) & (turn > _TURNED) & (moved > _MOVED)
        steps[np.flatnonzero(new)[1:][leaping] - 1] = True
        found[name] = steps
    cuts = np.sum(list(found.values()), axis=0) > _AT_ONCE
    return {name: steps & ~cuts for name, steps in found.items()}


def moments(paths: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames that do not repeat the frame before (n,) bool.

    Args:
        paths: name -> positions (n, 3), NaN where not seen.
    """
    new = np.zeros(len(next(iter(paths.values()))), dtype=bool)
    new[:1] = True
    for path in paths.values():
        new[1:] |= ~are_alike(path[1:], path[:-1])
    return new


def between_leaps(leaping: np.ndarray, wrong: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames between two jumps, or between a jump and a wrong frame (n,) bool.

    A single jump does not count: it does not show on which side the recording is wrong.

    Args:
        leaping: steps between frames in which a bone jumps (n - 1,) bool.
        wrong: wrong frames (n,) bool.
        time: times of the frames (n,) [s], increasing.
    """
    # Frames and the steps between them alternate.
    marks, at = np.zeros(2 * len(time) - 1, dtype=bool), np.empty(2 * len(time) - 1)
    marks[::2], at[::2] = wrong, time
    marks[1::2], at[1::2] = leaping, (time[:-1] + time[1:]) / 2
    return closed(marks, at, NEAR)[::2]


def closed(frames: np.ndarray, time: np.ndarray, most: float = BRIDGED) -> np.ndarray:
    """Return some frames, and all between two of them that are less than some time [s] apart."""
    if not frames.any():
        return frames
    between, before, after = gaps(frames)
    return frames | (between & (time[after] - time[before] < most))


def gaps(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the frames between some given ones (n,) bool, and the last given before and after."""
    known = np.flatnonzero(frames)
    at = np.searchsorted(known, np.arange(len(frames)))
    between = (at > 0) & (at < len(known))
    before, after = known[np.maximum(at - 1, 0)], known[np.minimum(at, len(known) - 1)]
    return between, before, after


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the angle between vectors (n,) [rad]; NaN where one is not seen."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(across, (one * other).sum(axis=1))


_OFF: Final = np.radians(20.0)
"""Largest angle between a bone of the body and the recorded one [rad].

It arises where the recorded angle is beyond the range of its joint. All ranges end within an outer
band of the sheet, so the score is right for people who move farther than most.
"""
_RIGID: Final = 0.001
"""Variation of a rigid skeleton's bones is below this share of their length."""
_LEAST: Final = 0.015
"""Share by which such a bone may be longer or shorter; with a sideways error it is 10 degrees."""
_BENDS_FROM: Final = 0.15
"""Least leeway of the bones that stand for several joints, of spine and shoulders: they are never
rigid, even if they keep their length while a person stands still."""
_USUALLY: Final = 6.0
"""Factor on its usual variation by which another bone may be longer or shorter."""
_MOST: Final = 0.3
"""Largest share by which any bone may be longer or shorter."""
_POOR: Final = 0.10
"""Largest distance between body and recording, RMS over the centres [m]."""
_ASTRAY: Final = 0.20
"""Largest distance of one joint centre of the body from the recorded one [m]."""
_ELSEWHERE: Final = 0.2
"""Tangent by which the base of the neck may be ahead of or beside its usual place on the shoulders.

It is 11 degrees of the trunk, or 0.1 m. In real recordings it is up to 0.04 m. Both shoulders rise
by more than that if arms are raised, so above and below do not count.
"""
_ARM: Final = (
    "shoulder_flexion",
    "shoulder_abduction",
    "shoulder_rotation",
    "elbow_flexion",
    "forearm_pronation",
    "wrist_flexion",
    "wrist_deviation",
)
LEG: Final = (
    "hip_flexion",
    "hip_abduction",
    "hip_rotation",
    "knee_flexion",
    "ankle_flexion",
    "ankle_inversion",
)
"""Joints of a leg, without the side."""
_NECK: Final = ("neck_flexion", "neck_side_bend", "neck_twist")
_TRUNK: Final = ("trunk_flexion", "trunk_side_bend", "trunk_twist")


def _of(side: str, joints: Iterable[str]) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}" for joint in joints)


_ABOVE: Final = (*_TRUNK, *_NECK, *(joint for side in SIDES for joint in _of(side, _ARM)))
"""Joints whose angles depend on hips and neck: those of the trunk, and all that hang from it."""
_FROM_SHOULDERS: Final = (
    "trunk_twist",
    "neck_twist",
    *(joint for side in SIDES for joint in _of(side, _ARM[:4])),
)
"""Joints whose angles depend on a shoulder: both arms are measured from the twist of the trunk."""
_DIRECTIONS: Final = (
    ("trunk", "hips", "neck", _ABOVE),
    ("neck", "neck", "skull", _NECK),
    *(
        (f"{side} upper arm", f"{side}_shoulder", f"{side}_elbow", _of(side, _ARM))
        for side in SIDES
    ),
)
"""Bones whose direction is scored, their ends, and the joints that depend on it."""
_BENDS: Final = tuple(
    (
        f"{side} {joint}",
        *(f"{side}_{centre}" for centre in (start, joint, end)),
        _of(side, joints),
    )
    for side in SIDES
    for start, joint, end, joints in (
        ("shoulder", "elbow", "wrist", _ARM[2:]),
        ("hip", "knee", "ankle", LEG),
    )
)
"""Joints whose angle between two bones is scored, its centres, and the joints that depend on it."""
_CENTRES: Final = {
    "neck": _ABOVE,
    **{
        f"{side}_{centre}": _of(side, joints)
        for side in SIDES
        for centres, joints in (
            (("shoulder", "elbow"), _ARM),
            (("wrist",), _ARM[2:]),
            (("hip", "knee"), LEG),
        )
        for centre in centres
    },
}
"""Centre on which scored angles depend -> their joints."""
_BENT: Final = ("shoulder_flexion", "shoulder_abduction", "elbow_flexion")
"""Joints up to the forearm; an arm that does not show its rotation hardly moves with it."""
_CHAINS: Final = {
    "neck": ("trunk_flexion",),
    **dict.fromkeys(("head", "head_top", "nose"), ("trunk_flexion", "neck_flexion")),
    **{
        f"{side}_{centre}": ("trunk_flexion", *own, *_of(side, needed))
        for side in SIDES
        for centre, own, needed in (
            ("shoulder", ("trunk_twist",), ()),
            ("elbow", ("trunk_twist",), _ARM[:2]),
            ("wrist", ("trunk_twist",), _BENT),
            ("knuckles", ("trunk_twist",), _BENT),
            ("thumb", ("trunk_twist",), (*_BENT, "forearm_pronation")),
            ("knee", (), LEG[:2]),
            ("ankle", (), LEG[:4]),
            ("toe", (), LEG[:4]),
        )
    },
}
"""Centre -> the joints between it and the pelvis, and the trunk, which tells where that is."""


@dataclass(frozen=True)
class Usual:
    """Usual length of a bone.

    Attributes:
        length: median of its length [m].
        leeway: how much longer or shorter it may be [m].
    """

    length: float
    leeway: float


def usual_lengths(places: Mapping[str, np.ndarray]) -> dict[str, Usual]:
    """Return the usual lengths of the bones that determine the score, if they are seen.

    A bone of a skeleton is rigid, and one between measured points varies. The leeway is therefore a
    multiple of the bone's usual variation.

    Args:
        places: centre -> positions (n, 3) [m], NaN where not seen.
    """
    places, found = _with_middles(places), {}
    for name, start, end, least, _ in _bones():
        if start in places and end in places:
            length = np.linalg.norm(places[end] - places[start], axis=1)
            if np.isfinite(length).any():
                middle = float(np.nanmedian(length))
                varies = 1.4826 * float(np.nanmedian(np.abs(length - middle))) / max(middle, 1e-9)
                rigid = varies < _RIGID and least < _BENDS_FROM
                share = _LEAST if rigid else min(max(_USUALLY * varies, least), _MOST)
                found[name] = Usual(middle, share * middle)
    return found


def placed_by_body(errors: Mapping[str, np.ndarray], observed: np.ndarray) -> dict[str, np.ndarray]:
    """Return the distances of centres (n,) [m], NaN where an angle on the way there is not seen.

    An ankle without a knee says nothing of how well the body fits.

    Args:
        errors: centre -> distance of the body's from the recording's (n,) [m].
        observed: which joint angles are determined (n, 32) bool.
    """
    found = {}
    for centre, error in errors.items():
        way = [INDEX[joint] for joint in _CHAINS.get(centre, ())]
        found[centre] = np.where(observed[:, way].all(axis=1), error, np.nan)
    return found


def doubtful(
    places: Mapping[str, np.ndarray],
    fitted: Mapping[str, np.ndarray],
    errors: Mapping[str, np.ndarray],
    usual: Mapping[str, Usual],
    on_shoulders: np.ndarray,
    time: np.ndarray,
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return where the recording cannot be right: cause -> (n,) bool, and the joints (n, 32) bool.

    Args:
        places: centre -> positions of the recording (n, 3) [m], NaN where not seen.
        fitted: centre -> positions of the body (n, 3) [m].
        errors: centre -> distance between both (n,) [m], see `placed_by_body`.
        usual: lengths of the bones, see `usual_lengths`.
        on_shoulders: how far the base of the neck is from its usual place on the shoulders, ahead
            of it and to the left (n, 2), see `ergoqp.mocap.fitting.standins`.
        time: times of the frames (n,) [s].
    """
    causes, wrong = {}, np.zeros((len(time), len(JOINTS)), dtype=bool)

    def doubt(cause: str, frames: np.ndarray, joints: Iterable[str]) -> None:
        if frames.any():
            causes[cause] = frames
            for joint in joints:
                wrong[:, INDEX[joint]] |= frames

    places, fitted = _with_middles(places), _with_middles(fitted)
    for name, start, end, joints in _DIRECTIONS:
        if name in usual:
            bone, own = (_bone(each, start, end) for each in (places, fitted))
            doubt(f"{name} beyond its range", angle_between(bone, own) > _OFF, joints)
    for name, *ends, joints in _BENDS:
        if all(end in places for end in ends):
            bend, own = (
                angle_between(_bone(each, *ends[:2]), _bone(each, *ends[1:]))
                for each in (places, fitted)
            )
            doubt(f"{name} beyond its range", np.abs(bend - own) > _OFF, joints)
    bones = {name: (_bone(places, *e), joints) for name, *e, _, joints in _bones() if name in usual}
    leaping = leaps({name: bone for name, (bone, _) in bones.items()}, time)
    for name, (bone, joints) in bones.items():
        off = np.abs(np.linalg.norm(bone, axis=1) - usual[name].length)
        # Between two wrong frames, a frame in which the length happens to be right is wrong, too.
        stretched = closed(_whole_runs(off, usual[name].leeway), time)
        doubt(f"{name} of unusual length", stretched, joints)
        jumping = between_leaps(leaping[name], stretched, time) & ~stretched
        doubt(f"{name} jumps", jumping, joints)
    doubt("neck out of place", _neck_wrong(causes, on_shoulders), _ABOVE)
    doubt(f"body off by more than {_POOR:g} m", rms(errors, len(time)) > _POOR, JOINTS)
    for centre, joints in _CENTRES.items():
        if centre in errors:
            off = errors[centre] > _ASTRAY
            doubt(f"{spoken(centre)} off by more than {_ASTRAY:g} m", off, joints)
    return causes, wrong


def _whole_runs(off: np.ndarray, leeway: float) -> np.ndarray:
    """Return the frames in which a length is off by more than a leeway (n,) bool.

    Those around are returned, too, as long as it is off by half of that: a point that drifts is
    wrong before it shows, and after.
    """
    wrong, near = off > leeway, np.nan_to_num(off) > leeway / 2
    if not wrong.any():
        return wrong
    starts = np.flatnonzero(np.diff(near, prepend=~near[0]))
    whole = np.logical_or.reduceat(wrong, starts)
    return np.repeat(whole, np.diff(starts, append=len(off))) & near


def _neck_wrong(causes: Mapping[str, np.ndarray], on_shoulders: np.ndarray) -> np.ndarray:
    """Return the frames in which the base of the neck may be in a wrong place (n,) bool.

    It is the common end of the bones to the head and to both shoulders. If only that to the head is
    of unusual length, the neck is right where it is at its usual place on the shoulders.

    Args:
        causes: cause -> frames (n,) bool.
        on_shoulders: as of `doubtful`.
    """
    none, away = np.zeros(len(on_shoulders), dtype=bool), np.linalg.norm(on_shoulders, axis=1)
    neck, *shoulders = (
        causes.get(f"{name} of unusual length", none)
        for name in ("neck", "right shoulder", "left shoulder")
    )
    # A shoulder in a wrong place moves the middle of both.
    apart = causes.get("shoulder girdle of unusual length", none)
    wrong = np.sum([neck, *shoulders], axis=0) >= 2
    wrong |= neck & ~(away < _ELSEWHERE / 2)
    return wrong | (_whole_runs(away, _ELSEWHERE) & ~apart)


def rms(errors: Mapping[str, np.ndarray], count: int) -> np.ndarray:
    """Return the root of the mean squared distance of centres (count,) [m]; NaN: none is seen.

    Args:
        errors: centre -> distance of the body's from the recording's (count,) [m]; NaN: not seen.
        count: number of frames.
    """
    total, seen = np.zeros(count), np.zeros(count)
    for each in errors.values():
        known = np.isfinite(each)
        total += np.where(known, each, 0.0) ** 2
        seen += known
    return np.sqrt(total / np.where(seen, seen, np.nan))


def without_trunk(observed: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames in which the trunk is not seen, and not near in time either (n,) bool.

    Args:
        observed: which joint angles are determined (n, 32) bool.
        time: times of the frames (n,) [s].
    """
    return away_from(observed[:, INDEX["trunk_flexion"]], time) > NEAR


def scored_frames(count: int, not_scored: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames that no cause keeps from being scored (count,) bool.

    Args:
        count: number of frames.
        not_scored: cause -> the frames that are not scored because of it (count,) bool.
    """
    return ~np.logical_or.reduce([np.zeros(count, dtype=bool), *not_scored.values()])


def _bones() -> Iterator[tuple[str, str, str, float, tuple[str, ...]]]:
    """Yield name and ends of each bone, its least leeway if it is not rigid, and its joints.

    The leeway is a share of the length. That of the trunk is larger because a bent trunk is
    shorter, and that of the shoulders because a raised shoulder is nearer to the neck. The joints
    are those whose angles depend on one of the ends.
    """
    legs = tuple(joint for side in SIDES for joint in _of(side, LEG))
    yield "trunk", "hips", "neck", _MOST, _ABOVE
    yield "neck", "neck", "skull", _MOST, _NECK
    yield "pelvis", "right_hip", "left_hip", 0.1, (*_ABOVE, *legs)
    yield "shoulder girdle", "right_shoulder", "left_shoulder", 0.15, _FROM_SHOULDERS
    for side in SIDES:
        arm, leg = _of(side, _ARM), _of(side, LEG)
        yield f"{side} shoulder", "neck", f"{side}_shoulder", 0.2, _FROM_SHOULDERS
        yield f"{side} upper arm", f"{side}_shoulder", f"{side}_elbow", 0.1, arm
        yield f"{side} forearm", f"{side}_elbow", f"{side}_wrist", 0.06, arm
        yield f"{side} thigh", f"{side}_hip", f"{side}_knee", 0.06, leg
        yield f"{side} shank", f"{side}_knee", f"{side}_ankle", 0.06, leg


def _with_middles(places: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the positions with the middle of the hips and the upper end of the head's bone."""
    found = dict(places)
    if "right_hip" in places and "left_hip" in places:
        found["hips"] = (places["right_hip"] + places["left_hip"]) / 2
    if "head" in places or "head_top" in places:
        found["skull"] = places.get("head_top", places.get("head", np.empty(0)))
    return found


def _bone(places: Mapping[str, np.ndarray], start: str, end: str) -> np.ndarray:
    return places[end] - places[start]
