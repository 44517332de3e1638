"""The assumptions of a simulated loop, in sentences for people."""

from __future__ import annotations

from dataclasses import fields

from ergoqp.joints import spoken
from ergoqp.problem.problem import Problem
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.responses.ik import IkResponse
from ergoqp.simulation.people.person import Person
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.robot import RobotKind
from ergoqp.step.guide import Guide

_MANY = 6
"""Largest number of joints with wrong readings that are named one by one."""


def about_person(
    model: IkResponse,
    person: Person,
    senses: Senses,
    unobserved: tuple[str, ...],
    place: Guide | None,
) -> list[str]:
    """Return sentences on who is simulated, and what the controller knows of them.

    Args:
        model: the controller's model of the person.
        person: who is simulated.
        senses: sensors between the two.
        unobserved: joints that are not seen.
        place: place to which a guide leads the object.
    """
    own = person.body
    sentences = [
        (
            f"The person is simulated: {own.stature:.2f} m tall, {person.manner}, with a delay"
            f" ({1e3 * senses.delay:.0f} ms) and measurement noise ({senses.noise_deg:g} deg white,"
            f" {senses.drift_deg:g} deg drift, {100 * senses.lost:g} % of the frames lost) that the"
            " controller does not know."
        ),
        f"The controller assumes a nominal person of {model.body.stature:.2f} m.",
        (
            "The hand holds the object where it is in the posture at the start, and does not let"
            f" go; {person.footing}."
        ),
    ]
    if place is not None:
        x, y, z = place.pose[:3, 3]
        sentences.append(
            f"The guide is the place ({x:z.2f}, {y:z.2f}, {z:z.2f}) m: the object goes there if"
            " descent alone comes to rest at a worse place."
        )
    if len(senses.bias_deg) > _MANY:
        most = max(map(abs, senses.bias_deg.values()))
        sentences.append(
            f"The sensors have constant errors of up to {most:.1f} deg in {len(senses.bias_deg)}"
            " angles, which the controller does not know."
        )
    elif senses.bias_deg:
        wrong = ", ".join(
            f"{spoken(name)} by {error:+g} deg" for name, error in senses.bias_deg.items()
        )
        sentences.append(
            f"The sensors have constant errors that the controller does not know: {wrong}."
        )
    if unobserved:
        sentences.append(
            f"The controller does not see {', '.join(map(spoken, unobserved))}; the simulated"
            f" person starts with {'it' if len(unobserved) == 1 else 'them'} as given in the start."
        )
    return sentences


def about_robot(problem: Problem, robot: RobotKind | None, person: Person) -> list[str]:
    """Return sentences on what is declared of the robot, and how it behaves.

    Args:
        problem: the problem with the declaration.
        robot: how it behaves; None: as declared.
        person: the person, whose simulation may include its own robot.
    """
    declared = _told(problem.robot)
    does = _told(robot) if robot is not None else ""
    own = (
        "holds the object with a spring and a damper, so it lags, and the person's forces move the"
        " object"
    )
    return [
        (
            f"The declared robot: {declared}."
            if declared
            else (
                "No robot is declared: the controller assumes one that follows every twist at once."
            )
        ),
        "The simulated robot "
        + (
            f"{own}{f', and has {does}' if does else ''}."
            if person.robot is not None
            else "does exactly that."
            if robot is None and not declared
            else "has errors up to that size."
            if robot is None
            else f"has {does}."
        ),
    ]


def _told(robot: DeclaredRobot | RobotKind) -> str:
    """Return a robot in words, without the values that are those of a perfect one."""
    perfect, words = type(robot)(), []
    for entry in fields(robot):
        value = getattr(robot, entry.name)
        if value == getattr(perfect, entry.name):
            continue
        name = entry.name.removesuffix("_deg").replace("_", " ")
        if entry.name.endswith("_deg"):
            words.append(f"{name} {value:g} deg")
        elif entry.name == "pose_noise":
            words.append(f"{name} {1e3 * value:g} mm")
        elif entry.name in ("gain_error", "speed_noise"):
            words.append(f"{name} {100 * value:g} %")
        else:
            words.append(
                f"{name} {value:g}" if entry.name == "gain" else f"{name} {1e3 * value:g} ms"
            )
    return ", ".join(words)
