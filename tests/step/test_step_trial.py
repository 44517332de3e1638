"""The trial of a given place against the same rules in plain words, over random histories and a
whole journey."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp.problem.settings import Control
from ergoqp.step.rest import (
    AFTER,
    BACK,
    DESCENT,
    FIRM,
    LOOK,
    STATES,
    THERE,
    TRIAL,
    UNKNOWN,
    trial_update,
)

CONTROL = Control()


def compiled() -> ca.Function:
    names = ("distance", "on", "promise", "points", "dt", "counts")
    trial, rest, pose = (
        ca.SX.sym("trial", TRIAL),
        ca.SX.sym("rest", STATES),
        ca.SX.sym("pose", 4, 4),
    )
    known = [ca.SX.sym(name) for name in names]
    return ca.Function(
        "trial", [trial, rest, pose, *known], list(trial_update(CONTROL, trial, rest, pose, *known))
    )


UPDATE = compiled()


def update(
    trial: np.ndarray, rest: np.ndarray, pose: np.ndarray, **known: float
) -> tuple[np.ndarray, np.ndarray]:
    names = ("distance", "on", "promise", "points", "dt", "counts")
    after, rests = UPDATE(trial, rest, pose, *(known[name] for name in names))
    return np.array(after).ravel(), np.array(rests).ravel()


def plain(
    trial: np.ndarray,
    rest: np.ndarray,
    pose: np.ndarray,
    *,
    distance: float,
    on: bool,
    promise: float,
    points: float,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """One frame that counts."""
    if not on:
        return np.zeros(TRIAL), rest
    phase, tried, worth, before, closest, waited, cost = trial[:7]
    began = trial[7:].copy()
    cost = points if cost <= 0 else cost + min(1.0, dt / CONTROL.rest_filter) * (points - cost)
    expected = (worth if tried else promise) + CONTROL.guide_gain
    # Descent has ended: it rests, or it has improved nothing for so long.
    ended = rest[0] == 1 or rest[5] >= CONTROL.stall_after
    waited += dt
    next_phase, judged, arrived_back = phase, False, False
    if phase in (THERE, BACK):
        if distance < closest - 0.02:
            closest, waited = distance, 0.0
        if distance < 0.05 or waited > 1.5:
            next_phase, arrived_back = (LOOK, False) if phase == THERE else (DESCENT, True)
    if phase == DESCENT and ended and cost > expected:
        next_phase, before, began = THERE, cost, np.concatenate([pose[:3, 3], pose[:3, 0]])
    worse = phase in (THERE, LOOK) and cost > trial[3] + CONTROL.guide_price
    looked = phase == LOOK and waited > 1.0
    if looked:
        next_phase = AFTER
        judged = cost <= expected
    if worse or (phase == AFTER and ended):
        judged = True
    if judged:
        worth, tried = cost, 1.0
        # A firm place is judged by somebody else, but for what the way there costs.
        own = worse or promise > -1.5e9
        next_phase = BACK if own and cost > trial[3] + 0.1 else DESCENT
    if next_phase != phase:
        closest, waited = 1e9, 0.0
    after = np.array([next_phase, tried, worth, before, closest, waited, cost, *began])
    still = next_phase == LOOK or arrived_back
    if still or next_phase in (THERE, BACK) or (looked and next_phase == AFTER):
        rest = np.array([float(still), 0, rest[2], rest[3], rest[3], 0])
    return after, rest


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 2**32 - 1))
def test_a_trial_goes_by_its_rules(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, 3] = rng.normal(size=3)
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    phase = rng.integers(0, 5)
    cost, before = rng.uniform(1, 5), rng.uniform(1, 5)
    trial = np.array(
        [
            phase,
            rng.integers(0, 2),
            rng.uniform(1, 5),
            before,
            rng.uniform(0, 1),
            rng.uniform(0, 2),
            cost,
            *rng.normal(size=6),
        ]
    )
    if rng.random() < 0.1:
        trial[:] = 0.0
    rest = np.array(
        [
            rng.integers(0, 2),
            rng.uniform(0, 0.4),
            rng.uniform(0, 1),
            rng.uniform(1, 4),
            1.0,
            rng.uniform(0, 3),
        ]
    )
    known = {
        "distance": float(
            rng.choice([0.04, 0.06, trial[4] - 0.01, trial[4] - 0.03, rng.uniform(0, 2)])
        ),
        "promise": float(rng.choice([UNKNOWN, FIRM, rng.uniform(0, 4)])),
        "points": rng.uniform(1, 5),
        "dt": float(rng.choice([0.01, 0.05, 1.0])),
    }
    on = bool(rng.random() < 0.95)
    for expected, found in zip(
        plain(trial, rest, pose, on=on, **known),
        update(trial, rest, pose, on=on, counts=1, **known),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    if on:
        # What judges nothing changes nothing.
        same, rested = update(trial, rest, pose, on=1, counts=0, **known)
        np.testing.assert_array_equal(same, trial)
        np.testing.assert_array_equal(rested, rest)


@pytest.mark.parametrize(
    ("at_place", "ends"), [(2.0, DESCENT), (3.05, DESCENT), (3.5, BACK), (5.0, BACK)]
)
def test_a_whole_journey(at_place: float, ends: int) -> None:
    """From rest at 3 points: there, a look, and back where the place is worse than where it
    began."""
    trial, pose, phases = np.zeros(TRIAL), np.eye(4), []
    distance = 1.0
    for _ in range(800):
        phase = trial[0]
        distance = (
            max(0.0, distance - 0.01)
            if phase in (THERE, BACK)
            else 1.0
            if phase == DESCENT
            else distance
        )
        points = 3.0 if phase in (DESCENT, THERE, BACK) else at_place
        resting = phase in (DESCENT, AFTER)
        given = np.array([float(resting), 0, 0, points, points, 0])
        trial, _ = update(
            trial,
            given,
            pose,
            distance=distance,
            on=1,
            promise=1.0,
            points=points,
            dt=0.01,
            counts=1,
        )
        if trial[0] != phase:
            phases.append(int(trial[0]))
            if trial[0] in (LOOK, AFTER):
                distance = 1.0
        if len(phases) >= 3 and phases[-1] in (DESCENT, BACK):
            break
    assert phases[:2] == [THERE, LOOK]
    assert phases[-1] == ends
    assert trial[1] == 1
