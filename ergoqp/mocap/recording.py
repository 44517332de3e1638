"""The motion that every reader returns, and the result of reading a recording.

The result of every reader: a recording's own joints, markers, segments and objects over time. All
are in the recording's own unit and axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.human import Body
from ergoqp.human.body import Marker
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap.fitting.unknown import Spans, spans_within, with_spans
from ergoqp.mocap.fitting.validity import scored_frames
from ergoqp.mocap.formats.text import count_of, short, some
from ergoqp.mocap.formats.times import count_repeated_frames, to_seconds


@dataclass(frozen=True)
class JointMotion:
    """Content of a file, before any naming, unit or axis is chosen.

    Attributes:
        names: names of the file's joints or markers, unique, shape (m,).
        positions: their positions in the file's unit and axes, shape (n, m, 3); NaN where not seen.
        time: time stamps from the file, increasing from zero, shape (n,) [s].
        rest: joint centres of the skeleton's rest pose, in the same unit and axes, shape (m, 3);
            None if the format has none.
        notes: sentences for the user about how the file was read.
        turns: name of a joint or segment -> its orientation in the file's axes, unit quaternions
            (x, y, z, w), shape (n, 4); NaN where not seen.
        objects: name of an object -> its pose in the file's unit and axes, shape (n, 4, 4).
        angles: name of a joint angle that the file itself holds -> its values (n,) [rad].
        markers: whether the positions are those of markers on the skin and not of joint centres.
        unit: the file's unit of length [m]; None if the file does not state it.
        measures: the file's name of a body measure, in small letters -> its value [m].
        up: the file's vertical axis, one of `ergoqp.mocap.fitting.axes.UPS`; None if the file
            does not state it.
        twice: joint angles that the file has more than once with different numbers; the first is
            kept.
        in_file: name -> its name in the file, where that is another.
        columns: column of the file that is no point -> what it is used as; empty if not used.
        subject: the person whose motion it is, if the reader has chosen; else empty.
        beside: whether the poses of objects are in the axes of the person's pelvis.
        blind: joint -> the frames in which a file of our joint angles does not have its angle (n,)
            bool.

    Example:
        >>> import numpy as np
        >>> from ergoqp.mocap.recording import JointMotion
        >>> motion = JointMotion(("hip", "knee"), np.zeros((10, 2, 3)), np.arange(10) / 100)
        >>> motion.of("knee").shape, motion.unit
        ((10, 3), None)
    """

    names: tuple[str, ...]
    positions: np.ndarray
    time: np.ndarray
    rest: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    turns: Mapping[str, np.ndarray] = field(default_factory=dict)
    objects: Mapping[str, np.ndarray] = field(default_factory=dict)
    angles: Mapping[str, np.ndarray] = field(default_factory=dict)
    markers: bool = False
    unit: float | None = None
    up: str | None = None
    measures: Mapping[str, float] = field(default_factory=dict)
    twice: tuple[str, ...] = ()
    in_file: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    subject: str = ""
    beside: bool = False
    blind: Mapping[str, np.ndarray] = field(default_factory=dict)

    def of(self, name: str) -> np.ndarray:
        """Return the path of one joint centre, shape (n, 3) [file unit].

        Args:
            name: one of ``names``.

        Raises:
            ValueError: if there is no joint of that name.
        """
        return self.positions[:, self.names.index(name)]

    def at(self, frames: np.ndarray) -> JointMotion:
        """Return the motion in some of the frames, given as (n,) bool."""
        return replace(self.mapped(lambda values: values[frames]), time=self.time[frames])

    def mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> JointMotion:
        """Return the motion with its arrays over the frames, of any shape, changed; not times."""
        return replace(
            self,
            positions=change(self.positions),
            turns={name: change(each) for name, each in self.turns.items()},
            objects={name: change(each) for name, each in self.objects.items()},
            angles={name: change(each) for name, each in self.angles.items()},
            blind={name: change(each) for name, each in self.blind.items()},
        )

    def joints(self, keep: Mapping[str, str]) -> JointMotion:
        """Return the motion of some of the joints, given as name -> new name."""
        places = [i for i, name in enumerate(self.names) if name in keep]
        return replace(
            self,
            names=tuple(keep[self.names[i]] for i in places),
            positions=self.positions[:, places],
            rest=None if self.rest is None else self.rest[places],
            turns={keep[name]: each for name, each in self.turns.items() if name in keep},
            in_file={new: self.in_file.get(name, name) for name, new in keep.items()},
        )

    def once(self) -> JointMotion:
        """Return the motion with unique names: of points with the same name the first is kept.

        If they nowhere differ, it is completed by the others where it is not seen. Sentences name
        them, and tell how far those that differ are apart.
        """
        first: dict[str, int] = {}
        again = [(i, name) for i, name in enumerate(self.names) if first.setdefault(name, i) != i]
        if not again:
            return self
        paths = self.positions[:, list(first.values())]
        place = {name: i for i, name in enumerate(first)}
        apart: dict[str, float] = {}
        for i, name in again:
            kept, other = paths[:, place[name]], self.positions[:, i]
            away = np.linalg.norm(other.astype(float) - kept, axis=1)
            far = float(np.fmax.reduce(away, initial=0.0))
            apart[name] = max(far, apart.get(name, 0.0))
            if not far:
                kept[:] = np.where(np.isnan(kept), other, kept)
        return replace(
            self,
            names=tuple(first),
            positions=paths,
            rest=None if self.rest is None else self.rest[list(first.values())],
            notes=(*self.notes, *_said_apart(apart, self.unit)),
        )

    def check_once(self, used: Iterable[str], where: str) -> None:
        """Raise if the file has a joint angle that is used more than once, with different numbers.

        Args:
            used: names of the angles.
            where: the file's name, for messages.

        Raises:
            RecordingError: if so, with the name.
        """
        for name in used:
            if name in self.twice:
                raise RecordingError(
                    f"{where}: got {short(name)} more than once with different numbers, allowed"
                    " once; rename or remove one in the file"
                )


def all_seen(observed: np.ndarray) -> np.ndarray:
    """Return the frames in which every joint is seen that is ever seen (n,) bool.

    The rotation of an upper arm does not count: a straight arm does not show it, and hardly moves
    with it.

    Args:
        observed: which joint angles are determined (n, 32) bool.
    """
    ever = np.any(observed, axis=0)
    ever[[INDEX[f"{side}_shoulder_rotation"] for side in SIDES]] = False
    return np.all(observed[:, ever], axis=1)


def with_times(
    where: str,
    motion: JointMotion,
    unit: float | None = 1.0,
    shown: Sequence[np.ndarray] = (),
    remedy: str = "",
) -> JointMotion:
    """Return a motion with times from zero [s] in place of the file's, and sentences about frames.

    Frames with the time of the frame before are left out.

    Args:
        where: the file's name, for messages.
        motion: the motion, with the time column of the file.
        unit: unit of that column [s]; None finds it.
        shown: content of the frames, arrays (n, ...), if it is more than the positions.
        remedy: what the user can do if frames of equal time differ, for the message.

    Raises:
        RecordingError: if the times are not those of frames.
    """
    content = shown or [motion.positions]
    time, kept, notes = to_seconds(where, motion.time, unit, content, remedy)
    motion = replace(motion if kept.all() else motion.at(kept), time=time)
    repeated = count_repeated_frames(motion.positions)
    return replace(motion, notes=(*notes, *motion.notes, *repeated))


def said_twice(names: Sequence[str]) -> str:
    """Return a sentence about names that a file has more than once."""
    return f"In the file more than once, of which the first is used: {some(list(names))}."


def _said_apart(apart: Mapping[str, float], unit: float | None) -> list[str]:
    """Return sentences about points that a file has more than once.

    Args:
        apart: name -> largest distance between points of that name [file unit].
        unit: the file's unit of length [m]; None if it is unknown.
    """
    alike = [name for name, far in apart.items() if not far]
    said = [said_twice(alike)] if alike else []
    far = [
        f"{name} (up to {f'{each:.3g}' if unit is None else f'{1000 * unit * each:.0f} mm'} apart)"
        for name, each in apart.items()
        if each
    ]
    if far:
        said.append(
            "In the file more than once with different numbers, of which the first is used and the"
            f" others are left out: {some(far, longest=80)}."
        )
    return said


def count_note(stated: str, found: int, what: str) -> list[str]:
    """Return a sentence if a file states another count of something than it has."""
    if (count := count_of(stated)) in {None, found}:
        return []
    return [f"The file states {count} {what} and has {found}: all are read."]


@dataclass(frozen=True)
class Recording:
    """A person's movement in the 32 joints.

    Attributes:
        time: time stamps, shape (n,) [s].
        postures: joint angles in the order of `ergoqp.JOINTS`, within their ranges, read-only,
            shape (n, 32) [rad].
        base_poses: pose of the pelvis in the world, upright (position and heading only), x forward,
            y left, z up, shape (n, 4, 4) [m].
        observed: whether the recording determines this joint angle, shape (n, 32) bool; an angle
            that it never determines is zero, and one that it does not determine for a while, or
            of which it cannot be right (`doubts`), is interpolated.
        fit_error: root of the mean squared distance between the recording's joint centres and the
            fitted body's, over the centres that were mapped, shape (n,) [m]; NaN where nothing is
            seen.
        object_poses: pose of the held object, shape (n, 4, 4) [m]; None if the recording has none.
        assumptions: what was assumed because the file does not state it, one sentence each.
        person: the body that was fitted.
        errors: joint centre -> distance between the fitted body's and the recording's, shape (n,)
            [m].
        not_scored: cause -> the frames that are not scored because of it, shape (n,) bool.
        doubts: cause (see `ergoqp.mocap.fitting.validity`) -> the frames in which some of the
            angles are not used because of it, shape (n,) bool.
        spans: number of a joint -> the frames in which its angle is not known (k,), and its lower
            and upper ends there (k,) [rad].
        markers: marker on the skin -> its place on the fitted body and its residual.
        measured: segments of the person whose lengths are measured in the recording; the others
            follow from the stature. Empty if the person was stated, or if the recording consists of
            joint angles.
        read: name of a joint, marker, object or column in the file -> what it was used as
            (``"right_wrist"``, ``"right_asis"``, ``"object"``), with words that say so if that is
            guessed; empty if it was not used.

    Example:
        >>> import numpy as np
        >>> from ergoqp import fit_postures, reba
        >>> from ergoqp.human import Body
        >>> from ergoqp.mocap.naming import centres_of
        >>> pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (50, 1))
        >>> centres = centres_of(Body(), pelvis, np.zeros((50, 32)))
        >>> recording = fit_postures(list(centres), np.stack(list(centres.values()), axis=1), 50.0)
        >>> int(reba.assess(recording.scored_postures).final.max())
        1
    """

    time: np.ndarray
    postures: np.ndarray
    base_poses: np.ndarray
    observed: np.ndarray
    fit_error: np.ndarray
    object_poses: np.ndarray | None
    assumptions: tuple[str, ...]
    person: Body
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    not_scored: Mapping[str, np.ndarray] = field(default_factory=dict)
    doubts: Mapping[str, np.ndarray] = field(default_factory=dict)
    spans: Spans = field(default_factory=dict)
    markers: Mapping[str, Marker] = field(default_factory=dict)
    measured: tuple[str, ...] = ()
    read: Mapping[str, str] = field(default_factory=dict)

    @property
    def seen(self) -> np.ndarray:
        """Frames in which every joint is seen that is ever seen, shape (n,) bool.

        The rotation of an upper arm does not count, because a straight arm does not show it.
        """
        return all_seen(self.observed)

    @property
    def whole(self) -> np.ndarray:
        """Frames that show a whole posture, shape (n,) bool: scored ones in which all is `seen`.

        If there is none, they are all scored ones.
        """
        whole = self.scored & self.seen
        return whole if whole.any() else self.scored

    @property
    def scored(self) -> np.ndarray:
        """Frames that show a posture, shape (n,) bool."""
        return scored_frames(len(self.time), self.not_scored)

    @property
    def scored_postures(self) -> np.ndarray:
        """Postures for `ergoqp.reba.assess`, NaN in frames that are not scored (n, 32) [rad]."""
        scored = self.scored
        if scored.all():
            return self.postures
        postures = np.where(scored[:, None], self.postures, np.nan)
        postures.setflags(write=False)
        return postures

    @property
    def low(self) -> np.ndarray:
        """Lower ends of the joint angles, for `ergoqp.reba.assess` (n, 32) [rad].

        They are the postures where these are known.
        """
        return with_spans(self.postures, self.spans, upper=False)

    @property
    def high(self) -> np.ndarray:
        """Upper ends of the joint angles, the same (n, 32) [rad]."""
        return with_spans(self.postures, self.spans, upper=True)

    def ends(self, frames: slice) -> np.ndarray:
        """Return `low` and `high` of some frames (2, frames, 32) [rad].

        Args:
            frames: their numbers, without gaps; for example blocks of a long recording.
        """
        start, stop, _ = frames.indices(len(self.time))
        spans = spans_within(self.spans, start, stop)
        return np.stack(
            [with_spans(self.postures[start:stop], spans, end) for end in (False, True)]
        )

    def causes(self, frame: int) -> list[str]:
        """Return why a frame is not scored; an empty list if it is scored."""
        return [cause for cause, frames in self.not_scored.items() if frames[frame]]
