"""Whoever faces backward by the names of left and right is refused, whatever shows it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.made_motions import BODY, Places, fitted, posture, walk
from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.mocap.fitting.axes import check_sides
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recording import JointMotion
from ergoqp.mocap.unseen import AHEAD

TOES = tuple(f"{side}_toe" for side in SIDES)
LEGS = (*TOES, *(f"{side}_{name}" for side in SIDES for name in ("knee", "ankle")))
ARMS = tuple(f"{side}_{name}" for side in SIDES for name in ("elbow", "wrist", "knuckles", "thumb"))
NOBODY = "no toe, nose, bent knee or reaching hand shows which way the person faces"


def work() -> Places:
    """Somebody who bends over a low bench and reaches out for it."""
    share = (1 - np.cos(2 * np.pi * np.arange(240) / 240)) / 2
    postures = posture(
        240,
        trunk_flexion=45 * share,
        legs_hip_flexion=20 * share,
        legs_knee_flexion=40 * share,
        arms_shoulder_flexion=70 * share,
        arms_elbow_flexion=10.0,
    )
    pelvis = np.tile([0.0, 0.0, 0.9, 0.4], (240, 1))
    places = centres_of(BODY, pelvis, postures)
    ahead = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    return {**places, "nose": places["head"] + 0.1 * ahead}


def without(places: Places, *names: str) -> Places:
    return {name: path for name, path in places.items() if name not in names}


def mirrored(places: Places) -> Places:
    return {name: path * [1.0, -1.0, 1.0] for name, path in places.items()}


def exchanged(places: Places) -> Places:
    turned = {"right": "left", "left": "right"}
    return {
        f"{turned[side]}_{name}" if side in turned else whole: path
        for whole, path in places.items()
        for side, _, name in [whole.partition("_")]
    }


@pytest.mark.parametrize("wrong", [mirrored, exchanged])
@pytest.mark.parametrize(
    ("gone", "what"),
    [
        ((), "the feet point"),
        (TOES, "the nose points"),
        ((*TOES, "nose"), "the knees bend"),
        ((*LEGS, "nose"), "the hands reach"),
    ],
)
def test_all_that_shows_it(wrong: object, gone: tuple[str, ...], what: str) -> None:
    assert callable(wrong)
    places = without(work(), *gone)
    fitted(places)
    with pytest.raises(RecordingError, match=f"{what} backward: left and right are exchanged, or"):
        fitted(wrong(places))


def test_where_nothing_shows_it_it_is_said() -> None:
    upper = without(walk()[0], *LEGS, *ARMS, "nose")
    assert NOBODY in " ".join(fitted(upper).assumptions)
    assert NOBODY not in " ".join(fitted(work()).assumptions)


def test_the_first_that_is_clear_decides() -> None:
    # Arms swing behind, a nose turns: toes count before both.
    places = work()
    places["nose"] = 2 * places["head"] - places["nose"]
    for name in ("right_wrist", "left_wrist"):
        shoulder = places[name.replace("wrist", "shoulder")]
        places[name] = places[name] - 2 * (places[name] - shoulder) * [1.0, 0.0, 0.0]
    assert check_sides("a", places) == ""
    with pytest.raises(RecordingError, match="the nose points backward"):
        check_sides("a", without(places, *TOES))


def test_some_frames_are_chance() -> None:
    places = without(work(), *TOES, *ARMS, "nose")
    wrong = mirrored(places)
    few = {name: path.copy() for name, path in places.items()}
    for name in few:
        few[name][:4] = wrong[name][:4]
    assert check_sides("a", few) == ""


def test_upside_down_nothing_is_known() -> None:
    places = {name: path * [1.0, 1.0, -1.0] for name, path in work().items()}
    assert NOBODY in check_sides("a", places)


def test_straight_knees_show_nothing() -> None:
    # A hair behind the line from hip to ankle, as many people stand.
    upright = without(walk()[0], *TOES, *ARMS, "nose")
    ahead = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    for side in SIDES:
        hip, ankle = upright[f"{side}_hip"], upright[f"{side}_ankle"]
        upright[f"{side}_knee"] = (hip + ankle) / 2 - 0.01 * ahead
    assert NOBODY in check_sides("a", upright)


def test_what_points_both_ways_decides_nothing() -> None:
    places = without(work(), *TOES)
    behind = np.arange(240) % 5 < 3
    away = (places["nose"] - places["head"])[behind]
    places["nose"][behind] -= 2 * away
    assert check_sides("a", places) == ""  # the knees do


def test_hands_beside_the_trunk_show_nothing() -> None:
    places = without(walk()[0], *LEGS, "nose")
    ahead = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    for side in SIDES:
        places[f"{side}_wrist"] = places[f"{side}_shoulder"] - 0.05 * ahead - [0.0, 0.0, 0.5]
    assert NOBODY in check_sides("a", places)


def test_a_nose_that_is_put_ahead_of_the_trunk_shows_nothing() -> None:
    # How the axes of the head lie is not known: the nose follows left and right, right or wrong.
    seen = without(work(), *LEGS, "nose")
    names = tuple(seen)
    turns = {"head": np.tile([0.0, 0.0, 0.0, 1.0], (240, 1))}
    for places, fine in ((seen, True), (exchanged(seen), False)):
        positions = np.stack([places[name] for name in names], axis=1)
        motion = JointMotion(names, positions, np.arange(240) / 60, turns=turns)
        if fine:
            assert AHEAD in recording_of(motion, "a", ReadOptions(unit=1.0, up="z")).assumptions
            continue
        with pytest.raises(RecordingError, match="the hands reach backward"):
            recording_of(motion, "a", ReadOptions(unit=1.0, up="z"))
