"""OpenSim's motion files (.mot, .sto): joint centres from the joint angles of known models.

OpenSim's motion files (.mot, .sto), which contain joint angles. About ten rows stand above the
numbers and end with "endheader". The next row names the columns (OpenSim, "Storage (.sto) and
Motion (.mot) Files"). Spreadsheet programs save such files with commas. Files by SIMM state no
version, and their angles are in degrees.

Check of the joint angles of an OpenSim model: their unit, and the signs of the hinges. Some files
state the unit of their angles wrongly, and in some models hinges bend the other way. Both give
another posture, which no later check would notice.

Joint centres from the joint angles of OpenSim's motion files. The file does not name the model of
its angles; the names of its coordinates determine it. The segments are rotated as in the model and
get the lengths of a person. The postures are then computed from the joint centres as for all other
recordings.

Joint centres from a file with ergoqp's own joint angles. Other programs may write them, too, for
example a ROS node that publishes `ergoqp.JOINTS`. The postures are computed from the joint centres
as for all other recordings; this gives the same angles.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.arguments import Progress
from ergoqp.errors import RecordingError
from ergoqp.human import Body, Kinematics
from ergoqp.joints import JOINTS, spoken
from ergoqp.mocap.formats.opensim_models import MODELS, SHOWS, OpenSimModel
from ergoqp.mocap.formats.text import (
    TableOptions,
    cells,
    read_rows,
    separator_of,
    short,
    some,
    text_lines,
)
from ergoqp.mocap.formats.times import are_alike, to_seconds
from ergoqp.mocap.naming import CENTRES, parted
from ergoqp.mocap.recording import JointMotion, count_note, said_twice

_HEAD: Final = 200
"""Largest number of rows above the numbers."""
_SPACE: Final = " \t,;"
"""Characters that spreadsheet programs put around the rows above the numbers."""
LENGTHS: Final = ("_tx", "_ty", "_tz", "transx", "transy", "transz")
"""Endings of the names of columns that are lengths and not angles."""


def read_storage(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return the joint angles of a motion file.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because the file has times.

    Raises:
        RecordingError: if it is not such a file.
    """
    with text_lines(path, progress) as lines:
        stated: dict[str, str] = {}
        while (row := lines.next("the line endheader").strip(_SPACE)).lower() != "endheader":
            key, mark, value = row.partition("=")
            if mark:
                stated[key.strip().lower()] = value.strip().lower()
            if lines.line > _HEAD:
                lines.fail(f"got {_HEAD} rows without endheader, allowed a motion file")
        head = ""
        while not head.strip(_SPACE):
            head = lines.next("the names of the columns")
            if lines.line > 2 * _HEAD:
                lines.fail("got no names of columns below endheader, allowed a motion file")
        # In some files tabs separate the names, and spaces the numbers.
        separator = separator_of(first) if (first := lines.peek()) else separator_of(head)
        names = cells(head.strip(" \t"), separator)
        while names and not names[-1]:
            names.pop()
        if not names or names[0].lower() != "time":
            lines.fail(f"got the first column {short(names[0] if names else '')}, allowed time")
        (values,) = read_rows(lines, separator, len(names), lambda rows: (rows,))
    time, kept, notes = to_seconds(path.name, values[:, 0], 1.0, [values[:, 1:]])
    notes = count_note(stated.get("nrows", ""), len(values), "rows") + notes
    degrees = stated.get("indegrees", "no") in {"yes", "true", "1"}
    if "indegrees" not in stated:
        degrees = "version" not in stated and path.suffix.lower() == ".mot"
        unit = "degrees, as in SIMM's files" if degrees else "radians"
        notes.append(f"The file does not state the unit of its angles: they are taken as {unit}.")
    if lost := names.count(""):
        notes.append(f"{lost} columns have no name and are left out.")
    columns, again, twice = _columns(names, values)
    if again:
        notes.append(said_twice(again))
    angles = {
        name: values[kept, i] * (np.pi / 180 if degrees and not is_length(name) else 1.0)
        for name, i in columns.items()
    }
    if blank := [name for name, each in angles.items() if not np.isfinite(each).all()]:
        notes.append(f"Blanks are taken as not seen, in the columns {some(blank, 6)}.")
    return JointMotion(
        (),
        np.empty((len(time), 0, 3)),
        time,
        notes=tuple(notes),
        angles=angles,
        unit=1.0,
        up="y",
        twice=twice,
    )


def _columns(
    names: list[str], values: np.ndarray
) -> tuple[dict[str, int], list[str], tuple[str, ...]]:
    """Return name -> first column (without the times), the repeated names, and those that differ.

    Args:
        names: names of the columns; an empty one belongs to no name.
        values: the numbers (n, columns).
    """
    first: dict[str, int] = {}
    again: dict[str, bool] = {}
    for i, name in enumerate(names[1:], 1):
        if name and first.setdefault(name, i) != i:
            same = bool(are_alike(values[:, [i]], values[:, [first[name]]]).all())
            again[name] = again.get(name, True) and same
    return first, list(again), tuple(name for name, same in again.items() if not same)


def is_length(name: str) -> bool:
    """Return whether the name of a column is that of a length."""
    return (coordinate_of(name) or name).lower().endswith(LENGTHS)


def coordinate_of(name: str) -> str | None:
    """Return the coordinate whose value a column holds; None for speeds and other paths.

    >>> coordinate_of("/jointset/hip_r/hip_flexion_r/value")
    'hip_flexion_r'
    """
    if "/" not in name:
        return name
    path, _, last = name.rpartition("/")
    return path.rpartition("/")[2] if last.lower() == "value" else None


Angles = Mapping[str, np.ndarray]
"""Coordinate in small letters -> angles [rad] or lengths [m] (n,)."""

_HEADINGS: Final = ("pelvis_rotation", "thorax_rotation", "ground_thorax_rot_y")
_ABOUT: Final = ("plane_elv", "axial_rot", "shoulder_plane", "shoulder_rotation")
"""In a hanging arm only the sum of two of these is determined, so each may turn without limit."""
_MOST_OF_A_COORDINATE: Final = 3.6
"""Largest angle of any other joint [rad]."""
_LEAST: Final = np.radians(0.1)
"""Smaller angles may be noise [rad]."""
_SMALL: Final = np.radians(4)
"""Nobody bends in a file without a larger angle [rad]; radians taken as degrees look like it."""
_FEW: Final = 3
"""Number of joints with small angles that have to move before the person counts as moving."""
_SWAYS: Final = np.radians(0.6)
"""Range of a joint that few joints exceed in a person who stands still [rad]."""
_STANDS: Final = 0.15
"""Range of the pelvis, or the thorax, in a person who stands still [m]."""
_KNEES: Final = ("knee_angle_r", "knee_angle_l")
_ELBOWS: Final = ("elbow_flexion", "elbow_flex_r", "elbow_flex_l")
BENT: Final = np.radians(0.5)
"""Least bend that an elbow or knee is given [rad]: a straight one would not show the rotation of
the limb, which the file states, and one that is bent backward would show the opposite rotation."""
_SHOWN: Final = np.radians(5)
"""Least bend from which a hinge shows its sign [rad]."""
_BACKWARD: Final = np.radians(10)
"""Largest backward bend of a person's joint [rad]."""


_TRUST: Final = "; or state that the angles are right (trust angles)"


def check_unit(
    model: OpenSimModel, angles: Angles, where: str, *, trusted: bool = False
) -> list[str]:
    """Raise if the unit of the angles is not the stated one; return a sentence about odd ones.

    Args:
        model: the model of the coordinates.
        angles: coordinate -> angles [rad] or lengths [m] (n,).
        where: the file's name, for messages.
        trusted: whether the unit is right, whatever the angles are.

    Raises:
        RecordingError: if an angle is too large for a joint, or a person moves without bending.
    """
    # The heading is left out, because it grows when a person turns round and round.
    turned = {
        name: angles[name]
        for name in _of_both_sides(model)
        if name in angles and name not in {*_HEADINGS, *model.moved}
    }
    largest = {name: _largest(each) for name, each in turned.items()}
    root = {step for step, _ in model.segments[model.root].steps}
    for name, farthest in largest.items():
        often = name in root or name in _ABOUT
        if farthest > (4 * np.pi if often else _MOST_OF_A_COORDINATE):
            allowed = "two whole turns" if often else f"{_MOST_OF_A_COORDINATE:g} rad"
            reached = f"{name} reaches {farthest:.4g} rad"
            if trusted:
                return [f"The unit of the angles is right, as stated, although {reached}."]
            raise RecordingError(
                f"{where}: {reached}, allowed {allowed}: the unit of the angles (inDegrees) is"
                f" wrong{_TRUST}"
            )
    most = max(largest.values(), default=0.0)
    if not _LEAST < most < _SMALL:
        return []
    small = f"no angle of the joints exceeds {np.degrees(most):.2g} deg"
    wrong = "radians that are taken as degrees look like this"
    plausible = sum(each > _LEAST for each in largest.values())
    moving = sum(_range(each) > _SWAYS for each in turned.values())
    goes = max((_range(angles[name]) for name in model.moved if name in angles), default=0.0)
    if not trusted and plausible >= _FEW and (moving >= _FEW or goes > _STANDS):
        raise RecordingError(
            f"{where}: {small} while the person moves, allowed those of a movement:"
            f" {wrong}, so the unit of the angles (inDegrees) is wrong{_TRUST}"
        )
    return [f"{small[0].upper()}{small[1:]}: {wrong}, and so does a person who stands."]


def with_bent_hinges(
    angles: Angles, where: str, *, trusted: bool = False
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the angles with positive flexion of elbows and knees, and sentences about changes.

    In gait2392 and Hamner's model, the flexion of both knees is negative.

    Args:
        angles: coordinate -> angles [rad] or lengths [m] (n,).
        where: the file's name, for messages.
        trusted: whether the signs are right, whatever the angles are.

    Raises:
        RecordingError: if an elbow, or one of two knees, is bent backward most of the time.
    """
    knees = {name: each for name, each in angles.items() if name in _KNEES}
    said = []
    if _negative(knees):
        knees = {name: -each for name, each in knees.items()}
        said = [
            "The angles of the knees are negative in flexion, as in gait2392: they are reversed."
        ]
    hinges = {name: each for name, each in angles.items() if name in _ELBOWS} | knees
    wrong = [name for name, each in hinges.items() if _is_backward(each)]
    if wrong and not trusted:
        most = max(float(-np.nanmin(hinges[name])) for name in wrong)
        raise RecordingError(
            f"{where}: {some(wrong)} {'bends' if len(wrong) == 1 else 'bend'} backward by up to"
            f" {np.degrees(most):.0f} deg, allowed {np.degrees(_BACKWARD):.0f} deg: the sign of the"
            f" angle is wrong{_TRUST}"
        )
    for name, each in hinges.items():
        if count := int((each < -_BACKWARD).sum()):
            said.append(
                f"{name} is bent backward by more than {np.degrees(_BACKWARD):.0f} deg in"
                f" {count} of {len(each)} frames, by up to {np.degrees(-np.nanmin(each)):.0f} deg:"
                " it is taken as straight there."
            )
    return {**angles, **{name: np.maximum(each, BENT) for name, each in hinges.items()}}, said


def _of_both_sides(model: OpenSimModel) -> list[str]:
    """Return the names of a model's coordinates, on both sides."""
    ends = [end for end in model.sides.values() if end]
    bare = [
        (name, next((end for end in ends if name.endswith(end)), "")) for name in model.coordinates
    ]
    return [name.removesuffix(own) + end for name, own in bare for end in (ends if own else [""])]


def _largest(values: np.ndarray) -> float:
    """Return the largest absolute value of (n,); 0 if none is known."""
    return float(np.fmax.reduce(np.abs(values), initial=0.0))


def _range(values: np.ndarray) -> float:
    """Return the range of values (n,); 0 if none is known."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _negative(knees: Angles) -> bool:
    """Return whether the flexion of the knees is negative.

    All knees that are bent far have to be negative. If none is bent far, the largest angle decides.
    """
    shown = [_is_backward(each) for each in knees.values() if (np.abs(each) > _BACKWARD).any()]
    if shown:
        return all(shown)
    every = np.concatenate([np.zeros(1), *knees.values()])
    return bool(-np.nanmin(every) > np.nanmax(every))


def _is_backward(hinge: np.ndarray) -> bool:
    """Return whether a hinge (n,) [rad] is far backward in most of the frames in which it bends."""
    bent = int((np.abs(hinge) > _SHOWN).sum())
    return 2 * int((hinge < -_BACKWARD).sum()) > bent


_AXIAL: Final = ("pelvis", "trunk")
_POSE: Final = ("_rotx", "_roty", "_rotz", "_transx", "_transy", "_transz")
"""Endings of the coordinates of an object."""
Turns = dict[str, tuple[Rotation, np.ndarray]]
"""Segment -> its orientation in the axes of the model, and whether that is known (n,) bool."""
_BLOCK: Final = 8192
"""Frames that are computed at once, because an hour does not fit into memory."""


def posed(
    motion: JointMotion, where: str, body: Body | None = None, trust: Collection[str] = ()
) -> JointMotion:
    """Return the joint centres that the joint angles of an OpenSim model determine.

    x is forward, y up and z to the right. Centres that the file does not determine are left out.

    Args:
        motion: the angles, as `ergoqp.mocap.formats.opensim.read_storage` returns them.
        where: the file's name, for messages.
        body: the person whose lengths are used; None: an average person.
        trust: what is right, whatever it looks like (see `ergoqp.load_recording`).

    Raises:
        RecordingError: if the coordinates are those of no known model, or the angles cannot be
            those of a person.
    """
    angles = _coordinates(motion)
    model = _model_of(angles, where)
    wanted = {*_of_both_sides(model), *model.moved}
    named = [path for path in motion.angles if (coordinate_of(path) or "").lower() in wanted]
    motion.check_once(named, where)
    objects = _objects(model, angles)
    of_objects = {name + end for name in objects for end in _POSE}
    columns = dict.fromkeys(motion.angles, "") | dict.fromkeys(named, "joint angle")
    columns |= {name: "object" for name in motion.angles if name.lower() in of_objects}
    doubts = check_unit(model, angles, where, trusted="angles" in trust)
    person, locked = body or Body(), _locked(model, angles)
    angles, bends = with_bent_hinges(angles, where, trusted="angles" in trust)
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
        notes.append(f"Not in the file: {some(lacking)}. What only they show is not seen.")
    if locked:
        notes.append(
            f"Taken as locked, because they never change while the person moves: {some(locked)}."
            " What only they show is not seen."
        )
    return replace(
        motion,
        names=tuple(upright),
        positions=positions,
        rest=np.stack([upright[centre][0] for centre in upright]),
        notes=(*motion.notes, *notes),
        objects={**motion.objects, **objects},
        unit=1.0,
        up="y",
        columns=columns,
    )


def unshown(motion: JointMotion, where: str) -> tuple[str, ...]:
    """Return our joints that a file's coordinates do not show, although the segments are placed.

    They belong to coordinates that are missing or locked, or are not in the model.

    Args:
        motion: the angles, as `ergoqp.mocap.formats.opensim.read_storage` returns them.
        where: the file's name, for messages.

    Raises:
        RecordingError: if the coordinates are those of no known model.
    """
    angles = _coordinates(motion)
    model = _model_of(angles, where)
    seen = set(angles) - set(_locked(model, angles))
    found = [f"{side}_{joint}" for side in model.sides for joint in model.lacks]
    for name, segment in model.segments.items():
        for side, end in _ends_of(model, name).items():
            for step, _ in segment.steps:
                if isinstance(step, str) and step + end not in seen:
                    joints = SHOWS.get(step, ())
                    found += joints if name in _AXIAL else [f"{side}_{each}" for each in joints]
    return tuple(dict.fromkeys(found))


def _locked(model: OpenSimModel, angles: Angles) -> list[str]:
    """Return the coordinates that never change while others do: the model holds them."""
    ranges = {name: _range(angles[name]) for name in _of_both_sides(model) if name in angles}
    moving = sum(each > _SWAYS for name, each in ranges.items() if name not in model.moved)
    held = [name for name, each in ranges.items() if not each and name not in model.moved]
    return held if moving >= _FEW else []


def _coordinates(motion: JointMotion) -> dict[str, np.ndarray]:
    """Return the coordinates of a file in small letters -> their values (n,)."""
    return {
        name.lower(): np.asarray(each, dtype=float)
        for path, each in motion.angles.items()
        if (name := coordinate_of(path)) is not None
    }


def is_of_model(names: Iterable[str]) -> bool:
    """Return whether some joint angles are the coordinates of a known model."""
    known = {name.lower() for path in names if (name := coordinate_of(path)) is not None}
    return _model_with(known) is not None


def _model_with(coordinates: Collection[str]) -> OpenSimModel | None:
    return next((each for each in MODELS if set(coordinates).issuperset(each.telling)), None)


def _model_of(angles: Angles, where: str) -> OpenSimModel:
    if model := _model_with(angles):
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
    shoulder = np.array([0.0, size["shoulder_height"], size["shoulder_width"] / 2])
    yield "neck", "pelvis", "trunk", np.array([0.0, size["trunk"], 0.0])
    yield "shoulder", "pelvis", "trunk", shoulder
    yield "elbow", "shoulder", "upper_arm", np.array([0.0, -size["upper_arm"], 0.0])
    yield "wrist", "elbow", "forearm", np.array([0.0, -size["forearm"], 0.0])
    yield "hip", "pelvis", "pelvis", np.array([0.0, 0.0, size["hip_width"] / 2])
    yield "knee", "hip", "thigh", np.array([0.0, -size["thigh"], 0.0])
    yield "ankle", "knee", "shank", np.array([0.0, -size["shank"], 0.0])
    for centre, start, segment in (
        ("knuckles", "wrist", "hand"),
        ("thumb", "wrist", "hand"),
        ("toe", "ankle", "foot"),
    ):
        forward, left, up = body.model.site(f"right_{centre}").pos
        yield centre, start, segment, np.array([forward, up, -left])


def _turns(model: OpenSimModel, angles: Angles, count: int) -> tuple[Turns, list[str]]:
    """Return the orientations of the segments that are determined, and the missing coordinates."""
    found: Turns = {}
    lacking: dict[str, None] = {}
    for name, segment in model.segments.items():
        for side, end in _ends_of(model, name).items():
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


def _ends_of(model: OpenSimModel, segment: str) -> Mapping[str, str]:
    """Return side -> ending of the coordinates of a segment; a single side for pelvis and trunk."""
    return {"right": ""} if segment in _AXIAL else model.sides


def _about(axis: np.ndarray, angle: np.ndarray) -> Rotation:
    """Return rotations by angles (n,) [rad]; the identity where an angle is unknown."""
    known = np.where(np.isfinite(angle), angle, 0.0)
    return Rotation.from_rotvec(known[:, None] * axis / np.linalg.norm(axis))


def _turned(turn: tuple[Rotation, np.ndarray], offset: np.ndarray) -> np.ndarray:
    """Return an offset in a segment's axes in those of the model (n, 3); NaN where unknown."""
    return np.where(turn[1][:, None], turn[0].apply(offset), np.nan)


def _objects(model: OpenSimModel, angles: Angles) -> dict[str, np.ndarray]:
    """Return the poses (n, 4, 4) of the objects in the file, in the axes of the centres."""
    back = Rotation.identity()
    for angle, axis in model.ground:
        back = back * Rotation.from_rotvec(float(angle) * np.array(axis))
    found, back = {}, back.inv()
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


def _sided(name: str, side: str) -> str:
    """Return the name of a centre or segment on a side of the body."""
    return name if name in {*_AXIAL, "neck"} else f"{side}_{name}"


_HINGES: Final = ("elbow_flexion", "knee_flexion")
_MOST_OF_A_JOINT: Final = 4 * np.pi
"""Largest angle of a joint [rad]; larger numbers are in degrees."""
_POSTURES_BLOCK: Final = 4096


def tell_person(names: Iterable[str]) -> bool:
    """Return whether joint angles are those of a person: ergoqp's own, or an OpenSim model's."""
    names = tuple(names)
    return bool(own_angles(names)) or is_of_model(names)


def own_angles(names: Iterable[str]) -> Mapping[str, str]:
    """Return our joint -> its name in the file, with a common prefix; empty if one is missing."""
    groups: dict[str, dict[str, str]] = {}
    for name in names:
        prefix, own = parted(name)
        groups.setdefault(prefix, {})[own] = name
    whole = (group for group in groups.values() if set(JOINTS) <= set(group))
    return {joint: group[joint] for group in [next(whole, {})] for joint in JOINTS if group}


def placed_by_angles(
    motion: JointMotion, where: str, body: Body | None = None, trust: Collection[str] = ()
) -> JointMotion:
    """Return the joint centres that the angles of all our joints determine, in our axes.

    Args:
        motion: the angles.
        where: the file's name, for messages.
        body: the person whose lengths are used; None: an average person.
        trust: what is right, whatever it looks like (see `ergoqp.load_recording`).

    Raises:
        RecordingError: if a joint turns by more than two whole turns.
    """
    person, columns, blind = body or Body(), [], {}
    for joint, name in own_angles(motion.angles).items():
        angle = np.asarray(motion.angles[name], dtype=float)
        if (unseen := np.isnan(angle)).any():
            blind[joint], known = unseen, np.flatnonzero(~unseen)
            filled = np.interp(np.arange(len(angle)), known, angle[known]) if len(known) else 0.0
            angle = np.where(unseen, filled, angle)
        most = _largest(angle)
        if most > _MOST_OF_A_JOINT and "angles" not in trust:
            raise RecordingError(
                f"{where}: the {spoken(joint)} reaches {most:.4g} rad, allowed two whole turns:"
                f" the angles may be in degrees{_TRUST}"
            )
        # A straight hinge would not show the rotation of the limb, which the file states.
        columns.append(np.maximum(angle, BENT) if joint.endswith(_HINGES) else angle)
    posture, kinematics = ca.SX.sym("q", len(JOINTS)), Kinematics(person)
    centres = [kinematics.at(centre, posture)[0] for centre in CENTRES]
    function = ca.Function("centres", [posture], [ca.densify(ca.vertcat(*centres))])
    postures = np.stack(columns, axis=1)
    starts = range(0, len(postures), _POSTURES_BLOCK)
    places = [np.array(function(postures[at : at + _POSTURES_BLOCK].T)) for at in starts]
    positions = np.hstack(places).reshape(len(CENTRES), 3, -1).transpose(2, 0, 1)
    notes = [
        "The joint centres are placed by the file's angles of the joints of ergoqp, with the"
        f" lengths of {'an average' if body is None else 'the'} person of {person.stature:.2f} m.",
        "The file does not state where the person stands: the pelvis stays in one place.",
    ]
    if motion.objects and not motion.beside:
        notes.append("The objects are left out: where they are beside the person is unknown.")
    return replace(
        motion,
        names=CENTRES,
        positions=positions,
        notes=(*motion.notes, *notes),
        objects=motion.objects if motion.beside else {},
        blind=blind,
        unit=1.0,
        up="z",
        columns={
            **dict.fromkeys(motion.angles, ""),
            **{name: joint for joint, name in own_angles(motion.angles).items()},
        },
    )
