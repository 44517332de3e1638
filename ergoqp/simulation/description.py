"""A simulated loop in words: its assumptions, and the terms of its problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

from ergoqp.joints import spoken
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.responses.ik import IkResponse
from ergoqp.rest.person_protocol import Person, SensorModel
from ergoqp.sheets.reba import Method
from ergoqp.simulation.robot import RobotKind
from ergoqp.step.guide import Guide

_MANY = 6
"""Largest number of joints with wrong readings that are named one by one."""


def about_person(
    model: IkResponse,
    person: Person,
    senses: SensorModel,
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
    declared, does = _told(problem.robot), "" if robot is None else _told(robot)
    told = "No robot is declared: the controller assumes one that follows every twist at once."
    if declared:
        told = f"The declared robot: {declared}."
    if person.robot is not None:
        acts = (
            "holds the object with a spring and a damper, so it lags, and the person's forces move"
            f" the object{f', and has {does}' if does else ''}."
        )
    elif robot is not None:
        acts = f"has {does}."
    else:
        acts = "has errors up to that size." if declared else "does exactly that."
    return [told, f"The simulated robot {acts}"]


_TOLD_IN: Final = {
    "gain": (1, ""),
    "pose_noise_deg": (1, " deg"),
    "pose_noise": (1e3, " mm"),
    "gain_error": (100, " %"),
    "speed_noise": (100, " %"),
}
"""Factor and unit of the numbers of a robot that are no times."""


def _told(robot: DeclaredRobot | RobotKind) -> str:
    """Return a robot in words, without the values that are those of a perfect one."""
    perfect, words = type(robot)(), []
    for entry in fields(robot):
        value = getattr(robot, entry.name)
        if value == getattr(perfect, entry.name):
            continue
        factor, unit = _TOLD_IN.get(entry.name, (1e3, " ms"))
        words.append(f"{_label(entry.name)} {factor * value:g}{unit}")
    return ", ".join(words)


_IN_UNITS: Final = {
    "s": "look_ahead smoothing rest_after move_after rest_filter max_age average delay lag"
    " pose_delay longest_hold recovery_time",
    "m": "pose_noise lower upper",
    "points": "rest_below move_above guide_gain guide_price",
    "points/(m/s)²": "effort_linear contact",
    "points/(rad/s)²": "effort_angular",
    "points/rad²": "comfort",
    "m/s": "linear_speed",
    "rad/s": "angular_speed",
    "m/s²": "linear_acceleration",
    "rad/s²": "angular_acceleration",
    "deg/s": "rate_deg",
}
_UNITS: Final = {name: unit for unit, names in _IN_UNITS.items() for name in names.split()}
_ENDINGS: Final = {"_deg": "deg", "_kg": "kg"}
_INNER: Final = ("tolerance", "yield_zone")
"""Fields of every limit, in its own unit, that only concern how rows are built."""


def options_of(problem: Problem, solver: str) -> list[tuple[str, str]]:
    """Return the terms of a problem and the options of the method as text for people.

    Args:
        problem: the task.
        solver: name of the QP solver.
    """
    control = _fields(problem.control) | {"average": problem.average}
    method, robot, usual = _fields(problem.method), _fields(problem.robot), _fields(Method())
    changed = {name: value for name, value in method.items() if value != usual[name]}
    return [
        ("cost", _cost(problem.cost)),
        ("person in the controller", _response(problem.response)),
        *((_spaced(type(limit).__name__), _sentence(_fields(limit))) for limit in problem.limits),
        *in_words(problem.task, "task: "),
        *in_words(changed, "method: "),
        *in_words(control, "control: "),
        *in_words({name: value for name, value in robot.items() if value}, "robot: "),
        ("QP solver", solver),
    ]


def in_words(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return names and values of options as text for people; `prefix` is before each name."""
    return [(prefix + _label(name), _value(name, value)) for name, value in values.items()]


def _cost(cost: Any) -> str:
    words = cost.name.replace("_", " ")
    if not hasattr(cost, "taus_deg"):
        return words
    parts = zip(cost.weights, cost.taus_deg, strict=True)
    return f"{words}: " + " + ".join(f"{weight:g} at {tau:g} deg" for weight, tau in parts)


def _response(response: Any) -> str:
    if not isinstance(response, IkResponse):
        return _spaced(type(response).__name__)
    where = "standing" if response.stance == "standing" else f"seated at {response.seat:.2g} m"
    hands = " and ".join(response.hands)
    turn = "free to turn about" if response.free_about_tool else "firm on"
    return (
        f"{response.body.stature:.2f} m, {where}, {hands} hand {turn} the tool ({response.tool} the"
        " hand)"
    )


def _fields(term: Any) -> dict[str, Any]:
    return (
        {entry.name: getattr(term, entry.name) for entry in fields(term)}
        if is_dataclass(term)
        else {}
    )


def _sentence(values: Mapping[str, Any]) -> str:
    told = {
        name: value
        for name, value in values.items()
        if name not in _INNER and value not in ({}, ())
    }
    return "; ".join(map(" ".join, in_words(told)))


def _label(name: str) -> str:
    for ending in _ENDINGS:
        name = name.removesuffix(ending)
    return name.replace("_", " ")


def _value(name: str, value: Any) -> str:
    unit = _UNITS.get(name) or next(
        (unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), ""
    )
    return f"{_plain(value)} {unit}".rstrip()


def _plain(value: Any) -> str:
    if isinstance(value, tuple) and [type(each) for each in value] == [bool, bool]:
        sides = [side for side, each in zip(("right", "left"), value, strict=True) if each]
        return " and ".join(sides) or "no"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{_label(str(key))} {_plain(each)}" for key, each in value.items())
    if isinstance(value, (tuple, list)):
        return ", ".join(map(_plain, value))
    return str(value)


def _spaced(name: str) -> str:
    return "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()
