"""Whose joints and markers a recording holds: people and things by the prefix of their names."""

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
"""Joints or markers of a person at least."""
_SHARE: Final = 0.5
"""Who has fewer joints than this share of the one with the most is a part of somebody."""
_CORNERS: Final = 3
"""Markers that show how a thing is turned."""
_SAMPLE: Final = 2000
"""Frames by which a thing's shape is found."""
_BLOCK: Final = 8192
"""Frames at once."""
_SIZE: Final = 0.5
"""Shapes are followed in metres, so a thing is taken to be so large [m]."""
_RIGID: Final = 0.05 * _SIZE
"""No point of a thing misses its shape by more [m]."""


def of_subject(
    motion: JointMotion, subject: str | None, known: Callable[[tuple[str, ...]], int], where: str
) -> JointMotion:
    """Return one person's joints, without their prefix; things of three markers become objects.

    Args:
        motion: everybody's.
        subject: whose, by the prefix; None if there is one person.
        known: how many of some names are a person's.
        where: the recording's name, for messages.

    Raises:
        RecordingError: there are two people, and nobody says which one.
        InputError: nobody is called `subject`.
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
            f" {some([repr(prefix) for prefix in groups if prefix]) or 'None: it names nobody'}"
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
            " allowed one; state whose posture is meant (subject)"
        )
    chosen = subject if subject is not None else (people[0] if people else None)
    if chosen is None:
        return motion
    said, objects = _said(chosen), dict(motion.objects)
    others = [p for p in people if p != chosen]
    for prefix, names in groups.items():
        if prefix in (chosen, "", *people) or prefix in objects:
            continue
        # Joints of somebody of whom little is seen may stand still for long.
        own, pose = tuple(names.values()), None
        if known(own) <= _SHARE * len(own):
            pose = _pose_of(np.stack([motion.of(name) for name in names], axis=1))
        if pose is None:
            others.append(prefix)
            continue
        objects[prefix] = pose
        said.append(
            f"{prefix} is an object of {len(names)} markers: its origin is their middle, its axes"
            " are the file's in its first whole frame."
        )
    if others:
        said.append(f"Also there, and left out: {some([repr(p) for p in others])}.")
    # What has no prefix belongs to nobody else, but the person's own go before it.
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
    """Return the only person's joints, without their prefix where that is no part of the names.

    Namings of skeletons know it, and mapping files may have it.
    """
    if known(tuple(names.values())) <= known(motion.names):
        return motion
    return replace(motion.joints(names), notes=(*_said(prefix), *motion.notes))


def _said(person: str) -> list[str]:
    return [f"The person is {person!r}."] if person else []


def _pose_of(points: np.ndarray) -> np.ndarray | None:
    """Return the poses (n, 4, 4) of a rigid thing by its markers; None if they do not show it.

    In half of the frames in which they are seen, at least, they keep their shape: others are of
    somebody who moves.
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
