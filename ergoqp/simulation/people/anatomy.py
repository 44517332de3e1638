"""Bodies of people at random: both sexes, with varied statures and proportions."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from ergoqp.human import Body
from ergoqp.human.body import FRACTIONS

Sex = Literal["female", "male"]

STATURES: Final = (1.50, 1.95)
"""Least and greatest drawn stature [m]."""

_POPULATION: Final[dict[Sex, tuple[float, float]]] = {
    "female": (1.63, 0.065),
    "male": (1.76, 0.070),
}
"""Mean and standard deviation of statures [m], similar to anthropometric surveys of adults."""

_BUILD: Final = (20.0, 30.0)
"""Least and greatest mass per squared stature [kg/m^2]."""

_PROPORTIONS: Final = 0.03
"""Standard deviation of the length of a segment, as a share of it."""

_WIDTHS: Final[dict[Sex, dict[str, float]]] = {
    "female": {"shoulder_width": 0.95, "hip_width": 1.06},
    "male": {"shoulder_width": 1.03, "hip_width": 0.98},
}
"""Widths of each sex relative to the mean of both."""


def draw_body(rng: np.random.Generator) -> tuple[Sex, Body]:
    """Return sex and body, with a stature within `STATURES` and drawn build and proportions."""
    sex: Sex = "male" if rng.integers(2) else "female"
    stature = float(np.clip(rng.normal(*_POPULATION[sex]), *STATURES))
    mass = float(rng.uniform(*_BUILD)) * stature**2
    lengths = {}
    for name, fraction in FRACTIONS.items():
        usual = fraction * stature * _WIDTHS[sex].get(name, 1.0)
        lengths[name] = usual * float(np.clip(rng.normal(1.0, _PROPORTIONS), 0.9, 1.1))
    return sex, Body(stature, lengths, mass)
