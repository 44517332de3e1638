"""What a reader of the user's own raises or hands on: a motion, or one sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ergoqp.errors import InputError, RecordingError
from ergoqp.mocap import readers
from ergoqp.mocap.recording import JointMotion

GOOD = JointMotion(("a", "b"), np.zeros((3, 2, 3)), np.arange(3.0))


def raises(error: Exception) -> Any:
    def reader(path: Path) -> JointMotion:
        raise error

    return reader


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch):
    """Return a function that reads a file by an own reader."""

    def with_reader(reader: Any) -> JointMotion:
        monkeypatch.setattr(readers, "registered", lambda kind: ("own",))
        monkeypatch.setattr(readers, "own_term", lambda kind, name: reader)
        return readers.read_motion(Path("take.own"))

    return with_reader


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (
            ValueError("not\nmine"),
            r"take\.own: got ValueError \(not mine\), allowed what the reader own reads",
        ),
        (FileNotFoundError(2, "No such file"), r"take\.own: got FileNotFoundError \(.*No such"),
        (MemoryError(), r"take\.own: got MemoryError \(\), allowed"),
        (InputError("unit: got 3, allowed 1"), r"take\.own: unit: got 3, allowed 1$"),
        (
            RecordingError("take.own: got a line, allowed two"),
            r"^take\.own: got a line, allowed two",
        ),
    ],
)
def test_whatever_it_raises_is_one_sentence(read, error: Exception, sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence) as caught:
        read(raises(error))
    assert "\n" not in str(caught.value)


def test_what_is_no_reader_is_a_sentence(read) -> None:
    with pytest.raises(
        RecordingError, match=r"take\.own: got TypeError .* allowed what the reader own reads"
    ):
        read(5)


@pytest.mark.parametrize(
    ("motion", "found"),
    [
        (None, "None"),
        (replace(GOOD, names=()), r"the names \(\)"),
        (replace(GOOD, names=("a", 1)), "the names"),
        (replace(GOOD, names=("a", "a")), "a name twice"),
        (replace(GOOD, positions=np.zeros((3, 3, 3))), r"positions of shape \(3, 3, 3\) and not"),
        (replace(GOOD, positions=np.full((3, 2, 3), "x")), "positions of shape"),
        (replace(GOOD, positions=np.full((3, 2, 3), np.inf)), "positions with infinite numbers"),
        (replace(GOOD, rest=np.zeros(3)), r"rest of shape \(3,\) and not \(2, 3\)"),
        (replace(GOOD, time=np.zeros(3)), "times that do not increase"),
        (replace(GOOD, time=np.array([0, 1, np.nan])), "times that do not increase"),
        (replace(GOOD, positions=np.zeros((0, 2, 3)), time=np.zeros(0)), "the times"),
    ],
)
def test_what_is_no_motion_is_one_sentence(read, motion: Any, found: str) -> None:
    words = rf"take\.own: got {found}.* from the reader own, allowed a JointMotion of ergoqp"
    with pytest.raises(RecordingError, match=words):
        read(lambda path: motion)


def test_a_motion_is_handed_on(read) -> None:
    found = read(lambda path: GOOD)
    assert found.names == GOOD.names
    np.testing.assert_array_equal(found.positions, GOOD.positions)
    np.testing.assert_array_equal(found.time, GOOD.time)


def test_times_of_an_own_reader_begin_at_zero(read) -> None:
    found = read(lambda path: replace(GOOD, time=[1.7e9, 1.7e9 + 0.5, 1.7e9 + 1]))
    np.testing.assert_array_equal(found.time, [0, 0.5, 1])
