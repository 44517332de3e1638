"""CasADi functions as machine code: generated, compiled once with DAQP, kept in the cache."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any, Final

import casadi as ca

from ergoqp.errors import ErgoqpError, last_line
from ergoqp.native.cache import Entry, locked, private_folder, remember, remembered
from ergoqp.native.content import content_key
from ergoqp.registry import cache_folder
from ergoqp.solvers.daqp import Daqp
from ergoqp.solvers.solver import Shapes, shapes_of

FLAGS: Final = (
    "-O3",
    "-fPIC",
    "-shared",
    "-w",
    # Whatever CC says: numbers that are none have to be seen.
    "-fno-fast-math",
    # Arithmetic without errno and signals, and inlining of small functions that could be replaced
    # at load time: this saves a third of the time. No contraction to fused operations, so that the
    # arithmetic is that of the interpreted step.
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-semantic-interposition",
    "-ffp-contract=off",
    # The compiler tidies up its memory earlier: half of the memory for a few percent of the time.
    "--param",
    "ggc-min-expand=50",
    "--param",
    "ggc-min-heapsize=65536",
)

V3: Final = {"avx2": "-mavx2", "bmi1": "-mbmi", "bmi2": "-mbmi2", "fma": "-mfma"}
"""What the third level of x86-64 has more, as processors name it and as compilers do.

It takes a quarter of the time off a step. Without contraction the answers are the same to the bit.
"""

PROGRAM_FLAGS: Final = ("-std=c99", "-O2", "-w")
"""Flags of a program."""


class CompilerError(ErgoqpError):
    """There is no C compiler, or the compilation failed.

    Example:
        >>> from ergoqp.errors import ErgoqpError
        >>> from ergoqp.native.compiled import CompilerError
        >>> issubclass(CompilerError, ErgoqpError)
        True
    """


@lru_cache(maxsize=1)
def processor_flags() -> tuple[str, ...]:
    """Return the compiler's flags for the processor of this machine, for what runs only here."""
    return tuple(V3.values()) if set(V3) <= set(abilities()) else ()


@lru_cache(maxsize=1)
def abilities() -> tuple[str, ...]:
    """Return what the processor of this machine can, in the words of Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ()
    return next((tuple(line.split()) for line in lines if line.startswith("flags")), ())


@lru_cache(maxsize=1)
def compiler() -> tuple[str, ...]:
    """Return the command of the C compiler.

    It is the environment variable CC, or the first of cc, gcc and clang.

    Raises:
        CompilerError: if there is no C compiler.
    """
    chosen = os.environ.get("CC")
    for command in [chosen] if chosen else ["cc", "gcc", "clang"]:
        try:
            words = shlex.split(command)
        except ValueError:  # an unclosed quotation
            words = []
        if words and shutil.which(words[0]):
            return tuple(words)
    got = f"CC={chosen!r}, which is not a program here" if chosen else "none of cc, gcc, clang"
    raise CompilerError(f"C compiler: found {got}; install one, for example gcc, or name it in CC")


def shared_library(
    name: str,
    sources: dict[str, str],
    archives: Sequence[Path],
    includes: Sequence[Path],
    build: bool = True,
) -> Path:
    """Return the shared library of C sources, compiled once and kept in the user's cache.

    The key in the cache covers everything that goes in.

    Args:
        name: name of the library, a word.
        sources: text by file name; files that end in ``.c`` are compiled, the others can be
            included.
        archives: static libraries to link.
        includes: folders of headers.
        build: whether it is compiled if the cache lacks it.

    Raises:
        CompilerError: if there is no compiler, or it fails, with its first error; or if it is not
            in the cache and not to be built.
    """
    return _built(name, sources, archives, includes, (*FLAGS, *processor_flags()), ".so", build)


def loaded(library: Path) -> ctypes.CDLL:
    """Return a shared library of `shared_library`.

    Raises:
        CompilerError: if this machine cannot load it.
    """
    try:
        return ctypes.CDLL(str(library))
    except OSError as error:
        raise CompilerError(
            f"compiled {library.name}: it cannot be loaded: {last_line(error)}; name a C compiler"
            " for this machine in CC, and a cache from which programs may run in XDG_CACHE_HOME"
        ) from None


def program(name: str, sources: dict[str, str]) -> Path:
    """Return the program of C sources, compiled once and kept in the user's cache.

    Args:
        name: name of the program, a word.
        sources: as for `shared_library`.

    Raises:
        CompilerError: if there is no compiler, or it fails; with its first error.
    """
    return _built(name, sources, (), (), PROGRAM_FLAGS, ".run")


def _built(
    name: str,
    sources: dict[str, str],
    archives: Sequence[Path],
    includes: Sequence[Path],
    flags: Sequence[str],
    ending: str,
    build: bool = True,
) -> Path:
    command = compiler()
    parts = [*command, _version(command), platform.machine(), *flags]
    parts += [text for pair in sorted(sources.items()) for text in pair]
    key = hashlib.sha256("\0".join(parts).encode())
    for archive in archives:
        key.update(archive.read_bytes())
    entry = Entry(key.hexdigest()[:32], name, ending)

    def make(scratch: Path) -> Path:
        return compile_in(scratch, sources, archives, includes, flags)

    with _cache(name):
        if (path := entry.find()) is not None:
            return path
        if not build:
            raise CompilerError(f"compiled {name}: it is not in the cache")
        return entry.build(make)


def compile_in(
    scratch: Path,
    sources: dict[str, str],
    archives: Sequence[Path],
    includes: Sequence[Path],
    flags: Sequence[str],
) -> Path:
    """Return the file that the compiler makes of sources in an empty folder.

    Raises:
        CompilerError: if there is no compiler, or it fails; with its first error.
    """
    command = compiler()
    for file, text in sources.items():
        (scratch / file).write_text(text, encoding="utf-8")
    units = [file for file in sources if file.endswith(".c")]
    folders = [f"-I{each}" for each in (scratch, *includes)]
    _run([*command, *flags, *folders, *units, *map(str, archives), "-lm", "-o", "made"], scratch)
    made = scratch / "made"
    if not made.is_file() or not made.stat().st_size:
        raise CompilerError(
            f"C compiler: {shlex.join(command)!r} wrote no file; name a C compiler in CC"
        )
    return made


@contextmanager
def _cache(name: str) -> Iterator[None]:
    """Say in one sentence why the cache cannot be used for what has a name."""
    try:
        yield
    except OSError as error:
        raise CompilerError(
            f"compiled {name}: the cache {str(cache_folder() / 'compiled')!r} cannot be used:"
            f" {error.strerror or error}; give a folder of your own with room in XDG_CACHE_HOME"
        ) from None


@lru_cache(maxsize=4)
def _version(command: tuple[str, ...]) -> str:
    shown = _done([*command, "--version"])
    return shown.stdout.splitlines()[0] if shown.stdout else "unknown"


def _done(command: list[str], folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        raise CompilerError(
            f"C compiler {command[0]!r} cannot be run: {error.strerror}; name a C compiler in CC"
        ) from None


def _run(command: list[str], folder: Path) -> None:
    done = _done(command, folder)
    if done.returncode:
        lines = [
            line for line in done.stderr.splitlines() if "error" in line.lower()
        ] or done.stderr.splitlines()
        raise CompilerError(
            f"C compiler {command[0]!r} failed: {lines[0].strip() if lines else 'without a word'}"
        )


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

    def active_set(self, n: int, m: int) -> ca.Function:
        """Return DAQP for `n` unknowns and `m` rows; see `ergoqp.solvers.solver`.

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
        return _loaded(name, sources)


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


def licence_of(package: str) -> str:
    """Return the text of an installed package's licence, or nothing if there is none."""
    try:
        found = [file for file in files(package) or [] if file.name == "LICENSE"]
    except PackageNotFoundError:
        return ""
    return found[0].read_text(encoding="utf-8") if found else ""


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
    into, out = shapes_of(n, m)
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


def _shapes_source(name: str, shapes: Shapes) -> str:
    # A dense matrix in CasADi's notation: rows, columns, 1.
    table = ", ".join(f"{{{rows}, {columns}, 1}}" for rows, columns in shapes)
    return f"""const casadi_int* {name}(casadi_int i) {{
    static const casadi_int shapes[][3] = {{{table}}};
    return i >= 0 && i < {len(shapes)} ? shapes[i] : 0;
}}"""


def _casadi() -> Path:
    return Path(ca.__file__).resolve().parent


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
    return _loaded(*sources_of(build))


def sources_of(build: Callable[[NativeDaqp], ca.Function]) -> tuple[str, dict[str, str]]:
    """Return the name of a function and its C sources by file name, see `compiled`."""
    compiler()
    solver = NativeDaqp()
    function = build(solver)
    name = function.name()
    return name, {
        f"{name}.c": '#include "inline.h"\n' + generated(function, name)[f"{name}.c"],
        "qp.c": sizes_source(solver.sizes),
        "inline.h": c_text("inline.h"),
        "qp_daqp.h": c_text("qp_daqp.h"),
    }


_LIBRARIES: Final[dict[int, tuple[ca.Function, Path]]] = {}
"""The functions that were loaded, kept so that their hash stays theirs, with their libraries."""


def library_of(function: ca.Function) -> Path | None:
    """Return the shared library of a compiled function; None if it is interpreted."""
    found = _LIBRARIES.get(hash(function))
    return None if found is None else found[1]


def _loaded(name: str, sources: dict[str, str]) -> ca.Function:
    return external(name, shared_library(name, sources, [daqp_archive()], [daqp_include()]))


def external(name: str, library: Path) -> ca.Function:
    """Return a function of a shared library.

    Raises:
        CompilerError: if this machine cannot load it.
    """
    try:
        function = ca.external(name, str(library))
        _LIBRARIES[hash(function)] = function, library
        return function
    except RuntimeError as error:
        raise CompilerError(
            f"compiled {name}: the library {str(library)!r} cannot be loaded: {last_line(error)}"
        ) from None


def short_key(*made_from: Any, any_compiler: bool = False) -> str | None:
    """Return a key of a compiled function, without building it; None: only its C code is one.

    Args:
        made_from: all that the package makes the function from.
        any_compiler: whether the key is the same whatever compiles, as it is without a compiler.
    """
    tool = list[str]()
    with suppress(CompilerError, OSError):
        if not any_compiler:
            files = shutil.which(compiler()[0]), daqp_archive()
            tool = [*compiler(), *map(_identity, files)]
    return content_key(*made_from, tool, FLAGS, processor_flags(), abilities())


def _identity(path: Any) -> str:
    """Return what changes when a file is replaced by another one."""
    found = os.stat(path)
    return f"{os.path.realpath(path)} {found.st_size} {found.st_mtime_ns} {found.st_ctime_ns}"


def found(name: str, key: str) -> ca.Function | None:
    """Return the function that was compiled under a short key; None if it is not in the cache.

    Raises:
        CompilerError: if others can write to the cache, or the library cannot be loaded.
    """
    with _cache(name):
        entry = remembered(key)
        library = None if entry is None else Entry(entry, name, ".so").find()
    return None if library is None else external(name, library)


@contextmanager
def one_at_a_time(name: str) -> Iterator[None]:
    """Wait until no other process of this user compiles in the background.

    Args:
        name: name of what is to be compiled.

    Raises:
        CompilerError: if the cache cannot be used.
    """
    with ExitStack() as stack:
        with _cache(name):
            folder = private_folder(make=True)
            assert folder is not None
            stack.enter_context(locked(folder / "background.lock"))
        yield


def keep(function: ca.Function, key: str) -> None:
    """Let a compiled function be `found` under a short key."""
    library = library_of(function)
    assert library is not None
    remember(key, library)


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
        # Products of matrices by the function of inline.h.
        plain, ours = "\n  casadi_mtimes_dense(", "\n  ergoqp_mtimes_dense("
        texts[f"{name}.c"] = texts[f"{name}.c"].replace(plain, ours)
        # The generator does not report that it cannot write.
        if not all(text.endswith("#endif\n") for text in texts.values()):
            raise CompilerError(
                f"C code: a file in {str(Path(folder).parent)!r} is cut off; give a folder with"
                " room"
            )
        return texts
