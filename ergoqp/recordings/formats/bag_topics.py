"""The messages of a ROS bag that show a person and objects, by topic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.bag_markers import Markers, Shown
from ergoqp.recordings.formats.bag_series import MOST, Frames, Series, plain, stamp_of
from ergoqp.recordings.formats.bag_tree import Moved, Tree, onto, pose_row, turns_of
from ergoqp.recordings.formats.opening import short, some
from ergoqp.recordings.formats.poses import poses_of

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
        self._poses: dict[str, dict[str, Series]] = {}
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

    def person(self) -> tuple[Shown | Moved | None, list[str]]:
        """Return the person, from the topic with the most joints, and sentences about the others.

        A topic with the joints of an Azure Kinect is preferred: other moving frames may be a
        robot's.
        """
        notes = []
        shown: dict[str, Markers] = {}
        for topic, markers in self.markers.items():
            if not markers.ids:
                notes.append(f"None of the {len(markers)} messages of {topic} shows anybody.")
            elif markers.crowded:
                notes.append(f"{topic} has {len(markers.ids)} markers or more and is not read.")
            else:
                shown[topic] = markers
        best = max(shown, key=lambda name: (shown[name].kinect, len(shown[name].ids)), default=None)
        moving = self.tree.names
        if best is not None and (shown[best].kinect or len(shown[best].ids) >= len(moving)):
            notes += [
                f"The markers of {topic} are not read: those of {best} are taken as the person."
                for topic in shown
                if topic != best
            ]
            if moving:
                notes.append(
                    f"The moving frames {some([plain(name) for name in moving])} of tf are not"
                    f" read: the markers of {best} are taken as the person."
                )
            return shown[best].joints(), notes
        notes += [
            f"The markers of {topic} are not read: tf has more moving frames." for topic in shown
        ]
        return (self.tree.joints() if moving else None), notes

    def clock(self) -> Frames | None:
        """Return the messages of the busiest poses or angles as frames; None if there are none."""
        poses = [series for within in self._poses.values() for series in within.values()]
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
            target: the coordinate frame of the person's joints; None: that of most messages.
        """
        count: Counter[str] = Counter()
        for series in self._poses.values():
            count.update({within: len(each) for within, each in series.items()})
        if target is None and count:
            target = count.most_common(1)[0][0]
        poses, notes, places = {}, [], []
        for topic, series in self._poses.items():
            rows = np.full((len(frames.time), 7), np.nan, dtype=np.float32)
            read = False
            # A topic with poses in several coordinate frames is read in the busiest one first.
            for within, each in sorted(series.items(), key=lambda item: -len(item[1])):
                found, said = self._brought(topic, within, each, frames, str(target))
                notes += said
                if found is not None:
                    rows = np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, found)
                    read = True
            if read:
                poses[topic.lstrip("/")] = poses_of(rows[:, :3], rows[:, 3:])
            if list(series) == [target]:
                places.append(f"{topic} in {short(str(target))}")
        return poses, ([f"The poses are those of {some(places)}."] if places else []) + notes

    def _brought(
        self, topic: str, within: str, series: Series, frames: Frames, target: str
    ) -> tuple[np.ndarray | None, list[str]]:
        """Return poses (n, 7) in a coordinate frame, None if it is not connected, and sentences."""
        rows = series.at(frames, f"{self.where}: {topic}")
        pose = np.concatenate([rows[:, :3], turns_of(rows[:, 3:])], axis=1)
        if within == target:
            return pose, []
        way = self.tree.between(within, target, frames)
        if way is None:
            return None, [
                f"The poses of {topic} are in the frame {short(within)} and are left out: tf does"
                f" not connect it with {short(target)}, the frame of the rest."
            ]
        return onto(way, pose), [
            f"The poses of {topic} are transformed by tf from the frame {short(within)} to"
            f" {short(target)}."
        ]

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
        series = self._poses.setdefault(topic, {})
        within = message.header.frame_id.lstrip("/")
        series.setdefault(within, Series(7)).add(stamp_of(message.header), recorded, row)
        self._check(len(self._poses) + len(series), f"{topic}: got", "topics or frames of poses")

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
        self._check(len(names) + len(self._angles), f"{topic}: got", "joints or lists of joints")

    def _check(self, count: int, what: str, things: str) -> None:
        if count > MOST:
            raise RecordingError(
                f"{self.where}: {what} more than {MOST} {things}, allowed at most that many"
            )
