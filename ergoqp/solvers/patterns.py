"""Matrices for solvers that are set up once for a sparsity pattern and then take new values."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ergoqp.solvers.sequence import Array


class GrowingPattern:
    """The entries of a matrix that were ever nonzero; entries that are zero now are explicit zeros.

    A full pattern would work too. But the rows of bounds are unit vectors and each slack has its
    own column, and the time of most solvers grows with the number of entries.
    """

    def __init__(self) -> None:
        """Start without entries."""
        self._mask = np.zeros((0, 0), dtype=bool)

    def grow(self, matrix: Array) -> bool:
        """Add a matrix; return whether it has new entries or another shape."""
        there = matrix != 0
        if there.shape != self._mask.shape:
            self._mask = there
        elif (there & ~self._mask).any():
            self._mask = there | self._mask
        else:
            return False
        # Column by column, as CSC matrices are stored.
        self._columns, self._rows = np.nonzero(self._mask.T)
        self._ends = np.concatenate([[0], np.cumsum(self._mask.sum(axis=0))])
        return True

    def holds_only(self, matrix: Array) -> bool:
        """Return whether the pattern is exactly that of this matrix."""
        return np.array_equal(self._mask, matrix != 0)

    def values(self, matrix: Array) -> Array:
        """Return the entries of a matrix in the pattern, column by column."""
        return matrix[self._rows, self._columns]

    def csc(self, matrix: Array) -> sparse.csc_matrix:
        """Return a matrix in the pattern."""
        return sparse.csc_matrix((self.values(matrix), self._rows, self._ends), shape=matrix.shape)
