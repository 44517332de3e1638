"""Person, robot and object in one model.

The robot's joints are solved for, and everything keeps its distance.

Needs the extra ``mink``: ``pip install 'ergoqp[mink]'``.
"""

import numpy as np

import ergoqp
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.whole_body import WholeBody
from ergoqp.whole_body.loop import run_whole_body

problem = ergoqp.load_problem("dentist")
person = sample_person(problem, seed=0, body=problem.response.body)
posture = awkward_start(problem, person, seed=4, places=1)

# The robot that comes with the package; any MJCF or URDF by its path, with frame= and, where the
# file is silent, load_robot().
whole = WholeBody(problem, robot="panda", posture=posture, distance=0.05)
print(f"{len(whole.scene.pairs)} pairs of robot, object and person keep {whole.distance} m")

# One step, as in a control loop: posture and joints in, joint velocities out.
step = whole.step(posture, arm=whole.start, arm_speed=np.zeros(7))
print(f"first step: {step.status}, joints {step.joint_velocities.round(4)} rad/s")

# A whole loop with a person who follows, and an arm that does what it is told.
trace = run_whole_body(whole, person, posture, duration=6.0)
for number, step in enumerate(trace.steps):
    if number % 100 == 0:
        print(
            f"{trace.time[number]:3.0f} s  {step.status:<9} {trace.distances[number]:.3f} m "
            f" {step.reason}"
        )
before, after = problem.assess(np.array([trace.postures[0], trace.postures[-1]])).final
print(f"REBA {before} -> {after}, never nearer than {min(trace.distances):.3f} m")
print(f"limits of the arm broken {trace.broken_limits(whole)} times")
