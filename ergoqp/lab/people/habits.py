"""Bodies and habits of people at random: proportions, preferred postures, stiffnesses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from ergoqp.human import Body
from ergoqp.human.body import FRACTIONS
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.lab.people.body_tasks import Work

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


def generators(kind: str, problem: str, seed: int) -> Iterator[np.random.Generator]:
    """Yield the generators for body, habits and senses of a person.

    With another body the other properties stay the same. Every kind has its own people.

    Args:
        kind: kind of the person.
        problem: name of the problem.
        seed: seed of the person.
    """
    said = [seed, *kind.encode(), 0, *problem.encode()]
    return (np.random.default_rng([*said, part]) for part in range(3))


_EASE: Final[Mapping[str, tuple[float, float]]] = {
    "trunk_flexion": (3.0, 4.0),
    "trunk_side_bend": (0.0, 2.0),
    "trunk_twist": (0.0, 2.0),
    "neck_flexion": (9.0, 5.0),
    "neck_side_bend": (0.0, 2.0),
    "neck_twist": (0.0, 3.0),
    "shoulder_flexion": (12.0, 8.0),
    "shoulder_abduction": (8.0, 5.0),
    "shoulder_rotation": (4.0, 8.0),
    "elbow_flexion": (75.0, 12.0),
    "forearm_pronation": (12.0, 15.0),
    "wrist_flexion": (-6.0, 6.0),
    "wrist_deviation": (2.0, 4.0),
}
"""Mean and standard deviation of the upper body's angles at ease, with the hands at work [deg]."""

_LEGS: Final[Mapping[str, Mapping[str, tuple[float, float]]]] = {
    "standing": {
        "hip_flexion": (5.0, 0.0),
        "hip_abduction": (3.0, 1.5),
        "knee_flexion": (10.0, 0.0),
        "ankle_flexion": (5.0, 0.0),
    },
    "seated": {"hip_flexion": (84.0, 3.0), "knee_flexion": (84.0, 3.0)},
}
"""The same for the legs."""

_FREE_ARM: Final[Mapping[str, Mapping[str, float]]] = {
    "standing": {"shoulder_flexion": 4.0, "shoulder_abduction": 6.0, "elbow_flexion": 12.0},
    "seated": {"shoulder_flexion": 14.0, "shoulder_abduction": 6.0, "elbow_flexion": 68.0},
}
"""Posture of an arm that holds nothing [deg]: it hangs, or lies on the thigh."""

_SPREAD: Final[Mapping[str, float]] = {
    "trunk_flexion": 11.0,
    "trunk_side_bend": 7.0,
    "trunk_twist": 9.0,
    "neck_flexion": 12.0,
    "neck_side_bend": 8.0,
    "neck_twist": 16.0,
    "shoulder_flexion": 20.0,
    "shoulder_abduction": 13.0,
    "shoulder_rotation": 22.0,
    "elbow_flexion": 30.0,
    "forearm_pronation": 32.0,
    "wrist_flexion": 16.0,
    "wrist_deviation": 10.0,
    "hip_flexion": 20.0,
    "hip_abduction": 9.0,
    "hip_rotation": 9.0,
    "knee_flexion": 18.0,
    "ankle_flexion": 14.0,
    "ankle_inversion": 9.0,
}
"""Deviation from ease at which every joint has the same cost [deg]."""

_OWN_SPREAD: Final = (0.6, 1.7)
"""Range of the factor on it, drawn log-uniformly per person and joint."""


@dataclass(frozen=True)
class Habits:
    """Preferred posture and stiffness of one person.

    Attributes:
        comfort: posture at ease (32,) [rad].
        spread: deviation from it at which every joint has the same cost (32,) [rad].
        relaxation: time constant of coming to rest [s].
        lean: preferred distance of the centre of mass ahead of the middle of the feet [m].
        steadiness: deviation of the centre of mass with the same cost as a joint that moves by
            `spread` [m].
    """

    comfort: np.ndarray
    spread: np.ndarray
    relaxation: float
    lean: float
    steadiness: float


def draw_habits(work: Work, rng: np.random.Generator) -> Habits:
    """Return random habits of a person for a work."""
    low, high = np.log(_OWN_SPREAD)
    factors = np.exp(rng.uniform(low, high, len(_SPREAD)))
    own = dict(zip(_SPREAD, factors, strict=True))
    ease = {name: rng.normal(*numbers) for name, numbers in (_EASE | _LEGS[work.stance]).items()}
    comfort, spread = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
    for joint, number in INDEX.items():
        side = next((each for each in SIDES if joint.startswith(each)), None)
        name = joint if side is None else joint.removeprefix(f"{side}_")
        is_free = side is not None and side not in work.hands and number < 20
        angle = _FREE_ARM[work.stance].get(name, 0.0) if is_free else ease.get(name, 0.0)
        if name == "ankle_inversion":
            angle = ease.get("hip_abduction", 0.0)  # keeps the sole of an abducted leg level
        comfort[number] = np.radians(angle)
        spread[number] = np.radians(_SPREAD[name] * own[name])
    return Habits(
        comfort=np.clip(comfort, LOWER, UPPER),
        spread=spread,
        relaxation=float(rng.uniform(0.5, 1.5)),
        lean=float(rng.uniform(-0.01, 0.03)),
        steadiness=float(rng.uniform(0.02, 0.04)),
    )
