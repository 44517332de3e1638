"""Independent calls on a Dask cluster, for studies of many people."""

from __future__ import annotations

import asyncio
import concurrent.futures
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from ergoqp.errors import InputError, MissingExtraError, WorkersError
from ergoqp.placing.parallel import call_packed, packed

TIMEOUT: Final = 5.0
"""Time within which a cluster must answer [s]."""

PATIENCE: Final = 60.0
"""Time for which a cluster may have no worker, for example while the first one starts [s]."""


def on_cluster(
    function: Callable[..., Any], calls: Sequence[tuple], address: str
) -> Iterator[tuple[int, Any]]:
    """Yield (number of the call, result) as the calls are finished.

    Args:
        function: a function of a module, so that the workers can import it.
        calls: arguments of each call.
        address: address of a Dask scheduler, which chooses the workers.

    Raises:
        InputError: if there is no answer at the address, or arguments cannot be sent.
        MissingExtraError: if a package for a cluster is not installed.
        WorkersError: if the workers are gone for good.
    """
    sent = packed("scheduler", calls)
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("work on a cluster", "optimise", "distributed") from None
    try:
        _check_address(address)
        client = Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"scheduler: got {address!r}, allowed the address of a Dask scheduler that answers:"
            f" {_words(error)}"
        ) from None
    with client:
        futures = {
            client.submit(call_packed, function, each, pure=False): number
            for number, each in enumerate(sent)
        }
        yield from _collected(client, futures)


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


def _collected(client: Any, futures: Mapping[Any, int]) -> Iterator[tuple[int, Any]]:
    """Yield the results of the calls that a cluster has made, as long as it has workers.

    Errors that a call raises are raised here.

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
                        f"{where} has had no worker for {PATIENCE:g} s; add one"
                    ) from None
                continue
            for future in done:
                # An OSError that the call itself raises, for example a cost that reads a
                # file, is not one of the connection to the scheduler.
                failed = future.exception() if future.status == "error" else None
                if failed is not None:
                    break
                try:
                    result = future.result(timeout=TIMEOUT if future.status == "finished" else 0)
                except TimeoutError:  # it was lost with its worker, and is computed again
                    pending.add(future)
                    continue
                yield futures[future], result
            seen = time.monotonic()
    except (OSError, asyncio.CancelledError, concurrent.futures.CancelledError) as error:
        raise WorkersError(f"{where} does not answer any more ({_words(error)})") from None
    if failed is None:
        return
    if isinstance(failed, (KilledWorker, ModuleNotFoundError)):
        raise WorkersError(f"{where} has workers that cannot do the work ({_words(failed)})")
    raise failed


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
