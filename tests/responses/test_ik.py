"""The ik response against an independent computation, and what it means: contact kept, soles kept,
locks, comfort."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from full_kkt import (
    contact_of,
    eyes_of,
    frame,
    jacobian,
    mobile,
    placed,
    rows_of,
    sensitivity,
    swings_of,
)

from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.responses import IkResponse
from ergoqp.responses.stance_and_gaze import arm_of

NOBODY = np.zeros(32)
KINDS = list(
    itertools.product(
        ("seated", "standing"), (("right",), ("left",), ("right", "left")), (True, False)
    )
)
KINDS.append(("standing", ("right",), True, "thumb"))
COMFORT = {
    "elbow_flexion": 80,
    "knee_flexion": 25,
    "hip_flexion": 12,
    "ankle_flexion": 12,
    "shoulder_flexion": 15,
}


@cache
def response_of(kind: tuple, damping: float = 0.02, stature: float = 1.75) -> IkResponse:
    stance, hands, free, *tool = kind
    return IkResponse(
        body=Body.of_stature(stature),
        stance=stance,
        hands=hands,
        free_about_tool=free,
        tool=tool[0] if tool else "along",
        comfort_deg=COMFORT,
        damping=damping,
    )


def postures(count: int, seed: int = 0, spread: float = 25.0) -> np.ndarray:
    """Bent arms and knees, so that nothing is singular; both soles may be anywhere."""
    middle = np.zeros(32)
    for name, angle in COMFORT.items():
        for side in ("right", "left"):
            middle[INDEX[f"{side}_{name}"]] = np.radians(angle)
    noise = np.random.default_rng(seed).uniform(-1, 1, (count, 32)) * np.radians(spread)
    found = np.clip(middle + noise, LOWER, UPPER)
    for joint in (
        "right_knee_flexion",
        "left_knee_flexion",
        "right_elbow_flexion",
        "left_elbow_flexion",
    ):
        found[:, INDEX[joint]] = np.maximum(found[:, INDEX[joint]], 0.15)
    return found


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_sensitivity_is_the_full_weighted_pseudo_inverse(kind: tuple) -> None:
    response = response_of(kind)
    for posture in postures(4):
        S, E = (np.array(part) for part in response.sensitivity()(posture, NOBODY))
        expected, unmet = sensitivity(response, posture, NOBODY)
        S[swings_of(response)] = 0.0
        np.testing.assert_allclose(S, expected, atol=1e-7 * (1 + np.abs(expected).max()))
        yaw = np.array(response.contact()(posture)[1])[:3, :3]
        in_world = np.kron(np.eye(2 * len(response.hands)), yaw)
        np.testing.assert_allclose(in_world @ E, unmet, atol=1e-7)


@pytest.mark.parametrize("kind", [KINDS[0], KINDS[5], KINDS[6], KINDS[10]], ids=str)
def test_locked_joints_stay_and_the_others_follow(kind: tuple) -> None:
    response = response_of(kind)
    rng = np.random.default_rng(1)
    for number, posture in enumerate(postures(4, seed=2)):
        locked = np.zeros(32)
        chosen = ["trunk_flexion", "right_wrist_flexion", "left_elbow_flexion"][: number + 1]
        locked[[INDEX[joint] for joint in chosen]] = 1
        locked[INDEX[rng.choice(response.joints)]] = 1
        S, E = (np.array(part) for part in response.sensitivity()(posture, locked))
        assert np.abs(S[locked > 0.5]).max() < 1e-6
        expected, unmet = sensitivity(response, posture, locked)
        S[swings_of(response)] = 0.0
        np.testing.assert_allclose(S, expected, atol=2e-6 * (1 + np.abs(expected).max()))
        # What is left over is told, in world axes or the pelvis's alike.
        assert np.linalg.norm(E) == pytest.approx(np.linalg.norm(unmet), rel=1e-5, abs=1e-6)


def test_a_person_whose_arm_is_locked_follows_with_the_rest() -> None:
    response = response_of(KINDS[6])
    posture = postures(1)[0]
    locked = np.zeros(32)
    locked[
        [INDEX[joint] for joint in JOINTS if joint.startswith("right_") and INDEX[joint] < 20]
    ] = 1
    forward = np.array([1.0, 0, 0, 0, 0, 0])
    S, E = (np.array(part) for part in response.sensitivity()(posture, locked))
    rates = S @ forward
    assert abs(rates[INDEX["trunk_flexion"]]) > 0.1
    assert np.abs(rates[INDEX["right_knee_flexion"]]) > 0.01
    assert np.linalg.norm(E @ forward) < 0.1
    everything = np.ones(32)
    S, E = (np.array(part) for part in response.sensitivity()(posture, everything))
    assert np.abs(S).max() < 1e-5
    # Nobody moves: the whole contact motion is unmet.
    assert np.linalg.norm(E @ forward) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_after_a_small_motion_every_grip_is_where_the_object_is(kind: tuple) -> None:
    # The undamped person; the error of a straight step is of second order.
    response = response_of(kind, 1e-5)
    hands = len(response.hands)
    rng = np.random.default_rng(3)
    for posture in postures(3, seed=4):
        twist = 0.1 * rng.normal(size=6) * [1, 1, 1, 2, 2, 2]
        contact = np.array(response.contact()(posture)[0])
        axis = contact[:3, 0] if response.free_about_tool else np.zeros(3)
        before = np.split(np.array(response.grips()(posture)), hands, axis=1)
        errors = []
        for dt in (2e-3, 1e-3, 1e-4):
            rates = np.array(response.sensitivity()(posture, NOBODY)[0]) @ twist
            after = np.split(np.array(response.grips()(posture + rates * dt)), hands, axis=1)
            error = 0.0
            for old, new in zip(before, after, strict=True):
                wanted = twist[:3] + np.cross(twist[3:], old[:3, 3] - contact[:3, 3])
                turned = (new[:3, :3] @ old[:3, :3].T - np.eye(3)) / dt
                spin = (
                    np.array(
                        [
                            turned[2, 1] - turned[1, 2],
                            turned[0, 2] - turned[2, 0],
                            turned[1, 0] - turned[0, 1],
                        ]
                    )
                    / 2
                )
                missed = twist[3:] - spin
                missed -= axis * (axis @ missed)
                error = max(
                    error, np.abs((new - old)[:3, 3] / dt - wanted).max(), np.abs(missed).max()
                )
            errors.append(error)
        assert errors[1] < 0.6 * errors[0] + 1e-6
        assert errors[2] < 1e-3


@pytest.mark.parametrize("kind", [kind for kind in KINDS if len(kind[1]) == 1], ids=str)
def test_after_a_small_motion_the_contact_is_where_the_object_is(kind: tuple) -> None:
    response = response_of(kind, 1e-5)
    posture, twist = postures(1, seed=4)[0], np.array([0.05, -0.02, 0.04, 0, 0, 0])
    rates = np.array(response.sensitivity()(posture, NOBODY)[0]) @ twist
    before, after = (np.array(response.contact()(q)[0]) for q in (posture, posture + 1e-3 * rates))
    np.testing.assert_allclose((after - before)[:3, 3] / 1e-3, twist[:3], atol=2e-3)
    np.testing.assert_allclose(after[:3, 0], before[:3, 0], atol=1e-5)


@pytest.mark.parametrize("hands", [("right",), ("right", "left")])
def test_soles_do_not_slip_while_the_object_moves(hands: tuple[str, ...]) -> None:
    response = response_of(("standing", hands, True))
    posture = postures(1, seed=5)[0]
    data = placed(response, posture)
    columns = mobile(response, NOBODY)
    rates = np.array(response.sensitivity()(posture, NOBODY)[0])
    # The pelvis rates that the legs imply must be the same for both soles.
    for twist in np.eye(6):
        joint_rates = rates @ twist
        soles = np.vstack([jacobian(data, f"{side}_sole") for side in ("right", "left")])
        base = np.linalg.lstsq(soles[:, :4], -soles[:, 4:] @ joint_rates, rcond=None)[0]
        assert np.abs(soles[:, :4] @ base + soles[:, 4:] @ joint_rates).max() < 1e-8
    assert len(columns) == 4 + len(response.chain)


def test_a_free_turn_about_the_tool_is_nobodys_business() -> None:
    for kind in (KINDS[0], KINDS[6], KINDS[-1]):
        response = response_of(kind)
        posture = postures(1, seed=6)[0]
        axis = np.array(response.contact()(posture)[0])[:3, 0]
        S, E = (np.array(part) for part in response.sensitivity()(posture, NOBODY))
        twist = np.concatenate([np.zeros(3), axis])
        assert np.abs(S @ twist).max() < 1e-9
        assert np.abs(E @ twist).max() < 1e-9
    rigid = response_of(("standing", ("right",), False))
    posture = postures(1, seed=6)[0]
    axis = np.array(rigid.contact()(posture)[0])[:3, 0]
    assert (
        np.abs(
            np.array(rigid.sensitivity()(posture, NOBODY)[0]) @ np.concatenate([np.zeros(3), axis])
        ).max()
        > 0.3
    )


@pytest.mark.parametrize("kind", [KINDS[0], KINDS[4], KINDS[6], KINDS[10]], ids=str)
def test_drift_goes_to_comfort_and_moves_neither_grips_nor_soles(kind: tuple) -> None:
    response = response_of(kind, 1e-4)
    for posture in postures(3, seed=7):
        data = placed(response, posture)
        rates = np.array(response.drift()(posture, NOBODY)).ravel()
        moves, _ = rows_of(response, data)
        base = np.zeros(4)
        if response.stance == "standing":
            soles = np.vstack([jacobian(data, f"{side}_sole") for side in ("right", "left")])
            base = np.linalg.lstsq(soles[:, :4], -soles[:, 4:] @ rates, rcond=None)[0]
            assert np.abs(soles @ np.concatenate([base, rates])).max() < 1e-8
        assert np.abs(moves @ np.concatenate([base, rates])).max() < 1e-5
        free = [] if response.hanging is None else arm_of(response.hanging)
        moving = {INDEX[joint] for joint in response.joints} | set(free)
        assert np.abs(rates[sorted(set(range(32)) - moving)]).max(initial=0.0) == 0
        # It leads downhill: discomfort, balance and what the eyes miss, together.
        chain = [INDEX[joint] for joint in response.chain]
        away = (response.weight_vector * (posture - response.comfort))[chain]
        seen, by_rates, _ = eyes_of(response, data)
        pulls = np.append(away, seen * response.attention)
        pelvis = np.array(response.contact()(posture)[1])[:2, 3]
        downhill = pulls @ np.append(rates[chain], by_rates @ np.concatenate([base, rates]))
        downhill += response.balance * pelvis @ base[:2]
        assert downhill < -1e-3


def test_drift_ends_in_comfort_distance_and_holds_locked_joints() -> None:
    response = replace(response_of(("seated", ("right",), True), 1e-3), looks=False)
    posture = postures(1, seed=8)[0]
    before = np.array(response.grips()(posture))
    weights, comfort = response.weight_vector, response.comfort
    moved = [INDEX[joint] for joint in response.chain]
    locked = np.zeros(32)
    locked[INDEX["trunk_twist"]] = 1
    distances, q = [], posture.copy()
    for _ in range(300):
        distances.append(float(weights[moved] @ (q - comfort)[moved] ** 2))
        q = q + 0.02 * np.array(response.drift()(q, locked)).ravel()
    assert q[INDEX["trunk_twist"]] == posture[INDEX["trunk_twist"]]
    assert distances[-1] < 0.9 * distances[0]
    assert np.all(np.diff(distances) < 1e-6)
    assert np.linalg.norm(np.array(response.grips()(q))[:3, 3] - before[:3, 3]) < 0.02


@pytest.mark.parametrize("kind", KINDS[::2], ids=str)
def test_the_world_is_anchored_to_the_soles_or_the_seat(kind: tuple) -> None:
    response = response_of(kind)
    for posture in postures(3, seed=9):
        data = placed(response, posture)
        contact, pelvis = (np.array(part) for part in response.contact()(posture))
        np.testing.assert_allclose(contact, contact_of(response, data), atol=1e-6)
        for hand, grip in zip(
            response.hands,
            np.split(np.array(response.grips()(posture)), len(response.hands), 1),
            strict=True,
        ):
            np.testing.assert_allclose(grip, frame(data, f"{hand}_grip"), atol=1e-12)
        np.testing.assert_allclose(pelvis, frame(data, "pelvis"), atol=1e-12)
        if response.stance == "seated":
            np.testing.assert_allclose(pelvis[:3, 3], [0, 0, response.seat])
            np.testing.assert_allclose(pelvis[:3, :3], np.eye(3))
        else:
            right, left = frame(data, "right_sole"), frame(data, "left_sole")
            np.testing.assert_allclose((right + left)[:3, 3], 0, atol=1e-12)
            heading = (right + left)[:2, 0]
            assert abs(heading[1]) < 1e-9 * np.linalg.norm(heading)
            assert heading[0] > 0


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_singular_arms_and_straight_knees_ask_for_nothing_infinite(kind: tuple) -> None:
    response = response_of(kind)
    rng = np.random.default_rng(10)
    straight = [
        np.zeros(32),
        LOWER,
        UPPER,
        *rng.uniform(LOWER, UPPER, (10, 32)),
        *rng.choice([0.0, 1.0], (5, 32)) * UPPER,
    ]
    for posture in straight:
        for locked in (NOBODY, np.ones(32), rng.integers(0, 2, 32)):
            S, E = (np.array(part) for part in response.sensitivity()(posture, locked))
            rates = np.array(response.drift()(posture, locked))
            assert np.isfinite(S).all()
            assert np.isfinite(E).all()
            assert np.isfinite(rates).all()
            assert np.abs(S).max() < 200


def test_a_straight_knee_can_still_bend() -> None:
    response = response_of(("standing", ("right",), True))
    posture = np.zeros(32)
    posture[INDEX["right_elbow_flexion"]] = 1.4
    locked = np.zeros(32)
    locked[:20] = 1
    down = np.array(response.sensitivity()(posture, locked)[0]) @ [0, 0, -1.0, 0, 0, 0]
    assert down[INDEX["right_knee_flexion"]] > 0.5
    assert down[INDEX["left_knee_flexion"]] > 0.5


def test_only_the_joints_of_the_chain_move() -> None:
    for kind in KINDS:
        response = response_of(kind)
        S = np.array(response.sensitivity()(postures(1)[0], NOBODY)[0])
        moving = {JOINTS[i] for i in np.flatnonzero(np.abs(S).max(axis=1) > 1e-9)}
        assert moving == set(response.joints), kind
        assert [INDEX[joint] for joint in response.joints] == sorted(
            INDEX[joint] for joint in response.joints
        )
    blind = replace(response_of(KINDS[6]), looks=False)
    assert "neck_flexion" in response_of(KINDS[6]).joints
    assert "neck_flexion" not in blind.joints
    assert not any(joint.startswith("left_") for joint in response_of(KINDS[0]).joints)


def test_a_heavier_joint_moves_less() -> None:
    posture, twist = postures(1, seed=11)[0], np.array([0.1, 0.05, 0.1, 0, 0, 0])
    rates = {}
    for weight in (0.5, 2.5, 50.0):
        response = IkResponse(weights={"trunk_flexion": weight}, comfort_deg=COMFORT)
        rates[weight] = abs(
            (np.array(response.sensitivity()(posture, NOBODY)[0]) @ twist)[INDEX["trunk_flexion"]]
        )
    assert rates[0.5] > rates[2.5] > 5 * rates[50.0]


def test_expression_is_the_unlocked_sensitivity() -> None:
    import casadi as ca

    response, posture = response_of(KINDS[6]), postures(1)[0]
    q = ca.MX.sym("q", 32)
    by_expression = np.array(ca.Function("S", [q], [response.expression(q)])(posture))
    np.testing.assert_array_equal(
        by_expression, np.array(response.sensitivity()(posture, NOBODY)[0])
    )


def test_reach_moves_the_grips_by_what_it_was_asked() -> None:
    response = response_of(("standing", ("right", "left"), False), 1e-5)
    posture = postures(1, seed=12)[0]
    asked = 1e-4 * np.random.default_rng(12).normal(size=12)
    step = np.array(response.reach()(posture, NOBODY, asked)).ravel()
    before, after = (np.array(response.grips()(q)) for q in (posture, posture + step))
    np.testing.assert_allclose((after - before)[:3, 3], asked[:3], atol=2e-6)
    np.testing.assert_allclose((after - before)[:3, 7], asked[6:9], atol=2e-6)


@pytest.mark.parametrize("stature", [1.5, 1.75, 2.0])
@pytest.mark.parametrize("hip", [70.0, 83.0, 95.0])
def test_a_seat_is_set_to_the_person_so_that_the_feet_stand(stature: float, hip: float) -> None:
    response = IkResponse(
        Body.of_stature(stature),
        stance="seated",
        comfort_deg={"hip_flexion": hip, "knee_flexion": 85},
    )
    data = placed(response, response.comfort)
    for side in ("right", "left"):
        assert frame(data, f"{side}_sole")[2, 3] == pytest.approx(0, abs=1e-12)
    assert frame(data, "pelvis")[2, 3] == response.seat
    assert (
        response.footing
        == f"the pelvis stays on its seat, {response.seat:.2f} m high, with the feet on the floor"
    )


@pytest.mark.parametrize(
    ("stature", "footing"),
    [
        (1.5, "at that height the feet hang 0.09 m above the floor"),
        (2.0, "the legs need 0.06 m more, and are not modelled folded"),
    ],
)
def test_a_seat_that_does_not_fit_is_told(stature: float, footing: str) -> None:
    response = IkResponse(Body.of_stature(stature), stance="seated", seat_height=0.55)
    assert response.seat == 0.55
    assert response.footing == f"the pelvis stays on its seat, 0.55 m high; {footing}"


def test_a_seat_that_nobody_could_set_is_refused() -> None:
    response = IkResponse(stance="seated", comfort_deg={"hip_flexion": 115, "knee_flexion": 0})
    with pytest.raises(
        InputError,
        match=r"seat_height: got none, .* comfort_deg puts the seat at -0\.\d+ m, allowed 0\.05 to",
    ):
        _ = response.seat


def test_a_side_wins_over_both_sides() -> None:
    response = IkResponse(
        weights={"right_elbow_flexion": 3.0, "elbow_flexion": 0.2}, comfort_deg={"knee_flexion": 18}
    )
    assert response.weight_vector[INDEX["right_elbow_flexion"]] == 3.0
    assert response.weight_vector[INDEX["left_elbow_flexion"]] == 0.2
    np.testing.assert_allclose(
        np.degrees(response.comfort[[INDEX["right_knee_flexion"], INDEX["left_knee_flexion"]]]), 18
    )


@pytest.mark.parametrize(
    ("terms", "sentence"),
    [
        ({"hands": ("left", "left")}, "hands: got .*, allowed 'right', 'left' or both, each once"),
        ({"hands": ()}, "hands: got"),
        ({"stance": "kneeling"}, "stance: got 'kneeling', allowed standing, seated"),
        ({"tool": "pen"}, "tool: got 'pen', allowed along, thumb"),
        ({"seat_height": 55.0}, "seat_height: got 55.0 m, allowed 0.2 to 1.2 m"),
        (
            {"seat_height": 0.5},
            "seat_height: got 0.5 of a person who stands, allowed none, or stance 'seated'",
        ),
        ({"damping": 0.0}, "damping: got 0.0"),
        ({"damping": float("nan")}, "damping: got nan"),
        ({"relaxation_time": -1.0}, "relaxation_time: got -1.0"),
        ({"balance": -1.0}, "balance: got -1.0"),
        ({"weights": {"elbow_flexion": 0.0}}, "weights of elbow_flexion: got"),
        ({"weights": {"elbow_flexion": float("nan")}}, "weights of elbow_flexion: got"),
        ({"weights": {"tail": 1.0}}, "weights: got 'tail', allowed a joint such as"),
        ({"comfort_deg": {"elbow": 90}}, "comfort_deg: got 'elbow'"),
        (
            {"comfort_deg": {"elbow_flexion": 200}},
            "comfort_deg: right_elbow_flexion: got .*, which is beyond its range",
        ),
        (
            {"comfort_deg": {"elbow_flexion": float("nan")}},
            "comfort_deg of elbow_flexion: got nan deg, allowed",
        ),
    ],
)
def test_wrong_terms_are_named(terms: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        IkResponse(**terms)


def test_the_model_of_mujoco_is_the_one_asked_for() -> None:
    response = response_of(KINDS[6], 0.02, 1.60)
    assert isinstance(response.body.model, mujoco.MjModel)
    posture = postures(1)[0]
    S, _ = (np.array(part) for part in response.sensitivity()(posture, NOBODY))
    S[swings_of(response)] = 0.0
    np.testing.assert_allclose(S, sensitivity(response, posture, NOBODY)[0], atol=1e-6)


def test_goes_to_another_process_after_use():
    response = IkResponse()
    pose = np.array(response.contact()(response.comfort)[0])
    sent = pickle.loads(pickle.dumps(response))
    assert sent == response
    assert np.array_equal(np.array(sent.contact()(sent.comfort)[0]), pose)
