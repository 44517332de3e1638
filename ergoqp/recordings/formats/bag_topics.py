"""The messages of a ROS bag that say where a person and objects are, topic by topic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.bag_markers import Markers, Shown
from ergoqp.recordings.formats.bag_series import MOST, Frames, Series, plain, stamp_of
from ergoqp.recordings.formats.bag_tree import Moved, Tree, pose_row, turns_of
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
    """What the messages say, kept as they come."""

    def __init__(self, where: str) -> None:
        """Begin without any, of the file of this name."""
        self.where = where
        self.markers: dict[str, Markers] = {}
        self.tree = Tree(where)
        self._poses: dict[str, Series] = {}
        self._within: dict[str, Counter[str]] = {}
        self._angles: dict[tuple[str, ...], Series] = {}

    def take(self, topic: str, kind: str, message: Any, recorded: int) -> None:
        """Add a message of one of `TYPES`, recorded at this time [ns]."""
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
        """Return who is shown, by the topic that shows most joints, and what is left out.

        The joints of an Azure Kinect are a person's; what else moves may be a robot.
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
        """Return the messages of the busiest pose or angles as frames; None without any."""
        every = {**self._poses, **self._angles}
        busiest = max(every.values(), key=len, default=None)
        return None if busiest is None else busiest.frames(self.where)

    def objects(self, frames: Frames) -> tuple[dict[str, np.ndarray], list[str]]:
        """Return the objects' poses (n, 4, 4) at frames, by their topics, and sentences."""
        poses = {}
        for topic, series in self._poses.items():
            rows = series.at(frames, f"{self.where}: {topic}")
            poses[topic.lstrip("/")] = poses_of(rows[:, :3], turns_of(rows[:, 3:]))
        places = [
            f"{topic} in {' and '.join(short(name) for name in within)}"
            for topic, within in self._within.items()
        ]
        return poses, [f"The poses are those of {some(places)}."] if places else []

    def angles(self, frames: Frames) -> Mapping[str, np.ndarray]:
        """Return the joint angles (n,) [rad] at frames, by their names."""
        found: dict[str, np.ndarray] = {}
        # A joint that several senders tell is the busiest one's.
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
        self._poses.setdefault(topic, Series(7)).add(stamp_of(message.header), recorded, row)
        within = self._within.setdefault(topic, Counter())
        within[message.header.frame_id.lstrip("/")] += 1
        self._check(len(self._poses) + len(within), f"{topic}: got", "topics or frames of poses")

    def _take_angles(self, topic: str, message: Any, recorded: int) -> None:
        names, angles = list(message.name), message.position
        if not len(angles):  # speeds or torques alone
            return
        if len(angles) != len(names):
            raise RecordingError(
                f"{self.where}: {topic}: got {len(names)} names and {len(angles)} positions,"
                " allowed as many"
            )
        series = self._angles.setdefault((topic, *names), Series(len(names)))
        series.add(stamp_of(message.header), recorded, angles)
        self._check(len(names) + len(self._angles), f"{topic}: got", "joints or lists of joints")

    def _check(self, count: int, what: str, things: str) -> None:
        if count > MOST:
            raise RecordingError(f"{self.where}: {what} more than {MOST} {things}, allowed so many")
