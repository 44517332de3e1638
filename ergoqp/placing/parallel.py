"""Independent calls on several processes, with results in the order of the calls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ergoqp.arguments import check_whole
from ergoqp.errors import MissingExtraError


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
