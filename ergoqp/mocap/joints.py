"""Joint centres of one person, from the joints, markers or joint angles of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ergoqp.arguments import Progress, unseen
from ergoqp.errors import InputError, RecordingError
from ergoqp.human import Body
from ergoqp.human.body import Marker
from ergoqp.mocap.formats.text import some
from ergoqp.mocap.naming import (
    CENTRES,
    LANDMARKS,
    PLACED,
    RIGID,
    MarkerSet,
    Naming,
    added_to,
    best_set,
    check_placed,
    known_namings,
    known_sets,
    landmarks_in,
    named_centres,
    naming_of,
    overlooked,
    parted,
)
from ergoqp.mocap.recording import JointMotion
from ergoqp.mocap.unseen import AHEAD, oriented, shoulders_of

if TYPE_CHECKING:
    from ergoqp.mocap.markers.joints import Astray

_LEAST: Final = 6
"""Least number of joints or markers of a person."""
_SHARE: Final = 0.5
"""A prefix with fewer joints than this share of the largest number is not a person of its own."""
_CORNERS: Final = 3
"""Number of markers that determine the orientation of a thing."""
_FOLLOWED: Final = 12
"""Most markers of a thing that are followed: every pair of them is tried for an exchange."""
_SAMPLE: Final = 2000
"""Frames from which the shape of a thing is found, about."""
_BLOCK: Final = 8192
"""Frames that are processed at once."""
_SIZE: Final = 0.5
"""Size to which a thing is scaled, because shapes are followed in metres [m]."""
_RIGID: Final = 0.05 * _SIZE
"""Largest distance of a thing's marker from its place in the shape [m]."""


def of_subject(motion: JointMotion, subject: str | None, where: str) -> JointMotion:
    """Return one person's joints, without their prefix; things of three markers become objects.

    Args:
        motion: the joints of everybody.
        subject: prefix of the person; None if there is one person.
        where: the recording's name, for messages.

    Raises:
        RecordingError: if there are several people and none is stated.
        InputError: if there is no such subject.
    """
    groups: dict[str, dict[str, str]] = {}
    for name in motion.names:
        prefix, own = parted(name)
        groups.setdefault(prefix, {})[name] = own
    if subject is not None and subject not in groups:
        subject = subject.strip("/").removesuffix(":") or subject
    if subject is not None and subject not in groups:
        raise InputError(
            f"{where}: subject: got {subject!r}, allowed"
            f" {some([repr(prefix) for prefix in groups if prefix]) or 'None: there is no prefix'}"
        )
    if not groups:
        return motion
    if len(groups) < 2:
        return _named_alike(motion, *groups.popitem())
    counts = {prefix: _known(tuple(names.values())) for prefix, names in groups.items()}
    whole = max(counts.values())
    people = [p for p, count in counts.items() if count >= max(_LEAST, _SHARE * whole)]
    if subject is None and len(people) > 1:
        raise RecordingError(
            f"{where}: got {len(people)} people ({some([p or 'without a name' for p in people])}),"
            " allowed one; state the person whose posture is meant (subject)"
        )
    chosen = subject if subject is not None else (people[0] if people else None)
    if chosen is None:
        return motion
    said, objects = _said(chosen), dict(motion.objects)
    theirs = set(groups[chosen].values())
    people += [p for p, names in groups.items() if p not in people and _is_like(names, theirs)]
    others = [p for p in people if p != chosen]
    for prefix, names in groups.items():
        if prefix in (chosen, "", *people) or prefix in objects:
            continue
        # Joints of a person of whom little is seen may stand still for long, like a thing.
        own, pose = tuple(names.values()), None
        followed = list(names)[:: -(-len(names) // _FOLLOWED)]
        if _known(own) <= _SHARE * len(own):
            pose = _pose_of(np.stack([motion.of(name) for name in followed], axis=1))
        if pose is None:
            others.append(prefix)
            continue
        objects[prefix] = pose
        count = "" if len(followed) == len(names) else f" ({len(followed)} of them are followed)"
        said.append(
            f"{prefix} is an object of {len(names)} markers{count}: its origin is their middle,"
            " and its axes are the file's axes in the first frame in which it is seen."
        )
    if others:
        said.append(f"Also in the recording, and left out: {some([repr(p) for p in others])}.")
    # Names without a prefix belong to the person, too, unless a name with the prefix is the same.
    keep = {each: new for each, new in groups.get("", {}).items() if new not in theirs}
    keep |= groups[chosen]
    return replace(motion.joints(keep), objects=objects, notes=(*said, *motion.notes))


def _named_alike(motion: JointMotion, prefix: str, names: dict[str, str]) -> JointMotion:
    """Return the only person's joints, without their prefix if the names are known better without.

    Some namings contain the prefix, and mapping files may.
    """
    if _known(tuple(names.values())) <= _known(motion.names):
        return motion
    return replace(motion.joints(names), notes=(*_said(prefix), *motion.notes))


def _is_like(names: Mapping[str, str], theirs: set[str]) -> bool:
    """Return whether joints, with and without their prefix, are named as those of a person."""
    alike = len(theirs.intersection(names.values()))
    return alike >= max(_LEAST, _SHARE * len(names))


def _said(person: str) -> list[str]:
    return [f"The person is {person!r}."] if person else []


def _pose_of(points: np.ndarray) -> np.ndarray | None:
    """Return the poses (n, 4, 4) of a rigid thing from its markers; None if they are not rigid.

    They have to keep their shape in at least half of the frames in which they are seen. Otherwise
    they belong to somebody who moves.
    """
    shown = np.flatnonzero(np.isfinite(points).all(axis=2).sum(axis=1) >= _CORNERS)
    if not len(shown):
        return None
    sample = points[shown[:: max(1, len(shown) // _SAMPLE)]].astype(float)
    extent = np.fmax.reduce(sample, axis=1) - np.fmin.reduce(sample, axis=1)
    size = float(np.median(extent.max(axis=1)))
    scale = _SIZE / size if size > 0 else 1.0
    # Only things need it.
    from ergoqp.mocap.markers.rigid import follow, shape_of

    shape = shape_of(scale * sample)
    if shape is None:
        return None
    poses, kept = np.full((len(points), 4, 4), np.nan), 0
    poses[:, 3] = [0, 0, 0, 1]
    for at in range(0, len(points), _BLOCK):
        seen = scale * points[at : at + _BLOCK].astype(float)
        followed = follow(seen, shape)
        poses[at : at + _BLOCK, :3, :3] = followed.turn
        poses[at : at + _BLOCK, :3, 3] = followed.place / scale
        away = np.linalg.norm(seen - followed.points, axis=2)
        miss = np.where(np.isfinite(seen).all(axis=2), away, 0.0).max(axis=1)
        kept += int((np.isfinite(followed.place[:, 0]) & (miss < _RIGID)).sum())
    if kept < _SHARE * len(shown):
        return None
    first = np.flatnonzero(np.isfinite(poses[:, 0, 0]))
    poses[:, :3, :3] = poses[:, :3, :3] @ poses[first[0], :3, :3].T
    return poses


_SAMPLED: Final = 4000
"""Frames in which the fit of markers to the body is evaluated, about."""


@dataclass(frozen=True, eq=False)
class Found:
    """A person's joint centres in a recording, in the file's axes.

    Attributes:
        motion: what is left of the person's motion, with the other content of the file.
        paths: our centre -> positions (n, 3).
        rest: our centre -> position (3,) in an upright rest pose; empty if there is none or it is
            not known to be upright.
        unit: unit of the centres [m]; None if it is unknown.
        said: sentences about how they were found.
        markers: used marker -> positions (n, 3) in a sample of frames [m].
        frames: indices of the frames of that sample.
        landmarks: marker -> the landmark that it marks, or the segment that it is on.
        upright: whether trunk and neck have their zero where they are straight, because the
            recording consists of joint angles.
        whole: the markers, if some are lost or left out for a while; else None.
        doubts: ``right_upper_arm``, ``left_upper_arm`` -> half-angle by which its direction may be
            off, because the acromion's marker slides (n,) [rad]; ``right_elbow_axis``,
            ``left_elbow_axis`` -> what two markers of an elbow add to the upper arm's rotation (n,)
            [rad]; empty for joints.
        read: name in the file -> what it is used as; empty if it is not used.
        unshown: our joints that nothing in the recording shows, although the centres do.
    """

    motion: JointMotion
    paths: Mapping[str, np.ndarray]
    rest: Mapping[str, np.ndarray]
    unit: float | None
    said: tuple[str, ...]
    markers: Mapping[str, np.ndarray] = field(default_factory=dict)
    frames: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))
    landmarks: Mapping[str, str] = field(default_factory=dict)
    upright: bool = False
    whole: JointMotion | None = None
    doubts: Mapping[str, np.ndarray] = field(default_factory=dict)
    read: Mapping[str, str] = field(default_factory=dict)
    unshown: tuple[str, ...] = ()


@dataclass(frozen=True)
class ReadOptions:
    """Options for reading a recording; what is None is found from the recording.

    Attributes:
        body: the person.
        shapes: marker -> its place on the body, from a person file.
        subject: the person whose joints are read: the prefix of their names.
        thing: name of the object that the person holds.
        unit: size of the unit of length [m].
        up: the vertical axis.
        naming: names of the joints.
        neutral: time at which the person is straight [s], a recording in which the person is
            straight, or ``"vertical"``.
        window: first and last time [s].
        completed: whether lost markers have been estimated already.
        trust: what is right, whatever the body shows (see `ergoqp.load_recording`).
    """

    body: Body | None = None
    shapes: Mapping[str, Marker] = field(default_factory=dict)
    subject: str | None = None
    thing: str | None = None
    unit: float | None = None
    up: str | None = None
    naming: Naming | None = None
    neutral: float | str | JointMotion | None = None
    window: tuple[float, float] | None = None
    completed: bool = False
    trust: frozenset[str] = frozenset()


def joints_of(
    motion: JointMotion, where: str, reading: ReadOptions, progress: Progress = unseen
) -> Found:
    """Return the joint centres of one person.

    Args:
        motion: content of the file.
        where: its name, for messages.
        reading: options for reading it; without a naming, the known namings and marker sets are
            tried.
        progress: is called with the share of the frames that is done.

    Raises:
        RecordingError: if the names are unknown, or the recording shows too little of a person.
        InputError: if there is no such subject.
    """
    ready = bool(motion.angles) and not motion.names
    everything = dict.fromkeys(motion.names, "")
    hidden: tuple[str, ...] = ()
    if ready:
        # Only ready angles need it.
        from ergoqp.mocap.formats.opensim import own_angles, placed_by_angles, posed, unshown

        ours = bool(own_angles(motion.angles))
        hidden = () if ours else unshown(motion, where)
        place = placed_by_angles if ours else posed
        motion = place(motion, where, reading.body, reading.trust)
        check_placed(motion.names, where, _unread(motion.columns, "columns"))
    naming, unit = reading.naming, reading.unit
    # A reader that has chosen the person gives names without a prefix.
    subject = None if reading.subject == motion.subject else reading.subject
    if subject is not None or not _names_whom(naming, motion.names):
        motion = of_subject(motion, subject, where)
    skin = _landmarks(motion.names, naming)
    if skin is None:
        used, found = naming_of(motion, naming, where)
        lost = naming.missing_in(motion.names) if naming is not None else ()
        more, turned = oriented(motion, used, found)
        shoulders, guessed = shoulders_of(motion, found)
        more, turned = more | shoulders, (*turned, *guessed)
        paths, rest = named_centres(motion, used, found, more)
        said = (*lost, *motion.notes, *turned)
        if not ready:
            said = (f"The joints are named as in the {used.title} skeleton.", *said)
        if unit is None and motion.unit is not None:
            said += (f"The unit of length is {motion.unit:g} m, as the file says.",)
        own = {motion.names[i] for which in found.values() for i in which}
        uses = _uses(motion, found)
        if AHEAD in turned:
            head = motion.names[found["head"][0]]
            uses[motion.in_file.get(head, head)] += " (the nose is guessed from its orientation)"
        read = {**everything, **({} if ready else uses), **motion.columns}
        names = motion.columns if ready else _own(motion, uses)
        said += _unread(names, "columns" if ready else "joints")
        if not ready:
            said += overlooked(_left(names), found)
        things = {name: poses for name, poses in motion.objects.items() if name not in own}
        return Found(
            _emptied(motion, things),
            paths,
            rest,
            unit or motion.unit,
            said,
            upright=ready,
            read=read,
            unshown=hidden,
        )
    found = _of_markers(motion, where, skin, reading, progress)
    used = {**skin.further, **skin.landmarks}
    uses = _uses(motion, used)
    for name in skin.others:
        uses[motion.in_file.get(name, name)] += " (guessed: a name of another marker set)"
    own = _own(motion, uses)
    said = (*found.said, *_unread(own, "markers"), *overlooked(_left(own), {*used, *CENTRES}))
    return replace(found, said=said, read={**everything, **uses, **motion.columns})


def _uses(motion: JointMotion, used: Mapping[str, tuple[int, ...]]) -> dict[str, str]:
    """Return name in the file -> what it is used as, for the used joints or markers.

    Args:
        motion: the person's joints or markers.
        used: centre, landmark or segment -> indices of its joints or markers.
    """
    found: dict[str, list[str]] = {}
    for thing, which in used.items():
        for i in which:
            name = motion.names[i]
            found.setdefault(motion.in_file.get(name, name), []).append(thing)
    return {name: ", ".join(things) for name, things in found.items()}


def with_objects(
    read: Mapping[str, str], objects: Iterable[str], held: str | None
) -> dict[str, str]:
    """Return what a file's names are used as, with its objects; the markers of one are its own.

    Args:
        read: name in the file -> what it is used as.
        objects: names of the objects.
        held: the object that is held; None: none is.
    """
    uses = {name: "object" if name == held else "" for name in objects}
    of_objects = {name: uses[parted(name)[0]] for name in read if parted(name)[0] in uses}
    return {**read, **of_objects, **uses}


def _own(motion: JointMotion, uses: Mapping[str, str]) -> dict[str, str]:
    """Return the person's joints or markers, without their prefix -> what they are used as."""
    return {name: uses.get(motion.in_file.get(name, name), "") for name in motion.names}


def _unread(uses: Mapping[str, str], what: str) -> tuple[str, ...]:
    """Return a sentence about the names that are not read, if there are any."""
    left = _left(uses)
    if not left:
        return ()
    return (f"{len(uses) - len(left)} of {len(uses)} {what} are read; not read: {some(left)}.",)


def _left(uses: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(name for name, use in uses.items() if not use)


def _of_markers(
    motion: JointMotion, where: str, skin: _Skin, reading: ReadOptions, progress: Progress
) -> Found:
    """Return the joint centres of one person from markers, as `_landmarks` found them."""
    # A skeleton needs nothing of markers.
    from ergoqp.mocap.markers.joints import (
        in_order,
        joints_of_markers,
        off_origin,
        unit_of_markers,
    )

    landmarks, further, said = skin.landmarks, skin.further, skin.said
    # A joint centre may be at the file's origin, but a marker at the origin was not seen.
    worn = {**further, **_on_skin(landmarks)}
    motion = off_origin(motion, sorted({i for which in worn.values() for i in which}))
    shapes, stated = reading.shapes, reading.unit or motion.unit
    motion, landmarks = _with_known(motion, landmarks, skin.title, shapes)
    size = unit_of_markers(motion, where, landmarks, stated)
    if stated is None:
        said += (f"The unit of length is taken as {size:g} m, from the width of the person.",)
    frames = np.arange(0, len(motion.time), max(1, len(motion.time) // _SAMPLED))
    sits = {i: name for name, which in (further | _on_skin(landmarks)).items() for i in which}
    markers = {motion.names[i]: size * motion.positions[frames, i].astype(float) for i in sits}
    used = {motion.names[i]: name for i, name in sits.items()}
    motion = in_order(motion, where, landmarks, size, "names" in reading.trust)
    paths, how, astray, doubts = joints_of_markers(
        motion, where, landmarks, further, shapes, size, progress
    )
    read = {motion.names[i] for which in (further | landmarks).values() for i in which}
    check_placed(tuple(paths), where, names=motion.names, read=read)
    things = {name: _scaled(poses, size) for name, poses in motion.objects.items()}
    return Found(
        _emptied(motion, things),
        paths,
        {},
        1.0,
        (*said, *motion.notes, *how),
        markers,
        frames,
        used,
        whole=_lacking(replace(motion, unit=size), used, astray),
        doubts=doubts,
    )


def _on_skin(landmarks: Mapping[str, tuple[int, ...]]) -> dict[str, tuple[int, ...]]:
    """Return the landmarks without the joint centres that a mapping names beside."""
    return {name: which for name, which in landmarks.items() if name in LANDMARKS}


def _with_known(
    motion: JointMotion,
    landmarks: dict[str, tuple[int, ...]],
    title: str,
    shapes: Mapping[str, Marker],
) -> tuple[JointMotion, dict[str, tuple[int, ...]]]:
    """Return motion and landmarks with those of rigid segments that only the person file has."""
    known = next((each for each in known_sets() if each.title == title), None)
    theirs = known.found_in(tuple(shapes)) if known is not None else {}
    # Fewer than three landmarks do not determine the pose of a segment.
    parts = [part for part in RIGID.values() if len(set(part) & set(landmarks)) >= 3]
    more = [mark for part in parts for mark in part if mark in theirs and mark not in landmarks]
    if not more:
        return motion, landmarks
    count = len(motion.names)
    positions = np.pad(motion.positions, [(0, 0), (0, len(more)), (0, 0)], constant_values=np.nan)
    names = (*motion.names, *(theirs[mark] for mark in more))
    places = {mark: (count + i,) for i, mark in enumerate(more)}
    return replace(motion, names=names, positions=positions, rest=None), {**landmarks, **places}


def _lacking(motion: JointMotion, used: Mapping[str, str], astray: Astray) -> JointMotion | None:
    """Return the markers without those left out; None if none is left out and none is lost."""
    from ergoqp.mocap.markers.fit import has_gaps
    from ergoqp.mocap.markers.joints import astray_said

    if not astray:
        return motion if has_gaps(motion, used) else None
    positions = motion.positions.copy()
    for i, name in enumerate(motion.names):
        for what in (name, used.get(name, "")):
            positions[astray.get(what, []), i] = np.nan
    return replace(motion, positions=positions, notes=(*motion.notes, *astray_said(motion, astray)))


def _known(names: tuple[str, ...]) -> int:
    """Return how many of some names are known names of a person's joints or markers."""
    found = best_set(names)
    counts = [len(naming.found_in(names)) for naming in known_namings()]
    return max(*counts, found[1] if found else 0)


def _names_whom(naming: Naming | None, names: tuple[str, ...]) -> bool:
    """Return whether a mapping names joints with their prefix, which selects the person."""
    theirs = {name for each in naming.centres.values() for name in each} if naming else set()
    return theirs <= set(names) and any(parted(name)[0] for name in theirs)


@dataclass(frozen=True)
class _Skin:
    """Markers on the skin, by their names.

    Attributes:
        landmarks: landmark -> indices of its markers; joint centres that a mapping names beside.
        further: segment -> indices of its further markers.
        title: the marker set.
        said: sentences about the names.
        others: markers that are named as in other sets.
    """

    landmarks: dict[str, tuple[int, ...]]
    further: dict[str, tuple[int, ...]]
    title: str
    said: tuple[str, ...]
    others: tuple[str, ...] = ()


def _landmarks(names: tuple[str, ...], mapping: Naming | None) -> _Skin | None:
    """Return the markers on the skin; None if the names are those of joints.

    A mapping is added to the known names.
    """
    joints = max(len(known.found_in(names)) for known in known_namings())
    known = landmarks_in(names)
    skin = _of_set(names, *known) if known is not None and len(known[1]) > joints else None
    if mapping is None:
        return skin
    own = mapping.found_in(names)
    # A mapping of joint centres reads the joints and not the markers beside, if it is enough.
    if not any(name in LANDMARKS for name in mapping.centres) and (
        skin is None or all(set(own) & set(needed) for needed in PLACED.values())
    ):
        return None
    if skin is None:
        return _Skin(own, {}, mapping.title, (_named(mapping.title), *mapping.missing_in(names)))
    marks = added_to(mapping, own, skin.landmarks)
    taken = {i for which in own.values() for i in which}
    further = {
        part: tuple(i for i in which if i not in taken) for part, which in skin.further.items()
    }
    said = (*skin.said, f"The {mapping.title} is added to them.", *mapping.missing_in(names))
    others = tuple(name for name in skin.others if names.index(name) not in taken)
    return _Skin(marks, further, skin.title, said, others)


def _of_set(names: tuple[str, ...], best: MarkerSet, found: Mapping[str, str]) -> _Skin:
    """Return the markers that a set, and other sets beside, find among some names."""
    place = {name: i for i, name in reversed(list(enumerate(names)))}
    own = best.found_in(names)
    further = {
        segment: tuple(place[name] for name in theirs)
        for segment, theirs in best.more_in(names).items()
    }
    said = [_named(best.title)]
    if others := tuple(name for mark, name in found.items() if mark not in own):
        said.append(f"Named as in other sets: {some(others)}.")
    marks = {mark: (place[name],) for mark, name in found.items()}
    return _Skin(marks, further, best.title, tuple(said), others)


def _named(title: str) -> str:
    return f"The markers are named as in the {title} set."


def _emptied(motion: JointMotion, things: Mapping[str, np.ndarray]) -> JointMotion:
    """Return a motion without its joints, so that their memory can be freed."""
    nowhere = np.empty((len(motion.time), 0, 3))
    return replace(motion, names=(), positions=nowhere, rest=None, turns={}, objects=things)


def _scaled(poses: np.ndarray, unit: float) -> np.ndarray:
    scaled = poses.copy()
    scaled[:, :3, 3] *= unit
    return scaled
