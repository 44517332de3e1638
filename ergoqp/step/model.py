"""What the functions of a control step share, and the step without users' Python code.

The step without what users' Python code computes, for the moment in which that code raises. Most
terms are expressions, in which nothing can be raised. But an expression may call Python, through
`casadi.Callback`, in a cost, in a response, and in the `measure` of a limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import takewhile
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import of_package
from ergoqp.errors import ProblemError
from ergoqp.expressions import Evaluator, Shape, slices, vectors, written_out
from ergoqp.limits import Limit, LimitContext
from ergoqp.limits.limit import Expression, with_symbols
from ergoqp.limits.twist_and_stopping import Braking, Stop
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import SOLVER, interrupted
from ergoqp.step.constants import Constants, constants_of, prefix_of, shares
from ergoqp.step.layout import (
    ASTRAY,
    FRAMES,
    History,
    PendingMotionLayout,
    Sizes,
    count,
    places,
    watch_blocks,
)
from ergoqp.step.rest import STATES, TRIAL
from ergoqp.step.rows import limit_values, movable_rows

_CALLBACK: Final = "CallbackInternal"
"""What CasADi calls a function that is written in Python."""


def callers(problem: Problem) -> list[str]:
    """Return the terms of a problem that may call Python, in words."""
    cost, response, limits = problem.cost, problem.response, problem.row_limits
    found = []
    if not of_package(cost):
        q = ca.MX.sym("q", len(problem.coordinates))
        function = ca.Function("cost", [q], [cost.expression(q)])
        if getattr(cost, "dense", False) or calls_python(function):
            found.append(f"cost: {cost.name}")
    if not of_package(response) and calls_python(response.contact(), response.sensitivity()):
        found.append(f"response: {type(response).__name__}")
    return found + [
        f"limits: {limit.names[0]}"
        for limit in limits
        if not of_package(limit) and limit.measure() is not None
    ]


def check_spare(spare: ca.Function) -> None:
    """Check that no row or margin of a limit calls Python: it could raise an error in every step.

    Args:
        spare: a step in which nothing else does, except its solver.

    Raises:
        ProblemError: if one does.
    """
    for part in spare.find_functions():
        if part.class_name() == _CALLBACK and part.name() != SOLVER:
            raise ProblemError(
                f"limits: got rows or margins that call {part.name()!r} in Python, allowed"
                " expressions; what calls Python belongs into the measure of the limit"
            )


def calls_python(*functions: ca.Function) -> bool:
    """Return whether a function contains a `casadi.Callback`."""
    found = [part for function in functions for part in (function, *function.find_functions())]
    return any(part.class_name() == _CALLBACK for part in found)


class NoResponse:
    """A response that gives no numbers: its contact is no pose, and its sensitivity is NaN.

    Args:
        response: the response whose place it takes.
    """

    def __init__(self, response: Any) -> None:
        """Keep the response, for its sizes."""
        self._response = response

    def contact(self) -> ca.Function:
        """Return zeros instead of the contact frame."""
        return _constant(self._response.contact(), 0.0)

    def sensitivity(self) -> ca.Function:
        """Return NaN in every entry."""
        return _constant(self._response.sensitivity(), float("nan"))


def _constant(function: ca.Function, value: float) -> ca.Function:
    """Return a function of the same inputs and sizes that gives one number in every entry."""
    count = function.n_out()
    parts = [ca.SX(value) * ca.SX.ones(*function.size_out(i)) for i in range(count)]
    names = [function.name_out(i) for i in range(count)]
    return ca.Function(function.name(), function.sx_in(), parts, function.name_in(), names)


def guarded(
    call: Callable[[], object], evaluator: Evaluator, spare: ca.Function, raised: list[str]
) -> Callable[[], None]:
    """Return a call of the step that takes the answer of another step if it raises.

    Args:
        call: evaluates the step.
        evaluator: the step, with its inputs and results.
        spare: the step in which these terms give no numbers, so that it brakes.
        raised: holds the error of the last call in words; empty if there was none.
    """
    instead = Evaluator(spare)

    def called() -> None:
        raised.clear()
        try:
            call()
        except Exception as error:  # any error in the code of a user's term
            if interrupted(error):
                raise KeyboardInterrupt from None
            for name, values in evaluator.inputs.items():
                instead.inputs[name][:] = values
            instead.evaluate()
            evaluator.results[:] = instead.results
            # CasADi puts the place in front of the words of the error.
            words = (str(error).strip().splitlines() or [""])[-1].split(": ", 1)[-1]
            raised.append(f"an error ({words[:120]})")

    return called


class Signals(dict[str, Any]):
    """Symbols of what the functions of the step exchange, each made when it is first used.

    So a function takes what its expressions read. Entries that are set are no inputs, and neither
    are `numbers`, which are written into the expressions.

    Attributes:
        inputs: the symbols, in the order in which they were made.
    """

    def __init__(
        self,
        size: Callable[[str], tuple[int, int]],
        names: Iterable[str],
        kind: type[Any],
        numbers: Constants | None = None,
    ) -> None:
        """Make the symbols of some names at once."""
        super().__init__()
        self._size, self._kind, self.inputs = size, kind, dict[str, Any]()
        self._numbers = numbers or {}
        self.pick(names)

    def __missing__(self, name: str) -> Any:
        """Make the symbol of a name."""
        if name in self._numbers:
            self[name] = self._kind(ca.DM(self._numbers[name]))
        else:
            self[name] = self.inputs[name] = self._kind.sym(name, *self._size(name))
        return self[name]

    def of(self, part: str, **known: Any) -> Any:
        """Return the constants of a part of the problem as attributes, see `constants_of`.

        Args:
            part: what their names begin with.
            known: attributes that are something else.
        """
        return _Part(self, part, known)

    def pick(self, names: Iterable[str]) -> dict[str, Any]:
        """Return some of the symbols, by name."""
        return {name: self[name] for name in names}

    def function(self, name: str, outputs: Mapping[str, Any]) -> ca.Function:
        """Return the dense function of the symbols that gives `outputs`, by name."""
        parts: Any = [ca.densify(self._kind(part)) for part in outputs.values()]
        parts = ca.cse(parts) if self._kind is ca.SX else parts
        inputs = self.inputs
        return ca.Function(name, list(inputs.values()), parts, list(inputs), list(outputs))


class _Part:
    """Constants of a part of the problem, each an attribute that is read when it is first used."""

    def __init__(self, signals: Mapping[str, Any], part: str, known: Mapping[str, Any]) -> None:
        """Set what is known."""
        self._signals, self._name = signals, part
        vars(self).update(known)

    def __getattr__(self, name: str) -> Any:
        """Return a constant."""
        if name.startswith("__"):
            raise AttributeError(name)
        return self._signals[f"{self._name}_{name}"]


PLACE = ("posture", "observed", "readings", "landed", "way", "previous", "dt")
"""Landing pose, and the data at the start of the present period."""


@dataclass(frozen=True, eq=False)
class StepModel:
    """The fixed properties of the control step of a problem.

    Attributes:
        problem: the task.
        guided: whether the step can be drawn to a guide.
        every_branch: whether the step takes every branch, to be timed; see
            `ergoqp.step.timing`.
        spare: whether cost, readings and a response that calls Python give no numbers, see
            `ergoqp.step.model`.
        shared: whether the numbers of the problem are inputs of the functions, so that they serve
            all problems of its structure, see `ergoqp.step.constants`. Otherwise they are written
            into the functions.
    """

    problem: Problem
    guided: bool = False
    every_branch: bool = False
    spare: bool = False
    shared: bool = False

    @cached_property
    def constants(self) -> Constants:
        """The numbers of the problem that are inputs of the functions if these are `shared`."""
        return constants_of(self.problem)

    def usual(self, size: int, at: Mapping[str, slice]) -> np.ndarray:
        """Return the usual inputs of a step but its constants, one after the other.

        Args:
            size: number of their entries.
            at: their places by name.
        """
        given = np.zeros(size)
        for name in ("observed", "frame", "enable"):
            given[at[name]] = 1.0
        given[at["dt"]] = self.problem.dt
        return given

    def fill(self, given: np.ndarray, at: Mapping[str, slice]) -> int:
        """Write the constants to the inputs of a step; return how many entries come before them.

        Args:
            given: all inputs, one after the other.
            at: their places by name.
        """
        # A function may have the numbers of its problem in itself.
        inputs = [name for name in self.constants if name in at]
        for name in inputs:
            given[at[name]] = self.constants[name].ravel(order="F")
        return at[inputs[0]].start if inputs else given.size

    def if_needed(self, needed: ca.MX) -> ca.MX:
        """Return the condition of a branch that takes longer than the other."""
        return ca.MX(1) if self.every_branch else needed

    @cached_property
    def response(self) -> Any:
        """The response that gives the numbers of a step."""
        response = self.problem.response
        if not self.spare or not calls_python(response.contact(), response.sensitivity()):
            return response
        return NoResponse(response)

    @cached_property
    def history(self) -> History:
        """Size of the history that the step keeps."""
        return History(self.problem)

    @cached_property
    def blocks(self) -> dict[str, Sizes]:
        """The blocks of the state that watch the robot, and their parts."""
        return watch_blocks(self.problem)

    @cached_property
    def under_way(self) -> PendingMotionLayout:
        """The parts of the vector ``way``."""
        return PendingMotionLayout(self.problem)

    @cached_property
    def asks_back(self) -> bool:
        """Whether some row of the person's posture may ask the object to come back."""
        return any(not limit.hard and any(limit.recovers) for limit in self.problem.row_limits)

    @property
    def compares(self) -> bool:
        """Whether posture and pose are compared, see `ergoqp.step.frames_check`."""
        return self.problem.moves_pose and self.problem.frames.compare

    @cached_property
    def state(self) -> Sizes:
        """Shape of every part of the state, in order."""
        sizes = {"history": (count(self.history.sizes), 1), "stored": (4, 4), "started": (1, 1)}
        # The posture stays in use while no frame arrives.
        sizes |= {"last_posture": (len(self.problem.coordinates), 1), "on_hold": (1, 1)}
        sizes |= {"rest": (STATES, 1)}
        sizes |= {name: (count(block), 1) for name, block in self.blocks.items()}
        if self.problem.robot.owes:
            # How far the object may be from its computed pose, along each axis and against it,
            # since it was measured.
            sizes["unsure"] = (6, 2)
        if self.asks_back:
            sizes["asked"] = (2, 1)
        if self.compares:
            sizes["frames"] = (count(FRAMES), 1)
        return sizes | ({"trial": (TRIAL, 1)} if self.guided else {})

    @cached_property
    def places(self) -> dict[str, slice]:
        """Slice of the state of each part, and of the parts of the history and of the watch."""
        found = places(self.state)
        for name, sizes in {"history": self.history.sizes, **self.blocks}.items():
            start, inner = found[name].start, places(sizes).items()
            found |= {part: slice(start + at.start, start + at.stop) for part, at in inner}
        return found

    @cached_property
    def sizes(self) -> Sizes:
        """Shape of everything that the functions of the step exchange; scalars are left out."""
        n, rows = len(self.problem.coordinates), len(self.problem.row_names)
        sensitivity = self._functions[0]
        sizes: dict[str, tuple[int, int]] = {**self.state, "state": (count(self.state), 1)}
        sizes |= dict.fromkeys(("posture", "observed", "gradient", "locked", "shift"), (n, 1))
        sizes |= dict.fromkeys(("pose", "landed", "guide"), (4, 4))
        sizes |= dict.fromkeys(("executed", "previous", "sent", "begun", "xi", "wanted"), (6, 1))
        sizes |= dict.fromkeys(
            ("brake", "share", "went", "changed", "owed", "excess", "twist"), (6, 1)
        )
        sizes |= {"next_rest": (STATES, 1), "astray": (ASTRAY, 1)}
        sizes |= dict.fromkeys(("up", "down", "slowest", "fastest", "twist"), (6, 1))
        sizes |= dict.fromkeys(("now", "ahead", "outside", "doubted"), (rows, 1))
        sizes |= {"unsure": (6, 2), "trial": (TRIAL, 1), "pull_H": (6, 6), "pull_g": (6, 1)}
        sizes |= {"S": sensitivity.size_out(0), "E": sensitivity.size_out(1)}
        read = sum(measure.numel_out(0) for _, measure in self.measures)
        way_out = self.problem.way_out
        read += 0 if way_out is None else way_out.size
        sizes |= {"readings": (read, 1), "way": (self.under_way.size, 1)}
        sizes |= {"ages": (self.history.ages, 1), "pending": (6, 1)}
        sizes |= {"apart": (6, 1), "explained": (2, 1)}
        sizes |= {"H": (6, 6), "g": (6, 1), "way_out": (4, 1)}
        return sizes | {"away": (2 * rows, 1)}

    def size(self, name: str) -> tuple[int, int]:
        """Return the shape of a variable that the functions of the step exchange."""
        if name in ("slack", "multipliers"):
            return (len(self.movable), 1)
        if name in self.constants:
            rows, columns = self.constants[name].shape
            return rows, columns
        return self.sizes.get(name, (1, 1))

    def symbols(self, names: Iterable[str] = (), kind: type[Any] = ca.SX) -> Signals:
        """Return symbols of scalars (`casadi.SX`) or matrices (`casadi.MX`), by name."""
        return Signals(self.size, names, kind, None if self.shared else self.constants)

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function]:
        """Sensitivity and contact, whose further inputs are numbers of the response."""
        response = self.response
        if self.shared and shares(response):
            return response.shared()
        return response.sensitivity(), response.contact()

    def sensitivity(
        self, signals: Mapping[str, Any], posture: Any, locked: Any, shape: Shape = vectors
    ) -> list[ca.MX]:
        """Return S (n, 6) and E (k, 6), see `ergoqp.responses.Response.sensitivity`."""
        function = self._functions[0]
        more = (signals[f"response_{name}"] for name in function.name_in()[2:])
        return written_out(shape(function), posture, locked, *more)

    def contact(self, signals: Mapping[str, Any], posture: Any) -> Any:
        """Return the contact frame (4, 4) of a posture (n,)."""
        function = self._functions[1]
        return function(posture, *(signals[name] for name in self.contact_names))[0]

    @property
    def contact_joints(self) -> list[int]:
        """Numbers of the joints that the contact frame depends on."""
        return sorted(set(self._functions[1].jac_sparsity(0, 0).get_triplet()[1]))

    @property
    def contact_names(self) -> list[str]:
        """Names of the constants that `contact` reads."""
        return [f"response_{name}" for name in self._functions[1].name_in()[1:]]

    def cost(self, signals: Mapping[str, Any], posture: ca.MX) -> ca.MX:
        """Return V of a posture (n,)."""
        cost: Any = self.problem.cost
        if not (self.shared and shares(cost)):
            return cost.expression(posture)
        return cost.shared(posture, *(signals[f"cost_{name}"] for name in cost.constants()))

    def stop(self, signals: Signals) -> Stop:
        """Return the law of the stop, with the symbols of its numbers if these are inputs."""
        law = self.problem.stop
        if not self.shared:
            return law
        given = signals.of("stop", **({} if law.limit.aside else {"aside": 0.0}))
        found: dict[str, Any] = {"limit": given}
        found |= {"longest": given.longest} if law.average else {}
        found |= {"stretch": given.stretch} if self.problem.robot.gain_error else {}
        found |= {"hold": given.hold, "memory": given.memory} if law.hold else {}
        return replace(law, **found)

    @cached_property
    def pattern(self) -> ca.SX:
        """S at a symbolic posture. It shows which entries are always zero."""
        response: Any = self.problem.response
        function = response.shared()[0] if shares(response) else response.sensitivity()
        symbols = [ca.SX.sym("i", *function.size_in(i)) for i in range(function.n_in())]
        return function.call(symbols, True)[0]

    @cached_property
    def moved(self) -> list[int]:
        """Numbers of the rows of S that are not zero by structure."""
        pattern = self.pattern
        return [
            row
            for row in range(pattern.shape[0])
            if not all(pattern[row, column].is_zero() for column in range(pattern.shape[1]))
        ]

    def sparse(self, S: ca.SX) -> ca.SX:
        """Return S (n, 6) without the rows of joints that never move."""
        kept = ca.SX(*self.pattern.shape)
        for row in self.moved:
            kept[row, :] = S[row, :]
        return kept

    @cached_property
    def movable(self) -> list[int]:
        """Numbers, among all rows, of the rows that some twist can move. These are in the QP."""
        sx, problem = self.symbols((*PLACE, "shift", "S")), self.problem
        S, brake = self.sparse(sx["S"]), self.stop(sx).braking(sx["previous"], sx["dt"])
        context = self.context(sx, S, brake)
        return movable_rows(problem.twist_limit, problem.row_limits, context)

    def values(self, pick: str) -> np.ndarray:
        """Return one number per row from the attribute `pick` of the limits."""
        return limit_values(self.problem.row_limits, pick)

    @cached_property
    def measures(self) -> list[tuple[Limit, ca.Function]]:
        """The limits with a `measure` function, and that function."""
        found = [(limit, limit.measure()) for limit in self.problem.row_limits]
        return [(limit, measure) for limit, measure in found if measure is not None]

    @cached_property
    def watched(self) -> set[str]:
        """First names of the limits of users, whose rows may be NaN where margins are not."""
        return {
            limit.names[0]
            for limit in self.problem.row_limits
            if not of_package(limit, getattr(limit, "region", None))
        }

    @cached_property
    def watched_rows(self) -> list[int]:
        """Numbers of the rows of the `watched` limits."""
        firsts = [limit.names[0] for limit in self.problem.row_limits for _ in limit.names]
        return [row for row, first in enumerate(firsts) if first in self.watched]

    @cached_property
    def readings(self) -> ca.Function:
        """``(posture, pose) -> readings (r,)``: the readings of all limits, stacked.

        They are computed once per step, at the measured posture. The way out of regions comes last,
        from the present pose.
        """
        mx = self.symbols(("posture", "pose"), ca.MX)
        measured = [measure(mx["posture"]) for _, measure in self.measures]
        if self.problem.way_out is not None:
            measured.append(self.problem.way_out.function(mx["pose"], mx["regions_way_out"]))
        readings = ca.densify(ca.vertcat(*measured)) if measured else ca.MX(0, 1)
        if self.spare:
            readings = ca.MX(ca.DM.nan(*readings.shape))
        return mx.function("readings", {"readings": readings})

    def way_out(self, readings: Expression) -> Expression | None:
        """Return the entries of the readings that `ergoqp.limits.keep_out` gives, or None."""
        way = self.problem.way_out
        return None if way is None else readings[readings.numel() - way.size :]

    def context(
        self,
        signals: Mapping[str, Expression],
        S: Expression,
        brake: Braking | None = None,
        held: bool = False,
        numbers: Signals | None = None,
    ) -> LimitContext:
        """Return the context, from the symbols of a function of the step.

        Args:
            signals: symbols by name: ``posture``, ``observed``, ``readings``, optionally
                ``previous``, and either ``pose`` for the present pose, or ``landed``, ``way`` and
                ``shift`` for the landing pose.
            S: sensitivity, only with the entries that can differ from zero.
            brake: braking of this period, which sets how far rows must look ahead. None: only the
                present counts.
            held: whether the robot holds once what is under way, if that is declared.
            numbers: where the constants of the limits are. None: in `signals`.
        """
        given: Any = signals if numbers is None else numbers
        swing = change = ca.SX(6, 1)
        if brake is not None:
            swing, change = signals["previous"] * brake.swing, brake.change
        where = {
            "posture": signals["posture"],
            "observed": signals["observed"],
            "sensitivity": S,
            "stop_displacement": swing,
            "change": change,
            "readings": self.by_limit(signals["readings"]),
            "surface": self.surface(given),
            "numbers": partial(self.numbers_of, given),
        }
        if "landed" not in signals:
            still, stays = type(S)(6, 1), type(S)(S.shape[0], 1)
            pose = signals.get("pose", ca.SX.eye(4))
            return LimitContext(pose=pose, pending_displacement=still, shift=stays, **where)
        return LimitContext(
            pose=signals["landed"],
            shift=signals["shift"],
            overshoot_bound=brake.stop.most(brake.dt)
            if brake is not None and self.problem.average
            else None,
            **self.under_way.split(signals["way"], held, brake is not None),
            **where,
        )

    def numbers_of(self, signals: Signals, limit: Any) -> Any:
        """Return the symbols of the numbers of a limit, or None if they are no inputs."""
        prefix = prefix_of(self.problem, limit) if self.shared else ""
        return signals.of(prefix) if prefix else None

    def of_rows(self, signals: Mapping[str, Any], name: str, limit: Limit) -> Any:
        """Return a number of each row of a limit (m,), such as ``tolerance``."""
        before = takewhile(lambda each: each is not limit, self.problem.row_limits)
        start = sum(len(each.names) for each in before)
        return signals[f"rows_{name}"][start : start + len(limit.names)]

    def robot(self, signals: Signals) -> Any:
        """Return what is declared of the robot, as attributes. A number that is zero stays one."""
        robot = self.problem.robot
        names = ("gain_error", "lag", "dead_time", "longest_hold")
        zeros: dict[str, Any] = {name: 0.0 for name in names if not getattr(robot, name)}
        zeros |= {} if robot.noise.any() else {"noise": ca.DM.zeros(6)}
        return signals.of("robot", **zeros)

    def numbers(self, known: Mapping[str, Any]) -> Signals:
        """Return where constants are read: what is known if they are inputs, else the numbers."""
        found = self.symbols((), ca.MX)
        if self.shared:
            found |= known
        return found

    def surface(self, signals: Signals) -> Any:
        """Return the surface that the state stays on, with the symbols of its numbers; or None."""
        surface = self.problem.surface
        prefix = prefix_of(self.problem, surface) if self.shared else ""
        return with_symbols(surface, signals.of(prefix)) if prefix else surface

    def by_limit(self, readings: Expression) -> dict[str, Expression]:
        """Return the readings of each limit, by the name of its first row."""
        sizes = {limit.names[0]: measure.numel_out(0) for limit, measure in self.measures}
        found = {name: readings[at] for name, at in slices(sizes).items()}
        way = self.problem.way_out
        return found if way is None else found | way.of_limits(self.way_out(readings))
