"""`follower`: weighs hands, feet, balance and ease by weights of their own."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ergoqp.human import Body
from ergoqp.problem.problem import Problem
from ergoqp.simulation.people.anatomy import draw_body
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import draw_habits
from ergoqp.simulation.people.soft_person import SoftPerson, draw_senses


class FollowerPerson(SoftPerson):
    """Follows at once, with the whole body."""

    kind: ClassVar[str] = "follower"
    manner: ClassVar[str] = "who weighs hands, feet, balance and ease in a way of their own"


def draw(problem: Problem, seed: int, body: Body | None = None) -> FollowerPerson:
    """Return a follower for a problem, the same for the same seed."""
    rng, work = np.random.default_rng([seed, 21]), Work.of(problem)
    return FollowerPerson(body or draw_body(rng), work, draw_habits(work, rng), draw_senses(rng))
