"""What is measured of one loop with a person: where it ends, when it rests, what is felt."""

from __future__ import annotations

from typing import Any

import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.simulation.loop import Trace, power_above
from ergoqp.simulation.people.person import Holding
from ergoqp.simulation.people.way import pose_error

EARLY = 20.0
"""When the score is looked at a first time [s]."""
STILL = 10.0
_STAYS = (5e-3, np.radians(1.0))
"""An object that stays this near to where it is goes nowhere [m], [rad]."""
_FILTER = 1.0
"""Time over which the score on the way is the median [s]."""
_RESTS = (1e-3, np.radians(0.2))
"""An object slower than this is at rest [m/s], [rad/s], for a second."""

_BY_CHANCE = ("pushed", "trembling")
"""Kinds that something moves at any time."""


class Watch:
    """Keeps the person as they are after `EARLY`, and ends a loop that goes nowhere any more."""

    def __init__(self, pose: np.ndarray) -> None:
        """Begin with the object at `pose` (4, 4)."""
        self.early: Holding | None = None
        self._stays, self._since, self._calls = pose, 0.0, 0

    def __call__(self, now: float, person: Holding) -> bool:
        """Return whether the loop ends."""
        self._calls += 1
        if self._calls % 10:
            return False
        if self.early is None and now >= EARLY:
            self.early = person.copy()
        moved = pose_error(self._stays, person.pose)
        if np.linalg.norm(moved[:3]) > _STAYS[0] or np.linalg.norm(moved[3:]) > _STAYS[1]:
            self._stays, self._since = person.pose, now
        return now - self._since >= STILL


def rest_score(problem: Problem, person: Holding) -> tuple[int, bool]:
    """Return the exact score of the person's rest where the object is, and whether there is one.

    There is none out of reach, out of balance or where they go on moving; the score is then that of
    the posture itself.
    """
    rest = person.copy()
    reached = rest.rest(person.pose)
    posture = rest.posture if reached else person.posture
    return int(problem.assess(posture).final[0]), reached


def apart_deg(lived: np.ndarray, rest: np.ndarray, dt: float, kind: str) -> float:
    """Return how far a person is from their rest, RMS over the joints [deg].

    At most in the last second, so that nobody rests who sways about it; of `_BY_CHANCE` at least in
    the last 5 s, as a push now and then is no lack of rest.

    Args:
        lived: postures period by period (n, 32) [rad].
        rest: posture of their undisturbed rest (32,) [rad].
        dt: period [s].
        kind: of person.
    """
    apart = np.sqrt(np.mean((lived - rest) ** 2, axis=1))
    if kind in _BY_CHANCE:
        return float(np.degrees(apart[-round(5.0 / dt) :].min()))
    return float(np.degrees(apart[-round(1.0 / dt) :].max()))


def at_rest(trace: Trace, person: Holding, dt: float) -> dict[str, Any]:
    """Return how far the person is from rest after a loop, and what slid or was missed.

    Args:
        trace: of the loop.
        person: at its end.
        dt: its period [s].
    """
    rest = person.copy()
    rest.rest(person.pose)
    return {
        "from_rest_deg": apart_deg(np.array(trace.postures), rest.posture, dt, person.person.kind),
        "slid_mm": 1e3 * person.slid,
        "hand_mm": 1e3 * rest.gap,
        "falls_over": bool(rest.unbalanced or rest.fallen),
    }


def of_trace(problem: Problem, trace: Trace, dt: float) -> dict[str, Any]:
    """Return the numbers of a trace of periods `dt` [s]: times, peak, way, forces.

    Forces count until the person falls or lets go.
    """
    twists = np.array(trace.twists)
    linear, angular = (np.linalg.norm(part, axis=1) for part in (twists[:, :3], twists[:, 3:]))
    rests = (linear < _RESTS[0]) & (angular < _RESTS[1])
    second = round(1.0 / dt)
    windows = np.convolve(rests, np.ones(second), "valid") > second - 0.5
    every = max(1, round(0.05 / dt))
    scores = problem.assess(np.array(trace.postures[::every])).final
    window = max(1, round(_FILTER / (every * dt)))
    views = np.lib.stride_tricks.sliding_window_view(scores, min(window, len(scores)))
    until = min(each for each in (trace.fell, trace.let_go, np.inf) if each is not None)
    felt = np.array(trace.forces)[np.array(trace.time) <= until]
    forces = np.linalg.norm(felt[:, :3], axis=1)
    forces = forces[np.isfinite(forces)]
    return {
        "first_rest": float(np.argmax(windows)) * dt if windows.any() else None,
        "rests": bool(rests[-3 * second :].all()),
        "peak": float(np.median(views, axis=1).max()),
        "path": float(linear.sum() * dt),
        "power": power_above(twists, dt, problem.twist_limit.speed),
        "force": None
        if not forces.size
        else [float(np.median(forces)), float(np.percentile(forces, 99)), float(forces.max())],
        "slips": trace.slips[-1],
        "fell": trace.fell is not None,
        "unbalanced": float(np.mean(trace.unbalanced)),
        "seconds": len(twists) * dt,
    }
