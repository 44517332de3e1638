"""Time of a control step against the number of support vectors of its cost.

Run ``python -m benchmarks.kernel_scale``.

The problem is ``screwing`` with a support vector machine of the 20 joints of the EPFL report's data
as its cost, the QP and the certification included, interpreted by CasADi unless a figure says
compiled.

- ``us_N``: median of a whole `Stepper.step` call with N support vectors; ``p99_us_N`` its 99th
  percentile. ``us_N.compiled``, for up to 1000: the same compiled.
- ``exp_us_N``: as many exponentials in numpy alone, a floor of what the cost can take.
- ``cost_us_N``: value and gradient of the cost alone; ``sklearn_us_N``: scikit-learn's own
  prediction, the value alone.
- ``us_smooth_reba``, ``us_smooth_reba.compiled``: the step with the sheet's smooth score, in the
  same run.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, run
from ergoqp.costs.load import evaluation_time
from ergoqp.costs.svr import Svr
from ergoqp.datasets.postures import posture_data
from ergoqp.learning.kernels import Columns, Kernel, KernelSum
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.step.stepper import Stepper

COUNTS = (30, 100, 300, 1000, 3000, 10_000)


def machine(count: int) -> tuple[Svr, object]:
    """Fit scikit-learn's machine and keep `count` of its support vectors.

    It is fitted to so many postures that at least `count` become support vectors.
    """
    from sklearn.svm import SVR

    data = posture_data(max(10, count // 8), seed=3)
    mean, scale = data.points.mean(axis=0), data.points.std(axis=0)
    estimator = SVR(epsilon=1e-3).fit((data.points - mean) / scale, data.labels)
    kept = np.argsort(-np.abs(estimator.dual_coef_.ravel()))[:count]
    if len(kept) < count:
        raise RuntimeError(
            f"only {len(kept)} support vectors of {len(data)} postures, {count} wanted"
        )
    centres, weights = estimator.support_vectors_[kept], estimator.dual_coef_.ravel()[kept]
    model = KernelSum(
        Kernel("rbf", estimator._gamma),
        centres,
        weights,
        float(estimator.intercept_[0]),
        mean,
        scale,
    )
    return Svr(Columns(tuple(range(len(mean)))), model, data.coordinates, 1.0), estimator


COMPILED = 1000
"""Most support vectors of a step that is compiled, which takes some seconds."""


def step_times(problem: Problem, steps: int, compiled: bool = False) -> NDArray[np.float64]:
    """Return the times of so many steps near an awkward posture [us]."""
    stepper, rng = Stepper(problem, compiled=compiled), np.random.default_rng(0)
    posture = problem.response.comfort + 0.15  # type: ignore[attr-defined]
    pose = stepper.step(posture).pose
    times = []
    for _ in range(steps):
        noisy = posture + rng.normal(0, 0.01, posture.shape)
        start = time.perf_counter()
        stepper.step(noisy, pose)
        times.append(time.perf_counter() - start)
    return np.array(times[steps // 10 :]) * 1e6


def measure(report: Report) -> None:
    """Measure every size."""
    problem, steps = load_problem("screwing"), report.pick(800, 5000)
    smooth = step_times(problem, steps)
    report.figure("us_smooth_reba", float(np.median(smooth)), "step with the smooth score")
    smooth = step_times(problem, steps, compiled=True)
    report.figure("us_smooth_reba.compiled", float(np.median(smooth)))
    for count in report.pick(COUNTS[:5], COUNTS):
        cost, estimator = machine(count)
        times = step_times(problem.replace(cost=cost), steps)
        report.figure(f"us_{count}", float(np.median(times)), f"step with {count} support vectors")
        report.figure(f"p99_us_{count}", float(np.percentile(times, 99)))
        if count <= COMPILED:
            times = step_times(problem.replace(cost=cost), steps, compiled=True)
            report.figure(f"us_{count}.compiled", float(np.median(times)))
        arguments, least = -np.linspace(0.0, 2.0, count), np.inf
        for _ in range(300):
            start = time.perf_counter()
            np.exp(arguments)
            least = min(least, time.perf_counter() - start)
        report.figure(f"exp_us_{count}", 1e6 * least)
        states = cost.coordinates.spread(posture_data(20, seed=4).points)
        report.figure(
            f"cost_us_{count}",
            evaluation_time(cost.value_and_gradient, states),
            "value and gradient",
        )
        row = ((cost.coordinates.read(states[0]) - cost.model.mean) / cost.model.scale).reshape(
            1, -1
        )
        calls = []
        for _ in range(300):
            start = time.perf_counter()
            estimator.predict(row)  # type: ignore[attr-defined]
            calls.append(time.perf_counter() - start)
        report.figure(
            f"sklearn_us_{count}", float(np.median(calls)) * 1e6, "scikit-learn, value alone"
        )


if __name__ == "__main__":
    run(measure, "Time of a control step against the number of support vectors.")
