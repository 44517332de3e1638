"""Who solves the starts: this process, several of this machine (joblib), or a Dask cluster.

The trials are the same.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import pickle
import time
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final

from ergoqp.errors import InputError, MissingExtraError, WorkersError
from ergoqp.placing.optimum import Trial
from ergoqp.placing.start import PlaceTask, StartSolver

TIMEOUT: Final = 5.0
"""How long a cluster may take to answer [s]."""

PATIENCE: Final = 60.0
"""How long a cluster may have no worker, for example while the first is being started [s]."""

_KEPT_STARTS: Final = (
    "with `out` the starts that were finished are kept, and the next run goes on with the rest"
)

_KEPT: Final = 4
_solvers: OrderedDict[str, StartSolver] = OrderedDict()


def solve_start(key: str, sent: bytes, number: int) -> Trial:
    """Return the trial of a start of a task that was sent to this process.

    The process writes its program down once.

    Args:
        key: of the task, see `ergoqp.placing.ledger.key_of`.
        sent: the task, as `_packed` has it.
        number: of the start.
    """
    if key not in _solvers:
        _solvers[key] = StartSolver(pickle.loads(sent))
        while len(_solvers) > _KEPT:
            _solvers.popitem(last=False)
    _solvers.move_to_end(key)
    return _solvers[key].start(number)


def trials_of(
    key: str, task: PlaceTask, numbers: Sequence[int], jobs: int, scheduler: str | None
) -> Iterator[Trial]:
    """Yield the trials of starts as they are finished.

    Args:
        key: of the task.
        task: what is to be solved.
        numbers: of the starts.
        jobs: processes of this machine.
        scheduler: address of a Dask scheduler, which then decides who works; None: this machine.

    Raises:
        InputError: if nobody answers at the address, or cost or limits cannot be sent to other
            processes.
        MissingExtraError: if what several processes or a cluster need is not installed.
        WorkersError: if those who work are gone for good.
    """
    if scheduler is not None:
        yield from _on_cluster(key, task, numbers, scheduler)
    elif jobs > 1 and len(numbers) > 1:
        yield from _in_processes(key, task, numbers, jobs)
    else:
        solver = StartSolver(task)
        for number in numbers:
            yield solver.start(number)


def _in_processes(key: str, task: PlaceTask, numbers: Sequence[int], jobs: int) -> Iterator[Trial]:
    sent = _packed(task)
    try:
        from joblib import Parallel, delayed
    except ImportError:
        raise MissingExtraError(
            "solving starts in several processes", "optimise", "joblib"
        ) from None
    options: dict[str, Any] = {"return_as": "generator_unordered", "batch_size": 1}
    run: Any = Parallel(n_jobs=jobs, backend="loky", **options)
    try:
        yield from run(delayed(solve_start)(key, sent, number) for number in numbers)
    except BrokenProcessPool:
        raise WorkersError(
            f"jobs: one of {jobs} processes that solved starts was ended, often for want of memory,"
            f" allowed fewer jobs; {_KEPT_STARTS}"
        ) from None


def _on_cluster(key: str, task: PlaceTask, numbers: Sequence[int], address: str) -> Iterator[Trial]:
    sent = _packed(task)
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("solving starts on a cluster", "optimise", "distributed") from None
    try:
        _check_address(address)
        client = Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"scheduler: got {address!r}, allowed the address of a Dask scheduler that answers:"
            f" {_words(error)}"
        ) from None
    with client:
        yield from _collected(
            client,
            [client.submit(solve_start, key, sent, number, pure=False) for number in numbers],
        )


def _check_address(address: str) -> None:
    """Raise what a client would for an address at which no scheduler answers.

    A client that failed is never quite closed: its thread goes on, and what the garbage collector
    closes in the midst of the next client's start waits for that start for ever.
    """
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.core import rpc

    async def ask() -> None:
        async with rpc(address, timeout=TIMEOUT) as scheduler:
            identity: Any = scheduler.identity
            await asyncio.wait_for(identity(), TIMEOUT)

    scheme, place = parse_address(address)
    if scheme in ("tcp", "tls"):
        parse_host_port(place)
    # In a thread of its own: a notebook's has a loop already.
    with concurrent.futures.ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, ask()).result()


def _collected(client: Any, futures: Sequence[Any]) -> Iterator[Trial]:
    """Yield what a cluster has finished, as long as there is somebody to wait for.

    What a start itself raises is raised.

    Dask waits for ever for a worker that never comes back, and drops the futures of a scheduler
    that is gone without a word.
    """
    from distributed import wait
    from distributed.scheduler import KilledWorker

    wait_for: Any = (
        wait  # what it returns depends on where it is called, which its types do not say
    )
    where = (
        f"scheduler: {client.scheduler.address}" if client.scheduler else "scheduler: its address"
    )
    pending, seen = set(futures), time.monotonic()
    failed: BaseException | None = None
    try:
        while pending and failed is None:
            try:
                with (
                    client.as_current()
                ):  # and no longer: a user's own client stays theirs between two trials
                    done, pending = wait_for(pending, timeout=1.0, return_when="FIRST_COMPLETED")
            except TimeoutError:
                # Asked of the scheduler itself: what the client remembers of it may be of a cluster
                # that is gone.
                if client.sync(client.scheduler.ncores, callback_timeout=TIMEOUT):
                    seen = time.monotonic()
                elif time.monotonic() - seen > PATIENCE:
                    raise WorkersError(
                        f"{where} has had no worker for {PATIENCE:g} s, allowed a cluster with one;"
                        f" {_KEPT_STARTS}"
                    ) from None
                continue
            for future in done:
                # An OSError of the start's own, such as of a cost that reads a file, is not one of
                # the way to the scheduler.
                failed = future.exception() if future.status == "error" else None
                if failed is not None:
                    break
                yield future.result()
            seen = time.monotonic()
    except (OSError, asyncio.CancelledError, concurrent.futures.CancelledError) as error:
        raise WorkersError(
            f"{where} does not answer any more ({_words(error)}); {_KEPT_STARTS}"
        ) from None
    if failed is None:
        return
    if isinstance(failed, (KilledWorker, ModuleNotFoundError)):
        raise WorkersError(
            f"{where} has workers that cannot solve a start ({_words(failed)}); {_KEPT_STARTS}"
        )
    raise failed


def _packed(task: PlaceTask) -> bytes:
    """Return the task as it is sent.

    Raises:
        InputError: if it cannot be.
        MissingExtraError: if cloudpickle is not installed.
    """
    try:
        # Unlike pickle it sends classes that a script defines, such as a cost of the user's own.
        import cloudpickle
    except ImportError:
        raise MissingExtraError(
            "solving starts in other processes", "optimise", "cloudpickle"
        ) from None
    try:
        return cloudpickle.dumps(task)
    except Exception as error:
        raise InputError(
            f"jobs: the terms of problem {task.problem.name} cannot be sent to other processes"
            f" ({_words(error)}), allowed jobs=1"
        ) from None


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
