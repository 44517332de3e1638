"""QPs of ergonomic control steps as a test set of qpbenchmark; needs qpbenchmark and NumPy only.

``ergoqp compare`` puts this file beside the folder ``sequences``. There, run

    qpbenchmark ergoqp_sequences.py --results-path results.csv run --author you

Each file in the folder is one sequence of QPs along a trajectory, or one derived from it. The names
are those of ``qpsolvers.Problem`` with one more axis in front: P (k, n, n), q (k, n), G (k, 2m, n),
h (k, 2m), lb (k, n), ub (k, n). The second half of G is the negative of the first. An infinite
entry of h means that there is no such row. Two opposite rows with equal bounds are an equality.
``feasible`` says whether the QPs have answers, ``follows`` whether each is close to the one before.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from qpbenchmark import Problem, TestSet


class ErgoqpSequences(TestSet):
    """All QPs that have an answer, from all sequences.

    Args:
        folder: folder of the sequences. None: ``sequences`` beside this file.
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        """Find the files."""
        super().__init__()
        self._files = sorted(Path(folder or Path(__file__).parent / "sequences").glob("*.npz"))

    def __iter__(self) -> Iterator[Problem]:
        """Yield the problems one by one, named ``SEQUENCE.NUMBER``."""
        for file in self._files:
            with np.load(file, allow_pickle=False) as arrays:
                parts = {name: arrays[name] for name in arrays.files}
            if parts["feasible"]:
                for i in range(len(parts["q"])):
                    yield _problem(
                        *(parts[name][i] for name in ("P", "q", "G", "h", "lb", "ub")),
                        name=f"{file.stem}.{i}",
                    )

    @property
    def description(self) -> str:
        """Description of the problems."""
        return (
            "QPs of control steps that move an object so that a person's posture gets better,"
            " recorded from closed loops."
        )

    @property
    def title(self) -> str:
        """Title of reports."""
        return "QPs of ergonomic control steps"

    @property
    def sparse_only(self) -> bool:
        """Whether only sparse solvers fit. False: the QPs are small."""
        return False


def _problem(
    P: np.ndarray,
    q: np.ndarray,
    G: np.ndarray,
    h: np.ndarray,
    lb: np.ndarray,
    ub: np.ndarray,
    name: str,
) -> Problem:
    half = len(h) // 2
    meet = np.tile(h[:half] == -h[half:], 2)
    kept = np.isfinite(h) & ~meet
    equal = np.flatnonzero(meet[:half])
    A, b = (G[equal], h[equal]) if len(equal) else (None, None)
    rows, ends = (G[kept], h[kept]) if kept.any() else (None, None)
    return Problem(P, q, rows, ends, A, b, lb, ub, name)
