"""A function as native machine code: generated, compiled once, kept in the user's cache."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca

from ergoqp.native.compiler import CompilerError, compiler, shared_library
from ergoqp.native.daqp import NativeDaqp, c_text, daqp_archive, daqp_include, sizes_source


def compiled(build: Callable[[NativeDaqp], ca.Function]) -> ca.Function:
    """Return a function that solves QPs by DAQP as machine code.

    It gives the same answers in a fraction of the time.

    For a control step, the first compilation takes some ten seconds. Later the library is found in
    the cache by the content of its sources, the compiler and its flags.

    Args:
        build: function that takes the solver and returns the function, with every operation written
            on its own.

    Raises:
        CompilerError: if there is no C compiler, or it fails.
    """
    compiler()
    solver = NativeDaqp()
    function = build(solver)
    name = function.name()
    sources = {
        f"{name}.c": '#include "inline.h"\n' + generated(function, name)[f"{name}.c"],
        "qp.c": sizes_source(solver.sizes),
        "inline.h": c_text("inline.h"),
        "qp_daqp.h": c_text("qp_daqp.h"),
    }
    library = shared_library(name, sources, [daqp_archive()], [daqp_include()])
    try:
        return ca.external(name, str(library))
    except RuntimeError as error:
        raise CompilerError(
            f"compiled {name}: the library {str(library)!r} cannot be loaded: {_last_line(error)}"
        ) from None


def _last_line(error: Exception) -> str:
    return str(error).strip().splitlines()[-1]


def generated(function: ca.Function, name: str) -> dict[str, str]:
    """Return the C source and the header that CasADi writes for a function, by file name."""
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": True})
    generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(f"{folder}/")
        texts = {
            file: (Path(folder) / file).read_text(encoding="utf-8")
            for file in (f"{name}.c", f"{name}.h")
        }
        # The generator does not report that it cannot write.
        if not all(text.endswith("#endif\n") for text in texts.values()):
            raise CompilerError(
                f"C code: got a file that is cut off in {str(Path(folder).parent)!r}, allowed a"
                " folder with room"
            )
        return texts
