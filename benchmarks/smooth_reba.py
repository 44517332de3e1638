"""The smooth score against the exact one, and its derivative against differences.

Run ``python -m benchmarks.smooth_reba``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, run
from ergoqp import reba
from ergoqp.costs.load import evaluation_time
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.datasets.postures import balanced_postures
from ergoqp.joints import JOINTS

Array = NDArray[np.float64]


def accuracy(
    report: Report, postures: Array, scores: NDArray[np.int64], mixture: SmoothReba
) -> None:
    """Report V's error against the exact sheet: at 0.25 deg, and of the controller's mixture."""
    value = mixture(postures)
    report.figure(
        "mixture.mae",
        np.abs(value - scores).mean(),
        f"points, tau {mixture.taus_deg} deg, the controller's own",
    )
    report.figure(
        "mixture.exact",
        (np.round(value) == scores).mean(),
        "share whose rounded value is the score",
    )
    value = SmoothReba((0.25,), (1.0,))(postures)
    error, rounded = np.abs(value - scores), np.round(value)
    report.figure("mae", error.mean(), "points, tau 0.25 deg")
    report.figure("exact", (rounded == scores).mean(), "share whose rounded value is the score")
    report.figure(
        "within1", (np.abs(rounded - scores) <= 1).mean(), "share within one point, rounded"
    )
    report.figure("spearman", spearman(value, scores), "rank correlation")
    report.figure("worst", error.max(), "points")


def spearman(first: Array, second: NDArray) -> float:
    """Return the rank correlation; ties get their mean rank."""
    ranks = []
    for values in (first, second):
        _, group, size = np.unique(values, return_inverse=True, return_counts=True)
        last = np.cumsum(size)
        ranks.append((last - (size - 1) / 2)[group])
    return float(np.corrcoef(*ranks)[0, 1])


def monte_carlo_error(postures: Array, draws: int, rng: np.random.Generator) -> float:
    """Return the root mean square of (closed form - sampled mean) / standard error at 5 deg.

    It is 1 for an exact closed form.
    """
    tau = np.radians(5.0)
    value = SmoothReba((5.0,), (1.0,))(postures)
    ratios = []
    for posture, expected in zip(postures, value, strict=True):
        noisy = posture + rng.logistic(scale=tau / 2, size=(draws, len(JOINTS)))
        # Noise may leave +-180 deg, where the sheet's outer bands go on but `assess` suspects
        # degrees.
        sampled = reba.assess(np.clip(noisy, -np.pi, np.pi)).final
        ratios.append((sampled.mean() - expected) / (sampled.std() / np.sqrt(draws)))
    return float(np.sqrt(np.mean(np.square(ratios))))


def gradient_error(cost: SmoothReba, postures: Array) -> float:
    """Return the largest |gradient - differences| relative to |differences|.

    The differences are central, with Richardson extrapolation to sixth order.
    """
    worst = 0.0
    for posture in postures:
        exact = cost.value_and_gradient(posture)[1].full().ravel()
        steps = [np.radians(0.05) * np.eye(len(JOINTS)) * factor for factor in (1, 2, 3)]
        one, two, three = ((cost(posture + h) - cost(posture - h)) / (2 * h.max()) for h in steps)
        differences = 1.5 * one - 0.6 * two + 0.1 * three
        worst = max(worst, float(np.linalg.norm(exact - differences) / np.linalg.norm(differences)))
    return worst


def flat_share(cost: SmoothReba, postures: Array, scores: NDArray[np.int64]) -> tuple[float, float]:
    """Return the share of postures above 1 with a gradient below 1e-6 points per rad.

    Also return the smallest gradient.
    """
    function = cost.value_and_gradient.map(len(postures))
    gradients = np.asarray(function(postures.T)[1])
    norms = np.linalg.norm(gradients, axis=0)[scores > 1]
    return float((norms < 1e-6).mean()), float(norms.min())


def measure(report: Report) -> None:
    """Measure the smooth score."""
    rng = np.random.default_rng(2024)
    postures, scores = balanced_postures(1000, rng)
    mixture = SmoothReba()
    accuracy(report, postures, scores, mixture)
    sampled, draws = report.pick((50, 20_000), (200, 100_000))
    report.figure(
        "mc_error",
        monte_carlo_error(postures[:sampled], draws, rng),
        "standard errors, root mean square; ideal 1",
    )
    gradient = gradient_error(mixture, postures[: report.pick(300, 3000)])
    report.figure("gradient_error", gradient, "largest, relative, of the mixture")
    flat, smallest = flat_share(mixture, postures, scores)
    report.figure(
        "flat_share", flat, f"of the postures above 1; smallest gradient {smallest:.3g} points/rad"
    )
    report.figure(
        "step_us",
        evaluation_time(mixture.value_and_gradient, postures, len(postures)),
        "median, value and gradient of the mixture",
    )
    one = evaluation_time(SmoothReba((1.5,), (1.0,)).value_and_gradient, postures, len(postures))
    report.say(f"value and gradient of one width: {one:.3g} us")


if __name__ == "__main__":
    run(measure, "The smooth REBA score: accuracy, exactness of closed form and gradient, speed.")
