"""The properties of a person with mass, and how they are drawn."""

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
"""Range of the factor on every joint's effort, drawn log-uniformly per person and joint."""

_BALANCE: Final = (200.0, 600.0)
"""Least and largest cost of the distance of the centre of mass from the soles' middle [per m^2]."""


@dataclass(frozen=True)
class Traits:
    """The properties of a person with mass.

    Attributes:
        body: lengths and mass.
        sex: sex, for the shares of mass.
        wishes: the costs by which they choose a posture.
        senses: their delay and simple sensors.
        compensation: share of gravity that the muscles compensate, 0.9 to 1.
        work: how they hold the object.
    """

    body: Body
    sex: Sex
    wishes: Wishes
    senses: Senses
    compensation: float
    work: Work


def draw_traits(kind: str, problem: Problem, seed: int, body: Body | None = None) -> Traits:
    """Return a random person for a problem. The same seed gives the same person.

    Body, comfort and senses are drawn as for all kinds. The effort of every joint, the cost of
    imbalance and the share of gravity that the muscles compensate are drawn for this kind.

    Args:
        kind: name of the kind.
        problem: the problem; only its work is used.
        seed: seed of the person.
        body: body of the person; None: it is drawn.

    Raises:
        InputError: if the problem does not describe how the object is held.
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
