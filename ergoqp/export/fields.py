"""The members of the input and output structs of the exported step, with their meaning."""

from __future__ import annotations

from dataclasses import dataclass

from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.step.margins import PARTS


@dataclass(frozen=True)
class Field:
    """One member of a C struct: doubles or one int.

    Attributes:
        name: name of the member.
        count: number of doubles; 0 for an int.
        meaning: description with unit.
        array: whether it is an array even with one entry.
    """

    name: str
    count: int
    meaning: str
    array: bool = False

    @property
    def length(self) -> int:
        """Length of the array in C, 0 if it is not an array.

        C has no empty arrays, so an array without entries has room for one.
        """
        return max(self.count, 1) if self.array else self.count if self.count > 1 else 0

    @property
    def whole(self) -> bool:
        """Whether it is an int."""
        return self.count == 0 and not self.array


def input_fields(problem: Problem) -> list[Field]:
    """Return the members of the input, which the caller gives at every step."""
    n, unit = len(problem.coordinates), _unit(problem)
    return [
        Field("posture", n, f"the state, in the order of ergoqp_coordinate_names {unit}"),
        Field("observed", n, "1 for entries of the posture that the sensors see, 0 for others"),
        Field("pose", 16, f"measured {_posed(problem)}, row-major 4 x 4 [m]; read if has_pose"),
        Field(
            "twist",
            6,
            "motion of the robot in the last period [m/s, rad/s]; read if has_twist",
        ),
        Field(
            "dt",
            1,
            "time for which this twist will be executed [s]; not the time since the last call",
        ),
        Field("age", 1, "age of the posture [s]"),
        Field("frame", 0, "1 if a posture arrived, 0 if not"),
        Field(
            "has_pose",
            0,
            "0: the pose is integrated from the last one, the first time from the posture",
        ),
        Field("has_twist", 0, "0: the robot is assumed to follow the sent twists as declared"),
        Field("enable", 0, "0: the object decelerates to rest"),
    ]


def output_fields(problem: Problem, guided: bool = False) -> list[Field]:
    """Return the members of the output of a step."""
    n, rows, unit = (
        len(problem.coordinates),
        len(problem.row_names),
        _unit(problem).replace("]", "/s]"),
    )
    fields = [
        Field(
            "twist",
            6,
            "send this: object velocity at the contact frame, world axes, linear first [m/s,"
            " rad/s]",
        ),
        Field("pose", 16, "contact frame that the step used, row-major 4 x 4 [m]"),
        Field("posture_rate", n, f"predicted rate of the posture {unit}"),
        Field("cost", 1, "V of the posture [points]"),
        Field("gain", 1, "predicted improvement within one second at full speed [points]"),
        Field(
            "margins",
            rows,
            "distance of every row to its nearer end, negative outside, in the row's unit",
            array=True,
        ),
        Field("slack", rows, "violation of each row in the QP [its unit/s]", array=True),
        Field("multipliers", rows, "multiplier of each row in the QP", array=True),
        Field("outside", rows, "1 for rows that are outside and coming back", array=True),
        Field("locked", n, "1 for joints that are held at their end"),
        Field(
            "amiss",
            len(PARTS) + rows,
            f"1 for terms without a usable number: {', '.join(map(' '.join, PARTS))}, each row",
        ),
        Field("qp_residual", 1, "largest KKT residual of the QP; accepted up to 1e-6"),
        Field("contact", 1, "contact motion that the posture cannot follow [m/s, rad/s]"),
        Field("accepted", 1, "certified share of the QP's answer: 0 braking, 1 all of it"),
        Field("status", 0, "an ergoqp_status"),
        Field("causes", 0, "bits by ergoqp_cause: inputs or answers that were not used, and why"),
        Field("fault", 0, "an ergoqp_fault: deviation of the robot from its declaration"),
        Field(
            "fault_amount",
            1,
            "size of the fault: a factor, seconds, metres, radians or metres per second",
        ),
        Field("doubted", 0, "1: no usual error of the posture explains the pose, see `apart`"),
        Field("apart", 1, "distance between the pose and the contact of the posture [m]"),
        Field("apart_angle", 1, "the same of the tool's axis [rad]"),
    ]
    drawn = Field(
        "drawn",
        0,
        "the guide: 1 on the way there, 2 waits there, 4 on the way back; 0: no influence",
    )
    return [*fields, *([drawn] if guided else [])]


def python_fields(fields: list[Field]) -> str:
    """Return the members of a struct for ``ctypes``, one per line."""
    return "\n".join(f'        ("{field.name}", {_python_type(field)}),' for field in fields)


def _python_type(field: Field) -> str:
    if field.whole:
        return "c_int"
    return f"c_double * {field.length}" if field.length else "c_double"


def members(fields: list[Field]) -> str:
    """Return the members of a struct in C, one per line, with their meaning."""
    lines = []
    for field in fields:
        name = f"{field.name}[{field.length}]" if field.length else field.name
        lines.append(f"    {'int' if field.whole else 'double'} {name}; /* {field.meaning} */")
    return "\n".join(lines)


def _posed(problem: Problem) -> str:
    return "flange in the base" if problem.frames.moved else "contact frame in the world"


def _unit(problem: Problem) -> str:
    return "[rad]" if problem.coordinates == JOINTS else "[m]"
