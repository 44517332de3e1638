"""People who follow the object, the sensors between them and the controller, and their start."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import Range, check_kind, check_parameters, shown, table_of_numbers, unmasked
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER, spoken
from ergoqp.problem.geometry import straight
from ergoqp.problem.settings import DeclaredRobot


@dataclass(frozen=True)
class SensorModel:
    """The sensors and delays between a person and the controller.

    Attributes:
        delay: delay from the object's motion to the person's [s].
        hand_time: time constant with which the hand follows, after the delay [s].
        noise_deg: standard deviation of the white noise of every angle of every frame [deg].
        drift_deg: standard deviation of the slow drift of every angle [deg].
        drift_time: time constant of the drift [s].
        lost: share of frames that do not arrive.
        bias_deg: constant error of the angles of some joints, by their names [deg].

    Raises:
        InputError: if a value has the wrong type or is out of range, or a joint is unknown.

    Example:
        >>> from ergoqp.rest.person_protocol import SensorModel
        >>> senses = SensorModel(delay=0.2, bias_deg={"right_knee_flexion": 5.0})
        >>> float(senses.bias.max().round(4))
        0.0873
    """

    delay: Annotated[float, Range(0.0, 2.0, "s")] = 0.15
    hand_time: Annotated[float, Range(1e-3, 10.0, "s")] = 0.05
    noise_deg: Annotated[float, Range(0.0, 90.0, "deg")] = 0.5
    drift_deg: Annotated[float, Range(0.0, 90.0, "deg")] = 1.0
    drift_time: Annotated[float, Range(1e-3, 3600.0, "s")] = 10.0
    lost: Annotated[float, Range(0.0, 1.0)] = 0.01
    bias_deg: Mapping[str, Annotated[float, Range(-90.0, 90.0, "deg")]] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        """Check the values and the names of the joints."""
        allowed = "a table of joints, each with its error [deg]"
        check_kind("bias_deg", self.bias_deg, Mapping, allowed)
        if unknown := [name for name in self.bias_deg if name not in INDEX]:
            raise InputError(
                f"bias_deg: got {shown(unknown[0])}, allowed a joint such as 'right_knee_flexion'"
            )
        check_parameters(self)

    @property
    def bias(self) -> np.ndarray:
        """Constant error of every joint (32,) [rad]."""
        return np.radians([self.bias_deg.get(name, 0.0) for name in JOINTS])


def frames(
    senses: SensorModel, dt: float, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield, for every period, (measurement error (32,) [rad], whether the frame arrives)."""
    count, bias, noise = len(JOINTS), senses.bias, np.radians(senses.noise_deg)
    keep = np.exp(-dt / senses.drift_time)
    drift = rng.normal(size=count) * np.radians(senses.drift_deg)
    fresh = np.sqrt(1 - keep**2) * np.radians(senses.drift_deg)
    while True:
        drift = keep * drift + fresh * rng.normal(size=count)
        error = bias + drift + rng.normal(size=count) * noise
        yield error, bool(rng.random() >= senses.lost)


def draw_senses(rng: np.random.Generator) -> SensorModel:
    """Return random senses, with a delay of 0 to 300 ms."""
    return SensorModel(
        delay=float(rng.uniform(0.0, 0.3)),
        hand_time=float(rng.uniform(0.04, 0.12)),
        noise_deg=2.0,
        drift_deg=1.0,
        lost=0.01,
    )


LET_GO = 0.12
"""A hand this far from its grip has let go [m]. A delay cannot explain it at any allowed speed."""

P = TypeVar("P", bound="Person", covariant=True)


class Holding(ABC, Generic[P]):
    """The state of a person who holds the object.

    Attributes:
        person: the person.
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

    person: P
    pose: np.ndarray
    senses: SensorModel
    gap: float = 0.0
    force: np.ndarray = np.full(6, np.nan)
    slipped: int = 0
    fallen: bool = False
    unbalanced: bool = False
    slid: float = 0.0
    _late: deque[np.ndarray]  # poses of the object that the person does not follow yet

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

    def copy(self) -> Self:
        """Return an independent copy of the state."""
        other = copy(self)
        other._late = self._late.copy()
        return other

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
    def senses(self) -> SensorModel:
        """Sensors between the person and the controller."""
        return SensorModel()

    @property
    def robot(self) -> DeclaredRobot | None:
        """Declaration of the robot that is part of this person's simulation.

        None: there is no such robot, and the object is exactly where it is moved to.
        """
        return None

    @abstractmethod
    def hold(
        self, posture: np.ndarray, senses: SensorModel | None = None, seed: int = 0
    ) -> Holding:
        """Return the person holding the object in a posture (32,) [rad].

        The origin of the world is on the floor, midway between the soles (standing) or below
        the pelvis (seated), with x along the person's heading.

        Args:
            posture: joint angles (32,) [rad]; the pose of the object follows from them.
            senses: how late the person follows; None: the senses of this person.
            seed: seed of what the person does at random.
        """

    def at(self, pose: np.ndarray, senses: SensorModel | None = None, seed: int = 0) -> Holding:
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


_OTHERWISE_DEG = 2.0  # a larger difference of the start from the given posture is reported
_AT_END = np.radians(0.01)  # a start this far beyond a joint's range counts as rounding


def read_posture(posture: ArrayLike) -> tuple[np.ndarray, list[str]]:
    """Return a posture (32,) [rad] within the joints' ranges, and a sentence if it was not.

    Raises:
        InputError: if it is not a posture.
    """
    try:
        angles = table_of_numbers("posture", posture)
    except InputError:
        raise InputError(
            f"posture: got {type(posture).__name__}, allowed {len(JOINTS)} angles in radians"
        ) from None
    if angles.shape != (len(JOINTS),):
        raise InputError(
            f"posture: got shape {angles.shape}, allowed ({len(JOINTS)},), in the order of"
            " ergoqp.JOINTS"
        )
    wrong = np.flatnonzero(~(np.abs(angles) <= np.pi))
    if wrong.size:
        raise InputError(
            f"posture: got {angles[wrong[0]]:g} for {JOINTS[wrong[0]]}, allowed radians within ±π"
            " (degrees given as radians?)"
        )
    inside = np.clip(angles, LOWER, UPPER)
    beyond = [spoken(JOINTS[i]) for i in np.flatnonzero(np.abs(angles - inside) > _AT_END)]
    if not beyond:
        return inside, []
    return inside, [
        f"The start is beyond the range of {', '.join(beyond)}; the person starts at its end."
    ]


def stood_otherwise(given: np.ndarray, start: np.ndarray) -> list[str]:
    """Return a sentence if a person does not start in the given posture (32,) [rad]."""
    apart = np.degrees(np.abs(start - given))
    joint = int(np.argmax(apart))
    if apart[joint] <= _OTHERWISE_DEG:
        return []
    return [
        "Before the run begins the person stands with flat soles, or sits with feet that reach the"
        " floor, and holds the object still: the start differs from the posture that was given, by"
        f" up to {apart[joint]:.0f} deg ({spoken(JOINTS[joint])})."
    ]


def read_observed(observed: ArrayLike | None) -> np.ndarray | None:
    """Return which joints are seen (32,), None: all.

    Raises:
        InputError: if it is neither None nor bool of that shape.
    """
    if observed is None:
        return None
    try:
        seen = unmasked(observed)
        if seen.shape == (len(JOINTS),) and seen.dtype == bool:
            return seen
    except Exception:  # not an array
        pass
    raise InputError(f"observed: got {shown(observed)}, allowed bool of shape ({len(JOINTS)},)")
