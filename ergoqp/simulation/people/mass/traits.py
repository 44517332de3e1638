"""What makes a person with mass who they are, and how that is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.simulation.people.anatomy import Sex, draw_body
from ergoqp.simulation.people.chance import generators
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import draw_habits
from ergoqp.simulation.people.mass.table import per_joint
from ergoqp.simulation.people.mass.wishes import Wishes
from ergoqp.simulation.people.senses import Senses, draw_senses

_OWN_EFFORT: Final = (0.5, 2.0)
"""Factor on every joint's effort, drawn log-uniformly per person and joint."""

_BALANCE: Final = (200.0, 600.0)
"""What it costs to have the centre of mass off the soles' middle, least and most [per m^2]."""


@dataclass(frozen=True)
class Traits:
    """What makes a person with mass who they are.

    Attributes:
        body: lengths and mass.
        sex: of which the shares of mass are.
        wishes: what the person minds.
        senses: their own delay, and sensors of the plainer sort.
        compensation: share of gravity that the muscles hold of themselves, 0.9 to 1.
        work: what they do with the object.
    """

    body: Body
    sex: Sex
    wishes: Wishes
    senses: Senses
    compensation: float
    work: Work


def draw_traits(kind: str, problem: Problem, seed: int, body: Body | None = None) -> Traits:
    """Return who works on a problem, the same for the same seed.

    Bodies, comfort and senses are drawn as for everybody; of their own are what every joint's
    effort counts, care for balance and the share of gravity that the muscles hold of themselves.

    Args:
        kind: name of the kind.
        problem: of which only the work is read.
        seed: of the person.
        body: the person's body; None: drawn.

    Raises:
        InputError: if the problem does not say how the object is held.
    """
    bodies, habits, senses = generators(kind, problem.name, seed)
    work = Work.of(problem)
    sex, drawn = draw_body(bodies)
    comfort = draw_habits(work, habits).comfort
    low, high = np.log(_OWN_EFFORT)
    factors = np.exp(habits.uniform(low, high, len(JOINTS)))
    wishes = Wishes(
        comfort=comfort,
        efforts=per_joint("effort") * factors,
        balance=float(habits.uniform(*_BALANCE)),
        hands=work.hands,
        seated=work.stance == "seated",
    )
    return Traits(
        body=body or drawn,
        sex=sex,
        wishes=wishes,
        senses=draw_senses(senses),
        compensation=float(habits.uniform(0.9, 1.0)),
        work=work,
    )
