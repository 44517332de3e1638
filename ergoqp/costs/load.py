"""The kinds of learned costs: loading one from its file, and how well it predicts unseen scores."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import LARGEST_SEED, Progress, check_whole, unseen
from ergoqp.costs.cost import LearnedCost
from ergoqp.datasets.data import DataSet
from ergoqp.errors import InputError, ModelError, last_line
from ergoqp.expressions import Evaluator
from ergoqp.learning.model_file import load_model

KINDS: Final[dict[str, str]] = {
    "quadratic": "ergoqp.costs.quadratic:Quadratic",
    "gmr": "ergoqp.costs.gmr:Gmr",
    "svr": "ergoqp.costs.svr:Svr",
    "one_class_ladder": "ergoqp.costs.one_class_ladder:OneClassLadder",
    "neural": "ergoqp.costs.neural:Neural",
    "sklearn": "ergoqp.costs.from_sklearn:SklearnCost",
}
"""Module and class of each kind of learned cost. To add one, write the class and a line here."""


def load_cost(path: Path | str) -> LearnedCost:
    """Return the cost that :meth:`LearnedCost.save` wrote.

    Raises:
        ModelError: if the file does not exist, is truncated or changed, or holds something
            else.

    Example:
        >>> import numpy as np
        >>> import tempfile
        >>> from pathlib import Path
        >>> import ergoqp
        >>> from ergoqp.costs.quadratic import Quadratic
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "cost.npz"
        ...     Quadratic(1.0, np.zeros(1), np.ones(1), ["trunk_flexion"], 1.0).save(path)
        ...     cost = ergoqp.load_cost(path)
        >>> cost.name, cost.minimum
        ('quadratic', 1.0)
    """
    header, arrays = load_model(path)
    kind = header.get("kind")
    if kind not in KINDS:
        raise ModelError(
            f"{Path(path).name}: holds a model of kind {kind!r}, allowed {', '.join(KINDS)}"
        )
    module, name = KINDS[kind].split(":")
    try:
        make = getattr(import_module(module), name).from_parts
        cost = make(header["settings"], arrays, header["coordinates"], header["minimum"])
        # Evaluate the cost once, to find arrays that do not fit together.
        value = cost(np.zeros((1, len(cost.coordinates.state))))
        if not np.isfinite([*value, cost.minimum]).all():
            raise ValueError("its value is not a number")
        return cost
    except (
        KeyError,
        TypeError,
        ValueError,
        IndexError,
        AttributeError,
        RuntimeError,
        OverflowError,
    ) as error:
        raise ModelError(
            f"{Path(path).name}: does not hold what a model of kind {kind!r} needs"
            f" ({last_line(error)})"
        ) from None


@dataclass(frozen=True)
class Quality:
    """Agreement of predicted values with true scores.

    Attributes:
        mae: mean absolute error of the value, not rounded [points].
        exact: share whose rounded value is the score.
        within1: share whose rounded value is at most one point off.
        spearman: rank correlation; ties get their mean rank; 0 if all values are the same.
        worst: largest absolute error [points].
    """

    mae: float
    exact: float
    within1: float
    spearman: float
    worst: float

    def as_dict(self) -> dict[str, float]:
        """Return the measures by name."""
        return asdict(self)


def quality_of(values: NDArray[np.float64], scores: NDArray) -> Quality:
    """Compare predicted values with true scores.

    Args:
        values: predicted (n,) [points].
        scores: true (n,) [points].

    Returns:
        Mean and largest error [points], shares of exact and nearly exact values, rank correlation.

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.load import quality_of
        >>> quality = quality_of(np.array([1.2, 2.9, 5.4]), np.array([1, 3, 4]))
        >>> round(quality.mae, 2), round(quality.exact, 2), quality.spearman
        (0.57, 0.67, 1.0)
    """
    error, off = np.abs(values - scores), np.abs(np.round(values) - scores)
    exact, within1 = float((off == 0).mean()), float((off <= 1).mean())
    rank = spearman(values, scores)
    return Quality(float(error.mean()), exact, within1, rank, float(error.max()))


def spearman(first: NDArray, second: NDArray) -> float:
    """Return the rank correlation of two sequences of numbers.

    Ties get their mean rank. A constant sequence gives 0.
    """
    from scipy.stats import rankdata

    ranks = [rankdata(values) for values in (first, second)]
    return float(np.corrcoef(*ranks)[0, 1]) if all(map(np.ptp, ranks)) else 0.0


def cross_validate(
    fit: Callable[[DataSet], LearnedCost],
    data: DataSet,
    folds: int,
    seed: int = 0,
    progress: Progress = unseen,
) -> tuple[NDArray[np.float64], list[Quality]]:
    """Fit to all folds but one and predict that one, for each fold.

    Args:
        fit: makes a cost from data.
        data: all data.
        folds: number of folds, 2 or more.
        seed: seed of the shuffle.
        progress: called with the share that is done.

    Returns:
        The prediction of each point (n,) by the model that was not fitted to it, and the
        quality on each fold.

    Raises:
        InputError: if the number of folds is not possible with these data.
    """
    if len(data) < 2:
        raise InputError(f"folds: got data of {len(data)} points, allowed at least 2")
    check_whole("folds", folds, 2, len(data))
    check_whole("seed", seed, 0, LARGEST_SEED)
    fold = np.random.default_rng(seed).permutation(len(data)) % folds
    values, found = np.zeros(len(data)), []
    for number in range(folds):
        held = fold == number
        cost = fit(data.part(~held))
        values[held] = cost.predict(data.points[held])
        found.append(quality_of(values[held], data.labels[held]))
        progress((number + 1) / folds)
    return values, found


def evaluation_time(function: ca.Function, states: NDArray[np.float64], calls: int = 500) -> float:
    """Return the median time of one call of a function of the state through its buffers [us].

    A control loop calls it in the same way.

    Args:
        function: for example a cost's `value_and_gradient`.
        states: states (n, N) for the calls, in turn.
        calls: number of calls.
    """
    evaluator = Evaluator(function)
    (state,) = evaluator.inputs.values()
    times = []
    for call in range(calls):
        state[:] = states[call % len(states)]
        start = time.perf_counter()
        evaluator.evaluate()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) * 1e6
