"""The postures behind joint centres: every angle in closed form, from the bones that show it.

A bone's direction is what a posture is scored by. So the angles are those of the recording's own
bones, whatever their lengths, and where the fitted body's centres come to lie is the check on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import JOINTS, SIDES
from ergoqp.recordings.fitting.centres_of import centres_of
from ergoqp.recordings.fitting.limbs import arm_angles, leg_angles
from ergoqp.recordings.fitting.spine import spine_of
from ergoqp.recordings.fitting.validity import not_scored
from ergoqp.recordings.naming import CENTRES


@dataclass(frozen=True, eq=False)
class Fit:
    """The fitted movement.

    Attributes:
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles within their ranges (n, 32) [rad].
        observed: which joints the recording tells (n, 32).
        errors: centre -> distance of the body's from the recording's (n,) [m]; NaN: not seen.
        not_scored: why frames are not to be scored -> those frames (n,) bool.
    """

    pelvis: np.ndarray
    postures: np.ndarray
    observed: np.ndarray
    errors: dict[str, np.ndarray]
    not_scored: dict[str, np.ndarray]

    @property
    def error(self) -> np.ndarray:
        """Root of the mean squared distance of the seen centres (n,) [m]; NaN: none is seen."""
        return _root_mean_square(self.errors, len(self.pelvis))


def fit(body: Body, places: Mapping[str, np.ndarray], time: np.ndarray) -> Fit:
    """Return the postures of a body whose joint centres are known.

    An angle that is never told is zero; one that is not told for a while goes on between those
    that are.

    Args:
        body: the person.
        places: centre -> positions (n, 3) [m], NaN where not seen.
        time: when (n,) [s], increasing.
    """
    lost = np.full((len(time), 3), np.nan)
    place = {centre: places.get(centre, lost) for centre in CENTRES}
    spine = spine_of(place, time)
    angles, told = dict(spine.angles), dict(spine.told)
    into_trunk, into_pelvis = spine.trunk.inv(), spine.upright.inv()
    for side in SIDES:
        at = {centre.removeprefix(f"{side}_"): path for centre, path in place.items()}

        def bone(
            start: str, end: str, at: Mapping[str, np.ndarray] = at, into=into_trunk
        ) -> np.ndarray:
            return into.apply(at[end] - at[start])

        arm = arm_angles(
            side,
            bone("shoulder", "elbow"),
            bone("elbow", "wrist"),
            bone("wrist", "knuckles"),
            bone("wrist", "thumb"),
            time,
        )
        leg = leg_angles(
            side,
            bone("hip", "knee", into=into_pelvis),
            bone("knee", "ankle", into=into_pelvis),
            bone("ankle", "toe", into=into_pelvis),
            body.model.site(f"{side}_toe").pos,
            time,
        )
        for limb, seen in (arm, leg):
            angles |= {f"{side}_{joint}": each for joint, each in limb.items()}
            told |= {f"{side}_{joint}": each for joint, each in seen.items()}
    postures = np.stack([angles[joint] for joint in JOINTS], axis=1)
    fitted = centres_of(body, spine.pelvis, postures)
    errors = {
        centre: np.linalg.norm(fitted[centre] - path, axis=1)
        for centre, path in places.items()
        if centre in fitted
    }
    observed = np.stack([told[joint] for joint in JOINTS], axis=1)
    error = _root_mean_square(errors, len(time))
    causes = not_scored(places, fitted, observed, error, time)
    return Fit(spine.pelvis, postures, observed, errors, causes)


def _root_mean_square(errors: Mapping[str, np.ndarray], frames: int) -> np.ndarray:
    squares = np.array(list(errors.values())).reshape(-1, frames) ** 2
    seen = np.isfinite(squares)
    count = seen.sum(axis=0)
    return np.sqrt(np.where(seen, squares, 0.0).sum(axis=0) / np.where(count, count, np.nan))
