"""Problems from TOML files: every mistake found at once, each with its key, what was found and what is allowed."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from ergoqp.costs.learned import load_cost
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError, ProblemError
from ergoqp.human import Body
from ergoqp.limits import AXES, ArmLength, AxisCone, JointLimit, OneClassBoundary, TwistLimit, WorkspaceBox
from ergoqp.paths import data_folder
from ergoqp.problem import Control, Problem
from ergoqp.responses import IkResponse, LinearResponse
from ergoqp.robot import DeclaredRobot
from ergoqp.sheets.reba import Method
from ergoqp.sheets.task import TaskOptions


class _Table(BaseModel):
    """A table of the file: unknown keys are mistakes, and a text is never taken for a number."""

    model_config = ConfigDict(extra="forbid", strict=True)


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_as_tuple)]
Side = Literal["right", "left"]
Pair = Annotated[tuple[bool, bool], BeforeValidator(_as_tuple)]


class _Ik(_Table):
    stature: Annotated[float, Field(ge=1.2, le=2.3)] = 1.75
    stance: Literal["standing", "seated"] = "standing"
    seat_height: Annotated[float, Field(ge=0.2, le=1.2)] = 0.5
    hands: Annotated[tuple[Side, ...], BeforeValidator(_as_tuple), Field(min_length=1, max_length=2)] = ("right",)
    tool: Literal["along", "thumb"] = "along"
    free_about_tool: bool = True
    weights: dict[str, Positive] = {}
    comfort_deg: dict[str, Number] = {}
    balance: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 60.0
    relaxation_time: Positive = 1.0
    damping: Annotated[float, Field(ge=1e-6, le=1)] = 0.02


class _Points(_Table):
    """Elbow and wrist of the right arm are the state, and the twist their velocities."""


class _Response(_Table):
    ik: _Ik | None = None
    points: _Points | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.ik is None) == (self.points is None):
            raise ValueError("exactly one of ik and points is allowed")
        return self


class _SmoothReba(_Table):
    taus_deg: Annotated[tuple[Positive, ...], BeforeValidator(_as_tuple), Field(min_length=1)] = (1.5, 12.0)
    weights: Annotated[tuple[Positive, ...], BeforeValidator(_as_tuple), Field(min_length=1)] = (0.8, 0.2)


class _Learned(_Table):
    model: str


class _Cost(_Table):
    smooth_reba: _SmoothReba | None = None
    learned: _Learned | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.smooth_reba is not None and self.learned is not None:
            raise ValueError("only one of smooth_reba and learned is allowed")
        return self


class _Task(_Table):
    load_kg: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    shock: bool = False
    coupling: Annotated[int, Field(ge=0, le=3)] = 0
    activity: Annotated[int, Field(ge=0, le=3)] = 0
    seated: bool = False
    one_leg: bool = False
    arm_supported: Pair = (False, False)
    shoulder_raised: Pair = (False, False)
    method: dict[str, Any] = {}


class _Twist(_Table):
    linear_speed: Positive = 0.20
    angular_speed: Positive = 0.80
    linear_acceleration: Positive = 0.60
    angular_acceleration: Positive = 2.50
    axes: Annotated[tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...], BeforeValidator(_as_tuple), Field(min_length=1)] = (
        AXES
    )


class _Joints(_Table):
    ranges_deg: dict[str, Annotated[tuple[Number, Number], BeforeValidator(_as_tuple)]] = {}
    rate_deg: Positive = 90.0
    yield_zone_deg: Annotated[float, Field(ge=0, le=20)] = 1.5
    tolerance_deg: Annotated[float, Field(ge=0, le=20)] = 2.0
    recovery_time: Positive = 1.0
    recover: bool = False


class _Workspace(_Table):
    lower: Vector
    upper: Vector


class _ToolAxis(_Table):
    direction: Vector
    half_angle_deg: Annotated[float, Field(gt=0, le=170)]


class _PointSpeed(_Table):
    speed: Positive = 0.15
    acceleration: Positive = 1.5


class _ArmLength(_Table):
    length: Positive


class _Boundary(_Table):
    model: str
    hard: bool = False
    tolerance: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 1e-9
    recovery_time: Positive = 0.25


class _Limits(_Table):
    twist: _Twist | None = None
    joints: _Joints | None = None
    workspace: _Workspace | None = None
    tool_axis: _ToolAxis | None = None
    point_speed: _PointSpeed | None = None
    arm_length: _ArmLength | None = None
    one_class_boundary: _Boundary | None = None


_Seconds = Annotated[float, Field(ge=0, le=0.5)]


class _Robot(_Table):
    delay: _Seconds = 0.0
    lag: _Seconds = 0.0
    gain_error: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    pose_delay: _Seconds = 0.0
    pose_noise: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    pose_noise_deg: Annotated[float, Field(ge=0, le=10)] = 0.0
    longest_hold: Annotated[float, Field(ge=0, le=1)] = 0.0


class _File(_Table):
    title: str = ""
    dt: Annotated[float, Field(ge=1e-4, le=0.1)] = 0.01
    response: _Response
    cost: _Cost = _Cost()
    task: _Task = _Task()
    limits: _Limits = _Limits()
    robot: _Robot = _Robot()
    control: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = {}


def _point_speed(speed: float, acceleration: float) -> TwistLimit:
    """Bounds on the velocities of two points, which are the six entries of the twist: all alike."""
    return TwistLimit(speed, speed, acceleration, acceleration)


# Registration: one line per kind of term; the table's fields are the keyword arguments.
_LIMITS: Final[dict[str, Callable[..., Any]]] = {
    "twist": TwistLimit,
    "joints": JointLimit,
    "workspace": WorkspaceBox,
    "tool_axis": AxisCone,
    "point_speed": _point_speed,
    "arm_length": ArmLength,
    "one_class_boundary": OneClassBoundary,
}


TASKS: Final = ("dentist", "desk", "low_bin", "overhead", "screwing")
"""The problems of a person and the sheet itself: what all figures of closed loops are about."""


def problem_names() -> list[str]:
    """Return the names of all problems that come with the package."""
    return sorted(path.stem for path in data_folder("problems").glob("*.toml"))


def load_problem(name: str | Path) -> Problem:
    """Return a problem by its name in ``problems/`` or by the path of a TOML file.

    Raises:
        ProblemError: if there is no such problem, or the file is not one; the message lists every mistake.
    """
    path = _find(name)
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ProblemError(f"{path.name}: not a TOML file: {error}") from None
    except OSError as error:
        raise ProblemError(f"{path.name}: cannot be read: {error.strerror}") from None
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
        file = _File.model_validate(raw)
    except ValidationError as error:
        raise ProblemError(_mistakes(name, error)) from None
    try:
        return _build(file, name, folder or Path())
    except ErgoqpError as error:
        raise ProblemError(f"{name}: {error}") from None
    except TypeError as error:
        raise ProblemError(f"{name}: {error}") from None


def _build(file: _File, name: str, folder: Path) -> Problem:
    task = file.task.model_dump()
    choices = task.pop("method")
    _known("task.method", choices, {f.name for f in fields(Method)})
    method = Method(**choices)
    _known("control", file.control, {f.name for f in fields(Control)})
    return Problem(
        cost=_cost(file.cost, method, task, folder),
        response=_response(file.response),
        limits=_limits(file, folder),
        dt=file.dt,
        control=Control(**file.control),
        robot=DeclaredRobot(**file.robot.model_dump()),
        task=TaskOptions(**task),
        method=method,
        name=name,
        title=file.title or name,
    )


def _response(table: _Response) -> IkResponse | LinearResponse:
    if table.ik is None:
        return LinearResponse()
    ik = table.ik.model_dump()
    return IkResponse(body=Body.of_stature(ik.pop("stature")), **ik)


def _cost(table: _Cost, method: Method, task: dict[str, Any], folder: Path) -> Any:
    if table.learned is not None:
        # What a cost has learned it knows: other options than those of its data would be silently ignored.
        if task != _Task().model_dump(exclude={"method"}) or method != Method():
            raise ProblemError("cost.learned: got options in [task], allowed none: the cost was learned without them")
        return load_cost(find_model(table.learned.model, folder))
    return SmoothReba(**(table.smooth_reba or _SmoothReba()).model_dump(), method=method, **task)


def _limits(file: _File, folder: Path) -> list[Any]:
    limits = file.limits.model_dump(exclude_none=True)
    if file.response.ik is not None:
        # A person always has joints, and an object always a largest speed.
        limits = {"twist": _Twist().model_dump(), "joints": _Joints().model_dump()} | limits
    elif "point_speed" not in limits:
        limits["point_speed"] = _PointSpeed().model_dump()
    if "one_class_boundary" in limits:
        from ergoqp.one_class import load_one_class

        boundary = limits["one_class_boundary"]
        boundary["model"] = load_one_class(find_model(boundary["model"], folder))
    return [_LIMITS[kind](**values) for kind, values in limits.items()]


def find_model(name: str, folder: Path) -> Path:
    """Return the file of a learned model: by its name in ``models/``, or a path of a .npz file relative to `folder`.

    Raises:
        ProblemError: if there is none.
    """
    path = data_folder("models") / f"{name}.npz" if not name.endswith(".npz") else folder / name
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in data_folder("models").glob("*.npz")))
        raise ProblemError(
            f"model: got {name!r}, allowed {known or 'none that came with the package'} or the path of a .npz file"
        )
    return path


def _known(where: str, given: dict[str, Any], allowed: set[str]) -> None:
    if unknown := set(given) - allowed:
        raise ProblemError(f"{where}: got {', '.join(sorted(unknown))}, allowed {', '.join(sorted(allowed))}")


def _find(name: str | Path) -> Path:
    path = Path(name)
    if path.suffix != ".toml" and len(path.parts) == 1:
        path = data_folder("problems") / f"{name}.toml"
        if not path.is_file():
            raise ProblemError(f"problem: got {str(name)!r}, allowed {', '.join(problem_names())} or the path of a .toml file")
    elif not path.is_file():
        raise ProblemError(f"problem: {str(name)!r} is {'a directory' if path.is_dir() else 'not there'}, allowed a .toml file")
    return path


def _mistakes(name: str, error: ValidationError) -> str:
    lines = []
    for item in error.errors(include_url=False):
        key = ".".join(str(part) for part in item["loc"])
        got = "" if item["type"] == "missing" else f", got {item['input']!r}"
        lines.append(f"{key}: {item['msg'][0].lower()}{item['msg'][1:]}{got}")
    count = len(lines)
    head = f"{name}: " if count == 1 else f"{name}: {count} mistakes:\n  "
    return head + "\n  ".join(lines)
