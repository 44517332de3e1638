"""Every code block of the site and of README is run as a reader would run it."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from page_blocks import Block, blocks_of
from page_given import GIVEN

from ergoqp.problem.load import problem_from_dict

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NEEDS_NO_RUN = {"c", "cmake", "text", ""}
"""Languages of what is shown: output, and sources that the tests of the export compile."""
ELSEWHERE = ("make ", "pip install ", "git clone ", "cd ", "cmake ", "python notebooks/")
"""Begins of commands that are run when the project is tested, or by tests of their own."""
TIMEOUT = 300  # s
_ERGOQP = "from ergoqp.cli.main import main; main()"


def _marked() -> list[Any]:
    return [pytest.param(page, id=page.relative_to(ROOT).as_posix()) for page in PAGES]


@pytest.mark.slow
@pytest.mark.parametrize("page", _marked())
def test_the_blocks_of_a_page(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # where a page's service has its sockets
    monkeypatch.setattr(sys, "path", [*sys.path])  # what a page adds to it goes with the page
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks_of(page):
        for name in block.given:
            namespace |= GIVEN[name]()
        run = {
            "python": _python,
            "sh": _shell,
            "toml": _toml,
            "json": lambda block, where, namespace: json.loads(block.text),
        }.get(block.language)
        if run is None or block.not_run:
            assert block.language in NEEDS_NO_RUN, f"{page.name}, line {block.line}: nobody runs it"
            continue
        run(block, f"{page.name}, line {block.line}", namespace)


def _python(block: Block, where: str, namespace: dict[str, Any]) -> None:
    # Lines are those of the page, so that a mistake is found where it is.
    exec(compile("\n" * (block.line - 1) + block.text, where, "exec"), namespace)


def _shell(block: Block, where: str, namespace: dict[str, Any]) -> None:
    for command in block.text.replace("\\\n", " ").replace("|\n", "| ").splitlines():
        words = shlex.split(command, comments=True)
        if not words or command.startswith(ELSEWHERE):
            continue
        if words[0] == "echo":
            # A pipe, as a reader runs it: `ergoqp` is the one that belongs to this Python.
            words = ["sh", "-c", f'PATH="{Path(sys.executable).parent}:$PATH"; {command}']
        program = {
            "sh": ["sh"],
            "ergoqp": [sys.executable, "-W", "error", "-c", _ERGOQP],
            "python": [sys.executable, "-W", "error"],
        }.get(words[0])
        assert program is not None, f"{where}: {command}"
        done = subprocess.run(
            [*program, *words[1:]],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
        assert done.returncode == 0, f"{where}: {command}\n{done.stdout}{done.stderr}"


def _toml(block: Block, where: str, namespace: dict[str, Any]) -> None:
    """A whole problem, or a part of one in place of what `screwing` has."""
    raw = tomllib.loads(block.text)
    if "response" not in raw or "limits" not in raw:
        whole = tomllib.loads((ROOT / "problems" / "screwing.toml").read_text(encoding="utf-8"))
        raw = _merged(whole, raw)
    problem_from_dict(raw, where, Path())


def _merged(whole: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    merged = dict(whole)
    for key, value in part.items():
        both = isinstance(value, dict) and isinstance(whole.get(key), dict)
        merged[key] = _merged(whole[key], value) if both else value
    return merged
