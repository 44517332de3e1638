"""The person as solid parts, the robot that holds the object, and the samples of a replay.

The robot in a replay: a sketch of an arm with two links on a post, solved in the plane. It shows
that a robot holds the object and from where. It does not show a particular robot, because a problem
does not describe one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ergoqp.expressions import matrix_of
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.report.body.track import Track

_SEGMENT_OF: Final = {
    "pelvis": "legs",
    "abdomen": "trunk",
    "waist": "trunk",
    "chest": "trunk",
    "shoulders": "trunk",
    "neck": "neck",
    "head": "neck",
    "nose": "neck",
    "upper_arm": "upper_arm",
    "forearm": "lower_arm",
    "palm": "wrist",
    "fingers": "wrist",
    "thumb": "wrist",
    "thigh": "legs",
    "shank": "legs",
}
"""The score that colours each shape of the model. Hair and shoes have their own colours."""


@dataclass(frozen=True, eq=False)
class Part:
    """A capsule or an ellipsoid of the body.

    Attributes:
        name: name of the shape in the model.
        owner: name of the model's body that it is fixed to.
        segment: key of the score that colours it, None without one.
        capsule: whether it is a capsule along its own z axis; else it is an ellipsoid.
        size: capsule: radius and half length of the straight part; ellipsoid: the three half
            axes [m].
        position: centre in the owner, shape (3,) [m].
        rotation: axes in the owner, shape (3, 3).
    """

    name: str
    owner: str
    segment: str | None
    capsule: bool
    size: NDArray[np.float64]
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placement:
    """Poses of the bodies of the model in n postures.

    Attributes:
        owners: names of the bodies.
        positions: shape (n, bodies, 3) [m].
        quaternions: w first, shape (n, bodies, 4).
    """

    owners: tuple[str, ...]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]

    def of(self, owner: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions (n, 3) and quaternions (n, 4) of one body."""
        i = self.owners.index(owner)
        return self.positions[:, i], self.quaternions[:, i]


def parts_of(body: Body) -> list[Part]:
    """Return the shapes of a person's model."""
    model = body.model
    parts = []
    for number in range(model.ngeom):
        geom = model.geom(number)
        side, _, rest = geom.name.partition("_")
        sided = side in ("right", "left")
        segment = _SEGMENT_OF.get(rest if sided else geom.name)
        if sided and segment not in (None, "legs"):
            segment = f"{side}_{segment}"
        parts.append(
            Part(
                name=geom.name,
                owner=model.body(int(geom.bodyid[0])).name,
                segment=segment,
                capsule=int(geom.type[0]) == mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=geom.size.copy(),
                position=geom.pos.copy(),
                rotation=matrix_of(geom.quat),
            )
        )
    return parts


def place(body: Body, postures: NDArray[np.float64], base_poses: NDArray[np.float64]) -> Placement:
    """Return the pose of every body of the model.

    Args:
        body: the person.
        postures: shape (n, 32) [rad], finite.
        base_poses: pelvis in the world, upright, shape (n, 4, 4) [m].
    """
    model = body.model
    data = mujoco.MjData(model)
    base = [model.joint(name).qposadr[0] for name in ("base_x", "base_y", "base_z")]
    yaw = model.joint("base_yaw").qposadr[0]
    hinges = [model.joint(name).qposadr[0] for name in JOINTS]
    owners = tuple(dict.fromkeys(part.owner for part in parts_of(body)))
    numbers = [model.body(owner).id for owner in owners]
    positions = np.empty((len(postures), len(owners), 3))
    quaternions = np.empty((len(postures), len(owners), 4))
    for i, (posture, pose) in enumerate(zip(postures, base_poses, strict=True)):
        data.qpos[base] = pose[:3, 3]
        data.qpos[yaw] = np.arctan2(pose[1, 0], pose[0, 0])
        data.qpos[hinges] = posture
        mujoco.mj_kinematics(model, data)
        positions[i], quaternions[i] = data.xpos[numbers], data.xquat[numbers]
    return Placement(owners, positions, quaternions)


_COLOUR: Final = (196, 201, 207)
_JOINT_COLOUR: Final = (120, 130, 142)
_RADIUS: Final = 0.024
"""Radius of the links [m]."""

_FLANGE: Final = 0.17
"""Distance from the contact along the tool axis to the end of the arm [m], behind the box."""

_BEHIND: Final = 0.55
"""Distance of the post from the middle of the object's path [m], on the far side of the person."""

_ASIDE: Final = 0.7
"""Angle of the post to the person's left, as seen from the object [rad]."""

_SLACK: Final = 1.08
"""Total length of the links, relative to the length needed."""


def arm_of(poses: NDArray[np.float64], person: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions of shoulder, elbow and flange for every pose (n, 3, 3) [m].

    Args:
        poses: poses of the object's contact frame (n, 4, 4).
        person: position of the person on the floor (2,) [m].
    """
    flanges = poses[:, :3, 3] + _FLANGE * poses[:, :3, 0]
    middle = flanges.mean(axis=0)
    away = middle[:2] - person
    away /= max(float(np.linalg.norm(away)), 1e-9)
    # Move it to the left, so that it is not between person and camera.
    cosine, sine = np.cos(_ASIDE), np.sin(_ASIDE)
    away = np.array([[cosine, -sine], [sine, cosine]]) @ away
    shoulder = np.array([*(middle[:2] + _BEHIND * away), middle[2] - 0.05])
    reach = float(np.linalg.norm(flanges - shoulder, axis=1).max()) * _SLACK / 2
    return np.array([[shoulder, _elbow(shoulder, flange, reach), flange] for flange in flanges])


def _elbow(
    shoulder: NDArray[np.float64], flange: NDArray[np.float64], link: float
) -> NDArray[np.float64]:
    """Return the elbow of two equal links, bent upward."""
    way = flange - shoulder
    half = float(np.linalg.norm(way)) / 2
    along = way / max(2 * half, 1e-9)
    up = np.array([0.0, 0.0, 1.0]) - along[2] * along
    up /= max(float(np.linalg.norm(up)), 1e-9)
    return shoulder + way / 2 + up * float(np.sqrt(max(link**2 - half**2, 0.0)))


class Holder:
    """The arm in a scene.

    Args:
        server: server of the scene.
        poses: poses of the object's contact frame (n, 4, 4).
        person: position of the person on the floor (2,) [m].
        floor: height of the floor [m].
    """

    def __init__(
        self, server: Any, poses: NDArray[np.float64], person: NDArray[np.float64], floor: float
    ) -> None:
        """Draw post, links and joints."""
        arms = arm_of(poses, person)
        scene, (shoulder, elbow, _) = server.scene, arms[0]
        length = float(np.linalg.norm(elbow - shoulder))
        height = float(shoulder[2]) - floor
        scene.add_cylinder(
            "/robot/post",
            radius=1.6 * _RADIUS,
            height=height,
            position=(*shoulder[:2], floor + height / 2),
            color=_COLOUR,
        )
        links = [
            scene.add_cylinder(f"/robot/link{i}", radius=_RADIUS, height=length, color=_COLOUR)
            for i in range(2)
        ]
        joints = [
            scene.add_icosphere(f"/robot/joint{i}", radius=1.35 * _RADIUS, color=_JOINT_COLOUR)
            for i in range(3)
        ]
        self._tracks = [Track(joint, arms[:, i]) for i, joint in enumerate(joints)]
        for i, link in enumerate(links):
            begin, end = arms[:, i], arms[:, i + 1]
            self._tracks.append(Track(link, (begin + end) / 2, _upright(end - begin)))

    def show(self, frame: int, recording: Any = None) -> None:
        """Move the arm to a frame."""
        for track in self._tracks:
            track.show(frame, recording)


def _upright(ways: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions (n, 4) that turn the z axis along ways (n, 3)."""
    turns = np.empty((len(ways), 4))
    for turn, way in zip(turns, ways, strict=True):
        mujoco.mju_quatZ2Vec(turn, way)
    return turns


LONGEST: Final = 60.0
"""Longest replay [s]. A longer movement is shown faster than real time."""

FRAME_RATE: Final = 30.0
"""Highest frame rate of the replay [Hz]."""


@dataclass(frozen=True, eq=False)
class Movement:
    """The contents of a replay: a scored movement, at every sample.

    Attributes:
        body: the person.
        time: shape (n,) [s], increasing.
        postures: shape (n, 32) [rad]; NaN if there is none.
        base_poses: pelvis in the world, upright, shape (n, 4, 4).
        final: score, 0 without a score; shape (n,).
        segments: scores of the segments, shape (n,) each; less than 1 is drawn without a colour.
        object_poses: contact frame of the held object in the world, shape (n, 4, 4), None
            without an object.
        seated: whether the person sits; a seat is then drawn.
        held: whether a robot holds the object; a robot is then drawn.
        forces: forces of the object on the hands, world-aligned, shape (n, 3) or more [N];
            None: unknown.
        ends: lowest and highest score, shape (n,) each, if `final` is the likeliest; None:
            there is no range.
    """

    body: Body
    time: NDArray[np.float64]
    postures: NDArray[np.float64]
    base_poses: NDArray[np.float64]
    final: NDArray[np.int64]
    segments: Mapping[str, NDArray[np.integer]] = field(default_factory=dict)
    object_poses: NDArray[np.float64] | None = None
    seated: bool = False
    held: bool = False
    forces: NDArray[np.float64] | None = None
    ends: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    def at(self, samples: NDArray[np.int64]) -> Movement:
        """Return some samples. A missing posture or pose is replaced by the last one before it.

        If there is none before it, the first one after it is used.
        """
        shown = _held(samples, _finite(self.postures) & _finite(self.base_poses))
        objects = self.object_poses
        if objects is not None:
            objects = np.nan_to_num(objects[_held(samples, _finite(objects))])
        return replace(
            self,
            time=self.time[samples],
            postures=np.nan_to_num(self.postures[shown]),
            base_poses=np.nan_to_num(self.base_poses[shown]),
            final=self.final[samples],
            segments={name: scores[samples] for name, scores in self.segments.items()},
            object_poses=objects,
            forces=None if self.forces is None else np.nan_to_num(self.forces[samples]),
            ends=None if self.ends is None else (self.ends[0][samples], self.ends[1][samples]),
        )


def _finite(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of n samples contain only finite numbers."""
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))


def _held(samples: NDArray[np.int64], good: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return for each sample the last good one up to it, else the first good one, else itself."""
    numbers = np.flatnonzero(good)
    return (
        numbers[np.maximum(np.searchsorted(numbers, samples, side="right") - 1, 0)]
        if len(numbers)
        else samples
    )


@dataclass(frozen=True)
class Timing:
    """The samples that a replay shows, and its speed.

    Attributes:
        samples: number of the sample of each frame, shape (frames,).
        frame_time: duration of a frame on the screen [s].
        speed: movement time over replay time, 1 for real time.
    """

    samples: NDArray[np.int64]
    frame_time: float
    speed: float

    @property
    def note(self) -> str:
        """What the replay leaves out, in one sentence."""
        rate = (
            f"{1 / self.frame_time:.2g} frames per second" if self.frame_time else "a single frame"
        )
        if self.speed > 1:
            return (
                f"The replay runs {self.speed:.3g} times faster than real time, to last"
                f" {LONGEST:.0f} s, at {rate}."
            )
        return f"The replay runs in real time, at {rate}."


def timing_of(time: NDArray[np.float64]) -> Timing:
    """Return the samples of a replay: at most 60 s and 30 frames per second, evenly spaced in time.

    Args:
        time: time of each sample, increasing, shape (n,) [s].
    """
    duration = float(time[-1] - time[0])
    if len(time) < 2 or duration <= 0:
        return Timing(np.zeros(1, dtype=np.int64), 0.0, 1.0)
    speed = max(1.0, duration / LONGEST)
    steps = max(1, min(len(time) - 1, int(np.floor(duration / speed * FRAME_RATE + 1e-9))))
    moments = np.linspace(time[0], time[-1], steps + 1)
    # Add a small tolerance, so that a moment exactly at a sample does not show the one before
    # because of rounding.
    after = (
        np.searchsorted(time, moments + 0.5 * duration / (len(time) - 1) * 1e-6, side="right") - 1
    )
    return Timing(np.clip(after, 0, len(time) - 1), duration / speed / steps, speed)
