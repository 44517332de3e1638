"""The second model of the EPFL report, and the controllers that follow from it, beside the QP.

Run ``python -m benchmarks.second_model [--quick | --full] [--json FILE]``. People who are not the
controller's model are recorded for five minutes each (100 s by default), in the problem
``screwing``, while the object is carried to random places. A mixture over (x_r, q, V~) is fitted to
each recording (`ergoqp.responses.gmr`), with V~ by the report's first model (`ergoqp.costs.gmr`).
Every person then begins at a bad place, and every way of moving the object is judged by the score
of their rest.

- ``derivative_error``: eq. 2.8 against central differences, in parts of the largest entry, and
  ``call_error``: the expression of q and V against a conditional mean in plain NumPy with densities
  by SciPy [rad, points]. Both of a mixture of `MANY` Gaussians, at its mean and where two Gaussians
  meet: ``shared`` is the largest share of all Gaussians but the likeliest there.
- ``gaussians``: chosen by BIC, mean over the people.
- ``posture_error_deg``: of the last fifth of a recording, by a mixture of the rest, RMS over the
  joints, median over the people; ``.mean`` of the mean posture, ``.prior`` of the model person of
  the recorded body that rests there.
- ``twist_angle_deg``: between the direction of eq. 3.3 and the QP's twist at postures of that
  fifth, each axis in units of its largest speed, median. ``.prior``: with dq/dx of the model
  person; ``.smooth``: with the smooth score as V; ``.nominal``: with both, as the QP has them;
  ``.dV_dx``: the mixture's own dV/dx; ``.random``: of a random direction. It says how alike two
  ways are, not which is better.
- ``policy_angle_deg``: between a policy that algorithm 1 trained on the rest of the recording and
  eq. 3.3 at postures of that fifth; ``.random`` of a random direction. ``converged``: share of the
  people with whom the training did.
- ``reba_end``: mean score at rest at the end, over the starts, of the policy (eq. 3.1) that
  algorithm 1 trained on eq. 3.3; where the person lets go, no better than the start.
  ``left_share``: share of the steps in which it left speed, acceleration, axes, workspace, tool
  axis, or a range or rate of the joints by the controller's model. ``lost``: share of the starts at
  which the person let go. All with ``.WAY`` of the others: ``still``; ``rule``, a rule of thumb;
  ``qp`` with the model person; ``qp_gmr``, the same QP with the mixture; ``nominal_gradient`` with
  the model person and the smooth score; ``gradient`` with both mixtures (eq. 3.3). Policy and
  gradients are kept within the object's limits by the baseline's own clipping; ``raw_policy`` is
  not.
- ``broken``: limits broken, and calls that raised, in a short fuzz of the step with the mixture as
  response; ``steps`` of it.
- ``recording.*``: the same of a real recording, in which the right hand stands for x_r; printed if
  the shared recordings are there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations, product
from typing import Any, Final

import casadi as ca
import numpy as np
from scipy.stats import multivariate_normal

from benchmarks.people import prepared
from benchmarks.people_draw import Unit, draw_unit, judged
from benchmarks.people_unit import come_along
from benchmarks.people_way import Watch, rested
from benchmarks.report import Report, run, shared_folder
from ergoqp.costs.gmr import Gmr
from ergoqp.datasets.postures import posture_data
from ergoqp.expressions import exp_rotation
from ergoqp.joints import INDEX
from ergoqp.lab.policy import (
    Policy,
    angles_deg,
    demonstrate,
    follow,
    twists_of,
    unit_twists,
)
from ergoqp.lab.yardstick import Drive, Gradient, Sent, Still, downhill, rule_pose
from ergoqp.mocap.load import load_recording
from ergoqp.mocap.recorded import held_poses
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames
from ergoqp.responses.gmr import GmrResponse
from ergoqp.rest.model_person import ModelPerson, person_of
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import run_loop
from ergoqp.step.stepper import Stepper
from tools.fuzz.fuzz import run_chunk

Array = np.ndarray

PROBLEM: Final = "screwing"
KINDS: Final = ("alike", "follower", "stubborn", "looking")
"""People with other weights than the controller's model, and people who are built otherwise."""

RECORDED: Final = 300.0
"""Duration of a recording [s]."""

WAYS: Final = (
    *("still", "rule", "qp", "qp_gmr"),
    *("nominal_gradient", "gradient", "policy", "raw_policy"),
)
RECORDING: Final = "c3d/pyomeca_box_handling.c3d"


@dataclass(frozen=True)
class Taught:
    """What was learned from a recording.

    Attributes:
        problem: the task.
        first: V~(q).
        model: the second model, of the whole recording.
        policy: trained on eq. 3.3 with both by algorithm 1.
        postures: recorded (n, 32) [rad].
        figures: of the last fifth of the recording, by models of the rest.
    """

    problem: Problem
    first: Gmr
    model: GmrResponse
    policy: Policy
    postures: Array
    figures: dict[str, float]


@cache
def first_model(per_score: int) -> Gmr:
    """Return the report's first model: V~(q), of random postures."""
    return Gmr.fit(posture_data(per_score))


def teach(problem: Problem, person: Any, postures: Array, poses: Array, per_score: int) -> Taught:
    """Fit the second model to a recording, train a policy on it, and judge both on its last fifth.

    Args:
        problem: the task.
        person: model person with the recorded body.
        postures: recorded (n, 32) [rad].
        poses: of the object in the world of the person's contact (n, 4, 4) [m].
        per_score: postures of each score for the first model.
    """
    first, begin = first_model(per_score), len(postures) * 4 // 5
    later, there = postures[begin:], poses[begin:]
    model = GmrResponse.fit(postures, poses, first, person)
    part = GmrResponse.fit(postures[:begin], poses[:begin], first, person)
    columns = [INDEX[joint] for joint in part.joints]
    guesses = {
        "": part.regression.mean(part.x_r(there))[:, :-1],
        ".mean": postures[:begin, columns].mean(axis=0),
        ".prior": rests(person, there)[:, columns],
    }
    found = {"gaussians": float(len(model.mixture.weights))}
    for name, guess in guesses.items():
        error = np.sqrt(np.mean((later[:, columns] - guess) ** 2))
        found[f"posture_error_deg{name}"] = float(np.degrees(error))
    sample = later[:: max(1, len(later) // 60)]

    def directions(function: Any) -> Array:
        return unit_twists(problem, np.array([np.array(function(q)).ravel() for q in sample]))

    answers = unit_twists(problem, twists_of(problem, sample))
    wanted = directions(downhill(first, part))
    random = np.random.default_rng(0).normal(size=wanted.shape)
    given = {
        "": wanted,
        ".prior": directions(downhill(first, problem.response)),
        ".smooth": directions(downhill(problem.cost, part)),
        ".nominal": directions(downhill(problem.cost, problem.response)),
        ".dV_dx": directions(lambda q: -np.array(part.slopes()(part.contact()(q)[0])[1])),
        ".random": random,
    }
    found |= {f"twist_angle_deg{name}": median_angle(each, answers) for name, each in given.items()}
    held = follow(problem, downhill(first, part), postures[:begin])
    found["policy_angle_deg"] = median_angle(unit_twists(problem, held.policy(sample)), wanted)
    found["policy_angle_deg.random"] = median_angle(random, wanted)
    found["converged"] = float(held.converged)
    policy = follow(problem, downhill(first, model), postures).policy
    return Taught(problem, first, model, policy, postures, found)


def rests(response: Any, poses: Array) -> Array:
    """Return the postures (n, 32) in which a model person comes to rest at poses (n, 4, 4)."""
    person = ModelPerson(response)
    return np.array([person.reach(pose)[0] for pose in poses])


def median_angle(given: Array, wanted: Array) -> float:
    """Return the median angle of rows [deg], of those where both have a direction."""
    return float(np.nanmedian(angles_deg(given, wanted)))


class Raw:
    """Sends what a policy asks for, along the axes that can move."""

    def __init__(self, problem: Problem, policy: Policy) -> None:
        """Take the period of the problem."""
        self.dt, self._policy = problem.dt, policy
        self._free = problem.twist_limit.speed > 0

    def reset(self) -> None:
        """Do nothing: there is no state."""

    def step(self, posture: Array, pose: Array, **rest: object) -> Sent:
        """Return the twist."""
        return Sent(np.where(self._free, self._policy(posture)[0], 0.0), "optimal")


def controller_of(way: str, unit: Unit, taught: Taught) -> Any:
    """Return what moves the object."""
    problem = unit.problem
    learned = problem.replace(response=taught.model)
    makers: dict[str, Any] = {
        "still": lambda: Still(problem),
        "rule": lambda: Drive(
            problem,
            unit.start.pose,
            come_along(unit, rule_pose(problem, person_of(problem).body)),
        ),
        "qp": lambda: Stepper(problem),
        "qp_gmr": lambda: Stepper(learned),
        "nominal_gradient": lambda: Gradient(problem, problem.cost),
        "gradient": lambda: Gradient(learned, taught.first),
        "policy": lambda: Gradient(problem, taught.first, policy=taught.policy.expression),
        "raw_policy": lambda: Raw(problem, taught.policy),
    }
    return makers[way]()


class Leaving(Checker):
    """Counts the steps that left any limit, but for the jerk: only the QP sends means."""

    def __init__(self, problem: Problem) -> None:
        """Begin to count."""
        super().__init__(problem)
        self.steps = self.left = 0

    def check(self, *given: Any, **named: Any) -> list[str]:
        """Check a step."""
        broken = super().check(*given, **named)
        self.steps += 1
        self.left += bool(set(broken) - {"jerk"})
        return broken


def of_person(task: tuple[str, int, bool]) -> tuple[dict[str, float], dict[str, tuple], Any]:
    """Return what came of a person: figures, (end, left, steps, lost) of each way, and models."""
    kind, seed, full = task
    drawn = draw_unit(kind, PROBLEM, seed)
    unit = drawn.unit
    if unit is None:
        return {}, {}, None
    problem = unit.problem
    duration = RECORDED if full else RECORDED / 3
    recorded = demonstrate(problem, unit.home.copy(), duration, seed)
    person = replace(person_of(problem), body=unit.person.body)
    taught = teach(problem, person, *recorded, per_score=1000 if full else 150)
    ends = {}
    for way in WAYS:
        follows, leaving = unit.start.copy(), Leaving(problem)
        follows.count_from_here()
        run_loop(
            problem,
            follows,
            duration=60.0,
            seed=unit.seed,
            controller=controller_of(way, unit, taught),
            checker=leaving,
            beside=Watch(unit.start.pose),
        )
        end = rested(problem, follows)
        score = end.score if end.holds else max(end.score, unit.still)
        ends[way] = (score, leaving.left, leaving.steps, not end.holds)
    many = None
    if seed == FIRST:
        many = GmrResponse.fit(*recorded, taught.first, person, MANY, regularisation=0.01)
    return taught.figures, ends, (taught.model, many)


FIRST: Final = 3000
"""First seed: nothing was tuned or tried on these people."""


MANY: Final = 8
"""Gaussians of the mixture by which expressions are judged."""


def errors_of(model: GmrResponse) -> Iterator[tuple[float, float, float]]:
    """Yield errors of derivative and value, at the mean pose and where two Gaussians meet.

    The third number is the share of all Gaussians but the likeliest there.
    """
    pose, base, twist = ca.MX.sym("pose", 4, 4), ca.SX.sym("pose", 4, 4), ca.SX.sym("twist", 6)
    prediction = model.prediction(pose)
    call = ca.Function("call", [pose], [prediction.mean, prediction.derivative])
    move = ca.Function("move", [base, twist], [exp_rotation(base, twist)])
    centres = model.mixture.means[:, :6]
    pairs = ((first + second) / 2 for first, second in combinations(centres, 2))
    for way in (np.zeros(6), *pairs):
        here = np.array(move(model.mean, way))
        mean, exact = map(np.array, call(here))
        columns = []
        for axis in np.eye(6):
            # Two central differences; of their errors the first terms cancel.
            near, far = (
                (np.array(call(move(here, h * axis))[0]) - np.array(call(move(here, -h * axis))[0]))
                / (2 * h)
                for h in (1e-5, 2e-5)
            )
            columns.append((4 * near - far).ravel() / 3)
        x = model.x_r(here[np.newaxis])
        yield (
            float(np.abs(exact - np.column_stack(columns)).max() / np.abs(exact).max()),
            float(np.abs(conditional_mean(model, x[0]) - mean.ravel()).max()),
            float(1 - model.regression.responsibilities(x).max()),
        )


def conditional_mean(model: GmrResponse, x: Array) -> Array:
    """Return E[(q, V) | x] (m + 1,) with densities by SciPy."""
    weights, means, covariances = (
        getattr(model.mixture, name) for name in ("weights", "means", "covariances")
    )
    logs, parts = [], []
    for weight, mean, covariance in zip(weights, means, covariances, strict=True):
        own = covariance[:6, :6]
        logs.append(np.log(weight) + multivariate_normal.logpdf(x, mean[:6], own))
        parts.append(mean[6:] + covariance[6:, :6] @ np.linalg.solve(own, x - mean[:6]))
    shares = np.exp(np.array(logs) - max(logs))
    return (shares / shares.sum()) @ np.array(parts)


def fuzzed(number: int, model: GmrResponse) -> tuple[int, int]:
    """Return (steps, limits broken and calls that raised) of a chunk of the fuzz."""
    # Postures and poses of the fuzz have nothing to do with each other.
    problem = judged(PROBLEM)[0].replace(response=model, frames=Frames(compare=False))
    tally = run_chunk((number, 1000), of=problem)
    return tally.steps, tally.counts["unsafe"] + tally.counts["exceptions"]


def of_recording(full: bool) -> dict[str, float]:
    """Return the figures of a real recording; none where it is not there."""
    folder = shared_folder()
    path = None if folder is None else folder / "mocap" / RECORDING
    if path is None or not path.is_file():
        return {}
    recording = load_recording(path)
    problem = judged(PROBLEM)[0]
    person = replace(person_of(problem), body=recording.person)
    postures, poses = held_poses(recording, person, by_hand=True)
    return teach(problem, person, postures, poses, per_score=1000 if full else 150).figures


def measure(report: Report) -> None:
    """Record, teach, and let every way move the object."""
    seeds = range(FIRST, FIRST + report.pick(1, 5))
    kinds: Sequence[str] = report.pick(KINDS[:2], KINDS)
    tasks = [(kind, seed, report.full) for seed, kind in product(seeds, kinds)]
    with prepared([PROBLEM], quick=not report.full) as pool:
        people = [each for each in pool.map(of_person, tasks) if each[1]]
        models, many = zip(*(both for _, _, both in people if both[1] is not None), strict=True)
        errors = np.max([each for model in many for each in errors_of(model)], axis=0)
        report.figure("people", len(people), "who were recorded and had a bad start")
        report.figure("derivative_error", errors[0], "of the largest entry")
        report.figure("call_error", errors[1], "rad, points")
        report.figure("shared", errors[2], "of all Gaussians but the likeliest, at most")
        print_figures(report, [figures for figures, _, _ in people])
        for way in WAYS:
            scores, left, steps, lost = zip(*(ends[way] for _, ends, _ in people), strict=True)
            name = "" if way == "policy" else f".{way}"
            report.figure(f"reba_end{name}", float(np.mean(scores)))
            report.figure(f"left_share{name}", sum(left) / sum(steps))
            report.figure(f"lost{name}", float(np.mean(lost)))
        fuzz_all(report, pool, models)
    found = of_recording(report.full)
    if not found:
        report.say("recording: not measured, the shared recordings are not there")
    for name, value in found.items():
        report.figure(f"recording.{name}", value)


def print_figures(report: Report, found: Sequence[dict[str, float]]) -> None:
    """Print the medians over the people, or the means."""
    for name in found[0]:
        of = np.mean if name in ("gaussians", "converged") else np.median
        report.figure(name, float(of([each[name] for each in found])))


def fuzz_all(report: Report, pool: ProcessPoolExecutor, models: Sequence[GmrResponse]) -> None:
    """Fuzz the step with the mixture as its response."""
    tasks = range(report.pick(4, 40))
    of_each = [models[number % len(models)] for number in tasks]
    done = list(pool.map(fuzzed, tasks, of_each))
    report.figure("steps", sum(steps for steps, _ in done), "of the fuzz")
    report.figure("broken", sum(broken for _, broken in done), "limits broken, calls that raised")


if __name__ == "__main__":
    run(measure, __doc__ or "")
