"""Ends of joint angles of some frames, made when asked for."""

from dataclasses import replace

import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.joints import INDEX
from ergoqp.mocap import Recording
from ergoqp.mocap.fitting.unknown import spans_of


@pytest.fixture
def recording() -> Recording:
    """A recording without knees, and of which a wrist is lost for a while."""
    count = 300
    time = np.arange(count) / 60
    postures = np.random.default_rng(0).uniform(-0.1, 0.1, (count, 32))
    observed = np.ones((count, 32), dtype=bool)
    observed[:, INDEX["right_knee_flexion"]] = False
    observed[100:150, INDEX["left_wrist_flexion"]] = False
    poses = np.tile(np.eye(4), (count, 1, 1))
    error = np.zeros(count)
    found = Recording(time, postures, poses, observed, error, None, (), Body())
    return replace(found, spans=spans_of(postures, observed, time)[0])


@pytest.mark.parametrize(
    ("start", "stop"), [(0, 300), (0, 90), (90, 120), (120, 200), (299, 300), (10, 10)]
)
def test_ends_of_some_frames_are_those_of_all(recording: Recording, start: int, stop: int) -> None:
    rows = slice(start, stop)
    low, high = recording.ends(rows)
    np.testing.assert_array_equal(low, recording.low[rows])
    np.testing.assert_array_equal(high, recording.high[rows])


def test_ends_are_not_to_be_written_to(recording: Recording) -> None:
    assert (recording.low <= recording.postures).all()
    assert (recording.low < recording.high).sum() == 300 + 50
    with pytest.raises(ValueError, match="read-only"):
        recording.low[0, 0] = 1.0
