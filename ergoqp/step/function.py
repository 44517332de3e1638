"""The control step as one pure CasADi function: inputs, state, and all parts.

Inputs are posture, pose and state; they are checked before anything is computed. Outputs are a
certified twist and its account. The state that one step hands to the next is one vector, and the
same inputs and the same state always give the same answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_kind, flag, of_package, read_array, shown
from ergoqp.errors import InputError
from ergoqp.expressions import (
    Shape,
    call_by_name,
    exp_rotation,
    is_rigid,
    is_set,
    normalised,
    once,
    scalars,
    vectors,
)
from ergoqp.problem.problem import Problem
from ergoqp.solvers import QpSolver, read_solver
from ergoqp.solvers.daqp import Daqp
from ergoqp.step.answer import account_function, rate_function
from ergoqp.step.causes import Cause
from ergoqp.step.certification import amiss, judge_function, shortened
from ergoqp.step.constants import constants_of
from ergoqp.step.delay import landing, next_history, under_way
from ergoqp.step.faults import taken_over, watch
from ergoqp.step.frames_check import BEYOND, compared_frames
from ergoqp.step.guide import GUIDE_INPUTS, GUIDE_OUTPUTS, pull_function
from ergoqp.step.layout import CLOCK_ROUNDING, FRAMES, count, initial_history, joined, split
from ergoqp.step.model import StepModel, callers
from ergoqp.step.objective import cost_function, gain_function
from ergoqp.step.qp import QP_DATA, away_function, solve_passes
from ergoqp.step.rest import stalled
from ergoqp.step.rows import update_recovery_timer


def initial_state(problem: Problem, twist: Any = None, *, guided: bool = False) -> np.ndarray:
    """Return the state (n,) at the start of a loop: the input ``state`` of `step_function`.

    The state is all that a step leaves to the next: the twists of the last periods with their ages,
    the pose and what of the motion is still under way, the last posture, whether the loop is on
    hold, the state of rest, the comparison of the robot with what it was sent, the time for which
    the posture has asked the object back, and what was learned about the guide. The order of the
    entries may change from version to version.

    Args:
        problem: the task.
        twist: twist (6,) with which the object moves already [m/s, rad/s], clipped to the speed
            limits. None: the object stands still.
        guided: whether the state is that of a step with a guide.

    Returns:
        The entries (n,), in the units of the step: metres, radians, seconds.

    Raises:
        InputError: if `problem` is not a Problem, `twist` is not six finite numbers, or `guided` is
            not a bool.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> state = ergoqp.initial_state(problem)
        >>> state.shape == ergoqp.step_function(problem).size_in("state")[:1]
        True
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    return state_at_start(StepModel(problem, flag("guided", guided)), twist)


def state_at_start(model: StepModel, twist: Any = None) -> np.ndarray:
    """Return the initial state of a step, see `initial_state`."""
    if twist is not None:
        speed = model.problem.twist_limit.speed
        twist = np.clip(read_array("twist", twist, (6,), "6 finite numbers"), -speed, speed)
    parts = {name: np.zeros(size) for name, size in model.state.items()}
    history = initial_history(model.history, np.zeros(6) if twist is None else twist)
    parts["history"] = np.concatenate([part.ravel(order="F") for part in history.values()])
    if twist is not None:
        for name, block in taken_over(model, twist).items():
            parts[name] = block[:, None]
    return np.concatenate([part.ravel(order="F") for part in parts.values()])


INPUTS: Final = (
    "posture",
    "observed",
    "pose",
    "has_pose",
    "executed",
    "has_twist",
    "dt",
    "age",
    "frame",
    "enable",
    "ask",
    "state",
)

OUTPUTS: Final = (
    "twist",
    "pose_used",
    "next_state",
    "posture_rate",
    "status",
    "causes",
    "fault",
    "frames",
    "cost",
    "gain",
    "margins",
    "slack",
    "multipliers",
    "locked",
    "outside",
    "residuals",
    "astray",
    "amiss",
)

FORMULATED: Final = (*QP_DATA, "S", "slope", "gave")
"""Further outputs of a step that gives its QP too, see `build_step`."""


def read_inputs(
    model: StepModel, given: Mapping[str, ca.MX], found: Mapping[str, ca.MX], shape: Shape
) -> dict[str, ca.MX]:
    """Check every input, and replace unusable ones by what was known before.

    So no NaN goes further.

    Args:
        model: model of the step.
        given: `INPUTS` as they came, and the parts of the state.
        found: the motion under way.
        shape: how functions are written, see `ergoqp.expressions`.

    Returns:
        The usable numbers for the step: ``posture``; ``pose`` as measured, or as far as it is
        known; ``previous``, the twist that was planned last; ``dt``; whether a pose was
        ``measured``; whether a pose is known from now on (``next_started``); whether a twist is
        ``told``; whether posture and pose can be compared (``compares``); whether the object has to
        ``stop``; ``causes`` why the step can only brake, by `Cause`; and everything else that was
        given.
    """
    seen = is_set(given["observed"])
    last = ca.if_else(is_set(given["frame"]), given["posture"], given["last_posture"])
    usable = ca.logic_and(seen, ca.fabs(last) <= model.problem.response.largest)
    posture = ca.if_else(usable, last, given["task_stand_in"])
    # Every entry is unseen or plausible.
    posture_ok = ca.sum1(usable - seen) > -0.5
    signals = {**given, **found, "dt": found["period"], "posture_ok": posture_ok}
    read = call_by_name(shape(_read_function(model)), signals, written=True)
    pose = _pose(model, given, read["measured"], read["moved"], posture)
    signals |= read | {"posture": posture, "pose": pose}
    if not of_package(model.problem.response):
        # Without a usable contact frame the pose stays unknown, see `_pose`.
        placed = pose[3, 3]
        signals["next_started"] *= placed
        signals["causes"] += 2.0**Cause.term * (1 - placed)
    if model.problem.robot.owes:
        # When the object was measured last, any share of the motion under way may have been done
        # already. It is integrated as if none was.
        signals["doubt"] = ca.if_else(read["measured"], 0, given["unsure"])
    return signals


def _read_function(model: StepModel) -> ca.Function:
    """Check all inputs except the posture.

    Returns:
        Function that gives ``moved``, the displacement of the last period as far as it is known,
        and the other results of `read_inputs`.
    """
    problem = model.problem
    raw = model.symbols()
    has_pose, has_twist, started, frame = (
        is_set(raw[name]) for name in ("has_pose", "has_twist", "started", "frame")
    )
    pose_ok, twist_ok = is_rigid(raw["pose"]), ca.sumsqr(raw["executed"]) < 1e4
    age_ok, fresh = raw["age"] >= -CLOCK_ROUNDING, raw["age"] <= raw["control_max_age"]
    measured, told = ca.logic_and(has_pose, pose_ok), ca.logic_and(has_twist, twist_ok)

    # What was sent is integrated, and never the noisy report: see `ergoqp.step.faults`.
    moved = raw["sent"] * raw["lasted"] + raw["changed"]
    anchors = ca.logic_or(measured, ca.logic_and(frame, raw["posture_ok"]))
    unmeasured = ca.logic_and(problem.robot.needs_pose, ca.logic_not(measured))
    disabled = ca.logic_or(ca.logic_not(is_set(raw["enable"])), is_set(raw["on_hold"]))
    bad = {
        Cause.posture: ca.logic_and(ca.logic_not(raw["posture_ok"]), frame),
        Cause.pose: ca.logic_and(has_pose, ca.logic_not(pose_ok)),
        Cause.twist: ca.logic_and(has_twist, ca.logic_not(twist_ok)),
        Cause.dt: ca.logic_not(raw["dt_ok"]),
        Cause.age: ca.logic_not(age_ok),
        Cause.disabled: disabled,
        Cause.no_frame: ca.logic_not(frame),
        Cause.too_old: ca.logic_and(age_ok, ca.logic_not(fresh)),
        Cause.unmeasured: unmeasured,
        Cause.asked: is_set(raw["ask"]),
        Cause.long_period: raw["period"] > raw["task_longest_period"] * (1 + 1e-9),
        Cause.short_periods: ca.logic_not(raw["fits"]),
    }
    if model.compares:
        bad[Cause.frames] = split(FRAMES, raw["frames"])["beyond"] >= BEYOND
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    outputs = {
        "moved": moved,
        "next_started": ca.logic_or(started, anchors),
        "measured": measured,
        "told": told,
        "stop": ca.logic_or(disabled, unmeasured),
        "causes": causes,
    }
    if model.compares:
        sees = ca.logic_and(ca.logic_and(frame, raw["posture_ok"]), fresh)
        waited = split(FRAMES, raw["frames"])["wait"] <= 1e-9
        outputs["compares"] = ca.logic_and(ca.logic_and(measured, sees), waited)
    return raw.function("read", outputs)


def _pose(
    model: StepModel, given: Mapping[str, ca.MX], measured: ca.MX, moved: ca.MX, posture: ca.MX
) -> ca.MX:
    """Return the measured pose, or the last one moved on.

    At the first step it is the contact frame of the posture.
    """
    sx = ca.SX.sym("stored", 4, 4), ca.SX.sym("moved", 6)
    on = ca.Function("moved_on", sx, [exp_rotation(*sx)])
    sizes = {"pose": (4, 4), "started": (1, 1), "stored": (4, 4), "moved": (6, 1)}
    sizes["posture"] = (posture.numel(), 1)
    constants = model.contact_names
    inputs = [ca.MX.sym(name, *size) for name, size in sizes.items()]
    inputs += [ca.MX.sym(name, *model.size(name)) for name in constants]
    first = model.contact(dict(zip(constants, inputs[5:], strict=True)), inputs[4])
    if not of_package(model.problem.response):
        # A matrix of zeros stands for a pose that is not usable.
        rigid = ca.Function("rigid", [sx[0]], [is_rigid(sx[0])])(first)
        first = ca.if_else(rigid, first, 0)
    by_posture = ca.Function("by_posture", inputs, [ca.densify(first)])
    followed = ca.Function("followed", inputs, [ca.densify(on(inputs[2], inputs[3]))])
    integrated = ca.Function.if_else("integrated", followed, by_posture)(inputs[1], *inputs)
    unmeasured = ca.Function("unmeasured", inputs, [integrated])
    exact = ca.Function("exact", [sx[0]], [ca.densify(normalised(sx[0]))])
    as_measured = ca.Function("as_measured", inputs, [exact(inputs[0])])
    known = (given["pose"], given["started"], given["stored"], moved, posture)
    choose = ca.Function.if_else("pose_known", as_measured, unmeasured)
    return choose(measured, *known, *(given[name] for name in constants))


def step_function(
    problem: Problem,
    solver: str | QpSolver = "daqp",
    compiled: bool = False,
    *,
    guided: bool = False,
) -> ca.Function:
    """Return the whole control step of a problem as one pure CasADi function; see `build_step`.

    Args:
        problem: the task.
        solver: name of the QP solver, see `ergoqp.solvers`, or a `QpSolver` of your own.
        compiled: whether to compile the step with the C compiler, into the user's cache. The solver
            must be DAQP.
        guided: whether the function has the inputs of a guide, see `ergoqp.step.guide`.

    Raises:
        InputError: if `problem` is not a Problem, a flag is not a bool, the solver is unknown, or
            the step is compiled with another solver than DAQP or with a term that calls Python.
        CompilerError: if there is no C compiler.

    Source:
        The penalty of slack is exact: Nocedal and Wright, section 17.2.

    Example:
        >>> import ergoqp
        >>> function = ergoqp.step_function(ergoqp.load_problem("screwing"))
        >>> function.size_in("posture"), function.size_out("twist")
        ((32, 1), (6, 1))
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    compiled, guided = flag("compiled", compiled), flag("guided", guided)
    shared = shared_step(problem, solver, compiled, guided=guided)
    return bound_step(problem, shared, "step", guided)


def shared_step(
    problem: Problem,
    solver: str | QpSolver = "daqp",
    compiled: bool = False,
    *,
    guided: bool = False,
) -> ca.Function:
    """Return `step_function` with the numbers of the problem as further inputs.

    It is that of all problems of this structure, see `ergoqp.step.constants`. The arguments and
    errors are those of `step_function`.
    """
    chosen = read_solver(solver)
    if not compiled:
        return build_shared_step(problem, chosen, guided=guided)
    if type(chosen) is not Daqp:
        raise InputError(f"compiled: got the solver {shown(solver)}, allowed only 'daqp'")
    if found := callers(problem):
        raise InputError(
            f"compiled: got {', '.join(found)}, which calls Python, allowed expressions without"
            " casadi.Callback"
        )
    from ergoqp.native.compiled import compiled as machine_code

    return machine_code(
        lambda native: build_shared_step(problem, native, guided=guided, unrolled=True)
    )


def build_step(
    problem: Problem,
    solver: QpSolver,
    name: str = "step",
    guided: bool = False,
    unrolled: bool = False,
    every_branch: bool = False,
    formulated: bool = False,
) -> ca.Function:
    """Return `build_shared_step` with the numbers of the problem, a function of `INPUTS`."""
    shared = build_shared_step(
        problem,
        solver,
        "shared_step",
        guided=guided,
        unrolled=unrolled,
        every_branch=every_branch,
        formulated=formulated,
    )
    return bound_step(problem, shared, name, guided)


def bound_step(problem: Problem, shared: ca.Function, name: str, guided: bool) -> ca.Function:
    """Return a step of a structure with the numbers of a problem of it, see `shared_step`."""
    constants = constants_of(problem)
    names = [*INPUTS, *(GUIDE_INPUTS if guided else ())]
    inputs = {each: ca.MX.sym(each, *shared.size_in(each)) for each in names}
    known = inputs | {each: ca.MX(ca.DM(value)) for each, value in constants.items()}
    outputs = call_by_name(shared, known)
    return ca.Function(name, list(inputs.values()), list(outputs.values()), names, list(outputs))


def build_shared_step(
    problem: Problem,
    solver: QpSolver,
    name: str = "step",
    guided: bool = False,
    unrolled: bool = False,
    every_branch: bool = False,
    spare: bool = False,
    formulated: bool = False,
) -> ca.Function:
    """Return the step as a function of `INPUTS` that gives `OUTPUTS`, by these names.

    The numbers of the problem are further inputs, by the names of `constants_of`.

    Inputs that may be absent have a flag (``has_pose``, ``has_twist``, ``frame``, ``enable``: 0 or
    1). ``ask`` is 1 if only the braking twist is wanted. The whole state is an input and an output,
    see `ergoqp.initial_state`. So the same inputs always give the same outputs.

    ``residuals`` holds the largest residual of the QP, the contact motion that the posture cannot
    follow [m/s, rad/s in one norm], and the accepted share of the way from braking to the QP's
    answer.

    Args:
        problem: the task.
        solver: solver of the QP.
        name: name of the function.
        guided: whether the step can be drawn to a guide. It then has `GUIDE_INPUTS` and
            `GUIDE_OUTPUTS` too. Where ``guided`` is 0, it gives the same step to the last bit. See
            `ergoqp.step.guide`.
        unrolled: whether every operation is written on its own instead of as vectors. This is the
            fastest form for a compiler and the slowest for an interpreter.
        every_branch: whether it always takes the longer branch. Its answers are those of a step
            only where all are needed; it is for `ergoqp.step.timing`.
        spare: whether no term calls Python, so that the step only brakes, see
            `ergoqp.step.model`.
        formulated: whether it has the outputs `FORMULATED` too: the QP of the pass whose answer is
            used, S of that pass, the gradient of V, and the slack of the rows of the QP. The step
            itself is the same to the last bit.
    """
    model = StepModel(problem, guided, every_branch, spare, shared=True)
    shape = scalars if unrolled else vectors
    names = [*INPUTS, *(GUIDE_INPUTS if guided else ()), *model.constants]
    raw = model.symbols(names, ca.MX)
    state = split(model.state, raw["state"])

    # The present pose of the object, and its landing pose.
    found = under_way(model, state["history"], raw["dt"], shape, raw)
    given = state | raw
    if problem.frames.moved:
        given["pose"] = call_by_name(shape(_contact_pose(model)), raw)["contact"]
    signals = read_inputs(model, given, found, shape)
    signals.setdefault("frames", ca.MX.zeros(count(FRAMES)))
    watched = watch(model, signals, shape)
    signals |= {name: watched.pop(name) for name in ("causes", "astray")}
    signals |= call_by_name(model.readings, signals)
    way = model.way_out(signals["readings"])
    if way is not None:
        signals["causes"] += 2.0**Cause.no_way_out * is_set(way[4])
    signals["usable"] = ca.logic_not(is_set(signals["causes"]))
    signals |= landing(model, found, signals, shape)

    # The QP and its answer.
    signals |= call_by_name(cost_function(model, formulated), signals)
    # Rows of the posture may ask to come back while the seconds asked for are within those allowed.
    signals["asks"] = state["asked"][0] <= state["asked"][1] if model.asks_back else ca.MX(1)
    signals |= call_by_name(shape(away_function(model)), signals)
    signals["stalled"] = stalled(state["rest"])
    if guided:
        signals |= call_by_name(pull_function(model), signals)
        if way is not None:
            pulls = way[3] <= 0
            signals |= {name: pulls * signals[name] for name in ("pull_H", "pull_g")}
    signals |= solve_passes(model, solver, signals, shape, formulated)
    signals["gave"] = signals["slack"]

    # The part of the answer that is certified and sent.
    signals |= call_by_name(gain_function(model), signals)
    signals |= call_by_name(judge_function(model), signals, written=True)
    signals["share"] = shortened(model, signals)
    signals |= amiss(model, signals)
    signals |= call_by_name(shape(account_function(model)), signals, written=True)
    signals |= call_by_name(rate_function(model), signals, written=True)
    signals["next_state"] = joined(model.state, _next_state(model, signals | watched))

    signals |= {"pose_used": signals["pose"], "causes": signals["all_causes"]}
    signals |= {"cost": signals["value"], "margins": signals["now"], "fault": watched["said"][-2:]}
    signals |= {name: signals[f"all_{name}"] for name in ("slack", "multipliers")}
    outputs = [*OUTPUTS, *(GUIDE_OUTPUTS if guided else ()), *(FORMULATED if formulated else ())]
    results = once([signals[name] for name in outputs])
    return ca.Function(name, list(raw.values()), results, names, outputs)


def _contact_pose(model: StepModel) -> ca.Function:
    """Return ``flange in the base (4, 4) -> contact frame in the world (4, 4)``."""
    sx = model.symbols(("pose",))
    contact = sx["robot_base"] @ sx["pose"] @ sx["robot_flange"]
    return sx.function("contact_pose", {"contact": contact})


def _next_state(model: StepModel, signals: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return the parts of the state that a step hands to the next one."""
    after = {name: signals[name] for name in ("compared", "story", "said", "on_hold")}
    sent = (signals[name] for name in ("planned", "twist", "still"))
    after["history"] = ca.vertcat(*next_history(model, signals["history"], signals, *sent))
    after |= {"stored": signals["pose"], "started": signals["next_started"]}
    after |= {"last_posture": signals["posture"], "rest": signals["next_rest"]}
    if model.problem.robot.owes:
        seen = ca.logic_or(signals["measured"], ca.logic_not(is_set(signals["started"])))
        ends = ca.horzcat(signals["up"], signals["down"])
        after["unsure"] = ca.if_else(seen, ends, signals["unsure"])
    if model.asks_back:
        limits = model.problem.row_limits
        now, dt = signals["now"], signals["dt"]
        numbers = signals["rows_tolerance"], signals["rows_recovery_time"]
        after["asked"] = update_recovery_timer(limits, signals["asked"], now, dt, numbers)
    if model.compares:
        spare = model.spare
        after["frames"] = signals["frames"] if spare else compared_frames(model, signals)
    if model.guided:
        after["trial"] = signals["next_trial"]
    return after
