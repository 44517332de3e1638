"""`stubborn`: has a favourite posture and keeps as much of it as possible."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import Habits
from ergoqp.simulation.people.soft_person import SoftPerson

_FAVOURITES: Final[tuple[Mapping[str, tuple[float, float]], ...]] = (
    # Slouches over the work.
    {"trunk_flexion": (22.0, 6.0), "neck_flexion": (24.0, 6.0), "elbow_flexion": (95.0, 12.0)},
    # Works with the elbows up.
    {"shoulder_abduction": (32.0, 8.0), "shoulder_flexion": (30.0, 8.0), "elbow_flexion": (95, 10)},
    # Stands askew.
    {"trunk_side_bend": (11.0, 3.0), "trunk_twist": (12.0, 4.0), "neck_side_bend": (-9.0, 3.0)},
    # Keeps the work at arm's length.
    {"shoulder_flexion": (42.0, 8.0), "elbow_flexion": (35.0, 10.0), "trunk_flexion": (8.0, 4.0)},
    # Bends the wrist and peers.
    {"wrist_flexion": (-24.0, 6.0), "wrist_deviation": (11.0, 4.0), "neck_flexion": (28.0, 6.0)},
)
"""Favourite postures: mean and standard deviation of the joints in which they differ [deg]."""

_FIRM: Final = 0.5
"""Factor on the spread of the joints of a favourite posture."""


class StubbornPerson(SoftPerson):
    """Follows the object and keeps as much as possible of a favourite posture."""

    kind: ClassVar[str] = "stubborn"
    manner: ClassVar[str] = "who keeps what they can of a favourite posture"

    @classmethod
    def habits_of(cls, habits: Habits, work: Work, rng: np.random.Generator) -> Habits:
        """Return the habits of these people, with a favourite posture."""
        comfort, spread = habits.comfort.copy(), habits.spread.copy()
        favourite = _FAVOURITES[rng.integers(len(_FAVOURITES))]
        mirrored = (-1.0, 1.0)[rng.integers(2)]
        for name, numbers in favourite.items():
            angle = np.radians(rng.normal(*numbers))
            central = name.startswith(("trunk", "neck"))
            joints = [name] if central else [f"{side}_{name}" for side in work.hands]
            for joint in joints:
                sideways = central and not name.endswith("_flexion")
                comfort[INDEX[joint]] = mirrored * angle if sideways else angle
                spread[INDEX[joint]] *= _FIRM
        return replace(habits, comfort=np.clip(comfort, LOWER, UPPER), spread=spread)


draw = StubbornPerson.drawn
