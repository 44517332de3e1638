"""ROS bags of few messages, written for the tests by rosbags' own writers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags (extra 'bags') is absent")

from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ergoqp.mocap.formats.bag import read_bag
from ergoqp.mocap.formats.text import TableOptions
from ergoqp.mocap.recording import JointMotion

BEGIN = 1_600_000_000_000_000_000
"""When the bags begin [ns]."""
KINDS = ("ros1", "sqlite3", "mcap")
MARKERS = "visualization_msgs/msg/MarkerArray"
TF = "tf2_msgs/msg/TFMessage"
POSE = "geometry_msgs/msg/PoseStamped"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
ANGLES = "sensor_msgs/msg/JointState"
LIFTED = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
"""A quarter turn about z."""

_STORES = {"ros1": Stores.ROS1_NOETIC}


class Bag:
    """A bag of one of `KINDS`."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.kind = kind
        self.path = folder / ("take.bag" if kind == "ros1" else "take")
        self.store = get_typestore(_STORES.get(kind, Stores.LATEST))
        if kind == "ros1":
            text = "geometry_msgs/TransformStamped[] transforms\n"
            self.store.register(get_types_from_msg(text, TF))

    def make(self, name: str, /, **fields: Any) -> Any:
        """Return a message; what is not given is zero or empty."""
        values = {}
        for field, (node, kind) in self.store.fielddefs[name][1]:
            if field in fields:
                values[field] = fields[field]
            elif node == Nodetype.NAME:
                values[field] = self.make(kind)
            elif node == Nodetype.BASE:
                values[field] = "" if kind[0] == "string" else 0
            elif kind[0][0] == Nodetype.BASE and kind[0][1][0] != "string":
                values[field] = np.empty(0, dtype=kind[0][1][0])
            else:
                values[field] = []
        return self.store.types[name](**values)

    def header(self, time: float, frame: str) -> Any:
        """Return a header at a time since the begin [s]; without a stamp for NaN."""
        stamp = 0 if np.isnan(time) else BEGIN + round(time * 1e9)
        at = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self.make("std_msgs/msg/Header", stamp=at, frame_id=frame)

    def xyz(self, kind: str, values: Iterable[float]) -> Any:
        names = "xyzw" if kind == "Quaternion" else "xyz"
        numbers = dict(zip(names, map(float, values), strict=True))
        return self.make(f"geometry_msgs/msg/{kind}", **numbers)

    def markers(
        self, time: float, places: dict[Any, Iterable[float]], frame: str = "camera", **more: Any
    ) -> Any:
        """Return markers by their number, or by name space and number."""
        shown = []
        for key, place in places.items():
            space, number = key if isinstance(key, tuple) else ("", key)
            position = self.xyz("Point", place)
            pose = self.make("geometry_msgs/msg/Pose", position=position)
            header = self.header(time, frame)
            fields = {"header": header, "ns": space, "id": number, "type": 2, "pose": pose} | more
            shown.append(self.make("visualization_msgs/msg/Marker", **fields))
        return self.make(MARKERS, markers=shown)

    def transform(
        self,
        time: float,
        parent: str,
        child: str,
        place: Iterable[float],
        turn: Iterable[float] = (0, 0, 0, 1),
    ) -> Any:
        moved = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.xyz("Vector3", place),
            rotation=self.xyz("Quaternion", turn),
        )
        header = self.header(time, parent)
        return self.make(TRANSFORM, header=header, child_frame_id=child, transform=moved)

    def tf(self, *transforms: Any) -> Any:
        return self.make(TF, transforms=list(transforms))

    def pose(
        self,
        time: float,
        place: Iterable[float],
        turn: Iterable[float] = (0, 0, 0, 1),
        frame: str = "camera",
    ) -> Any:
        position, orientation = self.xyz("Point", place), self.xyz("Quaternion", turn)
        pose = self.make("geometry_msgs/msg/Pose", position=position, orientation=orientation)
        return self.make(POSE, header=self.header(time, frame), pose=pose)

    def angles(self, time: float, angles: dict[str, float]) -> Any:
        fields = {"name": list(angles), "position": np.array(list(angles.values()))}
        return self.make(ANGLES, header=self.header(time, ""), **fields)

    def write(self, messages: list[tuple[float, str, Any]], topics: tuple[str, ...] = ()) -> Path:
        """Write messages, each with its time since the begin [s] and its topic."""
        if self.kind == "ros1":
            writer: Any = Writer1(self.path)
        else:
            plugin = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
            writer = Writer2(self.path, version=8, storage_plugin=plugin)
        ros1 = self.kind == "ros1"
        with writer:
            known: dict[str, Any] = {}
            for time, topic, message in messages:
                kind = message.__msgtype__
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=self.store)
                serialize = self.store.serialize_ros1 if ros1 else self.store.serialize_cdr
                stamp = BEGIN + round(time * 1e9)
                writer.write(known[topic], stamp, serialize(message, kind))
            for topic in topics:
                writer.add_connection(topic, "std_msgs/msg/String", typestore=self.store)
        return self.path


def read(path: Path) -> JointMotion:
    return read_bag(path, lambda share: None, TableOptions())


def body(number: int, height: float) -> dict[int, tuple[float, float, float]]:
    """Return the 32 markers of a body: each joint is as far along x as its number."""
    return {100 * number + i: (float(i), float(number), height) for i in range(32)}
