"""The control step of a loop: one call per period, no exceptions, only certified twists."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from copy import copy
from typing import Any, Final, TypeAlias

import casadi as ca
import numpy as np

from ergoqp.arguments import check_called, check_kind, check_number, read_array, shown
from ergoqp.errors import InputError
from ergoqp.expressions import Evaluator
from ergoqp.problem.problem import Problem
from ergoqp.problem.validate import PERIODS, slowest
from ergoqp.solvers import QpSolver, read_solver
from ergoqp.solvers.daqp import Daqp
from ergoqp.solvers.solver import passing_on
from ergoqp.step.answer import Step
from ergoqp.step.causes import Cause, Fault, Status
from ergoqp.step.engine import Choice, Engine, closed_stop, engine_of, read_choice
from ergoqp.step.frames_check import VERDICTS
from ergoqp.step.function import build_shared_step, shared_step, state_at_start
from ergoqp.step.given import number, put, truth
from ergoqp.step.guide import Guide, read_guide
from ergoqp.step.layout import CLOCK_ROUNDING, SHORTEST_DT, History
from ergoqp.step.model import StepModel, callers, check_spare, guarded
from ergoqp.step.rest import FIRM, UNKNOWN, stalled

_ROUNDING: Final = 1e-9
"""Tolerance of the speed limits [m/s, rad/s]."""

LONGEST_DEADLINE: Final = 10.0
"""Longest deadline of a step [s]."""

_STATUSES: Final = tuple(status.name for status in Status)

Frame: TypeAlias = tuple[np.ndarray, np.ndarray]
"""Posture and mask of a frame, as read (n,) each."""

Ready: TypeAlias = tuple[np.ndarray, np.ndarray, Mapping[str, str], Frame]
"""What the next call starts from: usual inputs, state, notes, and the last frame.

It is never written to, but replaced as one, as the last operation of a call. So an exception at any
point of a call (a signal handler, Ctrl-C) leaves the stepper as it was before the call. The usual
inputs are all inputs of the function but the numbers of the problem, one after the other, with the
guide; the notes say what was wrong with the guide. A plain tuple is the fastest to make.
"""

LogSink = Callable[[dict[str, Any]], None]


class Stepper:
    """One control loop with its state: last twists, last pose, rest. Make one per loop.

    Args:
        problem: the task.
        solver: name of the QP solver, see `ergoqp.solvers`, or a `QpSolver` of your own.
        compiled: whether to compile the step with the C compiler: True, False, or ``"auto"``, see
            `ergoqp.step.engine`. The answers are the same, in a fraction of the time.
        dt: control period [s]. None: that of the problem.
        log: function that gets a dict of all inputs before every step; `ergoqp.replay` computes the
            same answers again from these. An exception in it is not passed on: the loop goes on,
            the reason of the step says that the step is not recorded, and the next step calls it
            again.
        guide: a place that the object is drawn to if descent alone comes to rest at a worse one:
            the optimum of `ergoqp.optimise`, or a pose (4, 4) [m], see
            `ergoqp.step.guide.read_guide`. The limits are the same as without a guide.
        deadline: how long a call of `step` may take [s]. If it takes longer, its answer is dropped
            and the object brakes; the reason says so. The braking twist takes one more evaluation.
            None: there is no deadline.

    Raises:
        InputError: if the solver is unknown, `dt` or `deadline` is out of range, or the guide
            cannot be used.
        ProblemError: if the workspace is too narrow for such a period, or the rows or margins of an
            own limit call Python.
        CompilerError: if there is no C compiler for ``compiled=True``.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> stepper = ergoqp.Stepper(problem)
        >>> step = stepper.step(problem.response.comfort)
        >>> step.status, step.twist.shape
        ('optimal', (6,))
        >>> stepper.step(None).status
        'braking'
    """

    def __init__(
        self,
        problem: Problem,
        solver: str | QpSolver = "daqp",
        compiled: Choice = "auto",
        dt: float | None = None,
        log: LogSink | None = None,
        guide: Any = None,
        deadline: float | None = None,
    ) -> None:
        """Build the step function once.

        This takes some tenths of a second, and with ``compiled=True`` some ten, the first time.
        """
        if dt is not None:
            check_number("dt", dt, *PERIODS, "s")
        if deadline is not None:
            check_number("deadline", deadline, SHORTEST_DT, LONGEST_DEADLINE, "s")
        check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
        choice = read_choice(compiled)
        check_called("log", log, "a function that takes the record of a step")
        self.problem = problem if dt is None else problem.replace(dt=float(dt))
        self.dt = self.problem.dt
        self._shape = (len(self.problem.coordinates),)
        self._all = np.ones(self._shape)
        self._log = log
        self._deadline = None if deadline is None else float(deadline)
        self._longest_stop = self.problem.stop.duration
        self._solver = read_solver(solver)
        self._loop = {"dt": self.dt, "solver": self._solver.name}
        if not isinstance(solver, str):
            self._loop["own_solver"] = True
        place = None if guide is None else read_guide(self.problem, guide)
        self._guided = place is not None
        self._model = StepModel(self.problem, self._guided)
        self._begin = state_at_start(self._model)
        engine = Engine(self._model, solver, choice)
        self._bind(self._built(solver, engine))
        self._later = engine if engine.waits else None
        self._closed_stop = closed_stop(self._model) if self.engine == "compiled" else None
        self._slow = slowest(self.problem.own_times, self.dt)
        self._held = False
        usual = self._model.usual(self._own.size, self._at)
        if place is not None:
            usual = self._led(usual, place)
        self._ready: Ready = usual, self._begin, {}, (np.zeros(self._shape), self._all)

    def _built(self, solver: Any, engine: Engine | None = None, spare: bool = False) -> ca.Function:
        """Return the function of the step, or the one in which no term calls Python."""
        if spare:
            return build_shared_step(self.problem, self._solver, guided=self._guided, spare=True)
        compiled = None if engine is None else engine.compiled()
        return compiled or shared_step(self.problem, solver, guided=self._guided)

    def _bind(self, function: ca.Function) -> None:
        """Set the function of the step, with its own arrays."""
        self.function = function
        self._evaluator = evaluator = Evaluator(function)
        self._call, self._given = evaluator.evaluate, evaluator.given
        # The slice of each input, and of each part of the state within the state.
        self._inputs, self._at, self._parts = evaluator.inputs, evaluator.places, self._model.places
        self._numbers = evaluator.numbers
        # The numbers of the problem come last, and are never written again.
        self._own = self._given[: self._model.fill(self._given, self._at)]
        constants = self._model.constants
        self._recorded = {n: each for n, each in self._inputs.items() if n not in constants}
        if type(self._solver) is not Daqp:
            self._call = passing_on(evaluator.evaluate)
        self._raised: list[str] = []
        spare = function
        if callers(self.problem):
            spare = self._built(self._solver, spare=True)
            self._call = guarded(self._call, evaluator, spare, self._raised)
        if self._model.watched:
            check_spare(spare)
        # One array for all outputs: a step copies it once, and all its members are views of the
        # copy.
        self._out, self._slices = evaluator.results, evaluator.slices
        # The state that one step hands to the next.
        self._state_in, self._state_out = self._inputs["state"], evaluator.outputs["next_state"]
        self._status, self._twist_at = evaluator.outputs["status"].data, self._slices["twist"]
        self._held_at = self._parts["on_hold"].start
        # CasADi stores matrices by columns.
        self._pose_in = self._inputs["pose"].reshape(4, 4).T

    def warm_up(self) -> None:
        """Prepare what a later call would have to prepare; the state does not change.

        It touches the memory of the step for the first time, and from then on `stop` is computed in
        closed form if there is a C compiler, as it always is by a compiled stepper.
        """
        self._brake(self._ready, self.dt, logged=False)
        self._closed_stop = self._closed_stop or closed_stop(self._model)

    def sibling(self) -> Stepper:
        """Return a stepper of another loop of the same problem, at its start, within microseconds.

        The two share the memory in which a step is computed, so they belong to one thread.
        """
        other = copy(self)
        other._ready = (self._ready[0], self._begin, {}, (np.zeros(self._shape), self._all))
        other._held = False
        return other

    def state(self) -> np.ndarray:
        """Return the state (n,): all that the calls so far leave to the next one.

        It is the input ``state`` of `ergoqp.step_function`; see `ergoqp.initial_state` for what is
        in it. `hold` is a part of it. The guide is not, but what was learned about it is.
        """
        state = self._ready[1].copy()
        state[self._held_at] = self._held
        return state

    def restore(self, state: Any) -> None:
        """Continue from a state: the next calls give what they would have given from there.

        Args:
            state: what `state` of a stepper of the same problem has returned, or
                `ergoqp.initial_state` (n,).

        Raises:
            InputError: if `state` is not n finite numbers, or its last twists are beyond the speed
                limits.
        """
        n, (usual, _, notes, frame) = self._begin.size, self._ready
        allowed = f"{n} finite numbers, as state() returns them"
        state = read_array("state", state, (n,), allowed).copy()
        at = self._parts
        ages = state[at["ages"]]
        if (np.diff(ages, prepend=0.0) < 0).any() or not ages[0] > 0:
            raise InputError(
                f"state: got ages that do not grow from 0 s on, allowed {allowed} of this problem"
            )
        if (fault := float(state[at["fault"]][0])) not in tuple(Fault):
            raise InputError(f"state: got {fault:g} for a fault, allowed {allowed} of this problem")
        twists = np.concatenate([state[at["planned"]], state[at["sent"]]]).reshape(-1, 6)
        fastest, speed = np.abs(twists).max(axis=0), self.problem.twist_limit.speed
        if (fastest > speed + _ROUNDING).any():
            raise InputError(
                f"state: got twists of up to {fastest.round(6).tolist()}, allowed within the speed"
                f" limits {speed.tolist()}"
            )
        held = bool(state[self._held_at] > 0.5)
        # An interrupt between two of these leaves the loop rather on hold.
        self._held = self._held or held
        self._ready = (usual, state, notes, frame)
        self._held = held

    def reset(self, twist: Any = None) -> None:
        """Reset the state of the loop: the last twists, the last pose, the state of rest.

        The guide stays; what was learned about it is forgotten.

        Args:
            twist: twist (6,) with which the object moves already [m/s, rad/s]. It is for taking
                over a moving robot, once. It is clipped to the speed limits; the robot itself must
                brake the rest of a faster motion. None: the object stands still.

        Raises:
            InputError: if `twist` is not six finite numbers.
        """
        usual, _, notes, frame = self._ready
        state = self._begin if twist is None else state_at_start(self._model, twist)
        self._ready = (usual, state, notes, frame)
        self._held = False

    def hold(self) -> None:
        """Bring the object to rest and keep it there until `try_again` or `reset`.

        Until then every step brakes and its reason says so. This never raises.
        """
        self._held = True

    def try_again(self) -> None:
        """Allow motion again, and try the guide again, if there is one.

        It ends `hold`, the rest after a fault of the robot that no measured pose ended, and that
        after wrong frames, until they are compared again. After a fault the object may be anywhere
        between what was sent and what was reported since a pose was measured, and the limits count
        both.
        """
        usual, state, notes, frame = self._ready
        names = ("on_hold", "latched", *(["trial"] if self._guided else []))
        state = self._forgotten(state, *names)
        if "frames" in self._parts:
            state[self._parts["frames"]][VERDICTS] = 0.0
        self._ready = (usual, state, notes, frame)
        self._held = False

    @property
    def engine(self) -> str:
        """How the next step is computed: ``"interpreted"`` or ``"compiled"``."""
        return engine_of(self.function)

    @property
    def guided(self) -> bool:
        """Whether the stepper was made with a guide, so that it can have another one."""
        return self._guided

    @property
    def place(self) -> Guide | None:
        """The place that the object is drawn to; None: there is none."""
        usual, at = self._ready[0], self._at
        if not self._guided or not usual[at["guided"]][0]:
            return None
        promise = float(usual[at["promise"]][0])
        expected = None if promise in (UNKNOWN, FIRM) else promise
        return Guide(usual[at["guide"]].reshape(4, 4).T.copy(), expected, promise == FIRM)

    @property
    def still(self) -> bool:
        """Whether the object is at rest: no twist was planned or sent that still moves it."""
        state, at, counted = self._ready[1], self._parts, self._model.history.counted
        return not any(state[at[name]][: 6 * count].any() for name, count in counted.items())

    @property
    def evaluator(self) -> Evaluator:
        """The step function with its arrays, which every call overwrites.

        `step_filled` and `answered` are for who writes the inputs by other means than Python.
        """
        return self._evaluator

    @property
    def usual(self) -> np.ndarray | None:
        """The inputs (n,) that a call begins with; None if it begins with something to say too."""
        said = self._ready[2] or self._slow or self._held
        return None if said else self._ready[0]

    @property
    def history(self) -> History:
        """How much of the past the state holds."""
        return self._model.history

    @property
    def stalled(self) -> float:
        """For how long the object has moved without an improvement [s]; 0 at rest.

        The larger it is, the more slowly the next step moves.
        """
        return float(stalled(self._ready[1][self._parts["rest"]]))

    def guide(self, guide: Any) -> None:
        """Replace the guide from now on, or remove it.

        It never raises because of the place while the loop runs: a place that cannot be used counts
        as none, and the reason of the next steps says why.

        Args:
            guide: as for the constructor. None: descent alone.

        Raises:
            InputError: if the stepper was made without a guide; it cannot have one later.
        """
        if not self._guided:
            raise InputError(
                "guide: the stepper was made without one; make it with Stepper(guide=...)"
            )
        usual, state, _, frame = self._ready
        place, notes = None, dict[str, str]()
        try:
            place = None if guide is None else read_guide(self.problem, guide)
        except InputError as error:
            notes["guide"] = str(error)
        except Exception as error:  # any error of a user's object; the loop goes on
            notes["guide"] = f"guide: cannot be read ({type(error).__name__}); give a pose (4, 4)"
        self._ready = (self._led(usual, place), self._forgotten(state, "trial"), notes, frame)

    def _led(self, usual: np.ndarray, place: Guide | None) -> np.ndarray:
        """Return the usual inputs with another guide; None: there is none."""
        usual, at = usual.copy(), self._at
        usual[at["guided"]] = place is not None
        if place is not None:
            usual[at["guide"]], usual[at["promise"]] = place.pose.T.ravel(), place.expected
        return usual

    def _forgotten(self, state: np.ndarray, *names: str) -> np.ndarray:
        """Return a state with parts that are zero."""
        state = state.copy()
        for name in names:
            state[self._parts[name]] = 0.0
        return state

    def step(
        self,
        posture: Any,
        pose: Any = None,
        twist: Any = None,
        *,
        dt: float | None = None,
        age: float = 0.0,
        enable: bool = True,
        observed: Any = None,
    ) -> Step:
        """Return the next twist of the object.

        Every input gives a step. An unusable input gives the status ``invalid``, and a lost frame
        gives ``braking``; both have a decelerating twist and a reason.

        Args:
            posture: joint angles (32,) [rad], or the values of `Problem.coordinates`. None: no
                frame arrived.
            pose: measured contact frame in the world (4, 4) [m]. None: the sent twists are
                integrated from the last one, as delayed as is declared; the first one comes from
                the posture.
            twist: measured twist of the last period (6,) [m/s, rad/s], in which the step looks for
                faults of the robot. None: it looks at the pose alone. It never changes the limits,
                which hold for the twist that is sent, and never gives the pose.
            dt: for how long this twist will be executed [s]. None: the period of the loop. It is
                not the time since the last call: a late call ends what was certified. A period
                longer than three periods of the loop (or than the declared ``longest_hold``)
                brakes.
            age: age of the posture [s]. Down to -1 ms it counts as 0: clocks round.
            enable: False decelerates to rest. So does a value that is neither True nor False (1 and
                0 are allowed).
            observed: (32,) bool, False for joints that the sensors do not see in this frame. None:
                all are seen. The entry of an unseen joint in `posture` is not used.
        """
        start, ready, into = time.perf_counter(), self._ready, self._inputs
        notes, frame, numbers = self._begin_call(ready), ready[3], self._numbers
        if posture is None:
            numbers["frame"][0] = 0.0
        else:
            put(into["posture"], posture, self._shape, "posture", notes)
        if observed is not None:
            put(into["observed"], observed, self._shape, "observed", notes)
            mask = into["observed"]
            if "observed" in notes or ((mask != 0.0) & (mask != 1.0)).any():
                self._unseen(notes)
        if pose is not None:
            numbers["has_pose"][0] = 1.0
            put(self._pose_in, pose, (4, 4), "pose", notes)
        if twist is not None:
            numbers["has_twist"][0] = 1.0
            put(into["executed"], twist, (6,), "twist", notes)
        if dt is not None:
            numbers["dt"][0] = number(dt, "dt", notes)
        # The usual cases first: a call costs more than a comparison.
        numbers["age"][0] = age if type(age) is float else number(age, "age", notes)
        if enable is not True:
            numbers["enable"][0] = truth(enable, "enable", notes)
        if self._log is not None:
            self._record(notes)
        self._call()
        if self._deadline is not None:
            self._check_deadline(notes, start)
        if posture is not None:
            mask = self._all if observed is None else into["observed"].copy()
            frame = (into["posture"].copy(), mask)
        return self._answer(ready, notes, start, frame)

    def step_filled(self, fill: Callable[[], bool], frame: bool = True) -> Step:
        """Return the step of inputs that a function writes into `evaluator`.

        It is `step` for who has the inputs elsewhere than in Python. The record, the deadline and
        the checks of types are left out.

        Args:
            fill: writes the inputs that differ from the usual ones, which are set before; returns
                whether the mask ``observed`` is one of zeros and ones.
            frame: whether it writes a posture.
        """
        start, notes = time.perf_counter(), self._begin_call(self._ready)
        if not fill():
            self._unseen(notes)
        self._call()
        return self.answered(notes, frame, start)

    def answered(self, notes: Mapping[str, str], frame: bool, start: float) -> Step:
        """Return the step that is in `evaluator`, and continue from it.

        Args:
            notes: what was wrong with inputs, by name.
            frame: whether there was a posture.
            start: when the call began (`time.perf_counter`) [s].
        """
        ready, into = self._ready, self._inputs
        seen = (into["posture"].copy(), into["observed"].copy()) if frame else ready[3]
        return self._answer(ready, notes, start, seen)

    def _unseen(self, notes: dict[str, str]) -> None:
        """Drop the frame, because which joints were seen is unknown."""
        self._inputs["observed"][:], self._inputs["posture"][:] = 1.0, np.nan
        notes.setdefault("observed", "observed is not a mask of zeros and ones")

    def brake(self, dt: float | None = None, elapsed: float = 0.0) -> Step:
        """Return the next braking twist without new data.

        The loop calls it if data did not come in time. The twist follows the stop that the last
        step was certified for. While the sent twist is a mean, it may still grow for up to
        `Control.average` before it falls. The state of the loop moves along, so a later step
        continues from there. It never raises.

        Args:
            dt: for how long the twist will be executed [s]. None: the period of the loop.
            elapsed: how long the robot has already ramped down by itself before this call [s],
                along the twists of `stop`. Its ramp is not checked. The object comes to rest before
                it moves again. A straight ramp is up to half of `Control.average` ahead of that
                stop. After such a ramp use `reset`, with the measured twist or once the object
                stands.
        """
        start, ready, said = time.perf_counter(), self._ready, dict[str, str]()
        late, more = number(elapsed, "elapsed", said), dict[str, Any]()
        if not late >= -CLOCK_ROUNDING:
            # The time for which the robot ramped down is an age like that of a frame.
            more["age"] = np.nan
            said["age"] = said.pop("elapsed", f"elapsed is {late:g} s, allowed at least 0")
        late = min(late, self._longest_stop)
        while late >= SHORTEST_DT:
            # Period by period, as `stop` gives them.
            period = min(late, self.dt)
            late -= period
            self._brake(ready, period, enable=0.0, **more)
            ready = (ready[0], self._state_out.copy(), ready[2], ready[3])
            more["instead"] = True
            if not self._out[self._slices["twist"]].any():
                break
        notes = self._brake(ready, self.dt if dt is None else number(dt, "dt", said), **more) | said
        return self._answer(ready, notes, start, ready[3])

    def stop(self, dt: float | None = None) -> np.ndarray:
        """Return the twists of the certified stop from here (k, 6) [m/s, rad/s].

        There is one twist per period, as `brake` would return them, and the last one is zero. The
        state of the loop does not change. A robot that is to stop by itself when the loop hangs
        gets these twists in advance.

        Args:
            dt: for how long each twist will be executed [s]. None: the period of the loop.

        Raises:
            InputError: if `dt` is out of range.
        """
        period = self.dt if dt is None else dt
        if period != self.dt and not SHORTEST_DT <= period <= self.problem.longest_period:
            allowed = f"{SHORTEST_DT:g} to {self.problem.longest_period:g}"
            raise InputError(f"dt: got {shown(dt)}, allowed {allowed} s")
        ready, twists = self._ready, []
        if self._closed_stop is not None:
            return self._closed_stop(ready[1], period)
        while not twists or (
            twists[-1].any() and len(twists) * period < self._longest_stop + period
        ):
            self._brake(ready, period, enable=0.0, logged=False)
            ready = (ready[0], self._state_out.copy(), ready[2], ready[3])
            twists.append(self._out[self._slices["twist"]].copy())
        return np.array(twists)

    @property
    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Posture and mask of the last frame as read (n,) each. NaN: the entry was not a number."""
        posture, observed = self._ready[3]
        return posture.copy(), observed.copy()

    def sent_instead(self, twist: Any) -> None:
        """State that another twist than that of the step was sent; the next step continues from it.

        It is for a caller who limits the twist further.

        Args:
            twist: the sent twist (6,) [m/s, rad/s], within the limits of the object.

        Raises:
            InputError: if the step sends a mean (`Control.average`), which cannot be changed
                afterwards, or if `twist` is not six finite numbers within the speed limits.
        """
        if self.problem.average:
            raise InputError(
                f"sent_instead: got control.average = {self.problem.average:g} s, allowed 0"
            )
        speed = self.problem.twist_limit.speed
        sent = read_array("twist", twist, (6,), "6 finite numbers")
        if np.any(np.abs(sent) > speed + _ROUNDING):
            raise InputError(
                f"twist: got {sent.tolist()}, allowed within the speed limits {speed.tolist()}"
            )
        usual, state, notes, frame = self._ready
        state = state.copy()
        for name in ("planned", "sent"):  # newest first
            state[self._parts[name]][:6] = sent
        self._ready = (usual, state, notes, frame)

    def _begin_call(self, ready: Ready) -> dict[str, str]:
        """Set every input of the function anew; return the notes of the call."""
        if self._later is not None:
            self._later.change(self)
        self._own[:], self._state_in[:] = ready[0], ready[1]
        notes = {**ready[2]}
        if self._slow:
            notes["slow"] = self._slow
        # Not a part of `ready`: a signal handler may call `hold` during a step.
        if self._held:
            self._state_in[self._held_at] = 1.0
            notes["enable"] = "held: the object stays at rest until try_again()"
        return notes

    def _brake(
        self,
        ready: Ready,
        dt: float,
        enable: float = 1.0,
        age: float = 0.0,
        instead: bool = False,
        logged: bool = True,
    ) -> dict[str, str]:
        """Evaluate the function without new data; return the notes of the call."""
        notes, into = self._begin_call(ready), self._numbers
        into["frame"][0], into["ask"][0], into["dt"][0], into["enable"][0] = 0.0, 1.0, dt, enable
        into["age"][0] = age
        if logged and self._log is not None:
            self._record(notes, **({"instead": True} if instead else {}))
        self._call()
        return notes

    def _record(self, notes: dict[str, str], **more: bool) -> None:
        """Give the inputs to the log; a failing log is noted."""
        entry: dict[str, Any] = {"loop": dict(self._loop), "notes": dict(notes), **more}
        entry["engine"] = self.engine
        entry |= {name: values.tolist() for name, values in self._recorded.items()}
        try:
            if self._log is not None:
                self._log(entry)
        except Exception as error:  # the loop never stops for its log
            notes["log"] = (
                f"log: {type(error).__name__} in what was given as log=, this step is not recorded"
            )

    def _check_deadline(self, notes: dict[str, str], start: float) -> None:
        """Replace the answer of a step that took too long by braking."""
        took = time.perf_counter() - start
        if self._deadline is None or took <= self._deadline:
            return
        allowed = f"{1e3 * self._deadline:g} ms (deadline)"
        notes["deadline"] = f"the step took {1e3 * took:.1f} ms, allowed {allowed}"
        self._inputs["ask"][0] = 1.0
        if self._log is not None:
            self._record(notes, instead=True)
        self._call()

    def _answer(self, ready: Ready, notes: Mapping[str, str], start: float, frame: Frame) -> Step:
        """Return the answer of the last evaluation, and continue from it."""
        account, numbers = self._out.copy(), self._numbers
        if self._raised:
            who = ", ".join(callers(self.problem))
            notes = {**notes, "term": f"{who}: got {self._raised[-1]}, allowed a number"}
        seen = (frame[0], numbers["dt"][0], numbers["age"][0])
        twist, status = account[self._twist_at], _STATUSES[int(self._status[0])]
        after = (ready[0], self._state_out.copy(), ready[2], frame)
        step = Step(twist, status, self.problem, account, self._slices, seen, notes, start)
        # Last: an interrupted call counts as not made. CPython does not interrupt between this and
        # the assignment of the answer by the caller.
        self._ready = after
        return step


__all__ = ["Cause", "Status", "Step", "Stepper"]
