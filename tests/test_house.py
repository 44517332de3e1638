"""The shape of the package is seen however one file names another."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.house import house


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("import ergoqp.step.stepper", {"ergoqp.step.stepper"}),
        ("from ergoqp.step import stepper", {"ergoqp.step.stepper"}),
        ("from ergoqp.step.stepper import Stepper", {"ergoqp.step.stepper"}),
        ("from ..step import stepper", {"ergoqp.step.stepper"}),
        ("from ..step.stepper import Stepper", {"ergoqp.step.stepper"}),
        ("from .. import step", {"ergoqp.step"}),
        ("from .keep_out import KeepOut", {"ergoqp.limits.keep_out"}),
        ("from . import keep_out", {"ergoqp.limits.keep_out"}),
        ("import_module('ergoqp.step.stepper')", {"ergoqp.step.stepper"}),
        ("importlib.import_module(name='ergoqp.step')", {"ergoqp.step"}),
        ("import_module('..step.stepper', __package__)", {"ergoqp.step.stepper"}),
        ("import_module('.keep_out', package=__package__)", {"ergoqp.limits.keep_out"}),
        ("__import__('ergoqp.step.stepper')", {"ergoqp.step.stepper"}),
        ("K = 'ergoqp.step.stepper:Stepper'\nimport_module(K[:19])", {"ergoqp.step.stepper"}),
        ("told = '.'\nimport_module(told + 'x')", set()),
        ("told = 'ergoqp.step.stepper'", set()),
        ("import_module('json')\nfrom . import other\nfrom os import path", {"ergoqp.limits"}),
        ("if False:\n    from ..step import stepper", {"ergoqp.step.stepper"}),
    ],
)
def test_whom_a_file_imports(line: str, found: set[str], tmp_path: Path) -> None:
    names = ["ergoqp", "ergoqp.step", "ergoqp.step.stepper", "ergoqp.limits", "ergoqp.limits.own"]
    files = {name: tmp_path / name / "none.py" for name in [*names, "ergoqp.limits.keep_out"]}
    for name, path in files.items():
        path.parent.mkdir()
        path.write_text(line if name == "ergoqp.limits.own" else "", encoding="utf-8")
    assert house.imports(files)["ergoqp.limits.own"] == found


def test_a_package_imports_from_itself(tmp_path: Path) -> None:
    files = {"ergoqp.limits": tmp_path / "__init__.py", "ergoqp.limits.own": tmp_path / "own.py"}
    files["ergoqp.limits"].write_text("from .own import Own", encoding="utf-8")
    files["ergoqp.limits.own"].write_text("", encoding="utf-8")
    assert house.imports(files)["ergoqp.limits"] == {"ergoqp.limits.own"}


@pytest.mark.slow
def test_the_package_has_no_circle_climb_or_long_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert house.check() == 0
    assert (
        capsys.readouterr().out
        == "no circle, no climb, no import of others by the core, no long file or line\n"
    )
