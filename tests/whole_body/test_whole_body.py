"""The whole body's step: the object's own twist where the robot has no limits, and one within its
limits where it has."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

pytest.importorskip("mink")

import ergoqp
from ergoqp.errors import InputError, ProblemError
from ergoqp.expressions import Evaluator
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.rest.person_protocol import SensorModel
from ergoqp.simulation.check import Checker
from ergoqp.whole_body import WholeBody, load_robot
from ergoqp.whole_body.loop import run_whole_body
from ergoqp.whole_body.state import own_objective, terms_function


def without_limits():
    """The Panda's tree without ranges, rates and accelerations to speak of."""
    robot = load_robot("panda")
    k = np.ones(len(robot.joints))
    return replace(
        robot,
        lower=robot.lower - 50,
        upper=robot.upper + 50,
        velocity=1e3 * k,
        acceleration=1e6 * k,
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "desk", "low_bin"])
def test_without_limits_of_the_robot_it_is_the_twist_of_the_fast_step(name):
    problem = ergoqp.load_problem(name)
    person = sample_person(problem, 0, body=problem.response.body)
    posture = awkward_start(problem, person, 0, 10)
    whole = WholeBody(problem, without_limits(), posture=posture, distance=None)
    trace = run_whole_body(whole, person, posture, duration=1.5, senses=SensorModel())
    compared = [
        step
        for step in trace.steps
        if step.object_step.status in ("optimal", "relaxed", "recovering")
    ]
    compared = [step for step in compared if step.object_step.residuals["accepted"] == 1]
    assert len(compared) > 100
    assert max(np.abs(step.twist).max() for step in compared) > 0.04
    assert max(np.abs(step.twist - step.object_step.twist).max() for step in compared) < 1e-8


@pytest.fixture(scope="module")
def near_the_thigh():
    """A dentist's start from which the object would come down onto the thigh."""
    problem = ergoqp.load_problem("dentist")
    person = sample_person(problem, 0, body=problem.response.body)
    return problem, person, awkward_start(problem, person, 4, 1)


@pytest.mark.slow
def test_the_distance_is_kept_where_it_would_not_be(near_the_thigh):
    problem, person, posture = near_the_thigh
    careless = WholeBody(problem, posture=posture, distance=None)
    without = run_whole_body(careless, person, posture, duration=4.5)
    assert min(without.distances) < 0.045
    checker = Checker(careless.problem)
    careful = WholeBody(problem, posture=posture, distance=0.05)
    trace = run_whole_body(careful, person, posture, duration=4.5, checker=checker)
    assert min(trace.distances) >= 0.05 - 1e-4
    assert trace.broken_limits(careful) == 0
    assert not any(checker.violations.values())
    held = [step for step in trace.steps if step.status == "slower"]
    assert held
    assert "distance of" in held[0].reason
    before, after = problem.assess(np.array([trace.postures[0], trace.postures[-1]])).final
    assert after < before


@pytest.mark.slow
def test_with_noisy_sensors_the_object_keeps_its_speed_and_the_loop_goes_on(near_the_thigh):
    """To keep the distance of a thigh that is seen where it is not, it went at 1.06 times its
    speed; the next step raised."""
    problem, person, posture = near_the_thigh
    whole = WholeBody(problem, posture=posture, distance=0.05)
    trace = run_whole_body(whole, person, posture, duration=5.0, senses=SensorModel())
    twists = np.array([step.twist for step in trace.steps])
    assert np.abs(twists).max() > 0.05
    assert np.all(np.abs(twists) <= problem.twist_limit.speed * (1 + 1e-6))
    assert any(step.status == "braking" for step in trace.steps)
    # Where it could not be kept, the step goes on from what the arm did all the same.
    whole._sent = 3 * whole._sent + 0.5
    assert np.isfinite(whole.step(posture, trace.arms[-1]).joint_velocities).all()


@pytest.mark.slow
def test_slow_joints_make_a_slower_object_and_are_named(near_the_thigh):
    problem, person, posture = near_the_thigh
    slow = replace(load_robot("panda"), velocity=np.full(7, 0.1), acceleration=np.full(7, 1.0))
    whole = WholeBody(problem, slow, posture=posture)
    trace = run_whole_body(whole, person, posture, duration=1.0)
    assert trace.broken_limits(whole) == 0
    speeds = np.array([step.joint_velocities for step in trace.steps])
    assert np.abs(speeds).max() > 0.0999
    assert any(step.status == "slower" and "rate of joint" in step.reason for step in trace.steps)


@pytest.mark.slow
def test_whatever_comes_in_joint_velocities_come_out(near_the_thigh):
    problem, _, posture = near_the_thigh
    whole = WholeBody(problem, posture=posture)
    joints = whole.start.copy()
    for _ in range(15):
        moving = whole.step(posture, joints)
        joints = joints + moving.joint_velocities * problem.dt
    assert np.abs(moving.joint_velocities).max() > 0.01
    bad_posture = posture.copy()
    bad_posture[3] = np.nan
    odd = (
        ((None, whole.start), {}, "braking"),
        ((bad_posture, whole.start), {}, "invalid"),
        (("no posture", whole.start), {}, "invalid"),
        ((posture, whole.start), {"age": 9.0}, "braking"),
        ((posture, whole.start), {"enable": False}, "braking"),
        ((posture, whole.start), {"pose": np.zeros((4, 4))}, "invalid"),
        ((posture, whole.start), {"observed": "all"}, "invalid"),
        ((posture, np.full(7, np.nan)), {}, "invalid"),
        ((posture, None), {}, "invalid"),
        ((posture, whole.start, [1, 2]), {}, "invalid"),
        ((posture, whole.start, np.full(7, 50.0)), {}, "invalid"),
        ((posture, whole.start, [0, 0, 50.0, 0, 0, 0, 0]), {}, "invalid"),
    )
    for arguments, options, status in odd:
        before = moving.joint_velocities
        moving = whole.step(*arguments, **options)
        assert moving.status == status
        assert moving.reason
        assert np.isfinite(moving.joint_velocities).all()
        assert (
            np.abs(moving.joint_velocities - before) <= whole.robot.acceleration * whole.dt + 1e-9
        ).all()
    hasty = whole.step(posture, whole.start, [0, 0, 50.0, 0, 0, 0, 0])
    assert hasty.reason.startswith(
        "arm_speed: joint3 is 50 rad/s, allowed within +-4.35, twice its largest speed"
    )
    # What is measured says where the arm is; its limits go on from what was sent.
    for speed in (-0.5, -1.5):
        before = whole.step(posture, whole.start).joint_velocities
        other = whole.step(posture, whole.start, np.full(7, speed))
        assert (
            np.abs(other.joint_velocities - before) <= whole.robot.acceleration * whole.dt + 1e-9
        ).all()
    whole.reset()
    unseen = np.ones(32, dtype=bool)
    unseen[4] = False
    bad_posture[3], bad_posture[4] = posture[3], np.nan
    step = whole.step(bad_posture, whole.start, observed=unseen)
    assert step.status in ("optimal", "recovering")


class ReadOnce:
    """Gives its values when it is read first, and raises from then on."""

    def __init__(self, values):
        self.values, self.read = values, False

    def __array__(self, *_, **__):
        if self.read:
            raise RuntimeError("read twice")
        self.read = True
        return np.array(self.values)


@pytest.mark.slow
def test_what_is_read_is_read_once_and_a_lost_frame_with_a_wrong_mask_is_no_exception(
    near_the_thigh,
):
    """A lost frame brakes and is not invalid, so the mask was read again, as the user gave it."""
    problem, _, posture = near_the_thigh
    whole = WholeBody(problem, posture=posture)
    for mask in ("all", np.ones(3), object(), np.full(32, np.nan)):
        assert whole.step(None, whole.start, observed=mask).status in ("braking", "invalid")
    for arguments, options in (
        ((ReadOnce(posture),), {}),
        ((posture,), {"observed": ReadOnce(np.ones(32))}),
    ):
        whole.reset()
        assert whole.step(*arguments, whole.start, **options).status in ("optimal", "recovering")


@pytest.mark.slow
def test_an_arm_that_is_masked_or_nowhere_is_not_known(near_the_thigh):
    problem, _, posture = near_the_thigh
    whole = WholeBody(problem, posture=posture)
    with np.errstate(all="raise"):
        far = 12.0 * np.eye(7)[2]
        for arm in (
            np.ma.array(whole.start, mask=True),
            np.full(7, 1e308),
            whole.start - far,
            whole.start + far,
        ):
            step = whole.step(posture, arm)
            assert step.status == "invalid"
            assert "arm" in step.reason
    assert "arm: joint3 is" in step.reason


@pytest.mark.slow
def test_what_cannot_be_built_is_said_in_one_sentence():
    problem = ergoqp.load_problem("screwing")
    far = np.eye(4)
    far[:3, 3] = [3.0, 0, 0]
    with pytest.raises(
        InputError, match=r"from a base at \[3\.0, 0\.0, 0\.0\] the arm cannot hold the object"
    ):
        WholeBody(problem, base=far)
    with pytest.raises(InputError, match="distance: got -1 m, allowed 0"):
        WholeBody(problem, distance=-1)
    with pytest.raises(InputError, match="tool_frame: got a pose that is not a rigid motion"):
        WholeBody(problem, tool_frame=np.zeros((4, 4)))
    with pytest.raises(InputError, match="tool_frame: got 'flange', allowed a pose"):
        WholeBody(problem, tool_frame="flange")
    with pytest.raises(InputError, match=r"posture: got \[.*, allowed 32 finite numbers"):
        WholeBody(problem, posture=[0.0])
    with pytest.raises(InputError, match=r"posture: got array\(.*, allowed 32 finite numbers"):
        WholeBody(problem, posture=np.zeros(3))
    for size in ((0, 0, 0), 3, (0.1, np.nan, 0.1)):
        with pytest.raises(
            InputError, match=r"object_size: got .*, allowed three side lengths from 0\.001 to 1 m"
        ):
            WholeBody(problem, object_size=size)
    with pytest.raises(
        InputError, match=r"object_size: got 0\.2 m along z, where tool_frame has the contact point"
    ):
        WholeBody(problem, object_size=(0.1, 0.1, 0.2))
    with pytest.raises(
        InputError, match="frame: got 'foo' beside a robot whose frame is 'flange', allowed None"
    ):
        WholeBody(problem, load_robot("panda"), frame="foo")
    with pytest.raises(InputError, match="problem: got 'dentist', allowed a Problem"):
        WholeBody("dentist")
    with pytest.raises(ProblemError, match="allowed IkResponse"):
        WholeBody(ergoqp.load_problem("forearm"))


@pytest.mark.slow
def test_the_posture_share_and_the_own_share_are_the_objective_of_the_step():
    problem = ergoqp.load_problem("screwing")
    rng, posture = np.random.default_rng(0), problem.response.comfort + 0.1
    given = {
        "posture": posture,
        "observed": np.ones(32),
        "pose": np.eye(4),
        "previous": 0.1 * rng.normal(size=6),
    }
    terms = Evaluator(terms_function(problem))(
        given | {"dt": 0.01, "stalled": 0.0, "locked": np.zeros(32), "final": 0.0}
    )
    H, g = own_objective(terms)
    effort = np.repeat([problem.control.effort_linear, problem.control.effort_angular], 3)
    smoothing, E = problem.control.smoothing / 0.01, terms["E"]
    assert np.allclose(
        H, np.diag(effort * (1 + smoothing)) + problem.control.contact * E.T @ E, rtol=0, atol=1e-10
    )
    assert np.allclose(g, -smoothing * effort * given["previous"], rtol=0, atol=1e-10)


@pytest.mark.slow
def test_joints_that_the_arm_does_not_use_stay_where_they_are(near_the_thigh):
    problem, _, posture = near_the_thigh
    robot, plain = load_robot("panda"), WholeBody(problem, posture=posture, distance=None)
    finger = robot.spec.body("link7").add_body(name="finger", pos=[0, 0.05, 0.1])
    finger.add_joint(
        name="finger", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0], range=[0, 0.04]
    )
    finger.add_geom(name="finger", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0])
    whole = WholeBody(problem, robot, posture=posture, distance=None)
    assert len(whole.scene.idle) == 1
    assert whole.scene.model.nv == plain.scene.model.nv + 1
    for _ in range(5):
        step, same = whole.step(posture, whole.start), plain.step(posture, plain.start)
        assert step.status == "optimal"
        assert np.abs(step.twist).max() > 1e-3
        assert np.allclose(step.joint_velocities, same.joint_velocities, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_null_space_leads_back_to_the_joints_of_the_start(near_the_thigh):
    problem, _, posture = near_the_thigh
    whole = WholeBody(problem, posture=posture, distance=None)
    model, data = whole.scene.model, mujoco.MjData(whole.scene.model)

    def jacobian(arm):
        data.qpos[whole.scene.arm_qpos] = arm
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        J = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, J[:3], J[3:], whole.scene.contact_site)
        return J[:, whole.scene.arm]

    aside = np.linalg.svd(jacobian(whole.start))[2][-1]
    arm = whole.start + 0.2 * aside
    step = whole.step(posture, arm)
    J = jacobian(arm)
    null = np.eye(7) - np.linalg.pinv(J) @ J
    # Smoothing holds on to the last speeds, which are zero, with 15 parts to one.
    expected = null @ (whole.start - arm) / (1 + problem.control.smoothing / whole.dt)
    assert np.abs(expected).max() > 1e-3
    assert np.allclose(null @ step.joint_velocities, expected, rtol=0, atol=1e-9)
    assert np.allclose(step.twist, step.object_step.twist, rtol=0, atol=1e-9)
