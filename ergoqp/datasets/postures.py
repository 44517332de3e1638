"""Data sets of random postures with the same number of postures for every score.

The scores are those of the sheet, or those of the EPFL report's simplified rules.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any, Final, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import check_whole
from ergoqp.coordinates import REPORT_JOINTS, Coordinates
from ergoqp.datasets.cache import cached_data
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.sampler import BalancedSampler, interval_sampler, sheet_sampler
from ergoqp.errors import InputError
from ergoqp.joints import LOWER, UPPER
from ergoqp.sheets.description import load_description
from ergoqp.sheets.interval import score_interval
from ergoqp.sheets.options import Method, read_method
from ergoqp.sheets.task import TaskOptions

LABELS: Final = ("sheet", "interval")
"""Source of the scores: the REBA sheet, or the simplified one of :mod:`ergoqp.sheets.interval`."""

_VERSION: Final = 1
"""Must be increased when the same seed gives other postures than before."""

_BLOCK: Final = 20_000
"""Number of postures drawn at once."""


MOST_PER_SCORE: Final = 200_000
"""Largest number of postures per score in memory. For more, see `ergoqp.datasets.stream`."""


def posture_data(
    per_score: int = 1000,
    labels: Literal["sheet", "interval"] = "sheet",
    seed: int = 0,
    *,
    joints: Sequence[str] = REPORT_JOINTS,
    scores: Sequence[int] = range(1, 11),
    cache: bool = True,
    progress: Callable[[float], None] | None = None,
    method: Method | None = None,
    **task: Unpack[TaskOptions],
) -> DataSet:
    """Draw labelled postures, equally many of each score, in random order.

    The same arguments give the same data.

    For every joint that scores, a band is picked uniformly, then an angle uniformly in the
    band. Of these postures, equally many of each score are kept, see
    :mod:`ergoqp.datasets.sampler`. Joints that are not drawn are at zero, so the label depends
    only on the drawn ones.

    Args:
        per_score: postures of each score, at least 1.
        labels: ``"sheet"``, or ``"interval"`` for comparison with the EPFL report.
        seed: seed of the draw.
        joints: joints that are drawn; they are the coordinates of the data.
        scores: wanted scores.
        cache: keep the data on disk, and read them from there when the arguments are the same
            again.
        progress: called with the share that is done.
        method: how the sheet is read; the default follows the publication.
        **task: options of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for all
            postures.

    Raises:
        InputError: if a joint or the kind of labels is unknown, no posture has one of the
            scores, or a method or task options are given with ``"interval"``, which has none.

    Example:
        >>> from ergoqp.datasets.postures import posture_data
        >>> data = posture_data(5, scores=(1, 2, 3), cache=False)
        >>> data.points.shape, sorted(set(data.labels.tolist()))
        ((15, 20), [1.0, 2.0, 3.0])
    """
    check_whole("per_score", per_score, 1, MOST_PER_SCORE)
    check_whole("seed", seed, 0)
    coordinates = Coordinates(joints)
    sampler, rules = _sampler(labels, coordinates.names, method, task)

    def make() -> DataSet:
        rng = np.random.default_rng(seed)
        per_block = max(1, _BLOCK // max(1, len(scores)))
        points, found = [], []
        for first in range(0, per_score, per_block):
            postures, drawn = sampler.draw(min(per_block, per_score - first), rng, scores)
            points.append(postures[:, coordinates.indices])
            found.append(drawn)
            if progress is not None:
                progress(min(1.0, (first + per_block) / per_score))
        wanted = f"{per_score} postures of each score {', '.join(map(str, scores))}"
        options = "".join(f", {name} {value}" for name, value in task.items())
        source = f"{labels}: {wanted}, {len(coordinates)} joints, seed {seed}{options}"
        return DataSet(
            np.concatenate(points), np.concatenate(found).astype(float), coordinates.names, source
        )

    if not cache:
        return make()
    asked = {
        "version": _VERSION,
        "rules": rules,
        "per_score": per_score,
        "seed": seed,
        "scores": list(scores),
    }
    data = cached_data("postures", {**asked, "joints": coordinates.names, "task": task}, make)
    if progress is not None:
        progress(1.0)
    return data


def interval_labels(points: ArrayLike, joints: Sequence[str] = REPORT_JOINTS) -> NDArray[np.int64]:
    """Return the scores (n,) of points by the EPFL report's simplified rules.

    The rules are in :mod:`ergoqp.sheets.interval`.

    Args:
        points: angles of the joints (n, d) [rad]; other joints are at zero.
        joints: names of the columns.

    Raises:
        InputError: if the number of columns is wrong, an angle is NaN, or an angle is beyond
            +-180 deg.

    Source:
        EPFL semester report, "Learning ergonomic human-robot interaction".

    Example:
        >>> import numpy as np
        >>> from ergoqp.datasets.postures import interval_labels
        >>> interval_labels(np.zeros((2, 20))).tolist()
        [1, 1]
    """
    return score_interval(_spread(points, joints))


def _spread(points: ArrayLike, joints: Sequence[str]) -> NDArray[np.float64]:
    coordinates, rows = Coordinates(joints), np.atleast_2d(np.asarray(points, dtype=float))
    if rows.ndim != 2 or rows.shape[1] != len(coordinates):
        raise InputError(
            f"points: got shape {rows.shape}, allowed (n, {len(coordinates)}):"
            f" {', '.join(coordinates.names)}"
        )
    return coordinates.spread(rows)


def _sampler(
    labels: str, joints: tuple[str, ...], method: Method | None, task: TaskOptions
) -> tuple[BalancedSampler, dict[str, Any]]:
    """Return the sampler, and all properties of the rules that its postures depend on."""
    if labels == "sheet":
        method = read_method(method)
        rules = {
            "sheet": load_description("reba"),
            "method": asdict(method),
            "ranges": [LOWER, UPPER],
        }
        return sheet_sampler(method, joints, **task), rules
    if labels != "interval":
        raise InputError(f"labels: got {labels!r}, allowed {', '.join(map(repr, LABELS))}")
    if method is not None or task:
        raise InputError(
            f"labels: got 'interval' with {', '.join(task) or 'method'}, allowed without: these"
            " rules have none"
        )
    rules = {
        "sheet": [load_description("reba"), load_description("interval")],
        "ranges": [LOWER, UPPER],
    }
    return interval_sampler(joints), rules
