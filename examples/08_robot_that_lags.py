"""A robot that lags: declared, the loop reckons with it.

Not declared, the step notices, says so and stops. There is a watchdog too.

Here the robot is simulated; yours is a driver that executes twists and measures the pose of what it
holds.
"""

import numpy as np

import ergoqp
from ergoqp.simulation.robot import RobotKind, SimulatedRobot

problem = ergoqp.load_problem("screwing")
posture = np.asarray(problem.response.comfort) + 0.0
for name, degrees in {"right_shoulder_flexion": 75, "right_elbow_flexion": 50}.items():
    posture[ergoqp.JOINTS.index(name)] = np.radians(degrees)
held = np.array(problem.response.contact()(posture)[0])


def loop(problem: ergoqp.Problem, seconds: float) -> tuple[ergoqp.Stepper, ergoqp.Step]:
    """Close the loop of a posture that does not follow and a robot with a lag of 80 ms.

    Say what the step says.
    """
    stepper, robot = (
        ergoqp.Stepper(problem),
        SimulatedRobot(RobotKind(lag=0.08), held, np.random.default_rng(0)),
    )
    for period in range(round(seconds / problem.dt)):
        step = stepper.step(posture, pose=robot.measured_pose())
        for _ in robot.execute(step.twist, problem.dt):
            pass
        if period % 25 == 0:
            speed = 1000 * np.linalg.norm(step.twist[:3])
            print(
                f"{period * problem.dt:5.2f} s  {step.status:<9} {speed:5.1f} mm/s  {step.reason}"
            )
    return stepper, step


print("nothing declared:")
loop(problem, 1.0)

print("lag declared:")
stepper, step = loop(problem.replace(robot=ergoqp.DeclaredRobot(lag=0.1)), 1.0)

# The next step does not come in time. The robot's watchdog asks for the braking twist instead,
# period by period.
periods = 0
while step.twist.any():
    step, periods = stepper.brake(), periods + 1
print(f"the watchdog brought it to rest in {1000 * periods * problem.dt:.0f} ms: {step.reason}")
