"""The sensors and delays between a person and the controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ergoqp.arguments import check_kind, check_number, shown
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS

_ENDS: Final = {
    "delay": (0.0, 2.0),
    "hand_time": (1e-3, 10.0),
    "noise_deg": (0.0, 90.0),
    "drift_deg": (0.0, 90.0),
    "drift_time": (1e-3, 3600.0),
    "lost": (0.0, 1.0),
}
"""Least and greatest value of each number of `Senses`."""


@dataclass(frozen=True)
class Senses:
    """The sensors and delays between a person and the controller.

    Attributes:
        delay: delay from the object's motion to the person's [s].
        hand_time: time constant with which the hand follows, after the delay [s].
        noise_deg: standard deviation of the white noise of every angle of every frame [deg].
        drift_deg: standard deviation of the slow drift of every angle [deg].
        drift_time: time constant of the drift [s].
        lost: share of frames that do not arrive.
        bias_deg: constant error of the angles of some joints, by their names [deg].

    Raises:
        InputError: if a value has the wrong type or is out of range, or a joint is unknown.

    Example:
        >>> from ergoqp.simulation.people.senses import Senses
        >>> senses = Senses(delay=0.2, bias_deg={"right_knee_flexion": 5.0})
        >>> float(senses.bias.max().round(4))
        0.0873
    """

    delay: float = 0.15
    hand_time: float = 0.05
    noise_deg: float = 0.5
    drift_deg: float = 1.0
    drift_time: float = 10.0
    lost: float = 0.01
    bias_deg: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the values and the names of the joints."""
        for name, ends in _ENDS.items():
            check_number(name, getattr(self, name), *ends)
        check_kind(
            "bias_deg", self.bias_deg, Mapping, "a table of joints, each with its error [deg]"
        )
        for name, error in self.bias_deg.items():
            if name not in INDEX:
                raise InputError(
                    f"bias_deg: got {shown(name)}, allowed a joint such as 'right_knee_flexion'"
                )
            check_number(f"bias_deg of {name}", error, -90.0, 90.0, "deg")

    @property
    def bias(self) -> np.ndarray:
        """Constant error of every joint (32,) [rad]."""
        return np.radians([self.bias_deg.get(name, 0.0) for name in JOINTS])


def frames(
    senses: Senses, dt: float, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield, for every period, (measurement error (32,) [rad], whether the frame arrives)."""
    count, bias, noise = len(JOINTS), senses.bias, np.radians(senses.noise_deg)
    keep = np.exp(-dt / senses.drift_time)
    drift = rng.normal(size=count) * np.radians(senses.drift_deg)
    fresh = np.sqrt(1 - keep**2) * np.radians(senses.drift_deg)
    while True:
        drift = keep * drift + fresh * rng.normal(size=count)
        error = bias + drift + rng.normal(size=count) * noise
        yield error, bool(rng.random() >= senses.lost)


def draw_senses(rng: np.random.Generator) -> Senses:
    """Return random senses, with a delay of 0 to 300 ms."""
    return Senses(
        delay=float(rng.uniform(0.0, 0.3)),
        hand_time=float(rng.uniform(0.04, 0.12)),
        noise_deg=2.0,
        drift_deg=1.0,
        lost=0.01,
    )
