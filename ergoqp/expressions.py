"""Small CasADi tools: linear algebra, rigid motions, and functions called on arrays.

Small linear algebra as scalar expressions. It is for matrices with a structure that CasADi's
general routines would not use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, cached_property
from itertools import accumulate
from typing import Any, TypeVar, cast

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import shown, unmasked
from ergoqp.errors import InputError

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


def call_by_name(
    function: ca.Function, known: Mapping[str, Any], written: bool = False, **more: Any
) -> dict[str, ca.MX]:
    """Return the outputs of a function by name, for inputs by name.

    Args:
        function: function with named inputs and outputs.
        known: values by name, among them its inputs.
        written: inline a function of matrices, see `written_out`.
        more: values of further inputs, which come before those of `known`.
    """
    given = [more[name] if name in more else known[name] for name in function.name_in()]
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


def present(number: Any) -> bool:
    """Return whether a number is not zero; a symbol stands for one that is not."""
    return isinstance(number, (ca.SX, ca.MX)) or bool(number)


def column(numbers: Any) -> Any:
    """Return numbers as CasADi takes them; symbols are returned unchanged."""
    return numbers if isinstance(numbers, (ca.SX, ca.MX)) else ca.DM(numbers)


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


def ldl(matrix: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the unit lower factor L and 1/D (n,) of a symmetric matrix L D L'.

    Only the lower triangle of the matrix is used. It is positive definite if all 1/D are finite and
    above zero.
    """
    n = matrix.shape[0]
    unit, scaled, inverse = ca.SX.eye(n), ca.SX(n, n), ca.SX(n, 1)
    for j in range(n):
        for i in range(j, n):
            scaled[i, j] = matrix[i, j] - scaled[i, :j] @ unit[j, :j].T
        inverse[j] = 1 / scaled[j, j]
        unit[j + 1 :, j] = scaled[j + 1 :, j] * inverse[j]
    return unit, inverse


def ldl_solve(factors: tuple[ca.SX, ca.SX], right: ca.SX) -> ca.SX:
    """Return the solution (n, k) of a system, from `ldl` of its matrix."""
    unit, inverse = factors
    n, found = unit.shape[0], ca.SX(right)
    for i in range(1, n):
        found[i, :] -= unit[i, :i] @ found[:i, :]
    for i in reversed(range(n)):
        found[i, :] *= inverse[i]
        if i + 1 < n:
            found[i, :] -= unit[i + 1 :, i].T @ found[i + 1 :, :]
    return found


def exp_rotation(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) moved by a world-aligned displacement (6,).

    The rotation stays orthonormal for any number of moves.
    """
    moved = shifted(pose, displacement)
    moved[:3, :3] = _straightened(moved[:3, :3])
    return moved


def shifted(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) shifted and rotated by a world-aligned displacement (6,).

    The first three entries of the displacement shift the pose, the last three rotate it.

    The rotation is the exact exponential.
    """
    return pose_matrix(pose[:3, 3] + displacement[:3], turned(displacement[3:], pose[:3, :3]))


def pose_matrix(position: ca.SX, rotation: ca.SX) -> ca.SX:
    """Return the pose (4, 4) of a frame."""
    return ca.vertcat(ca.horzcat(rotation, position), ca.SX([[0, 0, 0, 1]]))


def turned(turn: ca.SX, vectors: ca.SX) -> ca.SX:
    """Return vectors (3, n) rotated by a rotation vector (3,) [rad]."""
    angle = ca.sqrt(ca.sumsqr(turn) + 1e-30)
    cross = ca.skew(turn)
    rotation = (
        ca.SX.eye(3)
        + ca.sin(angle) / angle * cross
        + (2 * ca.sin(angle / 2) ** 2) / angle**2 * (cross @ cross)
    )
    return rotation @ vectors


def rotation_error(rotation: ca.SX) -> ca.SX:
    """Return the distance of a 3 x 3 matrix from a rotation: the largest entry of R'R - I.

    It is 2 for a reflection and for NaN.
    """
    apart = ca.mmax(ca.fabs(ca.reshape(rotation.T @ rotation - ca.SX.eye(3), 9, 1)))
    # mmax ignores NaN, but the determinant is then NaN, which is not above zero.
    return ca.if_else(ca.det(rotation) > 0, apart, 2.0)


def is_rigid(pose: ca.SX) -> ca.SX:
    """Return whether a matrix (4, 4) is a rigid motion, finite and within 100 m."""
    bottom = ca.sumsqr(pose[3, :] - ca.DM([[0, 0, 0, 1]])) < 1e-6
    return ca.logic_and(
        ca.logic_and(rotation_error(pose[:3, :3]) < 1e-3, bottom), ca.sumsqr(pose[:3, 3]) < 1e4
    )


def normalised(pose: ca.SX) -> ca.SX:
    """Return the nearest rigid motion (4, 4) to a matrix that `is_rigid`, up to rounding."""
    # Two steps reduce the error from 1e-3 to 4e-7 to 1e-13.
    return pose_matrix(pose[:3, 3], _straightened(_straightened(pose[:3, :3])))


def read_pose(what: str, value: Any) -> np.ndarray:
    """Return a user's pose (4, 4) for the control step, see `is_rigid` and `normalised`.

    Args:
        what: name of the value, for the message.
        value: the value, of any type.

    Raises:
        InputError: if it is not a rigid motion within 100 m.
    """
    try:
        pose = np.array(unmasked(value), dtype=float)
    except Exception:  # not an array
        raise InputError(f"{what}: got {shown(value)}, allowed a pose (4, 4)") from None
    if pose.shape != (4, 4):
        raise InputError(f"{what}: got shape {pose.shape}, allowed a pose (4, 4)")
    read, rigid = _read_pose()(pose)
    if not rigid:
        raise InputError(
            f"{what}: got a pose that is {_what_is_wrong(pose)}, allowed a rotation and a position"
            " within 100 m"
        )
    return np.array(read)


@cache
def _read_pose() -> ca.Function:
    pose = ca.SX.sym("pose", 4, 4)
    return ca.Function("read_pose", [pose], [ca.densify(normalised(pose)), is_rigid(pose)])


def _what_is_wrong(pose: np.ndarray) -> str:
    if not np.isfinite(pose).all():
        return "not finite"
    if not np.allclose(pose[3], [0, 0, 0, 1], atol=1e-3):
        return f"not a rigid motion: its last row is {pose[3].tolist()}"
    if np.linalg.det(pose[:3, :3]) < 0:
        return "a mirror"
    if np.linalg.norm(pose[:3, 3]) >= 100:
        return "far away"
    return "not a rigid motion"


def _straightened(rotation: ca.SX) -> ca.SX:
    """Return the rotation after one Newton step toward the nearest rotation."""
    return 1.5 * rotation - 0.5 * rotation @ (rotation.T @ rotation)


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Return the quaternion (4,), w first, of a rotation (3, 3)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation, dtype=float).ravel())
    return quaternion


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion (4,), w first."""
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, np.asarray(quaternion, dtype=float))
    return flat.reshape(3, 3)


def pose_as_dict(pose: np.ndarray) -> dict[str, list[float]]:
    """Return a pose (4, 4) [m] as ``position_m`` and ``quaternion_xyzw``."""
    wxyz = quaternion_of(pose[:3, :3])
    return {"position_m": pose[:3, 3].tolist(), "quaternion_xyzw": np.roll(wxyz, -1).tolist()}


def pose_from_dict(values: Mapping[str, Any]) -> np.ndarray:
    """Return the pose (4, 4) [m] from the result of `pose_as_dict`.

    Raises:
        KeyError, TypeError, ValueError: if it does not describe a pose.
    """
    position, quaternion = (
        np.array(values[name], dtype=float) for name in ("position_m", "quaternion_xyzw")
    )
    if (
        position.shape != (3,)
        or quaternion.shape != (4,)
        or not abs(np.linalg.norm(quaternion) - 1) < 1e-6
    ):
        raise ValueError("pose")
    return pose_at(position, quaternion)


def pose_at(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) at a position (3,), turned by a quaternion (4,), w last."""
    pose = np.eye(4)
    pose[:3, :3] = matrix_of(np.roll(quaternion / np.linalg.norm(quaternion), 1))
    pose[:3, 3] = position
    return pose


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
        numbers: the same as views of Python's own, by name: one number is read and written faster.
        results: all outputs, one after the other.
        slices: slices of `results`, by the name of the output.
        outputs: views of `results`, by name.
        evaluate: calls the function. It uses the memory of this object, so keep this object
            too.
    """

    def __init__(self, function: ca.Function) -> None:
        """Allocate the arrays."""
        self._function = function
        self.places = slices({n: function.nnz_in(i) for i, n in enumerate(function.name_in())})
        self.given = np.zeros(function.nnz_in())
        self.inputs = {name: self.given[part] for name, part in self.places.items()}
        self.numbers: dict[str, Any] = {name: part.data for name, part in self.inputs.items()}
        self.slices = slices({n: function.nnz_out(i) for i, n in enumerate(function.name_out())})
        self.results = np.zeros(function.nnz_out())
        self.outputs = {name: self.results[part] for name, part in self.slices.items()}
        self._buffer, self.evaluate = _bound(function, self.inputs.values(), self.outputs.values())

    def replace(self, function: ca.Function) -> None:
        """Call another function of the same inputs and outputs from now on, with these arrays.

        What `evaluate` was before stays usable.
        """
        if function is self._function:
            return
        self._before, self._function = self._buffer, function
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


def slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Return the slices of named parts that follow each other, from the size of each."""
    ends = zip(sizes.items(), accumulate(sizes.values()), strict=True)
    return {name: slice(end - size, end) for (name, size), end in ends}


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
