"""How wide tables are, and what is said of long work where there is no terminal."""

import sys

import pytest
from command_line import mistake

from ergoqp.cli import common as screen


@pytest.mark.slow
@pytest.mark.parametrize("columns", [60, 80])
def test_tables_are_as_wide_as_columns_says(ergoqp, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    outcome = ergoqp("run", "desk", "--duration", "0.5")
    lines = [line for line in outcome.out.splitlines() if "ergoqp-out" not in line]
    assert max(map(len, lines)) <= columns
    assert "still costs points" in outcome.out


@pytest.mark.slow
def test_without_columns_a_pipe_gets_wide_tables(ergoqp, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    outcome = ergoqp("run", "desk", "--duration", "0.5")
    assert max(map(len, outcome.out.splitlines())) > 80


@pytest.mark.slow
def test_long_work_says_how_far_it_is(ergoqp, monkeypatch):
    monkeypatch.setattr(screen, "PAUSE", 0.0)
    outcome = ergoqp("fit", "quadratic", "--per-score", 9, "--folds", 3)
    assert outcome.status == 0, outcome.err
    lines = outcome.err.splitlines()
    assert "cross-validation, 3 folds ..." in lines
    assert any(line.startswith("cross-validation, 3 folds: 33 % after") for line in lines)
    assert "\x1b" not in outcome.err


@pytest.mark.parametrize(
    ("kind", "module"), [("svr", "sklearn"), ("quadratic", "matplotlib"), ("boundary", "sklearn")]
)
def test_fit_asks_for_its_extra_before_any_work(ergoqp, monkeypatch, tmp_path, kind, module):
    monkeypatch.setitem(sys.modules, module, None)
    outcome = ergoqp("fit", kind)
    words = mistake(outcome)
    assert f"needs the package {module!r}" in words
    assert "[learn]" in words
    assert outcome.err.splitlines() == [words]
    assert list(tmp_path.iterdir()) == []
