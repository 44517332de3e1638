"""The control loop: one call per period, from the measured posture to the robot's twist.

The robot executes that twist.

Here the "sensor" is the model person, who follows the object exactly; yours is a camera, a suit or
a filter.
"""

import numpy as np

import ergoqp

problem = ergoqp.load_problem("screwing")
stepper = ergoqp.Stepper(problem)

# Where the person is now: arm raised and reaching, in the order of ergoqp.JOINTS, in radians.
posture = np.zeros(32)
for name, degrees in {
    "right_shoulder_flexion": 75,
    "right_elbow_flexion": 50,
    "right_wrist_flexion": -20,
}.items():
    posture[ergoqp.JOINTS.index(name)] = np.radians(degrees)
print(f"at the start: REBA {problem.assess(posture).final[0]}")

for period in range(1000):
    step = stepper.step(posture)  # pass `pose=` when the robot measures the object's pose
    if period % 200 == 0:
        speed = 1000 * np.linalg.norm(step.twist[:3])
        print(
            f"{period * problem.dt:4.1f} s  {step.status:<10} {speed:5.1f} mm/s  cost"
            f" {step.cost:.2f}  {step.reason}"
        )
    posture = posture + step.posture_rate * problem.dt

print(f"after {1000 * problem.dt:.0f} s: REBA {problem.assess(posture).final[0]}, {step.status}")

lost = stepper.step(None)  # no frame arrived: the object slows down, and the step says why
print(f"without a frame: {lost.status}, {lost.reason}")
