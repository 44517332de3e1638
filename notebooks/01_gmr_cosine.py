# %% [markdown]
r"""# Gaussian mixture regression and its derivative on a noisy cosine.

Figures 3 and 4 of the EPFL report. A mixture of Gaussians is fitted to points $(x, y)$ by EM. Given
$x$, every Gaussian $k$ predicts a straight line, $\hat\mu_k(x) = \mu_k^y + \Sigma_k^{yx}
(\Sigma_k^{x})^{-1} (x - \mu_k^x)$, and the Gaussians share the answer by their responsibilities
$h_k(x)$:

$$\hat y = \sum_k h_k \hat\mu_k, \qquad \frac{d\hat y}{dx} = \underbrace{\sum_k h_k\, \Sigma_k^{yx}
(\Sigma_k^{x})^{-1}}_{\text{local lines}} + \underbrace{\sum_k \hat\mu_k
\frac{dh_k}{dx}}_{\text{switching}}$$

The covariance of one Gaussian's answer is $\Sigma_k^{y} - \Sigma_k^{yx} (\Sigma_k^{x})^{-1}
\Sigma_k^{xy}$; the report prints $\Sigma^{xy}$ in the place of $\Sigma^{y}$, a slip.
"""

# %%
import numpy as np
import studies
from matplotlib import pyplot as plt
from matplotlib.patches import Ellipse

from ergoqp.costs.gmr import Gmr
from ergoqp.datasets.data import DataSet


def draw_gaussians(axes, cost, colours):
    """Draw the Gaussians at one and two standard deviations, and their lines."""
    mixture, regression = cost.mixture, cost.regression
    for k, colour in enumerate(colours):
        values, vectors = np.linalg.eigh(mixture.covariances[k])
        angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
        for deviations in (1, 2):
            wide, high = 2 * deviations * np.sqrt(values[::-1])
            axes.add_patch(
                Ellipse(
                    mixture.means[k], wide, high, angle=angle, color=colour, alpha=0.22, linewidth=0
                )
            )
        x = mixture.means[k, 0] + np.array([-1, 1]) * 2.2 * np.sqrt(mixture.covariances[k, 0, 0])
        axes.plot(x, regression.means(x[:, np.newaxis])[:, k, 0], "--", color=colour, linewidth=1.3)


# %% [markdown]
"""## Two Gaussians, one answer (figure 3)

Left: two Gaussians over $(x, y)$ with their lines, and the regression between them. Right: what is
known about $y$ at one $x$. Both Gaussians keep a say (equation 2.4); the report takes mean and
covariance of the two as one Gaussian (2.5 and 2.6).
"""

# %%
rng = np.random.default_rng(3)
left = rng.multivariate_normal([-1.2, 0.2], [[0.5, 0.28], [0.28, 0.3]], 300)
right = rng.multivariate_normal([1.3, 1.6], [[0.6, -0.35], [-0.35, 0.4]], 300)
points = np.concatenate([left, right])
pair = Gmr.fit(
    DataSet(points[:, :1], points[:, 1], ("x",)), components=2, variant="joint", regularisation=1e-6
)
x = np.linspace(-3, 3.4, 400)[:, np.newaxis]
mean, deviation = pair.predict(x), np.sqrt(pair.variance(x))
colours = (studies.BLUE, studies.ORANGE)

figure, (plane, slice_) = plt.subplots(1, 2, figsize=(8.6, 3.5), width_ratios=(2, 1), sharey=True)
plane.plot(*points.T, ".", color="#b8b8b8", markersize=3)
draw_gaussians(plane, pair, colours)
plane.plot(x, mean, color=studies.GREEN, label="regression, ± 1 deviation")
plane.fill_between(
    x[:, 0], mean - deviation, mean + deviation, color=studies.GREEN, alpha=0.15, linewidth=0
)
at = np.array([[0.15]])
plane.axvline(at[0, 0], color="black", linewidth=0.9, linestyle=":")
plane.set(
    xlabel="x, given", ylabel="y, predicted", title="Two Gaussians over (x, y)", xlim=(-3, 3.4)
)
plane.legend(loc="upper left")


def bell(y, centre, variance):
    """Return the density of a Gaussian."""
    return np.exp(-0.5 * (y - centre) ** 2 / variance) / np.sqrt(2 * np.pi * variance)


y = np.linspace(-1.6, 3.4, 400)
share, centre = pair.regression.responsibilities(at)[0], pair.regression.means(at)[0, :, 0]
for k, colour in enumerate(colours):
    slice_.plot(
        share[k] * bell(y, centre[k], pair.regression.covariances[k, 0, 0]), y, color=colour
    )
slice_.plot(
    bell(y, pair.predict(at)[0], pair.variance(at)[0]), y, color=studies.GREEN, label="both as one"
)
slice_.set(xlabel="density", title=f"y given x = {at[0, 0]}")
slice_.legend(loc="upper right")
studies.save(figure, "fig03_gmr")

# %% [markdown]
"""## A noisy cosine and its derivative (figure 4)

The mixture sees the noisy points only; the derivative is equation 2.8, not a difference of
predictions.
"""

# %%
count = studies.size(200, 800)
angle = np.sort(rng.uniform(0, 4 * np.pi, count))
noisy = np.cos(angle) + rng.normal(0, 0.15, count)
wave = Gmr.fit(
    DataSet(angle[:, np.newaxis], noisy, ("angle",)),
    components=12,
    variant="joint",
    regularisation=1e-4,
)

x = np.linspace(0, 4 * np.pi, 600)[:, np.newaxis]
value, slope = wave.predict(x), wave.regression.derivative(x)[:, 0, 0]
deviation = np.sqrt(wave.variance(x))

figure, (top, bottom) = plt.subplots(2, 1, figsize=(8.0, 5.0), sharex=True)
top.plot(angle, noisy, ".", color="#b8b8b8", markersize=3, label=f"{count} noisy points")
top.plot(x, np.cos(x), color="black", linewidth=1.0, label="cos x")
top.plot(x, value, color=studies.ORANGE, label="regression, ± 1 deviation")
top.fill_between(
    x[:, 0], value - deviation, value + deviation, color=studies.ORANGE, alpha=0.18, linewidth=0
)
bottom.plot(x, -np.sin(x), color="black", linewidth=1.0, label="−sin x")
bottom.plot(x, slope, color=studies.GREEN, label="derivative of the regression, eq. 2.8")
top.set(ylabel="value", ylim=(-1.7, 2.1), title="12 Gaussians on a noisy cosine")
bottom.set(ylabel="derivative", xlabel="x [rad]", ylim=(-1.7, 2.1))
for axes in (top, bottom):
    axes.legend(loc="upper center", ncols=3)
studies.save(figure, "fig04_gmr_cosine")

inner = (x[:, 0] > 0.5) & (x[:, 0] < 4 * np.pi - 0.5)
print(f"RMS error of the value       {np.sqrt(np.mean((value - np.cos(x[:, 0]))[inner] ** 2)):.3f}")
print(f"RMS error of the derivative  {np.sqrt(np.mean((slope + np.sin(x[:, 0]))[inner] ** 2)):.3f}")
print("noise of the points          0.150")

# %% [markdown]
"""The regression is about four times closer to the cosine than a single point.

Its derivative carries the mark of the mixture: between two Gaussians it overshoots, inside one it
is nearly constant. In one dimension that is harmless. In twenty it is not; see `03_gmr_postures`.
"""
