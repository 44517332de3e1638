"""Reads ``reba_facts.toml``: the cells and the cases that others have published."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

_FACTS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

CASES: dict[str, dict[str, Any]] = _FACTS["cases"]


def _numbers(text: str) -> np.ndarray:
    """Return the numbers of a table as they stand: (line, group, number), or (line, number) where
    nothing is grouped."""
    lines = [[group.split() for group in line.split("|")] for line in text.strip().splitlines()]
    return np.array(lines, dtype=int)


TABLES = {
    "A": _numbers(_FACTS["tables"]["A"]).transpose(1, 0, 2),  # neck, trunk, legs
    "B": _numbers(_FACTS["tables"]["B"]),
    "C": _numbers(_FACTS["tables"]["C"])[:, 0],
}
"""Cells by the names of their tables, in the order of the sheet's axes."""
