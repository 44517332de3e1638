"""The control step of a loop: one call per period, no exceptions, only certified twists."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_called, check_kind, check_number, flag, read_array
from ergoqp.errors import InputError
from ergoqp.expressions.evaluator import Evaluator
from ergoqp.problem.kinds import PERIODS
from ergoqp.problem.problem import Problem
from ergoqp.problem.tried import slowest
from ergoqp.solvers import solver_named
from ergoqp.solvers.solver import passing_on
from ergoqp.step.answer.causes import Cause, Status
from ergoqp.step.answer.step import Step
from ergoqp.step.function import build_step, step_function
from ergoqp.step.guide.place import Guide, read_guide
from ergoqp.step.guide.trial import TRIAL
from ergoqp.step.model import StepModel
from ergoqp.step.packing import place_in
from ergoqp.step.rest import STATES, stalled
from ergoqp.step.spare import callers, guarded
from ergoqp.step.state import initial_state
from ergoqp.step.under_way.history import SHORTEST_DT
from ergoqp.step.user_values import number, put, truth

_ROUNDING: Final = 1e-9
"""Tolerance of the speed limits [m/s, rad/s]."""

_STATUSES: Final = tuple(status.name for status in Status)

LogSink = Callable[[dict[str, Any]], None]


class Stepper:
    """One control loop with its state: last twists, last pose, rest. Make one per loop.

    Args:
        problem: the task.
        solver: name of the QP solver, see `ergoqp.solvers`.
        compiled: whether to compile the step with the C compiler. The answers are the same, in a
            fraction of the time.
        dt: control period [s]. None: that of the problem.
        log: function that gets a dict of all inputs before every step; `ergoqp.replay` computes the
            same answers again from these. An exception in it is not passed on: the loop goes on,
            the reason of the step says that the step is not recorded, and the next step calls it
            again.
        guide: a place that the object is drawn to if descent alone comes to rest at a worse one:
            the optimum of `ergoqp.optimise`, or a pose (4, 4) [m], see
            `ergoqp.step.guide.place.read_guide`. The limits are the same as without a guide.

    Raises:
        InputError: if the solver is unknown, `dt` is out of range, or the guide cannot be used.
        ProblemError: if the workspace is too narrow for such a period.
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
        solver: str = "daqp",
        compiled: bool = False,
        dt: float | None = None,
        log: LogSink | None = None,
        guide: Any = None,
    ) -> None:
        """Build the step function once.

        This takes some tenths of a second. The first compilation takes some ten seconds.
        """
        if dt is not None:
            check_number("dt", dt, *PERIODS, "s")
        check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
        compiled = flag("compiled", compiled)
        check_called("log", log, "a function that takes the record of a step")
        self.problem = problem if dt is None else problem.replace(dt=float(dt))
        self.dt = self.problem.dt
        self._state = (len(self.problem.coordinates),)
        self._log = log
        self._longest_stop = self.problem.stop.duration
        self._loop = {"dt": self.dt, "solver": solver, "compiled": compiled}
        place = None if guide is None else read_guide(self.problem, guide)
        self._guided = place is not None
        self._model = StepModel(self.problem, self._guided)
        self._begin = initial_state(self._model)
        # The history comes first in the state, the planned twists in it, then the sent ones; newest
        # first.
        sent_at = 6 * self._model.history.planned
        self._planned_at, self._sent_at = slice(0, 6), slice(sent_at, sent_at + 6)
        parts = self._model.state
        self._latched_at = place_in(parts, "compared") + place_in(
            self._model.blocks["compared"], "latched"
        )
        self._rest_at = place_in(parts, "rest")
        self._bind(step_function(self.problem, solver, compiled, guided=self._guided))
        self._notes: dict[str, str] = {}
        if slow := slowest(self.problem.own_times, self.dt):
            self._notes["slow"] = slow
        self._held = False
        if place is not None:
            self._lead(place)
        self.reset()

    def _bind(self, function: ca.Function) -> None:
        """Set the function of the step, with its own arrays."""
        self._evaluator = evaluator = Evaluator(function)
        self._call, self._inputs = evaluator.evaluate, evaluator.inputs
        if self._loop["solver"] != "daqp":
            self._call = passing_on(evaluator.evaluate)
        self._raised: list[str] = []
        if callers(self.problem):
            solver = solver_named(self._loop["solver"])
            spare = build_step(self.problem, solver, guided=self._guided, spare=True)
            self._call = guarded(self._call, evaluator, spare, self._raised)
        # One array for all outputs: a step copies it once, and all its members are views of the
        # copy.
        self._out, self._slices = evaluator.results, evaluator.slices
        # The state that one step hands to the next.
        self._state_in, self._state_out = self._inputs["state"], evaluator.outputs["next_state"]
        self._status_at = self._slices["status"].start
        # CasADi stores matrices by columns.
        self._pose_in = self._inputs["pose"].reshape(4, 4).T

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
        state, self._held = self._begin, False
        if twist is not None:
            speed = self.problem.twist_limit.speed
            state = initial_state(self._model, np.clip(_six(twist), -speed, speed))
        self._state_in[:] = state
        self._inputs["posture"][:] = 0.0

    def hold(self) -> None:
        """Bring the object to rest and keep it there until `try_again` or `reset`.

        Until then every step brakes and its reason says so. This never raises.
        """
        self._held = True

    def try_again(self) -> None:
        """Allow motion again, and try the guide again, if there is one.

        It ends `hold`, and the rest after a fault of the robot that no measured pose ended. The
        object may then be anywhere between what was sent and what was reported since a pose was
        measured, and the limits count both.
        """
        self._held = False
        self._state_in[self._latched_at] = 0.0
        if self._guided:
            self._state_in[-TRIAL:] = 0.0

    @property
    def stalled(self) -> float:
        """For how long the object has moved without an improvement [s]; 0 at rest.

        The larger it is, the more slowly the next step moves.
        """
        return float(stalled(self._state_in[self._rest_at : self._rest_at + STATES]))

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
                "guide: the stepper was made without one, allowed only where Stepper(guide=...) had"
                " a place"
            )
        self._notes.pop("guide", None)
        self._inputs["guided"][0] = 0.0
        self._state_in[-TRIAL:] = 0.0
        if guide is None:
            return
        try:
            self._lead(read_guide(self.problem, guide))
        except InputError as error:
            self._notes["guide"] = str(error)
        except Exception as error:  # any error of a user's object; the loop goes on
            self._notes["guide"] = (
                f"guide: cannot be read ({type(error).__name__}), allowed a pose (4, 4)"
            )

    def _lead(self, place: Guide) -> None:
        self._inputs["guide"][:], self._inputs["guided"][0] = place.pose.T.ravel(), 1.0
        self._inputs["promise"][0] = place.expected

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
            pose: measured contact frame in the world (4, 4) [m]. None: it is integrated from the
                last one, and comes from the posture the first time.
            twist: measured twist of the last period (6,) [m/s, rad/s]. None: the sent twist,
                delayed as declared. It gives the pose if no pose is measured, and it shows faults
                of the robot. It never changes the limits, which hold for the twist that is sent.
            dt: for how long this twist will be executed [s]. None: the period of the loop. It is
                not the time since the last call: a late call ends what was certified. A period
                longer than three periods of the loop (or than the declared ``longest_hold``)
                brakes.
            age: age of the posture [s].
            enable: False decelerates to rest. So does a value that is neither True nor False (1 and
                0 are allowed).
            observed: (32,) bool, False for joints that the sensors do not see in this frame. None:
                all are seen. The entry of an unseen joint in `posture` is not used.
        """
        start = time.perf_counter()
        into, notes = self._inputs, {**self._notes} if self._notes else {}
        into["frame"][0] = posture is not None
        if posture is not None:
            put(into["posture"], posture, self._state, "posture", notes)
        if observed is None:
            into["observed"].fill(1.0)
        else:
            put(into["observed"], observed, self._state, "observed", notes)
            if "observed" in notes or not np.isfinite(into["observed"]).all():
                # Which joints were seen is unknown, so the frame cannot be used.
                into["observed"][:], into["posture"][:] = 1.0, np.nan
                notes.setdefault("observed", "observed is not a mask of zeros and ones")
        into["has_pose"][0] = pose is not None
        if pose is not None:
            put(self._pose_in, pose, (4, 4), "pose", notes)
        into["has_twist"][0] = twist is not None
        if twist is not None:
            put(into["executed"], twist, (6,), "twist", notes)
        into["dt"][0] = self.dt if dt is None else number(dt)
        into["age"][0] = number(age)
        into["enable"][0] = truth(enable, "enable", notes) and not self._held
        if self._held:
            notes.setdefault("enable", "held: the object stays at rest until try_again()")
        if self._log is not None:
            self._record(notes)
        self._call()
        return self._answer(notes, start)

    def brake(self, dt: float | None = None, elapsed: float = 0.0) -> Step:
        """Return the next braking twist without new data.

        The loop calls it if data did not come in time. The twist follows the stop that the last
        step was certified for. While the sent twist is a mean, it may still grow for up to
        `Control.average` before it falls. The state of the loop moves along, so a later step
        continues from there. It never raises.

        Args:
            dt: for how long the twist will be executed [s]. None: the period of the loop.
            elapsed: how long the robot has already ramped down by itself before this call [s]. Its
                ramp counts as that stop and is not checked. The object comes to rest before it
                moves again. A straight ramp is up to half of `Control.average` ahead of that stop.
                After such a ramp use `reset`, with the measured twist or once the object stands.
        """
        late = min(number(elapsed), self._longest_stop)
        while late >= SHORTEST_DT:
            period = min(late, 3 * self.dt)
            late -= period
            if not self._brake(period, 0.0).twist.any():
                break
        return self._brake(self.dt if dt is None else number(dt))

    def stop(self) -> np.ndarray:
        """Return the twists of the certified stop from here (k, 6) [m/s, rad/s].

        There is one twist per period, as `brake` would return them, and the last one is zero. The
        state of the loop does not change. A robot that is to stop by itself when the loop hangs
        gets these twists in advance.
        """
        state, log, self._log = self._state_in.copy(), self._log, None
        twists = [self._brake(self.dt, 0.0).twist]
        while twists[-1].any() and len(twists) * self.dt < self._longest_stop + self.dt:
            twists.append(self._brake(self.dt, 0.0).twist)
        self._state_in[:], self._log = state, log
        return np.array(twists)

    @property
    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Posture and mask of the last step as read (n,) each. NaN: the entry was not a number."""
        return self._inputs["posture"].copy(), self._inputs["observed"].copy()

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
        sent, speed = _six(twist), self.problem.twist_limit.speed
        if np.any(np.abs(sent) > speed + _ROUNDING):
            raise InputError(
                f"twist: got {sent.tolist()}, allowed within the speed limits {speed.tolist()}"
            )
        self._state_in[self._planned_at], self._state_in[self._sent_at] = sent, sent

    def _brake(self, dt: float, enable: float = 1.0) -> Step:
        start = time.perf_counter()
        into = self._inputs
        into["frame"][0], into["has_pose"][0], into["has_twist"][0], into["ask"][0] = (
            0.0,
            0.0,
            0.0,
            1.0,
        )
        into["dt"][0], into["age"][0], into["enable"][0] = dt, 0.0, enable
        notes: dict[str, str] = {}
        if self._log is not None:
            self._record(notes)
        self._call()
        into["ask"][0] = 0.0
        return self._answer(notes, start)

    def _answer(self, notes: Mapping[str, str], start: float) -> Step:
        account, into = self._out.copy(), self._inputs
        if self._raised:
            words = (
                f"{', '.join(callers(self.problem))}: got {self._raised.pop()}, allowed a number"
            )
            notes = {**notes, "term": words}
        self._state_in[:] = self._state_out
        seen = (into["posture"].copy(), into["dt"][0], into["age"][0])
        twist, status = account[self._slices["twist"]], _STATUSES[int(account[self._status_at])]
        return Step(twist, status, self.problem, account, self._slices, seen, notes, start)

    def _record(self, notes: dict[str, str]) -> None:
        entry = {name: values.tolist() for name, values in self._inputs.items()}
        try:
            if self._log is not None:
                self._log({"loop": dict(self._loop), "notes": dict(notes), **entry})
        except Exception as error:  # the loop never stops for its log
            notes["log"] = (
                f"log: {type(error).__name__} in what was given as log=, this step is not recorded"
            )


def _six(twist: Any) -> np.ndarray:
    return read_array("twist", twist, (6,), "6 finite numbers")


__all__ = ["Cause", "Status", "Step", "Stepper"]
