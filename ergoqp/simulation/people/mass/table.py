"""All numbers of the motion of a person with mass in one table, with their origin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.problem.robot import DeclaredRobot

FRICTION: Final = 0.8
"""Friction of soles on the floor and trousers on the seat; see ``models/person_with_mass.xml``."""


class Muscle(NamedTuple):
    """How a joint is held.

    Attributes:
        stiffness: stiffness toward the wanted posture [N m/rad].
        damping: damping [N m s/rad].
        strength: greatest torque [N m].
        effort: cost of a deviation from comfort, per rad^2; relative.
    """

    stiffness: float
    damping: float
    strength: float
    effort: float


MUSCLES: Final[dict[str, Muscle]] = {
    "trunk_flexion": Muscle(500.0, 60.0, 350.0, 3.0),
    "trunk_side_bend": Muscle(500.0, 50.0, 250.0, 7.0),
    "trunk_twist": Muscle(250.0, 20.0, 150.0, 5.0),
    "neck_flexion": Muscle(30.0, 2.0, 50.0, 2.0),
    "neck_side_bend": Muscle(30.0, 2.0, 50.0, 4.0),
    "neck_twist": Muscle(20.0, 1.0, 25.0, 2.0),
    "shoulder_flexion": Muscle(30.0, 6.0, 90.0, 1.2),
    "shoulder_abduction": Muscle(30.0, 6.0, 80.0, 2.5),
    "shoulder_rotation": Muscle(15.0, 2.0, 50.0, 1.0),
    "elbow_flexion": Muscle(20.0, 3.0, 70.0, 0.7),
    "forearm_pronation": Muscle(6.0, 0.3, 12.0, 0.5),
    "wrist_flexion": Muscle(8.0, 0.4, 18.0, 1.2),
    "wrist_deviation": Muscle(10.0, 0.4, 18.0, 1.8),
    "hip_flexion": Muscle(500.0, 50.0, 250.0, 1.5),
    "hip_abduction": Muscle(500.0, 50.0, 200.0, 4.0),
    "hip_rotation": Muscle(150.0, 10.0, 80.0, 4.0),
    "knee_flexion": Muscle(400.0, 30.0, 280.0, 2.5),
    "ankle_flexion": Muscle(300.0, 20.0, 200.0, 2.0),
    "ankle_inversion": Muscle(100.0, 6.0, 60.0, 4.0),
}
"""By joint, the same for both sides.

Stiffness: shoulder and elbow are those of a hand that is led and does not resist, at the lower
end of the values of Mussa-Ivaldi, Hogan and Bizzi (1985) for hands that keep their place, of
the order of tens. The wrist is that of a firm grasp, several times the passive one of Formica
et al. (2012), which is of the order of one. The ankles are those of quiet standing (Loram and
Lakie 2002: both together about nine tenths of the body's toppling stiffness). The trunk is
active, of the order of hundreds as in the lumbar spines of Cholewicki and McGill (1996). Knees
and hips are such that the stance is not softer than the ankles. Damping: 0.2 to 0.7 of
critical with the distal segments. Strength: of the order of the greatest voluntary torques of
untrained adults. Effort: the trunk carries half the body, the forearm nothing.
"""


def per_joint(field: str) -> np.ndarray:
    """Return one column of `MUSCLES` for every joint (32,)."""
    return np.array(
        [
            getattr(MUSCLES[name.removeprefix("right_").removeprefix("left_")], field)
            for name in JOINTS
        ]
    )


@dataclass(frozen=True)
class Habits:
    """How a person of this kind plans, balances and holds; the same for all unless noted.

    Attributes:
        grasp_stiffness: stiffness of a hand's grasp of the object [N/m]; fingertips are of the
            order of 1000, a whole fist several times that.
        grasp_damping: damping of the grasp [N s/m].
        grasp_lever: half the width of what the hand closes around, along the tool axis [m].
        slip_force: force at which the hand slides along the object [N]: a moderate squeeze of
            80 N from both sides at a friction of 0.5.
        body_time: time constant with which trunk, neck and legs follow the planned posture
            [s].
        arm_time: the same of the arms, which only have to yield to what they hold [s]: of the
            order of an arm's long-latency reflex.
        plan_period: time between two updates of the plan [s].
        tick: time between two commands to the muscles [s].
        grip_used: share of the available friction that a person uses, so that nothing slides.
        sway_stiffness: stiffness of the centre of mass over the soles, per mass [1/s^2].
        sway_damping: damping of the same [1/s].
        load_time: time constant with which a load in the hand is felt, or a load to come is
            taken over [s].
        lift_time: time constant with which a sinking load is lifted again [s].
        bracing: share of a felt load that the legs brace against.
        ahead: distance ahead of the ankles of the place over which the centre of mass is kept,
            as a share of the foot's length: in quiet standing it is of the order of 50 mm.
        farthest_over: largest distance from that place to which anybody moves their centre of
            mass by themselves [m]: somewhat less than half the way to the toes.
        eye_range: angle that the eyes turn without the neck [rad].
    """

    grasp_stiffness: float = 3000.0
    grasp_damping: float = 60.0
    grasp_lever: float = 0.05
    slip_force: float = 80.0
    body_time: float = 0.4
    arm_time: float = 0.1
    plan_period: float = 0.05
    tick: float = 0.01
    grip_used: float = 0.9
    sway_stiffness: float = 8.0
    sway_damping: float = 4.0
    load_time: float = 0.15
    lift_time: float = 3.0
    bracing: float = 0.7
    ahead: float = 0.17
    farthest_over: float = 0.05
    eye_range: float = 0.35


HABITS: Final = Habits()


@dataclass(frozen=True)
class SoftRobot:
    """The impedance with which the simulated robot holds the object.

    Its damping is to the ground, so it lags by damping over stiffness, 50 ms in shift and
    turn.

    Attributes:
        stiffness: stiffness of a shift [N/m].
        damping: damping of a shift [N s/m].
        turn_stiffness: stiffness of a turn [N m/rad].
        turn_damping: damping of a turn [N m s/rad].
        load: mass of the object [kg], which the robot carries.
    """

    stiffness: float = 5000.0
    damping: float = 250.0
    turn_stiffness: float = 200.0
    turn_damping: float = 10.0
    load: float = 3.0


SOFT_ROBOT: Final = SoftRobot()

SOFT_ROBOT_DECLARED: Final = DeclaredRobot(lag=0.08, pose_noise=0.010, pose_noise_deg=1.0)
"""The declaration of that robot for a controller, as upper bounds.

It contains the lag with a body on the robot, and how far a person who is led pulls and pushes
it off its path (at full speed mostly below 30 N, up to 80 N). When led people pulled half as
hard again, one loop in three had a robot fault with 60 ms and 5 mm, and none with these
values.
"""
