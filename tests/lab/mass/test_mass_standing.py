"""People with mass stand, sit, hold, push, slip and fall as bodies do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.joints import LOWER, UPPER
from ergoqp.lab.mass import person as holding
from ergoqp.lab.mass.body import HABITS, PERSON_DOFS, SOFT_ROBOT
from ergoqp.lab.mass.control import Grasp
from ergoqp.lab.mass.person import Mass, MassHolding
from ergoqp.problem.load import load_problem
from ergoqp.rest.best_place import awkward_start
from ergoqp.simulation.people import person_of_kind

PROBLEMS = ("screwing", "overhead", "low_bin", "dentist", "desk")
WEIGHT = 9.81


def drawn(problem: str, seed: int = 0, body: Body | None = None) -> Mass:
    person = person_of_kind("mass", load_problem(problem), seed, body)
    assert isinstance(person, Mass)
    return person


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have people hold still for two seconds only."""
    monkeypatch.setattr(holding, "STILL", 2.0)


def floor_force(who: MassHolding) -> np.ndarray:
    """Return what floor and seat push the person with (3,) [N]."""
    total, one = np.zeros(3), np.zeros(6)
    mujoco.mj_forward(who.model, who.data)
    for number in range(who.data.ncon):
        mujoco.mj_contactForce(who.model, who.data, number, one)
        contact = who.data.contact[number]
        # The force is on the second of the two, which is the person's or the floor's.
        sign = 1 if who.model.geom_bodyid[contact.geom[0]] == 0 else -1
        total += sign * (contact.frame.reshape(3, 3).T @ one[:3])
    return total


def energy(who: MassHolding) -> float:
    """Return potential and kinetic energy of person and object [J]."""
    mujoco.mj_energyPos(who.model, who.data)
    mujoco.mj_energyVel(who.model, who.data)
    return float(who.data.energy.sum())


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_everybody_holds_still_for_twenty_seconds(name: str) -> None:
    problem, person = load_problem(name), drawn(name, seed=5)
    who = person.hold(awkward_start(problem, person, seed=5, places=4))
    assert holding.STILL == 20.0
    assert who.held_drift <= 0.010
    assert not who.fallen
    assert not who.unbalanced
    before, pose = energy(who), who.pose.copy()
    for _ in range(20):
        who.follow(pose, 0.05)
    assert energy(who) <= before + 0.05


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_ground_carries_the_person_and_nothing_else_does(name: str, soon: None) -> None:
    person = drawn(name)
    who = person.hold(awkward_start(load_problem(name), person, seed=0, places=4))
    weight = np.array([0, 0, person.body.mass * WEIGHT])
    np.testing.assert_allclose(floor_force(who) + who.force[:3], weight, atol=5.0)
    assert np.linalg.norm(who.force[:3]) < 15.0
    assert not who.data.qfrc_applied.any()
    assert not who.data.xfrc_applied.any()
    # Muscles act between segments: what is left on the pelvis is what the object pushes.
    np.testing.assert_allclose(who.data.qfrc_actuator[:3], who.force[:3], atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "desk"])
def test_who_carries_the_box_alone_feels_its_weight(name: str, soon: None) -> None:
    person = drawn(name, seed=1)
    who = person.hold(person.comfort)
    pose = who.pose.copy()
    who.release()
    for _ in range(160):
        who.follow(pose, 0.05)
    np.testing.assert_allclose(who.force[2], -SOFT_ROBOT.load * WEIGHT, rtol=0.10)
    assert np.linalg.norm(who.pose[:3, 3] - pose[:3, 3]) < 0.05
    total = person.body.mass + SOFT_ROBOT.load
    np.testing.assert_allclose(floor_force(who)[2], total * WEIGHT, rtol=0.02)
    assert not who.fallen


@pytest.mark.parametrize("stature", [1.50, 1.95])
@pytest.mark.parametrize("name", ["screwing", "dentist"])
def test_the_short_and_the_tall_hold_still(name: str, stature: float, soon: None) -> None:
    who = drawn(name, 2, Body.of_stature(stature)).hold(drawn(name, 2).comfort)
    assert who.held_drift <= 0.010
    assert not who.fallen
    assert not who.unbalanced


def pushed(who: MassHolding, force: float) -> MassHolding:
    """Return somebody after a push against the trunk for 0.3 s, with nothing in hand."""
    who = who.copy()
    who._grasp.let_go()
    trunk, pose = who.model.body("trunk").id, who.pose
    for number in range(60):
        who.data.xfrc_applied[trunk, 0] = force if number < 6 else 0.0
        who.follow(pose, 0.05)
    return who


@pytest.mark.slow
def test_a_push_beyond_balance_makes_people_fall(soon: None) -> None:
    who = drawn("screwing").hold(drawn("screwing").comfort)
    gentle, hard = pushed(who, 40.0), pushed(who, 500.0)
    assert not gentle.fallen
    assert not gentle.unbalanced
    assert hard.fallen


@pytest.mark.slow
def test_who_is_out_of_balance_does_not_rest(soon: None, monkeypatch: pytest.MonkeyPatch) -> None:
    who = drawn("screwing").hold(drawn("screwing").comfort)
    assert who.copy().rest(who.pose)
    monkeypatch.setattr(who._support, "carries", lambda data: False)
    assert not who.rest(who.pose)


def test_slips_and_slides_are_counted_from_the_begin_of_a_loop(soon: None) -> None:
    who = drawn("screwing").hold(drawn("screwing").comfort)
    who._grasp.slipped, who.slid = 3, 0.1
    who._stood = who._soles() + 0.2
    who.follow(who.pose, 0.05)
    assert who.slipped == 3
    assert who.slid > 0.2
    who.count_from_here()
    who.follow(who.pose, 0.05)
    assert who.slipped == 0
    assert who.slid < 1e-3


def test_soles_lift_and_are_not_welded(soon: None) -> None:
    who = drawn("screwing").hold(drawn("screwing").comfort)
    before = who.data.site("right_sole").xpos.copy()
    pelvis = who.model.body("pelvis").id
    who.data.xfrc_applied[pelvis, 2] = 1.2 * who.model.body_subtreemass[pelvis] * WEIGHT
    who._grasp.let_go()
    for _ in range(6):
        who.follow(who.pose, 0.05)
    assert who.data.site("right_sole").xpos[2] > before[2] + 0.05


@pytest.mark.parametrize(("share", "slips"), [(0.95, 0), (1.3, 1)])
def test_a_hand_slips_beyond_its_force_and_not_below(share: float, slips: int) -> None:
    person = drawn("screwing")
    model, data = person.model, mujoco.MjData(person.model)
    data.qpos[:39], _ = person.stand(person.comfort)
    data.qpos[-4] = 1.0
    data.qpos[-7:-4] = data.site("right_grip").xpos
    mujoco.mj_forward(model, data)
    grasp = Grasp(model, ("right",))
    grasp.take(data)
    mujoco.mj_forward(model, data)
    data.qpos[-7] += share * HABITS.slip_force / HABITS.grasp_stiffness
    mujoco.mj_forward(model, data)
    pulled = np.linalg.norm(grasp.wrench(data)[:3])
    np.testing.assert_allclose(pulled, share * HABITS.slip_force, rtol=1e-6)
    data.time = 1.0
    grasp.slide(data)
    mujoco.mj_forward(model, data)
    assert grasp.slipped == slips
    held = np.linalg.norm(grasp.wrench(data)[:3])
    np.testing.assert_allclose(held, min(share, 1.0) * HABITS.slip_force, rtol=1e-6)


@pytest.mark.slow
def test_a_copy_and_another_of_the_same_seed_go_on_bit_for_bit(soon: None) -> None:
    person = drawn("desk", seed=3)
    who = person.hold(person.comfort)
    other, pose = who.copy(), who.pose.copy()
    pose[2, 3] += 0.01
    for twin in (who, other):
        for _ in range(30):
            twin.follow(pose, 0.01)
    assert who.data.qpos.tobytes() == other.data.qpos.tobytes()
    assert who.posture.tobytes() == other.posture.tobytes()
    assert who.force.tobytes() == other.force.tobytes()
    assert person.hold(person.comfort).posture.tobytes() == (
        drawn("desk", seed=3).hold(person.comfort).posture.tobytes()
    )


@pytest.mark.parametrize("dt", [0.005, 0.05])
def test_time_passes_as_told(dt: float, soon: None) -> None:
    person = drawn("dentist", seed=1)
    who = person.hold(person.comfort)
    pose, begin = who.pose.copy(), who.data.time
    for _ in range(round(0.5 / dt)):
        pose[0, 3] += 0.05 * dt
        who.follow(pose, dt)
    np.testing.assert_allclose(who.data.time - begin, 0.5, atol=1e-9)
    assert who.gap < 0.02
    np.testing.assert_allclose(who.pose[:3, 3], pose[:3, 3], atol=0.006)


@pytest.mark.slow
def test_carrying_ends_where_the_object_is_reached_last(soon: None) -> None:
    person = drawn("screwing", seed=1)
    who = person.hold(person.comfort)
    near, far = who.pose.copy(), who.pose.copy()
    near[2, 3] += 0.08
    far[0, 3] += 1.5
    assert who.carry(near)
    assert who.gap < 0.02
    np.testing.assert_allclose(who.pose[:3, 3], near[:3, 3], atol=0.005)
    assert not who.carry(far)
    assert who.gap < 0.03
    assert near[0, 3] < who.pose[0, 3] < far[0, 3] - 0.3


def test_the_plan_reaches_what_an_arm_reaches() -> None:
    person = drawn("screwing", seed=1)
    pose = np.eye(4)
    pose[:3, 3] = 0.45, -0.2, 1.1
    posture, reached = person.reach(pose)
    assert reached
    assert np.all(posture >= LOWER)
    assert np.all(posture <= UPPER)
    pose[0, 3] = 3.0
    assert not person.reach(pose)[1]


def test_posture_and_base_put_the_hand_where_it_is(soon: None) -> None:
    person = drawn("screwing", seed=1)
    who = person.hold(person.comfort)
    model, data = person.body.model, mujoco.MjData(person.body.model)
    base = who.base
    yaw = np.arctan2(base[1, 0], base[0, 0])
    data.qpos[:] = np.concatenate([base[:3, 3], [yaw], who.posture])
    mujoco.mj_kinematics(model, data)
    grip = data.site("right_grip").xpos
    np.testing.assert_allclose(grip, who.data.site("right_grip").xpos, atol=1e-9)
    np.testing.assert_allclose(grip, who.pose[:3, 3], atol=0.005)
    assert who.data.qpos.shape == (7 + PERSON_DOFS - 6 + 7,)
