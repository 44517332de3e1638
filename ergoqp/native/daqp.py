"""DAQP as C: its library and headers from CasADi, and the functions of the compiled step."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import casadi as ca

from ergoqp.native.compiler import CompilerError, shared_library
from ergoqp.solvers.daqp import Daqp

_HERE = Path(__file__).resolve().parent / "c"


class NativeDaqp(Daqp):
    """DAQP for C code: the algorithm of `ergoqp.solvers.daqp`, in memory that the step provides.

    Its settings are the same; they are in ``c/qp_daqp.h``.

    Attributes:
        sizes: the sizes (unknowns, rows) that were asked for.
    """

    def __init__(self) -> None:
        """Start without a size."""
        self.sizes: list[tuple[int, int]] = []

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver for `n` unknowns and `m` rows; see `ergoqp.solvers.solver`.

        Raises:
            CompilerError: if there is no C compiler or no DAQP library.
        """
        if (n, m) not in self.sizes:
            self.sizes.append((n, m))
        name = qp_name(n, m)
        sources = {
            f"{name}.c": sizes_source([(n, m)], described=True),
            "qp_daqp.h": c_text("qp_daqp.h"),
        }
        library = shared_library(name, sources, [daqp_archive()], [daqp_include()])
        return ca.external(name, str(library))


def qp_name(n: int, m: int) -> str:
    """Return the C name of the solver of a size."""
    return f"ergoqp_qp_{n}_{m}"


def c_text(name: str) -> str:
    """Return one of the C files that come with the package."""
    return (_HERE / name).read_text(encoding="utf-8")


def daqp_archive() -> Path:
    """Return DAQP's static library.

    Raises:
        CompilerError: if this installation of CasADi does not have it.
    """
    path = _casadi() / "libdaqpstat.a"
    if not path.is_file():
        raise CompilerError(
            "DAQP as C: got a CasADi without libdaqpstat.a, allowed one with it, as the wheels for"
            " Linux"
        )
    return path


def daqp_include() -> Path:
    """Return the folder of DAQP's headers."""
    return _casadi() / "include"


def daqp_licence() -> str:
    """Return the text of DAQP's licence.

    Raises:
        CompilerError: if the installed package daqp does not contain it.
    """
    try:
        found = [file for file in files("daqp") or [] if file.name == "LICENSE"]
    except PackageNotFoundError:
        found = []
    if not found:
        raise CompilerError(
            "DAQP's licence: got no LICENSE in the package 'daqp', allowed: `pip install daqp` as"
            " published"
        )
    return found[0].read_text(encoding="utf-8")


def sizes_source(sizes: list[tuple[int, int]], described: bool = False) -> str:
    """Return C functions that solve QPs of these sizes, in CasADi's calling convention.

    Args:
        sizes: (unknowns, rows) of each.
        described: whether to add what CasADi needs of a function that it loads: numbers and shapes
            of arguments, size of the memory.
    """
    parts = ['#include "qp_daqp.h"\n']
    for n, m in sizes:
        parts.append(_solver_source(n, m))
        if described:
            parts.append(_description_source(n, m))
    return "\n".join(parts)


def _solver_source(n: int, m: int) -> str:
    return f"""int {qp_name(n, m)}(const double** arg, double** res, casadi_int* iw, double* w,
    int mem) {{
    int marks[ERGOQP_QP_MARKS({n}, {m})];
    (void)iw;
    (void)mem;
    return ergoqp_qp_daqp({n}, {m}, arg, res, w, marks);
}}
"""


def _description_source(n: int, m: int) -> str:
    name = qp_name(n, m)
    into = ((n, n), (n, 1), (m, n), (m, 1), (m, 1), (n, 1), (n, 1))
    out = ((n, 1), (m, 1), (n, 1))
    return f"""casadi_int {name}_n_in(void) {{ return {len(into)}; }}
casadi_int {name}_n_out(void) {{ return {len(out)}; }}
{_shapes_source(f"{name}_sparsity_in", into)}
{_shapes_source(f"{name}_sparsity_out", out)}
int {name}_work(casadi_int* arg, casadi_int* res, casadi_int* iw, casadi_int* w) {{
    *arg = {len(into)};
    *res = {len(out)};
    *iw = 0;
    *w = ERGOQP_QP_DOUBLES({n}, {m});
    return 0;
}}
"""


def _shapes_source(name: str, shapes: tuple[tuple[int, int], ...]) -> str:
    # A dense matrix in CasADi's notation: rows, columns, 1.
    table = ", ".join(f"{{{rows}, {columns}, 1}}" for rows, columns in shapes)
    return f"""const casadi_int* {name}(casadi_int i) {{
    static const casadi_int shapes[][3] = {{{table}}};
    return i >= 0 && i < {len(shapes)} ? shapes[i] : 0;
}}"""


def _casadi() -> Path:
    return Path(ca.__file__).resolve().parent
