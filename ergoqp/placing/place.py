"""Where the object may be: the unknowns of the place, and flat maps of scores through one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import InputError
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.placing.parallel import in_order
from ergoqp.problem.geometry import frame_of, turn_about
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import outward, settle_in_order
from ergoqp.rest.model_person import ModelPerson, Start


@dataclass(frozen=True)
class PoseParametrization:
    """Poses of the object as five numbers: x, y, z [m], then two turns [rad].

    The turns are about the y and z axes of the cone's middle frame.

    Attributes:
        lower: least value of each (5,).
        upper: greatest value of each (5,); if it equals the least, the number is fixed.
        frame: middle of the cone (3, 3).
        half_angle: half angle of the cone [rad].
    """

    lower: np.ndarray
    upper: np.ndarray
    frame: np.ndarray
    half_angle: float

    @classmethod
    def of(cls, problem: Problem) -> PoseParametrization:
        """Return the placing for the workspace, tool axis and movable axes of a problem."""
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        half, axes = float(np.radians(cone.half_angle_deg)), set(problem.twist_limit.axes)
        turns = half * np.array([bool(axes & {"rx", "ry"}), bool(axes & {"rx", "rz"})])
        lower, upper = np.array([*box.lower, *-turns]), np.array([*box.upper, *turns])
        return cls(lower, upper, frame_of(np.asarray(cone.direction)), half)

    def pose(self, point: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) of a point (5,)."""
        pose = np.eye(4)
        pose[:3, 3] = point[:3]
        pose[:3, :3] = self.frame @ turn_about(1, point[3]) @ turn_about(2, point[4])
        return pose

    def point(self, pose: np.ndarray) -> np.ndarray:
        """Return the point (5,) of a pose (4, 4). The rotation about its own x is ignored."""
        x, y, z = self.frame.T @ pose[:3, 0]
        return np.array([*pose[:3, 3], np.arctan2(-z, x), np.arcsin(np.clip(y, -1, 1))])

    def holds(self, point: np.ndarray) -> bool:
        """Return whether a point is in the workspace and its tool axis in the cone."""
        inside = (point >= self.lower - 1e-9).all() and (point <= self.upper + 1e-9).all()
        return bool(
            inside and np.cos(point[3]) * np.cos(point[4]) >= np.cos(self.half_angle) - 1e-9
        )


_STEEPEST = np.radians(85.0)
"""Largest tilt about z of the frame [rad]. At a quarter turn the two tilts would coincide."""
_NEAR = 0.02
"""Allowed distance of the object from its box along an axis that it cannot move along [m].

The hand yields a little.
"""


@dataclass(frozen=True, eq=False)
class Place:
    """The poses among which the search takes place.

    The position is in the box and the tool axis in the cone. Only the axes of the twist can
    change.

    The object does not roll about its own tool axis. With two or three turning axes the tool
    axis tilts about y and z of the level frame of the cone. With one turning axis it turns
    about that axis from its given rotation. With none it keeps its rotation.

    Attributes:
        kinds: kind of each unknown: 0, 1, 2 for a coordinate, 3 and 4 for the tilts, 5 for the
            single turn.
        lower: least value of each unknown [m, rad].
        upper: greatest value [m, rad].
        axis: 0, 1, 2 for the world axis of the single turn; -1 without one.
        direction: middle of the cone (3,).
        least_cosine: cosine of its half angle.
    """

    kinds: tuple[int, ...]
    lower: np.ndarray
    upper: np.ndarray
    axis: int
    direction: np.ndarray
    least_cosine: float

    @classmethod
    def of(cls, problem: Problem) -> Place:
        """Return the place of a problem.

        Raises:
            InputError: if the problem has no workspace or no tool axis.
        """
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        if box is None or cone is None:
            missing = "workspace" if box is None else "tool_axis"
            raise InputError(
                f"problem {problem.name}: has no limits.{missing}, so nothing says where the object"
                " may be"
            )
        axes, half = problem.twist_limit.axes, np.radians(cone.half_angle_deg)
        bounds = {i: (box.lower[i], box.upper[i]) for i, name in enumerate("xyz") if name in axes}
        turns = [i for i, name in enumerate(("rx", "ry", "rz")) if name in axes]
        if len(turns) == 1:
            bounds[5] = (-np.pi, np.pi)
        elif turns:
            bounds |= {3: (-half, half), 4: (-min(half, _STEEPEST), min(half, _STEEPEST))}
        lower, upper = np.array(list(bounds.values()), dtype=float).T
        axis = turns[0] if len(turns) == 1 else -1
        return cls(
            tuple(bounds), lower, upper, axis, np.asarray(cone.direction), float(np.cos(half))
        )

    def anchor(self, problem: Problem, pose: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) to which the unknowns are applied.

        Everything that they do not change is as at the start.

        Raises:
            InputError: if the object is outside its box along an axis that it cannot move
                along.
        """
        box = problem.limit_of(WorkspaceBox)
        anchor = pose.copy()
        anchor[:3, 3] = np.clip(pose[:3, 3], box.lower, box.upper)
        off = np.abs(anchor[:3, 3] - pose[:3, 3])
        for i in set(range(3)) - set(self.kinds):
            # A box without width defines where the object is.
            if off[i] > _NEAR and box.lower[i] < box.upper[i]:
                raise InputError(
                    f"object: got {'xyz'[i]} = {pose[i, 3]:z.2f} m, where it cannot move, "
                    f"allowed {box.lower[i]:g} to {box.upper[i]:g} m"
                )
        if 3 in self.kinds:
            anchor[:3, :3] = frame_of(self.direction)
        return anchor

    def expression(self, unknowns: ca.SX, anchor: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return position (3,) and rotation (3, 3) of the object, as expressions."""
        position, rotation = ca.SX(anchor[:3, 3]), anchor[:3, :3]
        for number, kind in enumerate(self.kinds):
            if kind < 3:
                position[kind] = unknowns[number]
            elif kind < 5:
                rotation = rotation @ _turned(kind - 2, unknowns[number])
            else:
                rotation = _turned(self.axis, unknowns[number]) @ rotation
        return position, rotation

    def pose(self, unknowns: np.ndarray, anchor: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) for given unknowns."""
        pose = anchor.copy()
        for value, kind in zip(unknowns, self.kinds, strict=True):
            if kind < 3:
                pose[kind, 3] = value
            elif kind < 5:
                pose[:3, :3] = pose[:3, :3] @ turn_about(kind - 2, value)
            else:
                pose[:3, :3] = turn_about(self.axis, value) @ pose[:3, :3]
        return pose

    def unknowns(self, pose: np.ndarray, anchor: np.ndarray) -> np.ndarray:
        """Return the unknowns of the pose nearest to a given one, within their bounds."""
        local = anchor[:3, :3].T @ pose[:3, :3]
        tilts = np.arctan2(-local[2, 0], local[0, 0]), np.arcsin(np.clip(local[1, 0], -1, 1))
        values = [
            pose[kind, 3] if kind < 3 else tilts[kind - 3] if kind < 5 else 0.0
            for kind in self.kinds
        ]
        return np.clip(values, self.lower, self.upper)

    def draw(self, rng: np.random.Generator, anchor: np.ndarray) -> np.ndarray:
        """Return random unknowns within bounds and cone.

        Raises:
            InputError: if no turn about the single axis brings the tool axis into the cone.
        """
        for _ in range(1000):
            values = rng.uniform(self.lower, self.upper)
            if self.inside(self.pose(values, anchor)):
                return values
        raise InputError(
            "tool axis: the turns that the object can make do not bring it into its cone"
        )

    def inside(self, pose: np.ndarray) -> bool:
        """Return whether the tool axis is in the cone."""
        return bool(pose[:3, 0] @ self.direction >= self.least_cosine)


def _turned(axis: int, angle: ca.SX) -> ca.SX:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = ca.SX.eye(3)
    rotation[i, i] = rotation[j, j] = ca.cos(angle)
    rotation[j, i] = ca.sin(angle)
    rotation[i, j] = -rotation[j, i]
    return rotation


SPACING: Final = 0.05
"""Distance of neighbouring places of a slice [m]."""
TILTS: Final = 11
"""Number of tilts of a slice with tilts."""

_PAIRS: Final = ((0, 2), (1, 2), (0, 1), (3, 2), (4, 2), (3, 0), (4, 0), (3, 1), (4, 1), (3, 4))
_MOST: Final = 2


@dataclass(frozen=True, eq=False)
class Slice:
    """Scores over two coordinates of the object's place. The others are as at the place itself.

    Attributes:
        across: number of the horizontal coordinate of `ergoqp.placing.place.PoseParametrization`:
            x, y, z [m], two turns [rad].
        up: number of the vertical coordinate.
        horizontal: values of the horizontal coordinate (h,).
        vertical: values of the vertical coordinate (v,).
        scores: exact scores (people, v, h), 0 if the person does not reach, -1 if the object
            may not be there.
        point: the place itself (5,).
    """

    across: int
    up: int
    horizontal: np.ndarray
    vertical: np.ndarray
    scores: np.ndarray
    point: np.ndarray


def slices_through(
    problem: Problem,
    people: Sequence[ModelPerson],
    pose: np.ndarray,
    *,
    starts: Sequence[Start] | None = None,
    spacing: float = SPACING,
    jobs: int = 1,
) -> list[Slice]:
    """Return at most two slices through a place.

    They show distance and side over height, or tilt over height if nothing else moves.

    Args:
        problem: its workspace and tool axis define where the object can be.
        people: people who are put to rest at every place.
        pose: the place (4, 4), in the workspace.
        starts: how each person holds the object, and from which posture they settle; None: as
            in comfort.
        spacing: distance of neighbouring places [m].
        jobs: number of processes.
    """
    placing = PoseParametrization.of(problem)
    exact = placing.point(pose)
    # An optimum is often at an end of the workspace, up to the tolerance of its solver.
    point = np.clip(exact, placing.lower, placing.upper)
    # The rotation of the object about its tool axis stays the same.
    roll = placing.pose(exact)[:3, :3].T @ pose[:3, :3]
    free = placing.upper - placing.lower > 1e-9
    pairs = [pair for pair in _PAIRS if free[list(pair)].all()]
    flat = [pair for pair in pairs if max(pair) < 3] or pairs
    slices = []
    for across, up in flat[:_MOST]:
        horizontal, vertical = (_values(placing, number, spacing) for number in (across, up))
        points = np.tile(point, (len(vertical), len(horizontal), 1))
        points[..., across], points[..., up] = horizontal, vertical[:, None]
        allowed = np.array([placing.holds(each) for each in points.reshape(-1, 5)])
        if not allowed.any():
            continue
        poses = np.array([placing.pose(each) for each in points.reshape(-1, 5)[allowed]])
        poses[:, :3, :3] = poses[:, :3, :3] @ roll
        scores = np.full((len(people), len(allowed)), -1)
        calls = [
            (problem, person, poses, start)
            for person, start in zip(people, starts or [None] * len(people), strict=True)
        ]
        scores[:, allowed] = np.stack(in_order(_scores, calls, jobs))
        scores = scores.reshape(-1, len(vertical), len(horizontal))
        slices.append(Slice(across, up, horizontal, vertical, scores, point))
    return slices


def _values(placing: PoseParametrization, number: int, spacing: float) -> np.ndarray:
    low, high = placing.lower[number], placing.upper[number]
    count = max(2, round((high - low) / spacing) + 1) if number < 3 else TILTS
    return np.linspace(low, high, count)


def _scores(
    problem: Problem, person: ModelPerson, poses: np.ndarray, start: Start | None
) -> np.ndarray:
    order = outward(person, poses, None if start is None else start.pose)
    postures, reached = settle_in_order(person, poses[order], start)
    scores = np.zeros(len(poses), dtype=int)
    scores[order] = np.where(reached, problem.assess(postures).final, 0)
    return scores
