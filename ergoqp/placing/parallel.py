"""Independent calls on several processes of this machine."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from ergoqp.arguments import Progress, check_whole
from ergoqp.errors import InputError, MissingExtraError, WorkersError, in_words


def in_order(
    function: Callable[..., Any],
    calls: Sequence[tuple],
    jobs: int = 1,
    progress: Progress | None = None,
) -> list[Any]:
    """Return the results of all calls, in their order.

    Args:
        function: a function of a module, so that another process can import it.
        calls: arguments of each call.
        jobs: number of processes; 1: this process.
        progress: called with the share of the calls that is done.

    Raises:
        InputError: if `jobs` is below 1, or the arguments cannot be sent to another process.
        MissingExtraError: if a package for several processes is not installed.
        WorkersError: if a process was ended.
    """
    check_whole("jobs", jobs, 1)
    found = []
    for result in _yielded(function, calls, jobs):
        found.append(result)
        if progress is not None:
            progress(len(found) / len(calls))
    return found


def _yielded(function: Callable[..., Any], calls: Sequence[tuple], jobs: int) -> Iterator[Any]:
    """Yield the result of every call as soon as it and all before it are done."""
    if jobs == 1 or len(calls) < 2:
        yield from (function(*arguments) for arguments in calls)
        return
    sent = packed("jobs", calls)
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("work on several processes", "optimise", "joblib") from None
    try:
        yield from joblib.Parallel(n_jobs=jobs, backend="loky", return_as="generator")(
            joblib.delayed(call_packed)(function, each) for each in sent
        )
    except BrokenProcessPool:
        raise WorkersError(
            f"jobs: one of {jobs} processes was ended, often for want of memory; use fewer jobs"
        ) from None


def packed(option: str, calls: Sequence[tuple]) -> list[bytes]:
    """Return the arguments of calls in the form in which they are sent.

    Args:
        option: what asks for other processes, for the message.
        calls: arguments of each call.

    Raises:
        InputError: if they cannot be sent.
        MissingExtraError: if cloudpickle is not installed.
    """
    try:
        # Unlike pickle it can send classes that a script defines, such as the user's own cost.
        import cloudpickle
    except ImportError:
        raise MissingExtraError("work on other processes", "optimise", "cloudpickle") from None
    try:
        return [cloudpickle.dumps(arguments) for arguments in calls]
    except Exception as error:
        raise InputError(
            f"{option}: the terms of the problem cannot be sent to other processes"
            f" ({in_words(error)}); use one process"
        ) from None


def call_packed(function: Callable[..., Any], sent: bytes) -> Any:
    """Return the result of a call with arguments from `packed`."""
    return function(*pickle.loads(sent))
