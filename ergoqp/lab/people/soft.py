"""People who weigh all tasks against each other, and how they follow: overdamped, toward a balance.

How a person with soft tasks follows: overdamped, toward the balance of all tasks. The person
minimises 1/2 |q - comfort|^2 over spreads, with stiff springs that keep the hands at their grips,
the soles in place and the centre of mass over them. The motion is that of an overdamped body, M
dq/dt = pulls, by implicit Euler steps. Stiff wishes are met at once, and ease is reached within the
relaxation time. The pulls are not exactly the gradient of an energy: neck and arms move the centre
of mass but are not moved for its sake, and a hanging arm follows the trunk in one direction. So
there may be more than one rest, and which one is reached depends on the path. `benchmarks.people`
counts where.
"""

from __future__ import annotations

import math
from collections import deque
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.lab.people.habits import (
    BASE,
    BodyTasks,
    PersonParameters,
    Work,
    draw_body,
    draw_habits,
    generators,
)
from ergoqp.problem.geometry import LONGEST_SHIFT, LONGEST_TURN, between, straight
from ergoqp.problem.problem import Problem
from ergoqp.rest.person_protocol import Holding, Person, SensorModel, draw_senses

SOLES = tuple(f"{side}_sole" for side in SIDES)

SOLE = np.repeat([3e-4, 3e-3], 3)
"""Displacement of a sole with the same cost as a joint that moves by its spread [m], [rad]."""

_PELVIS = np.full(BASE, 0.25)
"""Displacement of the pelvis with the same cost as a joint that moves by its spread [m], [rad]."""


_STANDS = 40
"""Number of steps in which the legs put the soles flat on the floor."""


def _flat(sole: np.ndarray) -> np.ndarray:
    """Return the frame (4, 4) of a sole, levelled and moved to the floor."""
    flat, yaw = np.eye(4), math.atan2(sole[1, 0], sole[0, 0])
    flat[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    flat[:2, 3] = sole[:2, 3]
    return flat


PERIOD = 0.02
"""Duration of one posture [s]: people are seen at 50 Hz."""

GRIP = np.repeat([1.5e-3, 0.03], 3)
"""Displacement of a grip with the same cost as a joint that moves by its spread [m], [rad]."""

STRONGEST = 0.05
"""The pull of a hand does not grow beyond this distance of the object from the grip [m]."""

RESTLESS = 0.01
"""A person whose joints still move faster than this does not come to rest [rad/s]."""

REACHED, REACHED_ANGLE = 0.01, 0.15
"""The object is reached if the grips are this close [m], and their axes within this angle [rad]."""

STILL = 2e-4
"""A person whose joints move less than this in a second is at rest [rad]."""

CARRIED = 0.3
"""Time for each part of a straight path [s]."""

_PACE = (0.01, 4.0)
"""Shortest and longest time step toward rest [s]. Near the end of its reach an arm overshoots."""

_STEPS = 150
_WAITS = 10
_LARGEST = 0.2
"""Largest step of a joint or of the pelvis [rad], [m]. Beyond it, all entries are scaled down."""

_FASTEST = 2.5
"""Largest speed of any entry [rad/s], [m/s]. Beyond it, arcs are not straight and soles drag.

An object at 0.2 m/s needs about 1 rad/s of an arm.
"""

_LEVER = 0.5
"""Length of a limb [m]: how fast the slope of a hand's path turns with its joints."""

_BESIDE = (0.0, 0.04)
"""How far the support of a foot reaches ahead of its toe and beside its middle [m]."""

_HANGS = 0.9
"""Share of the trunk's flexion that a hanging arm compensates, so that it stays vertical."""

Wish = tuple[np.ndarray, np.ndarray]
"""Error of a task (n,) and its Jacobian (n, 36), both divided by the allowed deviation."""


class SoftHolding(Holding["SoftPerson"]):
    """The state of a person with soft tasks who holds the object.

    Args:
        person: the person.
        posture: posture in which they hold the object (32,) [rad].
        senses: the delay of the person.
        seed: seed of what they do at random.
    """

    def __init__(
        self, person: SoftPerson, posture: np.ndarray, senses: SensorModel, seed: int = 0
    ) -> None:
        """Hold the object as in the posture."""
        self.person, self.senses, self.seed = person, senses, seed
        self.placement, self.soles = person.placed(posture)
        tasks = person.tasks
        grips = [tasks.frame(f"{hand}_grip") for hand in person.work.hands]
        self.pose = person.work.contact(grips)
        self._grasp = [np.linalg.solve(self.pose, grip) for grip in grips]
        self._followed, self._late = self.pose, deque[np.ndarray]()
        self._miss, self._angle, self.time, self._since = 0.0, 0.0, 0.0, 0.0
        self.begin()

    def begin(self) -> None:
        """Prepare what people of the kind keep besides."""

    @property
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""
        return self.placement[BASE:].copy()

    @property
    def base(self) -> np.ndarray:
        """Pelvis in the world, upright (4, 4) [m]."""
        pose, yaw = np.eye(4), self.placement[3]
        pose[:3, 3] = self.placement[:3]
        pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        return pose

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow the object with the person's delay."""
        if not self._late:
            self._late.extend([self.pose] * round(self.senses.delay / dt))
        self.pose = pose
        self._late.append(pose)
        late = self._late.popleft()
        self.time += dt
        self._since += dt
        if self._since < PERIOD - 1e-9:
            return
        share = 1.0 - float(np.exp(-self._since / self.senses.hand_time))
        self._followed = between(self._followed, late, share)
        self.advance(self._followed, self._since, self.disturbance())
        self._since = 0.0
        # Distance of the hands from the object itself, which includes the delay.
        pairs = zip(self._hands, self._grasp, strict=True)
        self.gap = max(math.dist(hand, (pose @ grasp)[:3, 3]) for hand, grasp in pairs)

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest, without disturbances, with the object at `pose` (4, 4) [m]."""
        self._arrive(pose)
        pace, speed = 0.1, np.inf
        for number in range(_STEPS):
            before, speed = speed, self.advance(pose, pace) / pace
            if speed < STILL or (number > _STEPS / 3 and self._miss > 3 * REACHED):
                break
            pace *= 0.4 if speed > before else 1.5
            pace = min(max(pace, _PACE[0]), _PACE[1])
        # The errors are those before a step, so take one more step of zero length.
        self.advance(pose, 1e-9)
        self.gap = self._miss
        holds = self.gap < REACHED and self._angle < REACHED_ANGLE
        return holds and speed < RESTLESS and not self.unbalanced

    def carry(self, pose: np.ndarray) -> bool:
        """Follow the object straight to `pose` (4, 4), undisturbed, and come to rest there."""
        kept = [self.copy()]
        for part in straight(self.pose, pose):
            self._arrive(part)
            self.advance(part, CARRIED)
            # The errors are those before the step: the rest of the previous part, plus one
            # part.
            lags = (
                self._miss > LONGEST_SHIFT + REACHED or self._angle > LONGEST_TURN + REACHED_ANGLE
            )
            if (lags or self.unbalanced) and not self._waited_for(part):
                break
            kept.append(self.copy())
        else:
            if self.rest(pose):
                return True
        # Go back, in longer and longer strides, to where the person comes to rest and holds
        # the object.
        back = 1
        while True:
            vars(self).update(vars(kept[max(len(kept) - back, 0)].copy()))
            if self.rest(self.pose) or back >= len(kept):
                return False
            back *= 2

    def _waited_for(self, pose: np.ndarray) -> bool:
        """Wait with the object at `pose`, and return whether the hands arrive in balance."""
        for _ in range(_WAITS):
            self.advance(pose, CARRIED)
            if self._miss < REACHED and self._angle < REACHED_ANGLE and not self.unbalanced:
                return True
        return False

    def wishes(self, target: np.ndarray) -> list[Wish]:
        """Return the wishes of the person besides ease, at the present placement of `tasks`.

        Args:
            target: pose of the object that the hands follow (4, 4) [m].
        """
        person, tasks = self.person, self.person.tasks
        wishes, self._miss, self._angle, self._hands = [], 0.0, 0.0, []
        for hand, grasp in zip(person.grips, self._grasp, strict=True):
            error, moves = tasks.toward(hand, target @ grasp)
            self._hands.append(tasks.point(hand))
            if person.work.free_about_tool:
                axis = target[:3, 0]
                error[3:] -= axis * (axis @ error[3:])
                moves[3:] -= np.outer(axis, axis @ moves[3:])
            miss = math.hypot(*error[:3].tolist())
            self._miss = max(self._miss, miss)
            self._angle = max(self._angle, math.hypot(*error[3:].tolist()))
            if miss > STRONGEST:
                error[:3] *= STRONGEST / miss
            wishes.append((error / GRIP, moves / GRIP[:, None]))
        if not person.is_seated:
            for name, sole in zip(SOLES, self.soles, strict=True):
                error, moves = tasks.toward(name, sole)
                self.slid = max(self.slid, math.hypot(*error[:3].tolist()))
                wishes.append((error / SOLE, moves / SOLE[:, None]))
            wishes.append(self._balance())
        return wishes

    def disturbance(self) -> list[Wish]:
        """Return further wishes while the person follows, not at rest."""
        return []

    def mobile(self) -> np.ndarray:
        """Return which entries of the placement may move now (36,) bool; do not change it."""
        return self.person.mobile

    def advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None = None) -> float:
        """Take one implicit Euler step of `dt` [s] toward ease with the object at `target`.

        Returns:
            The largest change of a joint [rad] or of the pelvis [m].
        """
        person, placement = self.person, self.placement
        person.tasks.place(placement)
        wishes = [*self.wishes(target), *(besides or [])]
        error = np.concatenate([wish[0] for wish in wishes])
        moves = np.concatenate([wish[1] for wish in wishes])
        pull = error @ moves
        pull[BASE:] += (self._ease() - placement[BASE:]) * person.stiffness[BASE:]
        hessian = moves.T @ moves
        # The diagonal contains ease, and the damping M / dt.
        diagonal = person.stiffness + person.damping / dt
        # A pull that cannot be satisfied adds curvature. Without it a stretched arm or leg
        # oscillates across the end of its reach.
        missed = min(self._miss, STRONGEST) - REACHED
        if missed > 0:
            diagonal = diagonal + missed * _LEVER / GRIP[0] ** 2
        hessian.flat[:: len(pull) + 1] += diagonal
        step = person.tasks.step_within(placement, hessian, pull, self.mobile())
        largest, most = float(np.abs(step).max()), min(_LARGEST, _FASTEST * dt)
        if largest > most:
            step *= most / largest
        self.placement = placement + step
        return min(largest, most)

    def _ease(self) -> np.ndarray:
        """Return the posture at ease now (32,). An arm that holds nothing hangs down."""
        person = self.person
        if not person.hanging:
            return person.comfort
        ease = person.comfort.copy()
        ease[person.hanging] += _HANGS * self.placement[BASE + INDEX["trunk_flexion"]]
        return ease

    def _balance(self) -> Wish:
        tasks, habits = self.person.tasks, self.person.habits
        centre, moves = tasks.mass_centre()
        # Plain floats are faster for eight numbers, and this runs at every step.
        a, b, c, d = ([x - centre[0], y - centre[1]] for x, y, _ in tasks.feet())
        x, y = b[0] + d[0] - a[0] - c[0], b[1] + d[1] - a[1] - c[1]
        length = math.hypot(x, y)
        x, y = x / length, y / length
        ahead = [x * foot[0] + y * foot[1] for foot in (a, b, c, d)]
        beside = [x * foot[1] - y * foot[0] for foot in (a, b, c, d)]
        self.unbalanced = (
            max(min(ahead), -max(ahead)) > _BESIDE[0] or max(min(beside), -max(beside)) > _BESIDE[1]
        )
        middle = [(a[axis] + b[axis] + c[axis] + d[axis]) / 4 for axis in (0, 1)]
        error = np.array([habits.lean * x + middle[0], habits.lean * y + middle[1]])
        return error / habits.steadiness, moves / habits.steadiness

    def _arrive(self, pose: np.ndarray) -> None:
        """Set the object to be at `pose` now, without any delay."""
        self.pose = self._followed = pose
        self._late.clear()


class SoftPerson(Person):
    """A person simulated by whole-body inverse kinematics with soft tasks.

    Hands, feet, balance and preferred posture are weighed against each other. To make a kind of
    your own, change `habits_of`, `senses_of` or `holding`.

    Args:
        body: lengths and mass.
        work: how the person works on the object.
        habits: preferred posture and stiffness.
        senses: sensors between the person and the controller.

    Attributes:
        tasks: kinematics of the body at a placement.
        grips: names of the sites that hold the object.
        stiffness: stiffness toward ease, per entry of the placement (36,).
        damping: stiffness times the relaxation time [s].
        mobile: entries that may move (36,) bool.
        hanging: numbers of the joints of a hanging arm.

    Example:
        >>> import ergoqp
        >>> from dataclasses import replace
        >>> from ergoqp.lab.people.soft import SoftPerson
        >>> class Slow(SoftPerson):
        ...     kind = "slow"
        ...     manner = "who follows late"
        ...
        ...     @classmethod
        ...     def senses_of(cls, senses, rng):
        ...         return replace(senses, delay=0.4)
        >>> Slow.drawn(ergoqp.load_problem("screwing"), seed=0).senses.delay
        0.4
    """

    holding: ClassVar[type[SoftHolding]] = SoftHolding
    """Class of the state of people of this kind."""

    def __init__(
        self, body: Body, work: Work, habits: PersonParameters, senses: SensorModel
    ) -> None:
        """Store the parts, and compute stiffness and damping."""
        self._body, self.work, self.habits, self._senses = body, work, habits, senses
        self.tasks = BodyTasks(body)
        self.grips = [f"{hand}_grip" for hand in work.hands]
        # 1/2 |q - comfort|^2 over spreads. The pelvis has no preferred place, only damping.
        self.stiffness = np.concatenate([np.zeros(BASE), habits.spread**-2])
        self.damping = habits.relaxation * np.concatenate([_PELVIS**-2, habits.spread**-2])
        self.mobile = np.ones(BASE + len(JOINTS), dtype=bool)
        free_arms = set(SIDES) - set(work.hands)
        self.hanging = [INDEX[f"{side}_shoulder_flexion"] for side in sorted(free_arms)]
        if self.is_seated:
            self.mobile[:BASE] = self.mobile[BASE + 20 :] = False
            self.hanging = []

    @property
    def body(self) -> Body:
        """Body of the person."""
        return self._body

    @property
    def comfort(self) -> np.ndarray:
        """Posture of the person with nothing to reach for (32,) [rad]."""
        return self.habits.comfort

    @property
    def senses(self) -> SensorModel:
        """Sensors between the person and the controller."""
        return self._senses

    @property
    def is_seated(self) -> bool:
        """Whether the person sits."""
        return self.work.stance == "seated"

    @cached_property
    def seat(self) -> float:
        """Height of the hip centres when seated [m]: the problem's, or else that of the legs."""
        return self._seat_for(self.comfort)

    def _seat_for(self, posture: np.ndarray) -> float:
        given = self.work.seat_height
        return self.tasks.leg_height(posture) if given is None else given

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        if self.is_seated:
            return f"the pelvis stays on its seat, {self.seat:.2f} m high"
        return "the soles stay where they stand"

    def placed(self, posture: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the placement (36,) of a posture (32,), and the soles (4, 4) each.

        When standing, the soles are flat on the floor. If those of the posture are not, the
        legs change as little as possible. When seated, the seat has the height of the problem,
        or the height that the legs need.
        """
        tasks = self.tasks
        if self.is_seated:
            placement = tasks.seated(posture, self._seat_for(posture))
            return placement, [tasks.frame(name) for name in SOLES]
        placement = tasks.standing(posture)
        soles = [_flat(tasks.frame(name)) for name in SOLES]
        legs = np.ones(BASE + len(JOINTS), dtype=bool)
        legs[BASE : BASE + 20] = False
        wanted = placement.copy()
        for _ in range(_STANDS):
            tasks.place(placement)
            hessian, pull = np.diag(self.stiffness), self.stiffness * (wanted - placement)
            hessian[range(BASE), range(BASE)] += 1.0
            for name, sole in zip(SOLES, soles, strict=True):
                error, moves = tasks.toward(name, sole)
                moves /= SOLE[:, None]
                hessian += moves.T @ moves
                pull += (error / SOLE) @ moves
            step = tasks.step_within(placement, hessian, pull, legs)
            placement = placement + step * min(1.0, 0.2 / max(1e-12, float(np.abs(step).max())))
        tasks.place(placement)
        return placement, soles

    @classmethod
    def drawn(cls, problem: Problem, seed: int, body: Body | None = None) -> Self:
        """Return a person of the kind for a problem. The same seed gives the same person.

        Body, habits and senses are drawn independently. With another body the others stay the
        same.

        Args:
            problem: the task, of which hands, tool, stance and seat are used.
            seed: seed of the person.
            body: their body; None: it is drawn.
        """
        bodies, habits, senses = generators(cls.kind, problem.name, seed)
        work = Work.of(problem)
        return cls(
            body or draw_body(bodies)[1],
            work,
            cls.habits_of(draw_habits(work, habits), work, habits),
            cls.senses_of(draw_senses(senses), senses),
        )

    @classmethod
    def habits_of(
        cls, habits: PersonParameters, work: Work, rng: np.random.Generator
    ) -> PersonParameters:
        """Return the habits of people of this kind, from habits drawn as for everybody."""
        return habits

    @classmethod
    def senses_of(cls, senses: SensorModel, rng: np.random.Generator) -> SensorModel:
        """Return the senses of people of this kind, from senses drawn as for everybody."""
        return senses

    def hold(
        self, posture: np.ndarray, senses: SensorModel | None = None, seed: int = 0
    ) -> SoftHolding:
        """Return the person holding the object in a posture (32,) [rad]."""
        return self.holding(self, posture, senses or self.senses, seed)

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,) [rad], whether the object at `pose` is reached).

        The object is carried there straight from its pose in comfort.
        """
        held = self.hold(self.comfort)
        reached = held.carry(pose)
        return held.posture, reached

    def at(self, pose: np.ndarray, senses: SensorModel | None = None, seed: int = 0) -> SoftHolding:
        """Return the person at rest with the object at `pose` (4, 4), carried there from comfort.

        A person who stepped on the way stays at their new place.
        """
        held = self.hold(self.comfort, senses, seed)
        held.carry(pose)
        return held
