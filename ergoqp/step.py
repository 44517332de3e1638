"""The solve-step API of a control loop: one call per period, never an exception, never an unsafe twist."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS
from ergoqp.reasons import reason_of
from ergoqp.step_function import INPUTS, OUTPUTS, Cause, Status

if TYPE_CHECKING:
    from ergoqp.problem import Problem

_NAN_POSTURE: Final = np.full(len(JOINTS), np.nan)
_ALL: Final = np.ones(len(JOINTS))


@dataclass(frozen=True)
class Step:
    """The answer of one control step.

    Attributes:
        twist: object velocity at the contact frame, world-aligned, linear first (6,) [m/s, rad/s]: send this.
        status: ``optimal``, ``settled``, ``relaxed``, ``recovering``, ``braking`` or ``invalid``.
        pose: contact frame in the world that the step reckoned with (4, 4) [m].
        posture_rate: how the model person follows (32,) [rad/s].
        cost: V of the posture [points].
        gain: predicted improvement of one second at full speed [points].
        residuals: ``qp`` (largest KKT residual), ``contact`` (contact motion the posture cannot follow [m/s, rad/s]) and
            ``accepted`` (share of the way from braking to the QP's answer that was certified).
        solve_time: duration of the call [s].
    """

    twist: np.ndarray
    status: str
    pose: np.ndarray
    posture_rate: np.ndarray
    cost: float
    gain: float
    residuals: Mapping[str, float]
    solve_time: float
    _account: Mapping[str, np.ndarray]
    _problem: Problem
    _note: str

    @cached_property
    def reason(self) -> str:
        """One sentence that names the cause; empty for a plain optimal step."""
        return reason_of(self._problem, Status[self.status], self._account, self._note)

    @cached_property
    def margins(self) -> dict[str, float]:
        """Distance to the nearer end of every row, negative outside, in the row's unit."""
        return dict(zip(self._problem.row_names, self._account["margins"].tolist(), strict=True))

    @cached_property
    def slack(self) -> dict[str, float]:
        """By how much each soft row was missed, in its unit per second; only those that were."""
        values = self._account["slack"].tolist()
        return {name: value for name, value in zip(self._problem.row_names, values, strict=True) if value > 1e-7}

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold the object back, and of the joints that yield."""
        pushing = np.abs(self._account["multipliers"]) > 1e-6
        rows = [name for name, push in zip(self._problem.row_names, pushing, strict=True) if push]
        return (*rows, *self.locked)

    @cached_property
    def locked(self) -> tuple[str, ...]:
        """Joints at their end that the model person holds while the others follow."""
        return tuple(JOINTS[i] for i in np.flatnonzero(self._account["locked"] > 0.5))


LogSink = Callable[[dict[str, Any]], None]


class Stepper:
    """One control loop's state: last twist, last pose, rest state. Make one per loop with ``problem.stepper()``.

    Args:
        problem: the task.
        solver: name of the QP solver, see `ergoqp.solvers`.
        dt: control period [s]; None: the problem's.
        log: called after every step with a dict of everything that went in (``ergoqp.replay`` gives the same answers again);
            an exception in it is the logger's and is not passed on, the loop goes on.

    Raises:
        InputError: if the solver is unknown or `dt` is not a period.
    """

    def __init__(self, problem: Problem, solver: str = "daqp", dt: float | None = None, log: LogSink | None = None) -> None:
        """Build the step function once; this takes some tenths of a second."""
        self.problem = problem
        self.dt = problem.dt if dt is None else float(dt)
        if not 1e-4 <= self.dt <= 0.1:
            raise InputError(f"dt: got {dt!r} s, allowed 0.0001 to 0.1 s")
        self._log = log
        self._function = problem.step_function(solver)
        self._buffer, self._call = self._function.buffer()
        self._inputs = {name: np.zeros(self._function.numel_in(i)) for i, name in enumerate(INPUTS)}
        self._outputs = {name: np.zeros(self._function.numel_out(i)) for i, name in enumerate(OUTPUTS)}
        for i, name in enumerate(INPUTS):
            self._buffer.set_arg(i, memoryview(self._inputs[name]))
        for i, name in enumerate(OUTPUTS):
            self._buffer.set_res(i, memoryview(self._outputs[name]))
        self.reset()

    def reset(self) -> None:
        """Forget the last twist, the last pose and the rest state: the loop starts again from standstill."""
        for name in ("stored_pose", "started", "sent", "rest"):
            self._inputs[name][:] = 0.0
        self._inputs["posture"][:] = 0.0

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
        """Return the next object twist.

        Whatever comes in, a step comes out: an unusable input gives ``invalid``, a lost frame ``braking``, both with the
        decelerating twist and a reason.

        Args:
            posture: joint angles (32,) [rad]; None when no frame arrived.
            pose: measured contact frame in the world (4, 4) [m]; None: integrated from the last one, the first time from the
                posture.
            twist: what the robot really did in the last period (6,) [m/s, rad/s]; None: the last one sent.
            dt: this period [s]; None: the loop's.
            age: how old the posture is [s].
            enable: False decelerates to rest.
            observed: (32,) bool, False for joints that the sensors do not see in this frame; None: all are seen. What an
                unseen joint's entry in `posture` says is not used.
        """
        start = time.perf_counter()
        into, note = self._inputs, ""
        no_frame = posture is None
        if not no_frame:
            note = _put(into["posture"], posture, (32,), "posture") or note
        into["frame"][0] = not no_frame
        if observed is None:
            into["observed"][:] = _ALL
        else:
            problem = _put(into["observed"], observed, (32,), "observed")
            if problem:
                note, into["posture"][:] = problem, _NAN_POSTURE
        into["has_pose"][0] = pose is not None
        if pose is not None:
            note = _put(into["pose"], pose, (4, 4), "pose") or note
        if twist is None:
            into["executed"][:] = into["sent"]
        else:
            note = _put(into["executed"], twist, (6,), "twist") or note
        into["dt"][0] = self.dt if dt is None else _number(dt)
        into["age"][0] = _number(age)
        into["enable"][0] = bool(enable)
        if self._log is not None:
            self._record(note)
        self._call()
        return self._answer(note, start)

    def _answer(self, note: str, start: float) -> Step:
        out, into = self._outputs, self._inputs
        account = {
            name: out[name].copy() for name in ("margins", "slack", "multipliers", "locked", "outside", "causes", "residuals")
        }
        account["posture"], account["dt"], account["age"] = into["posture"].copy(), into["dt"].copy(), into["age"].copy()
        into["sent"][:] = out["twist"]
        into["stored_pose"][:] = out["next_pose"]
        into["rest"][:] = out["next_rest"]
        # Without a frame there is no pose to start from yet, unless one was given.
        if into["frame"][0] or into["has_pose"][0]:
            into["started"][0] = 1.0
        qp, contact, accepted = out["residuals"].tolist()
        return Step(
            twist=out["twist"].copy(),
            status=Status(int(out["status"][0])).name,
            pose=out["pose_used"].reshape(4, 4).T.copy(),
            posture_rate=out["posture_rate"].copy(),
            cost=float(out["cost"][0]),
            gain=float(out["gain"][0]),
            residuals={"qp": qp, "contact": contact, "accepted": accepted},
            solve_time=time.perf_counter() - start,
            _account=account,
            _problem=self.problem,
            _note=note,
        )

    def _record(self, note: str) -> None:
        entry = {name: values.tolist() for name, values in self._inputs.items()}
        try:
            assert self._log is not None
            self._log({"note": note, **entry})
        except Exception:  # the loop never stops for its log
            self._log = None


def _put(target: np.ndarray, value: Any, shape: tuple[int, ...], name: str) -> str:
    """Copy a user's array into a buffer; on anything unusable fill it with NaN, which the step judges, and say what it was."""
    try:
        array = np.asarray(value, dtype=float)
        if array.shape == shape:
            target[:] = array.T.ravel() if len(shape) == 2 else array
            return ""
        complaint = f"{name} has shape {array.shape}, allowed {shape}"
    except (TypeError, ValueError, OverflowError):
        complaint = f"{name} is not an array of numbers but {type(value).__name__}"
    target[:] = np.nan
    return complaint


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def replay(problem: Problem, log: list[dict[str, Any]], solver: str = "daqp") -> list[Step]:
    """Return the steps that a logged loop took, from its log alone: the same inputs give the same answers, bit for bit.

    Args:
        problem: the problem of the logged loop.
        log: the dicts that the log sink received, in order.
        solver: the solver of the logged loop.
    """
    stepper = Stepper(problem, solver=solver)
    steps = []
    for entry in log:
        for name in INPUTS:
            stepper._inputs[name][:] = entry[name]
        stepper._call()
        steps.append(stepper._answer(entry["note"], time.perf_counter()))
    return steps


__all__ = ["Cause", "Status", "Step", "Stepper", "replay"]
