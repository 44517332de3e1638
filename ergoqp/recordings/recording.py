"""The result of reading a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ergoqp.human import Body
from ergoqp.human.person_file import Marker


@dataclass(frozen=True)
class Recording:
    """A person's movement in the 32 joints.

    Attributes:
        time: time stamps, shape (n,) [s].
        postures: joint angles in the order of `ergoqp.JOINTS`, within their ranges, read-only,
            shape (n, 32) [rad].
        base_poses: pose of the pelvis in the world, upright (position and heading only), x forward,
            y left, z up, shape (n, 4, 4) [m].
        observed: whether the recording determines this joint angle, shape (n, 32) bool; an angle
            that it never determines is zero, and one that it does not determine for a while is
            interpolated.
        fit_error: root of the mean squared distance between the recording's joint centres and the
            fitted body's, over the centres that were mapped, shape (n,) [m]; NaN where nothing is
            seen.
        object_poses: pose of the held object, shape (n, 4, 4) [m]; None if the recording has none.
        assumptions: what was assumed because the file does not state it, one sentence each.
        person: the body that was fitted.
        errors: joint centre -> distance between the fitted body's and the recording's, shape (n,)
            [m].
        not_scored: cause (see `ergoqp.recordings.fitting.validity`) -> the frames that are not
            scored because of it, shape (n,) bool.
        markers: marker on the skin -> its place on the fitted body and its residual.
        measured: segments of the person whose lengths are measured in the recording; the others
            follow from the stature. Empty if the person was stated, or if the recording consists of
            joint angles.

    Example:
        >>> import numpy as np
        >>> from ergoqp import fit_postures, reba
        >>> from ergoqp.human import Body
        >>> from ergoqp.recordings.fitting.centres_of import centres_of
        >>> pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (50, 1))
        >>> centres = centres_of(Body(), pelvis, np.zeros((50, 32)))
        >>> recording = fit_postures(list(centres), np.stack(list(centres.values()), axis=1), 50.0)
        >>> int(reba.assess(recording.scored_postures).final.max())
        1
    """

    time: np.ndarray
    postures: np.ndarray
    base_poses: np.ndarray
    observed: np.ndarray
    fit_error: np.ndarray
    object_poses: np.ndarray | None
    assumptions: tuple[str, ...]
    person: Body
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    not_scored: Mapping[str, np.ndarray] = field(default_factory=dict)
    markers: Mapping[str, Marker] = field(default_factory=dict)
    measured: tuple[str, ...] = ()

    @property
    def scored(self) -> np.ndarray:
        """Frames that show a posture, shape (n,) bool."""
        lacking = np.zeros(len(self.time), dtype=bool)
        for frames in self.not_scored.values():
            lacking |= frames
        return ~lacking

    @property
    def scored_postures(self) -> np.ndarray:
        """Postures for `ergoqp.reba.assess`, NaN in frames that are not scored (n, 32) [rad]."""
        scored = self.scored
        if scored.all():
            return self.postures
        postures = np.where(scored[:, None], self.postures, np.nan)
        postures.setflags(write=False)
        return postures

    def causes(self, frame: int) -> list[str]:
        """Return why a frame is not scored; an empty list if it is scored."""
        return [cause for cause, frames in self.not_scored.items() if frames[frame]]
