"""The headers and tables of the exported step: members of its structs, with their meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ergoqp._version import __version__
from ergoqp.expressions import slices
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.step.causes import FAULT_UNITS, Cause, Fault, Status
from ergoqp.step.certification import PARTS, longest_stop
from ergoqp.step.frames_check import DOUBTED
from ergoqp.step.function import INPUTS, OUTPUTS, state_at_start
from ergoqp.step.guide import GUIDE_INPUTS, GUIDE_OUTPUTS, Guide
from ergoqp.step.layout import ASTRAY, CLOCK_ROUNDING, FRAMES, SHORTEST_DT, count
from ergoqp.step.model import StepModel
from ergoqp.step.rest import FIRM, TRIAL, UNKNOWN


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
        Field("twist", 6, "motion of the robot in the last period [m/s, rad/s]; read if has_twist"),
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
    n = len(problem.coordinates)
    rows = len(problem.row_names)
    unit = _unit(problem).replace("]", "/s]")
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
            "size of the fault, in the unit of ergoqp_fault_units; a factor where that is empty",
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


_GUIDE_VALUES = f"""
/* Promises for ergoqp_guide: the cost there is unknown; the caller judges the place. */
#define ERGOQP_PROMISE_UNKNOWN {UNKNOWN!r}
#define ERGOQP_PROMISE_FIRM {FIRM!r}
"""
_TRIED = " The place of the guide is tried again."
_GUIDE_CALLS = """\
/* Set the place of the guide: a contact frame in the world, row-major 4 x 4 [m]. A null pointer:
 * descent alone. promise: the expected cost there [points]. The trial of the last place is
 * forgotten. Returns 0 and changes nothing if the place is not a finite rigid pose or the promise
 * is not finite. The place may be outside the workspace: the object then goes as far as its limits
 * allow. ergoqp_init and ergoqp_take_over set the place of the export: call this function again
 * after them. */
int ergoqp_guide(ergoqp_stepper* stepper, const double* place, double promise);

"""


def header(problem: Problem, guided: bool = False) -> str:
    """Return the public header ``ergoqp_step.h``."""
    statuses = ",\n    ".join(f"ERGOQP_{status.name.upper()} = {int(status)}" for status in Status)
    causes = ",\n    ".join(f"ERGOQP_CAUSE_{cause.name.upper()} = {int(cause)}" for cause in Cause)
    faults = ",\n    ".join(f"ERGOQP_FAULT_{fault.name.upper()} = {int(fault)}" for fault in Fault)
    return f"""/* The control step of problem "{problem.name}", exported by ergoqp {__version__}.
 *
 * Axes: x forward, y left, z up; metres, radians, seconds. A twist is linear first, at the contact
 * frame, along the axes of the world. Nothing is allocated: all memory and all state are in an
 * ergoqp_stepper, which can be static. The same calls give the same answers. Several steppers are
 * independent.
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
#define ERGOQP_CAUSES {len(Cause)}
#define ERGOQP_FAULTS {len(Fault)}
#define ERGOQP_DT {problem.dt!r} /* the problem's control period [s] */
{_GUIDE_VALUES if guided else ""}
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
{members(input_fields(problem))}
}} ergoqp_input;

typedef struct {{
{members(output_fields(problem, guided))}
}} ergoqp_output;

/* One control loop. The members are private. */
typedef struct {{
    double input[ERGOQP_INPUT_DOUBLES], output[ERGOQP_OUTPUT_DOUBLES];
    double state[ERGOQP_STATE];{" double guide[18];" if guided else ""}
    double w[ERGOQP_SZ_W + 1];
    ERGOQP_INT iw[ERGOQP_SZ_IW + 1];
    const double* arg[ERGOQP_SZ_ARG];
    double* res[ERGOQP_SZ_RES];
}} ergoqp_stepper;

/* Reset the state to standstill, without a last twist or pose. Call it before the first step. */
void ergoqp_init(ergoqp_stepper* stepper);

/* The same for an object that is moving already. Call it once, with the measured twist, which is
 * clipped to the speed limits. Returns 0 if the twist is not finite. */
int ergoqp_take_over(ergoqp_stepper* stepper, const double twist[6]);

/* Set the defaults: a frame, all joints seen, no pose, no twist, the problem's period, age 0,
 * enabled. */
void ergoqp_input_defaults(ergoqp_input* input);

/* One step. `output->twist` keeps the limits of the object for every input. Returns the status. */
ergoqp_status ergoqp_step(ergoqp_stepper* stepper, const ergoqp_input* input,
                          ergoqp_output* output);

/* For the robot's watchdog, if no step came in time: the next twist of the stop, to be executed for
 * dt seconds. It needs no new data and updates the stepper. elapsed: seconds for which the robot
 * has already slowed down by itself along the twists of ergoqp_stop; after another ramp call
 * ergoqp_take_over. An elapsed that is no number from 0 gives the cause age. A stepper must not be
 * used by two threads at once. */
ergoqp_status ergoqp_brake(ergoqp_stepper* stepper, double dt, double elapsed,
                           ergoqp_output* output);

/* The twists of the certified stop from here, one per period ERGOQP_DT, the last one zero, as
 * ergoqp_brake would give them. For a robot that is to stop by itself when no twist comes: send
 * them in advance. Returns how many there are. The stepper is as before. */
int ergoqp_stop(ergoqp_stepper* stepper, double twists[ERGOQP_STOP][6]);

/* Allow motion again after a fault of the robot that no measured pose ended (cause `latched`), and
 * after wrong frames, until they are compared again. After a fault the object may be anywhere
 * between what was sent and what was reported since a pose was measured, and the limits count
 * both.{_TRIED if guided else ""} */
void ergoqp_try_again(ergoqp_stepper* stepper);

{_GUIDE_CALLS if guided else ""}/* Names, for logs. */
extern const char* const ergoqp_coordinate_names[ERGOQP_COORDINATES];
extern const char* const ergoqp_row_names[ERGOQP_ROWS + 1];
extern const char* const ergoqp_row_units[ERGOQP_ROWS + 1];
extern const char* const ergoqp_status_names[{len(Status)}];
extern const char* const ergoqp_cause_names[ERGOQP_CAUSES];
extern const char* const ergoqp_fault_names[ERGOQP_FAULTS];
extern const char* const ergoqp_fault_units[ERGOQP_FAULTS];

#ifdef __cplusplus
}}
#endif

#endif
"""


def memory_header(problem: Problem, core: str, guide: Guide | None = None) -> str:
    """Return ``ergoqp_memory.h``: sizes and positions of inputs and outputs.

    They are those of the generated function.

    Args:
        problem: the task.
        guide: first place that the step is drawn to. None: the step has no guide.
        core: the header that CasADi wrote for the generated function, which gives the size of its
            memory.
    """
    model = StepModel(problem, guided := guide is not None)
    inputs = (*INPUTS, *(GUIDE_INPUTS if guided else ()))
    sizes = {name: math.prod(model.size(name)) for name in INPUTS} | {"guide": 16}
    n, rows = len(problem.coordinates), len(problem.row_names)
    outputs = {
        "twist": 6,
        "pose_used": 16,
        "next_state": sizes["state"],
        "posture_rate": n,
        "fault": 2,
        "frames": count(FRAMES),
        "residuals": 3,
        "astray": ASTRAY,
    }
    outputs |= {"locked": n, "amiss": len(PARTS) + rows}
    outputs |= dict.fromkeys(("margins", "slack", "multipliers", "outside"), rows)
    lines = [
        "/* Sizes of the generated function. */",
        "#ifndef ERGOQP_MEMORY_H",
        "#define ERGOQP_MEMORY_H",
        "",
    ]
    found = {
        name[name.index("_SZ_") :]: size for name, size in defines(core).items() if "_SZ_" in name
    }
    lines += [
        f"#define ERGOQP_SZ_{kind} {found[f'_SZ_{kind}']}" for kind in ("ARG", "RES", "IW", "W")
    ]
    history, initial = model.history, _listed(state_at_start(model))
    lines += ["#define ERGOQP_INT long long int", f"#define ERGOQP_STATE {sizes['state']}", ""]
    lines += [
        f"#define ERGOQP_STATE_AT_{name} {model.places[name].start}"
        for name in ("idle", "due", "latched", "frames", "trial")
        if name in model.places
    ]
    lines += [f"#define ERGOQP_PLANNED {history.planned}", f"#define ERGOQP_SENT {history.sent}"]
    lines += [f"#define ERGOQP_SPEED {_listed(problem.twist_limit.speed)}"]
    lines += [f"#define ERGOQP_DOUBTED {DOUBTED}"]
    lines += [f"#define ERGOQP_SHORTEST_PERIOD {SHORTEST_DT!r}"]
    lines += [
        f"#define ERGOQP_CLOCK_ROUNDING {CLOCK_ROUNDING!r}",
        f"#define ERGOQP_LONGEST_STOP {problem.stop.duration!r}",
        f"#define ERGOQP_STOP {longest_stop(problem, problem.dt)} /* most twists of a stop */",
        f"#define ERGOQP_AVERAGE {float(problem.average)!r}",
        f"#define ERGOQP_ACCELERATION {_listed(problem.twist_limit.acceleration)}",
    ]
    lines += ["#define ERGOQP_SURFACE"] if problem.surface is not None else []
    taken = _listed(state_at_start(model, np.zeros(6)))
    late = problem.robot.dead_time + problem.robot.lag
    lines += [f"#define ERGOQP_INITIAL_STATE {initial}", f"#define ERGOQP_TAKEN_STATE {taken}"]
    lines += [f"#define ERGOQP_LATE {float(late)!r}", ""]
    if guide is not None:
        first = _listed(np.array([*guide.pose.T.ravel(), 1.0, guide.expected]))
        lines += [f"#define ERGOQP_GUIDE {first}", f"#define ERGOQP_TRIAL {TRIAL}", ""]
    results = (*OUTPUTS, *(GUIDE_OUTPUTS if guided else ()))
    for word, names, each in (("INPUT", inputs, sizes), ("OUTPUT", results, outputs)):
        starts = {name: at.start for name, at in slices({n: each.get(n, 1) for n in names}).items()}
        lines += [f"#define ERGOQP_{word}_AT_{name} {start}" for name, start in starts.items()]
        lines += [f"#define ERGOQP_{word}_STARTS {', '.join(map(str, starts.values()))}"]
        lines += [f"#define ERGOQP_{word}_DOUBLES {sum(each.get(n, 1) for n in names)}", ""]
    return "\n".join([*lines, "#endif", ""])


def names_source(problem: Problem) -> str:
    """Return ``ergoqp_names.c``."""
    units = [limit.unit for limit in problem.row_limits for _ in limit.names]
    tables = {
        "coordinate_names[ERGOQP_COORDINATES]": problem.coordinates,
        "row_names[ERGOQP_ROWS + 1]": (*problem.row_names, ""),
        "row_units[ERGOQP_ROWS + 1]": (*units, ""),
        f"status_names[{len(Status)}]": [status.name for status in Status],
        "cause_names[ERGOQP_CAUSES]": [cause.name for cause in Cause],
        "fault_names[ERGOQP_FAULTS]": [fault.name for fault in Fault],
        "fault_units[ERGOQP_FAULTS]": [FAULT_UNITS.get(fault, "") for fault in Fault],
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
    """Return any text as a literal of C: UTF-8 bytes, unusual ones in octal."""
    plain = {byte: chr(byte) for byte in range(32, 127) if chr(byte) not in '"\\?'}
    return '"' + "".join(plain.get(byte, f"\\{byte:03o}") for byte in text.encode()) + '"'


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(map(repr, numbers.tolist()))


def defines(source: str) -> dict[str, int]:
    """Return the whole numbers that a header of C defines, by name."""
    lines = map(str.split, source.splitlines())
    return {
        words[1]: int(words[2])
        for words in lines
        if len(words) == 3 and words[0] == "#define" and words[2].isdigit()
    }
