"""The unknown traits of a person: habits, lengths and a bias of the sensors, with their priors.

The priors are those of people in general, not of a data set. Standard deviations: a factor e for
the weight of a joint, 15 deg for a favourite angle, 6 % for stature, 4 % for a segment in addition,
2 deg for the bias of a joint angle. (The within-sex spread of stature is 4 %; the fractions of
Drillis and Contini vary by 3 to 5 %.)
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
"""Standard deviation of the logarithm of a joint's weight."""
COMFORT_SD: Final = float(np.radians(15.0))
"""Standard deviation of a favourite angle [rad]."""
BIAS_SD: Final = float(np.radians(2.0))
"""Standard deviation of the bias of a sensor [rad]."""
SEAT_SD: Final = 0.03
"""Standard deviation of the height of the hip centres when seated [m]."""

LENGTHS: Final[dict[str, tuple[tuple[str, ...], float]]] = {
    "stature": (("stature",), 0.06),
    "trunk": (("trunk", "shoulder_height"), 0.04),
    "shoulder_width": (("shoulder_width",), 0.05),
    "upper_arm": (("upper_arm",), 0.04),
    "forearm": (("forearm", "hand"), 0.04),
    "legs": (("thigh", "shank"), 0.04),
}
"""Unknown lengths: the segments that grow together, and the standard deviation of their share."""


@dataclass(frozen=True)
class Layout:
    """Positions of the traits in one vector; all are zero for the problem's own person.

    Attributes:
        response: the person of the problem.
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
        """Standard deviation of each trait."""
        n = len(self.joints)
        seat = [SEAT_SD] * (self.response.stance == "seated")
        lengths = [sd for _, sd in LENGTHS.values()]
        return np.array([*[WEIGHT_SD] * n, *[COMFORT_SD] * n, *lengths, *seat, *[BIAS_SD] * n])

    @cached_property
    def growth(self) -> np.ndarray:
        """Map (14, k) from the shares of the lengths to the growth of a body."""
        grown = np.zeros((len(GROWTH), len(LENGTHS)))
        for number, (together, _) in enumerate(LENGTHS.values()):
            for name in together:
                grown[GROWTH.index(name), number] = 1.0
        return grown
