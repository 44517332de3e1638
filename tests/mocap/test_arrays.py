"""Postures from arrays: what is no array of a person's joints is one sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.made_motions import stoop
from ergoqp.errors import InputError
from ergoqp.joints import INDEX
from ergoqp.mocap import fit_postures

NAMES, POINTS = list(stoop()[0]), np.stack(list(stoop()[0].values()), axis=1)


@pytest.mark.parametrize("rate", [1e300, 1e30, 1e-300, 0.009, 10_001, 10**400, -1, np.nan, True])
def test_no_camera_has_that_rate(rate: Any) -> None:
    with pytest.raises(InputError, match=r"^rate: got .*, allowed frames per second from 0\.01 to"):
        fit_postures(NAMES, POINTS, rate)


@pytest.mark.parametrize("rate", [0.01, 7, 10_000.0])
def test_the_slowest_and_the_fastest_rate(rate: float) -> None:
    recording = fit_postures(NAMES, POINTS, rate, neutral="vertical")
    assert recording.time[-1] == pytest.approx((len(POINTS) - 1) / rate)


@pytest.mark.parametrize("names", [None, 5, "neck", [1] * len(NAMES), {"neck": 1}])
def test_names_that_are_none(names: Any) -> None:
    with pytest.raises(InputError, match=r"^names: got .*, allowed names of joints or markers$"):
        fit_postures(names, POINTS, 50.0)


@pytest.mark.parametrize(
    "points",
    [
        None,
        5,
        "x",
        [[[0.0], [1.0, 2.0]]],
        POINTS.astype(complex),
        POINTS.astype(str),
        POINTS.astype("datetime64[s]"),
        POINTS > 0,
        POINTS[0],
        POINTS[None],
        POINTS[:, :3],
    ],
)
def test_positions_that_are_none(points: Any) -> None:
    allowed = rf"allowed real numbers of shape \(n, {len(NAMES)}, 3\)$"
    with pytest.raises(InputError, match=r"^positions: got .*, " + allowed) as caught:
        fit_postures(NAMES, points, 50.0)
    assert "\n" not in str(caught.value)


def test_what_a_mask_hides_is_not_seen() -> None:
    hidden = np.zeros(POINTS.shape, bool)
    hidden[:, NAMES.index("right_wrist")] = True
    found = fit_postures(NAMES, np.ma.masked_array(POINTS, hidden), 50.0)
    lost = fit_postures(NAMES, np.where(hidden, np.nan, POINTS), 50.0)
    assert not found.observed[:, INDEX["right_elbow_flexion"]].any()
    np.testing.assert_array_equal(found.postures, lost.postures)
    np.testing.assert_array_equal(found.observed, lost.observed)


def test_lists_with_none_and_positions_of_the_user_stay_theirs() -> None:
    points: list = POINTS.tolist()
    points[3][NAMES.index("left_wrist")] = [None] * 3
    lacking = POINTS.copy()
    lacking[3, NAMES.index("left_wrist")] = np.nan
    before = lacking.copy()
    found, same = (fit_postures(NAMES, each, 50.0) for each in (points, lacking))
    np.testing.assert_array_equal(found.postures, same.postures)
    np.testing.assert_array_equal(lacking, before)
