# %% [markdown]
r"""# Leading the forearm: added gradients, and constraints.

Figures 20 to 25 of the EPFL report. Only elbow and wrist of the right arm are looked at, six
numbers; the rest of the body is assumed to be at its best. A support vector machine is fitted to
the points of a clustered data set, and its gradient is followed. The report met arms that grow,
then arms behind the back, added the gradient of a one-class SVM against that, and found a ladder of
one-class SVMs best. Here the same is done, and then with the forearm's length and the boundary of
the data as rows of the control step instead of added gradients.

Ends are judged by truth: the lowest sheet score of any whole-body posture whose elbow and wrist are
there. The report judged by the label of the nearest sample. An end that no posture reaches counts
as failed.
"""

# %%
import numpy as np
import studies
from matplotlib import pyplot as plt

from ergoqp.human.forearm import forearm_length
from ergoqp.lab.forearm import forearm_data, nearest_sample_cost, true_cost
from ergoqp.lab.forearm_models import (
    added,
    descend,
    fit_forearm_models,
    slope_of,
    toward_class_below,
)
from ergoqp.limits import ArmLength, OneClassBoundary
from ergoqp.problem.load import load_problem
from ergoqp.simulation.points import run_points
from ergoqp.step.stepper import Stepper

models = fit_forearm_models(per_score=studies.size(150, 3000), rows=studies.size(200, 3000))
data = forearm_data(studies.size(150, 1000))
length, limit = forearm_length(), ArmLength(forearm_length())
scores, counts = np.unique(data.labels, return_counts=True)
print(
    f"{len(data)} points kept of {10 * studies.size(150, 1000)}; the EPFL report kept 2281 of"
    " 10 000"
)
print(
    "label: points  "
    + "  ".join(f"{score:.0f}: {count}" for score, count in zip(scores, counts, strict=True))
)

# %% [markdown]
"""The labels are the scores of whole postures, the lowest of each cluster.

The truth is lower: seen from elbow and wrist alone no score above 5 or so is forced on anyone,
because the rest of the body could be at its best.
"""

# %%
some = data.points[: studies.size(60, 1500)]
truth = true_cost(limit.project(some))
figure, axes = plt.subplots(figsize=(5.4, 3.2))
studies.boxes_by_score(
    axes,
    data.labels[: len(some)],
    truth,
    xlabel="label in the data set",
    ylabel="true forearm cost",
)
axes.set_title("What the label says and what elbow and wrist force")
studies.save(figure, "forearm_truth")

# %% [markdown]
"""## One start, four ways (figures 20, 21, 22, 24)

The plain gradient; with the length maintained; with the one-class gradient added; and the ladder.
The report's runs start at label 8, as here (7 for the ladder in the report).
"""

# %%
machine, margin = (
    slope_of(models.report_svr.value_and_gradient),
    slope_of(models.boundary.margin_and_slope),
)
rungs = [slope_of(rung.margin_and_slope) for rung in models.ladder.rungs]
ladder = toward_class_below(rungs, models.ladder.scores.tolist())
ways = {
    "plain gradient (fig. 20)": (machine, {"stop_at": None}),
    "length maintained (fig. 21)": (machine, {"stop_at": None, "length": length}),
    "one-class gradient added (fig. 22)": (added(machine, margin, 1.0), {"length": length}),
    "ladder (fig. 24)": (ladder, {"stop_at": None, "length": length}),
}
high = data.points[data.labels >= 8]
start = limit.project(high[models.boundary.margin(high) > 0][:1])
figure, axes = plt.subplots(2, 4, figsize=(11.2, 4.8), sharex=True, sharey="row")
for column, (name, (slope, options)) in enumerate(ways.items()):
    found = descend(slope, start, steps=studies.size(50, 250), **options)
    path = found.path[:, 0]
    axes[0, column].plot(found.values[:, 0], color=studies.ORANGE)
    axes[0, column].axhline(1, color=studies.GREY, linewidth=0.8)
    axes[0, column].set_title(name, fontsize=9.5)
    axes[1, column].plot(path - path[0], linewidth=1.1)
    axes[1, column].set_xlabel("step")
    end = np.linalg.norm(path[-1, 3:] - path[-1, :3])
    print(
        f"{name:<36} estimate {found.values[0, 0]:6.2f} -> {found.values[-1, 0]:6.2f}, length"
        f" {end:.3f} m ({length} m)"
    )
axes[0, 0].set_ylabel("estimated cost")
axes[1, 0].set_ylabel("motion of the coordinates, m")
studies.save(figure, "fig20_to_24_forearm_descents")

# %% [markdown]
"""## All starts, every way (figures 18 to 25, for the forearm)

Unseen points of every true cost, inside the boundary. The baselines stop where the estimate is 1.
The last three are closed loops of the control step: the machine of the report, the machine that has
also seen where nobody is, and the ladder as one smooth cost.
"""

# %%
unseen = limit.project(forearm_data(studies.size(60, 1500), seed=1).points)
unseen = unseen[models.boundary.margin(unseen) > 0]
unseen = unseen[np.random.default_rng(7).permutation(len(unseen))][: studies.size(60, 3000)]
costs = true_cost(unseen)
rows = np.concatenate(
    [np.flatnonzero(costs == cost)[: studies.size(2, 30)] for cost in range(1, costs.max() + 1)]
)
starts, costs = unseen[rows], costs[rows]


def led(cost):
    """Return ends and all states of closed loops of the problem `forearm` with a cost."""
    plain = load_problem("forearm")
    limits = [one for one in plain.limits if not isinstance(one, OneClassBoundary)]
    problem = plain.replace(
        cost=cost, limits=[*limits, OneClassBoundary(models.boundary, hard=True)]
    )
    stepper = Stepper(problem)
    runs = [
        run_points(problem, one, studies.size(3.0, 20.0), stepper=stepper).states for one in starts
    ]
    return np.array([states[-1] for states in runs]), np.concatenate(runs)


def followed(slope, **options):
    """Return ends and all points of the report's descents."""
    path = descend(slope, starts, steps=studies.size(50, 800), **options).path
    return path[-1], path.reshape(-1, 6)


found = {
    "SVR": followed(machine),
    "SVR, length": followed(machine, length=length),
    "SVR + one-class added": followed(added(machine, margin, 1.0), length=length),
    "ladder by gradients": followed(ladder, stop_at=None, length=length),
    "SVR of the report, constraints": led(models.report_svr),
    "SVR, constraints": led(models.svr),
    "ladder, constraints": led(models.ladder),
}
figure, axes = plt.subplots(2, 4, figsize=(11.2, 5.4), sharex=True, sharey=True)
table = []
for axis, (name, (ends, path)) in zip(axes.flat, found.items(), strict=False):
    error = np.abs(np.linalg.norm(path[:, 3:] - path[:, :3], axis=1) - length).max()
    reached = true_cost(limit.project(ends) if error < 1e-9 else ends)
    studies.boxes_by_score(
        axis, costs, reached, colour=studies.GREEN if "constraints" in name else studies.ORANGE
    )
    axis.set(title=name, xlabel="", ylabel="")
    axis.title.set_fontsize(9.5)
    worse = ((reached > costs) | (reached == 0)).mean()
    nearest = (nearest_sample_cost(ends, data) == 1).mean()
    table.append(
        (
            name,
            (reached == 1).mean(),
            worse,
            (reached == 0).mean(),
            nearest,
            error,
            models.boundary.margin(path).min(),
        )
    )
axes[1, 3].axis("off")
axes[1, 3].text(0.0, 0.5, "0: no posture reaches\nthe end", fontsize=10, va="center")
for axis in axes[1, :3]:
    axis.set_xlabel("true cost of the start")
for axis in axes[:, 0]:
    axis.set_ylabel("true cost at the end")
studies.save(figure, "fig25_forearm_minimisation")
table = [(*row[:5], f"{row[5]:.1e}", f"{row[6]:.4f}") for row in table]
studies.table(
    ("way", "at 1", "worse", "unreachable", "nearest at 1", "length error, m", "least margin"),
    table,
)

# %% [markdown]
"""What the report saw is here too.

Without the length the arm grows, with it the descent leaves the data, and an added gradient only
pulls against the cost's: where both cancel depends on a weight. As rows the length and the boundary
hold to the last digit at every step, whatever the cost does. What then decides is the cost. The
report's machine may be low at the edge of the data, where an arm cannot be; shown some points where
nobody is, it leads to cost 1. The ladder needs no such points.
"""
