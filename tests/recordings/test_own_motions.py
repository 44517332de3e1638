"""What a reader of the user's own hands on beside positions: all of it is looked at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ergoqp.errors import RecordingError
from ergoqp.recordings import readers
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.readers import lacking

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
    assert lacking(replace(GOOD, names=["a", "b"], positions=np.zeros((3, 2, 3), int))) == ""  # pyright: ignore


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"turns": None}, "the turns None"),
        ({"turns": [TURN]}, "the turns [array"),
        ({"turns": {1: TURN}}, "the turns {1: array"),
        ({"turns": {"a": TURN[:2]}}, "turns of a of shape (2, 4) and not (3, 4)"),
        ({"turns": {"a": TURN[:, :3]}}, "turns of a of shape (3, 3) and not (3, 4)"),
        ({"turns": {"a": TURN.astype(str)}}, "turns of a of shape (3, 4) and not numbers"),
        ({"turns": {"a": TURN + np.inf}}, "turns of a without end"),
        ({"turns": {"a": 0 * TURN}}, "turns of a that are no unit quaternions"),
        ({"turns": {"a": 1.5 * TURN}}, "turns of a that are no unit quaternions"),
        ({"turns": {"a": 1e200 * TURN}}, "turns of a that are no unit quaternions"),
        ({"objects": 3}, "the objects 3"),
        ({"objects": {"box": POSE[0]}}, "objects of box of shape (4, 4) and not (3, 4, 4)"),
        ({"objects": {"box": POSE[:, :3]}}, "objects of box of shape (3, 3, 4) and not"),
        ({"objects": {"box": 2 * POSE}}, "objects of box that are no poses"),
        ({"objects": {"box": POSE[:, ::-1]}}, "objects of box that are no poses"),
        ({"objects": {"box": 1e200 * POSE}}, "objects of box that are no poses"),
        ({"angles": {"knee": np.zeros(2)}}, "angles of knee of shape (2,) and not (3,)"),
        ({"angles": {"knee": 1.0}}, "angles of knee of shape () and not (3,)"),
        ({"angles": {"knee": np.full(3, -np.inf)}}, "angles of knee without end"),
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
    assert str(caught.value).endswith("allowed a JointMotion of ergoqp.recordings.motion")
    assert "\n" not in str(caught.value)
