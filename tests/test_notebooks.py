"""Every notebook runs from its first to its last cell, at its small size, as a user would run
it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(path.name for path in FOLDER.glob("[0-9][0-9]_*.py"))


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.fixture(scope="session")
def settings(tmp_path_factory):
    """Return a folder for matplotlib's list of fonts, which takes seconds to make: once for all
    notebooks."""
    return tmp_path_factory.mktemp("matplotlib")


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_runs_at_its_small_size(name, settings):
    before = {path.name: path.stat().st_mtime_ns for path in (FOLDER / "figures").glob("*")}
    # A process of its own: what a notebook sets up for figures and folders stays out of the other
    # tests.
    variables = {
        "ERGOQP_NOTEBOOK_SIZE": "small",
        "MPLCONFIGDIR": str(settings),
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [sys.executable, "-W", "error", name],
        cwd=FOLDER,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout
    assert {
        path.name: path.stat().st_mtime_ns for path in (FOLDER / "figures").glob("*")
    } == before, "a trial wrote figures"


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_the_rendered_notebook_is_of_this_source(name):
    """Same cells, run in order, with outputs and without errors, and of a size for the web."""
    jupytext, nbformat = pytest.importorskip("jupytext"), pytest.importorskip("nbformat")
    path = (FOLDER / name).with_suffix(".ipynb")
    assert path.is_file(), f"run python notebooks/render.py {name[:2]}"
    assert path.stat().st_size < 400_000
    rendered, source = (
        nbformat.read(path, as_version=4),
        jupytext.read(FOLDER / name, fmt="py:percent"),
    )
    assert [cell.source for cell in rendered.cells] == [cell.source for cell in source.cells]
    code = [cell for cell in rendered.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not [out for cell in code for out in cell.outputs if out.output_type == "error"]
    assert any(out.output_type == "display_data" for cell in code for out in cell.outputs)
