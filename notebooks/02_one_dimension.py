# %% [markdown]
r"""# A system with one joint, and a controller learned by algorithm 1.

Figures 10 and 11 of the EPFL report. One joint $q \in [-6, 6]$ with the cost $V(q) = (q^4 - 30 q^2
+ 225) / 225$, which has two minima at $q = \pm\sqrt{15} \approx \pm 3.87$ and a hill between them.
The cost is known only by 200 noisy samples. A mixture of Gaussians is fitted to them, its
regression gives $dV/dq$, and algorithm 1 trains $\dot q = \theta \Phi(q)$ on it.
"""

# %%
import numpy as np
import studies
from matplotlib import pyplot as plt
from matplotlib.patches import Ellipse

from ergoqp.costs.gmr import Gmr
from ergoqp.datasets.data import DataSet
from ergoqp.lab.policy import RadialFeatures, solve, train

LOW, HIGH, BEST = -6.0, 6.0, np.sqrt(15)
GAUSSIANS, BUMPS = 8, 10


def true_cost(q):
    """Return the cost that the controller never sees."""
    return (q**4 - 30 * q**2 + 225) / 225


# %% [markdown]
"""## The cost, its samples, the mixture, the regression (figure 10)"""

# %%
rng = np.random.default_rng(1)
joint = rng.uniform(LOW, HIGH, 200)
noisy = true_cost(joint) + rng.normal(0, 0.1, 200)
cost = Gmr.fit(
    DataSet(joint[:, np.newaxis], noisy, ("q",)),
    components=GAUSSIANS,
    variant="joint",
    regularisation=1e-4,
)

q = np.linspace(LOW, HIGH, 400)[:, np.newaxis]
figure, panels = plt.subplots(2, 2, figsize=(8.6, 5.4), sharex=True, sharey=True)
for axes, title in zip(
    panels.flat,
    ("(a) cost", "(b) 200 noisy samples", "(c) 8 Gaussians", "(d) regression"),
    strict=True,
):
    axes.set(title=title, xlim=(LOW, HIGH), ylim=(-0.5, 2.2))
panels[0, 0].plot(q, true_cost(q), color="black")
for axes in panels.flat[1:]:
    axes.plot(joint, noisy, ".", color="#b8b8b8", markersize=4)
for mean, covariance in zip(cost.mixture.means, cost.mixture.covariances, strict=True):
    values, vectors = np.linalg.eigh(covariance)
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    for deviations in (1, 2):
        wide, high = 2 * deviations * np.sqrt(values[::-1])
        panels[1, 0].add_patch(
            Ellipse(mean, wide, high, angle=angle, color=studies.BLUE, alpha=0.25, linewidth=0)
        )
value, deviation = cost.predict(q), np.sqrt(cost.variance(q))
panels[1, 1].fill_between(
    q[:, 0], value - deviation, value + deviation, color=studies.ORANGE, alpha=0.2, linewidth=0
)
panels[1, 1].plot(q, true_cost(q), color="black", linewidth=1, label="cost")
panels[1, 1].plot(q, value, color=studies.ORANGE, label="regression, ± 1 deviation")
panels[1, 1].legend(loc="upper center")
for axes in panels[1]:
    axes.set_xlabel("q")
for axes in panels[:, 0]:
    axes.set_ylabel("V")
studies.save(figure, "fig10_one_dimension")
print(
    "RMS error of the regression on [-6, 6]:"
    f" {np.sqrt(np.mean((value - true_cost(q[:, 0])) ** 2)):.3f}, noise 0.1"
)

# %% [markdown]
r"""## Algorithm 1

Ten radial basis functions, evenly on $[-6, 6]$. Every step draws a random $q$, compares
$\theta\Phi(q)$ with the wanted velocity $-\epsilon\, dV/dq$ of the regression, and corrects
$\theta$. The report stops at the first step that changes $\theta$ by less than a threshold. Any $q$
whose velocity happens to be right already makes such a step, so that rule can end at once. Here the
means of $\theta$ over two runs of 2000 steps must agree.

The rule minimises the squared error, so the least-squares solution is where it must arrive.
"""

# %%
EPSILON, RATE = 1.0, 0.1
features = RadialFeatures.evenly(LOW, HIGH, BUMPS)


def wanted(points):
    """Return the wanted velocity: down the slope of the regression."""
    return -EPSILON * cost.regression.derivative(points)[:, 0]


def draw(generator, count):
    """Return random joint angles."""
    return generator.uniform(LOW, HIGH, (count, 1))


training = train(
    features, draw, wanted, rate=RATE, threshold=0.02, run=2000, most_runs=studies.size(30, 300)
)
closed = solve(features, q, wanted(q))
gap = np.abs(training.policy(q) - closed(q)).max()
print(f"algorithm 1: {training.steps} steps, converged: {training.converged}")
print(
    f"largest velocity of the least-squares policy {np.abs(closed(q)).max():.2f}, largest"
    f" difference to algorithm 1 {gap:.3f}"
)

# %% [markdown]
r"""How soon the report's rule would stop depends on the order in which the $q$ come.

Below is the step at which it would, by the condition of the rule:
$\|\theta_{t+1} - \theta_t\|_\infty$ first falls under 0.001, for 200 orders.
"""

# %%
orders, stops = studies.size(20, 200), []
for seed in range(orders):
    generator, theta = np.random.default_rng(seed), np.zeros(BUMPS)
    points = draw(generator, 3000)
    phi, velocity = features(points), wanted(points)[:, 0]
    change, steps = np.inf, 0
    while change > 1e-3:
        correction = -RATE * (theta @ phi[steps] - velocity[steps]) * phi[steps]
        theta, change, steps = theta + correction, np.abs(correction).max(), steps + 1
    stops.append((steps, np.abs(features(q) @ theta - closed(q)[:, 0]).max()))
steps, errors = np.array(stops).T
print(
    f"first step below 0.001: median after {np.median(steps):.0f} steps, earliest {steps.min():.0f}"
)
print(f"largest error of the velocity then: median {np.median(errors):.2f}")

# %% [markdown]
r"""## The learned controller from every start (figure 11)

$\dot q = \theta\Phi(q)$ is integrated for 60 s from starts all over $[-6, 6]$. A start must end in
a local minimum of the cost; the one on top of the hill, where the slope is nearly zero, takes its
time.
"""

# %%
starts = np.linspace(LOW, HIGH, studies.size(13, 25))
dt, path = 0.02, [starts]
for _ in range(3000):
    path.append(path[-1] + dt * training.policy(path[-1][:, np.newaxis])[:, 0])
path = np.array(path)
time = dt * np.arange(len(path))
valley = np.where(path[-1] > 0, BEST, -BEST)
distance = np.abs(path[-1] - valley)
reached = distance < 0.2

figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.6), width_ratios=(1, 1.25))
left.plot(q, wanted(q), color="black", linewidth=1, label="wanted, −dV/dq of the regression")
left.plot(q, closed(q), color=studies.ORANGE, label="least squares")
left.plot(q, training.policy(q), "--", color=studies.BLUE, label="algorithm 1")
left.set(
    xlabel="q",
    ylabel="velocity",
    title="The controller, 10 radial basis functions",
    ylim=(-2.2, 3.4),
)
left.legend(loc="upper right")
right.plot(time, path, color=studies.BLUE, linewidth=0.9, alpha=0.8)
for minimum in (-BEST, BEST):
    right.axhline(minimum, color=studies.RED, linestyle="--", linewidth=1.2)
right.text(59, BEST + 0.25, "minimum of the cost", color=studies.RED, ha="right")
right.set(
    xlabel="time [s]",
    ylabel="q",
    title="From every start",
    xlim=(0, 60),
    ylim=(LOW - 0.3, HIGH + 0.3),
)
studies.save(figure, "fig11_policy")
print(
    f"{reached.sum()} of {len(starts)} starts end within 0.2 of a minimum, the farthest"
    f" {distance.max():.2f} away"
)
print(f"cost at the end: {true_cost(path[-1]).max():.4f} at most; at the minima 0, on the hill 1")
assert reached.all()
