"""Where a person comes to rest at every place of the object, and an awkward one to start from.

The start of a run that is not given: an awkward place of the object that the person reaches.

It is found in a fraction of a second.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from ergoqp.errors import ErgoqpError, InputError, OutOfReachError
from ergoqp.files.cache import CacheEntry, digest_of
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import frame_of, turn_about
from ergoqp.problem.problem import PLACES, Problem, no_start
from ergoqp.rest.batch import settling
from ergoqp.rest.model_person import ModelPerson, Start
from ergoqp.rest.person_protocol import Person

SPACING = 0.10
"""Distance of neighbouring places [m]."""
TURNS = (-0.66, 0.0, 0.66)
"""Tilts of the tool axis, as shares of the half angle of the cone."""


@dataclass(frozen=True)
class Map:
    """The exact score of a person's rest posture over the workspace of the object.

    Attributes:
        poses: poses of the object (n, 4, 4).
        postures: rest postures (n, 32) [rad].
        scores: exact score of each, 0 if the person does not reach (n,).
    """

    poses: np.ndarray
    postures: np.ndarray
    scores: np.ndarray

    @property
    def best(self) -> int:
        """Lowest score over the workspace, 0 if nothing can be reached."""
        reached = self.scores[self.scores > 0]
        return int(reached.min()) if reached.size else 0


def workspace_map(
    problem: Problem, person: ModelPerson, *, spacing: float = SPACING, cache: bool = True
) -> Map:
    """Return the map of a person, from the cache if the same one was computed before.

    The poses are settled outward from the comfort posture. Each one starts from the rest
    posture of the nearest pose that was settled before.
    """
    entry = CacheEntry("maps", _key(problem, person, spacing))
    kept = entry.read(("poses", "postures", "scores")) if cache else None
    if kept is not None:
        # A cached file that is not a map is computed again.
        with contextlib.suppress(ErgoqpError, ValueError):
            return _allowed(problem, Map(kept["poses"], kept["postures"], kept["scores"]))
    result = _compute(problem, person, spacing)
    if cache:
        entry.write(poses=result.poses, postures=result.postures, scores=result.scores)
    return _allowed(problem, result)


def _allowed(problem: Problem, found: Map) -> Map:
    """Return a map in which places that the user's own limits forbid count as not reached."""
    if not problem.own_limits.limits:
        return found
    places = zip(found.poses, found.postures, strict=True)
    broken = np.array([bool(problem.own_limits.broken(pose, posture)) for pose, posture in places])
    return replace(found, scores=np.where(broken, 0, found.scores))


def _compute(problem: Problem, person: ModelPerson, spacing: float) -> Map:
    poses = workspace_poses(problem, spacing)
    poses = poses[outward(person, poses)]
    postures, reached = settle_in_order(person, poses)
    scores = np.zeros(len(poses), dtype=int)
    if reached.any():
        scores[reached] = problem.assess(postures[reached]).final
    return Map(poses, postures, scores)


def settle_in_order(
    person: ModelPerson, poses: np.ndarray, start: Start | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return rest postures (n, 32) [rad] at poses (n, 4, 4), and which are reached (n,).

    Each is settled from the nearest one before it.

    The object is held as in `start`, and the first pose is settled from the posture of
    `start`; None: comfort.
    """
    start = start or person.start_at(person.response.comfort)
    postures, reached = np.zeros((len(poses), len(start.posture))), np.zeros(len(poses), dtype=bool)
    placed, settle = features(poses), settling(person, len(poses))
    for i, pose in enumerate(poses):
        before = np.flatnonzero(reached[:i])
        seed = start.posture
        if before.size:
            seed = postures[before[np.argmin(((placed[before] - placed[i]) ** 2).sum(axis=1))]]
        postures[i], reached[i] = settle(seed, pose, start.grasp, start.soles)
    return postures, reached


def outward(person: ModelPerson, poses: np.ndarray, home: np.ndarray | None = None) -> np.ndarray:
    """Return the order (n,) in which poses (n, 4, 4) are settled: outward from `home`.

    If `home` is None, it is the pose at which the comfort posture holds the object.
    """
    home = person.contact(person.response.comfort)[0] if home is None else home
    apart = features(poses) - features(home)
    return np.argsort([np.linalg.norm(each) for each in apart], kind="stable")


def workspace_lines(problem: Problem, spacing: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Return a map's places along x, y, z [m] and tilts (k, 3, 3). Each combination is a pose."""
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    ends = zip(box.lower, box.upper, strict=True)
    lines = [np.linspace(a, b, max(1, round((b - a) / spacing) + 1)) for a, b in ends]
    return lines, tilted_frames(cone, problem.twist_limit.axes)


def workspace_poses(problem: Problem, spacing: float) -> np.ndarray:
    """Return poses (n, 4, 4) over a problem's workspace: x slowest, then y, z, tilts fastest."""
    return poses_over(*workspace_lines(problem, spacing))


def poses_over(lines: Sequence[np.ndarray], rotations: np.ndarray) -> np.ndarray:
    """Return poses (n, 4, 4) for places along x, y, z and rotations (k, 3, 3), in that order."""
    places = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    poses = np.tile(np.eye(4), (len(places), len(rotations), 1, 1))
    poses[..., :3, 3], poses[..., :3, :3] = places[:, None], rotations
    return poses.reshape(-1, 4, 4)


def tilted_frames(
    cone: AxisCone, axes: tuple[str, ...], shares: tuple[float, ...] = TURNS
) -> np.ndarray:
    """Return rotations (n, 3, 3) of the contact frame within a cone.

    They are tilts about y and z of the frame, as far as such turns are allowed.
    """
    middle = frame_of(np.asarray(cone.direction))
    half = np.radians(cone.half_angle_deg)
    about_y, about_z = ("rx" in axes or axis in axes for axis in ("ry", "rz"))
    tilts = [
        (a, b)
        for a in (shares if about_y else (0.0,))
        for b in (shares if about_z else (0.0,))
        if np.hypot(a, b) <= 0.95
    ]
    return np.stack([middle @ turn_about(1, a * half) @ turn_about(2, b * half) for a, b in tilts])


_TERMS = ("hands", "stance", "seat", "tool", "free_about_tool")


def _key(problem: Problem, person: ModelPerson, spacing: float) -> str:
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    response = person.response
    content = {
        "version": 2,
        "task": [dict(problem.task), asdict(problem.method)],
        "box": [box.lower, box.upper],
        "cone": [cone.direction, cone.half_angle_deg],
        "axes": problem.twist_limit.axes,
        "spacing": spacing,
        "lengths": dict(response.body.lengths),
        "weights": response.weight_vector.tolist(),
        "comfort": response.comfort.tolist(),
        "terms": [getattr(response, name) for name in _TERMS],
        "numbers": [response.balance, response.relaxation_time, response.damping],
        "eyes": [response.looks, response.attention, response.hanging],
    }
    return digest_of(content)


def features(poses: np.ndarray) -> np.ndarray:
    """Return numbers (..., 6) of poses (..., 4, 4), which are alike for poses near each other.

    A quarter turn of the tool axis counts as much as 30 cm.
    """
    return np.concatenate([poses[..., :3, 3], 0.2 * poses[..., :3, 0]], axis=-1)


_EDGE = 0.02
"""Distance from the ends of the workspace [m], because the hand rests slightly off the object."""


def awkward_start(problem: Problem, person: Person, seed: int, places: int = PLACES) -> np.ndarray:
    """Return the rest posture (32,) [rad] with the highest score, see `awkward_place`.

    Example:
        >>> import ergoqp
        >>> from ergoqp.rest.model_person import sample_person
        >>> from ergoqp.rest.best_place import awkward_start
        >>> problem = ergoqp.load_problem("screwing")
        >>> posture = awkward_start(problem, sample_person(problem, 0), seed=0, places=4)
        >>> posture.shape, int(problem.assess(posture).final[0]) > 1
        ((32,), True)
    """
    return awkward_place(problem, person, seed, places)[1]


def awkward_place(
    problem: Problem, person: Person, seed: int, places: int = PLACES
) -> tuple[np.ndarray, np.ndarray]:
    """Return a random place (4, 4) with a high score, and the rest posture there (32,) [rad].

    Of all places that are tried, it is the one where the rest posture scores highest.

    Args:
        problem: its workspace and tool axis define where the object can be.
        person: who follows.
        seed: seed of the places.
        places: number of places to try.

    Raises:
        InputError: if the problem has no workspace or no tool axis, or no place is one that
            the person reaches and the limits allow.
    """
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    if box is None or cone is None:
        raise InputError(
            f"problem {problem.name}: has no limits.{'workspace' if box is None else 'tool_axis'},"
            " so nothing says where the object may start; give a recording to start from"
        )
    rng = np.random.default_rng([seed, 4])
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    inset = np.minimum(_EDGE, (upper - lower) / 2)
    rotations = tilted_frames(cone, problem.twist_limit.axes)
    found, postures, notes = [], [], []
    for _ in range(places):
        pose = np.eye(4)
        pose[:3, 3] = rng.uniform(lower + inset, upper - inset)
        pose[:3, :3] = rotations[rng.integers(len(rotations))]
        posture, reached = person.reach(pose)
        note = problem.own_limits.broken(pose, posture) if reached else "out of reach"
        if note:
            notes.append(note)
        else:
            found.append(pose)
            postures.append(posture)
    if not postures:
        raise OutOfReachError(f"problem {problem.name}: {no_start(notes)}")
    worst = int(np.argmax(problem.assess(np.array(postures)).final))
    return found[worst], postures[worst]
