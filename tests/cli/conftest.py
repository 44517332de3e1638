"""What the tests of the command line share."""

from pathlib import Path

import pytest
from command_line import Outcome

from ergoqp.cli import main as cli
from ergoqp.mocap.demo_recording import demo_recording


@pytest.fixture
def ergoqp(capsys, monkeypatch, tmp_path):
    """Run a command line in an empty folder, in this process."""
    monkeypatch.chdir(tmp_path)
    # Whoever runs the tests in several processes says how wide their lines are.
    monkeypatch.delenv("COLUMNS", raising=False)

    def call(*arguments):
        status = cli.execute([str(argument) for argument in arguments])
        return Outcome(status, *capsys.readouterr())

    return call


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Path:
    return demo_recording(tmp_path_factory.mktemp("cli") / "demo.bvh")
