"""What a reader of the user's own hands on beside positions: all of it is looked at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ergoqp.errors import RecordingError
from ergoqp.mocap import readers
from ergoqp.mocap.readers import lacking, normalised
from ergoqp.mocap.recording import JointMotion

TURN = np.tile([0.0, 0.0, 0.6, 0.8], (3, 1))
POSE = np.tile(np.eye(4), (3, 1, 1))
LOST = np.full_like(POSE, np.nan)
GOOD = JointMotion(
    ("a", "b"),
    np.zeros((3, 2, 3)),
    np.arange(3.0),
    np.zeros((2, 3)),
    ("A sentence.",),
    turns={"a": TURN, "b": np.full((3, 4), np.nan), "c": -TURN},
    objects={"box": POSE, "lid": LOST},
    angles={"knee": np.array([0.0, np.nan, 1.0])},
    markers=True,
    unit=0.001,
    up="-y",
    measures={"height": 1.7, "kneewidth": 1},
)


def test_what_is_right() -> None:
    assert lacking(GOOD) == ""
    assert lacking(JointMotion(("a",), np.full((1, 1, 3), np.nan), np.zeros(1))) == ""
    listed = replace(GOOD, names=["a", "b"], positions=np.zeros((3, 2, 3), int))  # pyright: ignore
    assert lacking(listed) == ""


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"turns": None}, "the turns None"),
        ({"turns": [TURN]}, "the turns [array"),
        ({"turns": {1: TURN}}, "the turns {1: array"),
        ({"turns": {"a": TURN[:2]}}, "turns of a of shape (2, 4) and not (3, 4)"),
        ({"turns": {"a": TURN[:, :3]}}, "turns of a of shape (3, 3) and not (3, 4)"),
        ({"turns": {"a": TURN.astype(str)}}, "turns of a of shape (3, 4) and not numbers"),
        ({"turns": {"a": TURN + np.inf}}, "turns of a with infinite numbers"),
        ({"turns": {"a": 0 * TURN}}, "turns of a that are not unit quaternions"),
        ({"turns": {"a": 1.5 * TURN}}, "turns of a that are not unit quaternions"),
        ({"turns": {"a": 1e200 * TURN}}, "turns of a that are not unit quaternions"),
        ({"objects": 3}, "the objects 3"),
        ({"objects": {"box": POSE[0]}}, "objects of box of shape (4, 4) and not (3, 4, 4)"),
        ({"objects": {"box": POSE[:, :3]}}, "objects of box of shape (3, 3, 4) and not"),
        ({"objects": {"box": 2 * POSE}}, "objects of box that are not poses"),
        ({"objects": {"box": POSE[:, ::-1]}}, "objects of box that are not poses"),
        ({"objects": {"box": 1e200 * POSE}}, "objects of box that are not poses"),
        ({"angles": {"knee": np.zeros(2)}}, "angles of knee of shape (2,) and not (3,)"),
        ({"angles": {"knee": 1.0}}, "angles of knee of shape () and not (3,)"),
        ({"angles": {"knee": np.full(3, -np.inf)}}, "angles of knee with infinite numbers"),
        ({"measures": {"height": "tall"}}, "the measures {'height': 'tall'}"),
        ({"measures": {"height": np.nan}}, "the measures {'height': nan}"),
        ({"measures": {"height": True}}, "the measures {'height': True}"),
        ({"measures": ["height"]}, "the measures ['height']"),
        ({"unit": 0.0}, "the unit 0.0"),
        ({"unit": -1}, "the unit -1"),
        ({"unit": np.inf}, "the unit inf"),
        ({"unit": np.nan}, "the unit nan"),
        ({"unit": "mm"}, "the unit 'mm'"),
        ({"unit": True}, "the unit True"),
        ({"up": "Z"}, "the vertical axis 'Z'"),
        ({"up": 2}, "the vertical axis 2"),
        ({"up": ["z"]}, "the vertical axis ['z']"),
        ({"notes": "A sentence."}, "the notes 'A sentence.'"),
        ({"notes": (1,)}, "the notes (1,)"),
        ({"notes": None}, "the notes None"),
        ({"time": 5.0}, "the times 5.0"),
        ({"time": np.zeros((3, 2))}, "the times array([[0., 0.], [0., 0.],"),
        ({"time": None}, "the times None"),
        ({"time": np.arange(3) > 0}, "the times array"),
        ({"time": np.array([2, 1, 0], dtype=np.uint32)}, "times that do not increase"),
        ({"time": np.ma.masked_array(np.arange(3.0), [0, 1, 0])}, "times that do not increase"),
        ({"time": np.arange(3) * 20_000_000}, "times that are 2e+07 s apart and not 0.0001 to 100"),
        ({"time": np.arange(3) * 1e300}, "times that are 1e+300 s apart"),
        ({"time": np.array([0.0, 1e-9, 2e-9])}, "times that are 1e-09 s apart"),
        ({"time": np.array([0.0, 1.0, 1e300])}, "times that are 5e+299 s apart"),
        ({"positions": [[[0.0], [1.0, 2.0]]] * 3}, "positions whose rows differ in length"),
        ({"positions": np.zeros((3, 2, 3), complex)}, "positions of shape (3, 2, 3) and not num"),
        ({"rest": np.full((2, 3), 1e200)}, "rest with a number beyond 1e+09"),
        ({"angles": {"knee": np.full(3, -1e200)}}, "angles of knee with a number beyond 1e+09"),
        ({"objects": {"box": POSE + 1e200 * np.eye(4)[:, 3:].T}}, "objects of box that are not"),
        ({"objects": {"box": POSE + np.eye(4)[3][:, None]}}, "objects of box that are not poses"),
        ({"objects": {"box": POSE.astype(str).tolist()}}, "objects of box of shape (3, 4, 4) and"),
        ({"unit": 1e300}, "the unit 1e+300"),
        ({"up": np.zeros(3)}, "the vertical axis array([0., 0., 0.])"),
        ({"markers": "yes"}, "the markers 'yes'"),
        ({"names": ("a", "b\n")}, "the name 'b\\n'"),
        ({"names": None}, "the names None"),
        ({"names": "ab"}, "the names 'ab'"),
        ({"names": ("a", "")}, "the names ('a', '')"),
        ({"names": np.array(["a", "b"])}, "the names array"),
    ],
)
def test_what_is_wrong_is_one_sentence(
    change: dict[str, Any], found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = replace(GOOD, **change)
    assert lacking(motion).startswith(found)
    monkeypatch.setattr(readers, "registered", lambda kind: ("own",))
    monkeypatch.setattr(readers, "own_term", lambda kind, name: lambda path: motion)
    with pytest.raises(RecordingError) as caught:
        readers.read_motion(Path("take.own"))
    assert str(caught.value).startswith(f"take.own: got {found}")
    assert str(caught.value).endswith("allowed a JointMotion of ergoqp.mocap.recording")
    assert "\n" not in str(caught.value)
    assert "from the reader own" in str(caught.value)


FAR = POSE.copy()
FAR[:, 0, 3] = 1e200


def test_a_thing_that_is_too_far() -> None:
    assert lacking(replace(GOOD, objects={"box": FAR})) == (
        "objects of box with a number beyond 1e+09"
    )


def test_a_gap_of_years_is_none() -> None:
    time = np.array([0.0, 1.0, 2.0, 1e300])
    motion = JointMotion(("a",), np.zeros((4, 1, 3)), time)
    assert lacking(motion) == "times over 1e+300 s and not at most 1e+07 s"


def test_lists_and_other_numbers_are_handed_on_as_arrays_of_floats() -> None:
    motion: Any = replace(
        GOOD,
        names=["a", "b"],
        positions=np.arange(18, dtype=np.uint8).reshape(3, 2, 3).tolist(),
        time=[1_700_000_000, 1_700_000_001, 1_700_000_003],
        rest=np.ones((2, 3), dtype=np.float16),
        objects={"box": POSE.tolist()},
        turns={"a": TURN.tolist()},
        angles={"knee": [0, 1, 2]},
        notes=["Said."],
    )
    assert lacking(motion) == ""
    found = normalised(motion)
    assert (found.names, found.notes) == (("a", "b"), ("Said.",))
    np.testing.assert_array_equal(found.time, [0, 1, 3])
    np.testing.assert_array_equal(found.positions, np.arange(18.0).reshape(3, 2, 3))
    assert found.rest is not None
    every = (found.time, found.positions, found.rest, *found.objects.values())
    for each in (*every, *found.turns.values(), *found.angles.values()):
        assert each.dtype == float
    np.testing.assert_array_equal(found.objects["box"], POSE)
    single = normalised(replace(GOOD, positions=np.zeros((3, 2, 3), ">f4")))
    assert single.positions.dtype == np.dtype("f4")


def test_what_a_mask_hides_is_lost() -> None:
    hidden = np.zeros((3, 2, 3), bool)
    hidden[1, 0, 2] = True
    motion = replace(
        GOOD,
        positions=np.ma.masked_array(np.full((3, 2, 3), 7), hidden),
        angles={"knee": np.ma.masked_array(np.zeros(3), [0, 1, 0])},
        objects={"box": np.ma.masked_array(POSE, np.ones((3, 4, 4)))},
    )
    assert lacking(motion) == ""
    found = normalised(motion)
    # Half of a point is no place.
    lost = np.isnan(found.positions).all(axis=2)
    np.testing.assert_array_equal(lost, [[False, False], [True, False], [False, False]])
    np.testing.assert_array_equal(found.positions[~lost], 7)
    np.testing.assert_array_equal(np.isnan(found.angles["knee"]), [False, True, False])
    assert np.isnan(found.objects["box"]).all()
