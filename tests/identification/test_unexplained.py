"""What no traits explain, with the Gaussian process of scikit-learn as the independent source."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.identification.identify import NOISES, REACH, WIDTHS, Unexplained
from ergoqp.problem.geometry import turn_about

JOINTS = 3
NOISE = NOISES[1]


def places(count: int, seed: int) -> list[np.ndarray]:
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        pose = np.eye(4)
        pose[:3, 3] = rng.uniform(-0.3, 0.3, 3)
        pose[:3, :3] = turn_about(2, rng.uniform(-1, 1)) @ turn_about(1, rng.uniform(-1, 1))
        found.append(pose)
    return found


def features(poses: list[np.ndarray]) -> np.ndarray:
    return np.array([[*pose[:3, 3], *(0.3 * pose[:3, 0])] for pose in poses])


def drawn(width: float, seed: int, count: int = 12) -> tuple[list[np.ndarray], np.ndarray]:
    """Rests of joints that are a Gaussian process of this width, and noise."""
    rng, poses = np.random.default_rng(seed), places(count, seed)
    x = features(poses)
    alike = np.exp(-0.5 * np.sum((x[:, None] - x[None]) ** 2, axis=2) / REACH**2)
    root = np.linalg.cholesky(alike + 1e-10 * np.eye(count))
    field = width * root @ rng.standard_normal((count, JOINTS))
    return poses, field + NOISE * rng.standard_normal((count, JOINTS))


@pytest.mark.parametrize("width", WIDTHS[1:])
def test_it_is_the_gaussian_process_of_scikit_learn(width: float) -> None:
    process = pytest.importorskip("sklearn.gaussian_process")
    kernels = pytest.importorskip("sklearn.gaussian_process.kernels")
    poses, beyond = drawn(width, 1)
    kernel = kernels.ConstantKernel(width**2, "fixed") * kernels.RBF(REACH, "fixed")
    other = process.GaussianProcessRegressor(kernel, alpha=NOISE**2, optimizer=None)
    other.fit(features(poses), beyond)
    ours = Unexplained(poses, beyond, (width,), (NOISE,))
    for pose in places(5, 2):
        mean, deviation = ours.at(pose)
        told, spread = other.predict(features([pose]), return_std=True)
        np.testing.assert_allclose(mean, told.ravel(), atol=1e-10)
        np.testing.assert_allclose(deviation, spread.ravel(), atol=1e-8)


def test_the_likeliest_width_and_noise_are_taken() -> None:
    kernels = pytest.importorskip("sklearn.gaussian_process.kernels")
    process = pytest.importorskip("sklearn.gaussian_process")
    for seed, width in enumerate(WIDTHS):
        poses, beyond = drawn(width, seed)
        likely = {}
        for noise in NOISES:
            for each in WIDTHS[1:]:
                kernel = kernels.ConstantKernel(each**2, "fixed") * kernels.RBF(REACH, "fixed")
                other = process.GaussianProcessRegressor(kernel, alpha=noise**2, optimizer=None)
                other.fit(features(poses), beyond)
                likely[each, noise] = other.log_marginal_likelihood_value_
            squares = np.sum(beyond**2) / noise**2
            volume = beyond.size * np.log(2 * np.pi * noise**2)
            likely[0.0, noise] = -0.5 * float(squares + volume)
        best = max(likely, key=lambda each: likely[each])
        found, told = Unexplained(poses, beyond), Unexplained(poses, beyond, best[:1], best[1:])
        assert found.width == best[0]
        for ours, theirs in zip(found.at(np.eye(4)), told.at(np.eye(4)), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_who_is_the_model_is_left_as_they_are() -> None:
    found = 0
    for seed in range(20):
        poses, beyond = drawn(0.0, seed)
        found += Unexplained(poses, beyond).width > 0
    assert found <= 4
    nobody = Unexplained(poses, beyond, (0.0,))
    for part in nobody.at(poses[0]):
        np.testing.assert_array_equal(part, 0.0)


def test_what_was_not_seen_and_flukes_count_for_nothing() -> None:
    poses, beyond = drawn(WIDTHS[-1], 3)
    hidden = beyond.copy()
    hidden[4, 1] = np.nan
    fluke = beyond.copy()
    fluke[4, 1] = np.radians(40)
    only = (WIDTHS[-1:], NOISES[1:])
    without = Unexplained([*poses[:4], *poses[5:]], np.delete(beyond, 4, axis=0), *only)
    for given in (hidden, fluke):
        found = Unexplained(poses, given, *only)
        mean, deviation = found.at(poses[4])
        expected = without.at(poses[4])
        assert mean[1] == pytest.approx(expected[0][1], abs=1e-5)
        assert deviation[1] == pytest.approx(expected[1][1], abs=1e-5)
        # The other joints were seen there.
        assert np.all(deviation[[0, 2]] < deviation[1])


def test_far_away_nothing_is_known() -> None:
    poses, beyond = drawn(WIDTHS[2], 5)
    far = np.eye(4)
    far[:3, 3] = 5.0
    mean, deviation = Unexplained(poses, beyond, (WIDTHS[2],)).at(far)
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(deviation, WIDTHS[2])


def test_what_was_not_seen_decides_neither_width_nor_noise() -> None:
    for seed in range(20):
        rng, poses = np.random.default_rng(seed), places(10, seed)
        beyond = NOISES[1] * rng.standard_normal((10, 20))
        hidden = np.where(rng.random(beyond.shape) < 0.4, np.nan, beyond)
        assert Unexplained(poses, hidden).width == 0.0
        # Ten joints that nobody ever saw are no joints.
        never = beyond.copy()
        never[:, 10:] = np.nan
        seen = Unexplained(poses, beyond[:, :10])
        assert Unexplained(poses, never).width == seen.width == 0.0
