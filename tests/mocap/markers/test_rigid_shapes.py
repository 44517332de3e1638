"""Shapes of markers: turned as by SciPy, never mirrored, and told only by markers that fit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ergoqp.mocap.markers.rigid import brought_to, follow, shape_of

PELVIS = np.array(
    [[0.09, 0.12, 0.0], [0.09, -0.12, 0.01], [-0.07, 0.05, 0.02], [-0.07, -0.05, 0.01]]
)
"""Left and right ASIS, left and right PSIS [m]: all but in a plane, and all but symmetric."""
CHEST = np.array([[-0.07, 0, 0.02], [0.07, 0.01, 0], [-0.1, 0, -0.22], [0.1, 0, -0.2]])


def placed(shape: np.ndarray, count: int = 20, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A shape somewhere in each frame (n, m, 3), and how it is turned (n, 3, 3)."""
    generator = np.random.default_rng(seed)
    turn = Rotation.random(count, rng=generator).as_matrix()
    place = generator.uniform(-3, 3, (count, 1, 3))
    return place + np.einsum("nij,mj->nmi", turn, shape), turn


def angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(Rotation.from_matrix(np.swapaxes(one, -1, -2) @ other).magnitude().max())


@pytest.mark.parametrize("count", [3, 4, 5, 8])
@pytest.mark.parametrize("flat", [False, True])
def test_turned_as_by_scipy(count: int, flat: bool) -> None:
    generator = np.random.default_rng(10 + count)
    shape = generator.uniform(-0.2, 0.2, (count, 3)) * [1, 1, 0 if flat else 1]
    points, _ = placed(shape)
    points += 0.002 * generator.standard_normal(points.shape)
    found = follow(points, shape)
    for i, each in enumerate(points):
        theirs = Rotation.align_vectors(each - each.mean(axis=0), shape - shape.mean(axis=0))[0]
        assert angle(found.turn[i], theirs.as_matrix()) < 1e-7
        place = each.mean(axis=0) - theirs.apply(shape.mean(axis=0))
        np.testing.assert_allclose(found.place[i], place, atol=1e-9)
    assert not found.astray.any()
    assert np.abs(found.points - points).max() < 0.012


@pytest.mark.parametrize("shape", [PELVIS, CHEST, PELVIS * [1, 1, 0]])
def test_never_mirrored(shape: np.ndarray) -> None:
    points, _ = placed(shape)
    turn = follow(points * [1, 1, -1], shape).turn
    told = np.isfinite(turn[:, 0, 0])
    np.testing.assert_allclose(np.linalg.det(turn[told]), 1.0)
    points, truth = placed(shape)
    assert angle(follow(points, shape).turn, truth) < 1e-7


def test_a_line_tells_nothing() -> None:
    line = np.linspace(-0.2, 0.2, 4)[:, None] * [1.0, 0.0, 0.0]
    for bent in (0.0, 0.005):
        points, _ = placed(line + bent * np.array([0, 1, 1, 0])[:, None] * [0, 1, 0])
        found = follow(points, line)
        assert np.isnan(found.turn).all()
        assert np.isnan(found.points).all()
        assert not found.astray.any()


def test_three_in_a_line_do_not_tell_where_the_others_are() -> None:
    # Both PSIS and the sacrum between them, with both ASIS lost.
    shape = np.vstack([PELVIS, [[-0.08, 0.0, 0.01]]])
    points, _ = placed(shape)
    points += 0.001 * np.random.default_rng(2).standard_normal(points.shape)
    points[5:10, :2] = np.nan
    found = follow(points, shape)
    assert np.isnan(found.points[5:10]).all()
    rest = np.isin(np.arange(20), range(5, 10), invert=True)
    assert np.abs(found.points - points)[rest].max() < 0.01


@pytest.mark.parametrize("shape", [PELVIS, CHEST])
@pytest.mark.parametrize("lost", range(4))
def test_three_of_four_tell_the_fourth(shape: np.ndarray, lost: int) -> None:
    points, turn = placed(shape)
    seen = points.copy()
    seen[:, lost] = np.nan
    found = follow(seen, shape)
    np.testing.assert_allclose(found.points, points, atol=1e-9)
    assert angle(found.turn, turn) < 1e-7
    seen[:, (lost + 1) % 4] = np.nan
    assert np.isnan(follow(seen, shape).points).all()


def test_a_point_that_the_shape_lacks_is_not_told() -> None:
    shape = PELVIS.copy()
    shape[1] = np.nan
    points, turn = placed(PELVIS)
    found = follow(points, shape)
    assert angle(found.turn, turn) < 1e-7
    assert np.isnan(found.points[:, 1]).all()
    np.testing.assert_allclose(found.points[:, [0, 2, 3]], points[:, [0, 2, 3]], atol=1e-9)


@pytest.mark.parametrize("shape", [PELVIS, CHEST])
@pytest.mark.parametrize("far", [0.1, 0.3, 5.0])
@pytest.mark.parametrize("which", range(4))
def test_one_astray_is_left_out(shape: np.ndarray, far: float, which: int) -> None:
    points, turn = placed(shape)
    away = np.random.default_rng(which).standard_normal((20, 3))
    seen = points.copy()
    seen[:, which] += far * away / np.linalg.norm(away, axis=1, keepdims=True)
    found = follow(seen, shape)
    np.testing.assert_array_equal(found.astray, np.arange(4)[None] == np.full((20, 1), which))
    np.testing.assert_allclose(found.points, points, atol=1e-9)
    assert angle(found.turn, turn) < 1e-7


def test_skin_is_not_astray() -> None:
    points, turn = placed(CHEST, 500)
    points += 0.003 * np.random.default_rng(3).standard_normal(points.shape)
    found = follow(points, CHEST)
    assert not found.astray.any()
    assert np.degrees(angle(found.turn, turn)) < 10


@pytest.mark.parametrize("shape", [PELVIS, CHEST])
@pytest.mark.parametrize("which", range(4))
def test_one_a_little_off_is_not_astray(shape: np.ndarray, which: int) -> None:
    # Though the others fit better without it.
    points, _ = placed(shape, 200)
    away = np.random.default_rng(which).standard_normal((200, 3))
    points[:, which] += 0.029 * away / np.linalg.norm(away, axis=1, keepdims=True)
    assert not follow(points, shape).astray.any()


ALIKE = ((0, 1), (2, 3))
"""Front and back of the chest are so: nobody knows which of these pairs was exchanged."""


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
def test_two_that_are_exchanged(pair: tuple[int, int]) -> None:
    points, turn = placed(CHEST)
    seen = points.copy()
    seen[:, pair] = points[:, pair[::-1]]
    found = follow(seen, CHEST)
    told = np.isfinite(found.turn[:, 0, 0])
    assert told.all() or not told.any()
    if told.all():
        assert angle(found.turn, turn) < 1e-7
        np.testing.assert_allclose(found.points, points, atol=1e-9)
    assert told.all() == (pair not in ALIKE)
    assert found.astray[:, pair].all()


def test_exchanged_sides_of_a_symmetric_pelvis_tell_nothing() -> None:
    # Turned upside down the other two are exchanged: nobody knows.
    shape = PELVIS * [1, 1, 0]
    for pair in ((0, 1), (2, 3)):
        points, _ = placed(shape)
        points[:, pair] = points[:, pair[::-1]]
        found = follow(points, shape)
        assert np.isnan(found.points).all()
        assert found.astray.all()


def test_of_three_that_do_not_fit_none_tells() -> None:
    wrong = PELVIS[:3].copy()
    for far in ([0.0, -0.1, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.1]):
        wrong[1] = PELVIS[1] + far
        points, _ = placed(wrong)
        found = follow(points, PELVIS[:3])
        assert np.isnan(found.points).all()
        assert found.astray.all()


def test_nothing_seen() -> None:
    nothing = np.full((7, 4, 3), np.nan)
    found = follow(nothing, PELVIS)
    assert np.isnan(found.points).all()
    assert not found.astray.any()
    assert follow(nothing[:0], PELVIS).points.shape == (0, 4, 3)
    assert shape_of(nothing) is None
    assert shape_of(nothing[:0]) is None
    assert brought_to(PELVIS, nothing[0]) is None


def test_the_shape_is_found() -> None:
    points, _ = placed(CHEST, 300)
    points += 0.003 * np.random.default_rng(4).standard_normal(points.shape)
    points[::3, 0], points[1::3, 2] = np.nan, np.nan
    found = shape_of(points)
    assert found is not None
    there, miss = brought_to(found, CHEST) or (None, np.inf)
    assert there is not None
    assert miss < 0.002
    assert shape_of(points[:, :2]) is None


@pytest.mark.parametrize("share", [0.3, 0.45])
def test_the_shape_is_where_points_mostly_are(share: float) -> None:
    points, _ = placed(PELVIS, 400)
    stays = round(share * 400)
    points[stays:, 1] += np.linspace(0.05, 2.0, 400 - stays)[:, None] * [0.1, 0.2, -1.0]
    points[10:40, [0, 2]] = points[10:40, [2, 0]]
    found = shape_of(points)
    assert found is not None
    assert brought_to(found, PELVIS)[1] < 0.002  # type: ignore[index]
    np.testing.assert_array_equal(follow(points, found).astray[stays + 10 :, 1], True)


def test_the_shape_does_not_hang_on_the_frame_in_the_middle() -> None:
    points, _ = placed(CHEST, 101)
    points[45:60, [0, 3]] = points[45:60, [3, 0]]
    found = shape_of(points)
    assert found is not None
    assert brought_to(found, CHEST)[1] < 1e-6  # type: ignore[index]


@pytest.mark.parametrize("shape", [PELVIS, CHEST])
@pytest.mark.parametrize("pair", [(0, 1), (2, 3), (0, 2)])
def test_the_shape_is_not_that_of_frames_in_which_two_are_exchanged(
    shape: np.ndarray, pair: tuple[int, int]
) -> None:
    points, _ = placed(shape, 300)
    truth = points.copy()
    # Most of the middle is so, and what begins a take may be anything.
    points[90:215, pair] = points[90:215, pair[::-1]]
    points[:40, 1] += np.linspace(0.1, 0.9, 40)[:, None]
    found = shape_of(points)
    assert found is not None
    assert brought_to(found, shape)[1] < 1e-6  # type: ignore[index]
    right = np.r_[40:90, 215:300]
    followed = follow(points, found)
    np.testing.assert_allclose(followed.points[right], truth[right], atol=1e-6)
    assert not followed.astray[right].any()
    # One frame may be all that there is, and those of too few points none.
    alone = shape_of(truth[:1])
    assert alone is not None
    assert brought_to(alone, shape)[1] < 1e-9  # type: ignore[index]


def test_a_point_that_is_never_seen_has_no_place() -> None:
    points, _ = placed(PELVIS)
    points[:, 2] = np.nan
    found = shape_of(points)
    assert found is not None
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [False, False, True, False])
    there, miss = brought_to(PELVIS, found) or (found, np.inf)
    assert miss < 1e-9
    np.testing.assert_allclose(there[[0, 1, 3]], found[[0, 1, 3]], atol=1e-9)
    np.testing.assert_allclose(
        follow(points, there).points[:, 2], placed(PELVIS)[0][:, 2], atol=1e-9
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nothing_breaks_it(seed: int) -> None:
    generator = np.random.default_rng(seed)
    count, many = generator.integers(0, 6), generator.integers(1, 7)
    points = generator.choice([0.0, 1e-9, 0.2, 1e6]) * generator.standard_normal((count, many, 3))
    points[generator.random((count, many)) < 0.3] = np.nan
    points[generator.random((count, many)) < 0.05] = np.inf
    for shape in (shape_of(points), generator.standard_normal((many, 3))):
        if shape is not None:
            found = follow(points, shape)
            told = np.isfinite(found.turn[:, 0, 0])
            np.testing.assert_allclose(np.linalg.det(found.turn[told]), 1.0, atol=1e-6)
