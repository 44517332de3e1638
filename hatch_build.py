"""A wheel with compiled steps, if the environment says ``ERGOQP_BUILD_LIBRARIES=1``."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class LibrariesHook(BuildHookInterface):
    """Compiles the libraries of `tools.libraries`, and puts them into a wheel for this machine."""

    def dependencies(self) -> list[str]:
        """Return what compiling needs: the package's own dependencies."""
        if not self._wanted():
            return []
        text = (Path(self.root) / "pyproject.toml").read_text(encoding="utf-8")
        return tomllib.loads(text)["project"]["dependencies"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the libraries to a wheel; an editable one has none."""
        if not self._wanted() or version == "editable":
            return
        folder = Path(self.root) / "out" / "libraries"
        command = [sys.executable, "-m", "tools.libraries", "--out", str(folder)]
        subprocess.run(command, cwd=self.root, check=True)
        build_data["pure_python"] = False
        if sys.platform == "linux":
            build_data["tag"] = f"py3-none-manylinux_2_28_{platform.machine()}"
        else:
            build_data["infer_tag"] = True
        for path in sorted(folder.iterdir()):
            build_data["force_include"][str(path)] = f"ergoqp/libraries/{path.name}"

    def _wanted(self) -> bool:
        return self.target_name == "wheel" and os.environ.get("ERGOQP_BUILD_LIBRARIES") == "1"
