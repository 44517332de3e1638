"""Who stands there, from ten of their rests: how well rests elsewhere are predicted, and places.

Run ``python -m benchmarks.identify [--quick | --full] [--json FILE]``. People of a kind, each with
a body, habits and seed of their own (seeds for judging), are led to places drawn at random. Ten of
their rests, every angle with 2 deg of noise, are given to `ergoqp.identify` with the problem's own
person as all that is known; eight others are to be predicted. ``--quick``: one person each of three
kinds on three problems; ``--full``: six of five kinds on all five, of which `KEPT` were never
looked at while this was built.

``KIND.posture_deg``: RMS over the joints that follow, median over places and people; ``.p90``: nine
in ten people are better. ``KIND.score_error``: mean difference of the exact scores.
``KIND.one_of_three``: share of people for whom one of the three places that promise most is as good
as the best of 48 places searched around with the very person. ``KIND.seconds``: longest
identification on one core. ``KIND.delay_error_ms``: of how late the person follows, by the log of
30 s of a loop that tries two places, on average over those of whom it shows
(``KIND.delay_known``, their share); ``.usual``: had it been taken to be what is usual, `USUAL`.

Beside each: ``.nominal``: the problem's own person, of whom nothing was identified; ``.nearest``:
the posture of the nearest of the ten rests; ``one_of_three.rests``: the three best of the ten
places, by their measured scores; ``.plain``: what no traits explain left out of the predictions;
``one_of_three.thirty``: by thirty rests instead of ten, or as many as there are;
``.half_bias``: without what no traits explain, but half of what the sensors seem to read too much
added everywhere, which is the simplest part of it; ``.biased``: all by sensors that read every
joint wrong by `BIAS`, drawn once per person, and ``.biased_plain``: of these ``.plain``.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.people import JUDGING, KEPT, prepared
from benchmarks.people_draw import judged, model_optimum
from benchmarks.report import Report, run
from ergoqp.identification.identify import HABIT, Identified, Identifier
from ergoqp.identification.loops import delay_of, watched
from ergoqp.identification.promising import CandidateSearch, chosen
from ergoqp.problem.load import TASKS
from ergoqp.rest.person_protocol import Holding
from ergoqp.seeking import Place, Seeker
from ergoqp.simulation.loop import run_loop
from ergoqp.simulation.people import person_of_kind

GIVEN, UNSEEN, MORE = 10, 8, 20
NOISE = float(np.radians(2.0))
BIAS = float(np.radians(4.0))
SCORED_AT_DEG = 2.0
USUAL = 0.23
"""Half of the longest delay, and the mean lag of the hand, that people are drawn with [s]."""
LED = 30.0
"""For how long somebody is led whose delay is to be found [s]."""
Rest = tuple[np.ndarray, np.ndarray]


@cache
def tools_of(name: str) -> tuple[Identifier, CandidateSearch]:
    """Return what identifies people of a problem: once per process."""
    problem, _ = judged(name)
    return Identifier(problem), CandidateSearch(problem, SCORED_AT_DEG)


def rests_of_person(home: Holding, name: str, rng: np.random.Generator, count: int) -> list[Rest]:
    """Return a person's rests at places drawn at random, as far as they come along."""
    workspace, found = judged(name)[1].workspace, []
    for _ in range(6 * count):
        there, pose = home.copy(), workspace.pose(rng.uniform(-1.0, 1.0, 5))
        if there.carry(pose):
            found.append((there.posture.copy(), pose))
        if len(found) == count:
            break
    return found


def of_person(kind: str, name: str, seed: int) -> dict[str, list[float]] | None:
    """Return the figures of one person, one per way of predicting; None without rests."""
    problem, judge = judged(name)
    person, rng = person_of_kind(kind, problem, seed), np.random.default_rng([seed, 77])
    home = person.hold(person.comfort, seed=seed)
    rests = rests_of_person(home, name, rng, GIVEN + UNSEEN + MORE)
    if len(rests) < GIVEN + UNSEEN:
        return None
    noisy = [(posture + NOISE * rng.standard_normal(32), pose) for posture, pose in rests]
    given, unseen = noisy[:GIVEN], rests[GIVEN : GIVEN + UNSEEN]
    identifier, promising = tools_of(name)
    begin = time.perf_counter()
    found = identifier.identify(given)
    seconds = time.perf_counter() - begin
    nobody = identifier.nobody(given)
    plain = replace(found, beyond=nobody.beyond)
    predictions = [[each.posture_at(pose) for _, pose in unseen] for each in (found, nobody, plain)]
    predictions.append([_nearest(given, pose) for _, pose in unseen])
    half = np.zeros(32)
    half[found.joints] = [HABIT * np.radians(each) for each in found.bias_deg.values()]
    predictions.append([posture + half for posture in predictions[2]])
    wrong = BIAS * np.random.default_rng([seed, 78]).standard_normal(32)
    biased = identifier.identify([(posture + wrong, pose) for posture, pose in given])
    for each in (biased, replace(biased, beyond=nobody.beyond)):
        predictions.append([each.posture_at(pose) for _, pose in unseen])
    truth = [posture for posture, _ in unseen]
    scores = [judge.score(posture) for posture in truth]
    many = identifier.identify([*given, *noisy[GIVEN + UNSEEN :]])
    places = [_three(promising, each) for each in (found, nobody, plain, many)]
    measured = sorted(given, key=lambda each: judge.score(each[0]))
    places.append([pose for _, pose in measured[:3]])
    best = judge.best(home, [pose for three in places for pose in three])[0].score
    return {
        "posture_deg": [_off(found.joints, told, truth) for told in predictions],
        "score_error": [
            float(np.mean([abs(judge.score(one) - s) for one, s in zip(told, scores, strict=True)]))
            for told in predictions
        ],
        "one_of_three": [
            float(any(judge.carried(home, pose).score == best for pose in three))
            for three in places
        ],
        "delay": delay_errors(home, name, rng, seed),
        "seconds": [seconds],
    }


@cache
def _logging(name: str) -> tuple[Seeker, list[dict[str, Any]]]:
    """Return what leads people of a problem, and its log: once per process."""
    log: list[dict[str, Any]] = []
    problem, best = judged(name)[0], Place("model's best", model_optimum(name).pose)
    return Seeker(problem, [best], thinks=False, log=log.append), log


def delay_errors(home: Holding, name: str, rng: np.random.Generator, seed: int) -> list[float]:
    """Return the errors of the delay that is found and of the usual one [ms]; NaN: not known."""
    problem, judge = judged(name)
    there, (seeker, log) = home.copy(), _logging(name)
    while not there.carry(judge.workspace.pose(rng.uniform(-1.0, 1.0, 5))):
        there = home.copy()
    log.clear()
    run_loop(problem, there, duration=LED, seed=seed, controller=seeker)
    loop = watched(log)
    assert loop is not None
    found, late = delay_of(loop), home.senses.delay + home.senses.hand_time
    return [1e3 * abs((np.nan if each is None else each) - late) for each in (found, USUAL)]


def _off(joints: list[int], told: Sequence[np.ndarray], truth: Sequence[np.ndarray]) -> float:
    apart = (np.array(told) - np.array(truth))[:, joints]
    return float(np.median(np.degrees(np.sqrt(np.mean(apart**2, axis=1)))))


def _nearest(given: Sequence[Rest], pose: np.ndarray) -> np.ndarray:
    return min(given, key=lambda each: float(np.linalg.norm(each[1][:3, 3] - pose[:3, 3])))[0]


def _three(promising: CandidateSearch, person: Identified) -> list[np.ndarray]:
    """Return the three places that together promise this person most."""
    return [place.pose for place in chosen(promising.places(person, 15.0), 3)]


def measure(report: Report) -> None:
    """Print the figures of every kind."""
    kinds = ("alike", "follower", "stubborn", *report.pick((), KEPT))
    names = report.pick(("dentist", "desk", "screwing"), TASKS)
    seeds = range(JUDGING, JUDGING + report.pick(1, 6))
    jobs = [(kind, name, seed) for kind in kinds for name in names for seed in seeds]
    people: dict[str, list[dict[str, list[float]]]] = defaultdict(list)
    with prepared(names) as pool:
        for (kind, _, _), found in zip(
            jobs, pool.map(of_person, *zip(*jobs, strict=True)), strict=True
        ):
            if found is not None:
                people[kind].append(found)
    for kind, found in people.items():
        report.figure(f"{kind}.people", len(found), "with 18 rests")
        for name in ("posture_deg", "score_error", "one_of_three"):
            by_way = np.array([each[name] for each in found])
            middle = np.median if name == "posture_deg" else np.mean
            simpler = (".nearest", ".half_bias", ".biased", ".biased_plain")
            others = (".thirty", ".rests") if name == "one_of_three" else simpler
            ways = ("", ".nominal", ".plain", *others)
            for way, values in zip(ways, by_way.T, strict=True):
                report.figure(f"{kind}.{name}{way}", float(middle(values)))
        errors = np.array([each["delay"] for each in found])
        known = np.isfinite(errors[:, 0])
        report.figure(f"{kind}.delay_known", float(known.mean()))
        for way, column in zip(("", ".usual"), errors.T, strict=True):
            if known.any():
                report.figure(f"{kind}.delay_error_ms{way}", float(column[known].mean()))
        worst = np.percentile([each["posture_deg"][0] for each in found], 90)
        report.figure(f"{kind}.posture_deg.p90", float(worst))
        report.figure(f"{kind}.seconds", max(each["seconds"][0] for each in found))


if __name__ == "__main__":
    run(measure, __doc__ or "")
