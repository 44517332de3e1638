"""Markers that are named wrongly for the whole take are told by the body, and refused."""

from __future__ import annotations

import numpy as np
import pytest
from marker_takes import NAMES, PLACES, at, fallen, read, said

from ergoqp.errors import RecordingError
from ergoqp.mocap.markers.fit import check_order
from ergoqp.mocap.naming import known_sets

EVERYWHERE = slice(None)
WRONG = {
    "RSHO RUPA": "",
    "RUPA RELB": "right upper arm is farther from right acromion than right outer elbow",
    "RELB RWRA": "right wrist thumb is farther from right outer elbow than right hand",
    "RSHO RELB": "",
    "RFRM RWRA": "right forearm is farther from right outer elbow than right wrist thumb",
    "RFIN RWRA": "right wrist thumb is farther from right outer elbow than right hand",
    "RFIN RWRB": "right wrist small is farther from right outer elbow than right hand",
    "RWRA RTHI": "the right wrist is .* cm wide between its markers",
    "RTHI RKNE": "right thigh is farther from right asis than right outer knee",
    "RTHI RTIB": "right thigh is farther from right asis than right outer knee",
    "RTIB RANK": "right shank is farther from right outer knee than right outer ankle",
    "RHEE RTOE": "right heel is farther from right outer ankle than right forefoot",
    "RASI RPSI": "asis is behind psis",
    "C7 T10": "back is farther from hips than c7",
    "CLAV STRN": "xiphoid is farther from hips than notch",
    "C7 CLAV": "notch is behind c7",
    "T10 STRN": "xiphoid is behind back",
    "LTHI RTHI": "the left thigh is to the right of the right one",
    "LKNE RKNE": "the left outer knee is to the right of the right one",
    "LTIB RTIB": "the left shank is to the right of the right one",
    "LANK RANK": "the left outer ankle is to the right of the right one",
    "LELB RELB": "the left outer elbow is to the right of the right one",
    "LWRA RWRA": "",
    "LSHO RSHO": "the left outer elbow is to the right of the right one",
    "LASI RASI": "the left thigh is to the right of the right one",
    "LFHD RBHD RFHD LBHD": "head front is behind head back",
    "LWRA RWRA LWRB RWRB LFIN RFIN": "the left wrist thumb is to the right of the right one",
}


def renamed(names: str, rows: slice = EVERYWHERE) -> np.ndarray:
    places, listed = PLACES.copy(), names.split()
    for one, other in zip(listed[::2], listed[1::2], strict=True):
        places[rows, at(one)] = PLACES[rows, at(other)]
        places[rows, at(other)] = PLACES[rows, at(one)]
    return places


@pytest.mark.parametrize("names", WRONG)
def test_names_that_are_exchanged_for_the_whole_take(names: str) -> None:
    what = (
        rf"got markers in impossible places \({WRONG[names]}.*\), allowed markers where their names"
        r" say; .* or state that the names are right \(trust names\)"
    )
    with pytest.raises(RecordingError, match=what):
        read(renamed(names))


def test_names_that_are_trusted_are_read_with_a_sentence() -> None:
    found = said(read(renamed("LTIB RTIB"), trust=["names"]))
    assert found.count("The markers are where their names say, as stated, although ") == 1
    assert "the left shank is to the right of the right one" in found
    with pytest.raises(RecordingError, match="trust names"):
        read(renamed("LTIB RTIB"), trust=["sides", "angles"])


@pytest.mark.parametrize(("wide", "fine"), [(0.13, True), (0.15, False)])
def test_the_markers_of_a_wrist_bar_stand_off_the_skin(wide: float, fine: bool) -> None:
    middle, across = np.zeros((10, 3)), np.array([[wide / 2, 0.0, 0.0]])
    landmarks = {"left_wrist_thumb": middle + across, "left_wrist_small": middle - across}
    if fine:
        assert check_order("a", landmarks) == []
        return
    with pytest.raises(RecordingError, match="the left wrist is 15 cm wide between its markers"):
        check_order("a", landmarks)


@pytest.mark.parametrize("factor", [1.34, 1.4])
def test_a_limb_that_is_longer_on_one_side(factor: float) -> None:
    knee, ankle = PLACES[:, at("LKNE")[0]], PLACES[:, at("LANK")[0]]
    landmarks = {
        "right_outer_knee": PLACES[:, at("RKNE")[0]],
        "right_outer_ankle": PLACES[:, at("RANK")[0]],
        "left_outer_knee": knee,
        "left_outer_ankle": knee + factor * (ankle - knee),
    }
    if factor < 1.35:
        check_order("a", landmarks)
        return
    with pytest.raises(RecordingError, match="outer knee and outer ankle are 42 cm apart on the r"):
        check_order("a", landmarks)


@pytest.mark.parametrize("names", [names for names in WRONG if names != "LASI RASI"])
def test_for_half_of_the_take_it_is_not_said_here(names: str) -> None:
    landmarks = known_sets()[0].found_in(NAMES)
    places = renamed(names, slice(0, 300))
    check_order("a", {mark: places[:, at(name)[0]] for mark, name in landmarks.items()})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["RKNE", "RWRA", "RTHI", "RTOE"])
def test_what_comes_off_early_is_no_wrong_name(name: str) -> None:
    read(fallen(name, 180))


def test_limbs_may_cross() -> None:
    # Hands that work on the other side, ankles that are crossed.
    places = PLACES.copy()
    left = PLACES[:, at("LASI")[0]] - PLACES[:, at("RASI")[0]]
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    for one, other, most in (
        ("LWRA", "RWRA", 0.18),
        ("LANK", "RANK", 0.14),
        ("LKNE", "RKNE", 0.09),
    ):
        apart = ((PLACES[:, at(one)[0]] - PLACES[:, at(other)[0]]) * left).sum(axis=1)
        places[:, at(one)[0]] -= (apart + most)[:, None] * left
    landmarks = known_sets()[0].found_in(NAMES)
    kept = ("wrist_thumb", "ankle", "knee", "asis", "acromion")
    check_order(
        "a",
        {
            mark: places[:, at(name)[0]]
            for mark, name in landmarks.items()
            if mark.endswith(kept) and not mark.startswith("right_wrist_small")
        },
    )
