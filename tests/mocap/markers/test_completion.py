"""Which lost markers are put where the others tell them: by how many, by which, and how surely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.made_markers import markers_of, plug_in_gait
from benchmarks.made_motions import BODY, RATE, fitted, walk
from ergoqp.human.body import Marker
from ergoqp.mocap.markers.fit import completed, has_gaps
from ergoqp.mocap.recording import JointMotion

SITS = plug_in_gait(BODY)
LEG = ("RASI", "LASI", "RPSI", "LPSI", "RTHI", "RTIB", "RANK", "RHEE", "RTOE")
"""Nine that tell where the tenth, RKNE, is."""
LOST = slice(10, 20)


@pytest.fixture(scope="module")
def walked() -> tuple[np.ndarray, np.ndarray]:
    """Pelvis and postures of somebody who walks for half a second."""
    recording = fitted(walk(0.5)[0])
    poses = recording.base_poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    return np.column_stack([poses[:, :3, 3], yaw]), recording.postures


def told(
    walked: tuple[np.ndarray, np.ndarray], *seen: str, **residuals: float
) -> tuple[JointMotion, JointMotion | None]:
    """The motion of some markers and RKNE, which is lost for a while, and what becomes of it."""
    names, places = markers_of(BODY, *walked)
    kept = (*seen, "RKNE")
    whole = JointMotion(
        kept,
        1000 * places[:, [names.index(name) for name in kept]],
        np.arange(len(places)) / RATE,
        markers=True,
    )
    positions = whole.positions.copy()
    positions[LOST, -1] = np.nan
    sits = {name: replace(SITS[name], residual=residuals.get(name, 0.0)) for name in kept}
    gappy = replace(whole, positions=positions)
    assert has_gaps(gappy, dict.fromkeys(kept, ""))
    return whole, completed(gappy, sits, BODY, *walked, np.eye(3) / 1000, {})


def test_a_lost_marker_is_put_where_ten_tell_it(walked) -> None:
    whole, found = told(walked, *LEG, "LTHI")
    assert found is not None
    np.testing.assert_allclose(found.positions, whole.positions, atol=10)
    rest = np.isin(np.arange(len(whole.time)), np.r_[LOST], invert=True)
    np.testing.assert_array_equal(found.positions[rest], whole.positions[rest])
    assert found.notes[-1].startswith(
        "In 10 of 30 frames lost markers are estimated from the others, with a standard deviation"
        " below 2.5 cm"
    )
    assert found.notes[-1].endswith("(10 places).")


def test_nine_tell_nothing(walked) -> None:
    assert told(walked, *LEG)[1] is None


@pytest.mark.parametrize(("residual", "counts"), [(0.02, True), (0.05, False), (np.nan, False)])
def test_one_that_is_never_where_it_sits_does_not_count(walked, residual, counts) -> None:
    assert (told(walked, *LEG, "LTHI", LTHI=residual)[1] is not None) == counts


@pytest.mark.parametrize(("residual", "sure"), [(0.004, True), (0.02, False)])
def test_one_that_is_often_elsewhere_is_not_told(walked, residual, sure) -> None:
    assert (told(walked, *LEG, "LTHI", RKNE=residual)[1] is not None) == sure


def test_without_gaps_nothing_is_done(walked) -> None:
    names, places = markers_of(BODY, *walked)
    motion = JointMotion(names, places, np.arange(len(places)) / RATE, markers=True)
    assert not has_gaps(motion, dict.fromkeys(names, ""))
    assert completed(motion, SITS, BODY, *walked, np.eye(3), {}) is None
    never = Marker("pelvis", (0.0, 0.0, 0.0), float("nan"))
    assert completed(motion, dict.fromkeys(names, never), BODY, *walked, np.eye(3), {}) is None
