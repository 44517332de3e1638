"""Whole closed loops with a place to be drawn to.

They are problems x people x starts, as ``benchmarks.closed_loop``.

Run ``python -m benchmarks.guided_loop [--quick | --full] [--json FILE]``. ``--quick`` (the default)
takes one person with one start per problem; ``--full`` ten people with twenty starts each. The
people are not those of ``closed_loop``: the guided step's thresholds were chosen on people 0 to 19,
and these are 20 and up.

Every loop is run five times, from the same start and with the same noise:

- ``PROBLEM.figure``: guided by `ergoqp.optimise` for the controller's own model of the person, all
  that it can know;
- ``PROBLEM.own_figure``: guided by `ergoqp.optimise` for the very person who follows;
- ``PROBLEM.alone_figure``: by descent alone;
- ``PROBLEM.seek_figure``: by `ergoqp.Seeker`, which tries the model's optimum and the rule's place
  and keeps what measures best, within 60 s;
- ``PROBLEM.unseeing_figure``: guided, with a model whose eyes are taken away (`looks = false`),
  and its optimum.

Beside them, from the same starts and for the same people, the object where nobody had to measure
anything:

- ``PROBLEM.rule_share_at_best``, ``PROBLEM.rule_mean_end``: carried straight to the height of the
  elbow, 0.40 m ahead, level (`ergoqp.lab.yardstick.rule_pose`); ``PROBLEM.placed_...``: to
  the optimum of the model, without a step that looks at the person.

The figures are those of ``closed_loop``, and ``travelled_share``: share of the loops in which the
object was drawn to the place, ``returned_share``: share in which it was drawn back, because the
person was better off before.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from benchmarks.loops import (
    Loops,
    figures_of,
    gather,
    optimum_of,
    placed_score,
    run_loops,
)
from benchmarks.people_draw import places_to_try, unseeing, unseeing_optimum
from benchmarks.report import Report, run
from ergoqp.lab.yardstick import rule_pose
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.model_person import Start, person_of, sample_person
from ergoqp.seeking import Seeker
from ergoqp.simulation.loop import Trace
from ergoqp.step.rest import BACK, THERE
from ergoqp.step.stepper import Stepper

FIRST_PERSON = 20
"""Seed of the first person: none whom anything was chosen on."""
WAYS = ("", "own_", "alone_", "seek_", "unseeing_")
SEEKING = {"duration": 60.0, "still": 10.0}
"""A loop that tries places takes longer, and rests in between [s]."""


@dataclass
class GuidedLoops(Loops):
    """Numbers of the loops of one problem and one way of guiding."""

    travelled: list[bool] = field(default_factory=list)
    returned: list[bool] = field(default_factory=list)
    rule: list[int] = field(default_factory=list)
    placed: list[int] = field(default_factory=list)

    def beside(self, start: Start, seed: int, trace: Trace) -> None:
        """Note where the loop was drawn."""
        phases = {step.drawn for step in trace.steps}
        self.travelled.append(THERE in phases)
        self.returned.append(BACK in phases)


def loops_of_person(name: str, person_seed: int, count: int) -> tuple[str, dict[str, GuidedLoops]]:
    """Run all loops of one person in one problem."""
    problem = load_problem(name)
    person = sample_person(problem, person_seed)
    own = optimum_of(problem, person)
    best = model_optimum(name)
    controllers = {
        "": Stepper(problem, guide=best),
        "own_": Stepper(problem, guide=own),
        "alone_": Stepper(problem),
        "seek_": Seeker(problem, places_to_try(problem, best), patient=True),
        "unseeing_": Stepper(unseeing(name), guide=unseeing_optimum(name)),
    }
    loops = {way: GuidedLoops() for way in WAYS}
    rule, placed = rule_pose(problem, person_of(problem).body), best.pose

    def beside(start: Start, seed: int, trace: Trace) -> None:
        loops[""].beside(start, seed, trace)
        loops[""].rule.append(placed_score(problem, person, start, rule))
        loops[""].placed.append(placed_score(problem, person, start, placed))

    for way, controller in controllers.items():
        told, longer = (loops[way].beside if way else beside), SEEKING if way == "seek_" else {}
        run_loops(loops[way], problem, person, person_seed, count, controller, told, own, **longer)
    return name, loops


@cache
def model_optimum(name: str) -> Optimum:
    """Return the best place for the controller's own model of the person: once per process."""
    return optimum_of(load_problem(name), None)


def measure(report: Report) -> None:
    """Run everything in two processes and print the figures of every problem."""
    people, starts = report.pick(quick=(1, 1), full=(10, 20))
    found = {name: {way: GuidedLoops() for way in WAYS} for name in TASKS}

    def take(name: str, loops: dict[str, GuidedLoops]) -> int:
        for way in WAYS:
            found[name][way].add(loops[way])
        return sum(len(each.start) for each in loops.values())

    seeds = range(FIRST_PERSON, FIRST_PERSON + people)
    gather(
        report, loops_of_person, [(name, seed, starts) for seed in seeds for name in TASKS], take
    )
    for name, ways in found.items():
        for way, loops in ways.items():
            figures = figures_of(loops)
            if loops.start and way != "alone_":
                runs = len(loops.start)
                figures |= {
                    "travelled_share": sum(loops.travelled) / runs,
                    "returned_share": sum(loops.returned) / runs,
                }
            if loops.start and not way:
                for what, scores in (
                    ("rule", np.array(loops.rule)),
                    ("placed", np.array(loops.placed)),
                ):
                    figures[f"{what}_share_at_best"] = float(
                        np.mean(scores <= np.array(loops.best))
                    )
                    figures[f"{what}_mean_end"] = float(scores.mean())
            for figure, value in figures.items():
                report.figure(f"{name}.{way}{figure}", value)


if __name__ == "__main__":
    run(measure, __doc__ or "")
