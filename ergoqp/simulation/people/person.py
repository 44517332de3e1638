"""Who works on the object, and what they do from moment to moment: what every kind of person is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np

from ergoqp.human import Body
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.problem.way import straight
from ergoqp.simulation.people.senses import Senses

LET_GO = 0.12
"""A hand this far from its grip has let go [m]: more than a delay explains at any allowed speed."""


class Holding(ABC):
    """A person with the object in hand, from moment to moment.

    Attributes:
        pose: the object's true contact frame in the world (4, 4) [m].
        gap: largest distance of a hand from where it holds the object [m].
        senses: what lies between the person and what the controller sees of them.
        force: of the object on the hands (6,) at the contact frame, world-aligned [N, N m]; not
            finite for people without mass.
        slipped: how often a hand has slipped so far.
        fallen: whether the person has fallen.
        unbalanced: whether the centre of mass is outside what carries the person.
        slid: how far a sole has been from where it was put, at most [m].
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
        """Who it is."""

    @property
    @abstractmethod
    def posture(self) -> np.ndarray:
        """The person's true posture now (32,) [rad]."""

    @property
    @abstractmethod
    def base(self) -> np.ndarray:
        """Pelvis in the world, upright (4, 4) [m]."""

    @abstractmethod
    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Live on for `dt` seconds while the robot takes the object to `pose` (4, 4) [m].

        Args:
            pose: where the robot wants the object's contact frame at the end of this time.
            dt: [s].
        """

    @abstractmethod
    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest, with nothing to disturb, while the object stays at `pose` (4, 4) [m].

        Returns:
            Whether the object is reached there.
        """

    @abstractmethod
    def copy(self) -> Self:
        """Return another who goes on from the same moment."""

    def count_from_here(self) -> None:
        """Begin anew to count slips, and how far soles slide."""
        self.slipped, self.slid = 0, 0.0

    def carry(self, pose: np.ndarray) -> bool:
        """Follow the object straight to `pose` (4, 4), undisturbed, and come to rest there.

        The object stays at the last place on the way that is reached.

        Returns:
            Whether that is `pose`.
        """
        for part in straight(self.pose, pose):
            before = self.copy()
            if not self.rest(part):
                vars(self).update(vars(before))
                return False
        return True


class Person(ABC):
    """One person of a kind.

    Attributes:
        kind: its name.
        manner: what people of the kind do, as a clause for people.
        body: lengths and mass.
        senses: what lies between the person and what the controller sees of them.
        comfort: posture that the person takes with nothing to reach for (32,) [rad].
        footing: what carries the person, as a clause for people.
    """

    kind: ClassVar[str]
    manner: ClassVar[str]

    @property
    @abstractmethod
    def body(self) -> Body:
        """The person's body."""

    @property
    @abstractmethod
    def comfort(self) -> np.ndarray:
        """Posture that the person takes with nothing to reach for (32,) [rad]."""

    @property
    @abstractmethod
    def footing(self) -> str:
        """What carries the person, as a clause for people."""

    @property
    def senses(self) -> Senses:
        """What lies between the person and what the controller sees of them."""
        return Senses()

    @property
    def robot(self) -> DeclaredRobot | None:
        """What is true of the robot that this person's simulation has of its own.

        None: it has none, and the object is where it is told to be.
        """
        return None

    @abstractmethod
    def hold(self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0) -> Holding:
        """Return the person as they hold the object in a posture (32,) [rad], just now.

        The world's origin is on the floor, midway between the soles (standing) or below the pelvis
        (seated), x along the person's heading.

        Args:
            posture: of which the object's place follows.
            senses: how late the person follows; None: as this person does.
            seed: of what the person does by chance.
        """

    def at(self, pose: np.ndarray, senses: Senses | None = None, seed: int = 0) -> Holding:
        """Return the person at rest with the object at `pose` (4, 4), or as near as they reach.

        Args:
            pose: of the object, in the world of `hold`.
            senses: as for `hold`.
            seed: as for `hold`.
        """
        return self.hold(self.reach(pose)[0], senses, seed)

    @abstractmethod
    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Come to rest from comfort with the object at `pose` (4, 4) at once.

        Returns:
            The posture (32,) [rad], and whether the object is reached.
        """
