"""The known OpenSim models: which coordinate rotates which segment about which axis.

They are read from ``opensim_models.toml``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final

Axis = tuple[float, float, float]
Step = tuple[str | float, Axis]
"""A coordinate, in small letters and without its side, or a fixed angle [rad]; and its axis."""

_AXES: Final[dict[str, Axis]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}


@dataclass(frozen=True)
class Segment:
    """The orientation of a segment.

    Attributes:
        parent: the segment that it hangs from; None: the ground.
        steps: rotations, each about the axes that result from those before.
        needed: coordinates without which it is unknown; other missing coordinates are zero.
    """

    parent: str | None
    steps: tuple[Step, ...]
    needed: tuple[str, ...]


@dataclass(frozen=True)
class OpenSimModel:
    """A model.

    Attributes:
        title: its name in messages.
        telling: coordinates that identify a file of this model.
        segments: its segments, each after its parent; all but pelvis and trunk exist on both sides.
        sides: side of the body -> ending of its coordinates.
        root: the segment that the translations move, ``pelvis`` or ``trunk``.
        moved: these translations, along x, y and z.
        origin: from the translated point to the middle of the hips, or to the base of the neck, in
            the axes of the root [m].
        ground: rotations of the ground's axes to those in which the root moves.
        notes: sentences about the model.
        lacks: our joints, without their side, that the model does not have.
    """

    title: str
    telling: tuple[str, ...]
    segments: Mapping[str, Segment]
    sides: Mapping[str, str]
    root: str
    moved: tuple[str, str, str]
    origin: Axis
    ground: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, those of the right side for both."""
        turned = {
            step + ("" if name in {"pelvis", "trunk"} else self.sides["right"]): None
            for name, segment in self.segments.items()
            for step, _ in segment.steps
            if isinstance(step, str)
        }
        return (*turned, *self.moved)


def _models(content: Mapping[str, Any]) -> tuple[OpenSimModel, ...]:
    return tuple(
        OpenSimModel(
            title=entry["title"],
            telling=tuple(entry["telling"]),
            segments={name: _segment(**each) for name, each in entry["segments"].items()},
            sides=entry["sides"],
            root=entry["root"],
            moved=tuple(entry["moved"]),
            origin=tuple(entry["origin"]),
            ground=_steps(entry.get("ground", ())),
            notes=tuple(content["notes"][key] for key in entry.get("notes", ())),
            lacks=tuple(entry.get("lacks", ())),
        )
        for entry in content["models"].values()
    )


def _segment(needed: list[str], steps: list[Any], parent: str | None = None) -> Segment:
    return Segment(parent, _steps(steps), tuple(needed))


def _steps(steps: Sequence[Any]) -> tuple[Step, ...]:
    return tuple(
        (turn, _AXES[axis] if isinstance(axis, str) else tuple(axis)) for turn, axis in steps
    )


_CONTENT: Final = tomllib.loads(
    resources.files("ergoqp.mocap.formats").joinpath("opensim_models.toml").read_text("utf-8")
)
MODELS: Final = _models(_CONTENT)
"""The known models; the first whose `telling` coordinates are all in the file is used."""
SHOWS: Final[Mapping[str, Sequence[str]]] = _CONTENT["shows"]
"""Coordinate, without its side -> our joints, without theirs, that only it shows."""
