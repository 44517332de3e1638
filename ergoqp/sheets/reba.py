"""REBA: the risk of a posture from 1 to 15, and the reasons for it.

>>> import numpy as np
>>> from ergoqp import reba
>>> assessment = reba.assess(np.zeros(32))
>>> int(assessment.final[0]), reba.ACTION_LEVELS[assessment.band[0]]
(1, 'negligible')
>>> assessment.reasons(0)[0]
'neck 0 deg flexion, 5 extension to 20 flexion: 1'

Source: S. Hignett and L. McAtamney, Rapid entire body assessment (REBA), Applied Ergonomics 31
(2000) 201-205.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.sheets.angles import read_ends, read_postures
from ergoqp.sheets.assessment import (
    Assessment,
    assess_rows,
    look_up,
    score_final,
)
from ergoqp.sheets.options import Method, read_method, read_task, sheet_of, whole_numbers

__all__ = ["ACTION_LEVELS", "Assessment", "Method", "Scores", "assess", "combine"]

ACTION_LEVELS: Final[tuple[str, ...]] = sheet_of(Method()).levels
"""Names of the action levels 0 to 4: negligible, low, medium, high, very high.

Source:
    S. Hignett and L. McAtamney, Rapid entire body assessment (REBA), Applied Ergonomics 31
    (2000) 201-205.

Example:
    >>> from ergoqp import reba
    >>> reba.ACTION_LEVELS
    ('negligible', 'low', 'medium', 'high', 'very high')
"""


@dataclass(frozen=True, eq=False)
class Scores:
    """Results of the tables for given segment scores, from `combine`.

    All are whole numbers. If any argument was an array, they are arrays of the common shape.

    Attributes:
        table_a: table A of neck, trunk and legs, of any shape [points].
        score_a: table A with the load, of any shape [points].
        table_b: table B of upper arm, lower arm and wrist, of any shape [points].
        score_b: table B with the coupling, of any shape [points].
        score_c: table C of scores A and B, of any shape [points].
        final: table C with the activity, 1 to 15, of any shape [points].

    Example:
        >>> from ergoqp import reba
        >>> scores = reba.combine(neck=1, trunk=[1, 5], legs=1, upper_arm=1, lower_arm=1, wrist=1)
        >>> scores.final.tolist()
        [1, 3]
    """

    table_a: np.int64 | NDArray[np.int64]
    score_a: np.int64 | NDArray[np.int64]
    table_b: np.int64 | NDArray[np.int64]
    score_b: np.int64 | NDArray[np.int64]
    score_c: np.int64 | NDArray[np.int64]
    final: np.int64 | NDArray[np.int64]


def combine(
    *,
    neck: ArrayLike,
    trunk: ArrayLike,
    legs: ArrayLike,
    upper_arm: ArrayLike,
    lower_arm: ArrayLike,
    wrist: ArrayLike,
    load: ArrayLike = 0,
    coupling: ArrayLike = 0,
    activity: ArrayLike = 0,
) -> Scores:
    """Look up segment scores in the tables of the sheet.

    All arguments are whole numbers. They are broadcast to a common shape.

    Args:
        neck: 1 to 3, of any shape [points].
        trunk: 1 to 5, of any shape [points].
        legs: 1 to 4, of any shape [points].
        upper_arm: 1 to 6, of the arm that counts, of any shape [points].
        lower_arm: 1 to 2, of any shape [points].
        wrist: 1 to 3, of any shape [points].
        load: points of the load, 0 to 3, of any shape [points].
        coupling: points of the coupling, 0 to 3, of any shape [points].
        activity: points of the activity, 0 to 3, of any shape [points].

    Raises:
        InputError: if a score is out of its range, or shapes do not broadcast.

    Source:
        S. Hignett and L. McAtamney, Rapid entire body assessment (REBA), Applied Ergonomics 31
        (2000) 201-205, tables A, B and C.

    Example:
        >>> from ergoqp import reba
        >>> scores = reba.combine(
        ...     neck=2, trunk=3, legs=2, upper_arm=3, lower_arm=2, wrist=2, load=1
        ... )
        >>> int(scores.table_a), int(scores.score_a), int(scores.table_b), int(scores.final)
        (5, 6, 5, 8)
    """
    sheet = sheet_of(Method())
    segments = {
        "neck": neck,
        "trunk": trunk,
        "legs": legs,
        "upper_arm": upper_arm,
        "lower_arm": lower_arm,
        "wrist": wrist,
    }
    points = {"load": load, "coupling": coupling, "activity": activity}
    names = [*segments, *points]
    checked = [
        whole_numbers(name, value, 1, sheet.segments[name].highest, -1)
        for name, value in segments.items()
    ]
    checked += [
        whole_numbers(name, value, 0, sheet.points[name], -1) for name, value in points.items()
    ]
    try:
        arrays = dict(zip(names, np.broadcast_arrays(*checked), strict=True))
    except ValueError:
        pairs = zip(names, checked, strict=True)
        shapes = ", ".join(f"{name} {array.shape}" for name, array in pairs)
        raise InputError(f"combine: got shapes {shapes}, allowed: shapes that broadcast") from None
    table_a = look_up(sheet, "A", *(arrays[name] for name in sheet.tables["A"].axes))
    table_b = look_up(sheet, "B", *(arrays[name] for name in sheet.tables["B"].axes))
    final = score_final(sheet, table_a, table_b, arrays, highest=15)
    score_a, score_b = table_a + arrays["load"], table_b + arrays["coupling"]
    steps = (table_a, score_a, table_b, score_b, final - arrays["activity"], final)
    return Scores(*(step.astype(np.int64)[()] for step in steps))


def assess(
    postures: ArrayLike,
    method: Method | None = None,
    *,
    load_kg: ArrayLike = 0.0,
    shock: ArrayLike = False,
    coupling: ArrayLike = 0,
    activity: ArrayLike = 0,
    seated: ArrayLike = False,
    one_leg: ArrayLike = False,
    arm_supported: tuple[ArrayLike, ArrayLike] = (False, False),
    shoulder_raised: tuple[ArrayLike, ArrayLike] = (False, False),
    low: ArrayLike | None = None,
    high: ArrayLike | None = None,
) -> Assessment:
    """Score postures by REBA.

    A finite angle beyond the range of its joint is scored by the outer band, and
    `Assessment.outside` shows it. A posture with NaN is invalid: its ``final`` is 0. The other
    postures are scored.

    With ``low`` and ``high``, every posture also has the lowest and the highest score of all
    postures between them (`Assessment.final_low`, `Assessment.final_high`). They follow from each
    segment's lowest and highest score by the tables, which are monotone, so a posture between
    ``low`` and ``high`` reaches each. With ``upper_arm="elevation"`` no posture scores beyond
    them, but they may be wider than what is reached: an elevation follows from two angles.

    Args:
        postures: shape (n, 32) or (32,) for one, in the order of :data:`ergoqp.JOINTS` [rad].
            32-bit numbers are rounded to the nearest 0.0001 deg, because the end of a band (60 deg)
            belongs to the lower score and must not be exceeded by rounding.
        method: how the sheet is read; the default follows the publication.
        load_kg: mass that is handled [kg]. This option and all below are one value, or one per
            posture with the shape (n,).
        shock: flag, () or (n,): there is a shock or a rapid build-up of force.
        coupling: () or (n,): 0 good, 1 fair, 2 poor, 3 unacceptable [points].
        activity: () or (n,): 0 to 3, one point for each of: static for more than a minute,
            repeated more than four times a minute, rapid large changes [points].
        seated: flag, () or (n,): the person sits; the knees are then not counted.
        one_leg: flag, () or (n,): the weight is on one leg, or the stance is unstable. It is
            not counted when seated.
        arm_supported: flags (right, left): the arm is supported or gravity assists it.
        shoulder_raised: flags (right, left): the shoulder is raised.
        low: lower ends of angles that are not known exactly, shape (n, 32) or (32,) as the postures
            [rad]; NaN: unknown, the range of the joint. None: the postures. An end within 2e-6 rad
            of the posture is the posture.
        high: their upper ends, the same, shape (n, 32) or (32,) [rad].

    Raises:
        InputError: if a shape is wrong, an angle is beyond +-180 deg (were degrees given as
            radians?), an angle is not between its ends, or an option is out of range.

    Source:
        S. Hignett and L. McAtamney, Rapid entire body assessment (REBA), Applied Ergonomics 31
        (2000) 201-205.

    Example:
        >>> import numpy as np
        >>> from ergoqp import JOINTS, reba
        >>> posture = np.zeros(32)
        >>> posture[JOINTS.index("trunk_flexion")] = np.radians(70)
        >>> assessment = reba.assess(posture, load_kg=6.0)
        >>> int(assessment.final[0]), int(assessment.segments["trunk"][0])
        (3, 4)
        >>> low, high = posture.copy(), posture.copy()
        >>> knees = [JOINTS.index(f"{side}_knee_flexion") for side in ("right", "left")]
        >>> low[knees] = high[knees] = np.nan
        >>> assessment = reba.assess(posture, load_kg=6.0, low=low, high=high)
        >>> int(assessment.final_low[0]), int(assessment.final_high[0])
        (3, 7)
    """
    rows = read_postures(postures)
    ends = None if low is None and high is None else read_ends(rows, low, high)
    method = read_method(method)
    options = {
        "load_kg": load_kg,
        "shock": shock,
        "coupling": coupling,
        "activity": activity,
        "seated": seated,
        "one_leg": one_leg,
        "arm_supported": arm_supported,
        "shoulder_raised": shoulder_raised,
    }
    return assess_rows(rows, method, read_task(sheet_of(method), len(rows), options), ends)
