"""A task of your own, put together in Python: another person, other limits, and your own cost."""

import casadi as ca
import numpy as np

import ergoqp
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.human import Body
from ergoqp.limits import AxisCone, JointLimit, TwistLimit, WorkspaceBox
from ergoqp.responses import IkResponse

# How the person would like to stand: knees not quite straight, or nobody could say which way they
# bend.
comfort = {
    "elbow_flexion": 80,
    "knee_flexion": 8,
    "hip_flexion": 4,
    "ankle_flexion": 4,
    "neck_flexion": 10,
}

problem = ergoqp.Problem(
    name="polishing",
    title="polishes a panel that a robot holds",
    cost=SmoothReba(load_kg=6),
    response=IkResponse(body=Body.of_stature(1.86), hands=("right",), comfort_deg=comfort),
    limits=[
        TwistLimit(linear_speed=0.15, axes=("x", "y", "z")),  # this robot only shifts the panel
        JointLimit(ranges_deg={"neck_flexion": (-20, 30)}),
        WorkspaceBox(lower=(0.25, -0.5, 0.8), upper=(0.75, 0.3, 1.6)),
        AxisCone(direction=(1, 0, 0), half_angle_deg=60),
    ],
    task={"load_kg": 6},
)


class Quadratic:
    """The classical cost: the squared distance to a comfortable posture."""

    name = "quadratic"
    minimum = 1.0

    def __init__(self, comfort, weight):
        """Keep the comfortable posture [rad] and the weight of distance from it [points/rad^2]."""
        self.comfort, self.weight = comfort, weight

    def expression(self, q):
        """Return V(q) as an expression: the controller takes its gradient from this."""
        return self.minimum + self.weight * ca.sumsqr(q - self.comfort)

    def __call__(self, postures):
        """Return V of each posture."""
        return self.minimum + self.weight * ((np.atleast_2d(postures) - self.comfort) ** 2).sum(
            axis=1
        )


start = problem.response.comfort.copy()
for name, degrees in {
    "right_shoulder_flexion": 80,
    "right_elbow_flexion": 40,
    "trunk_flexion": 15,
}.items():
    start[ergoqp.JOINTS.index(name)] = np.radians(degrees)

for variant in (problem, problem.replace(cost=Quadratic(problem.response.comfort, weight=1.0))):
    run = ergoqp.simulate(variant, start, duration=8.0)
    print(
        f"{variant.cost.name:<12} REBA {run.reba[0]} -> {run.reba[-1]}, standing still"
        f" {run.reba_standing_still}, limits broken {sum(run.violations.values())} times"
    )
