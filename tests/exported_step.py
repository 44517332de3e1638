"""An exported step as a library, and its wrapper for Python."""

from __future__ import annotations

import importlib.util
import subprocess
from pathlib import Path
from types import ModuleType

SOURCES = ("src/ergoqp_core.c", "src/ergoqp_step.c", "src/ergoqp_names.c", "src/qp.c")
_FLAGS = ("-std=c99", "-Wall", "-O1", "-shared", "-fPIC", "-ffp-contract=off")


def build(folder: Path) -> Path:
    """Compile an export; return the shared library."""
    library = folder / "libergoqp_step.so"
    folders = [f"-I{name}" for name in ("include", "src", "daqp/include")]
    command = ["gcc", *_FLAGS, *folders, *SOURCES, "daqp/lib/libdaqpstat.a", "-lm", "-o"]
    subprocess.run([*command, str(library)], cwd=folder, check=True, capture_output=True)
    return library


def load_wrapper(folder: Path, prefix: str = "ergoqp") -> ModuleType:
    """Return the module that the export has for Python."""
    file = folder / f"python/{prefix}_step.py"
    spec = importlib.util.spec_from_file_location("exported_step", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
