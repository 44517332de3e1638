"""The control step as one pure CasADi function.

Posture, pose and last twist go in; a certified twist and its account come out.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from ergoqp.arguments import check_kind, flag
from ergoqp.errors import InputError
from ergoqp.expressions.linear import by_name, is_set, once, scalars, vectors
from ergoqp.native.compiled import compiled as machine_code
from ergoqp.problem.problem import Problem
from ergoqp.solvers import QpSolver, solver_named
from ergoqp.step.answer.accounting import account_function
from ergoqp.step.certification import judge_function, shortened
from ergoqp.step.guide.pull import GUIDE_INPUTS, GUIDE_OUTPUTS, pull_function
from ergoqp.step.inputs import INPUTS, OUTPUTS, read_inputs
from ergoqp.step.model import StepModel
from ergoqp.step.packing import joined, split
from ergoqp.step.program.asked_back import asked_update, still_asks
from ergoqp.step.program.data import away_function
from ergoqp.step.program.locking import solve_passes
from ergoqp.step.program.objective import cost_function, gain_function
from ergoqp.step.rest import stalled
from ergoqp.step.robot_watch.watch import watch
from ergoqp.step.under_way.landing import landing
from ergoqp.step.under_way.motion import UnderWay, next_history, under_way


def step_function(
    problem: Problem, solver: str = "daqp", compiled: bool = False, *, guided: bool = False
) -> ca.Function:
    """Return the whole control step of a problem as one pure CasADi function; see `build_step`.

    Args:
        problem: the task.
        solver: name of the QP solver, see `ergoqp.solvers`.
        compiled: through the C compiler into the user's cache; the solver is then DAQP.
        guided: with the inputs of a step that can be drawn toward a given place, see
            `ergoqp.step.guide.pull`.

    Raises:
        InputError: if the problem is none, a flag is none, or the solver is unknown, or not the one
            that is compiled.
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
    chosen = solver_named(solver)
    if not compiled:
        return build_step(problem, chosen, guided=guided)
    if chosen.name != "daqp":
        raise InputError(f"compiled: got the solver {solver!r}, allowed only 'daqp'")
    return machine_code(lambda native: build_step(problem, native, guided=guided, unrolled=True))


def build_step(
    problem: Problem,
    solver: QpSolver,
    name: str = "step",
    guided: bool = False,
    unrolled: bool = False,
) -> ca.Function:
    """Return the step as a function of `INPUTS`, giving `OUTPUTS`, by these names.

    Inputs that may be absent come with a flag (``has_pose``, ``has_twist``, ``frame``, ``enable``:
    0 or 1); ``ask`` is 1 when only the braking twist is wanted. All state is passed in and out, see
    `ergoqp.step.state`: the same inputs give the same outputs, always.

    ``residuals`` holds the QP's largest residual, the contact motion that the posture cannot follow
    [m/s, rad/s in one norm] and the share of the way from braking to the QP's answer that was
    accepted.

    Args:
        problem: the task.
        solver: of the QP.
        name: of the function.
        guided: whether the step can be drawn toward a given place: it then has `GUIDE_INPUTS` and
            `GUIDE_OUTPUTS` too, and is the same step to the last bit where ``guided`` is 0. See
            `ergoqp.step.guide.pull`.
        unrolled: every operation on its own instead of vectors: what a compiler makes the fastest
            code of, and an interpreter the slowest.
    """
    model, shape = StepModel(problem, guided), scalars if unrolled else vectors
    names = [*INPUTS, *(GUIDE_INPUTS if guided else ())]
    raw = model.symbols(names, ca.MX)
    state = split(model.state, raw["state"])

    # What the step goes by: where the object is, and where it lands.
    found = under_way(model, state["history"], raw["dt"], shape)
    known = read_inputs(model, state | raw, found, shape)
    watched = watch(model, known, shape)
    known["causes"] = watched.pop("causes")
    known["usable"] = ca.logic_not(is_set(known["causes"]))
    known |= landing(model, found, known, shape)

    # What the QP asks, and its answer.
    known |= by_name(cost_function(model), known)
    known |= by_name(model.readings, known)
    known["asks"] = still_asks(state["asked"]) if model.asks_back else ca.MX(1)
    known |= by_name(shape(away_function(model)), known)
    known["stalled"] = stalled(state["rest"])
    if guided:
        known |= by_name(pull_function(model), known)
    known |= solve_passes(model, solver, known, shape)

    # What of it is certified, and is sent.
    known |= by_name(gain_function(model), known)
    known |= by_name(shape(judge_function(model)), known, written=True)
    known["share"] = shortened(model, known)
    known |= by_name(shape(account_function(model)), known, written=True)
    known["next_state"] = joined(model.state, _next_state(model, found, known | watched))

    known |= {"pose_used": known["pose"], "causes": known["all_causes"], "cost": known["value"]}
    known |= {"slack": known["all_slack"], "multipliers": known["all_multipliers"]}
    known |= {"fault": watched["said"][-2:], "margins": known["now"]}
    outputs = [*OUTPUTS, *(GUIDE_OUTPUTS if guided else ())]
    results = once([known[name] for name in outputs])
    return ca.Function(name, list(raw.values()), results, names, outputs)


def _next_state(model: StepModel, found: UnderWay, known: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return the parts of the state that a step leaves to the next."""
    after = {name: known[name] for name in ("compared", "story", "said")}
    history = next_history(
        model, known["history"], found, known["planned"], known["twist"], known["still"]
    )
    after |= {"history": ca.vertcat(*history), "stored": known["pose"], "rest": known["next_rest"]}
    after |= {"started": known["next_started"], "account": known["next_account"]}
    if model.problem.robot.owes:
        seen = ca.logic_or(known["measured"], ca.logic_not(is_set(known["started"])))
        ends = ca.horzcat(found.up, found.down)
        after["unsure"] = ca.if_else(seen, ends, known["unsure"])
    if model.asks_back:
        limits = model.problem.row_limits
        after["asked"] = asked_update(limits, known["asked"], known["now"], known["dt"])
    if model.guided:
        after["trial"] = known["next_trial"]
    return after
