"""What is unknown of a person: habits, lengths and a bias of the sensors, each with what is likely.

The scales are those of people, not of a data set: a joint may be dear to one person and cheap to
another by a factor e, a favourite angle 15 deg off the problem's, a stature 6 % and a segment
beside it 4 % off the model's (within-sex spread of stature is 4 %, Drillis and Contini's fractions
vary by 3 to 5 %), a joint angle read 2 deg off.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ergoqp.human.growth import GROWTH
from ergoqp.joints import INDEX
from ergoqp.responses.ik import IkResponse

WEIGHT_SD: Final = 1.0
"""Of the logarithm of a joint's weight."""
COMFORT_SD: Final = float(np.radians(15.0))
"""Of a favourite angle [rad]."""
BIAS_SD: Final = float(np.radians(2.0))
"""Of what a sensor reads too much [rad]."""
SEAT_SD: Final = 0.03
"""Of the height of the hip centres of who sits [m]."""

LENGTHS: Final[dict[str, tuple[tuple[str, ...], float]]] = {
    "stature": (("stature",), 0.06),
    "trunk": (("trunk", "shoulder_height"), 0.04),
    "shoulder_width": (("shoulder_width",), 0.05),
    "upper_arm": (("upper_arm",), 0.04),
    "forearm": (("forearm", "hand"), 0.04),
    "legs": (("thigh", "shank"), 0.04),
}
"""Lengths that are unknown: what grows together, and by which share of it people differ."""


@dataclass(frozen=True)
class Layout:
    """Where the traits of a person are in one vector; all are zero for the problem's own person.

    Attributes:
        response: the problem's person.
    """

    response: IkResponse

    @cached_property
    def joints(self) -> list[int]:
        """Numbers of the joints that follow by themselves."""
        return [INDEX[joint] for joint in self.response.chain]

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Slices of weights (log), comfort [rad], lengths (shares), seat [m] and bias [rad]."""
        n, found, end = len(self.joints), {}, 0
        seats = int(self.response.stance == "seated")
        sizes = {"weights": n, "comfort": n, "lengths": len(LENGTHS), "seat": seats, "bias": n}
        for name, size in sizes.items():
            found[name] = slice(end, end + size)
            end += size
        return found

    @cached_property
    def sd(self) -> np.ndarray:
        """How far a trait is likely to be from zero."""
        n = len(self.joints)
        seat = [SEAT_SD] * (self.response.stance == "seated")
        lengths = [sd for _, sd in LENGTHS.values()]
        return np.array([*[WEIGHT_SD] * n, *[COMFORT_SD] * n, *lengths, *seat, *[BIAS_SD] * n])

    @cached_property
    def growth(self) -> np.ndarray:
        """How the lengths' shares make the growth of a body (14, k)."""
        grown = np.zeros((len(GROWTH), len(LENGTHS)))
        for number, (together, _) in enumerate(LENGTHS.values()):
            for name in together:
                grown[GROWTH.index(name), number] = 1.0
        return grown
