"""Small linear algebra as scalar expressions.

It is for matrices with a structure that CasADi's general routines would not use.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar, cast

import casadi as ca
import numpy as np

Expression = TypeVar("Expression", ca.SX, ca.MX)


Shape = Callable[[ca.Function], ca.Function]
"""How a function is expressed: `vectors` or `scalars`."""


def vectors(function: ca.Function) -> ca.Function:
    """Return a function unchanged, in vectors and matrices: best for an interpreter."""
    return function


def scalars(function: ca.Function) -> ca.Function:
    """Return the same function as single scalar operations: best for a compiler.

    Equal subexpressions are computed once.
    """
    inputs = [
        ca.SX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())
    ]
    names = (
        [function.name_in(i) for i in range(function.n_in())],
        [function.name_out(i) for i in range(function.n_out())],
    )
    outputs = function.expand().call(inputs, True, False)
    return ca.Function(
        function.name(), inputs, ca.cse([ca.densify(part) for part in outputs]), *names
    )


def written_out(function: ca.Function, *arguments: ca.MX | float) -> list[ca.MX]:
    """Return the outputs of a function; a function of matrices is inlined instead of called.

    An interpreter copies the inputs and outputs of a call. A function of scalars stays a call.
    """
    return function.call(
        [ca.MX(argument) for argument in arguments], function.is_a("MXFunction"), False
    )


def by_name(
    function: ca.Function, known: Mapping[str, Any], written: bool = False
) -> dict[str, ca.MX]:
    """Return the outputs of a function by name, for inputs by name.

    Args:
        function: function with named inputs and outputs.
        known: values by name, among them its inputs.
        written: inline a function of matrices, see `written_out`.
    """
    given = [known[name] for name in function.name_in()]
    found: Any = written_out(function, *given) if written else function.call(given)
    return dict(zip(function.name_out(), found, strict=True))


def once(expressions: list[ca.MX]) -> list[ca.MX]:
    """Return the same expressions, with equal subexpressions computed once."""
    return cast("list[ca.MX]", ca.cse(expressions))


def dense(parts: Sequence[ca.SX]) -> list[ca.SX]:
    """Return expressions with their structural zeros stored.

    Functions that exchange plain arrays need this.
    """
    return [ca.densify(ca.SX(part)) for part in parts]


def is_set(flag: Any) -> Any:
    """Return whether a flag, 0 or 1 up to rounding, is set."""
    return flag > 0.5


def largest(values: Expression, of_none: float = 0.0) -> Expression:
    """Return the largest entry, or `of_none` if there is no entry."""
    return ca.mmax(values) if values.numel() else type(values)(of_none)


def smallest(values: Expression, of_none: float = 0.0) -> Expression:
    """Return the smallest entry, or `of_none` if there is no entry."""
    return ca.mmin(values) if values.numel() else type(values)(of_none)


def marked(values: Expression, *parts: Expression) -> Expression:
    """Return values, with NaN in the entries where a part is NaN; minimum and maximum drop NaN."""
    # A sum of squares keeps NaN. Infinite parts stay below the comparison.
    squares = sum(part**2 for part in parts)
    return values + ca.if_else(squares <= ca.inf, 0, np.nan)


def solve3(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solve a 3 x 3 system by cross products (Cramer)."""
    a, b, c = ca.horzsplit(matrix)
    cofactors = ca.horzcat(ca.cross(b, c), ca.cross(c, a), ca.cross(a, b))
    return (cofactors.T @ right) / ca.dot(a, cofactors[:, 0])


def spd_inverse(matrix: ca.SX) -> ca.SX:
    """Return the inverse of a symmetric positive definite matrix by Cholesky.

    Only the lower triangle of the matrix is used.
    """
    n = matrix.shape[0]
    root, inverse = ca.SX(n, n), ca.SX(n, n)
    for j in range(n):
        root[j, j] = ca.sqrt(matrix[j, j] - ca.sumsqr(root[j, :j]))
        for i in range(j + 1, n):
            root[i, j] = (matrix[i, j] - root[i, :j] @ root[j, :j].T) / root[j, j]
    for j in range(n):
        inverse[j, j] = 1 / root[j, j]
        for i in range(j + 1, n):
            inverse[i, j] = -(root[i, j:i] @ inverse[j:i, j]) / root[i, i]
    return inverse.T @ inverse
