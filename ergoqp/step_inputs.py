"""What goes into a step and comes out of it, by name; and the judgement of every input before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np

from ergoqp.linear import Shape
from ergoqp.rigid import exp_rotation, is_rigid
from ergoqp.step_state import state_size
from ergoqp.step_watch import WATCH, parked, watch_function
from ergoqp.step_way import history_sizes, holds_all, landed, way_function, way_size

if TYPE_CHECKING:
    from ergoqp.problem import Problem


class Status(IntEnum):
    """What a step did; the order is the order of precedence."""

    optimal = 0
    settled = 1
    relaxed = 2
    recovering = 3
    braking = 4
    invalid = 5


class Cause(IntEnum):
    """Why a step did not use its inputs or its answer; bits of the function's output ``causes``."""

    posture = 0
    pose = 1
    twist = 2
    dt = 3
    age = 4
    disabled = 5
    no_frame = 6
    too_old = 7
    not_solved = 8
    not_certified = 9
    robot = 10
    unmeasured = 11
    halted = 12
    asked = 13
    long_period = 14
    short_periods = 15


LONGEST_DT: Final = 1.0
"""What is longer is no control period [s]."""

INPUTS: Final = ("posture", "observed", "pose", "has_pose", "executed", "has_twist", "dt", "age", "frame", "enable", "ask", "state")

OUTPUTS: Final = (
    *("twist", "pose_used", "next_state", "posture_rate", "status", "causes", "fault", "cost", "gain", "margins"),
    *("slack", "multipliers", "locked", "outside", "residuals"),
)


def input_sizes(problem: Problem, guided: bool = False) -> dict[str, tuple[int, int]]:
    """Return the shape of every input of the step."""
    n = len(problem.coordinates)
    sizes = {"posture": (n, 1), "observed": (n, 1), "pose": (4, 4), "executed": (6, 1), "state": (state_size(problem, guided), 1)}
    return {name: sizes.get(name, (1, 1)) for name in INPUTS}


@dataclass(frozen=True)
class Known:
    """What a step goes by, all of it usable numbers.

    Attributes:
        posture: (n,) [rad].
        pose: contact frame as measured, or as far as it is known (4, 4).
        landed: where it comes to rest if the planned twist were zero from now on (4, 4).
        previous: twist that was planned for the end of the last period (6,).
        dt: period [s].
        way: what is under way, see `ergoqp.step_way.under_way_of`.
        owed: displacement of it that was sent (6,) [m, rad].
        begun: twist that is sent however the plan goes on (6,).
        own: share of the planned twist that is sent beside it.
        causes: why the step can only brake, by `Cause`; 0 if it can do more.
        started: 1 once a pose is known.
        watched: the parts of `ergoqp.step_watch.WATCH`.
    """

    posture: ca.MX
    pose: ca.MX
    landed: ca.MX
    previous: ca.MX
    dt: ca.MX
    way: ca.MX
    owed: ca.MX
    begun: ca.MX
    own: ca.MX
    causes: ca.MX
    started: ca.MX
    watched: dict[str, ca.MX]


def known_of(problem: Problem, raw: Mapping[str, ca.MX], state: Mapping[str, ca.MX], shape: Shape) -> Known:
    """Judge every input; replace what cannot be used by what was known before, so that no NaN goes further.

    Args:
        problem: the task.
        raw: `INPUTS` as they came.
        state: the parts of the state, see `ergoqp.step_state`.
        shape: how functions are written, see `ergoqp.linear`.
    """
    seen = raw["observed"] > 0.5
    usable = ca.logic_and(seen, ca.fabs(raw["posture"]) <= problem.response.largest)
    posture = ca.if_else(usable, raw["posture"], ca.DM(stand_in(problem)))
    # Every entry is unseen or plausible.
    posture_ok = ca.sum1(usable - seen) > -0.5
    dt_ok = ca.logic_and(raw["dt"] >= 1e-5, raw["dt"] <= LONGEST_DT)
    dt = ca.if_else(dt_ok, raw["dt"], problem.dt)

    way, owed, begun, own, up, down = shape(way_function(problem))(*(state[name] for name in history_sizes(problem)), dt)
    given = {**state, **raw, "period": dt, "dt_ok": dt_ok, "posture_ok": posture_ok, "owed": owed, "up": up, "down": down}
    given |= {"owed_before": state.get("owed", ca.MX(ca.DM.zeros(6)))}
    judged = shape(_judged(problem))
    pose, unanchored, causes, started, *watched = judged(*(given[name] for name in judged.name_in()))

    # Only the first step without a measured pose asks where the contact is by the posture.
    q, held = ca.MX.sym("q", posture.numel()), ca.MX.sym("pose", 4, 4)
    by_posture = ca.Function("by_posture", [q, held], [problem.response.contact()(q)[0]])
    as_known = ca.Function("as_known", [q, held], [held])
    pose = ca.densify(ca.Function.if_else("anchor", by_posture, as_known)(unanchored, posture, pose))
    return Known(
        posture=posture,
        pose=pose,
        landed=shape(_landing(problem))(pose, way) if way_size(problem) > 6 else pose,
        previous=state["planned"][:, 0],
        dt=dt,
        way=way,
        owed=owed,
        begun=begun,
        own=own,
        causes=causes,
        started=started,
        watched=dict(zip(WATCH, watched, strict=True)),
    )


def _landing(problem: Problem) -> ca.Function:
    """``(pose, way) -> where the object lands (4, 4)``."""
    pose, way = ca.SX.sym("pose", 4, 4), ca.SX.sym("way", way_size(problem))
    return ca.Function("landing", [pose, way], [ca.densify(landed(pose, way))])


def _judged(problem: Problem) -> ca.Function:
    """All inputs but the posture, and the robot: (pose, whether it has to come from the posture, causes, started, *WATCH)."""
    inputs = {name: size for name, size in input_sizes(problem).items() if name not in ("posture", "observed", "state")}
    history = {name: size for name, size in history_sizes(problem).items() if name != "owed"}
    own = {"stored": (4, 4), "started": (1, 1)} | dict.fromkeys(("period", "dt_ok", "posture_ok"), (1, 1))
    own |= dict.fromkeys(("owed_before", "owed", "up", "down"), (6, 1))
    raw = {name: ca.SX.sym(name, *size) for name, size in (inputs | history | own | WATCH).items()}
    has_pose, has_twist, started, frame = (raw[name] > 0.5 for name in ("has_pose", "has_twist", "started", "frame"))
    pose_ok, twist_ok = is_rigid(raw["pose"]), ca.sumsqr(raw["executed"]) < 1e4
    age_ok, fresh = raw["age"] >= 0, raw["age"] <= problem.control.max_age
    measured, told = ca.logic_and(has_pose, pose_ok), ca.logic_and(has_twist, twist_ok)

    sent, lasted = raw["sent"][:, 0], raw["ages"][0]
    least, most = _plausible(problem, raw)
    # What robots report is believed as far as it is what they were sent, or less.
    executed = ca.fmin(ca.fmax(ca.if_else(told, raw["executed"], 0), least), most)
    moved = ca.if_else(told, executed * lasted, sent * lasted + raw["owed_before"] - raw["owed"])
    followed = exp_rotation(raw["stored"], ca.if_else(started, moved, 0))
    pose = ca.if_else(measured, raw["pose"], followed)
    anchors = ca.logic_or(measured, ca.logic_and(frame, raw["posture_ok"]))
    unanchored = ca.logic_not(ca.logic_or(measured, started))

    lost = ca.logic_and(bool(problem.robot.gain_error), ca.logic_not(measured))
    disabled = raw["enable"] < 0.5
    watch = watch_function(problem)
    seen = {"pose": pose, "started": started, "measured": measured, "told": told, "sent": sent, "lasted": lasted}
    seen |= {"executed": ca.if_else(told, raw["executed"], 0), "parked": parked(raw["planned"], raw["sent"])}
    seen |= {"stop": ca.logic_or(disabled, lost), "dt": raw["period"], "slowest": least, "fastest": most}
    *watched, faulty = watch(*({**raw, **seen}[name] for name in watch.name_in()))
    halted = watched[list(WATCH).index("halted")]
    bad = {
        Cause.posture: ca.logic_and(ca.logic_not(raw["posture_ok"]), frame),
        Cause.pose: ca.logic_and(has_pose, ca.logic_not(pose_ok)),
        Cause.twist: ca.logic_and(has_twist, ca.logic_not(twist_ok)),
        Cause.dt: ca.logic_not(raw["dt_ok"]),
        Cause.age: ca.logic_not(age_ok),
        Cause.disabled: disabled,
        Cause.no_frame: ca.logic_not(frame),
        Cause.too_old: ca.logic_and(age_ok, ca.logic_not(fresh)),
        Cause.robot: faulty,
        Cause.unmeasured: lost,
        Cause.halted: ca.logic_and(halted, ca.logic_not(ca.logic_or(faulty, seen["stop"]))),
        Cause.asked: raw["ask"] > 0.5,
        Cause.long_period: raw["period"] > problem.longest_period * (1 + 1e-9),
        Cause.short_periods: ca.logic_not(holds_all(problem, raw["ages"], raw["period"])),
    }
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    outputs = [ca.densify(pose), unanchored, causes, ca.logic_or(started, anchors), *watched]
    return ca.Function("judged", list(raw.values()), outputs, list(raw), [f"out_{i}" for i in range(len(outputs))])


def _plausible(problem: Problem, raw: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Least and greatest twist (6,) that a robot does which does no more than it was sent."""
    least, most = ca.SX(6, 1), ca.SX(6, 1)
    for twist in ca.horzsplit(raw["sent"]):
        least, most = ca.fmin(least, twist), ca.fmax(most, twist)
    if lag := problem.robot.lag:
        least, most = least - raw["tail"][:, 1] / lag, most + raw["tail"][:, 0] / lag
    stretch = 1 + problem.robot.gain_error
    return stretch * least, stretch * most


def stand_in(problem: Problem) -> np.ndarray:
    """Posture that stands in for joints that are not seen: the comfort posture, where the response has one."""
    return np.asarray(getattr(problem.response, "comfort", np.zeros(len(problem.coordinates))), dtype=float)
