"""The closed loop of person, robot and object.

The person follows, and the joints of the arm do exactly what they are sent.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from ergoqp.rest.model_person import ModelPerson
from ergoqp.rest.person_protocol import SensorModel, frames
from ergoqp.simulation.check import Checker
from ergoqp.whole_body.scene import Scene
from ergoqp.whole_body.state import Separation
from ergoqp.whole_body.whole_body import WholeBody, WholeBodyStep

EXACT = SensorModel(noise_deg=0.0, drift_deg=0.0, lost=0.0)
"""Sensors without errors; the person still follows late."""


@dataclass
class WholeBodyTrace:
    """The record of one loop, sample by sample.

    Attributes:
        time: time of each sample [s].
        postures: postures of the person (32,) [rad].
        arms: joint positions of the arm (k,) [rad].
        poses: poses of the object (4, 4) [m].
        steps: the answers.
        distances: smallest distance to the true person, not the measured one [m].
    """

    time: list[float] = field(default_factory=list)
    postures: list[np.ndarray] = field(default_factory=list)
    arms: list[np.ndarray] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)
    steps: list[WholeBodyStep] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)

    def broken_limits(self, whole: WholeBody) -> int:
        """Return the number of samples that violate a range, rate or acceleration of the arm."""
        robot, dt = whole.robot, whole.dt
        arms, speeds = np.array(self.arms), np.array([step.joint_velocities for step in self.steps])
        before = np.vstack([np.zeros(speeds.shape[1]), speeds[:-1]])
        beyond = (
            (arms < robot.lower - 1e-9)
            | (arms > robot.upper + 1e-9)
            | (np.abs(speeds) > robot.velocity + 1e-9)
        )
        return int(
            (beyond | (np.abs(speeds - before) > robot.acceleration * dt + 1e-9)).any(axis=1).sum()
        )


class Ruler:
    """Measures the distances of a scene with the true person.

    Args:
        whole: step with robot, base and load.
        person: person with the true body, which may differ from the controller's model.
    """

    def __init__(self, whole: WholeBody, person: ModelPerson) -> None:
        """Build the true scene."""
        known = whole.scene
        self.scene = Scene(person.response.body, known.robot, known.base, known.load, known.hands)
        self._separation = Separation(self.scene)
        self._data = mujoco.MjData(self.scene.model)
        self._person = person

    def __call__(self, posture: np.ndarray, arm: np.ndarray) -> float:
        """Return the smallest distance [m] at a posture (32,) and joints of the arm (k,)."""
        pelvis = self._person.contact(posture)[1]
        place = np.array([*pelvis[:3, 3], np.arctan2(pelvis[1, 0], pelvis[0, 0])])
        self._data.qpos[:] = self.scene.qpos(place, posture, arm)
        mujoco.mj_kinematics(self.scene.model, self._data)
        return self._separation.smallest(self._data)[0]

    def contact(self, arm: np.ndarray) -> np.ndarray:
        """Return the contact frame (4, 4) as the arm holds it."""
        self._data.qpos[self.scene.arm_qpos] = arm
        mujoco.mj_kinematics(self.scene.model, self._data)
        return self.scene.contact_pose(self._data)


def run_whole_body(
    whole: WholeBody,
    person: ModelPerson,
    posture: np.ndarray,
    *,
    duration: float,
    seed: int = 0,
    senses: SensorModel = EXACT,
    checker: Checker | None = None,
) -> WholeBodyTrace:
    """Run the loop from `WholeBody.start` and return its trace.

    Args:
        whole: the step, made for this posture; it is reset here.
        person: the simulated person.
        posture: posture with which the person holds the tool at the start (32,) [rad]. Soles and
            grasp stay as in this posture.
        duration: duration of the loop [s].
        seed: seed of noise and lost frames.
        senses: sensors between person and controller.
        checker: judges the motion of the object. None: no check.

    Example:
        >>> import ergoqp
        >>> from ergoqp.rest.model_person import sample_person
        >>> from ergoqp.whole_body import WholeBody
        >>> from ergoqp.whole_body.loop import run_whole_body
        >>> problem = ergoqp.load_problem("screwing")
        >>> posture = problem.response.comfort
        >>> whole = WholeBody(problem, posture=posture)
        >>> trace = run_whole_body(whole, sample_person(problem, 0), posture, duration=0.1)
        >>> len(trace.steps), trace.broken_limits(whole)
        (10, 0)
    """
    whole.reset()
    dt, arm = whole.dt, whole.start.copy()
    ruler = Ruler(whole, person)
    pose = ruler.contact(arm)
    holding = person.holding(person.start_at(posture, pose), senses)
    errors = frames(senses, dt, np.random.default_rng([seed, 2]))
    trace, previous, speeds, age = WholeBodyTrace(), np.zeros(6), np.zeros(len(arm)), 0.0
    measured = posture.copy()
    for number in range(round(duration / dt)):
        error, arrives = next(errors)
        age = 0.0 if arrives or number == 0 else age + dt
        if age == 0.0:
            measured = holding.posture + error
        step = whole.step(measured, arm, speeds, age=age)
        if checker is not None:
            rate = step.object_step.posture_rate
            checker.check(
                step.twist, previous, pose, measured, rate, dt, None, step.object_step.slack
            )
        trace.time.append(number * dt)
        trace.postures.append(holding.posture)
        trace.arms.append(arm)
        trace.poses.append(pose)
        trace.steps.append(step)
        trace.distances.append(ruler(holding.posture, arm))
        previous, speeds = step.twist, step.joint_velocities
        arm = arm + speeds * dt
        pose = ruler.contact(arm)
        holding.follow(pose, dt)
    return trace
