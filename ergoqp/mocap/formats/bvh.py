"""Biovision hierarchy files (.bvh): joint centres by forward kinematics, and postures as a file.

Parser of BVH files: skeleton and numbers, in one pass that trusts nothing in the file. The rows are
read in blocks, because an hour does not fit into memory. The stated number of frames is checked,
and an early end of the file is refused. What hangs from a joint whose number is missing (NaN) is
not seen in that frame. Errors name the line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

import casadi as ca
import numpy as np

from ergoqp.arguments import Progress, unseen
from ergoqp.errors import InputError, RecordingError
from ergoqp.files.atomic import write_text_atomic
from ergoqp.human import Body, Kinematics
from ergoqp.joints import JOINTS, SIDES
from ergoqp.mocap.formats.text import TableOptions, binary, is_nothing, short
from ergoqp.mocap.formats.times import count_repeated_frames
from ergoqp.mocap.recording import JointMotion

CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")
"""The channel names of the format."""

_LARGEST = 1e8  # largest number, in any unit of length and in degrees
_SHORTEST_FRAME = 1e-5  # seconds; nobody measures so often
_LONGEST_FRAME = 10.0  # seconds; a longer frame time is a frame rate written in its place
_BLOCK: Final = 4096  # rows that are converted to numbers at once
_MOST_JOINTS: Final = 500  # a person with every finger and face bone has about 200
_BODY: Final = 8  # joints that turn; a skeleton with fewer is no person
_STILL: Final = 0.5  # a body that turns by less is still in radians and in degrees
_WHOLE_TURN: Final = 2 * math.pi + 0.01
_DEEPEST = 100  # nested joints; a person with all fingers has about ten


@dataclass(frozen=True)
class Joint:
    """One joint of a skeleton.

    Attributes:
        name: its name in the file.
        offset: its position in its parent at rest, shape (3,) [file unit].
        channels: the `CHANNELS` of its columns, in their order.
        depth: number of joints above it; its parent is the last joint before it with one less.
    """

    name: str
    offset: np.ndarray
    channels: tuple[str, ...]
    depth: int


@dataclass
class _Cursor:
    """The lines of one file and the current line, so that every error names its line."""

    path: Path
    lines: Iterator[str]
    line: int = 0
    """Number of the last line that was returned, counted from 1; 0 before the first."""
    empty: bool = True
    """Whether all lines so far were blank."""

    def words(self) -> list[str] | None:
        """Return the words of the next line that is not blank; None at the end."""
        for text in self.lines:
            self.line += 1
            if words := text.split():
                self.empty = False
                return words
        return None

    def next(self, wanted: str) -> list[str]:
        """Return the words of the next line that is not blank."""
        if (words := self.words()) is not None:
            return words
        if self.empty:
            raise RecordingError(f"{self.path.name}: got an empty file, allowed a BVH file")
        raise RecordingError(
            f"{self.path.name}: the file ends in line {self.line}, required is {wanted}"
        )

    def part(self, keyword: str) -> list[str]:
        """Return the words of the next line after the keyword with which it has to begin."""
        words = self.next("the skeleton's last closing brace")
        alone = keyword in "{}"
        if words[0] != keyword or (alone and len(words) > 1):
            allowed = f"{keyword} alone on its line" if alone else f"a line {keyword}"
            self.fail(f"got {short(' '.join(words))}, allowed here is {allowed}")
        return words[1:]

    def fail(self, problem: str) -> NoReturn:
        raise RecordingError(f"{self.path.name}, line {self.line}: {problem}")

    def number(self, word: str, what: str) -> float:
        try:
            value = float(word if _plain(word) else "")
        except ValueError:
            self.fail(f"{what}: got {short(word)}, allowed a number")
        if not abs(value) <= _LARGEST:  # also false for NaN
            self.fail(f"{what}: got {short(word)}, allowed finite numbers up to {_LARGEST:g}")
        return value


def _lines(file: BinaryIO, cursor: _Cursor) -> Iterator[str]:
    """Yield the lines of a file, with any of the usual line ends."""
    for number, raw in enumerate(file):
        try:
            text = raw.decode("utf-8" if number else "utf-8-sig")
        except UnicodeDecodeError:
            raise RecordingError(
                f"{cursor.path.name}, line {cursor.line + 1}: got a byte that is not UTF-8, allowed"
                " plain text"
            ) from None
        yield from text.removesuffix("\n").removesuffix("\r").split("\r")


def _read_skeleton(cursor: _Cursor) -> tuple[Joint, ...]:
    """Read the skeleton up to the closing brace of its root."""
    joints = [_read_joint(cursor, cursor.part("ROOT"), 0)]
    inside = [joints[0]]
    while inside:
        words = cursor.next("the skeleton's last closing brace")
        if words == ["}"]:
            inside.pop()
        elif words[0] == "JOINT":
            joints.append(_read_joint(cursor, words[1:], len(inside)))
            inside.append(joints[-1])
        elif words[0] == "End":
            cursor.part("{")
            _read_offset(cursor)
            cursor.part("}")
        else:
            cursor.fail(
                f"got {short(' '.join(words))}, allowed inside joint {short(inside[-1].name)} are"
                " JOINT, End Site, or its closing brace alone on a line"
            )
    if len(joints) > _MOST_JOINTS:
        cursor.fail(f"got {len(joints)} joints, allowed {_MOST_JOINTS}")
    if not any(joint.channels for joint in joints):
        cursor.fail("got a skeleton without channels, allowed a joint with channels at least")
    return tuple(joints)


def _read_joint(cursor: _Cursor, words: list[str], depth: int) -> Joint:
    """Read a joint up to its channels."""
    if len(words) != 1:
        cursor.fail(f"a joint: got {short(' '.join(words))}, allowed one name without spaces")
    name = words[0]
    if depth >= _DEEPEST:
        cursor.fail(
            f"joint {short(name)} is nested too deeply, allowed {_DEEPEST} joints inside each other"
        )
    cursor.part("{")
    return Joint(name, _read_offset(cursor), _read_channels(cursor), depth)


def _read_offset(cursor: _Cursor) -> np.ndarray:
    words = cursor.part("OFFSET")
    if len(words) != 3:
        cursor.fail(f"OFFSET: got {len(words)} numbers, allowed 3")
    # Single precision is finer than any measurement, and keeps earlier postures the same to the
    # last bit.
    return np.array([cursor.number(word, "OFFSET") for word in words], np.float32).astype(float)


def _read_channels(cursor: _Cursor) -> tuple[str, ...]:
    count, *names = cursor.part("CHANNELS") or ["no count"]
    if count != str(len(names)):
        cursor.fail(
            f"CHANNELS: got {len(names)} channels, allowed the stated number, {short(count)}"
        )
    for name in names:
        if name not in CHANNELS:
            cursor.fail(f"got the channel {short(name)}, allowed {', '.join(CHANNELS)}")
    if len(set(names)) != len(names):
        cursor.fail("got a channel twice in one joint, allowed once")
    return tuple(names)


def _read_motion(cursor: _Cursor) -> tuple[int, int, float]:
    """Return the stated number of rows, the line that states it, and the frame time [s]."""
    words = cursor.next("the line MOTION: it holds a skeleton but no movement")
    if words != ["MOTION"]:
        cursor.fail(f"got {short(' '.join(words))}, allowed the line MOTION after the skeleton")
    words = cursor.next("the line 'Frames:'")
    if words[0] != "Frames:" or len(words) != 2 or not re.fullmatch(r"[0-9]{1,18}", words[1]):
        cursor.fail(f"got {short(' '.join(words))}, allowed 'Frames: <whole number>'")
    stated, stated_line = int(words[1]), cursor.line
    words = cursor.next("the line 'Frame Time:'")
    if words[:2] != ["Frame", "Time:"] or len(words) != 3:
        cursor.fail(f"got {short(' '.join(words))}, allowed 'Frame Time: <seconds>'")
    frame_time = cursor.number(words[2], "the frame time")
    if not _SHORTEST_FRAME <= frame_time <= _LONGEST_FRAME:
        cursor.fail(
            f"the frame time: got {frame_time:g} s, allowed {_SHORTEST_FRAME:g} to"
            f" {_LONGEST_FRAME:g} s"
        )
    return stated, stated_line, frame_time


def _rows(cursor: _Cursor, channels: int, stated: int, stated_line: int) -> Iterator[np.ndarray]:
    """Yield the rows, block by block; raise at the end if their number is not the stated one."""
    found, block = 0, []
    while (words := cursor.words()) is not None:
        found += 1
        if found > stated:
            continue
        block.append(_row(cursor, words, channels))
        if len(block) == _BLOCK:
            yield np.array(block)
            block = []
    if stated != found or not found:
        what = "there is no movement in it"
        if found:
            what = "the recording is cut or was joined with another"
        raise RecordingError(
            f"{cursor.path.name}, line {stated_line}: got {found} rows, allowed {stated} as"
            f" stated; {what}"
        )
    if block:
        yield np.array(block)


def _row(cursor: _Cursor, words: list[str], channels: int) -> list[float]:
    if len(words) != channels:
        cursor.fail(f"got a row of {len(words)} numbers, allowed {channels}, one for each channel")
    try:
        values = [float(word) for word in words] if _plain("".join(words)) else [math.nan]
    except ValueError:
        values = [math.nan]
    if not all(abs(value) <= _LARGEST for value in values):
        values = [
            math.nan if is_nothing(word) else cursor.number(word, f"number {column} of the row")
            for column, word in enumerate(words, start=1)
        ]
    return values


def _plain(text: str) -> bool:
    """Return whether a text has no numbers that only Python accepts, such as 1_0."""
    return text.isascii() and "_" not in text


def read_bvh(
    path: Path, progress: Progress = unseen, asked: TableOptions | None = None
) -> JointMotion:
    """Read a BVH file.

    End sites are not joints: they state the drawn length of the last bone, not a measured point.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: whether the rotations are trusted to be degrees.

    Returns:
        The centres of all joints of the file's skeleton.

    Raises:
        RecordingError: if the file is not a complete BVH file, or its rotations look like radians.
    """
    with binary(path) as file:
        cursor = _Cursor(path, iter(()))
        cursor.lines = _lines(file, cursor)
        words = cursor.next("the line HIERARCHY")
        if words != ["HIERARCHY"]:
            cursor.fail(f"a BVH file starts with the line HIERARCHY, got {short(' '.join(words))}")
        joints = _read_skeleton(cursor)
        channels = sum(len(joint.channels) for joint in joints)
        stated, stated_line, frame_time = _read_motion(cursor)
        # A number and its separator are at least two bytes.
        size, count = path.stat().st_size, 0
        most = min(stated, size // (2 * channels) + 1)
        # Single precision is finer than any measurement and halves the memory.
        positions = np.empty((most, len(joints), 3), dtype=np.float32)
        lost, most = 0, 0.0
        turned = [c.endswith("rotation") for joint in joints for c in joint.channels]
        for rows in _rows(cursor, channels, stated, stated_line):
            lost += int(np.isnan(rows).any(axis=1).sum())
            most = float(np.fmax.reduce(np.abs(rows[:, turned]), axis=None, initial=most))
            positions[count : count + len(rows)] = _places(joints, rows)
            count += len(rows)
            progress(file.tell() / size)
    if asked is None or "angles" not in asked.trust:
        _check_degrees(path, joints, most)
    rest = _places([replace(joint, channels=()) for joint in joints], np.zeros((1, 0)))
    notes = [f"The frames are uniform in time, {frame_time:g} s apart, as the file states."]
    if lost:
        notes.append(
            f"In {lost} of {count} frames a number is missing: what hangs from its joint is not"
            " seen there."
        )
    motion = JointMotion(
        tuple(joint.name for joint in joints),
        positions[:count],
        frame_time * np.arange(count),
        rest[0],
        (*notes, *count_repeated_frames(positions[:count])),
    )
    return motion.once()


def _check_degrees(path: Path, joints: Sequence[Joint], most: float) -> None:
    """Raise if the rotations of a whole body look like radians.

    Args:
        path: the file.
        joints: its joints.
        most: the largest rotation in the file, in any direction.
    """
    turning = sum(any(c.endswith("rotation") for c in joint.channels) for joint in joints)
    if turning >= _BODY and _STILL < most <= _WHOLE_TURN:
        raise RecordingError(
            f"{path.name}: no rotation exceeds {most:.3g}, allowed degrees: radians look like this,"
            " and so does a body that hardly turns; multiply the rotations by 57.3, or state that"
            " they are degrees (trust angles)"
        )


def _places(joints: Sequence[Joint], rows: np.ndarray) -> np.ndarray:
    """Return the centres of joints (n, m, 3) by forward kinematics [file unit]."""
    positions = np.empty((len(rows), len(joints), 3))
    column = 0
    # Positions and rotations of the possible parents of the next joint, the world first.
    above = [(np.zeros((len(rows), 3)), np.broadcast_to(np.eye(3), (len(rows), 3, 3)))]
    for number, joint in enumerate(joints):
        parent_position, parent_rotation = above[joint.depth]
        width = len(joint.channels)
        offset, rotation = _local(joint, rows[:, column : column + width])
        column += width
        positions[:, number] = parent_position + np.einsum("nij,nj->ni", parent_rotation, offset)
        above[joint.depth + 1 :] = [(positions[:, number], parent_rotation @ rotation)]
    return positions


def _local(joint: Joint, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's offset (n, 3) and rotation (n, 3, 3) in its parent.

    Position channels replace the offset.
    """
    offset = np.tile(joint.offset, (len(values), 1))
    rotation = np.broadcast_to(np.eye(3), (len(values), 3, 3))
    for channel, value in zip(joint.channels, values.T, strict=True):
        axis = "XYZ".index(channel[0])
        if channel.endswith("position"):
            offset[:, axis] = value
        else:
            rotation = rotation @ _turn(axis, np.radians(value))
    return offset, rotation


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return the rotations about a coordinate axis, shape (n, 3, 3)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn


_ARM: Final = ("shoulder", "elbow", "wrist", "knuckles")
_LEG: Final = ("hip", "knee", "ankle", "toe")
_CHAINS: Final = (
    ("pelvis", "trunk", "neck", "head", "head_top"),
    ("head", "nose"),
    *(("trunk", *(f"{side}_{name}" for name in _ARM)) for side in SIDES),
    *((f"{side}_wrist", f"{side}_thumb") for side in SIDES),
    *(("pelvis", *(f"{side}_{name}" for name in _LEG)) for side in SIDES),
)
"""Joints of the file, each of which hangs from the one before."""
_PARENT: Final = {child: above for chain in _CHAINS for above, child in pairwise(chain)}
"""Joint of the file -> its parent; each rotates with the body's frame of the same name."""

# The usual axes of the format: x to the left, y up, z forward.
_TO_FILE: Final = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
_UNITS_PER_METRE: Final = 100.0
_ROTATIONS: Final = ("Zrotation", "Xrotation", "Yrotation")


def write_bvh(
    path: str | Path, postures: np.ndarray, base_poses: np.ndarray, body: Body, frame_time: float
) -> Path:
    """Write a movement of the body as a BVH file that `ergoqp.load_recording` reads back.

    Args:
        path: file to write.
        postures: joint angles, shape (n, 32) [rad].
        base_poses: poses of the upright pelvis in the world, shape (n, 4, 4) [m].
        body: the person.
        frame_time: period between two postures [s].

    Returns:
        The path written.

    Raises:
        InputError: if a shape does not fit, a value is not finite, or the frame time is not
            positive.
    """
    postures, base_poses = np.asarray(postures, dtype=float), np.asarray(base_poses, dtype=float)
    frames = len(postures)
    if postures.shape != (frames, len(JOINTS)) or base_poses.shape != (frames, 4, 4) or not frames:
        raise InputError(
            f"postures and base_poses: got the shapes {postures.shape} and {base_poses.shape}, "
            f"allowed (n, {len(JOINTS)}) and (n, 4, 4)"
        )
    if not (
        np.isfinite(postures).all() and np.isfinite(base_poses).all() and 0 < frame_time < np.inf
    ):
        raise InputError(
            "postures, base_poses and frame_time: got a value that is not finite or a period that"
            " is not positive, allowed finite values and a period above 0"
        )
    kinematics = Kinematics(body)
    turned = {"pelvis": np.broadcast_to(np.eye(3), (frames, 3, 3))}
    for name in _PARENT:
        _, rotation, _ = kinematics.function(name)(ca.DM(postures.T))
        turned[name] = rotation.full().reshape(3, frames, 3).transpose(1, 0, 2)
    root = base_poses[:, :3, 3] @ _TO_FILE.T * _UNITS_PER_METRE
    columns = [root, _angles(base_poses[:, :3, :3])]
    lines = ["HIERARCHY"]
    for name in _write_joint("pelvis", lines, 0, _offsets(kinematics)):
        parent = turned[_PARENT[name]]
        columns.append(_angles(parent.transpose(0, 2, 1) @ turned[name]))
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {frame_time:.9g}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in np.hstack(columns)]
    path = Path(path)
    write_text_atomic(path, "\n".join(lines) + "\n")
    return path


def _offsets(kinematics: Kinematics) -> dict[str, np.ndarray]:
    """Return each joint's position in its parent at the zero posture, shape (3,) [m].

    The trunk rotates about the pelvis.
    """
    at = {
        name: np.array(kinematics.at(name, ca.DM.zeros(len(JOINTS)))[0]).ravel()
        for name in ("pelvis", *_PARENT)
    }
    at["trunk"] = at["pelvis"]
    return {"pelvis": np.zeros(3)} | {
        name: at[name] - at[parent] for name, parent in _PARENT.items()
    }


def _write_joint(
    name: str, lines: list[str], depth: int, offsets: dict[str, np.ndarray]
) -> Iterator[str]:
    """Append a joint and its descendants; yield the names of the descendants in channel order."""
    tab = "  " * depth
    offset = _TO_FILE @ offsets[name] * _UNITS_PER_METRE
    channels = [*([] if depth else CHANNELS[:3]), *_ROTATIONS]
    lines += [
        f"{tab}{'JOINT' if depth else 'ROOT'} {name}",
        f"{tab}{{",
        f"{tab}  OFFSET {offset[0]:.6f} {offset[1]:.6f} {offset[2]:.6f}",
        f"{tab}  CHANNELS {len(channels)} {' '.join(channels)}",
    ]
    children = [child for child, parent in _PARENT.items() if parent == name]
    for child in children:
        yield child
        yield from _write_joint(child, lines, depth + 1, offsets)
    if not children:
        end = ("End Site", "{", "  OFFSET 0.000000 0.000000 0.000000", "}")
        lines += [f"{tab}  {line}" for line in end]
    lines.append(f"{tab}}}")


def _angles(rotations: np.ndarray) -> np.ndarray:
    """Return the angles of rotations (n, 3, 3) about the file's z, x, y in turn.

    The rotations are given in our axes; the angles have shape (n, 3) [deg].
    """
    r = _TO_FILE @ rotations @ _TO_FILE.T
    x = np.arcsin(np.clip(r[:, 2, 1], -1.0, 1.0))
    # With x at a quarter turn, z and y rotate about the same line, and z gets the whole angle.
    upright = np.hypot(r[:, 0, 1], r[:, 1, 1]) > 1e-9
    z = np.where(upright, np.arctan2(-r[:, 0, 1], r[:, 1, 1]), np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    y = np.where(upright, np.arctan2(-r[:, 2, 0], r[:, 2, 2]), 0.0)
    return np.degrees(np.stack([z, x, y], axis=1))
