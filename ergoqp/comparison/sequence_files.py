"""Sequences of QPs as files for qpbenchmark.

`ergoqp.comparison.ergoqp_sequences` describes their content.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ergoqp.errors import InputError, ModelError
from ergoqp.files.npz import read_npz
from ergoqp.files.whole import whole, write_whole
from ergoqp.solvers.sequence import Qp, QpSequence

_NAMES = ("P", "q", "G", "h", "lb", "ub", "feasible", "follows")


def save_sequences(sequences: Iterable[QpSequence], folder: str | Path) -> list[Path]:
    """Write one ``.npz`` file per sequence, and beside the folder the test set for qpbenchmark.

    Args:
        sequences: any sequences.
        folder: target folder; it is made if it does not exist. Files of other sequences in it stay.

    Returns:
        The paths of the sequences.

    Raises:
        OSError: if the files cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    # As text: importing it needs qpbenchmark.
    test_set = Path(__file__).with_name("ergoqp_sequences.py")
    write_whole(folder.parent / test_set.name, test_set.read_text(encoding="utf-8"))
    paths = []
    for sequence in sequences:
        path = folder / f"{sequence.name}.npz"
        A = np.array([qp.A for qp in sequence])
        with whole(path) as scratch:
            np.savez_compressed(
                scratch,
                P=np.array([qp.H for qp in sequence]),
                q=np.array([qp.g for qp in sequence]),
                G=np.concatenate([A, -A], axis=1),
                h=np.array([np.concatenate([qp.ubA, -qp.lbA]) for qp in sequence]),
                lb=np.array([qp.lb for qp in sequence]),
                ub=np.array([qp.ub for qp in sequence]),
                feasible=np.array(sequence.feasible),
                follows=np.array(sequence.follows),
            )
        paths.append(path)
    return paths


def load_sequence(path: str | Path) -> QpSequence:
    """Return a sequence from its file.

    Raises:
        InputError: if it is not such a file.
    """
    path = Path(path)
    try:
        arrays = read_npz(path, _NAMES)
    except ModelError as error:
        raise InputError(f"sequence: {error}") from None
    P, q, G, h, lb, ub, feasible, follows = (arrays[name] for name in _NAMES)
    half = h.shape[1] // 2
    data = zip(P, q, G[:, :half], -h[:, half:], h[:, :half], lb, ub, strict=True)
    return QpSequence(
        path.stem,
        tuple(Qp(*map(np.ascontiguousarray, parts)) for parts in data),
        bool(feasible),
        bool(follows),
    )
