"""The best place of the object for one person: many starts, and the best end by exact score."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from ergoqp.arguments import check_called, check_kind, check_number, check_whole, path_of, sentences
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError, OutOfReachError
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.placing.ledger import Ledger, key_of
from ergoqp.placing.optimum import Optimum, Trial
from ergoqp.placing.place import Place
from ergoqp.placing.program import check_names, smooth_cost
from ergoqp.placing.start import FINAL_TAU_DEG, RESIDUAL, PlaceTask, begin_from
from ergoqp.placing.workers import trials_of
from ergoqp.problem.problem import Problem
from ergoqp.progress import Progress
from ergoqp.responses.ik import IkResponse
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.inputs import read_posture
from ergoqp.rest.model_person import Alike


def optimise(
    problem: Problem,
    posture: ArrayLike | None = None,
    starts: int = 32,
    seed: int = 0,
    jobs: int = 1,
    mode: str = "stackelberg",
    solver: str = "ipopt",
    *,
    pose: ArrayLike | None = None,
    person: Alike | Body | None = None,
    tau_deg: float = FINAL_TAU_DEG,
    scheduler: str | None = None,
    out: str | Path | None = None,
    assumptions: Sequence[str] = (),
    progress: Progress | None = None,
) -> Optimum:
    """Find the place of the object at which the person, at rest there, has the lowest score.

    The object leads and the person follows: they come to rest at the place
    (`ergoqp.placing.program`). The conditions of the rest make this one nonlinear program. It is
    solved from many places, with a smooth score that becomes narrower from stage to stage. At
    the end of every start the person settles (`Alike.settle`), and the exact sheet gives the
    score. The start with the lowest exact score wins. Of equal scores the lowest cost wins.

    Args:
        problem: the task; its response must be an `IkResponse`.
        posture: posture in which the person holds the object now (32,) [rad]; None: an awkward
            one, drawn with the seed.
        starts: number of starts; the first is where the object is now.
        seed: seed of the places from which the starts begin.
        jobs: number of processes.
        mode: ``"stackelberg"``, or ``"cooperative"``: the posture of the person is chosen too,
            which gives an optimistic bound.
        solver: ``"ipopt"``, ``"fatrop"`` or ``"sqpmethod"``.
        pose: pose of the object now (4, 4) [m]; None: as the posture holds it.
        person: who holds the object, or their body; None: the person of the problem's
            response.
        tau_deg: scale of the smooth score in the last stage [deg]; not used by a cost that is
            not the smooth score.
        scheduler: address of a Dask scheduler whose workers solve the starts; None: this
            machine.
        out: folder for finished starts. A run with the same inputs continues from them.
        assumptions: sentences on earlier assumptions, for the report.
        progress: called with the share of the starts that is done.

    Returns:
        The best place and all starts. The result does not depend on `jobs` or `scheduler`.

    Raises:
        InputError: if an argument is not usable, or no start ends at a place that the limits
            allow and the person reaches.
        MissingExtraError: if a package for several processes or a cluster is not installed.
        OSError: if `out` cannot be written.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = ergoqp.optimise(problem, starts=1)
        >>> best.pose.shape, best.reba_after <= best.reba_before
        ((4, 4), True)
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    for name, value, least in (("starts", starts, 1), ("seed", seed, 0), ("jobs", jobs, 1)):
        check_whole(name, value, least)
    check_number("tau_deg", tau_deg, 0.05, 20.0, "deg")
    out = None if out is None else path_of("out", out)
    check_kind("scheduler", scheduler, (str, type(None)), "the address of a Dask scheduler or None")
    check_called("progress", progress, "a function of the share that is done")
    assumptions = sentences("assumptions", assumptions)
    follower = _follower(problem, person)
    notes: list[str] = []
    # Report faults of the task itself before any search.
    check_names(mode, solver)
    Place.of(problem)
    if posture is None:
        given = awkward_start(problem, follower, int(seed))
        notes.append(
            "The object starts at the worst-scored of some random places of the workspace (seed"
            f" {seed})."
        )
    else:
        given, notes = read_posture(posture)
    begin = begin_from(follower, given, pose)
    task = PlaceTask(problem, follower, begin, mode, solver, int(seed), float(tau_deg))
    Place.of(problem).anchor(problem, begin.pose)
    trials = _solve(task, int(starts), int(jobs), scheduler, out, progress)
    best = _best(problem, trials)
    return Optimum(
        problem=problem.name,
        title=problem.title or problem.name,
        mode=mode,
        solver=solver,
        seed=int(seed),
        response=follower.response,
        pose=best.pose,
        posture=best.posture,
        reba_before=int(problem.assess(given).final[0]),
        reba_after=best.reba,
        kkt_residual=best.kkt_residual,
        cost_before=smooth_cost(problem, given, float(tau_deg)),
        cost_after=best.cost,
        tau_deg=float(tau_deg) if isinstance(problem.cost, SmoothReba) else None,
        pose_before=begin.pose,
        posture_before=given,
        trials=tuple(trials),
        assumptions=(*assumptions, *notes, *_assumptions(follower.response, mode)),
    )


def _follower(problem: Problem, person: Alike | Body | None) -> Alike:
    response = problem.response
    if not isinstance(response, IkResponse) or tuple(problem.coordinates) != JOINTS:
        kind = type(response).__name__
        raise InputError(
            f"problem {problem.name}: got a response of type {kind}, allowed IkResponse: a person's"
        )
    if isinstance(person, Alike):
        return person
    check_kind("person", person, (Body, type(None)), "a person alike, a Body or None")
    return Alike(response if person is None else replace(response, body=person))


def _solve(
    task: PlaceTask,
    starts: int,
    jobs: int,
    scheduler: str | None,
    out: str | Path | None,
    progress: Progress | None,
) -> list[Trial]:
    """Return the trials of all starts, in order. Starts that an earlier run finished are reused."""
    key = key_of(task)
    ledger = None
    if out is not None:
        Path(out).mkdir(parents=True, exist_ok=True)
        ledger = Ledger(Path(out), key)
    trials = {
        number: trial
        for number, trial in (ledger.trials if ledger else {}).items()
        if number < starts and _stands(task.problem, trial)
    }
    missing = [number for number in range(starts) if number not in trials]
    for trial in trials_of(key, task, missing, jobs, scheduler):
        trials[trial.number] = trial
        if ledger is not None:
            ledger.add(trial)
        if progress is not None:
            progress(len(trials) / starts)
    return [trials[number] for number in range(starts)]


def _stands(problem: Problem, trial: Trial) -> bool:
    """Return whether the limits still allow the end of a start of an earlier run."""
    return not trial.reba or not problem.own_limits.broken(trial.pose, trial.posture)


def _best(problem: Problem, trials: Sequence[Trial]) -> Trial:
    counting = [trial for trial in trials if trial.reba > 0]
    if not counting:
        notes = Counter(trial.note for trial in trials).most_common()
        words = ", ".join(f"{count} {note}" for note, count in notes)
        raise OutOfReachError(
            f"problem {problem.name}: none of {len(trials)} starts ended at a place that counts"
            f" ({words}); enlarge the workspace or loosen the limits"
        )
    # Of equal scores an end that is proven optimal comes first. The last criterion is the
    # number of the start, which does not depend on the order in which starts finish.
    return min(
        counting,
        key=lambda trial: (
            trial.reba,
            trial.kkt_residual > RESIDUAL,
            round(trial.cost, 6),
            trial.number,
        ),
    )


def _assumptions(response: IkResponse, mode: str) -> list[str]:
    chooses = (
        "The person comes to rest by their own comfort at every place of the object."
        if mode == "stackelberg"
        else (
            "The posture is chosen together with the place: an optimistic bound, because people do"
            " not choose their posture by its score."
        )
    )
    return [
        (
            f"The person is {response.body.stature:.2f} m tall and holds the object as in the"
            f" posture at the start; {response.footing}."
        ),
        chooses,
    ]
