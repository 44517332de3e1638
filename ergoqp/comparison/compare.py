"""`compare`: record the QPs of closed loops, solve them with every solver, check the answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ergoqp._version import __version__
from ergoqp.comparison.derive import derived
from ergoqp.comparison.picture import comparison_picture
from ergoqp.comparison.record import RecordedQps, record, save_sequences
from ergoqp.comparison.trial import SolverTrial, figures_of, try_solver
from ergoqp.errors import InputError
from ergoqp.files.atomic import write_whole
from ergoqp.problem.problem import Problem
from ergoqp.progress import Progress
from ergoqp.solvers import SOLVERS, installed_solvers, open_session, solver_named
from ergoqp.solvers.session import QpSequence, tidy

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
            `ergoqp.comparison.trial.figures_of`.
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
        write_whole(path, json.dumps(self.as_dict(), indent=1) + "\n")
        picture = folder / "compare.png"
        # An old picture would be mistaken for that of this comparison.
        picture.unlink(missing_ok=True)
        names = sorted(self.figures, key=lambda name: self.figures[name]["sgm_us"])
        title = (
            f"{self.problem}: {sum(map(len, self.sequences))} QPs, solvers set to"
            f" {tidy(self.accuracy)}"
        )
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
    return found, (
        () if solvers is not None else tuple(name for name in SOLVERS if name not in found)
    )
