"""Independent calls, and starts: in this process, on several processes, or on a Dask cluster.

Where the starts are solved: this process, several processes (joblib), or a Dask cluster.

The trials are the same in all cases.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import pickle
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final

from ergoqp.arguments import check_whole
from ergoqp.errors import InputError, MissingExtraError, WorkersError
from ergoqp.placing.optimise import PlaceTask, StartSolver
from ergoqp.placing.optimum import Trial

TIMEOUT: Final = 5.0
"""Time within which a cluster must answer [s]."""

PATIENCE: Final = 60.0
"""Time for which a cluster may have no worker, for example while the first one starts [s]."""

_KEPT_STARTS: Final = (
    "with `out` the starts that were finished are kept, and the next run goes on with the rest"
)

_KEPT: Final = 4
_solvers: OrderedDict[str, StartSolver] = OrderedDict()


def solve_start(key: str, sent: bytes, number: int) -> Trial:
    """Return the trial of one start of a task that was sent to this process.

    The process builds the program of a task only once.

    Args:
        key: key of the task, see `ergoqp.placing.ledger.key_of`.
        sent: the task, as packed by `_packed`.
        number: number of the start.
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
        key: key of the task.
        task: the task.
        numbers: numbers of the starts.
        jobs: number of processes on this machine.
        scheduler: address of a Dask scheduler, which then chooses the workers; None: this
            machine.

    Raises:
        InputError: if there is no answer at the address, or cost or limits cannot be sent to
            other processes.
        MissingExtraError: if a package for several processes or a cluster is not installed.
        WorkersError: if the workers are gone for good.
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
    """Raise the error of a client if no scheduler answers at an address.

    A client that failed is never fully closed, and its thread goes on. If the garbage
    collector closes it while the next client starts, it waits for that start for ever.
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
    # Run it in another thread, because that of a notebook already has an event loop.
    with concurrent.futures.ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, ask()).result()


def _collected(client: Any, futures: Sequence[Any]) -> Iterator[Trial]:
    """Yield the trials that a cluster has finished, as long as it has workers.

    Errors that a start raises are raised here.

    Dask waits for ever for a worker that never comes back. It silently drops the futures of a
    scheduler that is gone.
    """
    from distributed import wait
    from distributed.scheduler import KilledWorker

    wait_for: Any = wait  # the return type depends on the context, unlike the annotation
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
                ):  # only while waiting: the user's own client is current otherwise
                    done, pending = wait_for(pending, timeout=1.0, return_when="FIRST_COMPLETED")
            except TimeoutError:
                # Ask the scheduler itself, because the client may remember a cluster that is
                # gone.
                if client.sync(client.scheduler.ncores, callback_timeout=TIMEOUT):
                    seen = time.monotonic()
                elif time.monotonic() - seen > PATIENCE:
                    raise WorkersError(
                        f"{where} has had no worker for {PATIENCE:g} s, allowed a cluster with one;"
                        f" {_KEPT_STARTS}"
                    ) from None
                continue
            for future in done:
                # An OSError that the start itself raises, for example a cost that reads a
                # file, is not one of the connection to the scheduler.
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
    """Return the task in the form in which it is sent.

    Raises:
        InputError: if it cannot be sent.
        MissingExtraError: if cloudpickle is not installed.
    """
    try:
        # Unlike pickle it can send classes that a script defines, such as the user's own cost.
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


def in_order(function: Callable[..., Any], calls: Sequence[tuple], jobs: int = 1) -> Iterator[Any]:
    """Yield the result of every call as soon as it and all before it are done.

    Args:
        function: a function of a module, so that another process can import it.
        calls: arguments of each call.
        jobs: number of processes; 1: this process.

    Raises:
        InputError: if `jobs` is below 1.
        MissingExtraError: if joblib is not installed and more than one process is needed.
    """
    check_whole("jobs", jobs, 1)
    if jobs == 1 or len(calls) < 2:
        yield from (function(*arguments) for arguments in calls)
        return
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("work on several processes", "optimise", "joblib") from None
    yield from joblib.Parallel(n_jobs=jobs, return_as="generator")(
        joblib.delayed(function)(*each) for each in calls
    )
