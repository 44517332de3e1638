"""Joint centres from the joint angles of OpenSim's motion files.

The file does not name the model of its angles; the names of its coordinates determine it. The
segments are rotated as in the model and get the lengths of a person. The postures are then computed
from the joint centres as for all other recordings.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.human import Body
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.formats.opensim_angles import Angles, check_unit, with_bent_hinges
from ergoqp.recordings.formats.opensim_models import MODELS, OpenSimModel, Step
from ergoqp.recordings.formats.storage import coordinate_of
from ergoqp.recordings.motion import JointMotion

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

_AXIAL: Final = ("pelvis", "trunk")
_POSE: Final = ("_rotx", "_roty", "_rotz", "_transx", "_transy", "_transz")
"""Endings of the coordinates of an object."""
Turns = dict[str, tuple["Rotation", np.ndarray]]
"""Segment -> its orientation in the axes of the model, and whether that is known (n,) bool."""
_BLOCK: Final = 8192
"""Frames that are computed at once, because an hour does not fit into memory."""


def posed(motion: JointMotion, where: str, body: Body | None = None) -> JointMotion:
    """Return the joint centres that the joint angles of an OpenSim model determine.

    x is forward, y up and z to the right. Centres that the file does not determine are left out.

    Args:
        motion: the angles, as `ergoqp.recordings.formats.storage.read_storage` returns them.
        where: the file's name, for messages.
        body: the person whose lengths are used; None: an average person.

    Raises:
        RecordingError: if the coordinates are those of no known model, or the angles cannot be
            those of a person.
    """
    angles = {
        name.lower(): np.asarray(each, dtype=float)
        for path, each in motion.angles.items()
        if (name := coordinate_of(path)) is not None
    }
    model = _model_of(angles, where)
    doubts = check_unit(model, angles, where)
    person = body or Body()
    angles, bends = with_bent_hinges(angles, where)
    upright, lacking = _places(model, {name: np.zeros(1) for name in angles}, 1, person)
    positions = np.empty((len(motion.time), len(upright), 3), dtype=np.float32)
    for start in range(0, len(positions), _BLOCK):
        rows = slice(start, start + _BLOCK)
        some_angles = {name: each[rows] for name, each in angles.items()}
        places, _ = _places(model, some_angles, len(positions[rows]), person)
        positions[rows] = np.stack(list(places.values()), axis=1)
    notes = [
        f"The joint centres are placed by the file's joint angles (OpenSim model: {model.title}),"
        f" with the lengths of {'an average' if body is None else 'the'} person of"
        f" {person.stature:.2f} m.",
        *model.notes,
        *doubts,
        *bends,
    ]
    if lacking:
        notes.append(f"Not in the file and taken as zero: {some(lacking)}.")
    return replace(
        motion,
        names=tuple(upright),
        positions=positions,
        rest=np.stack([upright[centre][0] for centre in upright]),
        notes=(*motion.notes, *notes),
        objects={**motion.objects, **_objects(model, angles)},
        unit=1.0,
        up="y",
    )


def is_of_model(names: Iterable[str]) -> bool:
    """Return whether some joint angles are the coordinates of a known model."""
    known = {name.lower() for path in names if (name := coordinate_of(path)) is not None}
    return any(known.issuperset(model.telling) for model in MODELS)


def _model_of(angles: Angles, where: str) -> OpenSimModel:
    for model in MODELS:
        if all(name in angles for name in model.telling):
            return model
    known = {model.title: some(model.coordinates) for model in reversed(MODELS)}
    allowed = "; ".join(f"{title}: {names}" for title, names in reversed(known.items()))
    raise RecordingError(
        f"{where}: got the coordinates {some(list(angles))}, which do not place a trunk, allowed"
        f" those of a known model ({allowed})"
    )


def _places(
    model: OpenSimModel, angles: Angles, count: int, body: Body
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return centre -> positions (n, 3) [m], and the missing coordinates."""
    turns, lacking = _turns(model, angles, count)
    size, nothing = body.lengths, np.zeros(count)
    origin = np.array(model.origin)
    if model.root == "trunk":
        origin = origin - [0.0, size["trunk"], 0.0]
    moved = np.stack([angles.get(name, nothing) for name in model.moved], axis=1)
    places = {"pelvis": moved + _turned(turns[model.root], origin)}
    for centre, start, segment, offset in _bones(body):
        for side, mirror in (("right", 1.0), ("left", -1.0)):
            here, begin, turned = (_sided(name, side) for name in (centre, start, segment))
            if begin in places and turned in turns:
                bone = _turned(turns[turned], offset * [1.0, 1.0, mirror])
                places[here] = places[begin] + bone
    return places, lacking


def _bones(body: Body) -> Iterable[tuple[str, str, str, np.ndarray]]:
    """Yield each centre, the one before, the segment between, and the offset in its axes (3,)."""
    size = body.lengths
    for centre, start, segment, offset in (
        ("neck", "pelvis", "trunk", (0.0, size["trunk"], 0.0)),
        ("shoulder", "pelvis", "trunk", (0.0, size["shoulder_height"], size["shoulder_width"] / 2)),
        ("elbow", "shoulder", "upper_arm", (0.0, -size["upper_arm"], 0.0)),
        ("wrist", "elbow", "forearm", (0.0, -size["forearm"], 0.0)),
        ("hip", "pelvis", "pelvis", (0.0, 0.0, size["hip_width"] / 2)),
        ("knee", "hip", "thigh", (0.0, -size["thigh"], 0.0)),
        ("ankle", "knee", "shank", (0.0, -size["shank"], 0.0)),
    ):
        yield centre, start, segment, np.array(offset)
    for centre, start, segment in (
        ("knuckles", "wrist", "hand"),
        ("thumb", "wrist", "hand"),
        ("toe", "ankle", "foot"),
    ):
        forward, left, up = body.model.site(f"right_{centre}").pos
        yield centre, start, segment, np.array([forward, up, -left])


def _turns(model: OpenSimModel, angles: Angles, count: int) -> tuple[Turns, list[str]]:
    """Return the orientations of the segments that are determined, and the missing coordinates."""
    from scipy.spatial.transform import Rotation

    found: Turns = {}
    lacking: dict[str, None] = {}
    for name, segment in model.segments.items():
        ends = {"right": ""} if name in _AXIAL else model.sides
        for side, end in ends.items():
            parent = segment.parent and _sided(segment.parent, side)
            if any(each + end not in angles for each in segment.needed):
                continue
            if parent is None:
                turn, seen = Rotation.identity(count), np.ones(count, dtype=bool)
            elif parent in found:
                turn, seen = found[parent]
            else:
                continue
            for step, axis in segment.steps:
                if isinstance(step, str) and step + end not in angles:
                    lacking[step + end] = None
                    continue
                angle = angles[step + end] if isinstance(step, str) else np.full(count, step)
                seen = seen & np.isfinite(angle)
                mirrored = np.array(axis) * ([1, 1, 1] if side == "right" else [-1, -1, 1])
                turn = turn * _about(mirrored, angle)
            found[_sided(name, side)] = turn, seen
    return found, list(lacking)


def _about(axis: np.ndarray, angle: np.ndarray) -> Rotation:
    """Return rotations by angles (n,) [rad]; the identity where an angle is unknown."""
    from scipy.spatial.transform import Rotation

    known = np.where(np.isfinite(angle), angle, 0.0)
    return Rotation.from_rotvec(known[:, None] * axis / np.linalg.norm(axis))


def _turned(turn: tuple[Rotation, np.ndarray], offset: np.ndarray) -> np.ndarray:
    """Return an offset in a segment's axes in those of the model (n, 3); NaN where unknown."""
    return np.where(turn[1][:, None], turn[0].apply(offset), np.nan)


def _objects(model: OpenSimModel, angles: Angles) -> dict[str, np.ndarray]:
    """Return the poses (n, 4, 4) of the objects in the file, in the axes of the centres."""
    found, back = {}, _fixed(model.ground).inv()
    for name in (each.removesuffix(_POSE[0]) for each in angles if each.endswith(_POSE[0])):
        if any(name + end not in angles for end in _POSE):
            continue
        numbers = [angles[name + end] for end in _POSE]
        turn = back
        for axis, angle in zip(np.eye(3), numbers[:3], strict=True):
            turn = turn * _about(axis, angle)
        poses = np.zeros((len(numbers[0]), 4, 4))
        poses[:, :3, :3], poses[:, 3, 3] = turn.as_matrix(), 1.0
        poses[:, :3, 3] = back.apply(np.stack(numbers[3:], axis=1))
        poses[~np.isfinite(numbers).all(axis=0), :3] = np.nan
        found[name] = poses
    return found


def _fixed(steps: tuple[Step, ...]) -> Rotation:
    """Return the product of rotations by fixed angles."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.identity()
    for angle, axis in steps:
        turn = turn * Rotation.from_rotvec(float(angle) * np.array(axis))
    return turn


def _sided(name: str, side: str) -> str:
    """Return the name of a centre or segment on a side of the body."""
    return name if name in {*_AXIAL, "neck"} else f"{side}_{name}"
