"""The C compiler of this machine, used for shared libraries."""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

from ergoqp.errors import ErgoqpError
from ergoqp.paths import cache_folder

FLAGS: Final = (
    "-O3",
    "-fPIC",
    "-shared",
    "-w",
    # Arithmetic without errno and signals, and inlining of small functions that could be replaced
    # at load time: this saves a third of the time. No contraction to fused operations, so that the
    # arithmetic is that of the interpreted step.
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-semantic-interposition",
    "-ffp-contract=off",
)


class CompilerError(ErgoqpError):
    """There is no C compiler, or the compilation failed.

    Example:
        >>> from ergoqp.errors import ErgoqpError
        >>> from ergoqp.native.compiler import CompilerError
        >>> issubclass(CompilerError, ErgoqpError)
        True
    """


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
    raise CompilerError(
        f"C compiler: got {got}, allowed one that is installed, for example gcc, or named in CC"
    )


def shared_library(
    name: str, sources: dict[str, str], archives: Sequence[Path], includes: Sequence[Path]
) -> Path:
    """Return the shared library of C sources, compiled once and kept in the user's cache.

    The key in the cache covers everything that goes in.

    Args:
        name: name of the library, a word.
        sources: text by file name; files that end in ``.c`` are compiled, the others can be
            included.
        archives: static libraries to link.
        includes: folders of headers.

    Raises:
        CompilerError: if there is no compiler, or it fails; with its first error.
    """
    command = compiler()
    parts = [*command, _version(command), platform.machine(), *FLAGS]
    parts += [text for pair in sorted(sources.items()) for text in pair]
    key = hashlib.sha256("\0".join(parts).encode())
    for archive in archives:
        key.update(archive.read_bytes())
    cache = cache_folder() / "compiled"
    folder = cache / key.hexdigest()[:32]
    try:
        if (kept := _whole(folder, name)) is not None:
            return kept
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as scratch:
            for file, text in sources.items():
                (Path(scratch) / file).write_text(text, encoding="utf-8")
            units = [file for file in sources if file.endswith(".c")]
            folders = [f"-I{each}" for each in (scratch, *includes)]
            _run(
                [*command, *FLAGS, *folders, *units, *map(str, archives), "-lm", "-o", "out.so"],
                scratch,
            )
            made = Path(scratch) / "out.so"
            if not made.is_file() or not made.stat().st_size:
                raise CompilerError(
                    f"C compiler: got {shlex.join(command)!r}, which wrote no library, allowed a C"
                    " compiler"
                )
            path = folder / f"{name}-{_digest(made)}.so"
            folder.mkdir(exist_ok=True)
            # Renaming is atomic: another process finds the whole library or none.
            made.replace(path)
    except OSError as error:
        raise CompilerError(
            f"compiled step: got {error.strerror or error} in the cache {str(cache)!r}, allowed a"
            " folder with room that can be written to, below XDG_CACHE_HOME or ~/.cache"
        ) from None
    return path


def _whole(folder: Path, name: str) -> Path | None:
    """Return the library in a folder if its content is unchanged since it was written.

    Loading a truncated library would end the process.
    """
    for path in sorted(folder.glob(f"{name}-*.so")):
        if path.stem == f"{name}-{_digest(path)}":
            return path
        path.unlink()
    return None


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


@lru_cache(maxsize=4)
def _version(command: tuple[str, ...]) -> str:
    shown = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    return shown.stdout.splitlines()[0] if shown.stdout else "unknown"


def _run(command: list[str], folder: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [
            line for line in done.stderr.splitlines() if "error" in line.lower()
        ] or done.stderr.splitlines()
        raise CompilerError(
            f"C compiler {command[0]!r} failed: {lines[0].strip() if lines else 'without a word'}"
        )
