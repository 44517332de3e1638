"""Postures from joint centres: every angle in closed form, from the bones that determine it.

Interpolation of angles that are not determined at every moment.

The rotation of an upper arm is determined only while the elbow is bent, and its flexion is not
determined while the arm points straight to the side. The measured value is then noise. Such an
angle is modelled as a random walk that is measured with a varying accuracy. Its mean given all
measurements is the solution of a tridiagonal system.

Angles of arms and legs from the directions of their bones, in closed form. A limb's first bone
gives flexion and abduction of the joint that it hangs from. The next bone gives the rotation about
the first and the bend between both. Directions are given in the axes of the segment that the limb
hangs from: x forward, y left, z up. A hanging limb points down.

Pose of the pelvis, and angles of trunk and neck, in closed form. The pelvis is upright by
definition and has the heading of the hips. The trunk is the line from the middle of the hips to the
base of the neck, with the twist of the shoulders. The neck is the line from there to the top of the
head, or its base, with the twist of the nose.

A posture is scored by the directions of its bones. The angles are therefore those of the
recording's own bones, whatever their lengths. The distance between the recorded joint centres and
those of the fitted body is the check.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.arguments import Progress, unseen
from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.mocap.fitting.standins import (
    UsualPlaces,
    either,
    hips_of,
    neck_of,
    neck_on,
    off_by,
    usual_places,
)
from ergoqp.mocap.fitting.triples import both_ways, chosen, near
from ergoqp.mocap.fitting.unknown import NEAR, Doubt, Spans, away_from, pieces_of, spans_of
from ergoqp.mocap.fitting.validity import (
    Usual,
    angle_between,
    doubtful,
    filled,
    placed_by_body,
    rms,
    steady,
    usual_lengths,
    without_trunk,
)
from ergoqp.mocap.naming import CENTRES, centres_of, placed

Angles = dict[str, np.ndarray]
"""Joint, without its side -> angles (n,) [rad], or whether they are determined (n,) bool."""

_NEARLY_ALL: Final = 0.9
"""Share of the frames in which a forearm beyond its range shows that its markers are others."""
_TOE: Final = 0.01
"""Weight of the foot in the thigh's rotation, relative to a knee that is bent by 90 degrees."""
_OVER_STRAIGHT: Final = np.radians(25.0)
"""Bend of a knee up to which it may be bent backward."""
_NOTHING: Final = np.radians(10.0)
"""Bend of an elbow up to which the arm shows nothing of its rotation [rad]."""
STRAIGHT: Final = np.radians(20.0)
"""Bend of an elbow up to which it is not certain [rad].

The forearms of adults point outward by a carrying angle of 10 to 15 deg. At this bend, one of 10
deg looks as if the upper arm was rotated by 30 deg.
"""
THUMB: Final = np.arctan2(0.02, 0.05)
"""Angle by which the thumb of `models/human.xml` is turned inward about the hand [rad]."""


def arm_angles(
    side: str,
    upper_arm: np.ndarray,
    forearm: np.ndarray,
    hand: np.ndarray,
    thumb: np.ndarray,
    time: np.ndarray,
    begin: bool | None = None,
) -> tuple[Angles, Angles, np.ndarray]:
    """Return the angles of an arm, which of them are determined, and which triple is chosen.

    The latter two are (n,) bool; for the last see `ergoqp.mocap.fitting.triples`.

    Args:
        side: ``right`` or ``left``.
        upper_arm: from shoulder to elbow in the axes of the trunk (n, 3); NaN where not seen, here
            and below.
        forearm: from elbow to wrist (n, 3).
        hand: from wrist to knuckles (n, 3).
        thumb: from wrist to thumb (n, 3).
        time: times of the frames (n,) [s].
        begin: whether the second triple is chosen at first; None: unknown.
    """
    out, upper_arm = _out(side), unit(upper_arm)
    forearm = _beyond(upper_arm, forearm)
    hand = _beyond(forearm, hand)
    lower, upper = _range(side, "shoulder_flexion", "shoulder_abduction", "shoulder_rotation")
    forward, aside, up = upper_arm.T
    bend = angle_between(upper_arm, forearm)

    held = np.stack([np.arctan2(forward, -up), np.arcsin(np.clip(out * aside, -1, 1))], axis=1)
    turn = _turn(forearm, _hanging(held, out), out)
    shows = np.stack([np.hypot(forward, up), np.ones_like(up), np.sin(bend)], axis=1)
    ways = both_ways(np.column_stack([held, turn]), lower, upper)
    second = chosen(ways, np.nan_to_num(shows), lower, upper, time, begin)
    flexion = np.where(second, ways[1][:, 0], ways[0][:, 0])
    # The angle jumps where the other triple is chosen, or where it wraps by a whole turn.
    leaps = np.diff(second) | (np.abs(np.diff(flexion)) > 1.2 * np.pi)
    flexion = steady(flexion, shows[:, 0], time, leaps)
    flexion = np.clip(flexion, lower[0], upper[0])
    # Abduction and rotation are recomputed for this flexion, so that the arm's direction is kept.
    along = np.sin(flexion) * forward - np.cos(flexion) * up
    abduction = near(np.arctan2(out * aside, along), lower[1], upper[1])
    held = np.stack([flexion, np.clip(filled(abduction, time), lower[1], upper[1])], axis=1)
    hanging = _hanging(held, out)
    turn = near(_turn(forearm, hanging, out), lower[2], upper[2])
    turn = steady(turn, np.where(bend > _NOTHING, shows[:, 2], 0.0), time, leaps)
    elbow = filled(bend, time)
    # The hand is measured in the forearm's own axes, even beyond the ranges.
    axes = hanging * Rotation.from_euler("ZY", np.stack([-out * turn, -elbow], 1))
    into = axes.inv()
    angles, told = _wrist_angles(side, into.apply(hand), into.apply(thumb), time)
    angles |= {
        "shoulder_flexion": flexion,
        "shoulder_abduction": held[:, 1],
        "shoulder_rotation": np.clip(turn, lower[2], upper[2]),
        "elbow_flexion": np.clip(elbow, *_range(side, "elbow_flexion")),
    }
    told |= dict.fromkeys(("shoulder_flexion", "shoulder_abduction"), np.isfinite(up))
    # A straight arm does not show how it is rotated.
    told |= {"elbow_flexion": np.isfinite(bend), "shoulder_rotation": bend > STRAIGHT}
    return angles, told, second


def leg_angles(
    side: str,
    thigh: np.ndarray,
    shank: np.ndarray,
    foot: np.ndarray,
    sole: np.ndarray,
    time: np.ndarray,
) -> tuple[Angles, Angles]:
    """Return the angles of a leg, and which of them the recording determines (n,) bool.

    Args:
        side: ``right`` or ``left``.
        thigh: from hip to knee in the upright axes of the pelvis (n, 3); NaN where not seen, here
            and below.
        shank: from knee to ankle (n, 3).
        foot: from ankle to toe (n, 3).
        sole: from ankle to toe of the person's own foot, in its axes (3,).
        time: times of the frames (n,) [s].
    """
    out, thigh = _out(side), unit(thigh)
    shank = _beyond(thigh, shank)
    foot = _beyond(shank, foot)
    lower, upper = _range(side, "hip_flexion", "hip_abduction", "hip_rotation")
    forward, aside, up = thigh.T
    bend = angle_between(thigh, shank)
    flexion = steady(np.arctan2(forward, -up), np.hypot(forward, up), time)
    held = np.stack([flexion, filled(np.arcsin(np.clip(out * aside, -1, 1)), time)], axis=1)
    held = np.clip(held, lower[:2], upper[:2])
    # The shank determines the rotation of a bent leg, the foot that of a straight one.
    hanging = _hanging(held, out)
    back, toes = (hanging.inv().apply(bone) for bone in (shank, foot))
    # A knee that is bent toward the toes is straight, or the thigh would be turned backward.
    over = (bend < _OVER_STRAIGHT) & ((back * toes)[:, :2].sum(axis=1) > 0)
    bend = np.where(over, 0.0, bend)
    ahead = -np.sin(bend)[:, None] * back[:, :2]
    ahead += np.nan_to_num(_TOE * np.maximum(np.cos(bend), 0)[:, None] * toes[:, :2])
    turn = np.arctan2(-out * ahead[:, 1], ahead[:, 0])
    turn = steady(turn, np.sqrt(np.linalg.norm(ahead, axis=1)), time)
    rotation = np.clip(turn, lower[2], upper[2])
    knee = np.clip(filled(bend, time), *_range(side, "knee_flexion"))

    axes = hanging * Rotation.from_euler("ZY", np.stack([-out * rotation, knee], 1))
    toes, (length, _, drop) = axes.inv().apply(foot), sole / np.linalg.norm(sole)
    roll = np.arcsin(np.clip(toes[:, 1] / -drop, -1, 1))
    pitch = np.arctan2(toes[:, 2], toes[:, 0]) - np.arctan2(drop * np.cos(roll), length)
    angles = {
        "hip_flexion": held[:, 0],
        "hip_abduction": held[:, 1],
        "hip_rotation": rotation,
        "knee_flexion": knee,
        "ankle_flexion": _inside(side, "ankle_flexion", pitch, time),
        "ankle_inversion": _inside(side, "ankle_inversion", -out * roll, time),
    }
    told: Angles = dict.fromkeys(("hip_flexion", "hip_abduction"), np.isfinite(up))
    told |= dict.fromkeys(("hip_rotation", "knee_flexion"), np.isfinite(bend))
    told |= dict.fromkeys(("ankle_flexion", "ankle_inversion"), np.isfinite(pitch))
    return angles, told


def _wrist_angles(
    side: str, hand: np.ndarray, thumb: np.ndarray, time: np.ndarray
) -> tuple[Angles, Angles]:
    """Return the angles of forearm and wrist; hand and thumb in the axes of the elbow (n, 3)."""
    out = _out(side)
    # A thumb beside a hand that is not seen shows the pronation of the forearm all the same.
    up = -either(hand, np.broadcast_to([0.0, 0.0, -1.0], hand.shape))
    beside = unit(thumb - (thumb * up).sum(axis=1, keepdims=True) * up)
    across = np.cross(up, beside)
    ahead = np.cos(THUMB) * beside + out * np.sin(THUMB) * across
    # The hand's left axis is the axis of deviation, so deviation does not change it.
    left = np.cross(up, ahead)
    turn = out * np.arctan2(left[:, 0], left[:, 1])
    lower, upper = _range(side, "forearm_pronation").ravel()
    beyond = (turn < lower) | (turn > upper)
    if beyond.sum() >= _NEARLY_ALL * np.isfinite(turn).sum():
        # Nobody turns a forearm like that all the time: these are not the sides of a hand.
        turn = np.full_like(turn, np.nan)
    pronation = _inside(side, "forearm_pronation", turn, time)
    turned = Rotation.from_euler("Z", -out * pronation[:, None]).inv().apply(hand)
    flexion = -out * np.arctan2(turned[:, 1], -turned[:, 2])
    deviation = -np.arcsin(np.clip(turned[:, 0], -1, 1))
    angles = {
        "forearm_pronation": pronation,
        "wrist_flexion": _inside(side, "wrist_flexion", flexion, time),
        "wrist_deviation": _inside(side, "wrist_deviation", deviation, time),
    }
    told: Angles = dict.fromkeys(("wrist_flexion", "wrist_deviation"), np.isfinite(turned[:, 0]))
    return angles, told | {"forearm_pronation": np.isfinite(turn)}


def _turn(bone: np.ndarray, hanging: Rotation, out: float) -> np.ndarray:
    """Return the inward rotation of a limb (n,) [rad], from the bone beyond its bend.

    Args:
        bone: direction of that bone (n, 3).
        hanging: axes of the limb without rotation.
        out: sign of the outside along y.
    """
    beyond = hanging.inv().apply(bone)
    return np.arctan2(-out * beyond[:, 1], beyond[:, 0])


def _hanging(held: np.ndarray, out: float) -> Rotation:
    """Return the axes of a limb with some flexion and abduction (n, 2) [rad]."""
    return Rotation.from_euler("YX", np.nan_to_num(held) * np.array([-1.0, out]))


def _out(side: str) -> float:
    """Return the sign of a side's outside along y."""
    return -1.0 if side == "right" else 1.0


def _range(side: str, *joints: str) -> np.ndarray:
    """Return the ends of the ranges (2, len(joints)) [rad]."""
    numbers = [INDEX[f"{side}_{joint}"] for joint in joints]
    return np.stack([LOWER[numbers], UPPER[numbers]])


def _inside(side: str, joint: str, angles: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles with gaps filled and clipped to the range (n,) [rad]."""
    lower, upper = _range(side, joint).ravel()
    return np.clip(filled(near(angles, lower, upper), time), lower, upper)


def _beyond(bone: np.ndarray, following: np.ndarray) -> np.ndarray:
    """Return the directions of the next bone (n, 3); NaN where the first bone is not seen."""
    return np.where(np.isfinite(bone), unit(following), np.nan)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors of length one (n, 3); NaN for those without a direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)


def every_centre(places: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the positions of every centre, NaN for those that the recording does not have."""
    lost = np.full_like(next(iter(places.values())), np.nan)
    return {**dict.fromkeys(CENTRES, lost), **places}


_PAIRS: Final = ("hip", "shoulder", "knee", "elbow", "ankle", "wrist")
"""Pairs of centres that define the heading of the body, the best first."""


@dataclass(frozen=True, eq=False)
class Spine:
    """Pelvis, trunk and neck over time.

    Attributes:
        pelvis: x, y, z [m] and yaw [rad] of the pelvis (n, 4).
        angles: joint -> angles within the range (n,) [rad].
        told: joint -> whether the recording determines it (n,) bool.
        upright: axes of the pelvis.
        trunk: axes of the trunk.
    """

    pelvis: np.ndarray
    angles: dict[str, np.ndarray]
    told: dict[str, np.ndarray]
    upright: Rotation
    trunk: Rotation


def spine_of(
    place: Mapping[str, np.ndarray],
    time: np.ndarray,
    given: Collection[str],
    usually: UsualPlaces,
) -> Spine:
    """Return pelvis, trunk and neck.

    Args:
        place: every centre -> positions (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s].
        given: centres that are seen at some time of the recording, of which this may be a part.
        usually: where both ends of the trunk usually are.
    """
    yaw = _unwrapped(_heading(place, time), time)
    hips = hips_of(place, yaw, usually)
    neck = neck_of(place, hips, usually)
    pelvis = np.column_stack([*(filled(each, time) for each in hips.T), yaw])
    upright = Rotation.from_euler("Z", yaw[:, None])
    trunk, trunk_told, axes = _segment(
        "trunk", upright, neck - hips, _across(place, "shoulder"), time
    )
    # Without hips the heading is that of the shoulders, and says nothing of their twist.
    trunk_told["trunk_twist"] &= np.isfinite(_across(place, "hip")[:, 0])
    # The nose defines left: perpendicular to where it points.
    head = either(place["head_top"], place["head"])
    ahead = place["nose"] - either(place["head"], neck)
    left = np.cross(head - neck, ahead)
    bent, bent_told, _ = _segment("neck", axes, head - neck, left, time)
    # A head or a neck that stands for a lost one is elsewhere.
    usual = np.ones(len(time), dtype=bool)
    for centre in {"neck", "head_top"} & set(given):
        usual &= np.isfinite(place[centre][:, 0])
    if not usual.all():
        bent_told = {joint: told & usual for joint, told in bent_told.items()}
        bent = {joint: _between(each, bent_told[joint], time) for joint, each in bent.items()}
    return Spine(pelvis, trunk | bent, trunk_told | bent_told, upright, axes)


def _segment(
    name: str, below: Rotation, along: np.ndarray, left: np.ndarray, time: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Rotation]:
    """Return flexion, side bend and twist of a segment, which are determined, and its axes."""
    x, y, z = below.inv().apply(along).T
    length = np.sqrt(x**2 + y**2 + z**2)
    bend = np.arcsin(np.clip(y / np.where(length > 0, length, np.nan), -1, 1))
    lean = np.stack([filled(each, time) for each in (np.arctan2(x, z), bend)], axis=1)
    axes = below * Rotation.from_euler("YX", lean * [1.0, -1.0])
    seen = np.isfinite(bend)
    x, y, _ = axes.inv().apply(left).T
    turned = np.where(seen & (np.hypot(x, y) > 0), np.arctan2(-x, y), np.nan)
    names = [f"{name}_{joint}" for joint in ("flexion", "side_bend", "twist")]
    told = dict(zip(names, (seen, seen, np.isfinite(turned)), strict=True))
    turned = filled(turned, time)
    angles = {
        joint: np.clip(each, LOWER[INDEX[joint]], UPPER[INDEX[joint]])
        for joint, each in zip(names, (*lean.T, turned), strict=True)
    }
    # What hangs from the segment is measured in its own axes, even beyond the ranges.
    return angles, told, axes * Rotation.from_euler("Z", turned[:, None])


def _heading(place: Mapping[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Return the heading of the body (n,) [rad]; NaN: unknown.

    It is that of the best pair that is seen in the frame or near in time: limbs turn against the
    body.
    """
    yaw = np.full(len(time), np.nan)
    for pair in _PAIRS:
        left = _across(place, pair)
        far = away_from(np.isfinite(yaw), time) > NEAR
        yaw = np.where(far, np.arctan2(-left[:, 0], left[:, 1]), yaw)
    return yaw


def _unwrapped(yaw: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles (n,) [rad], unwrapped and with gaps filled."""
    seen = np.isfinite(yaw)
    whole = np.full(len(yaw), np.nan)
    whole[seen] = np.unwrap(yaw[seen])
    return filled(whole, time)


def _across(place: Mapping[str, np.ndarray], pair: str) -> np.ndarray:
    """Return the vectors from the right centre of a pair to the left one (n, 3)."""
    return place[f"left_{pair}"] - place[f"right_{pair}"]


_SHOULDER: Final = ("flexion", "abduction", "rotation")


def _between(angles: np.ndarray, seen: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles (n,) [rad], interpolated where they are not seen."""
    return filled(np.where(seen, angles, np.nan), time)


_BLOCK: Final = 8192
"""Frames that are fitted at once, because an hour does not fit into memory."""
_AROUND: Final = 3.0
"""Duration before and after a block that is fitted with it [s]."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The fitted movement.

    Attributes:
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles within their ranges (n, 32) [rad].
        observed: which joint angles the recording determines (n, 32).
        errors: centre -> distance of the body's from the recording's (n,) [m]; NaN: not seen.
        doubts: cause -> the frames in which some of the angles are not used because of it (n,)
            bool.
        not_scored: cause -> the frames that are not scored because of it (n,) bool.
        spans: ends of the angles that are not known at every moment.
    """

    pelvis: np.ndarray
    postures: np.ndarray
    observed: np.ndarray
    errors: dict[str, np.ndarray]
    doubts: dict[str, np.ndarray]
    not_scored: dict[str, np.ndarray] = field(default_factory=dict)
    spans: Spans = field(default_factory=dict)

    @property
    def error(self) -> np.ndarray:
        """Root of the mean squared distance of the seen centres (n,) [m]; NaN: none is seen."""
        return rms(self.errors, len(self.pelvis))


def fit(
    body: Body,
    places: Mapping[str, np.ndarray],
    time: np.ndarray,
    progress: Progress = unseen,
    doubt: Doubt | None = None,
) -> Fit:
    """Return the postures of a body whose joint centres are known.

    An angle that is never determined is zero. One that is not determined for a while, or of which
    the recording cannot be right, is interpolated.

    Args:
        body: the person.
        places: centre -> positions (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s], increasing.
        progress: is called with the share of the frames that is done.
        doubt: how far the angles of the centres may be from those of the person.
    """
    every = every_centre(places)
    count, usual, usually = len(time), usual_lengths(places), usual_places(every)
    whole = Fit(
        np.empty((count, 4)),
        np.empty((count, len(JOINTS))),
        np.empty((count, len(JOINTS)), dtype=bool),
        {centre: np.empty(count, dtype=np.float32) for centre in placed(places)},
        {},
    )
    over: dict[str, np.ndarray] = {}
    for start in range(0, count, _BLOCK):
        stop = min(start + _BLOCK, count)
        first = int(np.searchsorted(time, time[start] - _AROUND))
        last = int(np.searchsorted(time, time[stop - 1] + _AROUND, side="right"))
        near = {centre: path[first:last].astype(float) for centre, path in places.items()}
        # In the overlap of two blocks, an arm keeps the triple of angles that it had.
        begin = {}
        for side, ways in over.items():
            # It is that of the first frame already fitted in which the arm is seen.
            seen = whole.observed[first:start, INDEX[f"{side}_shoulder_flexion"]]
            if seen.any():
                begin[side] = bool(ways[first + int(np.argmax(seen))])
        part, second = _fitted(body, near, time[first:last], begin, usual, usually)
        here, rows = slice(start - first, stop - first), slice(start, stop)
        for side, ways in second.items():
            over.setdefault(side, np.zeros(count, dtype=bool))[rows] = ways[here]
        for name in ("pelvis", "postures", "observed"):
            getattr(whole, name)[rows] = getattr(part, name)[here]
        for centre, errors in part.errors.items():
            whole.errors[centre][rows] = errors[here]
        for cause, frames in part.doubts.items():
            if frames[here].any():
                known = whole.doubts.setdefault(cause, np.zeros(count, dtype=bool))
                known[rows] = frames[here]
        progress(stop / count)
    apart = pieces_of(places, time)
    lost = without_trunk(whole.observed, apart)
    hips, shoulders = (np.isfinite(_across(every, pair)[:, 0]) for pair in ("hip", "shoulder"))
    doubt = replace(doubt or Doubt(), trunk=off_by(every, usually))
    spans, told = spans_of(whole.postures, whole.observed, apart, doubt, (hips, shoulders))
    not_scored = {"trunk not seen": lost} if lost.any() else {}
    return replace(whole, not_scored=not_scored, spans=spans, observed=told)


def _fitted(
    body: Body,
    places: Mapping[str, np.ndarray],
    time: np.ndarray,
    begin: Mapping[str, bool],
    usual: Mapping[str, Usual],
    usually: UsualPlaces,
) -> tuple[Fit, dict[str, np.ndarray]]:
    """Return the fit of some frames, and side -> frames with the second triple of angles (n,)."""
    place = every_centre(places)
    spine = spine_of(place, time, places, usually)
    angles, told, second = dict(spine.angles), dict(spine.told), {}
    into_trunk, into_pelvis = spine.trunk.inv(), spine.upright.inv()
    for side in SIDES:
        at = {name.removeprefix(f"{side}_"): path for name, path in place.items()}
        *of_arm, second[side] = arm_angles(
            side,
            into_trunk.apply(at["elbow"] - at["shoulder"]),
            into_trunk.apply(at["wrist"] - at["elbow"]),
            into_trunk.apply(at["knuckles"] - at["wrist"]),
            into_trunk.apply(at["thumb"] - at["wrist"]),
            time,
            begin.get(side),
        )
        of_leg = leg_angles(
            side,
            into_pelvis.apply(at["knee"] - at["hip"]),
            into_pelvis.apply(at["ankle"] - at["knee"]),
            into_pelvis.apply(at["toe"] - at["ankle"]),
            body.model.site(f"{side}_toe").pos,
            time,
        )
        for limb, seen in (of_arm, of_leg):
            angles |= {f"{side}_{joint}": each for joint, each in limb.items()}
            told |= {f"{side}_{joint}": each for joint, each in seen.items()}
    postures = np.stack([angles[joint] for joint in JOINTS], axis=1)
    observed = np.stack([told[joint] for joint in JOINTS], axis=1)
    # Arms and neck are measured from the trunk.
    held = [INDEX[f"{side}_shoulder_{joint}"] for side in SIDES for joint in _SHOULDER]
    held += [INDEX[f"neck_{joint}"] for joint in ("flexion", "side_bend", "twist")]
    lost = ~spine.told["trunk_flexion"]
    if lost.any():
        for joint in held:
            observed[lost, joint] = False
            postures[:, joint] = _between(postures[:, joint], observed[:, joint], time)
    fitted = centres_of(body, spine.pelvis, postures)
    errors = {
        centre: np.linalg.norm(fitted[centre] - path, axis=1)
        for centre, path in places.items()
        if centre in fitted
    }
    errors = placed_by_body(errors, observed)
    found = Fit(spine.pelvis, postures, observed, errors, {})
    moved = (neck_on(place) - usually.neck)[:, :2]
    causes, wrong = doubtful(places, fitted, errors, usual, moved, time)
    for joint in np.flatnonzero((wrong & observed).any(axis=0)):
        observed[:, joint] &= ~wrong[:, joint]
        postures[:, joint] = _between(postures[:, joint], observed[:, joint], time)
    return replace(found, doubts=causes), second
