from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergoqp.human import FRAMES, Body, Kinematics
from ergoqp.report import palette
from ergoqp.report.body.person import FRAME_RATE, LONGEST, Movement, parts_of, place, timing_of
from ergoqp.report.body.scene import body_mesh, score_text


@given(st.floats(0.1, 600), st.floats(1, 1000))
def test_a_replay_is_at_most_a_minute_and_thirty_frames_a_second(duration, rate):
    time = np.arange(max(2, min(int(duration * rate), 20_000))) / rate
    timing = timing_of(time)
    shown = timing.frame_time * (len(timing.samples) - 1)
    assert shown <= LONGEST + 1e-6
    assert timing.frame_time >= 1 / FRAME_RATE - 1e-9 or len(time) <= len(timing.samples)
    assert timing.samples[0] == 0
    assert timing.samples[-1] == len(time) - 1
    assert (np.diff(timing.samples) >= 0).all()
    assert shown * timing.speed == pytest.approx(time[-1] - time[0])


def test_a_replay_that_hurries_says_so():
    assert "4 times faster" in timing_of(np.arange(0, 240.01, 0.01)).note
    assert "real time" in timing_of(np.arange(0, 20, 0.01)).note
    assert "single frame" in timing_of(np.zeros(1)).note


def test_every_sample_of_a_slow_recording_is_shown():
    timing = timing_of(np.arange(51) / 10)
    assert timing.samples.tolist() == list(range(51))
    assert timing.frame_time == pytest.approx(0.1)


def test_a_missing_posture_is_held():
    postures = np.arange(5.0)[:, None] * np.ones(32)
    postures[[0, 2, 3]] = np.nan
    objects = np.tile(np.eye(4), (5, 1, 1)) * np.arange(5.0)[:, None, None]
    objects[4] = np.nan
    movement = Movement(
        Body(),
        np.arange(5.0),
        postures,
        np.tile(np.eye(4), (5, 1, 1)),
        np.array([0, 2, 0, 0, 3]),
        {},
        objects,
    )
    shown = movement.at(np.arange(5))
    assert shown.postures[:, 0].tolist() == [1, 1, 1, 1, 4]
    assert shown.final.tolist() == [0, 2, 0, 0, 3]
    assert shown.object_poses is not None
    assert shown.object_poses[4, 0, 0] == 3


def test_a_score_with_two_ends_is_told_as_such():
    movement = Movement(
        Body(),
        np.arange(3.0),
        np.zeros((3, 32)),
        np.tile(np.eye(4), (3, 1, 1)),
        np.array([0, 2, 3]),
        ends=(np.array([1, 2, 2]), np.array([9, 2, 9])),
    )
    shown = movement.at(np.arange(3))
    assert [score_text(shown, frame) for frame in range(3)] == [
        "not scored",
        "REBA 2, low",
        "REBA 2 to 9, low to high",
    ]
    exact = replace(movement, ends=None).at(np.arange(3))
    assert score_text(exact, 2) == "REBA 3, low"


def test_a_movement_without_any_posture_can_still_be_shown():
    movement = Movement(
        Body(),
        np.arange(2.0),
        np.full((2, 32), np.nan),
        np.tile(np.eye(4), (2, 1, 1)),
        np.zeros(2, dtype=int),
    )
    assert np.isfinite(movement.at(np.arange(2)).postures).all()


def test_parts_are_where_the_kinematics_say():
    body, random = Body.of_stature(1.62), np.random.default_rng(0)
    q = random.uniform(-0.3, 0.3, 32)
    base = np.eye(4)
    base[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    base[:3, 3] = [1, 2, 0.9]
    placement = place(body, q[None], base[None])
    kinematics = Kinematics(body)
    owners = {
        "right_wrist": "right_wrist_deviation",
        "left_ankle": "left_ankle_inversion",
        "head": "head",
    }
    assert set(owners) <= set(FRAMES)
    for frame, owner in owners.items():
        position, *_ = kinematics.function(frame)(q)
        expected = base[:3, :3] @ np.array(position).ravel() + base[:3, 3]
        np.testing.assert_allclose(placement.of(owner)[0][0], expected, atol=1e-12)


def test_every_segment_of_the_sheet_colours_something():
    assert {part.segment for part in parts_of(Body())} - {None} == set(palette.SEGMENTS)


def test_meshes_are_closed_and_face_outwards():
    groups = {}
    for part in parts_of(Body()):
        groups.setdefault((part.owner, part.segment), []).append(part)
    for parts in groups.values():
        vertices, faces = body_mesh(parts)
        assert np.isfinite(vertices).all()
        assert faces.max() < len(vertices)
        corners = vertices[faces].astype(float)
        # Signed volume: positive when the triangles are seen counter-clockwise from outside.
        volume = (
            np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
        )
        assert volume > 0


def test_colours_of_points_and_levels():
    assert palette.level_of_points([0, 1, 2, 5, 6]).tolist() == [-1, 0, 1, 4, 4]
    assert palette.level_of_score([0, 1, 2, 3, 4, 7, 8, 10, 11, 15]).tolist() == [
        -1,
        0,
        1,
        1,
        2,
        2,
        3,
        3,
        4,
        4,
    ]
    assert palette.risk_of_level(-1) == "not scored"
    assert palette.rgb("#0a10ff") == (10, 16, 255)
