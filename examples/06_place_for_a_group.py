"""One fixed place of the object for several people, and what each of them pays for sharing it."""

import ergoqp
from ergoqp.lab.group import best_for_group
from ergoqp.lab.population import variant

# The same task with a heavier drill; `hands=` and `stature=` are there too.
problem = variant(ergoqp.load_problem("overhead"), load_kg=3.0)

# Three people by stature [m]; `drawn_people(problem, 20, seed=0)` would draw twenty. `jobs=2` takes
# two processes.
place = best_for_group(problem, (1.60, 1.75, 1.90), "minimax", spacing=0.25, starts=2)
x, y, z = place.pose[:3, 3]
print(
    f"one place for all: x {x:.2f}, y {y:.2f}, z {z:.2f} m, highest score {place.maximum}, mean"
    f" {place.mean:.2f}"
)
for member in place.members:
    print(f"{member.label}: REBA {member.reba}, alone {member.own_reba}, pays {member.pays}")

# What a designer may make adjustable instead: what it would be worth if everybody could set one
# thing.
for axis, (highest, mean) in place.free.items():
    print(f"adjustable {axis}: highest {highest}, mean {mean:.2f}")
