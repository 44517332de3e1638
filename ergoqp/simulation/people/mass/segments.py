"""Masses and inertias of a person's segments, by sex.

The numbers are those of P. de Leva (1996), "Adjustments to Zatsiorsky-Seluyanov's segment
inertia parameters", J. Biomechanics 29 (9): masses as shares of the body's mass, and centres
of mass and radii of gyration as shares of the segments' lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import SIDES
from ergoqp.simulation.people.anatomy import Sex


class Segment(NamedTuple):
    """One row of the table.

    Attributes:
        mass: share of the body's mass.
        centre: centre of mass, from the upper end (of a foot: from the heel), as a share of
            the length.
        sagittal: radius of gyration about the axis forward, as a share of the length.
        transverse: the same about the axis to the left.
        longitudinal: the same about the segment's own axis.
    """

    mass: float
    centre: float
    sagittal: float
    transverse: float
    longitudinal: float


SEGMENTS: Final[dict[Sex, dict[str, Segment]]] = {
    "female": {
        "head": Segment(0.0668, 0.5894, 0.330, 0.359, 0.318),
        "upper_trunk": Segment(0.1545, 0.2077, 0.746, 0.502, 0.718),
        "middle_trunk": Segment(0.1465, 0.4512, 0.433, 0.354, 0.415),
        "lower_trunk": Segment(0.1247, 0.4920, 0.433, 0.402, 0.444),
        "upper_arm": Segment(0.0255, 0.5754, 0.278, 0.260, 0.148),
        "forearm": Segment(0.0138, 0.4559, 0.261, 0.257, 0.094),
        "hand": Segment(0.0056, 0.3427, 0.244, 0.208, 0.154),
        "thigh": Segment(0.1478, 0.3612, 0.369, 0.364, 0.162),
        "shank": Segment(0.0481, 0.4352, 0.267, 0.263, 0.092),
        "foot": Segment(0.0129, 0.4014, 0.299, 0.279, 0.139),
    },
    "male": {
        "head": Segment(0.0694, 0.5976, 0.362, 0.376, 0.312),
        "upper_trunk": Segment(0.1596, 0.2999, 0.716, 0.454, 0.659),
        "middle_trunk": Segment(0.1633, 0.4502, 0.482, 0.383, 0.468),
        "lower_trunk": Segment(0.1117, 0.6115, 0.615, 0.551, 0.587),
        "upper_arm": Segment(0.0271, 0.5772, 0.285, 0.269, 0.158),
        "forearm": Segment(0.0162, 0.4574, 0.276, 0.265, 0.121),
        "hand": Segment(0.0061, 0.3624, 0.288, 0.235, 0.184),
        "thigh": Segment(0.1416, 0.4095, 0.329, 0.329, 0.149),
        "shank": Segment(0.0433, 0.4395, 0.251, 0.246, 0.102),
        "foot": Segment(0.0137, 0.4415, 0.257, 0.245, 0.124),
    },
}
"""The rows by sex and segment.

The head includes the neck and is measured from the vertex over the head's own length. The
trunk has three parts. The hand is measured from the wrist over its whole length, the foot from
the heel.
"""

_TRUNK_PARTS: Final[dict[Sex, tuple[float, float, float]]] = {
    "female": (142.5, 205.3, 181.5),
    "male": (170.7, 215.5, 145.7),
}
"""Lengths of the upper, middle and lower trunk in the same sample [mm].

Together they reach from the suprasternal notch, where `Body` has the base of the neck, to the
middle of the hip centres.
"""

_HEEL: Final = 0.20
"""Distance of the heel behind the ankle, as a share of the foot's length, as in the model."""


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre (3,) [m] and principal inertia (3,) about it [kg m^2] of a rigid body."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray


def inertias(body: Body, sex: Sex) -> dict[str, Inertia]:
    """Return the inertia of every body of ``models/person_with_mass.xml``, in its own axes."""
    rows, length = SEGMENTS[sex], body.lengths
    # The shares of the table are rounded, so they are scaled to the whole body.
    sides = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
    whole = body.mass / sum(row.mass * (1 + (name in sides)) for name, row in rows.items())

    def along(name: str, upper: np.ndarray, down: np.ndarray, long: float) -> Inertia:
        row = rows[name]
        radii = np.array([row.sagittal, row.transverse, row.longitudinal])
        if down[0]:  # The longitudinal axis of a foot points forward.
            radii = radii[[2, 1, 0]]
        mass = row.mass * whole
        return Inertia(mass, upper + row.centre * long * down, mass * (radii * long) ** 2)

    below, nothing = np.array([0.0, 0.0, -1.0]), np.zeros(3)
    parts = np.array(_TRUNK_PARTS[sex])
    parts *= length["trunk"] / parts.sum()
    ends = length["trunk"] - np.concatenate([[0.0], np.cumsum(parts)])
    trunk = [
        along(name, np.array([0.0, 0.0, end]), below, long)
        for name, end, long in zip(
            ("upper_trunk", "middle_trunk", "lower_trunk"), ends[:3], parts, strict=True
        )
    ]
    top = np.array([0.0, 0.0, length["neck"] + length["head"]])
    found = {
        "pelvis": trunk[2],
        "trunk": _joined(trunk[0], trunk[1]),
        "head": along("head", top, below, length["head"]),
    }
    heel = np.array([-_HEEL * length["foot_length"], 0.0, -0.55 * length["foot_height"]])
    for side in SIDES:
        for name in ("upper_arm", "forearm", "hand", "thigh", "shank"):
            found[f"{side}_{name}"] = along(name, nothing, below, length[name])
        found[f"{side}_foot"] = along("foot", heel, np.array([1.0, 0, 0]), length["foot_length"])
    return found


def _joined(one: Inertia, other: Inertia) -> Inertia:
    """Return one body that is equivalent to two, one above the other."""
    mass = one.mass + other.mass
    centre = (one.mass * one.centre + other.mass * other.centre) / mass
    inertia = one.inertia + other.inertia
    for part in (one, other):
        away = part.centre - centre
        inertia = inertia + part.mass * (away @ away - away**2)
    return Inertia(mass, centre, inertia)
