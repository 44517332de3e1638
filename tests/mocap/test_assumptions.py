"""Which object a person holds: the only one or the stated one, if it is seen and near a hand."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.mocap.assumptions import held_object
from ergoqp.mocap.fitting.axes import axes_of

HANDS = {
    "right_wrist": np.tile([1000.0, 0, 0], (9, 1)),
    "left_wrist": np.tile([-9000.0, 0, 0], (9, 1)),
}
AXES = 0.001 * axes_of("y")
"""The file is in millimetres, and its y is up."""


def poses(x: float | np.ndarray) -> np.ndarray:
    found = np.tile(np.eye(4), (9, 1, 1))
    found[:, 0, 3] = x
    return found


def held(
    x: float | np.ndarray, thing: str | None = None, hands: dict[str, np.ndarray] = HANDS
) -> tuple[bool, str]:
    said: list[str] = []
    found = held_object("take", {"cup": poses(x)}, thing, AXES, hands, said)
    (sentence,) = said
    return found is not None, sentence


@pytest.mark.parametrize("thing", [None, "cup"])
@pytest.mark.parametrize("x", [1000.0, 3900.0, -1900.0, -8500.0])
def test_what_is_near_a_hand_is_held(x: float, thing: str | None) -> None:
    assert held(x, thing) == (True, "The object that is held is cup.")


def test_what_is_far_is_not_held_unless_it_is_stated() -> None:
    assert held(5000.0) == (
        False,
        "The object cup is 4.0 m from the nearer hand in the median and is not taken as held; state"
        " it (thing) if it is.",
    )
    assert held(5000.0, "cup") == (
        True,
        "The object that is held is cup, as stated, although it is 4.0 m from the nearer hand in"
        " the median.",
    )


@pytest.mark.parametrize("thing", [None, "cup"])
def test_what_is_never_seen_is_not_held(thing: str | None) -> None:
    said = "The object cup is never seen, so no object is taken as held."
    assert held(np.nan, thing) == (False, said)


@pytest.mark.parametrize("name", ["giver_chest", "Chest", "Torso2", "LeftHand", "r_foot_marker"])
def test_parts_of_a_body_are_not_held(name: str) -> None:
    objects = {name: poses(1000.0)}
    said: list[str] = []
    assert held_object("take", objects, None, AXES, HANDS, said) is None
    (sentence,) = said
    assert sentence == (
        f"Named as parts of a body and not taken as held: {name}; state it (thing) if one is."
    )
    said.clear()
    assert held_object("take", objects, name, AXES, HANDS, said) is not None
    said.clear()
    both = {**objects, "hand_drill": poses(1000.0)}
    assert held_object("take", both, None, AXES, HANDS, said) is not None
    assert said[-1] == "The object that is held is hand_drill."


def test_of_several_objects_none_is_held_unless_it_is_stated() -> None:
    said: list[str] = []
    objects = {name: poses(1000.0) for name in ("cup", "chest", "box")}
    assert held_object("take", objects, None, AXES, HANDS, said) is None
    assert said[0].startswith("The recording has 2 objects (cup, box); none is shown")


def test_most_of_the_time_decides() -> None:
    assert held(np.where(np.arange(9) < 5, 1000.0, 50_000.0))[0]
    assert not held(np.where(np.arange(9) < 4, 1000.0, 50_000.0))[0]
    # Where nothing is seen nothing is told.
    assert held(np.where(np.arange(9) < 2, 1000.0, np.nan))[0]


def test_without_hands_nobody_can_tell() -> None:
    apart = {"right_wrist": np.where(np.arange(9)[:, None] < 4, np.nan, HANDS["right_wrist"])}
    seen_before = np.where(np.arange(9) < 4, 90_000.0, np.nan)
    for hands in ({}, {"neck": HANDS["left_wrist"]}, apart):
        assert held(seen_before, hands=hands) == (True, "The object that is held is cup.")
