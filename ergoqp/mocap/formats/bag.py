"""ROS bags: bodies, coordinate frames, poses and joint angles that ROS nodes published.

Recognition and opening of ROS bags, and the errors for broken ones. rosbags recognises a bag by its
ending. Here the content decides.

ROS 1 writes a file (.bag), ROS 2 a folder with metadata.yaml and its files (.db3 or .mcap). Most
bags contain the definitions of their messages; those of ROS 2 before Iron do not.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import Progress
from ergoqp.errors import ErgoqpError, MissingExtraError, RecordingError
from ergoqp.mocap.formats.bag_series import (
    Frames,
    Joints,
    Markers,
    Series,
    Tree,
    check_count,
    onto,
    plain,
    pose_row,
    stamp_of,
    turns_of,
)
from ergoqp.mocap.formats.opensim import tell_person
from ergoqp.mocap.formats.text import BAG_MARKS, TableOptions, beginning, short, some
from ergoqp.mocap.formats.turns import poses_of
from ergoqp.mocap.recording import JointMotion

_METADATA: Final = "metadata.yaml"
_SPECIAL: Final = "?#%"
"""Characters with a meaning in the URI by which rosbags passes a name to SQLite."""


def is_bag_folder(folder: Path) -> bool:
    """Return whether a folder is a bag of ROS 2, by its metadata."""
    metadata = folder / _METADATA
    return metadata.is_file() and b"rosbag2_bagfile_information" in beginning(metadata)


def _check_name(path: Path) -> None:
    """Raise an error if rosbags would not open a bag because of its name."""
    if not os.path.isdir(path):
        first = beginning(path, max(map(len, BAG_MARKS)))
        ending = next((end for mark, end in BAG_MARKS.items() if first.startswith(mark)), None)
        if ending is None:
            raise RecordingError(f"{path.name}: does not begin like a ROS bag")
        if path.suffix != ending:
            raise RecordingError(
                f"{path.name}: got a ROS bag with another ending, allowed {ending}: rename it"
            )
    if marks := [mark for mark in _SPECIAL if mark in str(path)]:
        raise RecordingError(
            f"{short(str(path))}: got {marks[0]} in the path of a bag, allowed a path without it"
        )


@contextmanager
def faults(path: Path) -> Iterator[None]:
    """Turn any exception of a reader into one sentence that says what is wrong with a bag."""
    try:
        yield
    except ErgoqpError:
        raise
    except Exception as error:  # of rosbags, SQLite or YAML, or any other that broken bytes cause
        raise RecordingError(f"{path.name}: {_fault(error)}") from None


def _fault(error: Exception) -> str:
    """Return in words what an exception means for a bag."""
    # Only an OSError of the system has a number; archive readers raise others, without one.
    if isinstance(error, OSError) and error.errno and error.strerror:
        return f"cannot be read ({error.strerror})"
    said = " ".join(str(error).split())
    if "not indexed" in said:
        return "the bag has no index, because its recording was cut off"
    if "missing: [" in said:
        return "metadata.yaml names files that are missing"
    if "support" in said.lower():
        return f"a bag of a kind that rosbags does not read ({said.partition(';')[0][:80]})"
    return "the bag is damaged or cut off"


MARKERS: Final = "visualization_msgs/msg/MarkerArray"
TYPES: Final = (
    MARKERS,
    "tf2_msgs/msg/TFMessage",
    "tf/msg/tfMessage",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    "sensor_msgs/msg/JointState",
)
"""Types of the messages that are read."""


class Topics:
    """Content of the messages that are read, by topic."""

    def __init__(self, where: str) -> None:
        """Begin without messages; `where` is the file's name."""
        self.where = where
        self.markers: dict[str, Markers] = {}
        self.tree = Tree(where)
        self._poses: dict[str, tuple[str, Series]] = {}
        self._angles: dict[tuple[str, ...], Series] = {}

    def take(self, topic: str, kind: str, message: Any, recorded: int) -> None:
        """Add a message of one of `TYPES` that was recorded at a time [ns]."""
        topic = plain(topic)
        if kind == MARKERS:
            place = f"{self.where}: {topic}"
            self.markers.setdefault(topic, Markers(place)).take(message, recorded)
        elif kind.lower().endswith("tfmessage"):
            self.tree.take(message, recorded, topic.endswith("tf_static"))
        elif kind.endswith("JointState"):
            self._take_angles(topic, message, recorded)
        else:
            self._take_pose(topic, message, recorded)

    def person(self) -> tuple[Joints | None, list[str]]:
        """Return the person, from the topic with the most joints, and sentences about the others.

        A topic with the joints of an Azure Kinect is preferred: other moving frames may be a
        robot's.
        """
        empty, crowded, shown = [], [], dict[str, Markers]()
        for topic, markers in self.markers.items():
            if not markers.ids:
                empty.append(f"None of the {len(markers)} messages of {topic} shows anybody.")
            elif markers.crowded:
                crowded.append(f"{topic} has {len(markers.ids)} markers or more and is not read.")
            else:
                shown[topic] = markers
        notes = empty + crowded
        best = max(shown, key=lambda name: (shown[name].kinect, len(shown[name].ids)), default=None)
        moving = self.tree.names
        if best is not None and not shown[best].kinect and len(shown[best].ids) < len(moving):
            best = None
        notes += [
            f"The markers of {topic} are not read: others are taken as the person."
            for topic in shown
            if topic != best
        ]
        if best is None:
            return (self.tree.joints() if moving else None), notes
        if moving:
            notes.append(
                f"The moving frames {some([plain(name) for name in moving])} of tf are not"
                f" read: the markers of {best} are taken as the person."
            )
        return shown[best].joints(), notes

    def clock(self) -> Frames | None:
        """Return the messages of the busiest poses or angles as frames; None if there are none."""
        poses = [series for _, series in self._poses.values()]
        busiest = max([*poses, *self._angles.values()], key=len, default=None)
        return None if busiest is None else busiest.frames(self.where)

    def objects(
        self, frames: Frames, target: str | None
    ) -> tuple[dict[str, np.ndarray], list[str]]:
        """Return the objects' poses (n, 4, 4) at frames, by their topics, and sentences.

        They are transformed into one coordinate frame where tf connects it at that time. Poses in
        frames that tf does not connect are left out.

        Args:
            frames: the frames.
            target: the coordinate frame of the person's joints; None: that of most topics.
        """
        if target is None:
            usual = Counter(within for within, _ in self._poses.values()).most_common(1)
            target = usual[0][0] if usual else None
        poses, notes, places = {}, [], []
        for topic, (within, series) in self._poses.items():
            rows = series.at(frames, f"{self.where}: {topic}")
            pose = np.concatenate([rows[:, :3], turns_of(rows[:, 3:])], axis=1)
            if within == target:
                places.append(f"{topic} in {short(str(target))}")
            elif (way := self.tree.between(within, str(target), frames)) is None:
                notes.append(
                    f"The poses of {topic} are in the frame {short(within)} and are left out: tf"
                    f" does not connect it with {short(str(target))}, the frame of the rest."
                )
                continue
            else:
                pose = onto(way, pose)
                notes.append(
                    f"The poses of {topic} are transformed by tf from the frame {short(within)} to"
                    f" {short(str(target))}."
                )
            poses[topic.lstrip("/")] = poses_of(pose[:, :3], pose[:, 3:])
        return poses, ([f"The poses are those of {some(places)}."] if places else []) + notes

    def angles(self, frames: Frames) -> Mapping[str, np.ndarray]:
        """Return the joint angles (n,) [rad] at frames, by their names."""
        found: dict[str, np.ndarray] = {}
        # If several senders have a joint, the busiest one counts.
        for names, series in sorted(self._angles.items(), key=lambda each: -len(each[1])):
            rows = series.at(frames, f"{self.where}: {names[0]}")
            for i, name in enumerate(names[1:]):
                known = found.setdefault(name, rows[:, i])
                found[name] = np.where(np.isfinite(known), known, rows[:, i])
        return found

    def _take_pose(self, topic: str, message: Any, recorded: int) -> None:
        if hasattr(message, "pose"):
            row = pose_row(message.pose.position, message.pose.orientation)
        else:
            row = pose_row(message.transform.translation, message.transform.rotation)
        within = message.header.frame_id.lstrip("/")
        usual, series = self._poses.setdefault(topic, (within, Series(7)))
        if within != usual:
            raise RecordingError(
                f"{self.where}: {topic}: got poses in the frames {short(usual)} and"
                f" {short(within)}, allowed one frame"
            )
        series.add(stamp_of(message.header), recorded, row)
        check_count(f"{self.where}: {topic}", len(self._poses), "topics of poses")

    def _take_angles(self, topic: str, message: Any, recorded: int) -> None:
        names, angles = list(message.name), message.position
        if not len(angles):  # a message of velocities or torques only
            return
        if len(angles) != len(names):
            raise RecordingError(
                f"{self.where}: {topic}: got {len(names)} names and {len(angles)} positions,"
                " allowed as many names as positions"
            )
        series = self._angles.setdefault((topic, *names), Series(len(names)))
        series.add(stamp_of(message.header), recorded, angles)
        count = len(names) + len(self._angles)
        check_count(f"{self.where}: {topic}", count, "joints or lists of joints")


_LONGEST: Final = 1_000_000
"""Largest number of markers or points in one message; a few broken bytes could state more."""
_NAMED: Final = 8
"""Number of topics that an error names."""
_EVERY: Final = 100
"""Messages between two calls of the progress."""


def read_bag(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
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
    _check_name(path)
    with faults(path):
        store = get_typestore(Stores.LATEST)
        reader = stack.enter_context(AnyReader([path], default_typestore=store))
        reader.typestore.max_sequence_length = _LONGEST
        undefined = [each for each in reader.connections if not each.msgdef.format.value]
    used = [each for each in undefined if each.msgtype in TYPES]
    return reader, [
        "The bag does not define its messages: those of the latest ROS 2 are used."
    ] * bool(used)


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
