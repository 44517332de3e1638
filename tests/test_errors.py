"""The command that a missing extra is installed with, by where the package came from."""

import importlib.metadata
import json
import sys
from pathlib import Path

import pytest

from ergoqp.errors import MissingExtraError, install_command

PIP = "'/my own/python' -m pip install"


@pytest.fixture(autouse=True)
def own_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interpreter whose path needs quotes."""
    monkeypatch.setattr(sys, "executable", "/my own/python")


@pytest.fixture
def came_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Return a function that makes the package one that was installed from there."""

    def install(origin: dict | None) -> None:
        information = tmp_path / "site" / "ergoqp-9.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text("Name: ergoqp\nVersion: 9\n")
        if origin is not None:
            (information / "direct_url.json").write_text(json.dumps(origin))
        monkeypatch.setattr(
            importlib.metadata,
            "distribution",
            lambda name: importlib.metadata.PathDistribution(information),
        )

    return install


def test_from_an_index(came_from):
    came_from(None)
    assert str(MissingExtraError("a picture", "learn", "matplotlib")) == (
        "a picture needs the package 'matplotlib': install it with"
        " `'/my own/python' -m pip install 'ergoqp[learn]'`"
    )


@pytest.mark.parametrize(("information", "option"), [({"editable": True}, "-e "), ({}, "")])
def test_from_a_checkout(came_from, tmp_path, information, option):
    checkout = tmp_path / "a checkout"
    checkout.mkdir()
    came_from({"url": checkout.as_uri(), "dir_info": information})
    assert install_command("learn") == f"{PIP} {option}'{checkout}[learn]'"


def test_a_checkout_that_is_gone_and_a_wheel_are_as_an_index(came_from, tmp_path):
    came_from({"url": (tmp_path / "gone").as_uri(), "dir_info": {"editable": True}})
    assert install_command("learn") == f"{PIP} 'ergoqp[learn]'"


def test_without_an_installation(monkeypatch):
    def nowhere(name: str):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", nowhere)
    assert install_command("learn") == f"{PIP} 'ergoqp[learn]'"


@pytest.mark.parametrize("executable", ["", None])
def test_where_python_does_not_know_its_own_path(came_from, monkeypatch, executable):
    monkeypatch.setattr(sys, "executable", executable)
    came_from(None)
    assert install_command("learn") == "python -m pip install 'ergoqp[learn]'"
