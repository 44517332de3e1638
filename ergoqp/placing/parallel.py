"""Independent pieces of work on several processes, in the order they were given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ergoqp.arguments import check_whole
from ergoqp.errors import MissingExtraError


def in_order(function: Callable[..., Any], calls: Sequence[tuple], jobs: int = 1) -> Iterator[Any]:
    """Yield the result of every call as soon as those before it are there.

    Args:
        function: of a module, so that another process finds it.
        calls: its arguments.
        jobs: number of processes; 1 stays in this one.

    Raises:
        InputError: for a number of jobs below 1.
        MissingExtraError: if joblib is not installed and more than one process is wanted.
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
