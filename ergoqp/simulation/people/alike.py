"""People like the controller's model, but with other numbers: they reach and relax."""

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
    """Start of a loop: posture, pose of the object, grasp, and where the soles stand."""

    posture: np.ndarray
    pose: np.ndarray
    grasp: np.ndarray
    soles: np.ndarray


@dataclass(frozen=True)
class Alike(ReachAndRelax, Person):
    """A person like the controller's model, but with other numbers.

    Attributes:
        response: body, weights and comfort of the person.
    """

    kind: ClassVar[str] = "alike"
    manner: ClassVar[str] = "built like the controller's model with other joint weights"

    @property
    def body(self) -> Body:
        """Body of the person."""
        return self.response.body

    @property
    def comfort(self) -> np.ndarray:
        """Posture of the person with nothing to reach for (32,) [rad]."""
        return self.response.comfort

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        return self.response.footing

    def hold(
        self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0
    ) -> AlikeHolding:
        """Return the person holding the object in a posture (32,) [rad]. The seed has no effect."""
        return self.holding(self.start_at(posture), senses)

    def holding(self, start: Start, senses: Senses | None = None) -> AlikeHolding:
        """Return the person holding the object as at a start."""
        return AlikeHolding(self, start, senses or self.senses)

    def start_at(self, posture: np.ndarray) -> Start:
        """Return the start with the person holding the object in a posture (32,) [rad]."""
        return Start(posture, self.contact(posture)[0], self.grasp(posture), self.stand(posture))

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,) [rad], whether the object at `pose` is reached)."""
        return self.settle(self.comfort, pose, self.grasp(self.comfort), self.stand(self.comfort))


def sample_person(problem: Problem, seed: int, body: Body | None = None) -> Alike:
    """Return a person of the kind `alike` for a problem. The same seed gives the same person.

    The joint weights are multiplied by log-uniform factors of 0.5 to 2. The stature is within
    0.10 m of that of the controller's model.

    Args:
        problem: its response must be an `IkResponse`.
        seed: seed of the person.
        body: body of the person; None: one with a drawn stature.

    Raises:
        InputError: if the response of the problem is of another type.

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
    """The state of a person of the kind `alike` who holds the object.

    Args:
        person: the person.
        start: how they hold the object, and where it is.
        senses: the delay of the person.
    """

    def __init__(self, person: Alike, start: Start, senses: Senses) -> None:
        """Start to hold the object as in `start`."""
        self._person, self.start, self.senses = person, start, senses
        self._posture, self.pose = start.posture.copy(), start.pose.copy()
        self._late: deque[np.ndarray] = deque()

    @property
    def person(self) -> Alike:
        """The person."""
        return self._person

    @property
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""
        return self._posture

    @property
    def base(self) -> np.ndarray:
        """Pelvis in the world (4, 4) [m]."""
        return self.person.contact(self.posture)[1]

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow the object with the person's delay, and relax."""
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
        """Settle with the object at a pose."""
        start = self.start
        posture, reached = self.person.settle(self.posture, pose, start.grasp, start.soles)
        self._posture, self.pose = posture, pose
        self._late.clear()
        return reached

    def copy(self) -> Self:
        """Return an independent copy of the state."""
        other = copy(self)
        other._late = self._late.copy()
        return other
