"""A walk and a stoop, marked as each of the known sets does it, is read as with all markers."""

from __future__ import annotations

import numpy as np
import pytest
from marker_takes import NAMES, PLACES, motion, read, said

from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap.naming import MarkerSet, known_sets

SETS = pytest.mark.parametrize("marker_set", known_sets(), ids=lambda each: each.title)
WITHOUT = {
    "shoulder study": {"left_elbow_flexion", "right_knee_flexion", "left_knee_flexion"},
    "simple gait": {"right_elbow_flexion", "left_elbow_flexion"},
}
"""What these sets do not mark."""


@SETS
def test_a_walk_and_a_stoop(marker_set: MarkerSet) -> None:
    ours = known_sets()[0].found_in(NAMES)
    at = {landmark: PLACES[:, NAMES.index(marker)] for landmark, marker in ours.items()}
    at["sacrum"] = (at["left_psis"] + at["right_psis"]) / 2
    if "right_wrist_small" not in marker_set.landmarks:
        for side in SIDES:
            at[f"{side}_wrist_thumb"] = (at[f"{side}_wrist_thumb"] + at[f"{side}_wrist_small"]) / 2
    marked = {each: name for each, (name, *_) in marker_set.landmarks.items() if each in at}
    recording = read(np.stack([at[each] for each in marked], axis=1), tuple(marked.values()))
    assert marker_set.title in said(recording)
    # A score needs an arm; markers beside one do no harm where there is none.
    assert recording.scored.all() or marker_set.title == "simple gait"
    off = np.degrees(np.abs(recording.postures - motion()[1]))
    lacking = WITHOUT.get(marker_set.title, set())
    for name, most in (("knee_flexion", 0.01), ("elbow_flexion", 12.5)):
        for each in (f"{side}_{name}" for side in SIDES):
            seen = recording.observed[:, INDEX[each]]
            assert seen.any() == (each not in lacking)
            assert off[seen, INDEX[each]].max(initial=0) < most
    assert off[:, INDEX["trunk_flexion"]].max() < 0.01
