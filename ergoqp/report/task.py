"""Access to the task options of an assessment. No other module of the report uses them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ergoqp.sheets.assessment import Assessment, assess_rows
from ergoqp.sheets.postures import read_postures


def scored_alike(assessment: Assessment, postures: NDArray[np.float64]) -> Assessment:
    """Score other postures (n, 32) [rad] with the method of an assessment.

    The task options are those of its first posture.
    """
    return assess_rows(read_postures(postures), assessment.method, assessment._task.rows(0))


def is_seated(assessment: Assessment) -> bool:
    """Return whether the first posture was scored as seated."""
    return bool(assessment._task.rows(0).flag("seated"))
