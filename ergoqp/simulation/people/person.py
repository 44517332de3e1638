"""The interface of simulated people: who they are, and what they do from moment to moment."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np

from ergoqp.human import Body
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.problem.way import straight
from ergoqp.simulation.people.senses import Senses

LET_GO = 0.12
"""A hand this far from its grip has let go [m]. A delay cannot explain it at any allowed speed."""


class Holding(ABC):
    """The state of a person who holds the object.

    Attributes:
        pose: true contact frame of the object in the world (4, 4) [m].
        gap: largest distance of a hand from where it holds the object [m].
        senses: sensors between the person and the controller.
        force: force of the object on the hands (6,) at the contact frame, world-aligned [N, N
            m]; not finite for people without mass.
        slipped: number of times that a hand has slipped so far.
        fallen: whether the person has fallen.
        unbalanced: whether the centre of mass is outside the base of support.
        slid: largest distance of a sole from where it was put [m].

    Example:
        >>> import ergoqp
        >>> from ergoqp.simulation.people import person_of_kind
        >>> person = person_of_kind("alike", ergoqp.load_problem("screwing"), 0)
        >>> held = person.hold(person.comfort)
        >>> lower = held.pose.copy()
        >>> lower[2, 3] -= 0.1
        >>> held.rest(lower), held.posture.shape
        (True, (32,))
    """

    pose: np.ndarray
    senses: Senses
    gap: float = 0.0
    force: np.ndarray = np.full(6, np.nan)
    slipped: int = 0
    fallen: bool = False
    unbalanced: bool = False
    slid: float = 0.0

    @property
    @abstractmethod
    def person(self) -> Person:
        """The person."""

    @property
    @abstractmethod
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""

    @property
    @abstractmethod
    def base(self) -> np.ndarray:
        """Pelvis in the world, upright (4, 4) [m]."""

    @abstractmethod
    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Advance by `dt` seconds, while the robot moves the object to `pose` (4, 4) [m].

        Args:
            pose: contact frame that the robot wants at the end of this time (4, 4) [m].
            dt: duration [s].
        """

    @abstractmethod
    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest, without disturbances, with the object at `pose` (4, 4) [m].

        Returns:
            Whether the object is reached there.
        """

    @abstractmethod
    def copy(self) -> Self:
        """Return an independent copy of the state."""

    def count_from_here(self) -> None:
        """Reset the number of slips, and the sliding distance of the soles."""
        self.slipped, self.slid = 0, 0.0

    def carry(self, pose: np.ndarray) -> bool:
        """Follow the object straight to `pose` (4, 4), undisturbed, and come to rest there.

        If it is not reached, the object stays at the last place on the way that is reached.

        Returns:
            Whether `pose` is reached.
        """
        for part in straight(self.pose, pose):
            before = self.copy()
            if not self.rest(part):
                vars(self).update(vars(before))
                return False
        return True


class Person(ABC):
    """One simulated person of a kind.

    Attributes:
        kind: name of the kind.
        manner: what people of the kind do, as a clause for people.
        body: lengths and mass.
        senses: sensors between the person and the controller.
        comfort: posture of the person with nothing to reach for (32,) [rad].
        footing: what supports the person, as a clause for people.

    Example:
        >>> import ergoqp
        >>> from ergoqp.simulation.people import person_of_kind
        >>> person = person_of_kind("looking", ergoqp.load_problem("screwing"), 0)
        >>> person.kind, person.comfort.shape
        ('looking', (32,))
        >>> posture, reached = person.reach(person.hold(person.comfort).pose)
        >>> reached
        True
    """

    kind: ClassVar[str]
    manner: ClassVar[str]

    @property
    @abstractmethod
    def body(self) -> Body:
        """Body of the person."""

    @property
    @abstractmethod
    def comfort(self) -> np.ndarray:
        """Posture of the person with nothing to reach for (32,) [rad]."""

    @property
    @abstractmethod
    def footing(self) -> str:
        """What supports the person, as a clause for people."""

    @property
    def senses(self) -> Senses:
        """Sensors between the person and the controller."""
        return Senses()

    @property
    def robot(self) -> DeclaredRobot | None:
        """Declaration of the robot that is part of this person's simulation.

        None: there is no such robot, and the object is exactly where it is moved to.
        """
        return None

    @abstractmethod
    def hold(self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0) -> Holding:
        """Return the person holding the object in a posture (32,) [rad].

        The origin of the world is on the floor, midway between the soles (standing) or below
        the pelvis (seated), with x along the person's heading.

        Args:
            posture: joint angles (32,) [rad]; the pose of the object follows from them.
            senses: how late the person follows; None: the senses of this person.
            seed: seed of what the person does at random.
        """

    def at(self, pose: np.ndarray, senses: Senses | None = None, seed: int = 0) -> Holding:
        """Return the person at rest with the object at `pose` (4, 4), or as near as they reach.

        Args:
            pose: pose of the object (4, 4) [m], in the world of `hold`.
            senses: as for `hold`.
            seed: as for `hold`.
        """
        return self.hold(self.reach(pose)[0], senses, seed)

    @abstractmethod
    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Come to rest, from comfort, with the object at `pose` (4, 4).

        Returns:
            The posture (32,) [rad], and whether the object is reached.
        """
