"""The parts of a posture sheet, read from a TOML file and the values of a method.

Three modules use these parts, and nothing else describes the sheet: the exact score
(:mod:`ergoqp.sheets.assessment`), the reasons in words (:mod:`ergoqp.sheets.assessment`) and the
smooth score (:mod:`ergoqp.costs.smooth_reba`). This module does not depend on which sheet it
is.

Elevation of an arm: how far it is raised, whichever way its joints reach the direction.

Flexion and abduction of a shoulder describe some directions in two ways. Flexion 0 with
abduction 170 is 10 degrees away from flexion 170 with abduction 10, but a sheet that reads
flexion scores them 2 and 4. The elevation is the angle between the upper arm and the downward
axis of the trunk. Its plane is the direction in which the arm points: 0 degrees to the side,
90 forward, -90 backward (Wu et al., ISB recommendation on definitions of joint coordinate
systems, part II, Journal of Biomechanics 38 (2005), 981-992).
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from ergoqp.joints import INDEX, SIDES

TIE: Final = 1e-9
"""Half width of a band end [rad, or the unit of the edge].

The same 20 deg, computed in two ways, may differ in the last bits.
"""


@dataclass(frozen=True)
class StepFunction:
    """A piecewise constant function of one number: the bands of a joint, or the load.

    Attributes:
        joint: name of the joint, without the side if the segment has two.
        edges: ascending ends of the bands [rad].
        scores: one score per band, one more than `edges`.
        rises_at: thresholds that a value must exceed to be past each edge; they decide about
            ties [rad].
        words: the words for a negative and a positive value.
    """

    joint: str
    edges: tuple[float, ...]
    scores: tuple[int, ...]
    rises_at: tuple[float, ...]
    words: tuple[str, str]

    def score(self, values: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return the score of the band that each value is in. NaN is in the lowest band.

        Args:
            values: any shape, in the unit of the edges.
        """
        total = np.full(values.shape, self.scores[0], dtype=np.int8)
        for threshold, (below, above) in zip(
            self.rises_at, itertools.pairwise(self.scores), strict=True
        ):
            past = np.greater(values, threshold).astype(np.int8)
            total += past if above - below == 1 else np.int8(above - below) * past
        return total

    def band(self, value: float) -> int:
        """Return the number of the band that a value is in, 0 for the lowest."""
        return sum(value > threshold for threshold in self.rises_at)

    def lowest(self, ends: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return the lowest score between two values.

        Args:
            ends: lower and upper value (2, ...), in the unit of the edges.
        """
        return self._between(np.minimum, ends)

    def highest(self, ends: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return the highest score between two values; the argument is that of `lowest`."""
        return self._between(np.maximum, ends)

    def _between(self, worse: np.ufunc, ends: NDArray[np.float64]) -> NDArray[np.int8]:
        count = len(self.scores)
        # The scores are not monotone: between two of 2 there may be a 1.
        best = np.tile(np.array(self.scores, dtype=np.int8), (count, 1))
        for first in range(count):
            best[first, first:] = worse.accumulate(best[first, first:])
        first, last = (
            np.sum([end > threshold for threshold in self.rises_at], axis=0, dtype=np.int16)
            for end in ends
        )
        return np.take(best, first * np.int16(count) + last)


@dataclass(frozen=True)
class Modifier:
    """Points for conditions of several joints: at most one in total, or one each if `additive`."""

    conditions: tuple[StepFunction, ...]
    additive: bool


@dataclass(frozen=True)
class OptionPoints:
    """Points for a task option: added if `option` is set and `not_with` is not."""

    option: str
    points: int
    words: str
    not_with: str | None = None


@dataclass(frozen=True)
class Segment:
    """One part of the body: ``clip(start + base + modifiers + options, 1, highest)``.

    Attributes:
        name: for example ``"upper_arm"``.
        sided: the right and the left side are scored separately.
        worse_side: there is one score, by the worse of both sides of the base joint.
        start: score before anything is added.
        highest: length of the segment's axis in its table.
        base: bands of the main joint.
        skipped_by: option that sets the base to 0, or None.
        modifiers: points for other joints.
        options: points for task options.
    """

    name: str
    sided: bool
    worse_side: bool
    start: int
    highest: int
    base: StepFunction
    skipped_by: str | None
    modifiers: tuple[Modifier, ...]
    options: tuple[OptionPoints, ...]

    @property
    def sides(self) -> tuple[str, ...]:
        """Sides that are scored separately: ``("right", "left")``, or ``("",)`` for one score."""
        return SIDES if self.sided else ("",)

    @property
    def steps(self) -> tuple[StepFunction, ...]:
        """Base and conditions: every step of the segment."""
        return (self.base, *(step for modifier in self.modifiers for step in modifier.conditions))

    def joint(self, step: StepFunction, side: str) -> int:
        """Return the index in a posture of the joint of a step on one side.

        The side is ignored if the joint has only one.
        """
        paired = self.sided or (self.worse_side and step is self.base)
        return INDEX[f"{side}_{step.joint}" if paired else step.joint]

    def label(self, side: str) -> str:
        """Return the segment's key on one side, for example ``"left_wrist"``."""
        return f"{side}_{self.name}" if self.sided else self.name


@dataclass(frozen=True, eq=False)
class ScoreTable:
    """A table of scores 1, 2, ...: `cells` [score - 1, ...] of the named axes.

    The points named `plus` are added to the result.
    """

    axes: tuple[str, ...]
    plus: str
    cells: np.ndarray

    @cached_property
    def flat(self) -> np.ndarray:
        """The cells in one row (C order)."""
        return self.cells.ravel()


@dataclass(frozen=True, eq=False)
class Sheet:
    """A posture sheet with every value of its method filled in.

    Attributes:
        name: name of the sheet.
        segments: segments by name, in order.
        tables: ``A`` and ``B`` combine segments, ``C`` combines the results of these two.
        points: highest points of load, coupling and activity.
        load: points by mass [kg].
        shock: points for a shock or a rapid build-up of force.
        levels: names of the action levels, lowest first.
        level_starts: lowest final score of each level.
    """

    name: str
    segments: dict[str, Segment]
    tables: dict[str, ScoreTable]
    points: dict[str, int]
    load: StepFunction
    shock: int
    levels: tuple[str, ...]
    level_starts: tuple[int, ...]

    @property
    def places(self) -> tuple[tuple[Segment, str], ...]:
        """Every segment with each of its sides, in the order of the sheet."""
        return tuple((each, side) for each in self.segments.values() for side in each.sides)

    def of_table(self, table: str) -> tuple[Segment, ...]:
        """Return the segments along a table's axes."""
        return tuple(self.segments[name] for name in self.tables[table].axes)


Ties = Literal["lower", "higher", "inner"]


def load_description(name: str) -> dict[str, Any]:
    """Read a sheet's TOML file beside this module.

    Args:
        name: file name without its ending, for example ``"reba"``.
    """
    return tomllib.loads(
        resources.files("ergoqp.sheets").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    )


def read_sheet(
    description: Mapping[str, Any], values: Mapping[str, Any], *, ties: Ties, load_ties: Ties
) -> Sheet:
    """Return a description as a sheet, with the values of a method.

    Args:
        description: from :func:`load_description`.
        values: the value of every name that edges and alternatives refer to.
        ties: whether an angle at the end of a band gets the lower or the higher score of the
            two bands.
        load_ties: the same for the load; ``"inner"``: both ends belong to the band between
            them.
    """
    tables = {
        name: ScoreTable(
            tuple(table["axes"]), table["plus"], np.array(table["cells"], dtype=np.int8)
        )
        for name, table in description["tables"].items()
    }
    highest = {
        axis: table.cells.shape[i] for table in tables.values() for i, axis in enumerate(table.axes)
    }
    load = description["load"]
    levels = description["action_levels"]
    return Sheet(
        name=description["name"],
        segments={
            name: _read_segment(name, entry, highest[name], values, ties)
            for name, entry in description["segments"].items()
        },
        tables=tables,
        points=dict(description["points"]),
        load=_read_step({"joint": "load", "words": ("", ""), **load}, values, load_ties, unit=1.0),
        shock=load["shock"],
        levels=tuple(level["name"] for level in levels),
        level_starts=tuple(level["from"] for level in levels),
    )


def _read_segment(
    name: str, entry: Mapping[str, Any], highest: int, values: Mapping[str, Any], ties: Ties
) -> Segment:
    skip = entry.get("skipped_by")
    return Segment(
        name=name,
        sided=entry.get("sided", False),
        worse_side=entry.get("worse_side", False),
        start=entry.get("start", 0),
        highest=highest,
        base=next(
            _read_step(base, values, ties) for base in entry["base"] if _applies(base, values)
        ),
        skipped_by=None if skip is None or values[skip["unless"]] else skip["option"],
        modifiers=tuple(
            Modifier(
                tuple(
                    _read_step(c, values, ties)
                    for c in modifier["conditions"]
                    if _applies(c, values)
                ),
                additive="additive" in modifier and values[modifier["additive"]],
            )
            for modifier in entry.get("modifiers", ())
        ),
        options=tuple(OptionPoints(**option) for option in entry.get("options", ())),
    )


def _applies(entry: Mapping[str, Any], values: Mapping[str, Any]) -> bool:
    return all(values[name] == value for name, value in entry.get("when", {}).items())


def _read_step(
    entry: Mapping[str, Any], values: Mapping[str, Any], ties: Ties, unit: float = np.pi / 180
) -> StepFunction:
    edges = [_number(edge, values) * unit for edge in entry["edges"]]
    scores = entry["scores"]
    thresholds = []
    for i, edge in enumerate(edges):
        # A value at the edge stays in the band below if the edge belongs to that band.
        rises = scores[i + 1] > scores[i]
        below = {"lower": rises, "higher": not rises, "inner": i == len(edges) - 1}[ties]
        thresholds.append(edge + TIE if below else edge - TIE)
    # Two edges may coincide (a tolerance of 0). The band between them must then be empty, not
    # negative.
    thresholds = np.maximum.accumulate(thresholds).tolist()
    return StepFunction(
        entry["joint"], tuple(edges), tuple(scores), tuple(thresholds), tuple(entry["words"])
    )


def _number(edge: str | float, values: Mapping[str, Any]) -> float:
    if not isinstance(edge, str):
        return float(edge)
    return -float(values[edge[1:]]) if edge.startswith("-") else float(values[edge])


_ROWS = [(INDEX[f"{side}_shoulder_flexion"], INDEX[f"{side}_shoulder_abduction"]) for side in SIDES]


def elevation_of(postures: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return elevation and plane of the right and the left upper arm, each (n, 2) [rad].

    The plane of an arm that hangs or points straight up is 0.

    Args:
        postures: joint angles (n, 32) [rad].
    """
    found = [_raised(postures[:, flexion], postures[:, abduction]) for flexion, abduction in _ROWS]
    elevations, planes, _ = zip(*found, strict=True)
    return np.stack(elevations, axis=1), np.stack(planes, axis=1)


def by_elevation(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return joint angles (32, n) [rad] for a sheet that scores the direction of the arms.

    The flexion of the shoulder is replaced by the elevation, which is negative if the arm
    points backward more than to the side. The abduction is replaced by the angle between the
    arm and the sagittal plane.

    Args:
        angles: one row per joint (32, n) [rad].
    """
    read = angles.copy()
    for flexion, abduction in _ROWS:
        elevation, plane, aside = _raised(angles[flexion], angles[abduction])
        behind = (plane < -np.pi / 4) & (plane > -3 * np.pi / 4)
        read[flexion] = np.where(behind, -elevation, elevation)
        read[abduction] = aside
    return read


def between_elevations(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what `by_elevation` makes of all postures between two, as ends (2, 32, n) [rad].

    No posture between is beyond these ends. Where an arm may point backward or not, they may be
    wider than what can be reached.

    Args:
        ends: lower and upper joint angles (2, 32, n) [rad].
    """
    read = ends.copy()
    for flexion, abduction in _ROWS:
        bent, out = ends[:, flexion], ends[:, abduction]
        swung, aside = (
            _range_of(np.sin, bent, (-np.pi / 2, np.pi / 2)),
            _range_of(np.sin, out, (-np.pi / 2, np.pi / 2)),
        )
        down, across = (_range_of(np.cos, each, (-np.pi, 0.0, np.pi)) for each in (bent, out))
        height = np.arccos(np.clip(np.sort(_products(down, across), axis=0)[[-1, 0]], -1, 1))
        # An arm points backward where sin f cos a < -|sin a|.
        spread = np.sort(np.abs(aside), axis=0)
        spread[0] = np.where((aside[0] < 0) & (aside[1] > 0), 0.0, spread[0])
        forward = _products(swung, across)
        backward = forward.min(axis=0) < -spread[0]
        onward = forward.max(axis=0) >= -spread[1]
        read[0, flexion] = np.where(backward, -height[1], height[0])
        read[1, flexion] = np.where(onward, height[1], -height[0])
        read[:, abduction] = np.arcsin(np.clip(aside, -1, 1))
    return read


def _range_of(
    function: np.ufunc, ends: NDArray[np.float64], turns: tuple[float, ...]
) -> NDArray[np.float64]:
    """Return the lowest and highest value between ends (2, n), for a function that turns there."""
    reached = [function(ends[0]), function(ends[1])]
    reached += [function(np.clip(turn, *ends)) for turn in turns]
    return np.stack([np.min(reached, axis=0), np.max(reached, axis=0)])


def _products(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products of each end of one range with each of another (4, n)."""
    return np.stack([a * b for a in one for b in other])


def _raised(
    flexion: NDArray[np.float64], abduction: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return elevation, plane, and the angle to the sagittal plane (n,) [rad]."""
    forward, out = np.sin(flexion) * np.cos(abduction), np.sin(abduction)
    down = np.cos(flexion) * np.cos(abduction)
    aside = np.hypot(forward, out)
    plane = np.where(aside > 1e-9, np.arctan2(forward, out), 0.0)
    return np.arctan2(aside, down), plane, np.arcsin(np.clip(out, -1.0, 1.0))
