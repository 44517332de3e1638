"""Who solves the starts: this process, several of this machine (joblib), or a Dask cluster. The trials are the same."""

from __future__ import annotations

import pickle
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import Any, Final

from ergoqp.errors import InputError, MissingExtraError
from ergoqp.optimise.optimum import Trial
from ergoqp.optimise.start import Solver, Task

TIMEOUT: Final = 5.0
"""How long a cluster may take to answer [s]."""

_KEPT: Final = 4
_solvers: OrderedDict[str, Solver] = OrderedDict()


def solve_start(key: str, sent: bytes, number: int) -> Trial:
    """Return the trial of a start of a task that was sent to this process, which writes its program down once.

    Args:
        key: of the task, see `ergoqp.optimise.ledger.key_of`.
        sent: the task, as `_packed` has it.
        number: of the start.
    """
    if key not in _solvers:
        _solvers[key] = Solver(pickle.loads(sent))
        while len(_solvers) > _KEPT:
            _solvers.popitem(last=False)
    _solvers.move_to_end(key)
    return _solvers[key].start(number)


def trials_of(key: str, task: Task, numbers: Sequence[int], jobs: int, scheduler: str | None) -> Iterator[Trial]:
    """Yield the trials of starts as they are finished.

    Args:
        key: of the task.
        task: what is to be solved.
        numbers: of the starts.
        jobs: processes of this machine.
        scheduler: address of a Dask scheduler, which then decides who works; None: this machine.

    Raises:
        InputError: if nobody answers at the address, or cost or limits cannot be sent to other processes.
        MissingExtraError: if what several processes or a cluster need is not installed.
    """
    if scheduler is not None:
        yield from _on_cluster(key, task, numbers, scheduler)
    elif jobs > 1 and len(numbers) > 1:
        yield from _in_processes(key, task, numbers, jobs)
    else:
        solver = Solver(task)
        for number in numbers:
            yield solver.start(number)


def _in_processes(key: str, task: Task, numbers: Sequence[int], jobs: int) -> Iterator[Trial]:
    sent = _packed(task)
    try:
        from joblib import Parallel, delayed
    except ImportError:
        raise MissingExtraError("solving starts in several processes", "optimise", "joblib") from None
    options: dict[str, Any] = {"return_as": "generator_unordered", "batch_size": 1}
    run: Any = Parallel(n_jobs=jobs, backend="loky", **options)
    yield from run(delayed(solve_start)(key, sent, number) for number in numbers)


def _on_cluster(key: str, task: Task, numbers: Sequence[int], address: str) -> Iterator[Trial]:
    sent = _packed(task)
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise MissingExtraError("solving starts on a cluster", "optimise", "distributed") from None
    try:
        client = Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        words = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"scheduler: got {address!r}, allowed the address of a Dask scheduler that answers: {words}") from None
    with client:
        futures: list[Any] = [client.submit(solve_start, key, sent, number, pure=False) for number in numbers]
        for future in as_completed(futures, loop=client.loop):
            yield future.result()


def _packed(task: Task) -> bytes:
    """Return the task as it is sent.

    Raises:
        InputError: if it cannot be.
        MissingExtraError: if cloudpickle is not installed.
    """
    try:
        # Unlike pickle it sends classes that a script defines, such as a cost of the user's own.
        import cloudpickle
    except ImportError:
        raise MissingExtraError("solving starts in other processes", "optimise", "cloudpickle") from None
    try:
        return cloudpickle.dumps(task)
    except Exception as error:
        words = " ".join(str(error).split())
        raise InputError(
            f"jobs: the terms of problem {task.problem.name} cannot be sent to other processes ({words}), allowed jobs=1"
        ) from None
