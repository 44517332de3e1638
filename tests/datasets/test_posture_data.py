"""Data sets of postures: their rules against a second reading, their law against rejection, seed
and cache."""

import numpy as np
import pytest

from ergoqp import reba
from ergoqp.coordinates import REPORT_JOINTS, SCORED_JOINTS, Coordinates
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.datasets.postures import interval_labels, posture_data, posture_stream
from ergoqp.errors import InputError
from ergoqp.joints import INDEX
from ergoqp.sheets.interval import interval_ranges

# The rules behind the EPFL report's data as a plain list, edges [deg] and scores: a second reading,
# apart from the package's.
BENT = ([-45, -15, 15, 45], [1, 0, 1])
RULES = {
    "neck_flexion": ([-45, 10, 20, 45], [2, 1, 2]),
    "neck_side_bend": BENT,
    "neck_twist": BENT,
    "trunk_flexion": ([-20, -10, 10, 20, 60, 90], [2, 1, 2, 3, 4]),
    "trunk_side_bend": BENT,
    "trunk_twist": BENT,
    "knee_flexion": ([0, 60, 80], [1, 2]),
    "shoulder_flexion": ([-45, -20, 20, 45, 90, 135], [2, 1, 2, 3, 4]),
    "shoulder_abduction": ([0, 15, 90], [0, 1]),
    "elbow_flexion": ([0, 60, 100, 145], [2, 1, 2]),
    "wrist_flexion": ([-30, -15, 15, 30], [2, 1, 2]),
    "wrist_deviation": ([-45, -10, 10, 45], [1, 0, 1]),
    "forearm_pronation": ([-30, -10, 10, 30], [1, 0, 1]),
}


def rule(joint):
    return RULES[joint.removeprefix("right_").removeprefix("left_")]


def plain_score(angles):
    """Read one posture: {joint: deg} -> final score."""

    def points(joint):
        edges, scores = rule(joint)
        return scores[sum(angles[joint] > edge for edge in edges[1:-1])]

    def either(*joints):
        return max(points(joint) for joint in joints)

    def worse(*joints):
        return max(
            sum(part)
            for part in zip(
                *([points(f"{side}_{j}") for side in ("right", "left")] for j in joints),
                strict=True,
            )
        )

    neck = points("neck_flexion") + either("neck_side_bend", "neck_twist")
    trunk = points("trunk_flexion") + either("trunk_side_bend", "trunk_twist")
    legs = worse("knee_flexion")
    upper, lower = worse("shoulder_flexion", "shoulder_abduction"), worse("elbow_flexion")
    wrist = max(
        points(f"{side}_wrist_flexion")
        + either(f"{side}_wrist_deviation", f"{side}_forearm_pronation")
        for side in ("right", "left")
    )
    scores = reba.combine(
        neck=neck, trunk=trunk, legs=legs, upper_arm=upper, lower_arm=lower, wrist=wrist
    )
    table_a = int(scores.table_a) - ((neck, trunk) == (3, 5) and legs in (2, 3))
    return TABLE_C[table_a, int(scores.table_b)]


def read_table_c():
    """Return {(table A, table B): final score} over all segment scores, as `combine` gives it."""
    found = {}
    for neck in range(1, 4):
        for trunk in range(1, 6):
            for legs in range(1, 5):
                for arm in range(1, 7):
                    for lower in (1, 2):
                        for wrist in (1, 2, 3):
                            s = reba.combine(
                                neck=neck,
                                trunk=trunk,
                                legs=legs,
                                upper_arm=arm,
                                lower_arm=lower,
                                wrist=wrist,
                            )
                            found[int(s.score_a), int(s.score_b)] = int(s.final)
    return found


TABLE_C = read_table_c()


def rejected(count, seed):
    """Draw as the EPFL report did, by an interval of each joint and then inside it: points (n, 20)
    [rad]."""
    rng = np.random.default_rng(seed)
    columns = []
    for joint in REPORT_JOINTS:
        edges = np.array(rule(joint)[0], dtype=float)
        band = rng.integers(len(edges) - 1, size=count)
        columns.append(rng.uniform(edges[band], edges[band + 1]))
    return np.radians(np.stack(columns, axis=1))


@pytest.mark.slow
def test_interval_labels_agree_with_a_plain_reading():
    drawn = rejected(1500, 0)
    balanced = posture_data(100, "interval", cache=False)
    points = np.concatenate([drawn, balanced.points])
    plain = [plain_score(dict(zip(REPORT_JOINTS, np.degrees(row), strict=True))) for row in points]
    np.testing.assert_array_equal(interval_labels(points), plain)
    np.testing.assert_array_equal(balanced.labels, plain[1500:])
    assert np.bincount(balanced.labels.astype(int)).tolist() == [0] + [100] * 10


def test_the_two_low_cells_count():
    posture = dict.fromkeys(REPORT_JOINTS, 0.0)
    posture |= {
        "neck_flexion": 30,
        "neck_twist": 20,
        "trunk_flexion": 70,
        "trunk_twist": 20,
        "right_knee_flexion": 70,
    }
    row = np.radians([posture[joint] for joint in REPORT_JOINTS])
    # Neck 3, trunk 5, legs 2 is 7 here and 8 in REBA's table A; hanging arms with straight elbows
    # are 1 in table B.
    assert interval_labels(row) == TABLE_C[7, 1] == 7
    assert (
        reba.combine(neck=3, trunk=5, legs=2, upper_arm=1, lower_arm=2, wrist=1).final
        == TABLE_C[8, 1]
        == 8
    )


def test_interval_data_have_the_law_of_rejection():
    drawn = rejected(100_000, 1)
    labels = interval_labels(drawn)
    for score in (6, 9):
        kept = drawn[labels == score]
        exact = posture_data(len(kept), "interval", seed=score, scores=[score], cache=False).points
        for column in range(20):
            levels = np.quantile(kept[:, column], np.linspace(0.05, 0.95, 19))
            shares = [np.mean(sample[:, [column]] <= levels, axis=0) for sample in (kept, exact)]
            assert np.abs(shares[0] - shares[1]).max() < 4.5 * np.sqrt(0.5 / len(kept))


@pytest.mark.parametrize(
    "joints", [REPORT_JOINTS, SCORED_JOINTS, ("trunk_flexion", "neck_flexion", "right_hip_flexion")]
)
def test_sheet_labels_are_a_function_of_the_drawn_joints(joints):
    scores = range(1, 11) if len(joints) > 3 else (1, 2, 3)
    data = posture_data(50, joints=joints, scores=scores, cache=False)
    assert data.coordinates == joints
    np.testing.assert_array_equal(
        reba.assess(Coordinates(joints).spread(data.points)).final, data.labels
    )
    assert sorted(np.unique(data.labels)) == list(scores)
    assert (data.points.std(axis=0) > 0.05).all()


def test_options_of_task_and_method_count():
    method = reba.Method(additive=True)
    data = posture_data(30, scores=(5, 9), method=method, load_kg=7.0, cache=False)
    final = reba.assess(
        Coordinates(data.coordinates).spread(data.points), method, load_kg=7.0
    ).final
    np.testing.assert_array_equal(final, data.labels)
    assert "load_kg 7.0" in data.source


def test_same_seed_same_data_in_blocks_too():
    one, same, other = (posture_data(2500, seed=seed, cache=False) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.points, same.points)
    np.testing.assert_array_equal(one.labels, same.labels)
    assert (one.points != other.points).any()
    assert len(np.unique(one.points[:, 0])) == len(one) == 25_000


def test_the_cache_gives_back_what_was_drawn(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    told = []
    first = posture_data(10, seed=5, progress=told.append)
    assert told[-1] == 1
    (path,) = (tmp_path / "ergoqp" / "postures").iterdir()
    again = posture_data(10, seed=5, progress=told.append)
    np.testing.assert_array_equal(again.points, first.points)
    assert (again.source, again.coordinates) == (first.source, first.coordinates)
    # The file is what is read: with other numbers in it, these come back.
    np.savez(
        path,
        points=first.points + 1,
        labels=first.labels,
        coordinates=first.coordinates,
        source="changed",
    )
    assert posture_data(10, seed=5).source == "changed"
    for other in (
        posture_data(10, seed=6),
        posture_data(10, "interval", seed=5),
        posture_data(10, seed=5, activity=1, scores=range(2, 12)),
        posture_data(10, seed=5, method=reba.Method(additive=True)),
        posture_data(10, seed=5, joints=SCORED_JOINTS),
    ):
        assert other.source != "changed"


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", None])
def test_a_cache_that_cannot_be_read_is_ignored(content, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = posture_data(10, seed=5)
    (path,) = (tmp_path / "ergoqp" / "postures").iterdir()
    path.write_bytes(path.read_bytes()[:-40] if content is None else content)
    np.testing.assert_array_equal(posture_data(10, seed=5).points, first.points)
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    with np.load(path) as file:
        np.testing.assert_array_equal(file["points"], first.points)


def test_a_folder_that_cannot_be_written_means_no_cache(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert len(posture_data(10)) == 100


def test_noise_in_the_stream_gives_the_expected_score():
    noise = {"taus_deg": (8.0, 2.0), "weights": (0.3, 0.7)}
    points, labels = next(posture_stream(np.random.default_rng(0), joints=SCORED_JOINTS, **noise))
    states = Coordinates(SCORED_JOINTS).spread(points)
    exact, expected = reba.assess(states).final, SmoothReba(*noise.values())(states)
    assert (labels != exact).mean() > 0.2
    # The labels scatter about the closed form: nothing is left that goes with the form itself or
    # with the exact score.
    for other in (np.ones(len(labels)), expected, exact - expected):
        left = (labels - expected) * other
        assert abs(left.mean()) < 4.5 * left.std() / np.sqrt(len(left))


def test_mistakes_are_named():
    with pytest.raises(InputError, match="labels: got 'rula', allowed 'sheet', 'interval'"):
        posture_data(labels="rula")
    with pytest.raises(InputError, match="labels: got 'interval' with load_kg, allowed without"):
        posture_data(labels="interval", load_kg=5.0)
    with pytest.raises(InputError, match="labels: got 'interval' with method"):
        posture_data(labels="interval", method=reba.Method())
    with pytest.raises(InputError, match="joints: got 'elbow_x'"):
        posture_data(joints=("elbow_x",))
    with pytest.raises(InputError, match="per_score: got 0"):
        posture_data(0)
    with pytest.raises(InputError, match="scores: got 11, allowed under these options: 1, 2"):
        posture_data(5, scores=[11], joints=("trunk_flexion",))
    with pytest.raises(InputError, match=r"points: got shape \(4, 19\), allowed \(n, 20\)"):
        interval_labels(np.zeros((4, 19)))
    with pytest.raises(InputError, match="row 1 holds NaN"):
        interval_labels([[0.0] * 20, [np.nan] * 20])
    with pytest.raises(InputError, match="taus_deg"):
        next(posture_stream(np.random.default_rng(0), taus_deg=(-1.0,), weights=(1.0,)))
    with pytest.raises(InputError, match="weights"):
        next(posture_stream(np.random.default_rng(0), taus_deg=(1.0, 5.0), weights=(0.5, 0.2)))


def test_interval_ranges_are_those_of_the_rules():
    lower, upper = interval_ranges()
    for joint in REPORT_JOINTS:
        edges = rule(joint)[0]
        assert np.degrees(lower[INDEX[joint]]) == pytest.approx(edges[0])
        assert np.degrees(upper[INDEX[joint]]) == pytest.approx(edges[-1])
