"""The place that guides a run, as given by an option."""

from __future__ import annotations

from pathlib import Path

from ergoqp.cli.commands.screen import working
from ergoqp.errors import InputError
from ergoqp.lab.baselines import rule_pose
from ergoqp.lab.population import person_of
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.problem import Problem
from ergoqp.seeking.tries import Place
from ergoqp.step.guide import Guide, read_guide


def places_to_try(problem: Problem) -> list[Place]:
    """Return the places that ``--seek`` tries after descent: the model's best, and the rule's."""
    with working("looking for the model's best place") as done:
        best = optimise(problem, person_of(problem).comfort, progress=done)
    rule = rule_pose(problem, person_of(problem).body)
    return [Place("the model's best", best.pose), Place("elbow height, 0.40 m ahead", rule)]


def guide_named(problem: Problem, name: str) -> Guide:
    """Return the place that ``--guide`` names.

    Args:
        problem: the task.
        name: ``best``: the place is searched for the controller's model of the person; else
            the path of an ``optimum.json``.

    Raises:
        InputError: if the file does not exist, it is of another problem, or the place cannot
            be used.
    """
    if name == "best":
        with working("looking for the best place") as done:
            return read_guide(problem, optimise(problem, person_of(problem).comfort, progress=done))
    path, allowed = Path(name), "allowed best or an optimum.json of `ergoqp optimise`"
    if not path.exists():
        raise InputError(f"--guide: {name!r} is not there, {allowed}")
    try:
        found = Optimum.load(path)
    except InputError:
        raise InputError(f"--guide: {name!r} cannot be read as an optimum, {allowed}") from None
    return read_guide(problem, found)
