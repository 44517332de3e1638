"""Two benchmark artefacts side by side: ``python -m benchmarks.compare BEFORE.json AFTER.json``.

Prints every figure of both, the ratio after / before, and what only one of them has.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path


def compare(before: dict[str, float], after: dict[str, float]) -> list[str]:
    """Return one line per figure: name, before, after, ratio."""
    width = max(map(len, [*before, *after, "figure"]))
    lines = [f"{'figure':<{width}} {'before':>12} {'after':>12} {'ratio':>8}"]
    for name in dict.fromkeys([*before, *after]):
        one, other = before.get(name), after.get(name)
        shown = [f"{value:12.6g}" if value is not None else f"{'-':>12}" for value in (one, other)]
        ratio = f"{other / one:8.3f}" if one and other is not None else f"{'-':>8}"
        lines.append(f"{name:<{width}} {shown[0]} {shown[1]} {ratio}")
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the two files and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    options = parser.parse_args(arguments)
    figures = [
        json.loads(path.read_text(encoding="utf-8")) for path in (options.before, options.after)
    ]
    print("\n".join(compare(*figures)))


if __name__ == "__main__":
    main()
