"""What a corrected response would be worth: the loop with the very person's own, as identified.

Run ``python -m benchmarks.correction [--quick | --full] [--json FILE]``. The response says which
way a posture goes when the object moves. It is the model's, not the person's, and could be
corrected while the loop runs. At best that gives the person's own response. So here the person is
identified from ten scattered rests (2 deg of noise), more than a loop ever meets, and the same
loops are run with that response from the start as with the problem's. What they do not gain, no
correction can. And a loop that tries places identifies the person anyway, from the few rests that
it meets: what it gains by that response is found by taking it over after each identification.

Starts, people and judging are those of `benchmarks.people`, seeds for judging. ``--quick``: one
start of three kinds on one problem each; ``--full``: four of six kinds on all five problems.

``share_at_best``, ``mean_end``: without a suffix by descent, ``.own`` with the person's own
response, ``.seek`` and ``.seek_own`` by places tried, ``.seek_swapped`` with the response as
identified in the loop; ``.still``: had the object been left alone. The best is the lowest score of
the yardstick and of all these. ``better.WAY`` and ``worse.WAY``: share of starts in which ``own``,
``seek_own`` or ``seek_swapped`` ends lower or higher than the same loop with the problem's
response. ``KIND.share_at_best``: of the kinds alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.identify import GIVEN, NOISE, rests_of_person, tools_of
from benchmarks.people import JUDGING, KEPT, prepared
from benchmarks.people_draw import draw_unit, model_optimum, places_to_try
from benchmarks.people_figures import best_of, end_of
from benchmarks.people_unit import controller_of, way_of
from benchmarks.report import Report, run
from ergoqp.problem.load import TASKS
from ergoqp.seeking import Seeker
from ergoqp.step.guide import Guide
from ergoqp.step.stepper import Stepper

WAYS = ("descent", "own", "seek", "seek_own", "seek_swapped", "still")
PAIRS = {"own": "descent", "seek_own": "seek", "seek_swapped": "seek"}
"""Ways with another response, and the same with the problem's."""


class Swapping(Seeker):
    """Takes over the response of the person as identified, each time that it is thought about."""

    def _think_on(self) -> None:
        person = tools_of(self.problem.name)[0].identify(self._rests)
        # The object is at rest, so that the new step has nothing to take over.
        own = self.problem.replace(response=person.response)
        self.stepper = Stepper(own, guide=Guide(self._rests[-1].pose, firm=True))
        super()._think_on()


def of_start(kind: str, name: str, seed: int) -> dict[str, Any] | None:
    """Return the ends of one start, None where there is none that is bad enough."""
    unit = draw_unit(kind, name, seed).unit
    if unit is None:
        return None
    rng = np.random.default_rng([seed, 78])
    rests = rests_of_person(unit.home, name, rng, GIVEN)
    noisy = [(posture + NOISE * rng.standard_normal(32), pose) for posture, pose in rests]
    own = unit.problem.replace(response=tools_of(name)[0].identify(noisy).response)
    places = places_to_try(unit.problem, model_optimum(name))
    controllers = {
        "descent": controller_of(unit, "descent"),
        "own": Stepper(own),
        "seek": controller_of(unit, ""),
        "seek_own": Seeker(own, places, patient=True),
        "seek_swapped": Swapping(unit.problem, places, patient=True),
        "still": controller_of(unit, "still"),
    }
    ways = {way: way_of(unit, controllers[way]) for way in WAYS}
    return {"kind": kind, "still": unit.still, "best": unit.best, "ways": ways}


def measure(report: Report) -> None:
    """Print the figures over all starts."""
    kinds = ("follower", "stubborn", "looking", *report.pick((), (*KEPT, "trembling")))
    names = report.pick(("desk",), TASKS)
    seeds = range(JUDGING, JUDGING + report.pick(1, 4))
    jobs = [(kind, name, seed) for seed in seeds for name in names for kind in kinds]
    with prepared(names, quick=not report.full) as pool:
        found = [each for each in pool.map(of_start, *zip(*jobs, strict=True)) if each is not None]
    report.figure("starts", len(found))
    if not found:
        return
    best = np.array([best_of(each) for each in found])
    ends = {way: np.array([end_of(each, each["ways"][way]) for each in found]) for way in WAYS}
    of_kind = {kind: np.array([each["kind"] == kind for each in found]) for kind in kinds}
    for way in WAYS:
        suffix, at_best = "" if way == "descent" else f".{way}", ends[way] <= best
        report.figure(f"share_at_best{suffix}", float(np.mean(at_best)))
        report.figure(f"mean_end{suffix}", float(ends[way].mean()))
        for kind, which in of_kind.items():
            if which.any():
                report.figure(f"{kind}.share_at_best{suffix}", float(np.mean(at_best[which])))
    for way, without in PAIRS.items():
        report.figure(f"better.{way}", float(np.mean(ends[way] < ends[without])))
        report.figure(f"worse.{way}", float(np.mean(ends[way] > ends[without])))


if __name__ == "__main__":
    run(measure, __doc__ or "")
