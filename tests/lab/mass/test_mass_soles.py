"""The soles of a person with mass stay where they stand while the object leads the hand."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.lab.mass import person as holding
from ergoqp.lab.mass.body import FRICTION, cross
from ergoqp.lab.mass.control import shared
from ergoqp.problem.geometry import between
from ergoqp.problem.load import load_problem
from ergoqp.simulation.people import person_of_kind

SOLE = np.array([[x, y, 0.0] for x in (-0.05, 0.18) for y in (-0.15, -0.06, 0.06, 0.15)])
WEIGHT = 600.0


def wrench(force: tuple[float, float, float], at: tuple[float, float]) -> np.ndarray:
    """Return a force with its torque about the origin, where it acts on the floor."""
    return np.concatenate([force, cross(np.array([*at, 0.0]), np.array(force))])


def pushed(wanted: np.ndarray) -> np.ndarray:
    """Return the forces (8, 3) of the corners of two soles, each of which floor can give."""
    forces = shared(SOLE, wanted, np.ones(len(SOLE)))
    assert (forces[:, 2] >= -1e-9).all()
    assert (np.linalg.norm(forces[:, :2], axis=1) <= FRICTION * forces[:, 2] + 1e-9).all()
    return forces


@pytest.mark.parametrize("at", [(0.05, 0.0), (0.17, 0.1), (-0.045, 0.0)])
def test_what_the_floor_can_give_is_given(at: tuple[float, float]) -> None:
    wanted = wrench((30.0, -10.0, WEIGHT), at)
    forces = pushed(wanted)
    np.testing.assert_allclose(forces.sum(axis=0), wanted[:3], atol=1.0)
    np.testing.assert_allclose(cross(SOLE, forces).sum(axis=0), wanted[3:], atol=0.5)


@pytest.mark.parametrize("ahead", [0.16, 0.18, 0.2, 0.3, 0.5])
def test_beyond_the_toes_the_pressure_stays_under_them(ahead: float) -> None:
    forces = pushed(wrench((0.0, 0.0, WEIGHT), (ahead, 0.0)))
    np.testing.assert_allclose(forces[:, 2].sum(), WEIGHT, rtol=0.15)
    centre = SOLE[:, 0] @ forces[:, 2] / forces[:, 2].sum()
    np.testing.assert_allclose(centre, min(ahead, 0.18), atol=0.002)
    assert np.abs(forces[:, :2]).max() < 1.0


def test_beyond_friction_nobody_asks_the_floor_to_hold() -> None:
    forces = pushed(wrench((WEIGHT, 0.0, WEIGHT), (0.05, 0.0)))
    assert 0 < forces[:, 0].sum() < FRICTION * forces[:, 2].sum()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "way"),
    [
        ("screwing", 1000, (-0.25, 0.05, 0.1)),
        ("screwing", 1003, (-0.2, 0.15, 0.2)),
        ("low_bin", 1001, (0.15, 0.0, -0.15)),
        ("overhead", 1000, (0.1, 0.2, -0.2)),
    ],
)
def test_soles_stay_while_the_hand_is_led_at_full_speed(
    name: str, seed: int, way: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(holding, "STILL", 2.0)
    problem = load_problem(name)
    who = person_of_kind("mass", problem, seed)
    led = who.hold(who.comfort)
    home, there = led.pose.copy(), led.pose.copy()
    there[:3, 3] += way
    seconds = float(np.linalg.norm(way)) / problem.twist_limit.speed[:3].max()
    for begin, end in ((home, there), (there, home)):
        for moment in np.arange(0.05, seconds + 1.0, 0.05):
            led.follow(between(begin, end, min(1.0, moment / seconds)), 0.05)
    assert not led.fallen
    assert not led.unbalanced
    assert led.slid < 0.005
