"""People and things in a recording, told apart by the prefix of their names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.errors import InputError, RecordingError
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.markers.rigid import follow, shape_of
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.names import parted

_LEAST: Final = 6
"""Least number of joints or markers of a person."""
_SHARE: Final = 0.5
"""A prefix with fewer joints than this share of the largest number is not a person of its own."""
_CORNERS: Final = 3
"""Number of markers that determine the orientation of a thing."""
_SAMPLE: Final = 2000
"""Frames from which the shape of a thing is found, about."""
_BLOCK: Final = 8192
"""Frames that are processed at once."""
_SIZE: Final = 0.5
"""Size to which a thing is scaled, because shapes are followed in metres [m]."""
_RIGID: Final = 0.05 * _SIZE
"""Largest distance of a thing's marker from its place in the shape [m]."""


def of_subject(
    motion: JointMotion, subject: str | None, known: Callable[[tuple[str, ...]], int], where: str
) -> JointMotion:
    """Return one person's joints, without their prefix; things of three markers become objects.

    Args:
        motion: the joints of everybody.
        subject: prefix of the person; None if there is one person.
        known: function that returns how many of some names are those of a person's joints.
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
        return _named_alike(motion, *groups.popitem(), known)
    counts = {prefix: known(tuple(names.values())) for prefix, names in groups.items()}
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
    others = [p for p in people if p != chosen]
    for prefix, names in groups.items():
        if prefix in (chosen, "", *people) or prefix in objects:
            continue
        # Joints of a person of whom little is seen may stand still for long, like a thing.
        own, pose = tuple(names.values()), None
        if known(own) <= _SHARE * len(own):
            pose = _pose_of(np.stack([motion.of(name) for name in names], axis=1))
        if pose is None:
            others.append(prefix)
            continue
        objects[prefix] = pose
        said.append(
            f"{prefix} is an object of {len(names)} markers: its origin is their middle, and its"
            " axes are the file's axes in the first frame in which it is seen."
        )
    if others:
        said.append(f"Also in the recording, and left out: {some([repr(p) for p in others])}.")
    # Names without a prefix belong to the person, too, unless a name with the prefix is the same.
    own = set(groups[chosen].values())
    keep = {each: new for each, new in groups.get("", {}).items() if new not in own}
    keep |= groups[chosen]
    return replace(motion.joints(keep), objects=objects, notes=(*said, *motion.notes))


def _named_alike(
    motion: JointMotion,
    prefix: str,
    names: dict[str, str],
    known: Callable[[tuple[str, ...]], int],
) -> JointMotion:
    """Return the only person's joints, without their prefix if the names are known better without.

    Some namings contain the prefix, and mapping files may.
    """
    if known(tuple(names.values())) <= known(motion.names):
        return motion
    return replace(motion.joints(names), notes=(*_said(prefix), *motion.notes))


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
