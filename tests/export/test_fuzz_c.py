"""A few seconds of the fuzz of the exported step; ``python -m tools.fuzz_c --full`` runs for
longer."""

from __future__ import annotations

import shutil
from typing import Any

import pytest

from ergoqp.problem.load import load_problem
from tools import fuzz_c

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")


@pytest.mark.slow
def test_hostile_calls_find_nothing() -> None:
    found = fuzz_c.fuzz(load_problem("forearm"), 4, "random")
    assert not found.breach, found.breach[-3000:]
    assert found.calls > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("COPY(output->twist, FOUND(twist));", "output->twist[0] = 9.0;", "fuzz_c: speed"),
        (
            "memcpy(kept, stepper->state, sizeof kept);",
            "memcpy(kept, stepper->state, 8);",
            "fuzz_c: a stop changed the state",
        ),
    ],
)
def test_it_notices_what_is_wrong(
    old: str, new: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mistake in the C around the generated function ends the run, with a line that names it."""
    usual = fuzz_c.export_step

    def mistaken(problem: Any, folder: Any, guide: Any = None) -> None:
        usual(problem, folder, guide)
        source = folder / "src/ergoqp_step.c"
        text = source.read_text()
        assert old in text
        source.write_text(text.replace(old, new))

    monkeypatch.setattr(fuzz_c, "export_step", mistaken)
    found = fuzz_c.fuzz(load_problem("forearm"), 4, "random")
    assert said in found.breach, found.breach[-2000:]
