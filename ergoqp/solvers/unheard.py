"""Suppress what one thread prints, while the other threads go on printing."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

_LOCK: Final = threading.Lock()
_THREADS: Final[set[int]] = set()


class _Sieve:
    """A stream that drops what the threads in `_THREADS` write."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return len(text) if threading.get_ident() in _THREADS else self.stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def unheard() -> Iterator[None]:
    """Drop what this thread writes to `sys.stdout`; must not be nested.

    CasADi prints the messages of its plugins there. The stream is replaced only while a thread uses
    this. If another stream was set in the meantime, that one stays.
    """
    me = threading.get_ident()
    with _LOCK:
        _THREADS.add(me)
        if not isinstance(sys.stdout, _Sieve):
            sys.stdout = _Sieve(sys.stdout)
    try:
        yield
    finally:
        with _LOCK:
            _THREADS.discard(me)
            if not _THREADS and isinstance(sys.stdout, _Sieve):
                sys.stdout = sys.stdout.stream
