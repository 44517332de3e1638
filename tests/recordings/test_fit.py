"""The fit itself: derivatives, any posture found from a cold start, points that come and go."""

import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.recordings.fitting.centre_model import BASE, UNKNOWNS, CentreModel
from ergoqp.recordings.fitting.observe import observable_joints
from ergoqp.recordings.fitting.posture_fit import fit
from ergoqp.recordings.naming import CENTRES


@pytest.fixture(scope="module")
def model() -> CentreModel:
    return CentreModel(Body.of_stature(1.7), CENTRES)


def configuration(generator: np.random.Generator, margin: float = 0.2) -> np.ndarray:
    """A pelvis somewhere, heading anywhere, and a posture inside the ranges."""
    base = generator.uniform([-2, -2, 0.5, -np.pi], [2, 2, 1.5, np.pi])
    return np.concatenate(
        [base, LOWER + (UPPER - LOWER) * generator.uniform(margin, 1 - margin, len(JOINTS))]
    )


def test_the_jacobian_is_the_derivative(model: CentreModel):
    generator = np.random.default_rng(0)
    for _ in range(5):
        z = configuration(generator)
        jacobian = model(z)[1].copy()
        step = 1e-6
        for i in range(UNKNOWNS):
            ahead, behind = z.copy(), z.copy()
            ahead[i] += step
            behind[i] -= step
            difference = (model(ahead)[0].copy() - model(behind)[0].copy()).ravel() / (2 * step)
            assert jacobian[:, i] == pytest.approx(difference, abs=1e-8)


def test_any_posture_is_found_without_a_frame_before(model: CentreModel):
    generator = np.random.default_rng(1)
    for _ in range(25):
        z = configuration(generator)
        found = fit(model, model(z)[0].copy()[None])
        assert found.error[0] < 0.004
        assert found.observed.all()


def test_every_joint_is_told_by_all_centres_and_none_by_one(model: CentreModel):
    everything = np.ones(len(CENTRES), dtype=bool)
    assert observable_joints(model, everything).all()
    assert not observable_joints(model, np.array([name == "right_hip" for name in CENTRES])).any()
    assert not observable_joints(model, ~everything).any()


def test_points_that_are_lost_for_a_while(model: CentreModel):
    start = configuration(np.random.default_rng(4), margin=0.35)
    path = np.stack(
        [start + 0.02 * i * np.eye(UNKNOWNS)[BASE + INDEX["left_elbow_flexion"]] for i in range(12)]
    )
    targets = np.stack([model(z)[0].copy() for z in path])
    hand = [CENTRES.index(f"left_{name}") for name in ("wrist", "knuckles", "thumb")]
    targets[4:7][:, hand] = np.nan
    targets[9] = np.nan
    found = fit(model, targets)
    elbow = INDEX["left_elbow_flexion"]
    assert (
        found.observed[:, elbow].tolist()
        == [True] * 4 + [False] * 3 + [True] * 2 + [False] + [True] * 2
    )
    assert (found.configurations[4:7, BASE + elbow] == 0).all()
    assert found.configurations[[0, 3, 7, 8, 10, 11], BASE + elbow] == pytest.approx(
        path[[0, 3, 7, 8, 10, 11], BASE + elbow], abs=0.02
    )
    assert np.isnan(found.error[9])
    assert np.array_equal(found.configurations[9], found.configurations[8])
    assert np.nanmax(found.error) < 0.004


def test_a_leap_starts_afresh(model: CentreModel):
    generator = np.random.default_rng(11)
    path = [configuration(generator) for _ in range(6)]
    found = fit(model, np.stack([model(z)[0].copy() for z in path]))
    assert found.error.max() < 0.004
