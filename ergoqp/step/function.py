"""The control step as one pure CasADi function.

Inputs are posture, pose and state. Outputs are a certified twist and its account.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from ergoqp.arguments import check_kind, flag, shown
from ergoqp.errors import InputError
from ergoqp.expressions.linear import by_name, is_set, once, scalars, vectors
from ergoqp.native.compiled import compiled as machine_code
from ergoqp.problem.problem import Problem
from ergoqp.solvers import QpSolver, read_solver, solver_named
from ergoqp.step.answer.accounting import account_function
from ergoqp.step.answer.amiss import amiss
from ergoqp.step.answer.causes import Cause
from ergoqp.step.certification import judge_function, shortened
from ergoqp.step.frames_check import FRAMES, compared_frames
from ergoqp.step.guide.pull import GUIDE_INPUTS, GUIDE_OUTPUTS, pull_function
from ergoqp.step.inputs import INPUTS, OUTPUTS, read_inputs
from ergoqp.step.model import StepModel
from ergoqp.step.packing import count, joined, split
from ergoqp.step.program.asked_back import asked_update, still_asks
from ergoqp.step.program.data import away_function
from ergoqp.step.program.locking import solve_passes
from ergoqp.step.program.objective import cost_function, gain_function
from ergoqp.step.rest import stalled
from ergoqp.step.robot_watch.watch import watch
from ergoqp.step.spare import callers
from ergoqp.step.under_way.landing import landing
from ergoqp.step.under_way.motion import UnderWay, next_history, under_way


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
        guided: whether the function has the inputs of a guide, see `ergoqp.step.guide.pull`.

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
    chosen = read_solver(solver)
    if not compiled:
        return build_step(problem, chosen, guided=guided)
    if chosen is not solver_named("daqp"):
        raise InputError(f"compiled: got the solver {shown(solver)}, allowed only 'daqp'")
    if found := callers(problem):
        raise InputError(
            f"compiled: got {', '.join(found)}, which calls Python, allowed expressions without"
            " casadi.Callback"
        )
    return machine_code(lambda native: build_step(problem, native, guided=guided, unrolled=True))


def build_step(
    problem: Problem,
    solver: QpSolver,
    name: str = "step",
    guided: bool = False,
    unrolled: bool = False,
    every_branch: bool = False,
    spare: bool = False,
) -> ca.Function:
    """Return the step as a function of `INPUTS` that gives `OUTPUTS`, by these names.

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
            `ergoqp.step.guide.pull`.
        unrolled: whether every operation is written on its own instead of as vectors. This is the
            fastest form for a compiler and the slowest for an interpreter.
        every_branch: whether it always takes the longer branch. Its answers are those of a step
            only where all are needed; it is for `ergoqp.step.timing`.
        spare: whether no term calls Python, so that the step only brakes, see
            `ergoqp.step.spare`.
    """
    model = StepModel(problem, guided, every_branch, spare)
    shape = scalars if unrolled else vectors
    names = [*INPUTS, *(GUIDE_INPUTS if guided else ())]
    raw = model.symbols(names, ca.MX)
    state = split(model.state, raw["state"])

    # The present pose of the object, and its landing pose.
    found = under_way(model, state["history"], raw["dt"], shape)
    given = state | raw
    if problem.frames.moved:
        given["pose"] = shape(_contact_pose(problem))(raw["pose"])
    known = read_inputs(model, given, found, shape)
    known.setdefault("frames", ca.MX.zeros(count(FRAMES)))
    watched = watch(model, known, shape)
    known |= {name: watched.pop(name) for name in ("causes", "astray")}
    known |= by_name(model.readings, known)
    way = model.way_out(known["readings"])
    if way is not None:
        known["causes"] += 2.0**Cause.no_way_out * is_set(way[4])
    known["usable"] = ca.logic_not(is_set(known["causes"]))
    known |= landing(model, found, known, shape)

    # The QP and its answer.
    known |= by_name(cost_function(model), known)
    known["asks"] = still_asks(state["asked"]) if model.asks_back else ca.MX(1)
    known |= by_name(shape(away_function(model)), known)
    known["stalled"] = stalled(state["rest"])
    if guided:
        known |= by_name(pull_function(model), known)
        if way is not None:
            pulls = way[3] <= 0
            known |= {name: pulls * known[name] for name in ("pull_H", "pull_g")}
    known |= solve_passes(model, solver, known, shape)

    # The part of the answer that is certified and sent.
    known |= by_name(gain_function(model), known)
    known |= by_name(shape(judge_function(model)), known, written=True)
    known["share"] = shortened(model, known)
    known |= amiss(model, known)
    known |= by_name(shape(account_function(model)), known, written=True)
    known["next_state"] = joined(model.state, _next_state(model, found, known | watched))

    known |= {"pose_used": known["pose"], "causes": known["all_causes"], "cost": known["value"]}
    known |= {"slack": known["all_slack"], "multipliers": known["all_multipliers"]}
    known |= {"fault": watched["said"][-2:], "margins": known["now"]}
    outputs = [*OUTPUTS, *(GUIDE_OUTPUTS if guided else ())]
    results = once([known[name] for name in outputs])
    return ca.Function(name, list(raw.values()), results, names, outputs)


def _contact_pose(problem: Problem) -> ca.Function:
    """Return ``flange in the base (4, 4) -> contact frame in the world (4, 4)``."""
    pose, frames = ca.SX.sym("pose", 4, 4), problem.frames
    contact = ca.DM(frames.base) @ pose @ ca.DM(frames.flange)
    return ca.Function("contact_pose", [pose], [ca.densify(contact)])


def _next_state(model: StepModel, found: UnderWay, known: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return the parts of the state that a step hands to the next one."""
    after = {name: known[name] for name in ("compared", "story", "said")}
    history = next_history(
        model, known["history"], found, known["planned"], known["twist"], known["still"]
    )
    after |= {"history": ca.vertcat(*history), "stored": known["pose"], "rest": known["next_rest"]}
    after["started"] = known["next_started"]
    after |= {"last_posture": known["posture"], "on_hold": known["on_hold"]}
    if model.problem.robot.owes:
        seen = ca.logic_or(known["measured"], ca.logic_not(is_set(known["started"])))
        ends = ca.horzcat(found.up, found.down)
        after["unsure"] = ca.if_else(seen, ends, known["unsure"])
    if model.asks_back:
        limits = model.problem.row_limits
        after["asked"] = asked_update(limits, known["asked"], known["now"], known["dt"])
    if model.compares:
        compared = {**known, "period": found.dt}
        after["frames"] = (
            known["frames"] if model.spare else compared_frames(model.problem, compared)
        )
    if model.guided:
        after["trial"] = known["next_trial"]
    return after
