"""Postures from joint centres: every angle in closed form, from the bones that determine it.

A posture is scored by the directions of its bones. The angles are therefore those of the
recording's own bones, whatever their lengths. The distance between the recorded joint centres and
those of the fitted body is the check.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.fitting.centres_of import centres_of, placed
from ergoqp.recordings.fitting.limbs import arm_angles, leg_angles
from ergoqp.recordings.fitting.spine import spine_of
from ergoqp.recordings.fitting.validity import Usual, not_followed, not_seen, usual_lengths
from ergoqp.recordings.naming import CENTRES

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
        not_scored: cause -> the frames that are not scored because of it (n,) bool.
    """

    pelvis: np.ndarray
    postures: np.ndarray
    observed: np.ndarray
    errors: dict[str, np.ndarray]
    not_scored: dict[str, np.ndarray]

    @property
    def error(self) -> np.ndarray:
        """Root of the mean squared distance of the seen centres (n,) [m]; NaN: none is seen."""
        total, count = np.zeros(len(self.pelvis)), np.zeros(len(self.pelvis))
        for each in self.errors.values():
            seen = np.isfinite(each)
            total += np.where(seen, each, 0.0) ** 2
            count += seen
        return np.sqrt(total / np.where(count, count, np.nan))


def fit(
    body: Body,
    places: Mapping[str, np.ndarray],
    time: np.ndarray,
    progress: Progress = unseen,
) -> Fit:
    """Return the postures of a body whose joint centres are known.

    An angle that is never determined is zero. One that is not determined for a while is
    interpolated.

    Args:
        body: the person.
        places: centre -> positions (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s], increasing.
        progress: is called with the share of the frames that is done.
    """
    count, usual = len(time), usual_lengths(places)
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
        part, second = _fitted(body, near, time[first:last], begin, usual)
        here, rows = slice(start - first, stop - first), slice(start, stop)
        for side, ways in second.items():
            over.setdefault(side, np.zeros(count, dtype=bool))[rows] = ways[here]
        for name in ("pelvis", "postures", "observed"):
            getattr(whole, name)[rows] = getattr(part, name)[here]
        for centre, errors in part.errors.items():
            whole.errors[centre][rows] = errors[here]
        for cause, frames in part.not_scored.items():
            if not frames[here].any():
                continue
            known = whole.not_scored.setdefault(cause, np.zeros(count, dtype=bool))
            known[rows] = frames[here]
        progress(stop / count)
    causes = whole.not_scored | not_seen(whole.observed, whole.postures, time)
    return replace(whole, not_scored={name: each for name, each in causes.items() if each.any()})


def _fitted(
    body: Body,
    places: Mapping[str, np.ndarray],
    time: np.ndarray,
    begin: Mapping[str, bool],
    usual: Mapping[str, Usual],
) -> tuple[Fit, dict[str, np.ndarray]]:
    """Return the fit of some frames, and side -> frames with the second triple of angles (n,)."""
    lost = np.full((len(time), 3), np.nan)
    place = {centre: places.get(centre, lost) for centre in CENTRES}
    spine = spine_of(place, time)
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
    fitted = centres_of(body, spine.pelvis, postures)
    errors = {
        centre: np.linalg.norm(fitted[centre] - path, axis=1)
        for centre, path in places.items()
        if centre in fitted
    }
    found = Fit(spine.pelvis, postures, observed, errors, {})
    causes = not_followed(places, fitted, found.error, usual, time)
    return replace(found, not_scored=causes), second
