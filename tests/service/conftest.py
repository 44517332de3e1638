"""One service for all tests that only need one to answer."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from relay_running import Relay
from service_running import Running, running


@pytest.fixture(scope="session")
def service() -> Iterator[Running]:
    """A service with the loops ``screwing`` and ``overhead``; a test leaves them at rest."""
    # The path of a socket must be short.
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", "screwing", "overhead", "--interpreted") as found,
    ):
        found.client().close()
        yield found


@pytest.fixture(scope="session")
def compiled_service() -> Iterator[Running]:
    """A service with two compiled loops of one worker; a test leaves them at rest."""
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", "screwing", "--compiled", "--loops", "2") as found,
    ):
        found.client("screwing.0").close()
        yield found


@pytest.fixture
def relay(tmp_path: Path) -> Iterator[Relay]:
    found = Relay(tmp_path / "r")
    yield found
    found.end()
