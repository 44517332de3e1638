"""Random postures with the same number for every score, as one data set or as an endless stream.

Low scores are rare: if every joint is drawn from a random band, REBA 1 occurs about once in 40
000 draws. Rejection sampling is not needed. Joints are independent and each is read by one
segment, so the probabilities of the drawn bands are a finite table. The score divides that
table into parts. Drawing from the part with the wanted score gives exactly the postures that
rejection would keep.

Data sets of random postures with the same number of postures for every score. The scores are those
of the sheet, or those of the EPFL report's simplified rules.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any, Final, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import Progress, are_shares, check_whole, unseen
from ergoqp.coordinates import REPORT_JOINTS, Coordinates
from ergoqp.datasets.data import DataSet, cached_data
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.sheets import reba
from ergoqp.sheets.assessment import look_up, score_final, score_segment
from ergoqp.sheets.description import TIE, Segment, Sheet, load_description
from ergoqp.sheets.interval import FINAL_MAX, interval_ranges, interval_sheet, score_interval
from ergoqp.sheets.options import (
    Method,
    Task,
    TaskOptions,
    check_by_joint,
    read_method,
    read_task,
    sheet_of,
)

Array = NDArray[np.float64]

_CLEAR: Final = 2 * TIE
"""Drawn angles keep this distance from band ends, so that the tie rule never matters [rad]."""


def balanced_postures(
    per_score: int,
    rng: np.random.Generator,
    method: Method | None = None,
    *,
    scores: Sequence[int] = range(1, 11),
    joints: Sequence[str] | None = None,
    **options: Unpack[TaskOptions],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw postures with equally many of each score of the sheet.

    For every joint that scores, a band is picked uniformly (clipped to the range of the
    joint), then an angle uniformly in the band. All other joints are drawn uniformly in their
    range. The postures with the wanted scores are kept.

    Args:
        per_score: postures of each score, at least 1.
        rng: source of randomness; the same state gives the same postures.
        method: how the sheet is read; the default follows the publication.
        scores: wanted scores.
        joints: names of the joints that are drawn, the others are zero; None: all.
        **options: options of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for
            all postures.

    Returns:
        Postures, shape (n, 32) [rad], in random order, and their scores, shape (n,).

    Raises:
        InputError: if no posture has one of the scores under these options.
    """
    return sheet_sampler(method, joints, **options).draw(per_score, rng, scores)


def sheet_sampler(
    method: Method | None = None,
    joints: Sequence[str] | None = None,
    **options: Unpack[TaskOptions],
) -> BalancedSampler:
    """Return the sampler of :func:`balanced_postures`, to draw many times.

    Its tables are computed only once.
    """
    method = read_method(method)
    check_by_joint(method, "balanced_postures")
    sheet = sheet_of(method)
    task = read_task(sheet, None, options)
    return BalancedSampler(sheet, task, method.arms, method.final_max, LOWER, UPPER, joints)


class BalancedSampler:
    """Draws postures of wanted scores.

    Args:
        sheet: the sheet with its bands and tables.
        task: options, one value for all postures.
        arms: ``"whole"``: the worse arm counts; ``"segments"``: the worse of both arms in each
            segment.
        final_max: highest final score.
        lower: lower end of each joint, shape (32,) [rad].
        upper: upper end of each joint, shape (32,) [rad].
        joints: names of the joints that are drawn, the others are zero; None: all.

    Raises:
        InputError: if a name is not a joint.
    """

    def __init__(
        self,
        sheet: Sheet,
        task: Task,
        arms: Literal["whole", "segments"],
        final_max: int,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        joints: Sequence[str] | None = None,
    ) -> None:
        """Compute the probabilities of the drawn bands."""
        names = JOINTS if joints is None else tuple(joints)
        unknown = [name for name in names if name not in INDEX]
        if unknown:
            raise InputError(f"joints: got {unknown[0]!r}, allowed names of ergoqp.JOINTS")
        drawn = np.isin(JOINTS, names)
        self._lower, self._upper = np.where(drawn, lower, 0.0), np.where(drawn, upper, 0.0)
        parts = [(segment, "") for segment in sheet.of_table("A")]
        parts += [(segment, side) for side in SIDES for segment in sheet.of_table("B")]
        self._bands = [_Bands(each, side, task, self._lower, self._upper) for each, side in parts]
        # All combinations of segment scores: their probabilities and final scores.
        counts = [bands.count for bands in self._bands]
        grid = np.meshgrid(*(np.arange(1, len(c), dtype=np.int8) for c in counts), indexing="ij")
        cells = [axis.ravel() for axis in grid]
        shares = [(c / c.sum())[score] for c, score in zip(counts, cells, strict=True)]
        self._scores, self._chance = np.stack(cells, axis=1), np.prod(shares, axis=0)
        a, right, left = cells[:3], cells[3:6], cells[6:]
        if arms == "whole":
            table_b = np.maximum(look_up(sheet, "B", *right), look_up(sheet, "B", *left))
        else:
            table_b = look_up(sheet, "B", *map(np.maximum, right, left))
        table_a = look_up(sheet, "A", *a)
        self._final = score_final(sheet, table_a, table_b, task.points, final_max)

    def draw(
        self, per_score: int, rng: np.random.Generator, scores: Sequence[int] = range(1, 11)
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Draw postures with equally many of each score, see :func:`balanced_postures`.

        Args:
            per_score: postures of each score, at least 1.
            rng: source of randomness.
            scores: wanted scores.

        Returns:
            Postures, shape (n, 32) [rad], in random order, and their scores, shape (n,).

        Raises:
            InputError: if `per_score` is below 1, no score is given, or no posture has one of
                the scores.
        """
        if per_score < 1:
            raise InputError(f"per_score: got {per_score}, allowed: 1 or more")
        if not len(scores):
            raise InputError("scores: got none, allowed: one or more final scores")
        labels = np.repeat(np.asarray(scores, dtype=np.int64), per_score)
        cells = np.concatenate([self._cells(int(score), per_score, rng) for score in scores])
        order = rng.permutation(len(labels))
        postures = rng.uniform(self._lower, self._upper, (len(labels), len(JOINTS)))
        for bands, score in zip(self._bands, self._scores[cells[order]].T, strict=True):
            pick = bands.first[score] + rng.integers(bands.count[score])
            postures[:, bands.joints] = rng.uniform(bands.low[pick], bands.high[pick])
        return postures, labels[order]

    def _cells(self, score: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw combinations of one final score, by their probabilities."""
        cells = np.flatnonzero((self._final == score) & (self._chance > 0))
        if not len(cells):
            reachable = sorted(set(self._final[self._chance > 0].tolist()))
            known = ", ".join(map(str, reachable))
            raise InputError(f"scores: got {score}, allowed under these options: {known}")
        cumulative = np.cumsum(self._chance[cells])
        return cells[
            np.searchsorted(cumulative[:-1], rng.random(count) * cumulative[-1], side="right")
        ]


class _Bands:
    """The bands of one segment on one side: all combinations, sorted by the score of the segment.

    Attributes:
        joints: indices of the m joints.
        low: lower ends, shape (combinations, m) [rad].
        high: upper ends.
        first: number of the first combination of score k, indexed by k.
        count: number of combinations of score k, indexed by k.
    """

    def __init__(self, segment: Segment, side: str, task: Task, lower: Array, upper: Array) -> None:
        joints, choices = [], []
        for step in segment.steps:
            for joint_side in SIDES if segment.worse_side and step is segment.base else (side,):
                joint = segment.joint(step, joint_side)
                joints.append(joint)
                choices.append(_choices(step.edges, lower[joint], upper[joint]))
        ends = np.array(list(itertools.product(*choices)))  # (combinations, joints, 2)
        # The exact score of a combination is computed from the sheet, so no rule is written twice.
        angles = np.zeros((len(JOINTS), len(ends)))
        angles[joints] = ends.mean(axis=2).T
        score = score_segment(segment, angles, task, side)
        order = np.argsort(score, kind="stable")
        count = np.bincount(score, minlength=segment.highest + 1)
        self.joints, self.low, self.high = joints, ends[order, :, 0], ends[order, :, 1]
        self.first, self.count = np.cumsum(count) - count, count


def _choices(edges: Sequence[float], lower: float, upper: float) -> list[tuple[float, float]]:
    """Return a joint's bands as (lowest, highest) drawn angle; one value if it has no range."""
    if lower == upper:
        return [(lower, upper)]
    ends = np.clip([lower, *edges, upper], lower, upper)
    return [
        (low + _CLEAR, high - _CLEAR)
        for low, high in itertools.pairwise(ends)
        if high - low > 2 * _CLEAR
    ]


LABELS: Final = ("sheet", "interval")
"""Source of the scores: the REBA sheet, or the simplified one of :mod:`ergoqp.sheets.interval`."""

_VERSION: Final = 1
"""Must be increased when the same seed gives other postures than before."""

_BLOCK: Final = 20_000
"""Number of postures drawn at once."""


MOST_PER_SCORE: Final = 200_000
"""Largest number of postures per score in memory. For more, see `ergoqp.datasets.postures`."""


def posture_data(
    per_score: int = 1000,
    labels: Literal["sheet", "interval"] = "sheet",
    seed: int = 0,
    *,
    joints: Sequence[str] = REPORT_JOINTS,
    scores: Sequence[int] = range(1, 11),
    cache: bool = True,
    progress: Progress = unseen,
    method: Method | None = None,
    **task: Unpack[TaskOptions],
) -> DataSet:
    """Draw labelled postures, equally many of each score, in random order.

    The same arguments give the same data.

    For every joint that scores, a band is picked uniformly, then an angle uniformly in the
    band. Of these postures, equally many of each score are kept, see
    :mod:`ergoqp.datasets.postures`. Joints that are not drawn are at zero, so the label depends
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
            progress(min(1.0, (first + per_block) / per_score))
        wanted = f"{per_score} postures of each score {', '.join(map(str, scores))}"
        options = "".join(f", {name} {value}" for name, value in task.items())
        source = f"{labels}: {wanted}, {len(coordinates)} joints, seed {seed}{options}"
        labels_found = np.concatenate(found).astype(float)
        return DataSet(np.concatenate(points), labels_found, coordinates.names, source)

    if not cache:
        return make()
    asked = {"version": _VERSION, "rules": rules, "per_score": per_score, "seed": seed}
    asked |= {"scores": list(scores), "joints": coordinates.names, "task": task}
    data = cached_data("postures", asked, make)
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
    return score_interval(Coordinates(joints).spread(points))


def _sampler(
    labels: str, joints: tuple[str, ...], method: Method | None, task: TaskOptions
) -> tuple[BalancedSampler, dict[str, Any]]:
    """Return the sampler, and all properties of the rules that its postures depend on."""
    if labels == "sheet":
        method = read_method(method)
        rules = {"sheet": load_description("reba"), "method": asdict(method)}
        return sheet_sampler(method, joints, **task), rules | {"ranges": [LOWER, UPPER]}
    if labels != "interval":
        raise InputError(f"labels: got {labels!r}, allowed {', '.join(map(repr, LABELS))}")
    if method is not None or task:
        raise InputError(
            f"labels: got 'interval' with {', '.join(task) or 'method'}, allowed without: these"
            " rules have none"
        )
    sheets = [load_description("reba"), load_description("interval")]
    sheet = interval_sheet()
    no_task = read_task(sheet, None, {})
    sampler = BalancedSampler(sheet, no_task, "segments", FINAL_MAX, *interval_ranges(), joints)
    return sampler, {"sheet": sheets, "ranges": [LOWER, UPPER]}


def posture_stream(
    rng: np.random.Generator,
    *,
    joints: Sequence[str] = REPORT_JOINTS,
    scores: Sequence[int] = range(1, 11),
    per_score: int = 2000,
    taus_deg: Sequence[float] = (),
    weights: Sequence[float] = (),
    method: Method | None = None,
    **task: Unpack[TaskOptions],
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Yield blocks of postures, points (n, d) [rad] and labels (n,).

    The postures are as in :func:`ergoqp.datasets.postures.posture_data`.

    With `taus_deg` the label is the sheet's score of the posture with sensor noise: tau times
    logistic noise is added to every joint that is drawn, as in
    :class:`ergoqp.costs.smooth_reba.SmoothReba`. The mean label at a posture is then its
    expected score. It has a slope toward band ends instead of being constant between them.

    Args:
        rng: source of randomness.
        joints: joints that are drawn; the others are at zero.
        scores: scores of the postures, equally many of each.
        per_score: postures of each score in a block.
        taus_deg: scales of the noise [deg]; one is drawn per posture; none: no noise.
        weights: share of each scale.
        method: how the sheet is read; the default follows the publication.
        **task: options of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for all
            postures.

    Raises:
        InputError: if a joint is unknown, no posture has one of the scores, or scales and
            weights do not fit together.

    Example:
        >>> import numpy as np
        >>> from ergoqp.datasets.postures import posture_stream
        >>> blocks = posture_stream(np.random.default_rng(0), scores=(1, 2), per_score=10)
        >>> points, labels = next(blocks)
        >>> points.shape, sorted(set(labels.tolist()))
        ((20, 20), [1, 2])
    """
    taus, shares = np.asarray(taus_deg, dtype=float), np.asarray(weights, dtype=float)
    if taus.ndim != 1 or not (np.isfinite(taus) & (taus >= 0)).all():
        raise InputError(f"taus_deg: got {taus_deg!r}, allowed scales of 0 deg or more")
    if shares.shape != taus.shape or (taus.size and not are_shares(shares, taus.size)):
        raise InputError(
            f"weights: got {weights!r}, allowed one per tau ({taus.size}), not negative, adding up"
            " to 1"
        )
    coordinates = Coordinates(joints)
    sampler = sheet_sampler(method, coordinates.names, **task)
    while True:
        postures, labels = sampler.draw(per_score, rng, scores)
        points = postures[:, coordinates.indices]
        if taus.size:
            tau = np.radians(rng.choice(taus, size=(len(points), 1), p=shares))
            seen = points + tau * rng.logistic(scale=0.5, size=points.shape)
            # Noise may exceed +-180 deg. The outer bands of the sheet continue there, but such
            # angles would be rejected as degrees.
            spread = coordinates.spread(np.clip(seen, -np.pi, np.pi))
            labels = reba.assess(spread, method, **task).final
        yield points, labels
