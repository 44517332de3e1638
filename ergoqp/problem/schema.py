"""The tables of a problem file, made from the parameters of the terms of ergoqp and of users."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Literal,
    Self,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from annotated_types import Len
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PydanticUserError,
    create_model,
    model_validator,
)
from pydantic_core import PydanticCustomError

from ergoqp.arguments import Range, shown
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError, InputError, in_words
from ergoqp.human.body import STATURE_RANGE
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
from ergoqp.limits.twist_and_stopping import Acceleration, Speed
from ergoqp.problem.messages import as_list, as_tuple, full_keys, given_tables, keys_of, listing
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.problem.validate import PERIODS, check_response
from ergoqp.registry import check_free, own_term, registered
from ergoqp.responses import IkResponse
from ergoqp.sheets.options import DEFAULTS, Method, TaskOptions


class Table(BaseModel):
    """A table of the file. Unknown keys are mistakes, and a text is never taken for a number."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def given(table: BaseModel) -> dict[str, Any]:
    """Return the keys that a file states in a table, with their values; tables within as such."""
    return table.model_dump(by_alias=True, exclude_unset=True)


_CONTAINERS: Final[tuple[Any, ...]] = (list, dict, Mapping)


def as_in_files(hint: Any) -> Any:
    """Return a type that accepts what a TOML file can give for a type.

    Lists stand for tuples and arrays.

    Args:
        hint: type that the code declares.
    """
    kind: Any = get_origin(hint) or hint
    if kind is Annotated:
        core, *metadata = get_args(hint)
        return Annotated[(as_in_files(core), *metadata)]
    parts = tuple(map(as_in_files, get_args(hint)))
    if kind is np.ndarray:
        return Annotated[Any, BeforeValidator(_as_array)]
    if kind is Path:
        return Annotated[Path, BeforeValidator(_as_path)]
    if kind in _CONTAINERS and parts:
        return kind[parts]
    if kind is Sequence and parts:
        kind, parts = tuple, (*parts, ...)
    if kind is tuple:
        return Annotated[tuple[parts] if parts else tuple, BeforeValidator(as_tuple)]
    if kind in (Union, UnionType):
        return Union[parts]  # noqa: UP007  # of types that are known only now
    return hint


def _as_path(value: Any) -> Any:
    return Path(value) if isinstance(value, str) else value


def _as_array(value: Any) -> np.ndarray:
    with contextlib.suppress(ValueError):  # lists of several lengths
        array = np.array(value)
        if array.ndim and array.dtype.kind in "iuf":
            return array.astype(float)
    raise PydanticCustomError("array", "Input should be an array of numbers")


def table_of(name: str, term: Any, leave_out: Sequence[str] = (), **instead: Any) -> Any:
    """Return a table with the parameters of a term and their types.

    Keys that a file leaves out keep the defaults of the term.

    Args:
        name: name of the term.
        term: a class or function with typed parameters, of the package or of a user.
        leave_out: parameters that a file does not state.
        instead: types of further keys, and of parameters that a file states otherwise.

    Raises:
        InputError: if the term does not declare its parameters.
    """
    try:
        parameters = inspect.signature(term).parameters
        hints = get_type_hints(
            term if is_dataclass(term) or not inspect.isclass(term) else term.__init__,
            include_extras=True,
        )
    except (TypeError, ValueError, NameError) as error:
        raise InputError(
            f"{name}: got {shown(term)} ({error}), allowed a class or function with typed"
            " parameters"
        ) from None
    keys: dict[str, Any] = {}
    for key, parameter in parameters.items():
        if key in leave_out:
            continue
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise InputError(
                f"{name}: got the parameter {parameter}, allowed only ones that a file can name"
            )
        kind = instead.pop(key, None) or as_in_files(hints.get(key, Any))
        keys[key] = (kind, ... if parameter.default is parameter.empty else None)
    try:
        return _with_keys(name, Table, keys | {key: (kind, None) for key, kind in instead.items()})
    except PydanticUserError:
        for key in keys:
            if not _can_be_stated(name, {key: keys[key]}):
                raise InputError(
                    f"{name}: got the parameter {parameters[key]!s:.80}, allowed numbers, texts,"
                    " lists and arrays of them, and tables"
                ) from None
        raise


def _can_be_stated(name: str, keys: Mapping[str, tuple[Any, Any]]) -> bool:
    try:
        _with_keys(name, Table, keys)
    except PydanticUserError:
        return False
    return True


def _with_keys(name: str, base: type[Table], keys: Mapping[str, tuple[Any, Any]]) -> Any:
    """Return a table with more keys, each with its type and default (`...`: required)."""
    fields: dict[str, Any] = {
        f"own_{i}": (kind, Field(default, alias=key))
        for i, (key, (kind, default)) in enumerate(keys.items())
    }
    return create_model(f"{name} table", __base__=base, **fields)


def _check_one(keys: Sequence[str], stated: Sequence[str], at_least: int) -> None:
    """Raise an error if a table has more than one of some keys, or fewer than `at_least`."""
    if not at_least <= len(stated) <= 1:
        raise PydanticCustomError(
            "one",
            "got {got}, allowed {count} one of {keys}",
            {
                "got": listing(stated) if stated else "none",
                "count": "exactly" if at_least else "only",
                "keys": listing(keys),
            },
        )


class _AtMostOne(Table):
    """Tables of which a file states one or none."""

    at_least: ClassVar[int] = 0

    @model_validator(mode="after")
    def _one(self) -> Self:
        _check_one(list(keys_of(type(self))), list(given_tables(self)), self.at_least)
        return self


class _ExactlyOne(_AtMostOne):
    """Tables of which a file states one."""

    at_least: ClassVar[int] = 1


def _tables(name: str, base: type[Table], **tables: Any) -> Any:
    """Return a table of tables that a file may state."""
    fields: dict[str, Any] = {key: (one | None, None) for key, one in tables.items()}
    return create_model(name, __base__=base, **fields)


Side = Literal["right", "left"]


def _one_person(response: Table) -> Table:
    if {"stature", "person"} <= set(given(response)):
        raise PydanticCustomError("person", "got stature and person, allowed one of them")
    return response


def _saved(model: str) -> None:
    """Have the file of a learned model."""


def _points() -> None:
    """Elbow and wrist of the right arm are the state. The twist is their velocity."""


_Stature = Annotated[float, Range(*STATURE_RANGE, "m")]

ResponseTable: Any = _tables(
    "ResponseTable",
    _ExactlyOne,
    ik=Annotated[
        table_of(
            "ik",
            IkResponse,
            ["body"],
            hands=Annotated[tuple[Side, ...], BeforeValidator(as_tuple), Len(1, 2)],
            stature=_Stature | None,
            person=str | None,
        ),
        AfterValidator(_one_person),
    ],
    points=table_of("points", _points),
    gmr=table_of("gmr", _saved),
)
"""Exactly one response."""


CostTable: Any = _tables(
    "CostTable",
    _AtMostOne,
    smooth_reba=table_of("smooth_reba", SmoothReba, ["method", "task"]),
    learned=table_of("learned", _saved),
)
"""At most one cost. Default: the smooth REBA score."""

_TASK: Final[dict[str, Any]] = {
    name: (as_in_files(hint), DEFAULTS[name])
    for name, hint in get_type_hints(TaskOptions, include_extras=True).items()
    if name != "seated"
}
TaskTable: Any = create_model(
    "TaskTable",
    __base__=Table,
    **_TASK,
    method=(table_of("method", Method), table_of("method", Method)()),
)
"""What joint angles cannot tell. The stance says whether the person sits."""


def point_speed(speed: Speed = 0.15, acceleration: Acceleration = 1.5) -> TwistLimit:
    """Return the bounds on the velocities of two points, the same for all axes."""
    return TwistLimit(speed, speed, acceleration, acceleration)


REGIONS: Final = {"half_space": HalfSpace, "ball": Ball, "box": Box}
"""What a file can keep the object out of."""


def _one_region(region: Table) -> Table:
    _check_one(list(REGIONS), [name for name in given_tables(region) if name in REGIONS], 1)
    return region


KeepOutTable: Any = Annotated[
    table_of(
        "keep_out",
        KeepOut,
        ["region"],
        **{name: table_of(name, kind) | None for name, kind in REGIONS.items()},
    ),
    AfterValidator(_one_region),
]
"""See `ergoqp.limits.KeepOut`. Several are an array of tables, each with its own name."""


def _named(regions: list[Table]) -> list[Table]:
    """Raise an error if two regions have the same name, because each is a row of the step."""
    names = [given(region).get("name", KeepOut.name) for region in regions]
    if doubled := [name for name in names if names.count(name) > 1]:
        raise PydanticCustomError(
            "names",
            "got two regions named {name}, allowed regions each with a `name` of its own",
            {"name": repr(doubled[0])},
        )
    return regions


def _keep_out(**keys: Any) -> KeepOut:
    """Return a region that the contact point stays out of; exactly one of `REGIONS` is given."""
    kind = next(kind for kind in keys if kind in REGIONS)
    return KeepOut(REGIONS[kind](**keys.pop(kind)), **keys)


LIMITS: Final[dict[str, Callable[..., Any]]] = {
    "twist": TwistLimit,
    "joints": JointLimit,
    "workspace": WorkspaceBox,
    "tool_axis": AxisCone,
    "keep_out": _keep_out,
    "point_speed": point_speed,
    "arm_length": ArmLength,
    "one_class_boundary": OneClassBoundary,
}
"""Limits by the names of their tables; the keys of a table are the arguments."""

_FIXED: Final = ("tolerance", "recovery_time")
"""What the checker and the reasons count with too: a file cannot change it."""

LimitsTable: Any = _tables(
    "LimitsTable",
    Table,
    twist=table_of("twist", TwistLimit, ["aside"]),
    joints=table_of("joints", JointLimit),
    workspace=table_of("workspace", WorkspaceBox, _FIXED),
    tool_axis=table_of("tool_axis", AxisCone, _FIXED),
    point_speed=table_of("point_speed", point_speed),
    keep_out=Annotated[list[KeepOutTable], BeforeValidator(as_list), AfterValidator(_named)],
    arm_length=table_of("arm_length", ArmLength, ["name", *_FIXED]),
    one_class_boundary=table_of("boundary", OneClassBoundary, ["name"], model=str),
)
"""All limits, each at most once, except that several `keep_out` are allowed."""

_Frame = Annotated[
    tuple[float, float, float, float, float, float, float] | None, BeforeValidator(as_tuple)
]
RobotTable: Any = table_of("robot", DeclaredRobot)
ControlTable: Any = table_of("control", Control)
FramesTable: Any = table_of(
    "frames",
    Frames,
    base=_Frame,
    flange=_Frame,
    camera=_Frame,
    offset=Annotated[tuple[float, float, float], BeforeValidator(as_tuple)],
)


FileTable: Any = create_model(
    "FileTable",
    __base__=Table,
    title=(str, ""),
    dt=(Annotated[float, Range(*PERIODS, "s")], 0.01),
    response=(ResponseTable, ...),
    cost=(CostTable, CostTable()),
    task=(TaskTable, TaskTable()),
    limits=(LimitsTable, LimitsTable()),
    robot=(RobotTable, RobotTable()),
    frames=(FramesTable, FramesTable()),
    control=(ControlTable, ControlTable()),
    unusual=(list[str], []),
)
"""A whole file. `unusual` lists keys whose unusual values are meant."""

_PARTS: Final[dict[str, Any]] = {
    "cost": CostTable,
    "limits": LimitsTable,
    "response": ResponseTable,
}
_KINDS = {"cost": "cost", "limits": "limit", "response": "response"}


def file_table(raw: Mapping[str, Any]) -> Any:
    """Return the table of a file, with the keys of the user's terms that it names.

    Only terms that the file names are imported.

    Args:
        raw: tables of the file.

    Raises:
        InputError: if a user's term cannot be imported, does not declare its parameters, or has the
            name of another term.
    """
    parts: dict[str, Any] = {}
    for part, table in _PARTS.items():
        stated = raw.get(part)
        named = set(stated) if isinstance(stated, Mapping) else set()
        known = set(table.model_fields)
        check_free(_KINDS[part], named & known)
        # Reading what is installed takes 10 ms, so it is read only for names that are not ours.
        own = (named - known) & set(registered(_KINDS[part]) if named - known else ())
        found = {name: own_term(_KINDS[part], name) for name in own}
        if found:
            keys = {name: (table_of(name, term) | None, None) for name, term in found.items()}
            larger = _with_keys(table.__name__, table, keys)
            parts[part] = (larger, FileTable.model_fields[part].default)
    return create_model("FileTable", __base__=FileTable, **parts) if parts else FileTable


def own_names(raw: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the part and name of every term of a file that is not the package's."""
    return [
        (part, name)
        for part, table in _PARTS.items()
        if isinstance(raw.get(part), Mapping)
        for name in raw[part]
        if name not in table.model_fields
    ]


def own_tables(table: Table) -> dict[str, Table]:
    """Return the tables of the user's terms in a part of a file: those that no class declares."""
    known = next(kind for kind in _PARTS.values() if isinstance(table, kind)).model_fields
    return {key: each for key, each in given_tables(table).items() if key not in known}


def build_own(part: str, name: str, table: Table) -> Any:
    """Return a user's term made from the keys of a file. Keys that are missing keep their defaults.

    Raises:
        InputError: if the term does not accept the keys, with the error that it raised.
    """
    said = {
        key: getattr(table, attribute)
        for key, attribute in keys_of(type(table)).items()
        if attribute in table.model_fields_set
    }
    try:
        with full_keys({f"{part}.{name}": said}):
            made = own_term(_KINDS[part], name)(**said)
    except ErgoqpError:
        raise
    except Exception as error:  # any error in the code of a user's term
        raise InputError(
            f"{part}.{name}: got {in_words(error)}, allowed what"
            f" {own_term(_KINDS[part], name)!r:.80} takes"
        ) from None
    if part == "response":
        # Its state decides which limits there are, before `Problem` checks all terms.
        check_response(f"{part}.{name}", made)
    return made
