"""Every kind of person: what a body does, and what only this kind does."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ergoqp
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.lab.people.habits import STATURES, draw_habits
from ergoqp.lab.people.kinds import RANGE, SHIFT, FollowerPerson
from ergoqp.lab.people.soft import REACHED, SoftHolding, SoftPerson
from ergoqp.lab.yardstick import Workspace
from ergoqp.problem.geometry import pose_error, straight, turned
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.person_protocol import LET_GO, SensorModel
from ergoqp.simulation.people import kinds, person_of_kind
from ergoqp.simulation.simulate import simulate

SOFT = tuple(kind for kind in kinds() if kind not in ("alike", "mass"))


def soft(kind: str, problem: str = "screwing", seed: int = 3) -> SoftPerson:
    person = person_of_kind(kind, load_problem(problem), seed)
    assert isinstance(person, SoftPerson)
    return person


def at_ease(person: SoftPerson) -> SoftHolding:
    held = person.hold(person.comfort)
    assert held.rest(held.pose)
    return held


def shifted(pose: np.ndarray, *shift: float) -> np.ndarray:
    moved = pose.copy()
    moved[:3, 3] += shift
    return moved


def live(held: SoftHolding, pose: np.ndarray, seconds: float) -> None:
    for _ in range(round(seconds / 0.01)):
        held.follow(pose, 0.01)


@pytest.mark.parametrize("kind", SOFT)
@pytest.mark.parametrize("name", TASKS)
def test_at_rest_hands_hold_soles_stand_and_joints_are_within_their_ranges(
    kind: str, name: str
) -> None:
    problem, person = load_problem(name), soft(kind, name)
    places, reached = Workspace(problem), 0
    for point in places.spread(5):
        held = at_ease(person)
        reached += (there := held.carry(places.pose(point)))
        assert np.all(held.posture >= LOWER)
        assert np.all(held.posture <= UPPER)
        if not there:
            continue
        assert held.gap <= REACHED == 0.01
        # What rests stays: a second of life changes nothing that is not chance.
        after = held.copy()
        live(after, held.pose, 1.0)
        if kind != "trembling":
            assert np.degrees(np.abs(after.posture - held.posture)).max() < 2.0
        if problem.response.stance == "standing":
            person.tasks.place(held.placement)
            for side, sole in zip(SIDES, held.soles, strict=True):
                assert np.linalg.norm(pose_error(person.tasks.frame(f"{side}_sole"), sole)) < 5e-3
    assert reached >= 2


def test_no_code_is_shared_with_the_controllers_responses() -> None:
    """Data of a problem's response may be read; what computes with it may not."""
    lab = Path(ergoqp.__file__).parent / "lab"
    files = [path for room in ("people", "mass") for path in (lab / room).rglob("*.py")]
    assert len(files) >= 9
    seen, taken = set(), set()
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                ("ergoqp.responses", "ergoqp.rest.model_person", "ergoqp.rest.best_place")
            ):
                seen |= {f"{node.module}.{name.name}" for name in node.names}
            if isinstance(node, ast.Import):
                seen |= {name.name for name in node.names if "ergoqp.re" in name.name}
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                called = ast.unparse(node.func)
                assert "response" not in called, (path, node.lineno)
                assert not called.startswith("said."), (path, node.lineno)
            # Nor under another name: who takes hold of it reads what it says of the task.
            if isinstance(node, ast.Attribute) and node.attr == "response":
                taken.add(path.name)
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "person_of":
                taken.add(path.name)
    # `Work.of` names the response `said`, and reads its fields.
    assert seen == {"ergoqp.rest.model_person.person_of"}
    assert taken == {"habits.py"}


@pytest.mark.parametrize("kind", SOFT)
def test_the_same_seed_is_the_same_person_and_lives_the_same_way(kind: str) -> None:
    ends = []
    for seed in (5, 5, 6):
        person = soft(kind, seed=seed)
        held = person.hold(person.comfort, seed=seed)
        for part in straight(held.pose, shifted(held.pose, 0.05, -0.05, 0.1)):
            live(held, part, 0.3)
        ends.append(held.posture)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[0] - ends[2]).max() > 0.01


@pytest.mark.parametrize("kind", SOFT)
def test_a_copy_goes_on_from_the_same_moment_and_leaves_the_other_alone(kind: str) -> None:
    held = at_ease(soft(kind))
    live(held, shifted(held.pose, 0.0, 0.0, 0.03), 0.4)
    other, before = held.copy(), held.posture
    live(other, shifted(held.pose, 0.1, 0.0, 0.1), 1.5)
    other.carry(shifted(held.pose, 0.0, 0.25, 0.0))
    np.testing.assert_array_equal(held.posture, before)
    again = held.copy()
    live(held, shifted(held.pose, 0.0, 0.0, 0.05), 0.5)
    live(again, shifted(again.pose, 0.0, 0.0, 0.05), 0.5)
    np.testing.assert_array_equal(held.posture, again.posture)


@pytest.mark.parametrize("kind", SOFT)
def test_what_is_out_of_reach_is_not_reached_and_the_object_stays_behind(kind: str) -> None:
    held = at_ease(soft(kind, "overhead"))
    far = shifted(held.pose, 3.0, 0.0, 0.0)
    assert not held.copy().rest(far)
    assert not held.carry(far)
    assert 0.01 < held.pose[0, 3] - at_ease(soft(kind, "overhead")).pose[0, 3] < 2.0
    assert held.gap < REACHED


@pytest.mark.parametrize("kind", [kind for kind in SOFT if kind != "stepping"])
@pytest.mark.parametrize("way", [(0.0, 0.0, 1.5), (1.5, 0.3, 0.0)])
def test_an_object_led_out_of_reach_drags_nobody_off_their_soles(
    kind: str, way: tuple[float, float, float]
) -> None:
    held = at_ease(soft(kind, "overhead"))
    begin = held.pose
    for share in np.linspace(0.0, 1.0, 300):
        held.follow(shifted(begin, *(share * np.array(way))), 0.02)
    assert held.gap > LET_GO
    assert held.slid < 5e-3


def test_hands_lag_by_the_delay() -> None:
    person = soft("follower")
    held = at_ease(person)
    before, goal = held.posture, shifted(held.pose, 0.05, 0.0, 0.0)
    waits = 0
    while np.abs(held.posture - before).max() < 1e-3:
        held.follow(goal, 0.01)
        waits += 1
    assert 0.01 * waits == pytest.approx(person.senses.delay, abs=0.045)


def test_a_place_is_reached_again_whatever_the_pace() -> None:
    """The rest is that of an energy: it does not depend on how fast the person gets there."""
    fast, slow = (at_ease(soft("follower")) for _ in range(2))
    goal = shifted(fast.pose, 0.08, 0.05, -0.1)
    fast.carry(goal)
    for part in straight(slow.pose, goal):
        live(slow, part, 1.0)
    slow.rest(goal)
    np.testing.assert_allclose(np.degrees(slow.posture), np.degrees(fast.posture), atol=0.2)


def test_dead_zone_moves_the_arm_alone_for_small_changes() -> None:
    held = at_ease(soft("dead_zone"))
    trunk = [INDEX["trunk_flexion"], INDEX["right_hip_flexion"], INDEX["left_elbow_flexion"]]
    before = held.posture
    assert held.rest(shifted(held.pose, 0.0, 0.0, 0.8 * SHIFT))
    np.testing.assert_array_equal(held.posture[trunk], before[trunk])
    assert np.abs(held.posture - before).max() > np.radians(1)
    assert held.rest(shifted(held.pose, 0.0, 0.0, 3 * SHIFT))
    assert np.all(held.posture[trunk[:2]] != before[trunk[:2]])


def test_dead_zone_is_not_woken_by_its_own_delay() -> None:
    person = soft("dead_zone")
    late = person.hold(person.comfort, replace(person.senses, delay=0.3, hand_time=0.12))
    assert late.rest(late.pose)
    legs, before, begin = slice(20, 32), late.posture, late.pose
    for share in np.linspace(0.0, 1.0, 20):
        late.follow(shifted(begin, 0.0, 0.0, share * 0.8 * SHIFT), 0.02)
    live(late, late.pose, 1.0)
    np.testing.assert_array_equal(late.posture[legs], before[legs])
    assert np.abs(late.posture - before).max() > np.radians(1)


def test_dead_zone_wakes_up_when_the_arm_alone_does_not_get_there() -> None:
    held = at_ease(soft("dead_zone"))
    near, trunk = shifted(held.pose, 0.0, 0.0, 0.7 * SHIFT), INDEX["trunk_flexion"]
    held._arms[:] = False  # as if it were stretched
    before = held.posture
    live(held, near, 4.0)
    assert held.gap < REACHED
    assert held.posture[trunk] != before[trunk]


def test_dead_zone_wakes_up_for_turns() -> None:
    held = at_ease(soft("dead_zone"))
    trunk, before = INDEX["trunk_flexion"], held.posture
    for turn_deg, awake in ((7.0, False), (20.0, True)):
        other, pose = held.copy(), held.pose.copy()
        pose[:3, :3] = turned(pose[:3, :3], np.radians([0.0, turn_deg, 0.0]))
        other.rest(pose)
        assert (other.posture[trunk] != before[trunk]) == awake


@pytest.mark.slow
def test_stubborn_people_keep_a_favourite_that_others_do_not_have() -> None:
    """Against a follower who would have the same habits, drawn with the same numbers."""
    kept, others = [], []
    for seed in range(8):
        person = soft("stubborn", seed=seed)
        rng = np.random.default_rng([seed, *b"stubborn", 0, *b"screwing", 1])
        usual = draw_habits(person.work, rng)
        changed = person.habits.spread < 0.9 * usual.spread
        assert 2 <= changed.sum() <= 3
        np.testing.assert_allclose(person.habits.spread[changed], 0.5 * usual.spread[changed])
        assert np.degrees(np.abs(person.comfort - usual.comfort)[changed]).max() > 5
        plain = FollowerPerson(person.body, person.work, usual, person.senses)
        for who, stays in ((person, kept), (plain, others)):
            held = at_ease(who)
            held.carry(shifted(held.pose, 0.05, 0.0, 0.15))
            stays.append(np.abs(held.posture - person.comfort)[changed].mean())
    assert np.mean(kept) < 0.6 * np.mean(others)


def test_stepping_people_go_after_what_is_far_and_only_then() -> None:
    held = at_ease(soft("stepping"))
    near = held.copy()
    near.carry(shifted(held.pose, 0.15, 0.0, 0.0))
    assert not near.feet.any()
    far = held.copy()
    assert far.carry(shifted(held.pose, 0.45, 0.0, 0.0))
    assert far.feet[0] > 0.1
    assert np.hypot(*far.feet) <= 0.6
    for sole, home in zip(far.soles, held.soles, strict=True):
        np.testing.assert_allclose(sole[:3, 3] - home[:3, 3], [*far.feet, 0.0], atol=1e-9)
    stool = at_ease(soft("stepping", "dentist"))
    seat = stool.base[:3, 3]
    assert stool.carry(shifted(stool.pose, 0.45, 0.0, 0.0))
    assert stool.base[0, 3] - seat[0] > 0.1
    assert stool.base[2, 3] == pytest.approx(seat[2])


def test_feet_step_one_after_the_other_over_the_floor_after_a_while() -> None:
    held = at_ease(soft("stepping"))
    goal, seen = shifted(held.pose, 0.3, 0.0, 0.0), []
    for _ in range(400):
        held.follow(goal, 0.01)
        seen.append([*held.soles[0][:3, 3], *held.soles[1][:3, 3]])
    feet = np.array(seen)
    moves = np.abs(np.diff(feet[:, [0, 3]], axis=0)) > 1e-6
    assert not (moves[:, 0] & moves[:, 1]).any(), "one foot stands"
    assert moves.any(axis=0).all(), "both step"
    first = int(np.argmax(moves.any(axis=1)))
    assert 0.35 < 0.01 * first < 1.0, "after a moment of leaning"
    assert feet[:, [2, 5]].min() >= -1e-9
    assert feet[:, [2, 5]].max() > 0.04
    assert np.abs(np.diff(feet, axis=0)).max() < 0.02, "feet do not jump"


def test_pushed_people_are_pushed_now_and_then_and_come_back() -> None:
    person = soft("pushed")
    held = at_ease(person)
    rest, necks = held.posture, []
    for _ in range(2000):
        held.follow(held.pose, 0.01)
        person.tasks.place(held.placement)
        necks.append(person.tasks.frame("trunk")[:2, 3])
    away = np.linalg.norm(np.array(necks) - necks[0], axis=1)
    assert 0.03 < away.max() < 0.09
    pushes = np.flatnonzero(np.diff((away > 0.02).astype(int)) == 1)
    assert 3 <= len(pushes) <= 7
    headings = np.array([necks[push] - necks[0] for push in pushes + 10])
    assert np.linalg.norm(headings.mean(axis=0)) < 0.8 * np.linalg.norm(headings, axis=1).mean()
    held.rest(held.pose)
    np.testing.assert_allclose(np.degrees(held.posture), np.degrees(rest), atol=1.0)


def gaze_beyond(person: SoftPerson, held: SoftHolding) -> np.ndarray:
    """How far the eyes turn beyond 15 deg around a line 15 deg below the head's level [rad]."""
    scale = person.body.stature / 1.75
    person.tasks.place(held.placement)
    head = person.tasks.frame("head")
    eyes = head[:3, 3] + head[:3, :3] @ np.array([0.09, 0.0, 0.06]) * scale
    x, y, z = head[:3, :3].T @ (held.pose[:3, 3] - eyes)
    asked = np.array([np.arctan2(-z, np.hypot(x, y)) - np.radians(15), np.arctan2(y, x)])
    return asked - np.clip(asked, -RANGE, RANGE)


@pytest.mark.slow
def test_looking_people_see_what_they_do() -> None:
    """The work is within the eyes' range of the head where the neck allows it, and not without."""
    problem, missed = load_problem("screwing"), {}
    for kind in ("looking", "follower"):
        person = soft(kind)
        places, off = Workspace(problem), []
        for point in places.spread(8):
            held = at_ease(person)
            if held.carry(places.pose(point)):
                off.append(np.abs(gaze_beyond(person, held)).max())
        missed[kind] = float(np.mean(off))
    assert missed["looking"] < 0.35 * missed["follower"]


def test_the_gaze_is_moved_as_its_slopes_say() -> None:
    """Against finite differences of the eyes' angles, wherever they turn beyond their range."""
    person, checked = soft("looking"), 0
    held = at_ease(person)
    for shift in ((0.0, 0.25, 0.1), (0.1, -0.35, 0.3), (-0.05, 0.1, -0.5)):
        pose = shifted(held.pose, *shift)
        person.tasks.place(held.placement)
        beyond, helps = (part * np.radians(5.0) for part in held._gaze(pose[:3, 3]))
        for entry in (0, 1, 2, 4, 5, 6, 7, 8, 9):
            moved = held.copy()
            moved.placement = held.placement.copy()
            moved.placement[entry] += 1e-6
            person.tasks.place(moved.placement)
            after = moved._gaze(pose[:3, 3])[0] * np.radians(5.0)
            for row in np.flatnonzero(beyond):
                slope = (beyond - after)[row] / 1e-6
                assert slope == pytest.approx(helps[row, entry], abs=1e-4)
                checked += abs(slope) > 0.1
    assert checked >= 10


def test_trembling_people_tremble_until_they_are_judged_and_read_wrong() -> None:
    person = soft("trembling")
    held = at_ease(person)
    rest, seen = held.posture, []
    for _ in range(200):
        held.follow(held.pose, 0.01)
        seen.append(held.posture)
    arm = INDEX["right_elbow_flexion"]
    assert 0.2 < np.degrees(np.ptp(np.array(seen)[:, arm])) < 4
    held.rest(held.pose)
    np.testing.assert_allclose(np.degrees(held.posture), np.degrees(rest), atol=0.3)
    assert person.senses.lost == 0.05
    assert 1 < np.degrees(np.abs(person.senses.bias)).max() <= 8 + 1e-9


@pytest.mark.slow
@given(seed=st.integers(0, 2**31), kind=st.sampled_from(SOFT))
@settings(max_examples=25, deadline=None)
def test_people_are_drawn_within_what_people_are(seed: int, kind: str) -> None:
    person = soft(kind, seed=seed)
    assert STATURES[0] <= person.body.stature <= STATURES[1]
    assert 40 < person.body.mass < 120
    assert 0 <= person.senses.delay <= 0.3
    assert np.all((person.comfort >= LOWER) & (person.comfort <= UPPER))
    assert np.all(person.habits.spread > 0)


def test_balance_is_kept_by_legs_and_trunk_alone() -> None:
    """A neck or an arm in the balance would move to carry the centre of mass."""
    person = soft("follower")
    person.placed(person.comfort)
    _, moves = person.tasks.mass_centre()
    unmoved = [4 + i for name, i in INDEX.items() if name.startswith(("neck", "right_shoulder"))]
    assert not moves[:, unmoved].any()
    assert moves[0, 4 + INDEX["trunk_flexion"]] > 0.1


def test_balance_matters_and_leans_as_the_person_likes() -> None:
    """With a weak will to balance the centre of mass strays further; its lean moves it ahead."""
    person, centres = soft("follower", "low_bin"), {}
    for name, habits in (
        ("usual", person.habits),
        ("weak", replace(person.habits, steadiness=10.0)),
        ("ahead", replace(person.habits, lean=person.habits.lean + 0.03)),
    ):
        other = FollowerPerson(person.body, person.work, habits, person.senses)
        held = at_ease(other)
        held.rest(shifted(held.pose, 0.3, 0.0, -0.1))
        other.tasks.place(held.placement)
        feet = np.array(other.tasks.feet())
        centres[name] = other.tasks.mass_centre()[0][0] - feet[:, 0].mean()
    assert centres["weak"] > centres["usual"] + 0.01
    assert 0.005 < centres["ahead"] - centres["usual"] < 0.03


@pytest.mark.parametrize(
    ("ahead", "beside", "falls"),
    [(0.0, 0.0, 0), (0.4, 0.0, 1), (-0.4, 0.0, 1), (0.0, 0.4, 1), (0.0, -0.4, 1), (0.0, 0.1, 0)],
)
def test_who_stands_is_out_of_balance_beyond_the_feet(
    monkeypatch: pytest.MonkeyPatch, ahead: float, beside: float, falls: int
) -> None:
    held = at_ease(soft("follower"))
    tasks = held.person.tasks
    (x, y), moves = tasks.mass_centre()
    monkeypatch.setattr(tasks, "mass_centre", lambda: ([x + ahead, y + beside], moves))
    held.advance(held.pose, 1e-9)
    assert held.unbalanced == bool(falls)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000))
def test_no_step_leaves_the_ranges_of_the_joints(seed: int) -> None:
    """Joints that stop push others on: also where that goes on for longer than is followed."""
    rng, tasks = np.random.default_rng(seed), soft("follower").tasks
    factor = rng.normal(size=(36, 36))
    hessian, pull = factor @ factor.T + 1e-3 * np.eye(36), 100 * rng.normal(size=36)
    placement = np.concatenate([np.zeros(4), (LOWER + UPPER) / 2])
    step = tasks.step_within(placement, hessian, pull, rng.random(36) < 0.9)
    assert np.all(placement + step >= tasks.lower - 1e-12)
    assert np.all(placement + step <= tasks.upper + 1e-12)


def test_nobody_rests_beyond_their_toes() -> None:
    person = soft("follower")
    held = at_ease(person)
    far = shifted(held.pose, 0.9, 0.0, -0.2)
    assert not held.copy().rest(far)
    assert not held.carry(far)
    person.tasks.place(held.placement)
    centre, feet = person.tasks.mass_centre()[0], np.array(person.tasks.feet())[:, :2]
    assert feet[:, 0].min() < centre[0] < feet[:, 0].max() + 1e-3
    leaning = held.copy()
    live(leaning, far, 3.0)
    assert leaning.unbalanced


def test_the_gap_is_that_to_the_object_itself_and_soles_that_slide_are_counted() -> None:
    person = soft("follower")
    held = at_ease(person)
    held.slid = 0.0
    for number in range(100):
        held.follow(shifted(held.pose, 0.0025, 0.0, 0.0), 0.01)
        if number > 60:
            lag = 0.25 * (person.senses.delay + person.senses.hand_time)
            assert held.gap == pytest.approx(lag, abs=0.02)
    assert 0.0 < held.slid < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "dentist"])
def test_a_posture_on_odd_feet_is_brought_down_flat_and_said(name: str) -> None:
    person, problem = soft("follower", name), load_problem(name)
    posture = person.comfort.copy()
    posture[INDEX["left_knee_flexion"]] += np.radians(35)
    posture[INDEX["right_ankle_flexion"]] -= np.radians(20)
    held = person.hold(posture)
    if name == "screwing":
        person.tasks.place(held.placement)
        for side in SIDES:
            sole = person.tasks.frame(f"{side}_sole")
            assert abs(sole[2, 3]) < 2e-3
            assert sole[2, 2] > np.cos(np.radians(1.0))
        run = simulate(problem, posture, 0.1, person=person)
        assert any("the start differs" in sentence for sentence in run.assumptions)
    assert not any("the start differs" in said for said in told(problem, person))
    np.testing.assert_allclose(held.posture[:20], posture[:20], atol=1e-9)


def told(problem, person: SoftPerson) -> list[str]:
    return simulate(problem, person.comfort, 0.1, person=person).assumptions


def test_the_same_person_with_another_body_keeps_habits_and_senses() -> None:
    problem = load_problem("desk")
    for kind in SOFT:
        own, other = (person_of_kind(kind, problem, 5, body) for body in (None, Body()))
        assert isinstance(own, SoftPerson)
        assert isinstance(other, SoftPerson)
        np.testing.assert_array_equal(own.comfort, other.comfort)
        assert own.senses == other.senses
        assert other.body.stature == 1.75


def test_what_is_said_beside_a_person_is_not_ignored() -> None:
    problem, person = load_problem("screwing"), soft("follower")
    held = person.hold(person.comfort)
    for beside in ({"person": person}, {"follower": "mass"}, {"senses": SensorModel()}):
        name = next(iter(beside))
        with pytest.raises(InputError, match=f"{name}: got one beside a person who holds"):
            simulate(problem, held, 0.1, **beside)
    with pytest.raises(InputError, match="got 'looking', but the person given is 'follower'"):
        simulate(problem, person.comfort, 0.1, person=person, follower="looking")
    with pytest.raises(InputError, match="follower: got 'giant', allowed alike"):
        simulate(problem, held, 0.1, follower="giant")


def test_a_free_arm_hangs_when_the_trunk_bends() -> None:
    person = soft("follower", "overhead")
    held = at_ease(person)
    held.carry(shifted(held.pose, 0.5, 0.0, -0.9))
    bend = np.degrees(held.posture[INDEX["trunk_flexion"]])
    assert bend > 15
    person.tasks.place(held.placement)
    shoulder, elbow = (person.tasks.frame(f"left_{part}")[:3, 3] for part in ("shoulder", "elbow"))
    upper_arm = elbow - shoulder
    assert np.degrees(np.arccos(-upper_arm[2] / np.linalg.norm(upper_arm))) < 0.5 * bend + 8


def test_a_kind_that_there_is_not() -> None:
    with pytest.raises(InputError, match="follower: got 'giant', allowed alike, dead_zone"):
        person_of_kind("giant", load_problem("screwing"), 0)
    with pytest.raises(InputError, match="follower: got 'giant'"):
        simulate(load_problem("screwing"), np.zeros(32), 0.1, follower="giant")


@pytest.mark.slow
@pytest.mark.parametrize("kind", SOFT)
def test_a_run_says_who_followed(kind: str) -> None:
    problem, person = load_problem("screwing"), soft(kind)
    run = simulate(problem, person.comfort, 0.3, 3, follower=kind)
    assert run.follower == kind
    assert any(person.manner in sentence for sentence in run.assumptions)
    held = person.hold(person.comfort)
    again = simulate(problem, held, 0.3, 3)
    np.testing.assert_allclose(again.poses[0], run.poses[0], atol=1e-9)
    np.testing.assert_allclose(held.posture, person.comfort, atol=2e-3)
