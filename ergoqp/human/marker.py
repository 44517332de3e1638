"""A marker on the skin, as a calibration has it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Marker:
    """Where a marker sits on the body.

    Attributes:
        frame: of `ergoqp.human.FRAMES`, with which it moves.
        offset: where it is in that frame, along its axes [m].
        residual: root of the mean squared distance between the marker and that place on the fitted
            body [m]; NaN if it was never seen.
    """

    frame: str
    offset: tuple[float, float, float]
    residual: float
