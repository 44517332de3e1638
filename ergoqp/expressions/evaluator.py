"""CasADi functions called on NumPy arrays through their buffers: no conversion, no hidden copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Evaluator:
    """A CasADi function with arrays of its own, to be called often.

    In a loop: write into `inputs`, call `evaluate`, read `results` or `outputs`, which the next
    call overwrites. Elsewhere: call the whole.

    Matrices lie column by column, as CasADi has them; of a sparse one there are the nonzeros.

    Attributes:
        inputs: what the function reads, by name.
        results: all that it writes, output after output.
        slices: of `results`, by the output's name.
        outputs: views of `results`, by name.
        evaluate: calls the function; whoever keeps it keeps this object too, whose memory it uses.
    """

    def __init__(self, function: ca.Function) -> None:
        """Reserve the arrays once."""
        self._function = function
        self.inputs = {
            name: np.zeros(function.nnz_in(i)) for i, name in enumerate(function.name_in())
        }
        self.slices: dict[str, slice] = {}
        end = 0
        for i, name in enumerate(function.name_out()):
            begin, end = end, end + function.nnz_out(i)
            self.slices[name] = slice(begin, end)
        self.results = np.zeros(end)
        self.outputs = {name: self.results[part] for name, part in self.slices.items()}
        self._buffer, self.evaluate = _bound(function, self.inputs.values(), self.outputs.values())

    def stats(self) -> dict[str, Any]:
        """Return what the function tells of its last call."""
        return self._buffer.stats()

    def __call__(self, values: Mapping[str, Array | float]) -> dict[str, Array]:
        """Return the results of a dense function by name, matrices in their shape, columns flat.

        They are the caller's own.

        Args:
            values: by the input's name; further ones are not looked at.
        """
        for name, array in self.inputs.items():
            array[:] = np.ravel(values[name], order="F")
        self.evaluate()
        return {
            name: array.copy() if shape[1] == 1 else array.reshape(shape, order="F").copy()
            for (name, array), shape in zip(self.outputs.items(), self._shapes, strict=True)
        }

    @cached_property
    def _shapes(self) -> list[tuple[int, int]]:
        return [self._function.size_out(i) for i in range(self._function.n_out())]


def evaluated_once(function: ca.Function, given: Array) -> Array:
    """Return the only result of a function, flat; its only input is read where it lies.

    Args:
        function: of one input.
        given: contiguous, the input column by column.
    """
    result = np.empty(function.nnz_out(0))
    _, call = _bound(function, (given,), (result,))
    call()
    return result


def _bound(
    function: ca.Function, inputs: Iterable[Array], outputs: Iterable[Array]
) -> tuple[ca.FunctionBuffer, Any]:
    buffer, call = function.buffer()
    # CasADi's stubs ask for a length, which these do not take.
    for i, array in enumerate(inputs):
        buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]
    return buffer, call
