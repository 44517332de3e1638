"""Whoever faces backward by the names of left and right is refused, whatever shows it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.made_motions import BODY, Places, fitted, posture, walk
from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.recordings.fitting.centres_of import centres_of
from ergoqp.recordings.fitting.sides import check_sides

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
