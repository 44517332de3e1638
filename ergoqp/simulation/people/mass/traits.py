"""What makes a person with mass who they are, and how that is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.simulation.people.mass.segments import Sex
from ergoqp.simulation.people.mass.table import per_joint
from ergoqp.simulation.people.mass.wishes import Wishes
from ergoqp.simulation.people.senses import Senses

_STATURES: Final[dict[Sex, tuple[float, float]]] = {"female": (1.64, 0.065), "male": (1.77, 0.070)}
"""Mean and standard deviation of adults' statures [m]."""

_READ: Final = ("hands", "stance", "tool", "free_about_tool", "comfort", "seat_height")
"""What is read of a problem's response: the task, and nothing of how it reckons."""

_SHORTEST, _TALLEST = 1.50, 1.95
"""Who is drawn [m]."""

_BUILD: Final = (23.5, 2.0)
"""Mean and standard deviation of mass over squared stature [kg/m^2]."""

_HANGING: Final = np.radians(10.0)
"""Elbow flexion of an arm that has nothing to do [rad]."""


@dataclass(frozen=True)
class Traits:
    """What makes a person with mass who they are.

    Attributes:
        body: lengths and mass.
        sex: of which the shares of mass are.
        wishes: what the person minds.
        senses: their own delay, and sensors of the plainer sort.
        compensation: share of gravity that the muscles hold of themselves, 0.9 to 1.
        tool: axis of the tool in the hand, `"along"` or `"thumb"`.
        free_about_tool: whether a hand may turn about it.
        seat_height: of the hip centres when seated [m]; None: set to the person.
    """

    body: Body
    sex: Sex
    wishes: Wishes
    senses: Senses
    compensation: float
    tool: str
    free_about_tool: bool
    seat_height: float | None


def draw_traits(problem: Problem, seed: int, body: Body | None = None) -> Traits:
    """Return who works on a problem, the same for the same seed.

    Drawn are sex, stature, mass, what every joint's effort counts (0.5 to 2 times), comfort (3 deg
    around what the task suggests), care for balance, delay (0 to 0.3 s) and the share of gravity
    that the muscles hold of themselves (0.9 to 1).

    Args:
        problem: only what its response says of the task is read: hands, stance, tool, comfort
            and seat.
        seed: of the person.
        body: the person's body; None: drawn.

    Raises:
        InputError: if the problem's response does not say that.
    """
    task: Any = problem.response
    if missing := [name for name in _READ if not hasattr(task, name)]:
        raise InputError(
            f"simulated person: got a response of type {type(task).__name__} that does not say"
            f" {', '.join(missing)}, allowed one such as IkResponse"
        )
    rng = np.random.default_rng([seed, 11])
    sex: Sex = "female" if rng.random() < 0.5 else "male"
    mean, deviation = _STATURES[sex]
    stature = float(np.clip(rng.normal(mean, deviation), _SHORTEST, _TALLEST))
    build_index = float(np.clip(rng.normal(*_BUILD), 18.5, 30.0))
    seated = task.stance == "seated"
    comfort = task.comfort + np.radians(rng.normal(0.0, 3.0, len(JOINTS)))
    comfort[20:] = task.comfort[20:]  # Where the feet stand is the task's.
    for side in SIDES:
        if side not in task.hands:
            arm = [INDEX[name] for name in JOINTS[6:20] if name.startswith(side)]
            comfort[arm] = 0.0
            comfort[INDEX[f"{side}_elbow_flexion"]] = _HANGING
    efforts = per_joint("effort") * np.exp(rng.uniform(np.log(0.5), np.log(2.0), len(JOINTS)))
    wishes = Wishes(
        comfort=np.clip(comfort, LOWER, UPPER),
        efforts=efforts,
        balance=float(rng.uniform(200.0, 600.0)),
        hands=task.hands,
        seated=seated,
    )
    return Traits(
        body=body or Body.of_stature(stature, mass=build_index * stature**2),
        sex=sex,
        wishes=wishes,
        senses=Senses(delay=float(rng.uniform(0.0, 0.3)), noise_deg=2.0, drift_deg=1.0, lost=0.01),
        compensation=float(rng.uniform(0.9, 1.0)),
        tool=task.tool,
        free_about_tool=task.free_about_tool,
        seat_height=task.seat_height,
    )
