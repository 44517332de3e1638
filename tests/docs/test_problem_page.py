"""The tables of the page on problem files say what the declarations of the parameters say."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from ergoqp.arguments import Range
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.limits import (
    ArmLength,
    AxisCone,
    JointLimit,
    KeepOut,
    OneClassBoundary,
    TwistLimit,
    WorkspaceBox,
)
from ergoqp.problem.schema import TaskTable, point_speed
from ergoqp.problem.settings import Control, DeclaredRobot
from ergoqp.responses import IkResponse
from ergoqp.sheets.options import Method

PAGE = Path(__file__).resolve().parents[2] / "docs" / "problem.md"
DECLARED = {
    "response.ik": IkResponse,
    "cost.smooth_reba": SmoothReba,
    "task": TaskTable,
    "task.method": Method,
    "limits.twist": TwistLimit,
    "limits.joints": JointLimit,
    "limits.workspace": WorkspaceBox,
    "limits.tool_axis": AxisCone,
    "limits.keep_out": KeepOut,
    "limits.one_class_boundary": OneClassBoundary,
    "limits.point_speed": point_speed,
    "limits.arm_length": ArmLength,
    "robot": DeclaredRobot,
    "control": Control,
}
NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"


def rows() -> Iterator[tuple[str, str, dict[str, str]]]:
    """Table, key and cells by the head of their column, of each row."""
    table, head = "", []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("#"):
            table, head = (re.findall(r"`\[+([\w.]+)\]+`", line) or [""])[0], []
        elif not line.startswith("|"):
            head = []
        elif not head:
            head = cells
        elif "key" in head and table in DECLARED and "`" in cells[0]:
            for i, key in enumerate(re.findall(r"`([\w.]+)`", cells[0])):
                own = dict(zip(head, cells, strict=True))
                if cells[0].count("`") > 2 and "," in own.get("default", ""):
                    own["default"] = own["default"].split(", ")[i]
                *_, where, name = f"{table}.{key}".split(".")
                yield f"limits.{where}" if "." in key else table, name, own


def declared(table: str, key: str) -> tuple[Any, Range | None]:
    """The default of a parameter and its range, if it is a number or a table of numbers."""
    term = DECLARED[table]
    default = inspect.signature(term).parameters[key].default
    hint = (
        get_type_hints(term, include_extras=True).get(key)
        or get_type_hints(term.__init__, include_extras=True)[key]
    )
    return default, next(ranges(hint), None)


def ranges(hint: Any) -> Iterator[Range]:
    """All ranges within a type."""
    for part in (*getattr(hint, "__metadata__", ()), *get_args(hint)):
        if isinstance(part, Range):
            yield part
        else:
            yield from ranges(part)


OF_FILES = {"stature", "person", "ball", "box", "half_space"}
"""Keys from which a file makes a body or a region."""
ROWS = [pytest.param(*row, id=f"{row[0]}.{row[1]}") for row in rows() if row[1] not in OF_FILES]


def test_there_are_rows() -> None:
    assert len(ROWS) > 90


@pytest.mark.parametrize(("table", "key", "cells"), ROWS)
def test_a_row_says_what_is_declared(table: str, key: str, cells: dict[str, str]) -> None:
    default, allowed = declared(table, key)
    if re.fullmatch(NUMBER, cells["default"]) and isinstance(default, int | float):
        assert float(cells["default"]) == default
    if cells["default"] == "required":
        assert default is inspect.Parameter.empty
    if allowed is None:
        return
    if allowed.unit and "unit" in cells:
        assert cells["unit"].replace("²", "^2") == allowed.unit
    said, _, usual = cells.get("allowed", "").partition(" (usual ")
    if ends := re.fullmatch(rf"({NUMBER}) to ({NUMBER})", said):
        assert (float(ends[1]), float(ends[2])) == (allowed.low, allowed.high)
    elif said.startswith(("above 0", "at least 0")):
        assert 0 <= allowed.low <= 1e-6
    usual = cells.get("usual") or usual.rstrip(")")
    if ends := re.fullmatch(rf"({NUMBER}) to ({NUMBER})", usual):
        assert (float(ends[1]), float(ends[2])) == allowed.usual
    elif allowed.usual is not None:
        assert usual == f"to {allowed.usual[1]:g}"
