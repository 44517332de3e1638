"""The name of a fault, against a least-squares fit by NumPy and the rules in plain words."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest

from ergoqp.step.causes import Fault, fault_of, fault_sentence


@cache
def named() -> ca.Function:
    fit, Y, y = ca.SX.sym("fit", 5), ca.SX.sym("Y", 6), ca.SX.sym("y", 6)
    return ca.Function("fault", [fit, Y, y], [fault_of(fit, Y, y)])


def of(sent: np.ndarray, seen: np.ndarray, changes: np.ndarray) -> tuple[int, float]:
    """Kind and amount of what moved in samples (n, 6): sent, seen, and by how much the sent twist
    changed since the fault."""
    products = [
        (a * b).sum()
        for a, b in (
            (sent, sent),
            (sent, changes),
            (changes, changes),
            (sent, seen),
            (changes, seen),
        )
    ]
    kind, amount = np.array(named()(products, sent.sum(axis=0), seen.sum(axis=0))).ravel()
    return int(kind), float(amount)


def plain(sent: np.ndarray, seen: np.ndarray, changes: np.ndarray) -> tuple[int, float]:
    """The same in plain words: seen = gain sent - late changes."""
    Y, y = sent.sum(axis=0), seen.sum(axis=0)
    if y @ y >= (sent**2).sum() * 1e6:
        return Fault.unasked, 0.0
    columns = np.column_stack([sent.ravel(), -changes.ravel()])
    (gain, late), *_ = np.linalg.lstsq(columns, seen.ravel(), rcond=None)
    if np.linalg.matrix_rank(columns, tol=1e-9) < 2:
        gain, late = (sent * seen).sum() / (sent**2).sum(), 0.0
    aside = y - (y @ Y) / (Y @ Y) * Y
    if np.linalg.norm(aside) > 0.5 * np.linalg.norm(Y):
        return Fault.another_axis, 0.0
    if late > 1e-3 and late * np.linalg.norm(changes) > abs(gain - 1) * np.linalg.norm(sent):
        return Fault.late, late
    return (Fault.stands_still, 0.0) if abs(gain) < 0.15 else (Fault.factor, gain)


@pytest.mark.parametrize("seed", range(120))
def test_the_fault_that_fits_best_is_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sent = np.cumsum(rng.normal(0, 1e-4, (20, 6)), axis=0) + rng.normal(0, 1e-3, 6)
    changes = 50 * np.diff(sent, axis=0, prepend=sent[:1]) if seed % 4 else np.zeros((20, 6))
    gain, late = (
        rng.choice([-1.0, -0.1, 0.0, 0.1, 0.2, 0.5, 1.0, 1.3]),
        rng.choice([0.0, 0.01, 0.05]),
    )
    seen = gain * sent - late * changes + rng.normal(0, 1e-6, sent.shape)
    if seed % 7 == 3:
        seen = seen[:, [1, 2, 0, 4, 5, 3]]
    if seed % 11 == 5:
        sent = 1e-9 * sent
    kind, amount = of(sent, seen, changes)
    expected, value = plain(sent, seen, changes)
    assert kind == expected
    assert amount == pytest.approx(value, rel=1e-4, abs=1e-6)


def test_every_kind_is_met_and_has_a_sentence() -> None:
    sent = np.tile([1e-3, 0, 0, 0, 0, 0], (10, 1))
    rising, changes = (
        np.outer(part, [1, 0, 0, 0, 0, 0])
        for part in (1e-4 * np.arange(10), np.linspace(0.01, 0.03, 10))
    )
    none = np.zeros((10, 6))
    assert of(sent, 1.4 * sent, none) == (Fault.factor, pytest.approx(1.4))
    assert of(sent, 0.1 * sent, none)[0] == Fault.stands_still
    assert of(sent, -0.1 * sent, none)[0] == Fault.stands_still
    assert of(sent, -0.5 * sent, none) == (Fault.factor, pytest.approx(-0.5))
    assert fault_sentence(Fault.factor, -0.5) == "robot: moves backward, 0.5 times what was sent"
    assert of(sent, sent[:, ::-1], none)[0] == Fault.another_axis
    assert of(none, sent, none)[0] == Fault.unasked
    assert of(sent + rising, sent + rising - 0.02 * changes, changes) == (
        Fault.late,
        pytest.approx(0.02),
    )
    said = {kind: fault_sentence(kind, 0.25) for kind in Fault}
    assert said[Fault.none] == ""
    entry = " (if it always does, declare [robot] "
    assert said[Fault.factor] == f"robot: moves 0.2 times what was sent{entry}gain_error)"
    assert said[Fault.late] == f"robot: late by 250 ms{entry}delay, lag)"
    assert said[Fault.pose_jumps] == "robot: pose jumps by 250 mm"
    assert said[Fault.pose_turns] == "robot: pose jumps by 14.3 deg"
    # Noise is rounded up, so that a little more of it is the same sentence.
    assert fault_sentence(Fault.position_scatters, 0.0011) == (
        f"robot: the measured position scatters by 2 mm at rest{entry}pose_noise = 0.002)"
    )
    assert fault_sentence(Fault.orientation_scatters, np.radians(0.34)) == (
        f"robot: the measured orientation scatters by 0.5 deg at rest{entry}pose_noise_deg = 0.5)"
    )
    assert fault_sentence(Fault.position_scatters, 0.002) == fault_sentence(
        Fault.position_scatters, 0.0011
    )
    assert [int(kind) for kind in Fault] == list(range(11))
    assert len(set(said.values())) == len(Fault)
    for amount in (0.996, 1.004):
        assert fault_sentence(Fault.factor, amount) == "robot: drifts from what was sent"
    for amount in (0.994, 1.006):
        assert fault_sentence(Fault.factor, amount).startswith(
            f"robot: moves {amount:.2f} times what was sent (if"
        )


@pytest.mark.parametrize(
    ("gain", "late", "said"),
    [
        (1.0, 0.05, "robot: late by 50 ms"),
        # It was said to be late by 0 ms.
        (1.0, 4e-4, "robot: drifts"),
        (1.2, 4e-4, "robot: moves 1.20 times"),
    ],
)
def test_what_is_late_by_less_than_a_millisecond_is_on_time(
    gain: float, late: float, said: str
) -> None:
    rng = np.random.default_rng(0)
    sent = rng.normal(size=(9, 6)) + 2 * np.eye(6)[0]
    changes = 0.2 * rng.normal(size=(9, 6))
    assert fault_sentence(*of(sent, gain * sent - late * changes, changes)).startswith(said)
