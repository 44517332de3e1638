"""A person who weighs all tasks against each other: hands, feet, balance and ease."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from ergoqp.human import Body
from ergoqp.problem.problem import Problem
from ergoqp.simulation.people.anatomy import draw_body
from ergoqp.simulation.people.chance import generators
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import Habits, draw_habits
from ergoqp.simulation.people.senses import Senses, draw_senses
from ergoqp.simulation.people.soft_body import SoftBody
from ergoqp.simulation.people.soft_holding import SoftHolding


class SoftPerson(SoftBody):
    """A person simulated by whole-body inverse kinematics with soft tasks.

    Hands, feet, balance and preferred posture are weighed against each other. To make a kind of
    your own, change `habits_of`, `senses_of` or `holding`.

    Example:
        >>> import ergoqp
        >>> from dataclasses import replace
        >>> from ergoqp.simulation.people.soft_person import SoftPerson
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
    def habits_of(cls, habits: Habits, work: Work, rng: np.random.Generator) -> Habits:
        """Return the habits of people of this kind, from habits drawn as for everybody."""
        return habits

    @classmethod
    def senses_of(cls, senses: Senses, rng: np.random.Generator) -> Senses:
        """Return the senses of people of this kind, from senses drawn as for everybody."""
        return senses

    def hold(self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0) -> SoftHolding:
        """Return the person holding the object in a posture (32,) [rad]."""
        return self.holding(self, posture, senses or self.senses, seed)

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,) [rad], whether the object at `pose` is reached).

        The object is carried there straight from its pose in comfort.
        """
        held = self.hold(self.comfort)
        reached = held.carry(pose)
        return held.posture, reached

    def at(self, pose: np.ndarray, senses: Senses | None = None, seed: int = 0) -> SoftHolding:
        """Return the person at rest with the object at `pose` (4, 4), carried there from comfort.

        A person who stepped on the way stays at their new place.
        """
        held = self.hold(self.comfort, senses, seed)
        held.carry(pose)
        return held
