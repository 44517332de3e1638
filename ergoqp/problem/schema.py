"""The tables of a problem file: keys, allowed values, units, and terms of the user.

Types of the parameters of users' terms, as files can give them.

Lists stand for tuples and arrays.
"""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Literal, Self, Union, get_args, get_origin, get_type_hints

import numpy as np
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

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, InputError, in_words
from ergoqp.limits import AXES
from ergoqp.problem.messages import (
    NotNegative,
    Number,
    Positive,
    Vector,
    as_list,
    as_tuple,
    full_keys,
    given_tables,
    keys_of,
    listing,
)
from ergoqp.problem.settings import Control
from ergoqp.problem.validate import check_response
from ergoqp.registry import check_free, own_term, registered
from ergoqp.sheets.reba import Method


class Table(BaseModel):
    """A table of the file. Unknown keys are mistakes, and a text is never taken for a number."""

    model_config = ConfigDict(extra="forbid", strict=True)


Side = Literal["right", "left"]
Pair = Annotated[tuple[bool, bool], BeforeValidator(as_tuple)]


class IkTable(Table):
    """Keys of `ergoqp.responses.IkResponse`."""

    stature: Annotated[float, Field(ge=1.2, le=2.3)] | None = None
    person: str | None = None
    stance: Literal["standing", "seated"] = "standing"
    seat_height: Annotated[float, Field(ge=0.2, le=1.2)] | None = None
    hands: Annotated[
        tuple[Side, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=2)
    ] = ("right",)
    tool: Literal["along", "thumb"] = "along"
    free_about_tool: bool = True
    weights: dict[str, Positive] = {}
    comfort_deg: dict[str, Number] = {}
    balance: NotNegative = 60.0
    relaxation_time: Positive = 1.0
    damping: Annotated[float, Field(ge=1e-6, le=1)] = 0.02
    looks: bool = True
    attention: Annotated[float, Field(ge=1e-3, le=1e6)] = 8.0
    free_arm: Literal["hangs", "rests"] | None = None

    @model_validator(mode="after")
    def _one_person(self) -> Self:
        if self.stature is not None and self.person is not None:
            raise PydanticCustomError("person", "got stature and person, allowed one of them")
        return self


class PointsTable(Table):
    """Elbow and wrist of the right arm are the state. The twist is their velocity. No keys."""


def _check_one(keys: Sequence[str], given: Sequence[str], at_least: int) -> None:
    """Raise an error if a table has more than one of some keys, or fewer than `at_least`."""
    if not at_least <= len(given) <= 1:
        raise PydanticCustomError(
            "one",
            "got {got}, allowed {count} one of {keys}",
            {
                "got": listing(given) if given else "none",
                "count": "exactly" if at_least else "only",
                "keys": listing(keys),
            },
        )


class ResponseTable(Table):
    """Exactly one response."""

    ik: IkTable | None = None
    points: PointsTable | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        _check_one(list(keys_of(type(self))), list(given_tables(self)), 1)
        return self


class SmoothRebaTable(Table):
    """Keys of the smooth REBA score, see `ergoqp.costs.smooth_reba.SmoothReba`."""

    taus_deg: Annotated[tuple[Positive, ...], BeforeValidator(as_tuple), Field(min_length=1)] = (
        1.5,
        12.0,
    )
    weights: Annotated[tuple[Positive, ...], BeforeValidator(as_tuple), Field(min_length=1)] = (
        0.8,
        0.2,
    )


class LearnedTable(Table):
    """File of a learned cost."""

    model: str


class CostTable(Table):
    """At most one cost. Default: the smooth REBA score."""

    smooth_reba: SmoothRebaTable | None = None
    learned: LearnedTable | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        _check_one(list(keys_of(type(self))), list(given_tables(self)), 0)
        return self


def _table_of(kind: type, name: str, held: Any = None) -> Any:
    """Return a table with the fields of a dataclass, with their own types or all of type `held`."""
    hints = get_type_hints(kind)
    keys: dict[str, Any] = {
        each.name: (held or hints[each.name], each.default) for each in fields(kind)
    }
    return create_model(name, __base__=Table, **keys)


MethodTable: Any = _table_of(Method, "MethodTable")
"""The fields of `ergoqp.reba.Method`, with their names and types."""

ControlTable: Any = _table_of(Control, "ControlTable", NotNegative)
"""The fields of `ergoqp.Control`."""


class TaskTable(Table):
    """What joint angles cannot tell. The stance says whether the person sits."""

    load_kg: NotNegative = 0.0
    shock: bool = False
    coupling: Annotated[int, Field(ge=0, le=3)] = 0
    activity: Annotated[int, Field(ge=0, le=3)] = 0
    one_leg: bool = False
    arm_supported: Pair = (False, False)
    shoulder_raised: Pair = (False, False)
    # The class is made above.
    method: MethodTable = MethodTable()  # pyright: ignore[reportInvalidTypeForm]


class TwistTable(Table):
    """See `ergoqp.limits.TwistLimit`."""

    linear_speed: Positive = 0.20
    angular_speed: Positive = 0.80
    linear_acceleration: Positive = 0.60
    angular_acceleration: Positive = 2.50
    axes: Annotated[
        tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...],
        BeforeValidator(as_tuple),
        Field(min_length=1),
    ] = AXES


class JointsTable(Table):
    """See `ergoqp.limits.JointLimit`."""

    ranges_deg: dict[str, Annotated[tuple[Number, Number], BeforeValidator(as_tuple)]] = {}
    rate_deg: Positive = 90.0
    yield_zone_deg: Annotated[float, Field(ge=0, le=20)] = 1.5
    tolerance_deg: Annotated[float, Field(ge=0, le=20)] = 2.0
    recovery_time: Positive = 1.0
    recover: bool = False


class WorkspaceTable(Table):
    """See `ergoqp.limits.WorkspaceBox`."""

    lower: Vector
    upper: Vector


class ToolAxisTable(Table):
    """See `ergoqp.limits.AxisCone`."""

    direction: Vector
    half_angle_deg: Annotated[float, Field(gt=0, le=170)]


class PointSpeedTable(Table):
    """Largest speed and acceleration of each coordinate of two points."""

    speed: Positive = 0.15
    acceleration: Positive = 1.5


class ArmLengthTable(Table):
    """See `ergoqp.limits.ArmLength`."""

    length: Positive


class HalfSpaceTable(Table):
    """See `ergoqp.limits.HalfSpace`."""

    normal: Vector
    offset: Number


class BallTable(Table):
    """See `ergoqp.limits.Ball`."""

    centre: Vector
    radius: Positive


class BoxTable(Table):
    """See `ergoqp.limits.Box`."""

    lower: Vector
    upper: Vector


class KeepOutTable(Table):
    """See `ergoqp.limits.KeepOut`. Several are an array of tables, each with its own name."""

    name: str = "keep out"
    half_space: HalfSpaceTable | None = None
    ball: BallTable | None = None
    box: BoxTable | None = None
    tolerance: NotNegative = 1e-6
    recovery_time: Positive = 2.0

    @model_validator(mode="after")
    def _one(self) -> Self:
        regions = ("half_space", "ball", "box")
        _check_one(regions, [name for name in regions if getattr(self, name) is not None], 1)
        return self


def _named(regions: list[KeepOutTable] | None) -> list[KeepOutTable] | None:
    """Raise an error if two regions have the same name, because each is a row of the step."""
    names = [region.name for region in regions or ()]
    if doubled := [name for name in names if names.count(name) > 1]:
        raise PydanticCustomError(
            "names",
            "got two regions named {name}, allowed regions each with a `name` of its own",
            {"name": repr(doubled[0])},
        )
    return regions


class BoundaryTable(Table):
    """See `ergoqp.limits.OneClassBoundary`."""

    model: str
    hard: bool = False
    tolerance: NotNegative = 1e-9
    recovery_time: Positive = 0.25


class LimitsTable(Table):
    """All limits, each at most once, except that several `keep_out` are allowed."""

    twist: TwistTable | None = None
    joints: JointsTable | None = None
    workspace: WorkspaceTable | None = None
    tool_axis: ToolAxisTable | None = None
    point_speed: PointSpeedTable | None = None
    keep_out: Annotated[
        list[KeepOutTable] | None, BeforeValidator(as_list), AfterValidator(_named)
    ] = None
    arm_length: ArmLengthTable | None = None
    one_class_boundary: BoundaryTable | None = None


_Seconds = Annotated[float, Field(ge=0, le=0.5)]


class RobotTable(Table):
    """See `ergoqp.problem.settings.DeclaredRobot`."""

    delay: _Seconds = 0.0
    lag: _Seconds = 0.0
    gain_error: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    pose_delay: _Seconds = 0.0
    pose_noise: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    pose_noise_deg: Annotated[float, Field(ge=0, le=10)] = 0.0
    longest_hold: Annotated[float, Field(ge=0, le=1)] = 0.0
    pose_from_posture: Annotated[float, Field(ge=0, le=1)] = 0.035
    pose_from_posture_deg: Annotated[float, Field(ge=0, le=90)] = 8.0


_Frame = Annotated[
    tuple[Number, Number, Number, Number, Number, Number, Number], BeforeValidator(as_tuple)
]


class FramesTable(Table):
    """See `ergoqp.problem.settings.Frames`: x, y, z and a quaternion x, y, z, w."""

    base: _Frame | None = None
    flange: _Frame | None = None
    camera: _Frame | None = None
    offset: Vector = (0.0, 0.0, 0.0)
    spread: Annotated[float, Field(ge=0, le=2)] | None = None
    spread_deg: Annotated[float, Field(ge=0, le=180)] | None = None
    compare: bool = True


class FileTable(Table):
    """A whole file. `unusual` lists keys whose unusual values are meant."""

    title: str = ""
    dt: Annotated[float, Field(ge=1e-4, le=0.1)] = 0.01
    response: ResponseTable
    cost: CostTable = CostTable()
    task: TaskTable = TaskTable()
    limits: LimitsTable = LimitsTable()
    robot: RobotTable = RobotTable()
    frames: FramesTable = FramesTable()
    # The class is made above.
    control: ControlTable = ControlTable()  # pyright: ignore[reportInvalidTypeForm]
    unusual: list[str] = []


_CONTAINERS: Final[tuple[Any, ...]] = (list, dict, Sequence, Mapping)


def as_in_files(hint: Any) -> Any:
    """Return a type that accepts what a TOML file can give for a type.

    Args:
        hint: type that the user's code declares.
    """
    kind: Any = get_origin(hint) or hint
    parts = tuple(map(as_in_files, get_args(hint)))
    if kind is np.ndarray:
        return Annotated[Any, BeforeValidator(_as_array)]
    if kind is Path:
        return Annotated[Path, BeforeValidator(_as_path)]
    if kind is tuple:
        return Annotated[tuple[parts] if parts else tuple, BeforeValidator(as_tuple)]
    if kind in (Union, UnionType):
        return Union[parts]  # noqa: UP007  # of types that are known only now
    if kind in _CONTAINERS and parts:
        return kind[parts]
    return hint


def _as_path(value: Any) -> Any:
    return Path(value) if isinstance(value, str) else value


def _as_array(value: Any) -> np.ndarray:
    with contextlib.suppress(ValueError):  # lists of several lengths
        array = np.array(value)
        if array.ndim and array.dtype.kind in "iuf":
            return array.astype(float)
    raise PydanticCustomError("array", "Input should be an array of numbers")


_PARTS = {"cost": CostTable, "limits": LimitsTable, "response": ResponseTable}
_KINDS = {"cost": "cost", "limits": "limit", "response": "response"}


def file_table(raw: Mapping[str, Any]) -> type[FileTable]:
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
        given = raw.get(part)
        named, known = set(given) if isinstance(given, Mapping) else set(), set(table.model_fields)
        check_free(_KINDS[part], named & known)
        found = {name: own_term(_KINDS[part], name) for name in (named - known) & own_names(part)}
        if found:
            own = {name: (_table_of_term(name, term) | None, None) for name, term in found.items()}
            larger = _with_keys(table.__name__, table, own)
            parts[part] = (larger, FileTable.model_fields[part].default)
    return create_model("FileTable", __base__=FileTable, **parts) if parts else FileTable


def own_names(part: str) -> set[str]:
    """Return the names that installed packages register for a part of a file."""
    return set(registered(_KINDS[part]))


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


def _table_of_term(name: str, term: Any) -> type[Table]:
    """Return a table with the parameters of a term and their types."""
    try:
        parameters = inspect.signature(term).parameters
        hints = get_type_hints(term.__init__ if inspect.isclass(term) else term)
    except (TypeError, ValueError, NameError) as error:
        raise InputError(
            f"{name}: got {shown(term)} ({error}), allowed a class or function with typed"
            " parameters"
        ) from None
    keys: dict[str, Any] = {}
    for key, parameter in parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise InputError(
                f"{name}: got the parameter {parameter}, allowed only ones that a file can name"
            )
        keys[key] = (
            as_in_files(hints.get(key, Any)),
            ... if parameter.default is parameter.empty else None,
        )
        try:
            _with_keys(name, Table, {key: keys[key]})
        except PydanticUserError:
            raise InputError(
                f"{name}: got the parameter {parameter!s:.80}, allowed numbers, texts,"
                " lists and arrays of them, and tables"
            ) from None
    return _with_keys(name, Table, keys)


def _with_keys(name: str, base: type[Table], keys: Mapping[str, tuple[Any, Any]]) -> Any:
    """Return a table with more keys, each with its type and default (`...`: required)."""
    fields: dict[str, Any] = {
        f"own_{i}": (kind, Field(default, alias=key))
        for i, (key, (kind, default)) in enumerate(keys.items())
    }
    return create_model(f"{name} table", __base__=base, **fields)
