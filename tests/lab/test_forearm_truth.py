"""The true cost of a forearm: every witness is exact, no posture does better, and nothing reachable
is missed."""

import numpy as np
import pytest

from ergoqp import reba
from ergoqp.errors import InputError
from ergoqp.human import Body, Kinematics
from ergoqp.human.forearm import ARM_INDEX, ARM_JOINTS, Arm, forearm_length, forearm_points
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.lab.forearm import boxes_of, true_cost, true_posture

METHODS = [
    reba.Method(),
    reba.Method(
        additive=True,
        adduction=True,
        band_ends="higher",
        trunk_extension="mirrored",
        arms="segments",
    ),
]


def random_postures(count, seed):
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 32))


def with_arm_of(postures, method=None):
    """Return postures that keep trunk, right shoulder and elbow, and have everything else at its
    best."""
    rest = np.tile(boxes_of(method or reba.Method()).rest, (len(postures), 1))
    rest[:, ARM_INDEX] = postures[:, ARM_INDEX]
    return rest


@pytest.mark.parametrize(
    "body", [Body(), Body.of_lengths({"trunk": 0.61, "upper_arm": 0.29, "forearm": 0.28})], ids=str
)
def test_points_are_those_of_the_kinematics(body):
    kinematics = Kinematics(body)
    postures = random_postures(5, 0)
    points = forearm_points(postures, body)
    for posture, row in zip(postures, points, strict=True):
        expected = [
            np.asarray(kinematics.at(f"right_{name}", posture)[0]).ravel()
            for name in ("elbow", "wrist")
        ]
        np.testing.assert_allclose(row, np.concatenate(expected), rtol=0, atol=1e-12)
    lengths = np.linalg.norm(points[:, 3:] - points[:, :3], axis=1)
    np.testing.assert_allclose(lengths, forearm_length(body), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("solve", "first"),
    [("solve_by_bend", "trunk_side_bend"), ("solve_by_shoulder", "right_shoulder_flexion")],
)
def test_closed_forms_return_the_posture_that_the_points_came_from(solve, first):
    body = Body.of_lengths({"shoulder_width": 0.33, "upper_arm": 0.35})
    postures = random_postures(500, 1)
    given = [postures[:, [INDEX[name]]] for name in (first, "trunk_twist")]
    points = forearm_points(postures, body)
    angles, missing = getattr(Arm(body), solve)(points, *given)
    assert angles.shape == (len(ARM_JOINTS), 500, 4)
    error = np.abs(angles - postures[:, ARM_INDEX].T[:, :, None]).max(axis=0)
    assert error.min(axis=1).max() < 1e-7
    # Every solution that there is puts elbow and wrist back.
    for k in range(4):
        there = missing[:, k] == 0
        again = np.zeros((there.sum(), 32))
        again[:, ARM_INDEX] = angles[:, there, k].T
        np.testing.assert_allclose(forearm_points(again, body), points[there], rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS, ids=["default", "other"])
def test_boxes_are_the_sheet(method):
    boxes = boxes_of(method)
    postures = with_arm_of(random_postures(4000, 2), method)
    final = reba.assess(postures, method).final
    angles = postures[:, ARM_INDEX].T
    for score in boxes.scores:
        inside = boxes.excess(angles, np.zeros(len(postures)), score) == 0
        np.testing.assert_array_equal(inside, final <= score)
    everything = random_postures(4000, 2)
    assert (reba.assess(everything, method).final >= final).all(), "all else is at its best"


@pytest.mark.slow
@pytest.mark.parametrize("body", [Body(), Body.of_stature(1.6)], ids=["1.75", "1.60"])
def test_witness_is_exact_and_never_above_the_posture_that_the_points_came_from(body):
    postures = random_postures(200, 3)
    points = forearm_points(postures, body)
    witness, cost = true_posture(points, body)
    assert cost.min() >= 1
    assert len(np.unique(cost)) > 4, "easy and hard points"
    np.testing.assert_allclose(forearm_points(witness, body), points, rtol=0, atol=1e-9)
    assessment = reba.assess(witness)
    np.testing.assert_array_equal(assessment.final, cost)
    assert not assessment.outside.any()
    assert ((witness >= LOWER) & (witness <= UPPER)).all()
    assert (cost <= reba.assess(with_arm_of(postures)).final).all()
    assert (cost <= reba.assess(postures).final).all()


@pytest.mark.slow
def test_method_counts():
    points = forearm_points(random_postures(40, 4))
    lenient = true_cost(points, method=reba.Method(upper_arm_low_deg=44, trunk_upright_deg=19))
    assert (lenient <= true_cost(points)).all()
    assert (lenient < true_cost(points)).any()


@pytest.mark.slow
def test_random_search_never_does_better():
    rng, arm = np.random.default_rng(5), Arm(Body())
    low, high = LOWER[ARM_INDEX], UPPER[ARM_INDEX]
    points = forearm_points(random_postures(20, 6))
    cost = true_cost(points)
    checked = 0
    for point, found in zip(points, cost, strict=True):
        if found == 1:
            continue
        bend, twist, shoulder = (rng.uniform(low[i], high[i], (1, 12_000)) for i in (1, 2, 3))
        # Half of the draws where trunk and shoulder cost little.
        bend[:, ::2], twist[:, ::2], shoulder[:, ::2] = (
            bend[:, ::2] / 4,
            twist[:, ::2] / 4.5,
            shoulder[:, ::2] / 8,
        )
        for angles, missing in (
            arm.solve_by_bend(point[None], bend, twist),
            arm.solve_by_shoulder(point[None], shoulder, twist),
        ):
            rows = angles[:, missing == 0].T
            rows = rows[((rows >= low) & (rows <= high)).all(axis=1)]
            postures = np.zeros((len(rows), 32))
            postures[:, ARM_INDEX] = rows
            checked += len(rows)
            if len(rows):
                assert reba.assess(with_arm_of(postures)).final.min() >= found
    assert checked > 20_000


def test_special_points():
    straight = np.zeros((1, 32))
    out_to_the_side = np.zeros((1, 32))
    out_to_the_side[0, INDEX["right_shoulder_abduction"]] = np.pi / 2
    ends = np.stack([LOWER, UPPER])
    points = forearm_points(np.concatenate([straight, out_to_the_side, ends]))
    witness, cost = true_posture(points)
    assert (cost > 0).all()
    np.testing.assert_allclose(forearm_points(witness), points, rtol=0, atol=1e-9)
    assert cost[0] == 1


def test_out_of_reach():
    good = forearm_points(np.zeros(32))[0]
    length = forearm_length()
    far, longer, shorter = good + 1.0, good.copy(), good.copy()
    longer[5] -= 2e-6
    shorter[5] += 2e-6
    behind = np.concatenate([good[:3], good[:3] + length * np.array([-1.0, 0, 0])])
    through = np.concatenate([[0.0, 0, 0], [length, 0, 0]])
    broken = np.full(6, np.nan)
    points = np.stack([good, far, longer, shorter, broken, through])
    witness, cost = true_posture(points)
    np.testing.assert_array_equal(cost[1:5], 0)
    assert cost[0] == 1
    assert np.isnan(witness[1:5]).all()
    np.testing.assert_array_equal(true_cost(behind), true_cost(behind[None]))
    assert len(true_cost(np.empty((0, 6)))) == 0


def test_backward_forearm_needs_a_bent_trunk():
    """An elbow bends one way: a forearm that points backward under a hanging arm is only there with
    a turned arm."""
    good = forearm_points(np.zeros(32))[0]
    behind = np.concatenate([good[:3], good[:3] + forearm_length() * np.array([-1.0, 0, 0])])
    assert true_cost(behind)[0] != 1


@pytest.mark.parametrize("points", [np.zeros(5), np.zeros((2, 7)), np.zeros((1, 2, 6))])
def test_other_shapes_are_refused(points):
    with pytest.raises(InputError, match=r"points: got shape .* allowed \(n, 6\)"):
        true_cost(points)
