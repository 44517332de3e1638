"""Problems from TOML files: every mistake found at once, each with its key, what was found and what is allowed."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError, ProblemError
from ergoqp.human import Body
from ergoqp.limits import AXES, AxisCone, JointLimit, TwistLimit, WorkspaceBox
from ergoqp.paths import data_folder
from ergoqp.problem import Control, Problem
from ergoqp.responses import IkResponse
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


class _Response(_Table):
    ik: _Ik


class _SmoothReba(_Table):
    taus_deg: Annotated[tuple[Positive, ...], BeforeValidator(_as_tuple), Field(min_length=1)] = (1.5, 12.0)
    weights: Annotated[tuple[Positive, ...], BeforeValidator(_as_tuple), Field(min_length=1)] = (0.8, 0.2)


class _Cost(_Table):
    smooth_reba: _SmoothReba = _SmoothReba()


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


class _Workspace(_Table):
    lower: Vector
    upper: Vector


class _ToolAxis(_Table):
    direction: Vector
    half_angle_deg: Annotated[float, Field(gt=0, le=170)]


class _Limits(_Table):
    twist: _Twist = _Twist()
    joints: _Joints = _Joints()
    workspace: _Workspace | None = None
    tool_axis: _ToolAxis | None = None


class _File(_Table):
    title: str = ""
    dt: Annotated[float, Field(ge=1e-4, le=0.1)] = 0.01
    response: _Response
    cost: _Cost = _Cost()
    task: _Task = _Task()
    limits: _Limits = _Limits()
    control: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = {}


# Registration: one line per kind of term; the table's fields are the keyword arguments.
_LIMITS: Final[dict[str, Callable[..., Any]]] = {
    "twist": TwistLimit,
    "joints": JointLimit,
    "workspace": WorkspaceBox,
    "tool_axis": AxisCone,
}


def problem_names() -> list[str]:
    """Return the names of the problems that come with the package."""
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
    return problem_from_dict(raw, path.stem)


def problem_from_dict(raw: dict[str, Any], name: str) -> Problem:
    """Return the problem that a parsed file describes.

    Raises:
        ProblemError: listing every mistake.
    """
    try:
        file = _File.model_validate(raw)
    except ValidationError as error:
        raise ProblemError(_mistakes(name, error)) from None
    try:
        return _build(file, name)
    except ErgoqpError as error:
        raise ProblemError(f"{name}: {error}") from None
    except TypeError as error:
        raise ProblemError(f"{name}: {error}") from None


def _build(file: _File, name: str) -> Problem:
    ik = file.response.ik.model_dump()
    stature = ik.pop("stature")
    task = file.task.model_dump()
    choices = task.pop("method")
    _known("task.method", choices, {f.name for f in fields(Method)})
    method = Method(**choices)
    _known("control", file.control, {f.name for f in fields(Control)})
    limits = file.limits.model_dump(exclude_none=True)
    return Problem(
        cost=SmoothReba(**file.cost.smooth_reba.model_dump(), method=method, **task),
        response=IkResponse(body=Body.of_stature(stature), **ik),
        limits=[_LIMITS[kind](**values) for kind, values in limits.items()],
        dt=file.dt,
        control=Control(**file.control),
        task=TaskOptions(**task),
        method=method,
        name=name,
        title=file.title or name,
    )


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
