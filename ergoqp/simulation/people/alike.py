"""People built like the controller's model, with other numbers: they reach and relax."""

from __future__ import annotations

from collections import deque
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.simulation.people.person import Holding, Person
from ergoqp.simulation.people.reach_and_relax import ReachAndRelax
from ergoqp.simulation.people.senses import Senses


@dataclass(frozen=True)
class Start:
    """A loop's start: a posture, how it holds the object, where that is, where the soles stand."""

    posture: np.ndarray
    pose: np.ndarray
    grasp: np.ndarray
    soles: np.ndarray


@dataclass(frozen=True)
class Alike(ReachAndRelax, Person):
    """A person who is the controller's model with other numbers.

    Attributes:
        response: the person's own body, weights and comfort.
    """

    kind: ClassVar[str] = "alike"
    manner: ClassVar[str] = "built like the controller's model with other joint weights"

    @property
    def body(self) -> Body:
        """The person's body."""
        return self.response.body

    @property
    def comfort(self) -> np.ndarray:
        """Posture that the person takes with nothing to reach for (32,) [rad]."""
        return self.response.comfort

    @property
    def footing(self) -> str:
        """What carries the person, as a clause for people."""
        return self.response.footing

    def hold(
        self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0
    ) -> AlikeHolding:
        """Return the person as they hold the object in a posture (32,) [rad]: no chance in it."""
        return self.holding(self.start_at(posture), senses)

    def holding(self, start: Start, senses: Senses | None = None) -> AlikeHolding:
        """Return the person as they hold the object at a start, just now."""
        return AlikeHolding(self, start, senses or self.senses)

    def start_at(self, posture: np.ndarray) -> Start:
        """Return the start in which the person holds the object in a posture (32,) [rad]."""
        return Start(posture, self.contact(posture)[0], self.grasp(posture), self.stand(posture))

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,) [rad], whether the object at `pose` is reached)."""
        return self.settle(self.comfort, pose, self.grasp(self.comfort), self.stand(self.comfort))


def sample_person(problem: Problem, seed: int, body: Body | None = None) -> Alike:
    """Return a person alike for a problem, the same for the same seed.

    Joint weights are multiplied by log-uniform 0.5 to 2; the stature is within 0.10 m of the
    controller's.

    Args:
        problem: its response must be an `IkResponse`.
        seed: of the person.
        body: the person's body, None: of a drawn stature.

    Raises:
        InputError: if the problem's response is of another kind.

    Example:
        >>> import ergoqp
        >>> from ergoqp.human import Body
        >>> from ergoqp.simulation.people.alike import sample_person
        >>> problem = ergoqp.load_problem("screwing")
        >>> sample_person(problem, seed=1, body=Body(1.68)).body.stature
        1.68
    """
    response = problem.response
    if not isinstance(response, IkResponse):
        raise InputError(
            f"simulated person: got a response of type {type(response).__name__}, allowed"
            " IkResponse"
        )
    rng = np.random.default_rng([seed, 1])
    factors = np.exp(rng.uniform(np.log(0.5), np.log(2.0), len(JOINTS)))
    stature = response.body.stature + rng.uniform(-0.10, 0.10)
    weights = dict(zip(JOINTS, (response.weight_vector * factors).tolist(), strict=True))
    return Alike(replace(response, body=body or Body.of_stature(stature), weights=weights))


class AlikeHolding(Holding):
    """A person alike from moment to moment.

    Args:
        person: who.
        start: how they hold the object, and where.
        senses: how late they follow.
    """

    def __init__(self, person: Alike, start: Start, senses: Senses) -> None:
        """Hold the object as in `start`."""
        self._person, self.start, self.senses = person, start, senses
        self._posture, self.pose = start.posture.copy(), start.pose.copy()
        self._late: deque[np.ndarray] = deque()

    @property
    def person(self) -> Alike:
        """Who it is."""
        return self._person

    @property
    def posture(self) -> np.ndarray:
        """The person's true posture now (32,) [rad]."""
        return self._posture

    @property
    def base(self) -> np.ndarray:
        """Pelvis in the world (4, 4) [m]."""
        return self.person.contact(self.posture)[1]

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow where the object was before the person's delay; relax."""
        if not self._late:
            self._late.extend([self.pose] * (1 + round(self.senses.delay / dt)))
        self.pose = pose
        self._late.append(pose)
        followed = self._late.popleft()
        held = np.hstack([followed @ grip for grip in self.start.grasp])
        follow = 1.0 - float(np.exp(-dt / self.senses.hand_time))
        self._posture, self.gap, _ = self.person.move(
            self.posture, held, self.start.soles, follow, dt
        )

    def rest(self, pose: np.ndarray) -> bool:
        """Settle where the object is."""
        start = self.start
        posture, reached = self.person.settle(self.posture, pose, start.grasp, start.soles)
        self._posture, self.pose = posture, pose
        self._late.clear()
        return reached

    def copy(self) -> Self:
        """Return another who goes on from the same moment."""
        other = copy(self)
        other._late = self._late.copy()
        return other
