"""Learn a cost from labelled postures, keep it, and let it lead the object.

It leads within the region of its data.

Needs the extra ``learn``: ``pip install 'ergoqp[learn]'``.
"""

import tempfile
from pathlib import Path

import ergoqp
from ergoqp.coordinates import SCORED_JOINTS
from ergoqp.costs.load import quality_of
from ergoqp.costs.svr import Svr
from ergoqp.datasets.postures import posture_data
from ergoqp.learning.one_class import OneClass
from ergoqp.limits import OneClassBoundary

# Random postures, as many of each score from 1 to 10; your own labelled postures make a `DataSet`
# too.
data = posture_data(per_score=60, seed=0, joints=SCORED_JOINTS)
seen, unseen = data.split(0.8)
cost = Svr.fit(seen)
found = quality_of(cost.predict(unseen.points), unseen.labels)
print(f"{data.source}: {len(seen)} to learn from, {len(unseen)} to judge by")
print(f"mean error {found.mae:.2f} points, {100 * found.within1:.0f} % within one point")

# The cost knows nothing about postures unlike its data, so it is not asked about them: their
# boundary is a limit.
boundary = OneClassBoundary(
    OneClass.fit(seen.points, seen.coordinates, nu=0.02), tolerance=0.05, recovery_time=1.0
)
plain = ergoqp.load_problem("screwing")
problem = plain.replace(cost=cost, limits=[*plain.limits, boundary])

with tempfile.TemporaryDirectory() as folder:
    path = (
        Path(folder) / "my_cost.npz"
    )  # no pickle inside; a problem file names it under [cost.learned]
    cost.save(path, {"unseen": found.as_dict()})
    problem = problem.replace(cost=ergoqp.load_cost(path))

step = ergoqp.Stepper(problem).step(problem.response.comfort)
print(
    f"cost {step.cost:.2f}, boundary margin {step.margins['boundary']:.2f}, {step.status}: twist"
    f" {step.twist.round(4)}"
)
