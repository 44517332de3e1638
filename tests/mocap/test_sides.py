"""Whoever faces backward by the names of left and right is refused by signs that are no chance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.made_motions import BODY, Places, fitted, posture, walk
from ergoqp.errors import InputError, RecordingError
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import fit_postures
from ergoqp.mocap.fitting.sides import check_sides
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recording import JointMotion
from ergoqp.mocap.unseen import AHEAD

WRONG = "backward: left and right are exchanged, or an axis is mirrored; .* \\(trust sides\\)"
AHEAD_OF = np.array([np.cos(0.4), np.sin(0.4), 0.0])

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


def bent(angle: float) -> Places:
    """Somebody who stands with knees that are bent by an angle [deg]; no toe, nose or hand."""
    places = without(walk()[0], *TOES, *ARMS, "nose")
    for side in SIDES:
        hip = places[f"{side}_hip"]
        places[f"{side}_ankle"] = hip - [0.0, 0.0, 0.8]
        places[f"{side}_knee"] = (
            hip - [0.0, 0.0, 0.4] + 0.4 * np.tan(np.radians(angle / 2)) * (AHEAD_OF)
        )
    return places


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
        ((), "the feet point and the nose points and the knees bend and the hands reach"),
        ((*TOES, *ARMS), "the nose points and the knees bend"),
        ((*TOES, *ARMS, "nose"), "the knees bend"),
        (LEGS, "the nose points and the hands reach"),
    ],
)
def test_two_signs_or_one_that_no_body_shows(
    wrong: Callable[[Places], Places], gone: tuple[str, ...], what: str
) -> None:
    places = without(work(), *gone)
    assert check_sides("a", places) == ""
    with pytest.raises(RecordingError, match=f"a: {what} {WRONG}"):
        check_sides("a", wrong(places))


@pytest.mark.parametrize(
    ("gone", "what"), [((*LEGS, "nose"), "the hands reach"), ((*LEGS, *ARMS), "the nose points")]
)
def test_one_weak_sign_is_said(gone: tuple[str, ...], what: str) -> None:
    places = without(work(), *gone)
    assert check_sides("a", places) == ""
    said = f"Left and right are taken as named, although {what} backward."
    assert check_sides("a", mirrored(places)) == said
    assert said in fitted(mirrored(places)).assumptions


def test_who_pulls_with_a_hand_behind_is_read_as_named() -> None:
    places = bent(20.0)
    for name in ("elbow", "wrist"):
        places[f"left_{name}"] = places["left_shoulder"] - 0.3 * AHEAD_OF - [0.0, 0.0, 0.2]
    said = (
        "Left and right are taken as named, although the hands reach backward, and the knees bend"
        " forward."
    )
    assert check_sides("a", places) == said
    # Whoever exchanges the sides all the same is told: the knees would bend backward.
    with pytest.raises(RecordingError, match=f"the knees bend {WRONG}"):
        check_sides("a", exchanged(places))


@pytest.mark.parametrize(("angle", "shown"), [(12.0, False), (18.0, True)])
def test_knees_show_it_when_no_knee_extends_so_far(angle: float, shown: bool) -> None:
    if shown:
        with pytest.raises(RecordingError, match="the knees bend backward"):
            check_sides("a", bent(-angle))
    else:
        assert NOBODY in check_sides("a", bent(-angle))


def test_knees_to_the_side_show_nothing() -> None:
    # Bowed legs, 5 mm behind the line from hip to ankle.
    places = bent(-1.0)
    for side, out in (("right", 1.0), ("left", -1.0)):
        aside = np.array([np.sin(0.4), -np.cos(0.4), 0.0])
        places[f"{side}_knee"] = places[f"{side}_knee"] + 0.12 * out * aside
    assert NOBODY in check_sides("a", places)


def test_feet_against_knees_decide_nothing() -> None:
    places = without(work(), *ARMS, "nose")
    for toe in TOES:
        places[toe] = 2 * places[toe.replace("toe", "ankle")] - places[toe]
    assert check_sides("a", places) == (
        "Left and right are taken as named, although the feet point backward, and the knees bend"
        " forward."
    )


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_feet_that_point_backward_all_the_time_are_enough(share: float) -> None:
    places = bent(0.0)
    count = len(places["neck"])
    way = np.where(np.arange(count) < share * count, -1.0, 1.0)[:, None]
    for toe in TOES:
        places[toe] = places[toe.replace("toe", "ankle")] + 0.15 * way * AHEAD_OF
    if share < 1.0:
        said = "Left and right are taken as named, although the feet point backward."
        assert check_sides("a", places) == said
        return
    with pytest.raises(RecordingError, match=f"a: the feet point {WRONG}"):
        check_sides("a", places)


def test_who_states_the_sides_is_believed() -> None:
    wrong = mirrored(work())
    with pytest.raises(RecordingError, match="trust sides"):
        fitted(wrong)
    said = " ".join(fitted(wrong, trust=["sides"]).assumptions)
    assert "Left and right are taken as named, as stated, although the feet point and" in said
    with pytest.raises(InputError, match=r"trust: got .* allowed a list of names, sides, angles"):
        fitted(wrong, trust=["side"])
    with pytest.raises(InputError, match="trust: got 'sides', allowed a list"):
        fitted(wrong, trust="sides")


def test_where_nothing_shows_it_it_is_said() -> None:
    upper = without(walk()[0], *LEGS, *ARMS, "nose")
    assert NOBODY in " ".join(fitted(upper).assumptions)
    assert NOBODY not in " ".join(fitted(work()).assumptions)


def test_feet_and_knees_count_more_than_nose_and_hands() -> None:
    # Arms swing behind, a nose turns.
    places = work()
    places["nose"] = 2 * places["head"] - places["nose"]
    for name in ("right_wrist", "left_wrist"):
        places[name] = places[name.replace("wrist", "shoulder")] - 0.5 * AHEAD_OF
    assert check_sides("a", places) == (
        "Left and right are taken as named, although the nose points and the hands reach backward,"
        " and the feet point and the knees bend forward."
    )
    with pytest.raises(RecordingError, match="the nose points and the hands reach backward"):
        check_sides("a", without(places, *LEGS))


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
    said = "Left and right are taken as named, although the hands reach backward."
    for places, fine in ((seen, True), (exchanged(seen), False)):
        positions = np.stack([places[name] for name in names], axis=1)
        motion = JointMotion(names, positions, np.arange(240) / 60, turns=turns)
        assumptions = recording_of(motion, "a", ReadOptions(unit=1.0, up="z")).assumptions
        assert AHEAD in assumptions
        assert (said in assumptions) is not fine


def exchanged_in(places: Places, rows: slice) -> Places:
    """The same centres with left and right exchanged in some frames."""
    found = {centre: path.copy() for centre, path in places.items()}
    for centre in places:
        side, _, name = centre.partition("_")
        if side in SIDES:
            found[centre][rows] = places[f"{SIDES[1 - SIDES.index(side)]}_{name}"][rows]
    return found


@pytest.mark.parametrize("rows", [slice(100, 220), slice(0, 90), slice(250, 360)])
def test_sides_exchanged_for_a_while_are_exchanged_back(rows: slice) -> None:
    places = walk()[0]
    wrong, plain = exchanged_in(places, rows), fitted(places)
    recording = fitted(wrong)
    np.testing.assert_allclose(recording.postures, plain.postures, atol=1e-9)
    count = rows.stop - rows.start
    assert f"exchanged in {count} frames" in " ".join(recording.assumptions)
    # What is seen on one side only in these frames is that of the other side.
    del wrong["left_wrist"]
    lost = fitted(wrong)
    assert not lost.observed[rows, INDEX["right_wrist_flexion"]].any()
    trusted = fitted(wrong, trust=["sides"])
    assert "exchanged back" not in " ".join(trusted.assumptions)


@pytest.mark.parametrize("pair", ["hip", "shoulder"])
def test_one_pair_is_no_body(pair: str) -> None:
    places = walk()[0]
    swapped = exchanged_in({n: p for n, p in places.items() if n.endswith(pair)}, slice(100, 160))
    assert "exchanged back" not in " ".join(fitted({**places, **swapped}).assumptions)


def test_who_is_elsewhere_at_once_is_not_exchanged() -> None:
    places = walk()[0]
    elsewhere = {centre: path.copy() for centre, path in places.items()}
    for path in elsewhere.values():
        path[180:] += [2.0, 1.0, 0.0]
    assert "exchanged back" not in " ".join(fitted(elsewhere).assumptions)


def test_who_turns_around_is_not_exchanged() -> None:
    # Half a turn in 0.4 s.
    yaw = np.pi * np.clip((np.arange(240) / 60 - 1) / 0.4, 0, 1)
    pelvis = np.column_stack([np.zeros((240, 2)), np.full(240, 0.9), yaw])
    places = centres_of(BODY, pelvis, posture(240, legs_knee_flexion=20.0))
    for every in (1, 8):
        few = {centre: path[::every] for centre, path in places.items()}
        names, positions = list(few), np.stack(list(few.values()), axis=1)
        recording = fit_postures(names, positions, 60 / every, neutral="vertical")
        assert "exchanged back" not in " ".join(recording.assumptions)
