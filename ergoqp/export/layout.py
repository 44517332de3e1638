"""What the exported step takes and gives, said once.

The header, the wrapper for Python and their documentation follow from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ergoqp._version import __version__
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.step.answer.causes import Cause, Status
from ergoqp.step.inputs import INPUTS, OUTPUTS
from ergoqp.step.model import StepModel
from ergoqp.step.robot_watch.faults import Fault
from ergoqp.step.state import initial_state
from ergoqp.step.under_way.history import SHORTEST_DT


@dataclass(frozen=True)
class Field:
    """One member of a C struct: doubles or one int.

    Attributes:
        name: of the member.
        count: number of doubles; 0 for an int.
        meaning: what it is, with its unit.
        array: whether it is an array even with one entry.
    """

    name: str
    count: int
    meaning: str
    array: bool = False

    @property
    def length(self) -> int:
        """Length of the array in C, 0 where it is none.

        C has no empty arrays: one without entries has room for one.
        """
        return max(self.count, 1) if self.array else self.count if self.count > 1 else 0

    @property
    def whole(self) -> bool:
        """Whether it is an int."""
        return self.count == 0 and not self.array


def input_fields(problem: Problem) -> list[Field]:
    """Return what the caller gives at every step."""
    n, unit = len(problem.coordinates), _unit(problem)
    return [
        Field("posture", n, f"the state, in the order of ergoqp_coordinate_names {unit}"),
        Field("observed", n, "1 for entries of the posture that the sensors see, 0 for others"),
        Field(
            "pose", 16, "measured contact frame in the world, row-major 4 x 4 [m]; read if has_pose"
        ),
        Field(
            "twist",
            6,
            "what the robot really did in the last period [m/s, rad/s]; read if has_twist",
        ),
        Field(
            "dt",
            1,
            "for how long this twist will be executed [s]; not the time since the last call",
        ),
        Field("age", 1, "how old the posture is [s]"),
        Field("frame", 0, "1 if a posture arrived, 0 if not"),
        Field(
            "has_pose",
            0,
            "0: the pose is integrated from the last one, the first time from the posture",
        ),
        Field("has_twist", 0, "0: the robot did what it was sent, as late as declared"),
        Field("enable", 0, "0 decelerates to rest"),
    ]


def output_fields(problem: Problem) -> list[Field]:
    """Return what a step gives."""
    n, rows, unit = (
        len(problem.coordinates),
        len(problem.row_names),
        _unit(problem).replace("]", "/s]"),
    )
    return [
        Field(
            "twist",
            6,
            "send this: object velocity at the contact frame, world axes, linear first [m/s,"
            " rad/s]",
        ),
        Field("pose", 16, "contact frame that the step reckoned with, row-major 4 x 4 [m]"),
        Field("posture_rate", n, f"how the model person follows {unit}"),
        Field("cost", 1, "V of the posture [points]"),
        Field("gain", 1, "predicted improvement within one second at full speed [points]"),
        Field(
            "margins",
            rows,
            "distance of every row to its nearer end, negative outside, in the row's unit",
            array=True,
        ),
        Field("slack", rows, "by how much each row was missed [its unit/s]", array=True),
        Field("multipliers", rows, "multiplier of each row in the QP", array=True),
        Field("outside", rows, "1 for rows that are outside and on their way back", array=True),
        Field("locked", n, "1 for joints at their end that do not follow"),
        Field("qp_residual", 1, "largest KKT residual of the QP; accepted up to 1e-6"),
        Field("contact", 1, "contact motion that the posture cannot follow [m/s, rad/s]"),
        Field("accepted", 1, "share of the way from braking to the QP's answer that was certified"),
        Field("status", 0, "an ergoqp_status"),
        Field("causes", 0, "bits by ergoqp_cause: why inputs or the answer were not used"),
        Field("fault", 0, "an ergoqp_fault: what the robot does other than declared"),
        Field(
            "fault_amount", 1, "how much: a factor, seconds, metres, radians or metres per second"
        ),
    ]


def header(problem: Problem) -> str:
    """Return the public header ``ergoqp_step.h``."""
    statuses = ",\n    ".join(f"ERGOQP_{status.name.upper()} = {int(status)}" for status in Status)
    causes = ",\n    ".join(f"ERGOQP_CAUSE_{cause.name.upper()} = {int(cause)}" for cause in Cause)
    faults = ",\n    ".join(f"ERGOQP_FAULT_{fault.name.upper()} = {int(fault)}" for fault in Fault)
    return f"""/* The control step of problem "{problem.name}", exported by ergoqp {__version__}.
 *
 * Axes: x forward, y left, z up; metres, radians, seconds. A twist is linear first, at the contact
 * frame, along the axes of the world. Nothing is allocated: all memory is in an ergoqp_stepper,
 * which can be static. The only state is in there too, so the same calls give the same answers, and
 * steppers do not know of each other.
 */
#ifndef ERGOQP_STEP_H
#define ERGOQP_STEP_H

#include "ergoqp_memory.h"

#ifdef __cplusplus
extern "C" {{
#endif

#define ERGOQP_PROBLEM {c_string(problem.name)}
#define ERGOQP_COORDINATES {len(problem.coordinates)}
#define ERGOQP_ROWS {len(problem.row_names)}
#define ERGOQP_DT {problem.dt!r} /* the problem's control period [s] */

typedef enum {{
    {statuses}
}} ergoqp_status;

typedef enum {{
    {causes}
}} ergoqp_cause;

typedef enum {{
    {faults}
}} ergoqp_fault;

typedef struct {{
{_members(input_fields(problem))}
}} ergoqp_input;

typedef struct {{
{_members(output_fields(problem))}
}} ergoqp_output;

/* One control loop. Its members are nobody's business. */
typedef struct {{
    double input[ERGOQP_INPUT_DOUBLES], output[ERGOQP_OUTPUT_DOUBLES];
    double state[ERGOQP_STATE];
    double w[ERGOQP_SZ_W + 1];
    ERGOQP_INT iw[ERGOQP_SZ_IW + 1];
    const double* arg[ERGOQP_SZ_ARG];
    double* res[ERGOQP_SZ_RES];
}} ergoqp_stepper;

/* Standstill: forgets the last twists, the last pose and the rest state. To call before the first
 * step. */
void ergoqp_init(ergoqp_stepper* stepper);

/* The same for an object that moves already: takes it over, once, its twist clipped to the speed
 * limits. Returns 0 if it is not finite. */
int ergoqp_take_over(ergoqp_stepper* stepper, const double twist[6]);

/* What most loops give: a frame, everything seen, no pose, no twist, the problem's period, age 0,
 * enabled. */
void ergoqp_input_defaults(ergoqp_input* input);

/* One step. Whatever comes in, `output->twist` keeps the object's limits. Returns the status. */
ergoqp_status ergoqp_step(ergoqp_stepper* stepper, const ergoqp_input* input,
                          ergoqp_output* output);

/* For the robot's watchdog, when no step came in time: the next twist of the stop, executed for dt
 * seconds, without new data. The stepper goes on with it. elapsed: seconds for which the robot has
 * already ramped down along that stop by itself; after another ramp: ergoqp_take_over. Not beside
 * ergoqp_step in another thread: one stepper belongs to one thread at a time. */
ergoqp_status ergoqp_brake(ergoqp_stepper* stepper, double dt, double elapsed,
                           ergoqp_output* output);

/* Names, for logs. */
extern const char* const ergoqp_coordinate_names[ERGOQP_COORDINATES];
extern const char* const ergoqp_row_names[ERGOQP_ROWS + 1];
extern const char* const ergoqp_row_units[ERGOQP_ROWS + 1];
extern const char* const ergoqp_status_names[{len(Status)}];
extern const char* const ergoqp_cause_names[{len(Cause)}];

#ifdef __cplusplus
}}
#endif

#endif
"""


def memory_header(problem: Problem, core: str) -> str:
    """Return ``ergoqp_memory.h``: sizes and places of what the generated function takes and gives.

    Args:
        problem: the task.
        core: the header that CasADi wrote for the generated function, which says how much memory it
            works in.
    """
    sizes = {name: math.prod(StepModel(problem).size(name)) for name in INPUTS}
    n, rows = len(problem.coordinates), len(problem.row_names)
    outputs = {
        "twist": 6,
        "pose_used": 16,
        "next_state": sizes["state"],
        "posture_rate": n,
        "fault": 2,
        "residuals": 3,
    }
    outputs |= {"locked": n} | dict.fromkeys(("margins", "slack", "multipliers", "outside"), rows)
    lines = [
        "/* Sizes of the generated function. */",
        "#ifndef ERGOQP_MEMORY_H",
        "#define ERGOQP_MEMORY_H",
        "",
    ]
    lines += [
        f"#define ERGOQP_SZ_{kind} {_macro(core, kind)}" for kind in ("ARG", "RES", "IW", "W")
    ]
    model = StepModel(problem)
    history, initial = model.history, ", ".join(map(repr, initial_state(model).tolist()))
    lines += ["#define ERGOQP_INT long long int", f"#define ERGOQP_STATE {sizes['state']}", ""]
    lines += [f"#define ERGOQP_PLANNED {history.planned}", f"#define ERGOQP_SENT {history.sent}"]
    lines += [f"#define ERGOQP_SPEED {', '.join(map(repr, problem.twist_limit.speed.tolist()))}"]
    lines += [f"#define ERGOQP_SHORTEST_PERIOD {SHORTEST_DT!r}"]
    lines += [
        f"#define ERGOQP_LONGEST_CUT {3 * problem.dt!r}",
        f"#define ERGOQP_LONGEST_STOP {problem.stop.duration!r}",
    ]
    lines += [f"#define ERGOQP_INITIAL_STATE {initial}", ""]
    for word, names, count in (("INPUT", INPUTS, sizes), ("OUTPUT", OUTPUTS, outputs)):
        starts = [
            sum(count.get(before, 1) for before in names[:number])
            for number in range(len(names) + 1)
        ]
        lines += [
            f"#define ERGOQP_{word}_AT_{name} {start}"
            for name, start in zip(names, starts[:-1], strict=True)
        ]
        lines += [f"#define ERGOQP_{word}_STARTS {', '.join(map(str, starts[:-1]))}"]
        lines += [f"#define ERGOQP_{word}_DOUBLES {starts[-1]}", ""]
    return "\n".join([*lines, "#endif", ""])


def names_source(problem: Problem) -> str:
    """Return ``ergoqp_names.c``."""
    units = [limit.unit for limit in problem.row_limits for _ in limit.names]
    tables = {
        "coordinate_names[ERGOQP_COORDINATES]": problem.coordinates,
        "row_names[ERGOQP_ROWS + 1]": (*problem.row_names, ""),
        "row_units[ERGOQP_ROWS + 1]": (*units, ""),
        f"status_names[{len(Status)}]": [status.name for status in Status],
        f"cause_names[{len(Cause)}]": [cause.name for cause in Cause],
    }
    lines = ['#include "ergoqp_step.h"', ""]
    for name, words in tables.items():
        lines += [
            f"const char* const ergoqp_{name} = {{",
            *(f"    {c_string(word)}," for word in words),
            "};",
            "",
        ]
    return "\n".join(lines)


def c_string(text: str) -> str:
    """Return a text as a literal of C, whatever is in it: UTF-8 bytes, unusual ones in octal."""
    plain = {byte: chr(byte) for byte in range(32, 127) if chr(byte) not in '"\\?'}
    return '"' + "".join(plain.get(byte, f"\\{byte:03o}") for byte in text.encode()) + '"'


def python_fields(fields: list[Field]) -> str:
    """Return the members of a struct as ``ctypes`` names them, one per line."""
    return "\n".join(f'        ("{field.name}", {_python_type(field)}),' for field in fields)


def _python_type(field: Field) -> str:
    if field.whole:
        return "c_int"
    return f"c_double * {field.length}" if field.length else "c_double"


def _members(fields: list[Field]) -> str:
    lines = []
    for field in fields:
        name = f"{field.name}[{field.length}]" if field.length else field.name
        lines.append(f"    {'int' if field.whole else 'double'} {name}; /* {field.meaning} */")
    return "\n".join(lines)


def _macro(core: str, kind: str) -> int:
    return next(
        int(line.split()[-1])
        for line in core.splitlines()
        if line.startswith("#define") and f"_SZ_{kind} " in line
    )


def _unit(problem: Problem) -> str:
    return "[rad]" if problem.coordinates == JOINTS else "[m]"
