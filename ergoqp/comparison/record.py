"""The QPs of real closed loops, and sequences of QPs as files for qpbenchmark.

A run is logged, and its steps are computed again with a solver that records its QPs.

Sequences of QPs as files for qpbenchmark. `ergoqp.comparison.ergoqp_sequences` describes their
content.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.coordinates import FOREARM
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import InputError, ModelError
from ergoqp.files.atomic import atomic_write, write_text_atomic
from ergoqp.files.read import read_npz
from ergoqp.human.forearm import forearm_points
from ergoqp.joints import JOINTS
from ergoqp.limits import ArmLength, OneClassBoundary
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.loop import in_world, run_loop
from ergoqp.simulation.points import run_points
from ergoqp.solvers.daqp import Daqp
from ergoqp.solvers.session import Qp, QpAnswer, QpSequence
from ergoqp.solvers.solver import NumericFunction, numeric
from ergoqp.step.function import INPUTS, OUTPUTS, build_step
from ergoqp.step.model import StepModel
from ergoqp.step.qp import TOLERANCE
from ergoqp.step.stepper import Stepper

STILL: Final = 1.0
"""A loop ends when the object has rested for this long [s], because all later QPs are the same."""

TWIST: Final = 6
"""Number of unknowns of a QP without slack."""

_PLACES: Final = 20


@dataclass(frozen=True, eq=False)
class RecordedQps:
    """QPs that the control steps of some closed loops solved, and how the steps used the answers.

    Attributes:
        sequence: the QPs, in order.
        answers: the answer of the step's solver for each.
        accepted: whether the step used that answer: the QP was its last one, and passed its
            residual test.
    """

    sequence: QpSequence
    answers: tuple[QpAnswer, ...]
    accepted: NDArray[np.bool_]


class RecordingSolver(Daqp):
    """The solver of the step, which records every QP.

    Attributes:
        heard: the QPs and the answers, in order.
    """

    def __init__(self) -> None:
        """Start without a QP."""
        self.heard: list[tuple[Qp, QpAnswer]] = []
        # CasADi does not keep the Python part of a callback alive.
        self._kept: list[NumericFunction] = []

    def function(self, n: int, m: int) -> ca.Function:
        """Return DAQP with recording; see `ergoqp.solvers.solver`."""
        inner = super().function(n, m)

        def hear(parts: Sequence[ca.DM]) -> Sequence[ca.DM]:
            answer = inner.call(parts)
            x, rows, box = (np.array(part).ravel() for part in answer)
            self.heard.append((numeric(parts), QpAnswer(x, rows, box, "solved")))
            return answer

        self._kept.append(NumericFunction("recorded", n, m, hear))
        return self._kept[-1].expression()


def record(
    problem: Problem,
    steps: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> list[RecordedQps]:
    """Return the QPs that the first `steps` control steps of closed loops solve.

    The loops use one simulated person after the other, each from an awkward place, until there are
    enough steps. Every QP of a step is recorded, including those of further passes in which joints
    yield. A step whose rows must give way solves a larger QP, with a slack variable per row. These
    form their own sequences, ``PROBLEM.LOOP.relaxed``.

    Args:
        problem: the task.
        steps: number of steps of all loops together.
        seed: seed of the first loop; the others count on from it.
        progress: function that is called repeatedly with the share that is done.

    Raises:
        InputError: if there is fewer than one step, or the state of the problem is neither a
            posture nor a forearm.
    """
    if steps < 1:
        raise InputError(f"steps: got {steps}, allowed 1 or more")
    problem = in_world(problem)
    solver, log = RecordingSolver(), list[dict[str, Any]]()
    function, model = build_step(problem, solver), StepModel(problem)
    sizes = {name: model.size(name) for name in INPUTS}
    stepper = Stepper(problem, compiled=False, log=log.append)
    recordings, done = [], 0
    for loop in range(seed, seed + steps):
        log.clear()
        closed_loop(problem, stepper, loop, (steps - done) * problem.dt)
        every: list[tuple[Qp, QpAnswer, bool]] = []
        for entry in log:
            solver.heard.clear()
            # The log has the layout of the buffers, column by column.
            outputs = function(
                *(np.reshape(entry[name], size, order="F") for name, size in sizes.items())
            )
            passed = float(outputs[OUTPUTS.index("residuals")][0]) < TOLERANCE
            last = len(solver.heard) - 1
            every += [
                (qp, answer, passed and i == last) for i, (qp, answer) in enumerate(solver.heard)
            ]
        recordings += _sorted(every, f"{problem.name}.{loop}")
        done += len(log)
        if progress is not None:
            progress(min(1.0, done / steps))
        if done >= steps:
            break
    return recordings


def _sorted(every: list[tuple[Qp, QpAnswer, bool]], name: str) -> list[RecordedQps]:
    """Return the QPs of one loop by size, small ones first."""
    found = []
    for unknowns in sorted({qp.size[0] for qp, _, _ in every}):
        qps, answers, accepted = zip(
            *(one for one in every if one[0].size[0] == unknowns), strict=True
        )
        ending = "" if unknowns == TWIST else ".relaxed"
        found.append(RecordedQps(QpSequence(name + ending, qps), answers, np.array(accepted)))
    return found


def _points_start(problem: Problem, seed: int) -> np.ndarray:
    """Return the point with the highest cost among some random points that keep the limits."""
    if problem.coordinates != FOREARM:
        raise InputError(
            f"problem {problem.name}: got the state {', '.join(problem.coordinates)}, allowed"
            " JOINTS or FOREARM"
        )
    postures, _ = balanced_postures(_PLACES, np.random.default_rng([seed, 6]), scores=range(3, 9))
    points = forearm_points(postures)
    length, boundary = problem.limit_of(ArmLength), problem.limit_of(OneClassBoundary)
    points = points if length is None else length.project(points)
    if boundary is not None and (inside := boundary.model.margin(points) > 0).any():
        points = points[inside]
    return points[int(np.argmax(problem.cost(points)))]


def closed_loop(problem: Problem, stepper: Any, seed: int, duration: float) -> None:
    """Run a loop of a simulated person [s], from an awkward place; see the log of the stepper."""
    if tuple(problem.coordinates) != JOINTS:
        run_points(
            problem, _points_start(problem, seed), duration, stepper=stepper, stop_when_still=STILL
        )
        return
    person = sample_person(problem, seed)
    start = person.start_at(awkward_start(problem, person, seed, _PLACES))
    run_loop(
        problem,
        person.holding(start),
        duration=duration,
        seed=seed,
        controller=stepper,
        stop_when_still=STILL,
    )


_NAMES = ("P", "q", "G", "h", "lb", "ub", "feasible", "follows")


def save_sequences(sequences: Iterable[QpSequence], folder: str | Path) -> list[Path]:
    """Write one ``.npz`` file per sequence, and beside the folder the test set for qpbenchmark.

    Args:
        sequences: any sequences.
        folder: target folder; it is made if it does not exist. Files of other sequences in it stay.

    Returns:
        The paths of the sequences.

    Raises:
        OSError: if the files cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    # As text: importing it needs qpbenchmark.
    test_set = Path(__file__).with_name("ergoqp_sequences.py")
    write_text_atomic(folder.parent / test_set.name, test_set.read_text(encoding="utf-8"))
    paths = []
    for sequence in sequences:
        path = folder / f"{sequence.name}.npz"
        A = np.array([qp.A for qp in sequence])
        with atomic_write(path) as scratch:
            np.savez_compressed(
                scratch,
                P=np.array([qp.H for qp in sequence]),
                q=np.array([qp.g for qp in sequence]),
                G=np.concatenate([A, -A], axis=1),
                h=np.array([np.concatenate([qp.ubA, -qp.lbA]) for qp in sequence]),
                lb=np.array([qp.lb for qp in sequence]),
                ub=np.array([qp.ub for qp in sequence]),
                feasible=np.array(sequence.feasible),
                follows=np.array(sequence.follows),
            )
        paths.append(path)
    return paths


def load_sequence(path: str | Path) -> QpSequence:
    """Return a sequence from its file.

    Raises:
        InputError: if it is not such a file.
    """
    path = Path(path)
    try:
        arrays = read_npz(path, _NAMES)
    except ModelError as error:
        raise InputError(f"sequence: {error}") from None
    P, q, G, h, lb, ub, feasible, follows = (arrays[name] for name in _NAMES)
    half = h.shape[1] // 2
    data = zip(P, q, G[:, :half], -h[:, half:], h[:, :half], lb, ub, strict=True)
    return QpSequence(
        path.stem,
        tuple(Qp(*map(np.ascontiguousarray, parts)) for parts in data),
        bool(feasible),
        bool(follows),
    )
