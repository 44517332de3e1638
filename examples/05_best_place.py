"""The best place of the object, offline: for one person and for somebody taller.

The example also shows what a robot makes of it.
"""

from collections import Counter

import ergoqp
from ergoqp.human import Body
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import ModelPerson

problem = ergoqp.load_problem("low_bin")  # a bin at knee height that a lift can move a little

# How the person holds the bin now: here at an awkward place, yours may come from
# `ergoqp.load_recording(...).postures`.
now = awkward_start(problem, ModelPerson(problem.response), seed=0)

# Twelve starts at random places; each ends where the person comes to rest, scored by the exact
# sheet.
best = ergoqp.optimise(problem, now, starts=12, seed=0)
x, y, z = best.pose[:3, 3]
print(
    f"best place: REBA {best.reba_before} -> {best.reba_after} with the bin at x {x:.2f}, y"
    f" {y:.2f}, z {z:.2f} m"
)
print(f"conditions of optimality hold to {best.kkt_residual:.0e}")
print(
    "scores that starts ended at:",
    dict(sorted(Counter(trial.reba for trial in best.trials).items())),
)

# What would be possible if the person took the posture that is best, and not the one that is least
# effort: a bound.
bound = ergoqp.optimise(problem, now, starts=12, seed=0, mode="cooperative")
print(f"if the posture could be chosen too: REBA {bound.reba_after}")

# Another person, another place. `jobs=2` would solve the starts in two processes.
taller = ergoqp.optimise(problem, starts=6, seed=0, person=Body.of_stature(1.95))
print(f"a person of 1.95 m: REBA {taller.reba_after} at z {taller.pose[2, 3]:.2f} m")

# The control step, drawn to the place wherever descent alone would rest at a worse one.
run = ergoqp.simulate(problem, now, duration=15.0, guide=best)
print(
    f"guided loop: REBA {run.reba[0]} -> {run.reba[-1]}, limits broken"
    f" {sum(run.violations.values())} times"
)
