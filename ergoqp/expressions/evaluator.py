"""CasADi functions called on NumPy arrays through their buffers, without conversions and copies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Evaluator:
    """A CasADi function with its own arrays, for frequent calls.

    In a loop: write to `inputs`, call `evaluate`, read `results` or `outputs`. The next call
    overwrites them. Elsewhere: call the object.

    Matrices are stored column by column, as in CasADi. Of a sparse matrix only the nonzeros
    are stored.

    Attributes:
        given: all inputs, one after the other.
        places: slices of `given`, by the name of the input.
        inputs: views of `given`, by name.
        results: all outputs, one after the other.
        slices: slices of `results`, by the name of the output.
        outputs: views of `results`, by name.
        evaluate: calls the function. It uses the memory of this object, so keep this object
            too.
    """

    def __init__(self, function: ca.Function) -> None:
        """Allocate the arrays."""
        self._function = function
        self.places = _consecutive(function.name_in(), function.nnz_in)
        self.given = np.zeros(function.nnz_in())
        self.inputs = {name: self.given[part] for name, part in self.places.items()}
        self.slices = _consecutive(function.name_out(), function.nnz_out)
        self.results = np.zeros(function.nnz_out())
        self.outputs = {name: self.results[part] for name, part in self.slices.items()}
        self._buffer, self.evaluate = _bound(function, self.inputs.values(), self.outputs.values())

    def stats(self) -> dict[str, Any]:
        """Return CasADi's statistics of the last call."""
        return self._buffer.stats()

    def __call__(self, values: Mapping[str, Array | float]) -> dict[str, Array]:
        """Return the results of a dense function by name, matrices in their shape, columns flat.

        They are copies that belong to the caller.

        Args:
            values: inputs by name; other names are ignored.
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


def _consecutive(names: Iterable[str], count: Callable[[int], int]) -> dict[str, slice]:
    """Return the slices of named parts that follow each other."""
    parts, end = {}, 0
    for i, name in enumerate(names):
        begin, end = end, end + count(i)
        parts[name] = slice(begin, end)
    return parts


def evaluated_once(function: ca.Function, given: Array) -> Array:
    """Return the only result of a function, flat. Its only input is not copied.

    Args:
        function: a function of one input.
        given: the input, contiguous, column by column.
    """
    result = np.empty(function.nnz_out(0))
    _, call = _bound(function, (given,), (result,))
    call()
    return result


def _bound(
    function: ca.Function, inputs: Iterable[Array], outputs: Iterable[Array]
) -> tuple[ca.FunctionBuffer, Any]:
    buffer, call = function.buffer()
    # CasADi's stubs require a length, but these methods do not take one.
    for i, array in enumerate(inputs):
        buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]
    return buffer, call
