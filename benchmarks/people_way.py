"""What is measured of one loop with a person: where it ends, when it rests, what is felt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.loops import power_above
from ergoqp.problem.geometry import pose_error
from ergoqp.problem.problem import Problem
from ergoqp.rest.person_protocol import Holding
from ergoqp.simulation.loop import Trace

EARLY = 20.0
"""When the score is looked at a first time [s]."""
STILL, DONE, PUSHED = 10.0, 6.0, 13.0
"""How long an object goes nowhere until a loop is over [s]; less where it never moves again.

But for people who are disturbed now and then: so long that they were.
"""
_STAYS = (5e-3, np.radians(1.0))
"""An object that stays this near to where it is goes nowhere [m], [rad]."""
_FILTER = 1.0
"""Time over which the score on the way is the median [s]."""
_RESTS = (1e-3, np.radians(0.2))
"""An object slower than this is at rest [m/s], [rad/s], for a second."""

BY_CHANCE = ("pushed", "trembling")
"""Kinds that something moves at any time."""


class Watch:
    """Keeps the person as they are after `EARLY`, and ends a loop that goes nowhere any more."""

    def __init__(self, pose: np.ndarray, still: float = STILL) -> None:
        """Begin with the object at `pose` (4, 4); end when it is `still` for so long [s]."""
        self.early: Holding | None = None
        self._still = still
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
        return now - self._since >= self._still


@dataclass(frozen=True)
class Rested:
    """A person's undisturbed rest where the object is.

    Attributes:
        holds: whether there is one: not out of reach, out of balance or where they go on moving.
        score: exact score there; without a rest that of the posture itself.
        person: as they came to rest, or tried to.
    """

    holds: bool
    score: int
    person: Holding


def rested(problem: Problem, person: Holding) -> Rested:
    """Return the rest of a person, who stays as they are."""
    there = person.copy()
    holds = there.rest(person.pose)
    posture = there.posture if holds else person.posture
    return Rested(holds, int(problem.assess(posture).final[0]), there)


def apart_deg(lived: np.ndarray, rest: np.ndarray, dt: float, kind: str) -> float:
    """Return how far a person is from their rest, RMS over the joints [deg].

    At most in the last second, so that nobody rests who sways about it; of `BY_CHANCE` at least in
    the last 5 s, as a push now and then is no lack of rest.

    Args:
        lived: postures period by period (n, 32) [rad].
        rest: posture of their undisturbed rest (32,) [rad].
        dt: period [s].
        kind: of person.
    """
    apart = np.sqrt(np.mean((lived - rest) ** 2, axis=1))
    if kind in BY_CHANCE:
        return float(np.degrees(apart[-round(5.0 / dt) :].min()))
    return float(np.degrees(apart[-round(1.0 / dt) :].max()))


def at_rest(trace: Trace, person: Holding, rest: Holding, dt: float) -> dict[str, Any]:
    """Return how far the person is from rest after a loop, and what slid or was missed.

    Args:
        trace: of the loop.
        person: at its end.
        rest: the same at rest there.
        dt: its period [s].
    """
    lived = np.array(trace.postures)
    return {
        "from_rest_deg": apart_deg(lived, rest.posture, dt, person.person.kind),
        "slid_mm": 1e3 * person.slid,
        "hand_mm": 1e3 * rest.gap,
        "falls_over": bool(rest.unbalanced or rest.fallen),
    }


def departures(rests: np.ndarray, second: int) -> int:
    """Return how often an object sets off that was at rest for a second, or at the beginning.

    Args:
        rests: whether it is at rest, period by period (n,).
        second: how many periods that is.
    """
    count, stood = 0, second
    for still in rests:
        count += not still and stood >= second
        stood = stood + 1 if still else 0
    return int(count)


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
        "moves": departures(rests, second),
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
