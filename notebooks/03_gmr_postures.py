# %% [markdown]
r"""# The score of a posture by Gaussian mixture regression, and why its descent gets stuck.

Figures 13, 14 and 15 of the EPFL report: 10 000 random postures of 20 joints, 1000 of each REBA
score from 1 to 10, a mixture of Gaussians over posture and score, and the gradient of its
regression followed downhill. The report leaves a question open: why its descents end at scores of 3
to 4, wherever they start. The second half of this notebook answers it by measurement.
"""

# %%
import numpy as np
import studies
from descents import (
    balanced_rows,
    follow,
    joint_ranges,
    nearest_scores,
    slopes_of,
    to_the_bottom,
    true_scores,
)
from matplotlib import pyplot as plt

from ergoqp.coordinates import REPORT_JOINTS, Coordinates
from ergoqp.costs.gmr import Gmr, bic_curve
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import interval_labels, posture_data
from ergoqp.learning.mixtures import MixtureRegression

PER_SCORE = studies.size(80, 1000)
GAUSSIANS = studies.size(8, 24)
STEPS, RATE = studies.size(60, 2000), 0.01

data = posture_data(PER_SCORE, seed=0)
unseen = posture_data(PER_SCORE, seed=1)
ranges = joint_ranges(REPORT_JOINTS)
print(data.source)

# %% [markdown]
"""## How many Gaussians (figure 13)

The Bayesian information criterion of mixtures over posture and score with full covariances: on the
sheet's labels with the regularisation that `Gmr.fit` takes, and on labels by the simplified rules
behind the report's data with hardly any. A full covariance over 21 columns has 231 numbers, so
every Gaussian has to earn its price. Every point is one run of EM, which is what makes the curves
rough: now and then a Gaussian settles on a single score, has no width in that direction, and is
very likely.
"""

# %%
counts = np.arange(*studies.size((1, 5), (1, 51)))
fewer = np.arange(*studies.size((2, 5), (2, 51)), 2)
simplified = posture_data(PER_SCORE, labels="interval", seed=0)
curves = {
    "sheet, regularisation 0.001": (counts, bic_curve(data, counts), studies.BLUE),
    "simplified rules, regularisation 0.000001": (
        fewer,
        bic_curve(simplified, fewer, regularisation=1e-6),
        studies.GREEN,
    ),
}
figure, axes = plt.subplots(figsize=(6.6, 3.7))
for name, (numbers, curve, colour) in curves.items():
    lowest = curve.argmin()
    axes.plot(numbers, curve / 1000, color=colour, label=name)
    axes.plot(numbers[lowest], curve[lowest] / 1000, "o", color=colour)
    axes.annotate(
        f"{numbers[lowest]}",
        (numbers[lowest], curve[lowest] / 1000),
        (0, -13),
        textcoords="offset points",
        ha="center",
    )
    print(f"{name}: lowest BIC with {numbers[lowest]} Gaussians")
axes.axvline(24, color=studies.GREY, linewidth=1, linestyle=":", label="the EPFL report's 24")
axes.set(
    xlabel="number of Gaussians",
    ylabel="BIC / 1000",
    title="Bayesian information criterion, 10 000 postures",
)
axes.margins(y=0.12)
axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.55))
studies.save(figure, "fig13_bic")

# %% [markdown]
"""## Predicting the score of unseen postures (figure 14)

As in the report, four fifths of the data are for the fit and one fifth for the test. Beside the
report's mixture over posture and score (`joint`) stands what `Gmr.fit` does when nothing else is
asked for: a mixture for the postures of each score, weighed by Bayes' rule (`per_score`). The
second pair of columns is on labels by the simplified rules behind the report's data.
"""


# %%
def mean_error(cost, points, labels):
    """Return the mean absolute error of a cost [points]."""
    return float(np.abs(cost.predict(points) - labels).mean())


variants = {
    "joint": {"variant": "joint", "components": GAUSSIANS},
    "per_score": {"variant": "per_score", "components": studies.size(20, 60)},
}
rows, kept = [], {}
for name, options in variants.items():
    cells = [name]
    for labels in ("sheet", "interval"):
        train, test = posture_data(PER_SCORE, labels=labels, seed=0).split(0.8)
        cost = Gmr.fit(train, **options)
        cells += [mean_error(cost, part.points, part.labels) for part in (train, test)]
        kept[name, labels] = cost, train, test
    rows.append(cells)
studies.table(["mean error, points", "sheet: fitted", "unseen", "interval: fitted", "unseen"], rows)
print("the EPFL report: 1.19 on unseen data of its own; always the same score: 2.50")

figure, panels = plt.subplots(2, 2, figsize=(8.6, 6.2), sharex=True, sharey=True)
for row, name in enumerate(variants):
    cost, train, test = kept[name, "sheet"]
    for axes, part, which in zip(panels[row], (train, test), ("fitted", "unseen"), strict=True):
        colour = (studies.BLUE, studies.GREEN)[row]
        studies.boxes_by_score(
            axes,
            part.labels,
            cost.predict(part.points),
            colour=colour,
            line="perfect",
            xlabel="score of the sheet",
            ylabel="",
        )
        axes.set_title(
            f"{name}, {which} postures: mean error {mean_error(cost, part.points, part.labels):.2f}"
        )
for axes in panels[:, 0]:
    axes.set_ylabel("predicted")
for axes in panels[0]:
    axes.set_xlabel("")
studies.save(figure, "fig14_gmr_prediction")

# %% [markdown]
"""## Following the gradient (figure 15)

Every descent starts from an unseen posture and takes 2000 steps of 0.01 times the gradient. The
report judges an end by the score of the nearest posture of the data; the sheet itself can simply be
asked. Angles may leave the ranges of the joints, as in the report.
"""

# %%
starts = unseen.part(balanced_rows(unseen, studies.size(3, 30)))
joint = Gmr.fit(data, **variants["joint"])
per_score = Gmr.fit(data, **variants["per_score"])
paths = {}
for name, cost in (("joint", joint), ("per_score", per_score)):
    paths[name] = follow(slopes_of(cost, len(starts)), starts.points, RATE, STEPS)

figure, panels = plt.subplots(1, 3, figsize=(10.2, 3.7), sharey=True)
panels_of = [
    (
        "joint",
        "nearest posture of the data",
        nearest_scores(paths["joint"][-1], data),
        studies.BLUE,
    ),
    ("joint", "the sheet", true_scores(paths["joint"][-1], REPORT_JOINTS), studies.BLUE),
    ("per_score", "the sheet", true_scores(paths["per_score"][-1], REPORT_JOINTS), studies.GREEN),
]
rows = []
for axes, (name, judge, ends, colour) in zip(panels, panels_of, strict=True):
    studies.boxes_by_score(axes, starts.labels, ends, colour=colour)
    axes.set_title(f"{name}, judged by\n{judge}: mean {ends.mean():.2f}")
    by_start = [float(ends[starts.labels == score].mean()) for score in range(1, 11)]
    rows.append([f"{name}, {judge}", *(round(value, 1) for value in by_start), float(ends.mean())])
for axes in panels[1:]:
    axes.set_ylabel("")
panels[0].set_ylim(0.5, 10.5)
studies.save(figure, "fig15_gmr_minimisation")
studies.table(["mean score at the end, start with", *map(str, range(1, 11)), "all"], rows)
print(
    f"predicted by the joint mixture at its ends: {joint.predict(paths['joint'][-1]).mean():.1f} on"
    " average"
)

# %% [markdown]
"""The report's result is here again: the nearest posture of the data says 3.9 on average.

It says 2 to 5 for starts up to 9, and more than before for those that began at 1. The sheet says
worse, and the mixture itself believes in scores far below zero. The mixture per score goes down to
1.

## Why GMR gets stuck: one page

Two things go wrong, both because a few Gaussians cannot divide many joints. Each of them alone ends
at "3 to 4".

**Lines lead out of the data.** Inside one Gaussian the regression is a straight line, the first
term of equation 2.8. With 2 joints a Gaussian covers a fifth of a joint's spread; with 20 joints it
covers all of it (0.98, evidence 5). Along a whole joint the sheet is a valley: upright is best,
bending either way is worse. The line through a valley is level but for chance, so its slope says
little about the way down (cosine 0.31, evidence 3), and its best place is an end of the range, in
56 % of the cases (evidence 2). Nor does a line ever end. After a few steps the lines are the larger
part of the gradient and their length no longer changes; at the end all descents are outside the
data, 13 of 20 joints are at or beyond an end of their range, the regression predicts -23, the sheet
says 6.6. The posture of the data that is nearest to such a place is one of its rim, whatever the
start: 3.9 on average.

**One Gaussian has all the say.** In 20 dimensions the log densities of two Gaussians differ by a
lot almost everywhere, so the responsibilities are 0 or 1: at the start 1.5 Gaussians have a say, at
the end one, and a descent changes its leader less than once in 2000 steps (evidence 1). Only the
second term of equation 2.8 compares Gaussians, and it is zero where nobody hesitates. With the
lines taken away from the very same mixture the descents stay inside the data and stall: at 3.5 by
the mixture's own account, 3.5 by the nearest posture, 4.4 by the sheet (evidence 4). Letting the
same Gaussians hesitate, with responsibilities at temperatures 1 and 8, brings that to 1.6.

Either way it is 3 to 4. Which of the two the report met cannot be told from its text: it does not
say how these ends were judged, nor how strongly the covariances were regularised.

**Full covariances add noise.** 210 numbers for 20 joints, from a few hundred postures each, tilt
the way down between joints that have nothing to do with each other. Diagonal ones take the share of
descents that can reach score 1 from 75 to 100 %, and lower the error of unseen postures besides.

It is not the step size, nor patience, the start of EM, regularisation, noise of the labels, the
report's labels, or the way out of the joints' ranges alone (evidence 4 and 6). Classes that are not
balanced make it worse. Nor is it the accuracy of the prediction: 0.97 points with diagonal
covariances ends at 2.3, 1.04 with full ones at 6.6.

**What helps, and is what `Gmr.fit` does:** Gaussians of one score each, which have no lines;
responsibilities at two temperatures, which see past the next Gaussian; diagonal covariances. Mean
error on unseen postures 0.83 instead of 1.04, and from 100 starts of all scores 100 % reach score
1, where the report's mixture reached it from none. `Gmr.fit(data, variant="joint")` is the
report's.
"""

# %% [markdown]
"""## Evidence 1: what happens along a descent

The same descents, step by step. *Gaussians with a say*: one over the sum of squared
responsibilities. *Lines* and *switching*: the lengths of the two terms of equation 2.8. *Outside
the data*: the density of the inputs is below that of 99 % of the data.
"""

# %%
moments = np.unique(np.r_[0, np.geomspace(1, STEPS, 40).astype(int)])
figure, panels = plt.subplots(1, 4, figsize=(12.0, 3.3))
say, terms, outside, believed = panels
rows = []
for name, cost, colour in (("joint", joint, studies.BLUE), ("per_score", per_score, studies.GREEN)):
    path, regression = paths[name][moments], cost.regression
    shares = [regression.responsibilities(points) for points in path]
    counted = np.array([np.median(1 / np.square(share).sum(axis=1)) for share in shares])
    lengths = np.array(
        [
            [np.median(np.linalg.norm(term[:, 0], axis=1)) for term in regression.terms(points)]
            for points in path
        ]
    )
    rare = np.quantile(regression.log_density(data.points), 0.01)
    lost = np.array([(regression.log_density(points) < rare).mean() for points in path])
    leaders = regression.log_densities(paths[name][:: max(1, STEPS // 400)].reshape(-1, 20)).argmax(
        axis=1
    )
    leaders = leaders.reshape(-1, len(starts))
    say.plot(moments, counted, color=colour, label=name)
    terms.plot(moments, lengths[:, 1], color=colour, label=f"{name}, switching")
    if name == "joint":
        terms.plot(moments, lengths[:, 0], "--", color=colour, label=f"{name}, lines")
    outside.plot(moments, lost, color=colour, label=name)
    believed.plot(
        moments,
        [true_scores(points, REPORT_JOINTS).mean() for points in path],
        color=colour,
        label=f"{name}, sheet",
    )
    believed.plot(
        moments,
        [cost.predict(points).mean() for points in path],
        "--",
        color=colour,
        label=f"{name}, predicted",
    )
    changes = (np.diff(leaders, axis=0) != 0).sum(axis=0)
    rows.append(
        [name, *counted[[0, -1]], float(changes.mean()), *lengths[0], *lengths[-1], float(lost[-1])]
    )
for axes, title in zip(
    panels,
    ("Gaussians with a say", "gradient [points/rad]", "outside the data", "score"),
    strict=True,
):
    axes.set(title=title, xlabel="step")
    axes.set_xscale("symlog", linthresh=10)
    axes.legend(fontsize=8)
terms.set_yscale("log")
believed.set_ylim(-6, 8)
studies.save(figure, "why_gmr_along_descents")
header = [
    "medians; outside and changes: means",
    "say, start",
    "end",
    "changes of leader",
    "lines, start",
    "switching",
]
studies.table([*header, "lines, end", "switching", "outside"], rows)

# %% [markdown]
"""## Evidence 2: a Gaussian spans whole joints, so its line is the wrong model

One joint alone is moved through its range, the others stay as they are in an unseen posture. The
sheet wants most joints in the middle: a neck upright, an elbow at 60 to 100 degrees. A line has no
middle; its best is an end of the range. Counted over 200 postures and 20 joints: how often the
lowest value along the joint is at an end of its range, and how often the sheet has a lower score to
offer along that joint than at the place that the mixture likes best.

The spread of a joint within a Gaussian, as a share of its spread in all data, is 1 where the
Gaussian does not divide that joint at all. 24 Gaussians can divide four or five of 20 joints once.
"""

# %%
sample = unseen.points[: studies.size(10, 200)]
steps_along = 31
judges = {
    "sheet": lambda points: true_scores(points, REPORT_JOINTS).astype(float),
    "joint": joint.predict,
    "per_score": per_score.predict,
}
along = {name: np.empty((20, len(sample), steps_along)) for name in judges}
for column in range(20):
    moved = np.repeat(sample[:, np.newaxis], steps_along, axis=1)
    moved[:, :, column] = np.linspace(ranges[0][column], ranges[1][column], steps_along)
    for name, judge in judges.items():
        along[name][column] = judge(moved.reshape(-1, 20)).reshape(len(sample), steps_along)
rows, lowest_score = [], along["sheet"].min(axis=2)
varies = along["sheet"].max(axis=2) > lowest_score
for name in ("joint", "per_score"):
    best = along[name].argmin(axis=2)
    reached = np.take_along_axis(along["sheet"], best[:, :, np.newaxis], axis=2)[:, :, 0]
    at_end = (best == 0) | (best == steps_along - 1)
    rows.append([name, float(at_end.mean()), float((reached > lowest_score)[varies].mean())])
studies.table(
    [
        "share of postures and joints",
        "best at an end of the range",
        "the sheet has better to offer",
    ],
    rows,
)
spreads = np.sqrt(np.diagonal(joint.mixture.covariances, axis1=1, axis2=2))
within = spreads[:, :-1] / data.points.std(axis=0)
print(
    f"spread of a joint in a Gaussian / in the data: median {np.median(within):.2f}, below 0.5 in"
    f" {(within < 0.5).mean():.0%}"
)
print(f"spread of the score in a Gaussian: median {np.median(spreads[:, -1]):.2f} points")

shown = REPORT_JOINTS.index("neck_side_bend")
angles = np.degrees(np.linspace(ranges[0][shown], ranges[1][shown], steps_along))
figure, panels = plt.subplots(1, 3, figsize=(10.2, 3.3), sharey=True)
for axes, (name, colour) in zip(
    panels, (("sheet", "black"), ("joint", studies.BLUE), ("per_score", studies.GREEN)), strict=True
):
    curves = along[name][shown, :40]
    axes.plot(
        angles,
        (curves - curves.mean(axis=1, keepdims=True)).T,
        color=colour,
        linewidth=0.8,
        alpha=0.45,
    )
    axes.set(title=name, xlabel="neck side bend [deg]", ylim=(-2.2, 2.2))
panels[0].set_ylabel("score less its mean along the line")
studies.save(figure, "why_gmr_one_joint")

# %% [markdown]
"""## Evidence 3: the gradient against the true way down

Cosine of the angle between the gradient and that of the smooth score at 12 degrees (`SmoothReba`,
the sheet's mean under noise, no learning involved), median over starts above 1. In 20 dimensions
two random directions have a cosine of 0 +- 0.22.
"""

# %%
smooth = SmoothReba((12.0,), (1.0,)).value_and_gradient
above = starts.part(starts.labels > 1)
coordinates = Coordinates(REPORT_JOINTS)
way = np.array(
    [
        np.asarray(smooth(posture)[1]).ravel()[coordinates.indices]
        for posture in coordinates.spread(above.points)
    ]
)


def cosine(directions):
    """Return the median cosine with the smooth score's gradient."""
    return float(
        np.median(
            np.einsum("ij,ij->i", directions, way)
            / np.linalg.norm(directions, axis=1)
            / np.linalg.norm(way, axis=1)
        )
    )


def at_temperatures(cost, temperatures, shares):
    """Return the same mixture at other temperatures."""
    return Gmr(cost.mixture, REPORT_JOINTS, 1.0, temperatures=temperatures, shares=shares)


lines, switching = (term[:, 0] for term in joint.regression.terms(above.points))
rows = [
    ["joint: lines alone", cosine(lines)],
    ["joint: switching alone", cosine(switching)],
    ["joint", cosine(lines + switching)],
]
for title, temperatures, shares in (
    ("1", (1,), (1,)),
    ("1 and 8", (1, 8), (0.7, 0.3)),
    ("8", (8,), (1,)),
):
    gradient = at_temperatures(per_score, temperatures, shares).regression.derivative(above.points)[
        :, 0
    ]
    rows.append([f"per_score, temperature {title}", cosine(gradient)])
studies.table(["gradient", "cosine"], rows)

# %% [markdown]
"""## Evidence 4: taking the causes away, one by one

The same starts for all, the sheet as the judge. *Without lines* is the very same mixture with the
covariances between posture and score set to zero, so that only the switching remains. *To the
bottom* replaces 2000 small steps by L-BFGS-B within the ranges of the joints: no step size, no
patience, no way out of the data.
"""


# %%
def without_lines(cost):
    """Return the same Gaussians without the covariances between posture and score."""
    covariances = cost.mixture.covariances.copy()
    covariances[:, -1, :-1] = covariances[:, :-1, -1] = 0
    return Gmr(
        MixtureRegression(cost.mixture.weights, cost.mixture.means, covariances), REPORT_JOINTS, 1.0
    )


few = starts.part(balanced_rows(starts, studies.size(1, 10)))
warm = {"temperatures": (1.0, 8.0), "shares": (0.7, 0.3)}
cold = {"temperatures": (1.0,), "shares": (1.0,)}
ladder = {
    "joint, full covariances (the report)": (joint, None),
    "the same, kept within the joints' ranges": (joint, ranges),
    "without lines": (without_lines(joint), None),
    "without lines, temperatures 1 and 8": (
        at_temperatures(without_lines(joint), (1, 8), (0.7, 0.3)),
        None,
    ),
    "joint, diagonal covariances (no lines)": (
        Gmr.fit(data, **variants["joint"], covariance="diag"),
        None,
    ),
    "per score, full covariances": (
        Gmr.fit(data, studies.size(10, 20), covariance="full", **cold),
        None,
    ),
    "per score, full covariances, temperatures 1 and 8": (
        Gmr.fit(data, studies.size(10, 20), covariance="full", **warm),
        None,
    ),
    "per score, diagonal": (Gmr.fit(data, variants["per_score"]["components"], **cold), None),
    "per score, diagonal, temperatures 1 and 8 (ours)": (per_score, None),
}
rows, bars = [], []
for name, (cost, box) in ladder.items():
    followed = follow(slopes_of(cost, len(few)), few.points, RATE, STEPS, box=box)[-1]
    bottom = to_the_bottom(cost, few.points, ranges)
    scores = [true_scores(points, REPORT_JOINTS) for points in (followed, bottom)]
    beyond = ((followed <= ranges[0]) | (followed >= ranges[1])).sum(axis=1).mean()
    bars.append([ends.mean() for ends in scores])
    cells = [
        mean_error(cost, unseen.points, unseen.labels),
        float(beyond),
        float(cost.predict(followed).mean()),
    ]
    cells += [
        nearest_scores(followed, data).mean(),
        scores[0].mean(),
        scores[1].mean(),
        float((scores[1] == 1).mean()),
    ]
    rows.append([name, *cells])
header = [
    "",
    "mean error",
    "joints at or beyond an end",
    "predicted",
    "nearest",
    "sheet",
    "sheet, to the bottom",
    "share at 1",
]
studies.table(header, rows)

figure, axes = plt.subplots(figsize=(8.6, 4.0))
places = np.arange(len(ladder))[::-1]
for offset, colour, column, label in (
    (0.18, studies.BLUE, 0, "following the gradient"),
    (-0.18, studies.ORANGE, 1, "to the bottom, in the ranges"),
):
    values = [bar[column] for bar in bars]
    axes.barh(places + offset, np.array(values) - 1, left=1, height=0.34, color=colour, label=label)
    for place, value in zip(places, values, strict=True):
        axes.text(value + 0.06, place + offset, f"{value:.2f}", va="center", fontsize=8)
axes.axvline(few.labels.mean(), color="black", linewidth=1, linestyle=":", label="at the start")
axes.set(
    yticks=places,
    yticklabels=list(ladder),
    xlim=(1, 9),
    xlabel="mean score of the sheet at the end",
)
axes.grid(axis="y", visible=False)
axes.legend(loc="center right", frameon=True, facecolor="white", edgecolor="none", framealpha=1)
studies.save(figure, "why_gmr_ladder")

# %% [markdown]
"""## Evidence 5: the number of dimensions

2, 5, 10 and 20 joints, the others at zero, the same number of postures and the same fit. Scores
reach as far as these joints allow, so the measure is the excess over the lowest score that is left,
as a share of that at the start.

With 10 joints or fewer EM settles the Gaussians on single scores by itself (a spread of 0.03
points), so there are no lines and only the second cause is left. With 2 joints it is the steps of
the sheet that stop both mixtures: 24 or 60 Gaussians follow them closely enough to be as flat as
they are.
"""

# %%
some = (
    "trunk_flexion",
    "right_shoulder_flexion",
    "neck_flexion",
    "right_elbow_flexion",
    "right_wrist_flexion",
)
more = (
    "trunk_twist",
    "right_shoulder_abduction",
    "right_knee_flexion",
    "neck_twist",
    "left_shoulder_flexion",
)
rows = []
for joints in (some[:2], some, some + more, REPORT_JOINTS):
    box = joint_ranges(joints)
    uniform = np.random.default_rng(0).uniform(*box, (studies.size(5000, 100_000), len(joints)))
    scores = (
        range(1, 11)
        if joints == REPORT_JOINTS
        else np.unique(true_scores(uniform, joints)).tolist()
    )
    drawn = posture_data(10 * PER_SCORE // len(scores), joints=joints, scores=scores, seed=0)
    fresh = posture_data(studies.size(3, 100 // len(scores)), joints=joints, scores=scores, seed=1)
    fitted = Gmr.fit(drawn, **variants["joint"])
    spreads = np.sqrt(np.diagonal(fitted.mixture.covariances, axis1=1, axis2=2))
    cells = [
        len(joints),
        float(np.median(spreads[:, :-1] / drawn.points.std(axis=0))),
        float(np.median(spreads[:, -1])),
    ]
    for cost in (fitted, Gmr.fit(drawn, variants["per_score"]["components"])):
        ends = follow(slopes_of(cost, len(fresh)), fresh.points, RATE, STEPS)[-1]
        cells.append(
            float(
                (true_scores(ends, joints) - scores[0]).mean() / (fresh.labels - scores[0]).mean()
            )
        )
    rows.append(cells)
header = [
    "joints",
    "spread in a Gaussian / in the data",
    "spread of the score",
    "excess left, joint",
    "excess left, per_score",
]
studies.table(header, rows)

# %% [markdown]
"""## Evidence 6: what is not the cause

Smaller steps, more patience, other starts of EM, more or less regularisation, noisy labels, the
report's own labels, and data as they fall instead of equally many of each score. All descents
without lines or with them are of the joint mixture.
"""

# %%
rng = np.random.default_rng(0)


def follow_and_judge(cost, rate=RATE, steps=STEPS, judge=true_scores, at=few):
    """Return the mean score at the end of descents within the joints' ranges."""
    box = (data.points.min(axis=0), data.points.max(axis=0))
    path = follow(slopes_of(cost, len(at)), at.points, rate, steps, box=box, every=steps)
    return float(judge(path[-1], REPORT_JOINTS).mean())


def interval_scores(points, joints):
    """Return the scores by the simplified rules."""
    return interval_labels(np.clip(points, -np.pi, np.pi), joints)


natural = rng.uniform(*ranges, (10 * PER_SCORE, 20))
own = posture_data(PER_SCORE, labels="interval", seed=1)
noisy = DataSet(data.points, data.labels + rng.normal(size=len(data)), REPORT_JOINTS)
uneven = DataSet(natural, true_scores(natural, REPORT_JOINTS).astype(float), REPORT_JOINTS)
rows = [
    ["as above, in the ranges", follow_and_judge(joint)],
    ["a tenth of the step, twice the way", follow_and_judge(joint, RATE / 10, 20 * STEPS)],
    ["another start of EM", follow_and_judge(Gmr.fit(data, seed=1, **variants["joint"]))],
    [
        "regularisation 1e-6",
        follow_and_judge(Gmr.fit(data, regularisation=1e-6, **variants["joint"])),
    ],
    [
        "regularisation 1e-2",
        follow_and_judge(Gmr.fit(data, regularisation=1e-2, **variants["joint"])),
    ],
    ["labels with noise of one point", follow_and_judge(Gmr.fit(noisy, **variants["joint"]))],
    ["data as they fall, not balanced", follow_and_judge(Gmr.fit(uneven, **variants["joint"]))],
]
at = own.part(balanced_rows(own, studies.size(1, 10)))
for name, options in variants.items():
    cost = Gmr.fit(simplified, **options)
    rows.append(
        [
            f"the report's labels, judged by them: {name}",
            follow_and_judge(cost, judge=interval_scores, at=at),
        ]
    )
studies.table(["descents", "mean score at the end"], rows)
print(
    "share of scores in the data as they fall:",
    np.round(np.bincount(uneven.labels.astype(int), minlength=12)[1:] / len(uneven), 3),
)
