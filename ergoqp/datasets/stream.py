"""An endless stream of labelled postures in blocks, for costs that need very many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from ergoqp.coordinates import REPORT_JOINTS, Coordinates
from ergoqp.datasets.sampler import sheet_sampler
from ergoqp.errors import InputError
from ergoqp.sheets import reba
from ergoqp.sheets.options import Method
from ergoqp.sheets.task import TaskOptions


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
        >>> from ergoqp.datasets.stream import posture_stream
        >>> blocks = posture_stream(np.random.default_rng(0), scores=(1, 2), per_score=10)
        >>> points, labels = next(blocks)
        >>> points.shape, sorted(set(labels.tolist()))
        ((20, 20), [1, 2])
    """
    taus, shares = np.asarray(taus_deg, dtype=float), np.asarray(weights, dtype=float)
    if taus.ndim != 1 or not (np.isfinite(taus) & (taus >= 0)).all():
        raise InputError(f"taus_deg: got {taus_deg!r}, allowed scales of 0 deg or more")
    if (
        shares.shape != taus.shape
        or not (shares >= 0).all()
        or (taus.size and not np.isclose(shares.sum(), 1))
    ):
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
            labels = reba.assess(
                coordinates.spread(np.clip(seen, -np.pi, np.pi)), method, **task
            ).final
        yield points, labels
