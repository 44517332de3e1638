"""The simplified sheet behind the data of the EPFL report.

Use it only for comparison with the figures of the report, never for a person.

Its scores are about one point below those of REBA. In each segment the worse of both arms
counts. Load, coupling and activity are not counted.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.joints import LOWER, SIDES, UPPER
from ergoqp.sheets.angles import check_angles, read_postures
from ergoqp.sheets.assessment import (
    look_up,
    score_final,
    score_segments,
    score_worse_segments,
)
from ergoqp.sheets.description import Sheet, load_description, read_sheet
from ergoqp.sheets.options import read_task

FINAL_MAX: Final = 12
"""Highest final score: that of table C."""


@cache
def interval_sheet() -> Sheet:
    """Return the sheet: its own bands, and the tables of REBA with some cells one point lower."""
    reba, own = load_description("reba"), load_description("interval")
    for table, cells in own["low_cells"].items():
        for first, second, third in cells:
            reba["tables"][table]["cells"][first - 1][second - 1][third - 1] -= 1
    return read_sheet({**reba, **own}, reba["numbers"], ties="lower", load_ties="inner")


@cache
def interval_ranges() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper ends of the angles in the data, shape (32,) each [rad].

    Joints that the sheet does not read have their full range.
    """
    lower, upper = LOWER.copy(), UPPER.copy()
    for name, entry in load_description("interval")["segments"].items():
        segment = interval_sheet().segments[name]
        conditions = (
            condition
            for modifier in entry.get("modifiers", ())
            for condition in modifier["conditions"]
        )
        for step, described in zip(segment.steps, (*entry["base"], *conditions), strict=True):
            joints = [segment.joint(step, side) for side in SIDES]
            lower[joints], upper[joints] = np.radians(described["range"])
    return lower, upper


def score_interval(postures: ArrayLike) -> NDArray[np.int64]:
    """Return the final score 1 to 12 of postures by the simplified sheet, shape (n,).

    Args:
        postures: shape (n, 32) or (32,), in the order of :data:`ergoqp.JOINTS`, all finite [rad].
            Angles beyond the ranges are scored by the outer band.

    Raises:
        InputError: if the shape is wrong, an angle is NaN, or an angle is beyond +-180 deg.
    """
    sheet = interval_sheet()
    angles = np.ascontiguousarray(read_postures(postures).T)
    valid = check_angles(angles, 0)
    if not valid.all():
        raise InputError(f"postures: row {np.argmin(valid)} holds NaN, allowed: finite angles")
    task = read_task(sheet, None, {})
    segments = score_segments(sheet, angles, task)
    table_a = look_up(sheet, "A", *(segments[segment.label("")] for segment in sheet.of_table("A")))
    final = score_final(
        sheet, table_a, score_worse_segments(sheet, segments), task.points, FINAL_MAX
    )
    return final.astype(np.int64)
