"""The marker sets that are known: whole, told apart, and read however their names are written."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.mocap.markers.fit import SEGMENTS, markers_on
from ergoqp.mocap.naming import LANDMARKS, RIGID, MarkerSet, above_hips, best_set, known_sets

SETS = pytest.mark.parametrize("marker_set", known_sets(), ids=lambda each: each.title)


def names_of(marker_set: MarkerSet, which: int = 0) -> tuple[str, ...]:
    """A name for each of its landmarks, of several the first or the last."""
    return tuple(theirs[which] for theirs in marker_set.landmarks.values())


def test_titles_are_told_apart() -> None:
    titles = [each.title for each in known_sets()]
    assert len(set(titles)) == len(titles)


@SETS
def test_sets_are_of_landmarks_that_there_are(marker_set: MarkerSet) -> None:
    assert set(marker_set.landmarks) <= set(LANDMARKS)
    assert set(marker_set.more) <= set(RIGID)
    assert all(theirs and all(theirs) for theirs in marker_set.landmarks.values())
    every = [name for theirs in marker_set.landmarks.values() for name in theirs]
    assert len(set(every)) == len(every)
    assert not any("{" in name for name in every)
    # A pelvis and an upper trunk can be placed with them.
    assert {"right_asis", "left_asis"} <= set(marker_set.landmarks)
    assert {"right_acromion", "c7", "notch"} & set(marker_set.landmarks)


@SETS
@pytest.mark.parametrize("which", [0, -1])
def test_a_set_is_known_by_its_names(marker_set: MarkerSet, which: int) -> None:
    names = names_of(marker_set, which)
    found = best_set((*names, "*101", "box_1", "Sword"))
    assert found is not None
    assert found[0].title == marker_set.title
    assert found[1] == len(names)
    expected = dict(zip(marker_set.landmarks, names, strict=True))
    assert marker_set.found_in(names) == expected


@SETS
def test_capitals_and_what_parts_words_do_not_count(marker_set: MarkerSet) -> None:
    names = names_of(marker_set)
    written = tuple(f"{name.swapcase()[:1]}_{name.swapcase()[1:]}" for name in names)
    found = marker_set.found_in(written)
    assert list(found.values()) == list(written)


def test_of_several_names_the_first_that_is_there_is_taken() -> None:
    gait = known_sets()[0]
    assert gait.found_in(("LMKN", "LKNM"))["left_inner_knee"] == "LKNM"
    assert gait.found_in(("LMKN",))["left_inner_knee"] == "LMKN"
    assert gait.found_in(("lasi", "LASI")) == {"left_asis": "lasi"}
    assert gait.more_in(("rbak", "C7")) == {"trunk": ("rbak",)}
    assert gait.more_in(("C7",)) == {"trunk": ()}


def test_few_names_are_chance() -> None:
    names = names_of(known_sets()[0])
    assert best_set(names[:7]) is None
    assert best_set(names[:8]) is not None
    assert best_set(()) is None


def test_every_landmark_may_sit_somewhere() -> None:
    frames = {}
    body_still = (np.zeros((3, 4)), np.zeros((3, 32)))

    paths = {mark: np.tile([0.1, 0.0, 0.0], (3, 1)) for mark in (*LANDMARKS, *RIGID)}
    for mark, found in markers_on(Body(), *body_still, paths, {m: m for m in paths}).items():
        frames[mark] = found.frame
        assert found.residual < 1e-9
    assert set(frames) == {*LANDMARKS, *RIGID}
    assert set(frames.values()) <= set(SEGMENTS)
    for mark, frame in frames.items():
        if mark.startswith(("right", "left")) and frame not in RIGID:
            assert frame.split("_")[0] == mark.split("_")[0]


def test_what_is_above_the_hips() -> None:
    below = {mark for mark in (*LANDMARKS, *RIGID) if not above_hips(mark)}
    ends = ("asis", "psis", "thigh", "knee", "shank", "ankle", "heel", "forefoot")
    assert below == {"pelvis", "sacrum", *(mark for mark in LANDMARKS if mark.endswith(ends))}
