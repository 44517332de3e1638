"""Joint centres of one person, from the joints, markers or joint angles of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ergoqp.human import Body
from ergoqp.human.person_file import Marker
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.formats.opensim import posed
from ergoqp.recordings.formats.ready_angles import own_angles, placed_by_angles
from ergoqp.recordings.markers.completion import has_gaps
from ergoqp.recordings.markers.joints import Astray, astray_said, joints_of_markers, unit_of_markers
from ergoqp.recordings.markers.landmarks import LANDMARKS, RIGID, best_set, known_sets
from ergoqp.recordings.markers.origin import off_origin
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.names import parted
from ergoqp.recordings.naming import (
    NamedCentres,
    Naming,
    check_all_there,
    check_placed,
    known_namings,
    named_centres,
    naming_of,
)
from ergoqp.recordings.oriented import oriented
from ergoqp.recordings.shoulders import shoulders_of
from ergoqp.recordings.subjects import of_subject

_SAMPLED: Final = 4000
"""Frames in which the fit of markers to the body is evaluated, about."""


@dataclass(frozen=True, eq=False)
class Found:
    """A person's joint centres in a recording, in the file's axes.

    Attributes:
        motion: what is left of the person's motion, with the other content of the file.
        centres: the centres under our names.
        unit: unit of the centres [m]; None if it is unknown.
        said: sentences about how they were found.
        markers: used marker -> positions (n, 3) in a sample of frames [m].
        frames: indices of the frames of that sample.
        landmarks: marker -> the landmark that it marks, or the segment that it is on.
        upright: whether trunk and neck have their zero where they are straight, because the
            recording consists of joint angles.
        whole: the markers, if some are lost or left out for a while; else None.
    """

    motion: JointMotion
    centres: NamedCentres
    unit: float | None
    said: tuple[str, ...]
    markers: Mapping[str, np.ndarray] = field(default_factory=dict)
    frames: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))
    landmarks: Mapping[str, str] = field(default_factory=dict)
    upright: bool = False
    whole: JointMotion | None = None


def joints_of(
    motion: JointMotion,
    where: str,
    naming: Naming | None,
    subject: str | None,
    unit: float | None,
    shapes: Mapping[str, Marker],
    body: Body | None = None,
    progress: Progress = unseen,
) -> Found:
    """Return the joint centres of one person.

    Args:
        motion: content of the file.
        where: its name, for messages.
        naming: names of the joints or markers; None tries the known namings and marker sets.
        subject: the person, if there are several.
        unit: the file's unit of length [m] as the user states it.
        shapes: marker -> its place on the body, from a person file.
        body: the person, if their lengths are known.
        progress: is called with the share of the frames that is done.

    Raises:
        RecordingError: if the names are unknown, or the recording shows too little of a person.
        InputError: if there is no such subject.
    """
    ready = bool(motion.angles) and not motion.names
    if ready:
        place = placed_by_angles if own_angles(motion.angles) else posed
        motion = place(motion, where, body)
    if subject is not None or not _names_whom(naming, motion.names):
        motion = of_subject(motion, subject, _known, where)
    landmarks, further, title = _landmarks(motion.names, naming, where)
    if not landmarks:
        used, found = naming_of(motion, naming, where)
        more, turned = oriented(motion, used, found)
        shoulders, guessed = shoulders_of(motion, found)
        more, turned = more | shoulders, (*turned, *guessed)
        named = named_centres(motion, used, found, more)
        said = (*motion.notes, *turned)
        if not ready:
            said = (f"The joints are named as in the {named.title} skeleton.", *said)
        if unit is None and motion.unit is not None:
            said += (f"The unit of length is {motion.unit:g} m, as the file says.",)
        own = {motion.names[i] for which in found.values() for i in which}
        things = {name: poses for name, poses in motion.objects.items() if name not in own}
        return Found(
            _emptied(motion, things),
            named,
            unit or motion.unit,
            said,
            upright=ready,
        )
    said: tuple[str, ...] = (f"The markers are named as in the {title} set.",)
    # A joint centre may be at the file's origin, but a marker at the origin was not seen.
    skin = {**further, **{name: which for name, which in landmarks.items() if name in LANDMARKS}}
    motion = off_origin(motion, sorted({i for which in skin.values() for i in which}))
    motion, landmarks = _with_known(motion, landmarks, title, shapes)
    stated = unit or motion.unit
    size = unit_of_markers(motion, where, landmarks, stated)
    if stated is None:
        said += (f"The unit of length is taken as {size:g} m, from the width of the person.",)
    frames = np.arange(0, len(motion.time), max(1, len(motion.time) // _SAMPLED))
    sits = {i: name for name, which in (further | landmarks).items() for i in which}
    markers = {motion.names[i]: size * motion.positions[frames, i].astype(float) for i in sits}
    used = {motion.names[i]: name for i, name in sits.items()}
    paths, how, astray = joints_of_markers(
        motion, where, landmarks, further, shapes, size, progress
    )
    check_placed(tuple(paths), where)
    things = {name: _scaled(poses, size) for name, poses in motion.objects.items()}
    return Found(
        _emptied(motion, things),
        NamedCentres(title, paths, {}),
        1.0,
        (*said, *motion.notes, *how),
        markers,
        frames,
        used,
        whole=_lacking(replace(motion, unit=size), used, astray),
    )


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


def _landmarks(
    names: tuple[str, ...], naming: Naming | None, where: str
) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]], str]:
    """Return landmark -> indices of its markers, segment -> further markers, and the set's title.

    All are empty if the names match those of joints better. A mapping may name joint centres beside
    landmarks; these are returned with the landmarks.
    """
    if naming is not None:
        found = naming.found_in(names)
        landmarks = {name: which for name, which in found.items() if name in LANDMARKS}
        if not landmarks:
            return {}, {}, ""
        check_all_there(naming, found, names, where)
        return found, {}, naming.title
    best = best_set(names)
    if best is None or best[1] <= max(len(known.found_in(names)) for known in known_namings()):
        return {}, {}, ""
    marker_set, place = best[0], {name: i for i, name in reversed(list(enumerate(names)))}
    landmarks = {mark: (place[name],) for mark, name in marker_set.found_in(names).items()}
    further = {
        segment: tuple(place[name] for name in theirs)
        for segment, theirs in marker_set.more_in(names).items()
    }
    return landmarks, further, marker_set.title


def _emptied(motion: JointMotion, things: Mapping[str, np.ndarray]) -> JointMotion:
    """Return a motion without its joints, so that their memory can be freed."""
    nowhere = np.empty((len(motion.time), 0, 3))
    return replace(motion, names=(), positions=nowhere, rest=None, turns={}, objects=things)


def _scaled(poses: np.ndarray, unit: float) -> np.ndarray:
    scaled = poses.copy()
    scaled[:, :3, 3] *= unit
    return scaled
