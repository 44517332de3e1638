"""A learned controller x_dot = theta Phi(q): chapter 3 of the EPFL report.

The same is done for the full control step.

Algorithm 1 of the report trains theta on random postures by theta <- theta - rate e Phi', with
e = theta Phi(q) - x_dot_desired (eq. 3.4-3.8). The report stops at the first small step, but a
single posture that is predicted well gives a small step at any time. Here the means of theta
over two long runs of steps must agree. The training approaches a least-squares fit, which
`solve` computes directly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice, repeat
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import check_number
from ergoqp.errors import InputError
from ergoqp.lab.yardstick import GRADIENT_GAIN
from ergoqp.problem.geometry import Workspace, between, straight
from ergoqp.problem.problem import Problem
from ergoqp.rest.person_protocol import Holding
from ergoqp.step.stepper import Stepper

Array = NDArray[np.float64]

MOST_RUNS: Final = 2000
"""Largest number of runs of steps; training then ends without convergence."""


_STAYS: Final = 1.0
"""How long the object of a demonstration stays at a place [s]."""

_PERIOD: Final = 0.02
"""Period of a demonstration [s]."""

_PART: Final = 0.5
"""Time for one part of a path, 4 cm at most, see `ergoqp.problem.geometry.straight` [s]."""

_HELD: Final = 0.05
"""A hand that is no further off holds the object [m]."""


@dataclass(frozen=True, eq=False)
class RadialFeatures:
    """Phi, M features of a posture: Gaussian bumps exp(-|q - c|^2 / (2 width^2)) for centres c.

    Attributes:
        centres: (M, d) [rad].
        width: width of all bumps, above 0 [rad].
        constant: add one more feature, which is 1 everywhere.
    """

    centres: Array
    width: float
    constant: bool = False

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: if the centres are not a table of numbers, or the width is not
                positive.
        """
        centres = np.asarray(self.centres, dtype=float)
        if centres.ndim != 2 or not centres.size or not np.isfinite(centres).all():
            raise InputError(
                f"centres: got shape {centres.shape}, allowed (M, d) of finite numbers"
            )
        if not 0 < self.width < np.inf:
            raise InputError(f"width: got {self.width!r}, allowed a positive number")
        object.__setattr__(self, "centres", centres)

    @classmethod
    def evenly(cls, low: float, high: float, count: int) -> RadialFeatures:
        """Return evenly spaced bumps of one coordinate from low to high, as wide as their spacing.

        Raises:
            InputError: if there are fewer than two, or the range is empty.
        """
        if count < 2 or not low < high:
            raise InputError(
                f"features: got {count} from {low} to {high}, allowed two or more in a range that"
                " is not empty"
            )
        return cls(np.linspace(low, high, count)[:, np.newaxis], (high - low) / (count - 1))

    @classmethod
    def among(cls, postures: ArrayLike, count: int, seed: int = 0) -> RadialFeatures:
        """Return bumps around postures of a sample, and a constant.

        They are as wide as the median distance of two centres.

        Args:
            postures: sample (n, d) [rad].
            count: number of bumps, at most n.
            seed: seed of the choice.

        Raises:
            InputError: if there are too few postures.
        """
        sample = np.atleast_2d(np.asarray(postures, dtype=float))
        if not 2 <= count <= len(sample):
            raise InputError(
                f"count: got {count}, allowed 2 to the number of postures, {len(sample)}"
            )
        centres = sample[np.random.default_rng(seed).choice(len(sample), count, replace=False)]
        # The pairs of a few hundred centres are enough. All pairs need much memory.
        some = centres[:300]
        distances = np.sqrt(_squared_distances(some, some))
        width = float(np.median(distances[np.triu_indices(len(some), 1)]))
        return cls(centres, width, constant=True)

    def __call__(self, postures: ArrayLike) -> Array:
        """Return the features (n, M) of postures (n, d)."""
        rows = np.atleast_2d(np.asarray(postures, dtype=float))
        bumps = np.exp(-0.5 * _squared_distances(rows, self.centres) / self.width**2)
        return np.column_stack([bumps, np.ones(len(rows))]) if self.constant else bumps

    def expression(self, q: ca.MX) -> ca.MX:
        """Return the features (M,) of a posture (d,), an expression."""
        offsets = ca.DM(self.centres.T) - ca.repmat(q, 1, len(self.centres))
        bumps = ca.exp(-0.5 * ca.sum1(offsets**2).T / self.width**2)
        return ca.vertcat(bumps, 1) if self.constant else bumps


@dataclass(frozen=True, eq=False)
class Policy:
    """x_dot = theta Phi(q), eq. 3.1.

    Attributes:
        theta: (P, M).
        features: the features Phi.
    """

    theta: Array
    features: RadialFeatures

    def __call__(self, postures: ArrayLike) -> Array:
        """Return the velocities (n, P) at postures (n, d)."""
        return self.features(postures) @ self.theta.T

    def expression(self, q: ca.MX) -> ca.MX:
        """Return the velocity (P,) at a posture (d,), an expression."""
        return ca.DM(self.theta) @ self.features.expression(q)


@dataclass(frozen=True, eq=False)
class Training:
    """Result of algorithm 1.

    Attributes:
        policy: policy with the mean theta of the last run of steps, which the noise of single
            steps hardly affects.
        changes: largest change of an entry of that mean from run to run.
        converged: the last change was below the threshold.
        steps: total number of steps.
    """

    policy: Policy
    changes: Array
    converged: bool
    steps: int


def train(
    features: RadialFeatures,
    sample: Callable[[np.random.Generator, int], Array],
    desired: Callable[[Array], Array],
    rate: float,
    threshold: float,
    *,
    run: int = 1000,
    most_runs: int = MOST_RUNS,
    seed: int = 0,
) -> Training:
    """Train a policy by algorithm 1 of the EPFL report, from theta = 0.

    Args:
        features: the features Phi.
        sample: returns a number of random postures (n, d) from a generator.
        desired: returns the desired velocities (n, P) at postures (n, d), for example -eps
            dV/dq dq/dx (eq. 3.3).
        rate: lambda of eq. 3.5; rate |Phi|^2 must stay below 2, otherwise single steps
            overshoot.
        threshold: largest change of an entry of theta between the means of two runs at which
            training has converged.
        run: number of steps of a run.
        most_runs: largest number of runs.
        seed: seed of the postures.

    Returns:
        The policy, and whether it converged.

    Raises:
        InputError: if the rate overshoots, or a number is not positive.
    """
    if not (rate > 0 and threshold > 0 and run >= 1 and most_runs >= 2):
        got = f"rate {rate!r}, threshold {threshold!r}, run {run!r}, most_runs {most_runs!r}"
        raise InputError(f"train: got {got}, allowed positive ones and at least two runs")
    rng = np.random.default_rng(seed)
    theta, mean, changes = None, None, []
    for _ in range(most_runs):
        postures = sample(rng, run)
        phi, wanted = features(postures), np.asarray(desired(postures), dtype=float)
        largest = float(np.square(phi).sum(axis=1).max())
        if rate * largest >= 2:
            raise InputError(
                f"rate: got {rate:g}, allowed less than {2 / largest:.3g} for these features"
            )
        theta = np.zeros((wanted.shape[1], phi.shape[1])) if theta is None else theta
        total = np.zeros_like(theta)
        for row, want in zip(phi, wanted, strict=True):
            theta = theta - rate * np.outer(theta @ row - want, row)
            total += theta
        before, mean = mean, total / run
        if before is not None:
            changes.append(float(np.abs(mean - before).max()))
            if changes[-1] <= threshold:
                break
    assert mean is not None  # at least two runs were taken
    return Training(
        Policy(mean, features),
        np.array(changes),
        changes[-1] <= threshold,
        run * (len(changes) + 1),
    )


def solve(
    features: RadialFeatures, postures: ArrayLike, wanted: ArrayLike, ridge: float = 1e-6
) -> Policy:
    """Return the policy that fits desired velocities best.

    It is the result that algorithm 1 approaches, in closed form.

    Args:
        features: the features Phi.
        postures: (n, d).
        wanted: desired velocities (n, P).
        ridge: weight of |theta|^2 relative to the mean squared error.

    Raises:
        InputError: if the rows do not fit together, or the ridge is negative.
    """
    phi, targets = features(postures), np.asarray(wanted, dtype=float)
    if targets.ndim != 2 or len(targets) != len(phi):
        raise InputError(f"wanted: got shape {targets.shape}, allowed ({len(phi)}, P)")
    if not 0 <= ridge < np.inf:
        raise InputError(f"ridge: got {ridge!r}, allowed a number of at least 0")
    # Solve one tall least-squares problem. The normal equations would square the condition
    # number.
    weight = np.sqrt(ridge * len(phi))
    tall = np.concatenate([phi, weight * np.eye(phi.shape[1])])
    right = np.concatenate([targets, np.zeros((phi.shape[1], targets.shape[1]))])
    return Policy(np.asarray(np.linalg.lstsq(tall, right, rcond=None)[0].T, dtype=float), features)


def demonstrate(
    problem: Problem, person: Holding, duration: float, seed: int = 0, every: float = 0.2
) -> tuple[Array, Array]:
    """Record a person at work: postures (n, 32) [rad] and poses of the object (n, 4, 4) [m].

    The object is carried straight to random places of the workspace, slowly, and stays a second at
    each. Frames in which a hand is off the object are left out.

    Args:
        problem: the task.
        person: who follows; their state is changed.
        duration: duration of the recording [s].
        seed: seed of the places.
        every: time between two frames [s].

    Raises:
        InputError: if a time is out of range.
    """
    check_number("every", every, _PERIOD, 60.0, "s")
    check_number("duration", duration, every, 36000.0, "s")
    workspace, rng = Workspace(problem), np.random.default_rng([seed, 45])

    def carried() -> Iterator[Array]:
        """Yield the pose in every period of `_PERIOD`."""
        here = person.pose
        while True:
            for part in straight(here, workspace.pose(rng.uniform(-1.0, 1.0, 5))):
                for share in np.linspace(0.0, 1.0, round(_PART / _PERIOD) + 1)[1:]:
                    yield between(here, part, share)
                here = part
            yield from repeat(here, round(_STAYS / _PERIOD))

    postures, poses = [], []
    for number, pose in enumerate(islice(carried(), round(duration / _PERIOD))):
        person.follow(pose, _PERIOD)
        if number % round(every / _PERIOD) == 0 and person.gap < _HELD:
            postures.append(person.posture.copy())
            poses.append(person.pose.copy())
    return np.array(postures), np.array(poses)


def follow(problem: Problem, down: ca.Function, postures: Array, count: int = 100) -> Training:
    """Train a policy by algorithm 1 to follow a direction at recorded postures.

    The wanted twist is the direction at the gain of `ergoqp.lab.yardstick.GRADIENT_GAIN`, no faster
    than the object may be: as the baseline sends it.

    Args:
        problem: the task.
        down: ``q (32,) -> twist (6,)``, for example `ergoqp.lab.yardstick.downhill`.
        postures: recorded (n, 32) [rad].
        count: number of radial features.
    """
    features = RadialFeatures.among(postures, min(count, len(postures)))
    speed = problem.twist_limit.speed
    wanted = GRADIENT_GAIN * np.array(down.map(len(postures))(postures.T)).T * (speed > 0)
    over = np.abs(wanted) / np.where(speed > 0, speed, 1.0)
    wanted /= np.maximum(1.0, over.max(axis=1, keepdims=True))
    at = {posture.tobytes(): twist for posture, twist in zip(postures, wanted, strict=True)}
    largest = float(np.square(features(postures)).sum(axis=1).max())
    return train(
        features,
        lambda rng, number: postures[rng.integers(len(postures), size=number)],
        lambda some: np.array([at[posture.tobytes()] for posture in some]),
        rate=0.5 / largest,
        threshold=0.02 * float(np.linalg.norm(wanted, axis=1).mean()),
        run=len(postures),
        most_runs=100,
    )


def twists_of(problem: Problem, postures: ArrayLike, periods: int = 30) -> Array:
    """Return the twist (n, 6) that the control step plans at postures (n, 32) that are held still.

    Each posture starts from standstill with a reset stepper. After one period the acceleration
    limits of the axes determine the direction. After some periods the twist is the one that
    the step wants there.

    Args:
        problem: the task.
        postures: (n, 32) [rad].
        periods: number of control periods for which each posture is held; they must end before
            the step comes to rest.

    Raises:
        InputError: if it is less than one period.
    """
    if periods < 1:
        raise InputError(f"periods: got {periods!r}, allowed 1 or more")
    plain = problem.replace(control=replace(problem.control, average=0.0))
    stepper = Stepper(plain, compiled=False)
    twists = []
    for posture in np.atleast_2d(np.asarray(postures, dtype=float)):
        stepper.reset()
        step = stepper.step(posture)
        pose = step.pose
        for _ in range(periods - 1):
            # Object and person are held in place although the object has a twist: the stepper
            # is reset to this twist in every period.
            stepper.reset(step.twist)
            step = stepper.step(posture, pose)
        twists.append(step.twist)
    return np.array(twists)


def unit_twists(problem: Problem, twists: Array) -> Array:
    """Return the directions (n, 6) of twists (n, 6), each axis in units of its largest speed.

    Zero stays zero.

    An axis along which the object cannot move is zero too.
    """
    speed = problem.twist_limit.speed
    scaled = np.divide(twists, speed, out=np.zeros_like(twists), where=speed > 0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.divide(scaled, length, out=np.zeros_like(scaled), where=length > 0)


def angles_deg(first: Array, second: Array) -> Array:
    """Return the angles (n,) between the rows of two tables (n, P) [deg]; NaN if one is zero."""
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    products = np.einsum("ij,ij->i", first, second)
    cosines = np.divide(products, lengths, out=np.full(len(lengths), np.nan), where=lengths > 0)
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def _squared_distances(first: Array, second: Array) -> Array:
    products = first @ second.T
    squares = np.square(first).sum(axis=1)[:, np.newaxis] + np.square(second).sum(axis=1)
    return np.maximum(squares - 2 * products, 0)
