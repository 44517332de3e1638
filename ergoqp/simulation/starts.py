"""The start of a run that is not given: an awkward place of the object that the person reaches.

It is found in a fraction of a second.
"""

from __future__ import annotations

import numpy as np

from ergoqp.errors import InputError, OutOfReachError
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.problem.room import PLACES, no_start
from ergoqp.simulation.best_place import TURNS, tilted_frames
from ergoqp.simulation.people.person import Person

_EDGE = 0.02
"""Distance from the ends of the workspace [m], because the hand rests slightly off the object."""


def awkward_start(problem: Problem, person: Person, seed: int, places: int = PLACES) -> np.ndarray:
    """Return the rest posture (32,) [rad] with the highest score, see `awkward_place`.

    Example:
        >>> import ergoqp
        >>> from ergoqp.simulation.people.alike import sample_person
        >>> from ergoqp.simulation.starts import awkward_start
        >>> problem = ergoqp.load_problem("screwing")
        >>> posture = awkward_start(problem, sample_person(problem, 0), seed=0, places=4)
        >>> posture.shape, int(problem.assess(posture).final[0]) > 1
        ((32,), True)
    """
    return awkward_place(problem, person, seed, places)[1]


def awkward_place(
    problem: Problem, person: Person, seed: int, places: int = PLACES
) -> tuple[np.ndarray, np.ndarray]:
    """Return a random place (4, 4) with a high score, and the rest posture there (32,) [rad].

    Of all places that are tried, it is the one where the rest posture scores highest.

    Args:
        problem: its workspace and tool axis define where the object can be.
        person: who follows.
        seed: seed of the places.
        places: number of places to try.

    Raises:
        InputError: if the problem has no workspace or no tool axis, or no place is one that
            the person reaches and the limits allow.
    """
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    if box is None or cone is None:
        raise InputError(
            f"problem {problem.name}: has no limits.{'workspace' if box is None else 'tool_axis'},"
            " so nothing says where the object may start; give a recording to start from"
        )
    rng = np.random.default_rng([seed, 4])
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    inset = np.minimum(_EDGE, (upper - lower) / 2)
    rotations = tilted_frames(cone, problem.twist_limit.axes, TURNS)
    found, postures, notes = [], [], []
    for _ in range(places):
        pose = np.eye(4)
        pose[:3, 3] = rng.uniform(lower + inset, upper - inset)
        pose[:3, :3] = rotations[rng.integers(len(rotations))]
        posture, reached = person.reach(pose)
        note = problem.own_limits.broken(pose, posture) if reached else "out of reach"
        if note:
            notes.append(note)
        else:
            found.append(pose)
            postures.append(posture)
    if not postures:
        raise OutOfReachError(f"problem {problem.name}: {no_start(notes)}")
    worst = int(np.argmax(problem.assess(np.array(postures)).final))
    return found[worst], postures[worst]
