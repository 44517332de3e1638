"""Problems from TOML files, with every mistake found at once.

Each comes with its key, what was found and what is allowed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from ergoqp.arguments import path_of, shown
from ergoqp.costs.learned import LearnedCost
from ergoqp.costs.load import load_cost
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError, InputError, ProblemError
from ergoqp.files.text import read_toml
from ergoqp.human import Body
from ergoqp.human.person_file import given_person
from ergoqp.joints import JOINTS
from ergoqp.limits import (
    ArmLength,
    AxisCone,
    Ball,
    Box,
    HalfSpace,
    JointLimit,
    KeepOut,
    OneClassBoundary,
    TwistLimit,
    WorkspaceBox,
)
from ergoqp.paths import data_folder
from ergoqp.problem.control import Control
from ergoqp.problem.problem import Problem
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.problem_files.keys import given_tables
from ergoqp.problem_files.mistakes import listed, mistakes, unusual
from ergoqp.problem_files.own_terms import build_own, file_table, own_tables
from ergoqp.problem_files.tables import (
    FileTable,
    JointsTable,
    PointSpeedTable,
    ResponseTable,
    SmoothRebaTable,
    TaskTable,
    TwistTable,
)
from ergoqp.responses import IkResponse, LinearResponse, Response
from ergoqp.sheets.reba import Method
from ergoqp.sheets.task import TaskOptions


def _point_speed(speed: float, acceleration: float) -> TwistLimit:
    """Bounds on the velocities of two points, which are the six entries of the twist: all alike."""
    return TwistLimit(speed, speed, acceleration, acceleration)


_REGIONS: Final = {"half_space": HalfSpace, "ball": Ball, "box": Box}


def _keep_out(name: str, tolerance: float, recovery_time: float, **regions: Any) -> KeepOut:
    """A region that the contact point stays out of; of `_REGIONS` exactly one is given."""
    kind, values = next((kind, values) for kind, values in regions.items() if values is not None)
    return KeepOut(_REGIONS[kind](**values), tolerance, recovery_time, name)


def _ik(folder: Path, stature: float | None, person: str | None, **keys: Any) -> IkResponse:
    """Return a person who follows: of average proportions, or of a person file."""
    if person is None:
        return IkResponse(body=Body() if stature is None else Body.of_stature(stature), **keys)
    return IkResponse(body=given_person(folder / person if person else person), **keys)


def _points(folder: Path) -> LinearResponse:
    """Return elbow and wrist that follow; their file needs no folder."""
    return LinearResponse()


@dataclass(frozen=True)
class _Given:
    """What a file says beside a cost's own table.

    Attributes:
        file: the whole file.
        sheet: the options that the sheet is read with, the method among them.
        folder: that paths are relative to.
    """

    file: FileTable
    sheet: dict[str, Any]
    folder: Path


def _smooth_reba(given: _Given, **keys: Any) -> SmoothReba:
    """Return the sheet, as the task has it, made smooth."""
    return SmoothReba(**keys, **given.sheet)


def _learned(given: _Given, model: str) -> LearnedCost:
    """Return the cost that a file holds."""
    # What a cost has learned it knows: other options than those of its data would be silently
    # ignored.
    if given.file.task != TaskTable():
        raise ProblemError(
            "cost.learned: got options in [task], allowed none: the cost was learned without them"
        )
    return load_cost(find_model(model, given.folder))


# Registration: one line per kind of term; the table's fields are the keyword arguments.
COSTS: Final[dict[str, Callable[..., Any]]] = {
    "smooth_reba": _smooth_reba,
    "learned": _learned,
}
"""Costs by the names of their tables; each takes first what else the file says."""

RESPONSES: Final[dict[str, Callable[..., Response]]] = {"ik": _ik, "points": _points}
"""Responses by the names of their tables; each takes first what paths are relative to."""

LIMITS: Final[dict[str, Callable[..., Any]]] = {
    "twist": TwistLimit,
    "joints": JointLimit,
    "workspace": WorkspaceBox,
    "tool_axis": AxisCone,
    "keep_out": _keep_out,
    "point_speed": _point_speed,
    "arm_length": ArmLength,
    "one_class_boundary": OneClassBoundary,
}
"""Limits by the names of their tables."""

TASKS: Final = ("dentist", "desk", "low_bin", "overhead", "screwing")
"""The problems of a person and the sheet itself: what all figures of closed loops are about."""


def problem_names() -> list[str]:
    """Return the names of all problems that come with the package."""
    return sorted(path.stem for path in data_folder("problems").glob("*.toml"))


def load_problem(name: str | Path) -> Problem:
    """Return a problem by its name in ``problems/`` or by the path of a TOML file.

    Raises:
        ProblemError: if there is no such problem, or the file is not one; the message lists every
            mistake.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> problem.name, problem.dt
        ('screwing', 0.01)
        >>> len(problem.row_names)
        36
    """
    path = _find(path_of("problem", name, ProblemError))
    try:
        raw = read_toml(path, "problem")
    except InputError as error:
        raise ProblemError(str(error)) from None
    return problem_from_dict(raw, path.stem, path.parent)


def problem_from_dict(raw: dict[str, Any], name: str, folder: Path | None = None) -> Problem:
    """Return the problem that a parsed file describes.

    Args:
        raw: the file's tables.
        name: of the problem.
        folder: that paths of models are relative to; None: the current one.

    Raises:
        ProblemError: listing every mistake.
    """
    try:
        table = file_table(raw)
    except InputError as error:
        raise ProblemError(f"{name}: {error}") from None
    try:
        file = table.model_validate(raw)
    except ValidationError as error:
        raise ProblemError(listed(name, mistakes(table, error))) from None
    if found := unusual(raw, file.unusual):
        raise ProblemError(listed(name, found))
    try:
        return _build(file, name, folder or Path())
    except ErgoqpError as error:
        raise ProblemError(f"{name}: {error}") from None
    except TypeError as error:
        raise ProblemError(f"{name}: {error}") from None


def _build(file: FileTable, name: str, folder: Path) -> Problem:
    response = _response(file.response, folder)
    # Who sits is scored as one who sits: one key, not two.
    seated = getattr(response, "stance", None) == "seated"
    task = file.task.model_dump() | {"seated": seated}
    method = Method(**task.pop("method"))
    return Problem(
        cost=_cost(file, {**task, "method": method}, folder),
        response=response,
        limits=_limits(file, folder, tuple(response.coordinates) == JOINTS),
        dt=file.dt,
        control=Control(**file.control.model_dump()),
        robot=DeclaredRobot(**file.robot.model_dump()),
        task=TaskOptions(**task),
        method=method,
        name=name,
        title=file.title or name,
    )


def _response(table: ResponseTable, folder: Path) -> Response:
    for name, own in own_tables(table).items():
        return build_own("response", name, own)
    ((name, keys),) = given_tables(table).items()
    return RESPONSES[name](folder, **keys.model_dump())


def _cost(file: FileTable, sheet: dict[str, Any], folder: Path) -> Any:
    for name, own in own_tables(file.cost).items():
        return build_own("cost", name, own)
    ((name, keys),) = (given_tables(file.cost) or {"smooth_reba": SmoothRebaTable()}).items()
    return COSTS[name](_Given(file, sheet, folder), **keys.model_dump())


def _limits(file: FileTable, folder: Path, of_person: bool) -> list[Any]:
    own = own_tables(file.limits)
    limits = file.limits.model_dump(exclude_none=True, include=set(LIMITS))
    if of_person:
        # A person always has joints, and an object always a largest speed.
        limits = {"twist": TwistTable().model_dump(), "joints": JointsTable().model_dump()} | limits
    elif "point_speed" not in limits:
        limits["point_speed"] = PointSpeedTable().model_dump()
    if "one_class_boundary" in limits:
        from ergoqp.learning.one_class import load_one_class

        boundary = limits["one_class_boundary"]
        boundary["model"] = load_one_class(find_model(boundary["model"], folder))
    listed = {kind: one if isinstance(one, list) else [one] for kind, one in limits.items()}
    made = [
        _limit(kind, values, f"limits.{kind}.{i}" if isinstance(limits[kind], list) else kind)
        for kind, several in listed.items()
        for i, values in enumerate(several)
    ]
    return [*made, *(build_own("limits", name, table) for name, table in own.items())]


def _limit(kind: str, values: dict[str, Any], where: str) -> Any:
    """Make a limit; of several of a kind, a mistake says which."""
    try:
        return LIMITS[kind](**values)
    except InputError as error:
        words = str(error)
        if words.startswith(kind):
            words = f"{where}{words.removeprefix(kind)}"
        raise InputError(words) from None


def find_model(name: str, folder: Path) -> Path:
    """Return the file of a learned model.

    It is found by its name in ``models/``, or by a path of a .npz file relative to `folder`.

    Raises:
        ProblemError: if there is none.
    """
    path = data_folder("models") / f"{name}.npz" if not name.endswith(".npz") else folder / name
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in data_folder("models").glob("*.npz")))
        raise ProblemError(
            f"model: got {name!r}, allowed {known or 'none that came with the package'} or the path"
            " of a .npz file"
        )
    return path


def _find(name: str | Path) -> Path:
    path = Path(name)
    try:
        return _found(path, str(name))
    except OSError as error:
        raise ProblemError(
            f"problem: got {shown(str(name))}: {error.strerror}, allowed the path of a .toml file"
        ) from None


def _found(path: Path, name: str) -> Path:
    if path.suffix != ".toml" and len(path.parts) == 1:
        path = data_folder("problems") / f"{name}.toml"
        if not path.is_file():
            raise ProblemError(
                f"problem: got {name!r}, allowed {', '.join(problem_names())} or the path of a"
                " .toml file"
            )
    elif not path.is_file():
        raise ProblemError(
            f"problem: {name!r} is {'a directory' if path.is_dir() else 'not there'}, allowed a"
            " .toml file"
        )
    return path
