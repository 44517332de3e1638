"""The samples of a movement that a replay shows, and their timing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.human import Body

LONGEST: Final = 60.0
"""Longest replay [s]. A longer movement is shown faster than real time."""

FRAME_RATE: Final = 30.0
"""Highest frame rate of the replay [Hz]."""


@dataclass(frozen=True, eq=False)
class Movement:
    """The contents of a replay: a scored movement, at every sample.

    Attributes:
        body: the person.
        time: shape (n,) [s], increasing.
        postures: shape (n, 32) [rad]; NaN if there is none.
        base_poses: pelvis in the world, upright, shape (n, 4, 4).
        final: score, 0 without a score; shape (n,).
        segments: scores of the segments, shape (n,) each.
        object_poses: contact frame of the held object in the world, shape (n, 4, 4), None
            without an object.
        seated: whether the person sits; a seat is then drawn.
        held: whether a robot holds the object; a robot is then drawn.
        forces: forces of the object on the hands, world-aligned, shape (n, 3) or more [N];
            None: unknown.
    """

    body: Body
    time: NDArray[np.float64]
    postures: NDArray[np.float64]
    base_poses: NDArray[np.float64]
    final: NDArray[np.int64]
    segments: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    object_poses: NDArray[np.float64] | None = None
    seated: bool = False
    held: bool = False
    forces: NDArray[np.float64] | None = None

    def at(self, samples: NDArray[np.int64]) -> Movement:
        """Return some samples. A missing posture or pose is replaced by the last one before it.

        If there is none before it, the first one after it is used.
        """
        shown = _held(samples, _finite(self.postures) & _finite(self.base_poses))
        objects = self.object_poses
        if objects is not None:
            objects = np.nan_to_num(objects[_held(samples, _finite(objects))])
        return Movement(
            body=self.body,
            time=self.time[samples],
            postures=np.nan_to_num(self.postures[shown]),
            base_poses=np.nan_to_num(self.base_poses[shown]),
            final=self.final[samples],
            segments={name: scores[samples] for name, scores in self.segments.items()},
            object_poses=objects,
            seated=self.seated,
            held=self.held,
            forces=None if self.forces is None else np.nan_to_num(self.forces[samples]),
        )


def _finite(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of n samples contain only finite numbers."""
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))


def _held(samples: NDArray[np.int64], good: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return for each sample the last good one up to it, else the first good one, else itself."""
    numbers = np.flatnonzero(good)
    return (
        numbers[np.maximum(np.searchsorted(numbers, samples, side="right") - 1, 0)]
        if len(numbers)
        else samples
    )


@dataclass(frozen=True)
class Timing:
    """The samples that a replay shows, and its speed.

    Attributes:
        samples: number of the sample of each frame, shape (frames,).
        frame_time: duration of a frame on the screen [s].
        speed: movement time over replay time, 1 for real time.
    """

    samples: NDArray[np.int64]
    frame_time: float
    speed: float

    @property
    def note(self) -> str:
        """What the replay leaves out, in one sentence."""
        rate = (
            f"{1 / self.frame_time:.2g} frames per second" if self.frame_time else "a single frame"
        )
        if self.speed > 1:
            return (
                f"The replay runs {self.speed:.3g} times faster than real time, to last"
                f" {LONGEST:.0f} s, at {rate}."
            )
        return f"The replay runs in real time, at {rate}."


def timing_of(time: NDArray[np.float64]) -> Timing:
    """Return the samples of a replay: at most 60 s and 30 frames per second, evenly spaced in time.

    Args:
        time: time of each sample, increasing, shape (n,) [s].
    """
    duration = float(time[-1] - time[0])
    if len(time) < 2 or duration <= 0:
        return Timing(np.zeros(1, dtype=np.int64), 0.0, 1.0)
    speed = max(1.0, duration / LONGEST)
    steps = max(1, min(len(time) - 1, int(np.floor(duration / speed * FRAME_RATE + 1e-9))))
    moments = np.linspace(time[0], time[-1], steps + 1)
    # Add a small tolerance, so that a moment exactly at a sample does not show the one before
    # because of rounding.
    after = (
        np.searchsorted(time, moments + 0.5 * duration / (len(time) - 1) * 1e-6, side="right") - 1
    )
    return Timing(np.clip(after, 0, len(time) - 1), duration / speed / steps, speed)
