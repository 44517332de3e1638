"""Problems from TOML files.

Every mistake is reported with its key, what was found and what is allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from ergoqp.arguments import path_of, shown
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError, InputError, ProblemError
from ergoqp.files.read import read_toml
from ergoqp.human import Body
from ergoqp.human.person_file import given_person
from ergoqp.joints import JOINTS
from ergoqp.problem.messages import full_keys, listed, mistakes, unusual
from ergoqp.problem.problem import Problem
from ergoqp.problem.schema import LIMITS, TaskTable, build_own, file_table, given, own_tables
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.registry import data_folder
from ergoqp.responses import IkResponse, LinearResponse, Response
from ergoqp.sheets.options import TaskOptions
from ergoqp.sheets.reba import Method


def _ik(
    folder: Path, stature: float | None = None, person: str | None = None, **keys: Any
) -> IkResponse:
    """Return the response of a person: of average proportions, or from a person file."""
    if person is None:
        return IkResponse(body=Body() if stature is None else Body.of_stature(stature), **keys)
    return IkResponse(body=given_person(folder / person if person else person), **keys)


def _points(folder: Path) -> LinearResponse:
    """Return the response of elbow and wrist; it does not use the folder."""
    return LinearResponse()


def _gmr(folder: Path, model: str) -> Response:
    """Return the response that was learned from a recording."""
    from ergoqp.responses.gmr import GmrResponse

    return GmrResponse.load(find_model(model, folder))


def _smooth_reba(file: Any, sheet: dict[str, Any], folder: Path, **keys: Any) -> SmoothReba:
    """Return the smooth REBA score of the task."""
    return SmoothReba(**keys, **sheet)


def _learned(file: Any, sheet: dict[str, Any], folder: Path, model: str) -> Any:
    """Return the learned cost of a file."""
    # A learned cost has the options of its data. Other options would be silently ignored.
    if file.task != TaskTable():
        raise ProblemError(
            "cost.learned: got options in [task], allowed none: the cost was learned without them"
        )
    from ergoqp.costs.load import load_cost

    return load_cost(find_model(model, folder))


# Registration: one line per kind of term; the table's fields are the keyword arguments.
COSTS: Final[dict[str, Callable[..., Any]]] = {"smooth_reba": _smooth_reba, "learned": _learned}
"""Costs by the names of their tables.

The first arguments are the whole file, the options of the sheet including the method, and the
folder of relative paths.
"""

RESPONSES: Final[dict[str, Callable[..., Response]]] = {
    "ik": _ik,
    "points": _points,
    "gmr": _gmr,
}
"""Responses by the names of their tables. The first argument is the folder of relative paths."""

TASKS: Final = ("dentist", "desk", "low_bin", "overhead", "screwing")
"""The problems with a person and the smooth REBA score, used for all figures of closed loops."""


def problem_names() -> list[str]:
    """Return the names of all problems that come with the package."""
    return sorted(path.stem for path in data_folder("problems").glob("*.toml"))


def load_problem(name: str | Path) -> Problem:
    """Return a problem by its name in ``problems/`` or by the path of a TOML file.

    Raises:
        ProblemError: if there is no such problem, or the file is not one. The message lists every
            mistake of keys and values.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> problem.name, problem.dt
        ('screwing', 0.01)
        >>> len(problem.row_names)
        36
    """
    path = find_problem(path_of("problem", name, ProblemError))
    try:
        raw = read_toml(path, "problem")
    except InputError as error:
        raise ProblemError(str(error)) from None
    return problem_from_dict(raw, path.stem, path.parent)


def problem_from_dict(raw: dict[str, Any], name: str, folder: Path | None = None) -> Problem:
    """Return the problem that a parsed file describes.

    Args:
        raw: tables of the file.
        name: name of the problem.
        folder: folder that paths of models are relative to. None: the current folder.

    Raises:
        ProblemError: if the file has mistakes; the message lists every mistake of keys and values.
    """
    try:
        table = file_table(raw)
    except InputError as error:
        raise ProblemError(f"{name}: {error}") from None
    try:
        file = table.model_validate(raw)
    except ValidationError as error:
        raise ProblemError(listed(name, mistakes(table, error))) from None
    if found := unusual(table, raw, file.unusual):
        raise ProblemError(listed(name, found))
    try:
        return _build(file, name, folder or Path())
    except (ErgoqpError, TypeError) as error:
        raise ProblemError(f"{name}: {error}") from None


def _build(file: Any, name: str, folder: Path) -> Problem:
    response = _term("response", file.response, RESPONSES, {}, folder)
    # The stance alone says whether the person sits, also for the sheet.
    seated = getattr(response, "stance", None) == "seated"
    task = file.task.model_dump(exclude={"method"}) | {"seated": seated}
    method = Method(**given(file.task.method))
    sheet = {**task, "method": method}
    return Problem(
        cost=_term("cost", file.cost, COSTS, {"task": sheet}, file, sheet, folder),
        response=response,
        limits=_limits(file, folder, tuple(response.coordinates) == JOINTS),
        dt=file.dt,
        control=Control(**given(file.control)),
        robot=DeclaredRobot(**given(file.robot)),
        frames=Frames(**given(file.frames)),
        task=TaskOptions(**task),
        method=method,
        name=name,
        title=file.title or name,
    )


def _term(
    part: str,
    table: Any,
    makers: Mapping[str, Callable[..., Any]],
    sheet: Mapping[str, Mapping[str, Any]],
    *first: Any,
) -> Any:
    """Return the cost or the response of a file, of a user or from its first arguments."""
    for name, own in own_tables(table).items():
        return build_own(part, name, own)
    ((name, values),) = (given(table) or {"smooth_reba": {}}).items()
    with full_keys({f"{part}.{name}": values, **sheet}):
        return makers[name](*first, **values)


def _limits(file: Any, folder: Path, of_person: bool) -> list[Any]:
    own = own_tables(file.limits)
    limits = {key: one for key, one in given(file.limits).items() if key in LIMITS}
    if of_person:
        # A person always has joint limits, and an object always has a twist limit.
        limits = {"twist": {}, "joints": {}} | limits
    elif "point_speed" not in limits:
        limits["point_speed"] = {}
    made = []
    for kind, one in limits.items():
        several = one if isinstance(one, list) else [one]
        for i, values in enumerate(several):
            where = f"limits.{kind}.{i}" if several is one else f"limits.{kind}"
            made.append(_limit(kind, values, where, folder))
    return [*made, *(build_own("limits", name, table) for name, table in own.items())]


def _limit(kind: str, values: dict[str, Any], where: str, folder: Path) -> Any:
    """Return one limit. If there are several of a kind, an error names the one that is wrong."""
    with full_keys({where: values}, kind):
        if kind == "one_class_boundary":
            from ergoqp.learning.one_class import load_one_class

            values = values | {"model": load_one_class(find_model(values["model"], folder))}
        return LIMITS[kind](**values)


def find_model(name: str, folder: Path) -> Path:
    """Return the file of a model by its name in ``models/`` or by a .npz path, from `folder` on.

    Raises:
        ProblemError: if there is no such file.
    """
    path = data_folder("models") / f"{name}.npz" if not name.endswith(".npz") else folder / name
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in data_folder("models").glob("*.npz")))
        raise ProblemError(
            f"model: got {name!r}, allowed {known or 'none that came with the package'} or the path"
            " of a .npz file"
        )
    return path


def find_problem(name: str | Path) -> Path:
    """Return the file of a problem by its name in ``problems/`` or by the path of a TOML file.

    Raises:
        ProblemError: if there is no such file.
    """
    path = Path(name)
    try:
        if path.suffix != ".toml" and len(path.parts) == 1:
            path = data_folder("problems") / f"{name}.toml"
            if not path.is_file():
                raise ProblemError(
                    f"problem: got {str(name)!r}, allowed {', '.join(problem_names())} or the path"
                    " of a .toml file"
                )
        elif not path.is_file():
            what = "is a directory" if path.is_dir() else "no such file"
            raise ProblemError(f"problem: {str(name)!r}: {what}; give a .toml file")
    except OSError as error:
        raise ProblemError(
            f"problem: {shown(str(name))}: {error.strerror}; give the path of a .toml file"
        ) from None
    return path
