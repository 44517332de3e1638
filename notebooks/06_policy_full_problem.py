# %% [markdown]
r"""# A learned controller for the full problem: how far from the QP?

The EPFL report's controller is $\dot x = \theta\Phi(q)$, trained by algorithm 1 on the velocity
that the gradient of the cost asks for. Here it is taught by the control step itself: in the problem
`screwing`, the twist that the QP commands at a posture, with all its limits. The question is how
much of that a linear map of features can learn. Measured is the angle between both twists, each
axis in units of its largest speed, at postures of people whom the training has never seen.
"""

# %%
import numpy as np
import studies
from matplotlib import pyplot as plt

from ergoqp import load_problem
from ergoqp.lab.policy import RadialFeatures, angles_deg, solve, train, twists_of, unit_twists
from ergoqp.rest.best_place import workspace_map
from ergoqp.rest.model_person import sample_person

problem = load_problem("screwing")
SPACING = studies.size(0.5, 0.2)
TAUGHT, ASKED = studies.size((2, 40), (10, 600)), studies.size((1, 30), (4, 250))
print(f"{problem.name}: {problem.title}")

# %% [markdown]
"""## Postures and the QP's answers

Simulated people of random stature and joint weights rest at random places of the object's
workspace; to every angle is added noise of 3 degrees. Each posture is held for 30 periods from
standstill: in the first period every axis is limited by its acceleration, so that the direction is
not yet what the QP wants.
"""


# %%
def postures_of(people, each, seed):
    """Return postures (n, 32) of people at work [rad]."""
    rng, drawn = np.random.default_rng(seed), []
    for person in people:
        places = workspace_map(
            problem, sample_person(problem, person), spacing=SPACING, cache=False
        )
        resting = places.postures[places.scores > 0]
        drawn.append(
            resting[rng.choice(len(resting), each)] + np.radians(3) * rng.normal(size=(each, 32))
        )
    return np.concatenate(drawn)


taught = postures_of(range(TAUGHT[0]), TAUGHT[1], seed=0)
asked = postures_of(range(100, 100 + ASKED[0]), ASKED[1], seed=1)
wanted, answers = (
    unit_twists(problem, twists_of(problem, postures)) for postures in (taught, asked)
)
moving = np.linalg.norm(wanted, axis=1) > 0
taught, wanted = taught[moving], wanted[moving]
first = unit_twists(problem, twists_of(problem, asked, periods=1))
shaken = asked + np.radians(1) * np.random.default_rng(2).normal(size=asked.shape)
beside = unit_twists(problem, twists_of(problem, shaken))
print(
    f"{len(taught)} postures of {TAUGHT[0]} people to learn from, {len(asked)} of {ASKED[0]} others"
    " to ask"
)
print(
    f"the QP stands still at {(np.linalg.norm(answers, axis=1) == 0).mean():.1%} of the asked"
    " postures"
)

# %% [markdown]
"""## Features, least squares, algorithm 1

Gaussian bumps around postures of the sample, half as wide as the median distance of two postures,
and a constant.
"""

# %%
BUMPS = studies.size(30, 500)
narrow = RadialFeatures.among(taught, BUMPS, seed=0)
features = RadialFeatures(narrow.centres, narrow.width / 2, constant=True)
closed = solve(features, taught, wanted, ridge=1e-5)

answer_to = {posture.tobytes(): twist for posture, twist in zip(taught, wanted, strict=True)}
largest = np.square(features(taught)).sum(axis=1).max()


def draw(rng, count):
    """Return random postures of the sample."""
    return taught[rng.integers(len(taught), size=count)]


def asked_for(postures):
    """Return the QP's twists at postures of the sample."""
    return np.array([answer_to[posture.tobytes()] for posture in postures])


training = train(
    features,
    draw,
    asked_for,
    rate=0.5 / largest,
    threshold=0.01,
    run=len(taught),
    most_runs=studies.size(20, 80),
)
print(
    f"algorithm 1: {training.steps} steps, converged: {training.converged}, last change"
    f" {training.changes[-1]:.4f}"
)

# %% [markdown]
"""## The angle between the learned twist and the QP's
"""

# %%
answered = np.linalg.norm(answers, axis=1) > 0
policies = {
    "least squares": closed(asked),
    "algorithm 1": training.policy(asked),
    "the best constant twist": np.tile(wanted.mean(axis=0), (len(asked), 1)),
    "the QP's own first period": first,
    "the QP, every angle 1 deg off": beside,
}
rows, angles = [], {}
for name, twists in policies.items():
    angles[name] = angles_deg(twists, answers)[answered]
    rows.append(
        [
            name,
            float(np.median(angles[name])),
            float(np.quantile(angles[name], 0.9)),
            float((angles[name] > 90).mean()),
        ]
    )
seen = angles_deg(closed(taught), wanted)
rows.append(
    [
        "least squares, on what it was taught",
        float(np.median(seen)),
        float(np.quantile(seen, 0.9)),
        float((seen > 90).mean()),
    ]
)
studies.table(["angle to the QP's twist [deg]", "median", "90 %", "share above 90 deg"], rows)
worst = angles["least squares"] >= np.quantile(angles["least squares"], 0.9)
turns = angles["the QP, every angle 1 deg off"]
medians = np.median(turns[worst]), np.median(turns[~worst])
print(
    f"1 deg off turns the QP by {medians[0]:.0f} deg where least squares is worst, by"
    f" {medians[1]:.0f} elsewhere (medians)"
)

sizes = studies.size([20, 60], [300, 600, 1200, 2400, len(taught)])
curve = []
order = np.random.default_rng(0).permutation(len(taught))
for count in sizes:
    some = order[:count]
    few = RadialFeatures.among(taught[some], min(BUMPS, count), seed=0)
    policy = solve(
        RadialFeatures(few.centres, few.width / 2, constant=True),
        taught[some],
        wanted[some],
        ridge=1e-5,
    )
    found = angles_deg(policy(asked), answers)[answered]
    curve.append([np.median(found), np.quantile(found, 0.9)])
curve = np.array(curve)

figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.7))
for (name, values), colour in zip(
    angles.items(),
    (studies.ORANGE, studies.BLUE, studies.GREY, studies.GREEN, studies.SKY),
    strict=True,
):
    left.plot(np.sort(values), np.linspace(0, 1, len(values)), color=colour, label=name)
left.set(
    xlabel="angle to the QP's twist [deg]",
    ylabel="share of postures below",
    xlim=(0, 180),
    ylim=(0, 1),
)
left.set_title("Unseen people")
left.legend(loc="lower right")
right.plot(sizes, curve[:, 1], "o-", color=studies.ORANGE, label="90 %")
right.plot(sizes, curve[:, 0], "o-", color=studies.BLUE, label="median")
right.set(
    xlabel="postures taught",
    ylabel="angle [deg]",
    ylim=(0, None),
    title="Least squares, more and more postures",
)
right.set_xscale("log")
right.set_xticks(sizes, [str(count) for count in sizes])
right.minorticks_off()
right.legend()
studies.save(figure, "policy_full_problem")

# %% [markdown]
"""The learned controller points within 19 degrees of the QP's twist in half of the cases.

The postures are of people whom it has never seen. In nine of ten cases it points within 52;
algorithm 1 comes to 21 and 53. That is about as far as the QP's own first period from standstill is
from where it goes in the end. Fitting is the limit, not the number of postures: on what it was
taught least squares is hardly better, and twice as many postures gain little. Part of the tail is
the QP's own sharpness: where the learned twist is worst, one degree in every angle turns the QP by
11 degrees, elsewhere by 5. And no limit holds by itself for theta Phi(q): the twist of such a
controller has to pass the same certification as any other.
"""
