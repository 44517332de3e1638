"""`compare`: solve recorded QPs with every solver, check every answer, measure every time."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp._version import __version__
from ergoqp.arguments import Progress
from ergoqp.comparison.derive import derived
from ergoqp.comparison.record import RecordedQps, record, save_sequences
from ergoqp.errors import InputError, MissingExtraError
from ergoqp.files.atomic import atomic_write, write_text_atomic
from ergoqp.problem.problem import Problem
from ergoqp.solvers import SOLVERS, installed_solvers, open_session, solver_named
from ergoqp.solvers.session import (
    NOTHING,
    TOLERANCES,
    Array,
    QpSequence,
    judge,
    shifted_geometric_mean,
    tidy,
)

_SLOW: Final = 2.0
"""A first pass that took this long is the only one [s].

Interruptions by other programs do not matter then.
"""


@dataclass(frozen=True, eq=False)
class SolverTrial:
    """Result of one solver on one sequence.

    Attributes:
        solver: name of the solver.
        sequence: the QPs.
        warm: whether each QP but the first started from the answer before.
        residuals: primal, dual, gap and sign of every answer (k, 4); infinite if there is none.
        flags: result reported by the solver (k,).
        seconds: time of each QP (k,) [s].
        iterations: number of iterations of the solver (k,); NaN if it does not report it.
        points: the answers (k, n).
        fault: what was wrong when the solver first raised or returned an answer of the wrong size.
            Empty: nothing.
    """

    solver: str
    sequence: QpSequence
    warm: bool
    residuals: Array
    flags: NDArray[np.str_]
    seconds: Array
    iterations: Array
    points: Array
    fault: str = ""

    @property
    def worst(self) -> Array:
        """The largest residual of each answer (k,)."""
        return self.residuals.max(axis=1)

    @property
    def found(self) -> NDArray[np.bool_]:
        """Whether the solver reported each QP as solved (k,)."""
        return self.flags == "solved"

    def success(self, tolerance: float) -> NDArray[np.bool_]:
        """Return whether it did so and all four residuals are within a tolerance (k,)."""
        return self.found & (self.worst <= tolerance)

    def wrong(self, tolerance: float) -> NDArray[np.bool_]:
        """Return whether the report is wrong (k,): solved but not so, or infeasible but not so."""
        if not self.sequence.feasible:
            return self.found
        return (self.found & ~(self.worst <= tolerance)) | (self.flags == "infeasible")


def try_solver(
    solver: str, sequence: QpSequence, warm: bool, accuracy: float, passes: int = 1
) -> SolverTrial:
    """Solve a sequence in order by one solver that stays in memory, and check every answer.

    With more than one pass, the time of each QP is its smallest, because a solver takes the same
    steps every time and other programs do not interrupt every pass.

    Args:
        solver: name of the solver, see `ergoqp.solvers`.
        sequence: the QPs.
        warm: whether each QP starts from the answer before. False: as if it were the first.
        accuracy: accuracy that the solver is set to.
        passes: how often the whole sequence is solved, each time by a new session.

    Raises:
        MissingExtraError: if the solver is not installed.
    """
    session = open_session(solver, *sequence.size, accuracy)
    residuals, flags, seconds, iterations, points = [], [], [], [], []
    for qp in sequence:
        answer = session.solve_qp(qp, warm)
        found = judge(qp, answer) if answer.found else NOTHING
        residuals.append((found.primal, found.dual, found.gap, found.sign))
        flags.append(answer.flag)
        seconds.append(answer.seconds)
        iterations.append(np.nan if answer.iterations is None else answer.iterations)
        points.append(answer.x)
    fault = session.fault
    for _ in range(passes - 1 if sum(seconds) < _SLOW else 0):
        session = open_session(solver, *sequence.size, accuracy)
        seconds = [
            min(least, session.solve_qp(qp, warm).seconds)
            for least, qp in zip(seconds, sequence, strict=True)
        ]
    return SolverTrial(
        solver,
        sequence,
        warm,
        np.array(residuals),
        np.array(flags),
        np.array(seconds),
        np.array(iterations),
        np.array(points),
        fault,
    )


Mask = NDArray[np.bool_]

DEADLINE: Final = 0.01
"""Least time of an unsolved QP in the mean [s]: the control period that is lost."""


def figures_of(trials: Sequence[SolverTrial], accuracy: float) -> dict[str, float]:
    """Return the figures of one solver.

    - ``success_1e-3``, ``success_1e-6``, ``success_1e-9``: share of the feasible QPs, cold and
      warm, that it reported as solved, with primal residual, dual residual, gap and wrong-signed
      multipliers within that tolerance.
    - ``wrong_flags``: number of wrong reports at the accuracy. It is the sum of ``wrong_solved``
      (feasible QPs reported as solved that are not), ``wrong_infeasible`` (feasible QPs reported as
      infeasible) and ``solved_infeasible`` (infeasible QPs reported as solved).
    - ``infeasible_named``: share of the infeasible QPs that it reported as such.
    - ``sgm_us``: shifted geometric mean of the times of cold, feasible QPs. A QP that was not
      solved to the accuracy counts with at least `DEADLINE`. ``p50_us`` to ``max_us``: the times as
      measured.
    - ``warm_us``, ``warm_ratio``: shifted geometric mean of the warm times along trajectories, and
      its ratio to the cold one of the same QPs. ``warm_iterations_ratio``: the ratio of the mean
      iterations. ``iterations``: mean, cold.

    Args:
        trials: trials of one solver, with cold ones among them.
        accuracy: accuracy that the solver was set to [1e-9 to 1].
    """
    good = [trial for trial in trials if trial.sequence.feasible]
    bad = [trial for trial in trials if not trial.sequence.feasible]
    cold = [trial for trial in good if not trial.warm]
    count = sum(len(trial.sequence) for trial in trials if not trial.warm)
    figures: dict[str, float] = {"qps": count}
    for tolerance in TOLERANCES:
        figures[f"success_{tidy(tolerance)}"] = _mean([trial.success(tolerance) for trial in good])
    figures["wrong_solved"] = _count([trial.wrong(accuracy) & trial.found for trial in good])
    figures["wrong_infeasible"] = _count([trial.flags == "infeasible" for trial in good])
    figures["solved_infeasible"] = _count([trial.found for trial in bad])
    kinds = ("wrong_solved", "wrong_infeasible", "solved_infeasible")
    figures["wrong_flags"] = sum(figures[kind] for kind in kinds)
    if bad:
        figures["infeasible_named"] = _mean([trial.flags == "infeasible" for trial in bad])
    counted = [
        np.where(trial.success(accuracy), trial.seconds, np.maximum(trial.seconds, DEADLINE))
        for trial in cold
    ]
    figures["sgm_us"] = 1e6 * shifted_geometric_mean(np.concatenate(counted))
    seconds = np.concatenate([trial.seconds for trial in cold])
    for name, percent in (("p50_us", 50), ("p95_us", 95), ("p99_us", 99), ("max_us", 100)):
        figures[name] = 1e6 * float(np.percentile(seconds, percent))
    figures |= _iterations("iterations", cold)
    return figures | _warm(good)


def _warm(trials: Sequence[SolverTrial]) -> dict[str, float]:
    warm = [trial for trial in trials if trial.warm]
    names = {trial.sequence.name for trial in warm}
    cold = [trial for trial in trials if not trial.warm and trial.sequence.name in names]
    if not warm or not cold:
        return {}
    took, cold_took = (
        shifted_geometric_mean(np.concatenate([trial.seconds for trial in kind]))
        for kind in (warm, cold)
    )
    figures = {"warm_us": 1e6 * took, "warm_ratio": took / cold_took}
    counts = [_iterations("i", kind).get("i", np.nan) for kind in (warm, cold)]
    if counts[1] > 0:
        figures["warm_iterations_ratio"] = counts[0] / counts[1]
    return figures


def _iterations(name: str, trials: Sequence[SolverTrial]) -> dict[str, float]:
    counts = np.concatenate([trial.iterations for trial in trials])
    return {} if np.isnan(counts).any() else {name: float(counts.mean())}


def _mean(parts: Sequence[Mask]) -> float:
    return float(np.concatenate(parts).mean()) if parts else 0.0


def _count(parts: Sequence[Mask]) -> float:
    return float(sum(part.sum() for part in parts))


_COLD, _WARM, _LATE = "#2f5d8c", "#dd6b20", "#b9bec6"
_LEAST = 1e-16


def comparison_picture(
    title: str, names: Sequence[str], trials: Sequence[SolverTrial], accuracy: float, path: Path
) -> None:
    """Draw the picture of a comparison, and write it (PNG or SVG).

    Left: the times of the recorded QPs, a dot each, cold above warm, with the median as a line; QPs
    not solved to the accuracy are crosses. Right: the share of all QPs with an answer whose largest
    residual is at most the value on the axis.

    Args:
        title: title of the picture.
        names: names of the solvers, from top to bottom.
        trials: every solver on every sequence.
        accuracy: accuracy that the solvers were set to.
        path: path of the file.

    Raises:
        MissingExtraError: if matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("the picture of a comparison", "solvers", "matplotlib") from None
    figure = Figure(figsize=(11.0, 1.6 + 0.42 * len(names)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    times, residuals = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_times(times, names, trials, accuracy)
    _draw_residuals(residuals, names, trials)
    for axes in (times, residuals):
        axes.grid(axis="x", color="#e3e3e3", linewidth=0.8)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    with atomic_write(path) as scratch:
        figure.savefig(scratch)


def _draw_times(
    axes: Any, names: Sequence[str], trials: Sequence[SolverTrial], accuracy: float
) -> None:
    rng = np.random.default_rng(0)
    for place, name in enumerate(names):
        recorded = [one for one in trials if one.solver == name and one.sequence.follows]
        kinds = ((False, _COLD, 0.0),)
        if solver_named(name).warm:
            kinds = ((False, _COLD, 0.18), (True, _WARM, -0.18))
        for warm, colour, above in kinds:
            its = [one for one in recorded if one.warm == warm]
            micros = 1e6 * np.concatenate([one.seconds for one in its])
            good = np.concatenate([one.success(accuracy) for one in its])
            height = -place + above + rng.uniform(-0.11, 0.11, len(micros))
            dots = {"s": 4, "color": colour, "alpha": 0.35, "linewidths": 0}
            crosses = {"s": 8, "color": _LATE, "marker": "x", "linewidths": 0.7}
            for here, look in ((good, dots), (~good, crosses)):
                axes.scatter(micros[here], height[here], rasterized=True, **look)
            middle, median = -place + above, np.median(micros)
            ends = [middle - 0.15, middle + 0.15]
            axes.plot([median, median], ends, color=colour, linewidth=2.4)
    for colour, label in ((_COLD, "cold"), (_WARM, "warm")):
        axes.plot([], [], color=colour, linewidth=2.4, label=label)
    axes.scatter([], [], s=14, color=_LATE, marker="x", label="not solved")
    axes.set_xscale("log")
    axes.set_yticks([-place for place in range(len(names))], names)
    axes.set_ylim(-len(names) + 0.4, 0.6)
    axes.set_xlabel("time of a recorded QP, µs (lines: medians)")
    where = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
    axes.legend(frameon=False, ncols=3, fontsize=9, handletextpad=0.4, **where)


def _draw_residuals(axes: Any, names: Sequence[str], trials: Sequence[SolverTrial]) -> None:
    from matplotlib import colormaps

    colour: Callable[[int], Any] = colormaps["tab10"]
    for place, name in enumerate(names):
        its = [one for one in trials if one.solver == name and one.sequence.feasible]
        worst = np.sort(np.concatenate([np.maximum(one.worst, _LEAST) for one in its]))
        share = np.arange(1, len(worst) + 1) / len(worst)
        there = np.isfinite(worst)
        x = np.concatenate([worst[there], [1e3]])
        y = np.concatenate([share[there], [share[there][-1] if there.any() else 0.0]])
        look = {"color": colour(place % 10), "linewidth": 1.6, "label": name}
        axes.step(x, 100 * y, ("-", "--")[place % 2], where="post", **look)
    for tolerance in TOLERANCES:
        axes.axvline(tolerance, color="#8a8a8a", linewidth=0.8, linestyle=(0, (2, 3)))
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, 1.0)
    axes.set_ylim(0, 101)
    axes.set_xlabel("largest residual of an answer")
    axes.set_ylabel("QPs that have an answer, %")
    axes.legend(frameon=False, fontsize=8.5, loc="center left", bbox_to_anchor=(1.0, 0.5))


STEPS: Final = 300
"""Default number of recorded control steps."""

MOST_STEPS: Final = 100_000

_DERIVED: Final = 20
_PASSES: Final = 2


@dataclass(frozen=True, eq=False)
class Comparison:
    """Result of `compare`.

    Attributes:
        problem: name of the problem.
        steps: number of recorded control steps.
        seed: seed of the loops.
        accuracy: accuracy that the solvers were set to, in the units of the QPs.
        sequences: the QPs, including the derived ones.
        trials: every solver on every sequence.
        figures: solver -> figure -> number, each in the unit of
            `ergoqp.comparison.compare.figures_of`.
        missing: solvers that are not installed and were not asked for.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> found = ergoqp.compare(problem, ["daqp"], steps=3, derive=0)
        >>> found.steps, found.missing, [len(one) for one in found.sequences]
        (3, (), [3])
    """

    problem: str
    steps: int
    seed: int
    accuracy: float
    sequences: tuple[QpSequence, ...]
    trials: tuple[SolverTrial, ...]
    figures: dict[str, dict[str, float]]
    missing: tuple[str, ...]

    def save(self, folder: str | Path) -> Path:
        """Write ``compare.json``, the picture, and the sequences for qpbenchmark.

        See ``docs/compare_json.md``.

        Returns:
            The path of ``compare.json``.

        Raises:
            OSError: if the files cannot be written.
            MissingExtraError: if matplotlib is not installed for the picture; everything else is
                written before.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        save_sequences(self.sequences, folder / "sequences")
        path = folder / "compare.json"
        write_text_atomic(path, json.dumps(self.as_dict(), indent=1) + "\n")
        picture = folder / "compare.png"
        # An old picture would be mistaken for that of this comparison.
        picture.unlink(missing_ok=True)
        names = sorted(self.figures, key=lambda name: self.figures[name]["sgm_us"])
        count = sum(map(len, self.sequences))
        title = f"{self.problem}: {count} QPs, solvers set to {tidy(self.accuracy)}"
        comparison_picture(title, names, self.trials, self.accuracy, picture)
        return path

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``compare.json``."""
        sequences = [
            {
                "name": one.name,
                "qps": len(one),
                "unknowns": one.size[0],
                "rows": one.size[1],
                "feasible": one.feasible,
            }
            for one in self.sequences
        ]
        return {
            "problem": self.problem,
            "steps": self.steps,
            "seed": self.seed,
            "accuracy": self.accuracy,
            "version": __version__,
            "solvers": self.figures,
            "not_installed": list(self.missing),
            "sequences": sequences,
        }


def compare(
    problem: Problem,
    solvers: Sequence[str] | None = None,
    steps: int = STEPS,
    seed: int = 0,
    *,
    accuracy: float = 1e-6,
    derive: int = _DERIVED,
    progress: Progress | None = None,
) -> Comparison:
    """Compare QP solvers on the QPs of a problem's control steps.

    The QPs are those that the steps of closed loops solve (`ergoqp.comparison.record.record`), and
    near singular, nearly infeasible and infeasible ones derived from them
    (`ergoqp.comparison.derive.derived`). Every solver solves every sequence cold. Solvers with a
    warm start also solve the recorded sequences warm. Times are those of the solver alone,
    including the update with new data, the smaller of two passes.

    Args:
        problem: the task.
        solvers: names from `ergoqp.solvers`. None: all that are installed.
        steps: number of control steps to record.
        seed: seed of the loops and of the derived QPs.
        accuracy: largest residuals that the solvers are set to, 1e-9 to 1, in the units of the QPs.
        derive: number of QPs of each derived kind per recorded sequence.
        progress: function that is called repeatedly with the share that is done.

    Raises:
        InputError: if an argument is out of range.
        MissingExtraError: if a solver that is asked for is not installed.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> found = ergoqp.compare(problem, ["daqp"], steps=3, derive=0)
        >>> found.figures["daqp"]["success_1e-6"]
        1.0
    """
    names, missing = check(solvers, steps, seed, accuracy)
    if derive < 0:
        raise InputError(f"derive: got {derive}, allowed a whole number of at least 0")
    tell = progress or (lambda share: None)
    recordings = record(problem, steps, seed, lambda share: tell(0.2 * share))
    sequences = [recording.sequence for recording in recordings]
    for recording in recordings:
        sequences += relatives(recording, derive, seed)
    trials: list[SolverTrial] = []
    for i, name in enumerate(names):
        for sequence in sequences:
            for warm in (False, True) if sequence.follows and solver_named(name).warm else (False,):
                trials.append(try_solver(name, sequence, warm, accuracy, _PASSES))
        tell(0.2 + 0.8 * (i + 1) / len(names))
    figures = {
        name: figures_of([trial for trial in trials if trial.solver == name], accuracy)
        for name in names
    }
    best = min(one["sgm_us"] for one in figures.values())
    for one in figures.values():
        one["sgm_time"] = one["sgm_us"] / best
    return Comparison(
        problem.name, steps, seed, accuracy, tuple(sequences), tuple(trials), figures, missing
    )


def relatives(recording: RecordedQps, count: int, seed: int) -> list[QpSequence]:
    """Return the sequences derived from a recorded sequence.

    Nothing is derived from the larger QPs, which always have an answer.
    """
    sequence = recording.sequence
    if count == 0 or sequence.name.endswith(".relaxed"):
        return []
    return derived(sequence, [answer.x for answer in recording.answers], count, seed)


def check(
    solvers: Sequence[str] | None, steps: int, seed: int, accuracy: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the solvers to compare and those not installed, before anything is computed.

    Raises:
        InputError: if an argument of `compare` is out of range.
        MissingExtraError: if a solver that is asked for is not installed.
    """
    if not 1 <= steps <= MOST_STEPS:
        raise InputError(f"steps: got {steps}, allowed 1 to {MOST_STEPS}")
    if seed < 0:
        raise InputError(f"seed: got {seed}, allowed a whole number of at least 0")
    if solvers is not None and not solvers:
        raise InputError(f"solvers: got none, allowed {', '.join(SOLVERS)}")
    found = tuple(dict.fromkeys(solvers)) if solvers is not None else installed_solvers()
    for name in found:
        # Raises for a wrong name or accuracy, and for a missing package.
        open_session(name, 1, 0, accuracy)
    missing = [name for name in SOLVERS if name not in found] if solvers is None else []
    return found, tuple(missing)
