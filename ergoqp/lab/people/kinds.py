"""Kinds of people who weigh their tasks, each with one trait of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.lab.people.habits import BASE, PersonParameters, Work
from ergoqp.lab.people.soft import REACHED, SoftHolding, SoftPerson, Wish
from ergoqp.problem.geometry import pose_error
from ergoqp.rest.person_protocol import SensorModel


class FollowerPerson(SoftPerson):
    """Follows the object at once, with the whole body."""

    kind: ClassVar[str] = "follower"
    manner: ClassVar[str] = "who weighs hands, feet, balance and ease in a way of their own"


draw_follower = FollowerPerson.drawn


SHIFT: Final = 0.03
TURN: Final = float(np.radians(10.0))
"""The arm alone follows as long as the object is within this distance [m] and angle [rad]."""

_SETTLED: Final = 0.005
"""The body stops moving once no joint is faster than this [rad/s]."""


_MISSES: Final = 5
"""Number of steps with a hand off its target after which the body starts to move."""


class DeadZoneHolding(SoftHolding):
    """A person whose trunk and legs stay until the object is far from where they came to rest."""

    def begin(self) -> None:
        """Begin with the body at rest."""
        self._settled_at, self._awake, self._in_vain = self.pose, False, 0
        hands = self.person.work.hands
        arms = [number < 20 and joint.startswith(hands) for number, joint in enumerate(JOINTS)]
        self._arms = np.concatenate([np.zeros(BASE, dtype=bool), arms])

    def mobile(self) -> np.ndarray:
        """Return which entries of the placement may move now (36,) bool."""
        return super().mobile() if self._awake else self._arms

    def advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None = None) -> float:
        """Take one step; the body moves for an object far from where the body came to rest."""
        error = pose_error(self._settled_at, target)
        far = np.linalg.norm(error[:3]) > SHIFT or np.linalg.norm(error[3:]) > TURN
        # If the arm alone does not reach the object in a few steps, the body moves too.
        self._in_vain = self._in_vain + 1 if self._miss > REACHED else 0
        self._awake = bool(self._awake or far or self._in_vain > _MISSES)
        change = super().advance(target, dt, besides)
        if self._awake and change < _SETTLED * dt:
            self._settled_at, self._awake = target, False
        return change


class DeadZonePerson(SoftPerson):
    """Follows the object with the arm, and with the body from time to time."""

    kind: ClassVar[str] = "dead_zone"
    manner: ClassVar[str] = "who follows small changes with the arm alone"
    holding: ClassVar[type[SoftHolding]] = DeadZoneHolding


draw_dead_zone = DeadZonePerson.drawn


EYES: Final = np.array([0.090, 0.0, 0.060])
"""Position of the eyes in the head of a person of 1.75 m, relative to the top of the neck [m]."""

AT_EASE: Final = float(np.radians(15.0))
"""Angle of the eyes at rest below the level of the head [rad] (the normal line of sight)."""

RANGE: Final = np.radians([15.0, 15.0])
"""Turn of the eyes up or down, and sideways, before the head follows [rad]."""

_FIRM: Final = float(np.radians(5.0))
"""Gaze error with the same cost as a joint that moves by its spread [rad]."""


class LookingHolding(SoftHolding):
    """A person who looks at what the hands do."""

    def wishes(self, target: np.ndarray) -> list[Wish]:
        """Return the wishes besides ease, including the wish to see the work."""
        return [*super().wishes(target), self._gaze(target[:3, 3])]

    def _gaze(self, work: np.ndarray) -> Wish:
        """Return the turn of the eyes beyond their range (2,): down, to the left, as a wish."""
        tasks, scale = self.person.tasks, self.person.body.stature / 1.75
        head, moves = tasks.frame("head"), tasks.jacobian("head")
        turn, offset = head[:3, :3], head[:3, :3] @ EYES * scale
        seen = turn.T @ (work - head[:3, 3] - offset)
        x, y, z = seen
        level, far = math.hypot(x, y), float(seen @ seen)
        asked = np.array([math.atan2(-z, level) - AT_EASE, math.atan2(y, x)])
        beyond = asked - np.clip(asked, -RANGE, RANGE)
        slopes = np.array(
            [[z * x / level, z * y / level, -level], [-y * far / level**2, x * far / level**2, 0.0]]
        )
        # Motion of the work in the frame of the head when the head moves with the eyes.
        turns, shifts = turn.T @ moves[3:], turn.T @ (moves[:3] - _cross(offset) @ moves[3:])
        helps = slopes / -far @ (_cross(seen) @ turns - shifts)
        helps[beyond == 0] = 0.0
        return beyond / _FIRM, helps / _FIRM


def _cross(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class LookingPerson(SoftPerson):
    """Follows the object and keeps the eyes on the work."""

    kind: ClassVar[str] = "looking"
    manner: ClassVar[str] = "who keeps the eyes on the work"
    holding: ClassVar[type[SoftHolding]] = LookingHolding


draw_looking = LookingPerson.drawn


EVERY: Final = (3.0, 7.0)
"""Least and longest time between two pushes [s]."""

LASTS: Final = 0.4
"""Duration of a push [s]."""

AWAY: Final = (0.04, 0.08)
"""Distance by which a push moves the base of the neck, parallel to the floor [m]."""

_FIRMLY: Final = 0.01
"""Deviation with the same cost as a joint that moves by its spread [m]. A push is firm."""


class PushedHolding(SoftHolding):
    """A person who is pushed at the shoulders from time to time."""

    def begin(self) -> None:
        """Plan the first push."""
        self._pushes = 0
        self._plan(0.0)

    def disturbance(self) -> list[Wish]:
        """Return the target of a push for the base of the neck, as a wish."""
        if self.time < self._next:
            return []
        tasks = self.person.tasks
        tasks.place(self.placement)
        have, moves = tasks.frame("trunk")[:2, 3], tasks.jacobian("trunk")[:2]
        begin = self._from = have.copy() if self._from is None else self._from
        gone = (self.time - self._next) / LASTS
        if gone >= 1.0:
            self._plan(self.time)
            return []
        return [((begin + gone * self._way - have) / _FIRMLY, moves / _FIRMLY)]

    def _plan(self, now: float) -> None:
        """Draw the next push. It depends on the seed only, not on the controller."""
        rng = np.random.default_rng([self.seed, 31, self._pushes])
        heading, self._pushes = rng.uniform(0, 2 * np.pi), self._pushes + 1
        self._next = now + float(rng.uniform(*EVERY))
        self._way = float(rng.uniform(*AWAY)) * np.array([np.cos(heading), np.sin(heading)])
        self._from: np.ndarray | None = None


class PushedPerson(SoftPerson):
    """Follows the object between pushes."""

    kind: ClassVar[str] = "pushed"
    manner: ClassVar[str] = "who is pushed every few seconds"
    holding: ClassVar[type[SoftHolding]] = PushedHolding


draw_pushed = PushedPerson.drawn


STEP: Final = 0.20
"""Distance of the object from its place at ease beyond which the person steps after it [m]."""

FARTHEST: Final = 0.60
"""Largest distance of the person from where they began [m], because the robot is there."""

_SWING: Final = 0.5
"""Time in which one foot is moved [s]; then the other."""

_LIFT: Final = 0.05
"""Height to which a foot is lifted [m]."""

_HESITATES: Final = 0.4
"""Time for which the object is away before the person steps [s]."""

_PART: Final = 0.1
"""Longest time step in which a foot moves [s]."""

_LONGEST_WAY: Final = 100
"""Number of such steps after which every foot has arrived."""

_LEANS: Final = {"trunk_flexion": 1.6, "trunk_side_bend": 1.6, "knee_flexion": 0.6}
"""Factors on the spread of joints: the trunk leans before the knees bend."""


class SteppingHolding(SoftHolding):
    """A person whose feet follow the object."""

    def begin(self) -> None:
        """Begin with both feet on the floor. The place at ease is relative to them."""
        person = self.person
        self._at_ease = SoftHolding(person, person.comfort, self.senses).pose[:2, 3]
        self.feet = np.zeros(2)
        self._home = [sole.copy() for sole in self.soles]
        self._seat = self.placement[:2].copy()
        self._away, self._swing, self._way = 0.0, np.inf, np.zeros(2)
        person.tasks.place(self.placement)

    def advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None = None) -> float:
        """Take one step of time. The feet follow an object that is away for long."""
        while dt > _PART and np.isfinite(self._swing):
            # A foot moves in parts, however long a step of time is.
            self._advance(target, _PART, besides)
            dt -= _PART
        return self._advance(target, dt, besides)

    def _advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None) -> float:
        if np.isfinite(self._swing):
            self._put_feet(dt)
        else:
            away = target[:2, 3] - self._at_ease - self.feet
            distance = float(np.linalg.norm(away))
            self._away = self._away + dt if distance > STEP else 0.0
            way = away * (STEP / max(distance, STEP))
            if self._away > _HESITATES and np.linalg.norm(self.feet + way) <= FARTHEST:
                self._way, self._swing, self._away = way, 0.0, 0.0
        return super().advance(target, dt, besides)

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest, with the feet first."""
        self._arrive(pose)
        for _ in range(_LONGEST_WAY):
            self.advance(pose, _PART)
            if np.isinf(self._swing) and self._away == 0.0:
                break
        return super().rest(pose)

    def _put_feet(self, dt: float) -> None:
        """Move one foot, then the other. A stool rolls with both."""
        self._swing += dt
        gone = [np.clip(self._swing / _SWING - number, 0.0, 1.0) for number in range(2)]
        if self._swing >= 2 * _SWING:
            self.feet, self._way, self._swing = self.feet + self._way, np.zeros(2), np.inf
        smooth = [share * share * (3 - 2 * share) for share in gone]
        if self.person.is_seated:
            # Copies share this array, so make a new one.
            placement = self.placement.copy()
            placement[:2] = self._seat + self.feet + np.mean(smooth) * self._way
            self.placement = placement
            return
        self.soles = [sole.copy() for sole in self._home]
        for sole, share, part in zip(self.soles, smooth, gone, strict=True):
            sole[:2, 3] += self.feet + share * self._way
            sole[2, 3] += _LIFT * np.sin(np.pi * part)


class SteppingPerson(SoftPerson):
    """Follows the object with the feet too."""

    kind: ClassVar[str] = "stepping"
    manner: ClassVar[str] = "who leans toward the object and steps after it"
    holding: ClassVar[type[SoftHolding]] = SteppingHolding

    @classmethod
    def habits_of(
        cls, habits: PersonParameters, work: Work, rng: np.random.Generator
    ) -> PersonParameters:
        """Return the habits of these people: they lean."""
        spread = habits.spread.copy()
        for joint, number in INDEX.items():
            spread[number] *= next((by for name, by in _LEANS.items() if joint.endswith(name)), 1.0)
        return replace(habits, spread=spread)

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        if self.is_seated:
            return f"the pelvis stays on a stool that rolls, {self.seat:.2f} m high"
        return f"the soles step after an object more than {100 * STEP:.0f} cm away"


draw_stepping = SteppingPerson.drawn


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

_FIRM_POSTURE: Final = 0.5
"""Factor on the spread of the joints of a favourite posture."""


class StubbornPerson(SoftPerson):
    """Follows the object and keeps as much as possible of a favourite posture."""

    kind: ClassVar[str] = "stubborn"
    manner: ClassVar[str] = "who keeps what they can of a favourite posture"

    @classmethod
    def habits_of(
        cls, habits: PersonParameters, work: Work, rng: np.random.Generator
    ) -> PersonParameters:
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
                spread[INDEX[joint]] *= _FIRM_POSTURE
        return replace(habits, comfort=np.clip(comfort, LOWER, UPPER), spread=spread)


draw_stubborn = StubbornPerson.drawn


TREMOR: Final = (float(np.radians(0.3)), float(np.radians(1.2)))
"""Least and largest amplitude of a joint's tremor [rad]."""

FREQUENCY: Final = (4.0, 8.0)
"""Least and largest frequency of a tremor [Hz]."""

BIAS_DEG: Final = (4.0, 8.0)
"""Standard deviation and largest value of the constant error of each joint's angle [deg]."""

LOST: Final = 0.05
"""Share of frames that do not arrive."""


class TremblingHolding(SoftHolding):
    """A person whose arms shake while they work. At rest, for the judgement, they do not shake."""

    def begin(self) -> None:
        """Draw the tremor."""
        rng = np.random.default_rng([self.seed, 32])
        arms = np.array([joint.startswith(("right", "left")) for joint in JOINTS[:20]])
        self._amplitude = np.append(rng.uniform(*TREMOR, 20) * arms, np.zeros(12))
        self._frequency, self._phase = rng.uniform(*FREQUENCY, 32), rng.uniform(0, 2 * np.pi, 32)
        self._shakes = False

    @property
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""
        steady = self.placement[BASE:]
        if not self._shakes:
            return steady.copy()
        turns = 2 * np.pi * self._frequency * self.time + self._phase
        return steady + self._amplitude * np.sin(turns)

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow the object with a tremor."""
        self._shakes = True
        super().follow(pose, dt)

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest without a tremor."""
        self._shakes = False
        return super().rest(pose)


class TremblingPerson(SoftPerson):
    """Follows the object with a tremor, and is measured badly."""

    kind: ClassVar[str] = "trembling"
    manner: ClassVar[str] = "whose arms shake, and whose angles read wrong"
    holding: ClassVar[type[SoftHolding]] = TremblingHolding

    @classmethod
    def senses_of(cls, senses: SensorModel, rng: np.random.Generator) -> SensorModel:
        """Return the senses of these people: constant errors of all joints, and lost frames."""
        sd, most = BIAS_DEG
        bias = np.round(np.clip(rng.normal(0.0, sd, len(JOINTS)), -most, most), 1)
        return replace(senses, lost=LOST, bias_deg=dict(zip(JOINTS, bias.tolist(), strict=True)))


draw_trembling = TremblingPerson.drawn
