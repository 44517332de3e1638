"""The kinds of learned costs, and loading a cost from its file."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.costs.learned import LearnedCost
from ergoqp.errors import ModelError
from ergoqp.learning.model_file import load_model

KINDS: Final[dict[str, str]] = {
    "quadratic": "ergoqp.costs.quadratic:Quadratic",
    "gmr": "ergoqp.costs.gmr:Gmr",
    "svr": "ergoqp.costs.svr:Svr",
    "one_class_ladder": "ergoqp.costs.ladder:OneClassLadder",
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
        if not np.isfinite(
            cost(np.zeros((1, len(cost.coordinates.state))))
        ).all() or not np.isfinite(cost.minimum):
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
            f" ({_last_line(error)})"
        ) from None


def _last_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[-1]
