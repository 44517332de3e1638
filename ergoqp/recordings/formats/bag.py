"""ROS bags: bodies, coordinate frames, poses and joint angles that ROS nodes published.

ROS 1 writes a file (.bag), ROS 2 a folder with metadata.yaml and its files (.db3 or .mcap). Most
bags contain the definitions of their messages; those of ROS 2 before Iron do not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.errors import MissingExtraError, RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.bag_files import faults, sources_of
from ergoqp.recordings.formats.bag_series import plain
from ergoqp.recordings.formats.bag_topics import MARKERS, TYPES, Topics
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.formats.ready_angles import tell_person
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.motion import JointMotion

_LONGEST: Final = 1_000_000
"""Largest number of markers or points in one message; a few broken bytes could state more."""
_EMPTY: Final = 12
"""Number of bytes of a message with an empty list."""
_NAMED: Final = 8
"""Number of topics that an error names."""
_EVERY: Final = 100
"""Messages between two calls of the progress."""


def read_bag(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the person, the poses of objects and the joint angles in a bag.

    A person is shown by markers of body tracking or by moving coordinate frames. Poses and angles
    are sampled at the person's frames, or at those of the busiest topic if there is no person. Each
    sample is the last message before the frame, and NaN if there is none or it is older than half a
    second. A message of joints does not state which joints are prismatic: their "angles" are in
    metres.

    Args:
        path: the file or folder.
        progress: is called with the share that is read.
        asked: unused, because messages have times.

    Raises:
        RecordingError: if it is not a complete bag, or shows no person.
        MissingExtraError: if rosbags is not installed.
    """
    topics = Topics(path.name)
    with ExitStack() as stack:
        reader, notes = _opened(path, stack)
        with faults(path):  # SQLite and YAML may hold any type in place of a text or a number
            connections = [each for each in reader.connections if each.msgtype in TYPES]
            found = {str(each.topic): _spoken(str(each.msgtype)) for each in reader.connections}
            stated = sum(int(each.msgcount) for each in connections)
        count = 0
        for connection, recorded, message in _messages(path, reader, connections):
            with faults(path):
                topics.take(connection.topic, connection.msgtype, message, recorded)
            count += 1
            if count % _EVERY == 0:
                progress(min(count / max(stated, 1), 1.0))
    progress(1.0)
    if count < stated:
        notes.append(f"The bag states {stated} messages on its topics and has {count}.")
    person, said = topics.person()
    frames = topics.clock() if person is None else person.frames
    if frames is None:
        why = f" ({' '.join(said)})" if said else ""
        raise RecordingError(
            f"{path.name}: got no movement in {_listed(found)}{why}, allowed messages of"
            f" {', '.join(map(_spoken, TYPES))}"
        )
    angles = topics.angles(frames)
    if person is None and not tell_person(angles):
        joints = f" and the joints {some([plain(name) for name in angles])}" if angles else ""
        raise RecordingError(
            f"{path.name}: got the topics {_listed(found)}{joints}, which show no person, allowed a"
            " person's joints: MarkerArray, tf, or JointState with all of ergoqp.JOINTS or with the"
            " coordinates of an OpenSim model from its pelvis or thorax on"
        )
    objects, within = topics.objects(frames, None if person is None else person.within)
    return JointMotion(
        () if person is None else person.names,
        np.empty((len(frames.time), 0, 3)) if person is None else person.positions,
        frames.time,
        None,
        (*notes, *(frames.notes if person is None else person.notes), *said, *within),
        turns={} if person is None else person.turns,
        objects=objects,
        angles=angles,
        unit=1.0,
    )


def _opened(path: Path, stack: ExitStack) -> tuple[Any, list[str]]:
    """Return the rosbags reader of a bag, which the stack closes, and sentences."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError("reading ROS bags", "bags", "rosbags") from None
    sources = sources_of(path, stack)
    # In Humble, markers got further fields.
    for store in (Stores.LATEST, Stores.ROS2_FOXY):
        with faults(path), ExitStack() as trial:
            reader = trial.enter_context(AnyReader(sources, default_typestore=get_typestore(store)))
            reader.typestore.max_sequence_length = _LONGEST
            undefined = [each for each in reader.connections if not each.msgdef.format.value]
            if store is Stores.ROS2_FOXY or _decodes(reader, undefined):
                stack.push(trial.pop_all())
                break
    used = [each for each in undefined if each.msgtype in TYPES]
    name = "Foxy" if store is Stores.ROS2_FOXY else "Humble and later"
    return reader, [
        f"The bag does not define its messages: those of ROS 2 {name} are used."
    ] * bool(used)


def _decodes(reader: Any, connections: list[Any]) -> bool:
    """Return whether the reader decodes the first markers, or there are none."""
    from rosbags.highlevel import AnyReaderError

    markers = [each for each in connections if each.msgtype == MARKERS]
    if not markers:  # for an empty list the reader would read all topics
        return True
    for connection, _, raw in reader.messages(markers):
        if len(raw) > _EMPTY:
            try:
                reader.deserialize(raw, connection.msgtype)
            except AnyReaderError:
                return False
            return True
    return True


def _messages(path: Path, reader: Any, connections: list[Any]) -> Iterator[tuple[Any, int, Any]]:
    """Return the messages of some topics, each with its connection and time [ns]."""
    if not connections:
        return
    stream = reader.messages(connections)
    while True:
        with faults(path):
            found = next(stream, None)
            if found is None:
                return
            connection, recorded, raw = found
            message = reader.deserialize(raw, connection.msgtype)
        yield connection, recorded, message


def _listed(topics: dict[str, str]) -> str:
    """Return a list of topics with their types in words, cut so that a sentence stays readable."""
    shown = [f"{plain(topic)} ({plain(msgtype)})" for topic, msgtype in topics.items()]
    more = [f"{len(shown) - _NAMED} more topics"] if len(shown) > _NAMED else []
    return ", ".join(shown[:_NAMED] + more) or "a bag without topics"


def _spoken(msgtype: str) -> str:
    """Return the usual name of a type of message."""
    return msgtype.replace("/msg/", "/")
