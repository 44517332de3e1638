"""A recording as the rest of the package sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergoqp.human import Body


@dataclass(frozen=True)
class Recording:
    """A person's movement in the 32 joints.

    Attributes:
        time: time stamps, shape (n,) [s].
        postures: joint angles in the order of `ergoqp.JOINTS`, within their ranges, shape (n, 32)
            [rad].
        base_poses: pose of the pelvis in the world, upright (position and heading only), x forward,
            y left, z up, shape (n, 4, 4) [m].
        observed: whether the recording tells this joint, shape (n, 32) bool; one that it does not
            tell is held at zero, and a frame in which nothing is seen keeps the posture before.
        fit_error: root of the mean squared distance between the recording's joint centres and the
            fitted body's, over the centres that were mapped, shape (n,) [m]; NaN where nothing is
            seen.
        object_poses: pose of the held object where the recording has one, shape (n, 4, 4) [m], else
            None.
        assumptions: what was assumed because the file does not say it, one sentence each.
        person: the body that was fitted.
    """

    time: np.ndarray
    postures: np.ndarray
    base_poses: np.ndarray
    observed: np.ndarray
    fit_error: np.ndarray
    object_poses: np.ndarray | None
    assumptions: tuple[str, ...]
    person: Body
