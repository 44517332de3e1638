"""The QP of one control step as data, for a whole-body QP or an MPC of the user's own.

It is taken out of the step itself, by further outputs of the same function. So its numbers are
those with which the step solves, and inputs are read, checked and named as in `ergoqp.Stepper`.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, fields
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_kind, flag
from ergoqp.errors import InputError
from ergoqp.expressions import Evaluator
from ergoqp.limits import AXES
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import infinite
from ergoqp.step.answer import Step
from ergoqp.step.causes import Cause
from ergoqp.step.engine import Engine
from ergoqp.step.function import build_shared_step
from ergoqp.step.model import StepModel
from ergoqp.step.qp import ELBOW, QP_DATA, slack_function
from ergoqp.step.stepper import Stepper

GIVES_WAY: Final = 1e-9
"""Slack from which on a row gives way, in its unit per second; less is rounding of a solver."""

_AFTER: Final = 2**Cause.not_solved | 2**Cause.not_certified
"""Causes that say something of the answer, not of the inputs."""

_READ: Final = ("posture", "observed", "pose", "twist", "dt", "age")
"""Inputs that may be of a wrong kind or shape."""

_KEPT: Final = 4
"""Number of problems whose functions `formulate` keeps."""


@dataclass(frozen=True, eq=False)
class Formulation:
    """The QP of one control step: min 1/2 x'Hx + g'x subject to lower <= A x <= upper.

    The first six unknowns are the twist, at the contact frame and world-aligned. Where no row gives
    way, any solver finds exactly the twist that the step wants in them. `Step.twist` of a
    `Stepper` with the same state and inputs follows from it so:

    1. If the status is ``settled``, the object rests: the step plans the braking twist instead.
    2. The step certifies the whole stop after the twist. If that would leave a limit, the twist is
       shortened toward the braking twist. ``Step.residuals["accepted"]`` is the share that is left:
       1 for the whole twist, 0 for the braking twist (status ``braking``). Where the state has to
       stay on a surface (`forearm`), the twist is also led onto it. The result is the planned
       twist.
    3. The step sends the mean of the planned twists of the last `Control.average` seconds. With
       ``average = 0``, `Step.twist` is the planned twist.

    A row gives way only if braking itself would break it, or if it asks the object back from
    outside. Each such row then has an unknown ``slack of ROW``, at a price that is above every
    multiplier. The twist that the step wants is then that of the answer, cut back to the exact end
    of hard rows, which changes it by up to 2e-6 of its unit.

    Joints at their end yield: the step locks them in the model and solves again, up to twice. The
    QP is that of the last solve, whose answer the step uses.

    Attributes:
        H: curvature of the objective (n, n), symmetric and positive definite [points over the units
            of two unknowns]. Source: `ergoqp.step.objective`.
        g: slope of the objective at x = 0 (n,) [points over the unit of an unknown].
        A: rows (m, n) [unit of the row over that of the unknown]: the rows of the limits that some
            twist can move, then the bounds of the twist, then those of the slack.
        lower: least values of A x (m,), in `units`; -inf where there is no bound.
        upper: greatest values of A x (m,), in `units`; inf where there is no bound.
        rows: names of the rows (m,): those of the limits as in `Problem.row_names`, ``twist x`` to
            ``twist rz``, ``slack of ROW``.
        units: unit of each row (m,), such as ``"rad/s"``.
        unknowns: names of the unknowns (n,): the six `ergoqp.limits.AXES` in the units of a twist
            [m/s, rad/s], then ``slack of ROW`` in the unit of its row.
        gave_way: names of the rows that give way in the step's own answer; usually none.
        gradient: dV/dq at the posture that the step used (coordinates,) [points/rad]; 0 for joints
            that are not seen. `g` also holds comfort and smoothing.
        sensitivity: S, how the posture follows the object (coordinates, 6) [rad/m, rad/rad]; the
            rows of joints that yield are 0 up to 1e-6. Source: `Problem.response`.
        dt: period for which the twist would be sent [s].
        usable: flag, whether there is a QP to solve. False: an input or a term is not usable, or
            something asks the object to brake; `reason` says what. All numbers of the QP, gradient
            and sensitivity are then NaN, so that no solver takes them for a QP. It is True if the
            QP has no answer, or none that is certified: the status is then ``braking``.
        step: what a `Stepper` answers to the same state and inputs. Its twist is certified, and is
            the one to send where this QP is not usable.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> qp = ergoqp.formulate(problem, None, problem.response.comfort)
        >>> qp.H.shape, qp.unknowns, qp.gave_way
        ((6, 6), ('x', 'y', 'z', 'rx', 'ry', 'rz'), ())
        >>> qp.rows[-1], qp.units[-1], len(qp.rows) == len(qp.A)
        ('twist rz', 'rad/s', True)
        >>> ergoqp.formulate(problem, None, None).reason
        'no posture arrived'
    """

    H: np.ndarray
    g: np.ndarray
    A: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rows: tuple[str, ...]
    units: tuple[str, ...]
    unknowns: tuple[str, ...]
    gave_way: tuple[str, ...]
    gradient: np.ndarray
    sensitivity: np.ndarray
    dt: float
    usable: bool
    step: Step

    @property
    def cost(self) -> float:
        """V of the posture that the step used [points]."""
        return self.step.cost

    @property
    def margins(self) -> dict[str, float]:
        """Distance of every row of the limits to its nearer end now, in the unit of the limit.

        It is negative outside, as in `Step.margins`.
        """
        return self.step.margins

    @property
    def status(self) -> str:
        """Status of the step, see `ergoqp.step.causes.Status`."""
        return self.step.status

    @property
    def reason(self) -> str:
        """Why, in one sentence; empty for a plain optimal step."""
        return self.step.reason

    def as_dict(self) -> dict[str, Any]:
        """Return all members but `step` as plain lists, numbers and texts, for JSON.

        JSON has no infinity and no NaN: both become None. A bound of None is no bound.

        Example:
            >>> import json
            >>> import ergoqp
            >>> problem = ergoqp.load_problem("screwing")
            >>> qp = ergoqp.formulate(problem, None, problem.response.comfort)
            >>> len(json.loads(json.dumps(qp.as_dict()))["g"])
            6
        """
        return {name: _plain(getattr(self, name)) for name in _MEMBERS}


_MEMBERS: Final = (
    *(each.name for each in fields(Formulation) if each.name != "step"),
    *("cost", "margins", "status", "reason"),
)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return value if not isinstance(value, float) or np.isfinite(value) else None


class _FormulatedStep(Stepper):
    """A stepper whose function also gives the QP that it solves."""

    def _built(self, solver: Any, engine: Engine | None = None, spare: bool = False) -> ca.Function:
        problem, solver, guided = self.problem, self._solver, self._guided
        return build_shared_step(problem, solver, guided=guided, spare=spare, formulated=True)


class Formulator:
    """`ergoqp.formulate` of one problem, built once.

    Calls from several threads wait for each other.

    Args:
        problem: the task.
        guide: the place that the object is drawn to, as for a `Stepper`: the optimum of
            `ergoqp.optimise`, or a pose (4, 4) [m]. The state is then that of a stepper with a
            guide, and the objective holds its pull. None: descent alone.

    Raises:
        InputError: if `problem` is not a Problem, or the guide cannot be used.
        ProblemError: if the rows or margins of an own limit call Python.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> stepper = ergoqp.Stepper(problem)
        >>> formulator = ergoqp.Formulator(problem)
        >>> posture = problem.response.comfort
        >>> for period in range(3):
        ...     qp = formulator(stepper.state(), posture)
        ...     step = stepper.step(posture)
        >>> qp.status == step.status, qp.margins == step.margins
        (True, True)
    """

    def __init__(self, problem: Problem, guide: Any = None) -> None:
        """Build the function. This takes some tenths of a second."""
        self._stepper = _FormulatedStep(problem, compiled=False, guide=guide)
        self.problem = problem
        limits = [(limit, name) for limit in problem.row_limits for name in limit.names]
        movable = [limits[row] for row in StepModel(problem).movable]
        self._names = tuple(name for _, name in movable)
        turns = "rad/s" if problem.moves_pose else "m/s"
        self._rows = self._names + tuple(f"twist {axis}" for axis in AXES)
        self._units = (*(f"{limit.unit}/s" for limit, _ in movable), *["m/s"] * 3, *[turns] * 3)
        self._with_slack = Evaluator(slack_function(len(movable)))
        self._lock = threading.Lock()

    def __call__(
        self,
        state: Any,
        posture: Any,
        pose: Any = None,
        twist: Any = None,
        *,
        dt: float | None = None,
        age: float = 0.0,
        enable: bool = True,
        observed: Any = None,
    ) -> Formulation:
        """Return the QP of one step.

        Args:
            state: state of the loop before the step (k,), in the units of the step: what
                `Stepper.state` or `ergoqp.initial_state` returns. None: the object stands still and
                nothing is known. It does not change.
            posture: joint angles (32,) [rad], or the values of `Problem.coordinates`. None: no
                frame arrived.
            pose: measured contact frame in the world (4, 4) [m], as in `Stepper.step`. None: that
                of the state, moved on; without one, that of the posture.
            twist: measured twist of the last period (6,) [m/s, rad/s]; it only shows faults of the
                robot. None: none is measured.
            dt: for how long the twist will be executed [s]. None: the period of the problem.
            age: age of the posture [s].
            enable: False: the object has to come to rest, and there is no QP to solve.
            observed: (32,) bool, False for joints that the sensors do not see. None: all are seen.

        Raises:
            InputError: if an argument has a wrong type or shape, or `state` is not one of such a
                loop. Numbers that are not usable (NaN, out of range, too old) raise nothing: see
                `Formulation.usable`.
        """
        enable = flag("enable", enable)
        with self._lock:
            stepper = self._stepper
            if state is None:
                stepper.reset()
            else:
                stepper.restore(state)
            given = {"dt": dt, "age": age, "enable": enable, "observed": observed}
            step = stepper.step(posture, pose, twist, **given)
            for name in _READ:
                if name in step._notes:
                    raise InputError(f"formulate: {step._notes[name]}")
            return self._formulation(step)

    def _formulation(self, step: Step) -> Formulation:
        """Return what the function found."""
        n, names, m = len(self.problem.coordinates), self._names, len(self._names)
        numbers = {name: step.account(name) for name in (*QP_DATA, "S", "slope")}
        usable = not int(step.account("causes")[0]) & ~_AFTER
        loose = np.flatnonzero(numbers["cap"] > 0) if usable else np.arange(0)
        slack = tuple(f"slack of {names[row]}" for row in loose)
        if len(loose):
            kept = [*range(6), *(6 + loose)]
            found = self._with_slack(numbers)
            H, g = found["full_H"][np.ix_(kept, kept)], found["full_g"][kept]
            A, lb, ub = found["full_A"][:, kept], found["full_lb"][kept], found["full_ub"][kept]
        else:
            H, g = numbers["H"].reshape(6, 6).T.copy(), numbers["g"].copy()
            A, lb, ub = numbers["A"].reshape(6, m).T, numbers["lb"], numbers["ub"]
        A = np.vstack([A, np.eye(len(g))])
        lower = infinite(np.concatenate([numbers["lbA"], lb]))
        upper = infinite(np.concatenate([numbers["ubA"], ub]))
        gradient, S = numbers["slope"].copy(), numbers["S"].reshape(6, n).T.copy()
        # A hard row is cut back by the part of its slack that no row needs, see `ELBOW`.
        used, cap = step.account("gave"), numbers["cap"]
        cut = np.where(cap > 0, used - cap + ELBOW, 0.0)
        gave = np.flatnonzero(np.maximum(used, cut) > GIVES_WAY)
        if not usable:
            gave = ()
            for part in (H, g, A, lower, upper, gradient, S):
                part[:] = np.nan
        return Formulation(
            H=H,
            g=g,
            A=A,
            lower=lower,
            upper=upper,
            rows=self._rows + slack,
            units=self._units + tuple(self._units[row] for row in loose),
            unknowns=AXES + slack,
            gave_way=tuple(names[row] for row in gave),
            gradient=gradient,
            sensitivity=S,
            dt=float(step._seen[1]),
            usable=usable,
            step=step,
        )


_kept: list[Formulator] = []
"""Of the problems that `formulate` was asked for last, newest last. It is only replaced as one."""


def formulate(
    problem: Problem,
    state: Any,
    posture: Any,
    pose: Any = None,
    twist: Any = None,
    *,
    dt: float | None = None,
    age: float = 0.0,
    enable: bool = True,
    observed: Any = None,
) -> Formulation:
    """Return the QP of one control step as data: objective, rows and bounds, with their names.

    The first call for a problem builds its function, in some tenths of a second. The functions of
    the last four problems are kept; `ergoqp.Formulator` keeps one for as long as you do.

    Args:
        problem: the task.
        state: state of the loop before the step (k,), in the units of the step: what
            `Stepper.state` or `ergoqp.initial_state` returns. None: the object stands still and
            nothing is known. It does not change.
        posture: joint angles (32,) [rad], or the values of `Problem.coordinates`. None: no frame
            arrived.
        pose: measured contact frame in the world (4, 4) [m], as in `Stepper.step`. None: that of
            the state, moved on; without one, that of the posture.
        twist: measured twist of the last period (6,) [m/s, rad/s]; it only shows faults of the
            robot. None: none is measured.
        dt: for how long the twist will be executed [s]. None: the period of the problem.
        age: age of the posture [s].
        enable: False: the object has to come to rest, and there is no QP to solve.
        observed: (32,) bool, False for joints that the sensors do not see. None: all are seen.

    Returns:
        The `ergoqp.Formulation`: how its answer relates to `Step.twist` is said there.

    Raises:
        InputError: if an argument has a wrong type or shape, or `state` is not one of this problem
            without a guide. Numbers that are not usable (NaN, out of range, too old) raise nothing:
            see `Formulation.usable`.
        ProblemError: if the rows or margins of an own limit call Python.

    Source:
        The price of slack is an exact penalty: Nocedal and Wright, section 17.2.

    Example:
        >>> import numpy as np
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> state = ergoqp.initial_state(problem)
        >>> qp = ergoqp.formulate(problem, state, problem.response.comfort)
        >>> qp.status, qp.A.shape[1], bool((np.linalg.eigvalsh(qp.H) > 0).all())
        ('optimal', 6, True)
    """
    global _kept
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    known = next((each for each in _kept if each.problem is problem), None)
    if known is None:
        known = Formulator(problem)
        _kept = [*_kept, known][-_KEPT:]
    given = {"dt": dt, "age": age, "enable": enable, "observed": observed}
    return known(state, posture, pose, twist, **given)


__all__ = ["Formulation", "Formulator", "formulate"]
