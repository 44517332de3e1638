"""A marker on the skin, as found by a calibration."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Marker:
    """Position of a marker on the body.

    Attributes:
        frame: frame that it moves with, one of `ergoqp.human.FRAMES`.
        offset: position in that frame, along its axes [m].
        residual: root of the mean squared distance between the marker and this position on the
            fitted body [m]; NaN if it was never seen.
    """

    frame: str
    offset: tuple[float, float, float]
    residual: float
