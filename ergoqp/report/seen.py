"""What a recording shows of each segment, block by block.

A segment is seen in a frame if its main joint is observed (one of them, if the worse side counts).
A segment whose score is known without that needs no sensor: the legs of a seated person.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import Progress, unseen
from ergoqp.joints import SIDES
from ergoqp.sheets.description import Segment
from ergoqp.sheets.options import sheet_of
from ergoqp.sheets.reba import Assessment

if TYPE_CHECKING:
    from ergoqp.mocap import Recording

_BLOCK: Final = 4096
"""Frames per block; an hour of the scores of all segments at both ends would be 130 MB."""


def frames_of(count: int, progress: Progress = unseen) -> Iterator[slice]:
    """Yield the frames of each block of a recording.

    Args:
        count: number of frames.
        progress: called with the share that is done.
    """
    for start in range(0, count, _BLOCK):
        stop = min(start + _BLOCK, count)
        yield slice(start, stop)
        progress(stop / count)


def blocks(
    assessment: Assessment, progress: Progress = unseen
) -> Iterator[tuple[slice, Assessment]]:
    """Yield the frames of each block and their assessment.

    Args:
        assessment: the assessment of all frames.
        progress: called with the share that is done.
    """
    for rows in frames_of(len(assessment.final), progress):
        yield rows, assessment.rows(rows)


def observed_shares(
    recording: Recording, rows: slice, part: Assessment
) -> dict[str, NDArray[np.float64]]:
    """Return how much of each segment is seen: segment -> share (rows,).

    It is the share of the joints that the score reads which are observed, 1 if it reads none.

    Args:
        recording: the recording.
        rows: frames of a block.
        part: their assessment.
    """
    shares = {}
    for segment, side in sheet_of(part.method).places:
        main, others = _joints(segment, side)
        joints = [*main, *others]
        share = recording.observed[rows][:, joints].mean(axis=1)
        if segment.skipped_by is not None:
            rest = recording.observed[rows][:, others].mean(axis=1) if others else 1.0
            share = np.where(part._task.flag(segment.skipped_by, side), rest, share)
        shares[segment.label(side)] = share
    return shares


def not_seen(recording: Recording, rows: slice, part: Assessment) -> dict[str, NDArray[np.bool_]]:
    """Return where a segment is neither seen nor known without that: segment -> (rows,).

    Frames that are not scored are not among them.

    Args:
        recording: the recording.
        rows: frames of a block.
        part: their assessment.
    """
    lowest, highest = part.segments_low, part.segments_high
    found = {}
    for segment, side in sheet_of(part.method).places:
        name, (main, _) = segment.label(side), _joints(segment, side)
        shown = recording.observed[rows][:, main].any(axis=1)
        found[name] = ~shown & (lowest[name] < highest[name]) & part.valid
    return found


def shown_scores(
    recording: Recording, assessment: Assessment, names: tuple[str, ...]
) -> tuple[Mapping[str, NDArray[np.int8]], Mapping[str, NDArray[np.int8]]]:
    """Return the scores of segments as they are drawn, and what they may be at most.

    Args:
        recording: the recording, of n frames.
        assessment: its assessment.
        names: the segments.

    Returns:
        Segment -> score of the likeliest posture (n,), 0 if the frame is not scored, -1 if the
        segment is not seen; and segment -> highest score (n,) where it has a range, else 0.
    """
    shown, most = (
        {name: np.zeros(len(assessment.final), dtype=np.int8) for name in names} for _ in range(2)
    )
    for rows, part in blocks(assessment):
        hidden = not_seen(recording, rows, part)
        scores, lowest, highest = part.segments, part.segments_low, part.segments_high
        for name in names:
            shown[name][rows] = np.where(hidden[name], -1, scores[name])
            open_ = part.valid & (lowest[name] < highest[name])
            most[name][rows] = np.where(open_, highest[name], 0)
    return shown, most


def _joints(segment: Segment, side: str) -> tuple[list[int], list[int]]:
    """Return the joints that a segment's score reads: the main ones, and the others."""
    sides = SIDES if segment.worse_side else (side,)
    main = [segment.joint(segment.base, each) for each in sides]
    return main, [segment.joint(step, side) for step in segment.steps[1:]]
