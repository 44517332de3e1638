"""Meaning of the columns in a table of positions: coordinates, times, people and confidence."""

from __future__ import annotations

import datetime
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import GrowableArray, TableOptions, TextLines, is_number, short, some
from ergoqp.mocap.formats.times import drop_duplicate_times, tick_of, time_head
from ergoqp.mocap.naming import squashed

_DAY: Final = 86_400.0
_STAMP: Final = re.compile(
    r"(?:(?P<date>\d{4}-\d\d-\d\d)[T ])?(?P<h>\d\d?):(?P<m>\d\d):(?P<s>\d\d(?:[.,]\d{1,12})?)"
    r"\s*(?:Z|UTC|(?P<zone>[+-]\d\d):?(?P<minutes>\d\d)?)?",
    re.ASCII,
)
_LOST: Final = frozenset(
    {"nottracked", "untracked", "lost", "off", "no", "false", "invalid", "notseen", "notvisible"}
    | {"invisible", "hidden", "occluded", "searching", "terminate", "none"}
)
"""Words of trackers for a joint that they do not see, without separators of words."""


class ClockTimeParser:
    """Conversion of a column of clock times, with or without dates, to seconds."""

    def __init__(self, where: str = "") -> None:
        """Begin before the first time; `where` is the column's name."""
        self._where = where
        self._first: int | None = None
        self._days = 0
        self._last = 0.0

    def __call__(self, word: str) -> str:
        """Return the seconds since the midnight before the first time.

        Without dates, a clock that goes back by more than half a day has passed midnight.

        >>> clock = ClockTimeParser()
        >>> clock("23:59:59.5"), clock("00:00:01")
        ('86399.5', '86401.0')

        Raises:
            ValueError: if it is not a time; the text says what is allowed.
        """
        match = _STAMP.fullmatch(word)
        try:
            if match is None:
                raise ValueError
            date = match["date"]
            day = 0 if date is None else datetime.date.fromisoformat(date).toordinal()
        except ValueError:
            raise ValueError(
                f"in the column {short(self._where)}, allowed a number or a time such as"
                " 12:00:00.5 or 2026-01-31T12:00:00.5"
            ) from None
        self._first = day if self._first is None else self._first
        seconds = 3600.0 * int(match["h"]) + 60.0 * int(match["m"])
        seconds += float(match["s"].replace(",", "."))
        if zone := match["zone"]:
            minutes = 60 * int(zone) + int(zone[0] + (match["minutes"] or "0"))
            seconds -= 60.0 * minutes
        if date is None and seconds < self._last - _DAY / 2:
            self._days += 1
        self._last = seconds
        return repr(_DAY * (day - self._first + self._days) + seconds)


def parse_tracking_state(word: str) -> str:
    """Return the confidence that a tracker's word for a joint stands for, as a number in words.

    >>> [parse_tracking_state(word) for word in ("NOT_TRACKED", "Inferred", "0.7")]
    ['0', '1', '0.7']
    """
    if is_number(word):
        return word
    return "0" if squashed(word).endswith(tuple(_LOST)) else "1"


_LEVELS: Final = 3.0
"""Highest value of a scale of few levels (Kinect has 0 to 3), on which only zero means not seen."""
_STEP: Final = 0.25
"""Levels are multiples of this: the Azure Kinect's ROS driver writes 0.25 for a low confidence,
which is that of a joint in view."""
_HUNDRED: Final = 100.0
_LEAST: Final = 0.3
"""Share of the whole scale below which a place is taken as not seen."""


@dataclass(frozen=True)
class ConfidenceColumn:
    """A confidence column of a point.

    Attributes:
        column: index of the column.
        point: index of the point.
        head: name of such columns; columns with the same name have the same scale.
    """

    column: int
    point: int
    head: str


class ConfidenceFilter:
    """Values of the confidence columns, gathered block by block."""

    def __init__(self, columns: Sequence[ConfidenceColumn]) -> None:
        """Begin without rows of these columns."""
        self._columns = columns
        self._values = GrowableArray()
        self._most = dict.fromkeys([each.head for each in columns], 0.0)
        self._levels = dict.fromkeys(self._most, True)

    def add(self, values: np.ndarray, share: float) -> None:
        """Add rows (n, columns); `share` is the share of the file that is read up to them."""
        for i, each in enumerate(self._columns):
            known = values[:, i][np.isfinite(values[:, i])]
            self._most[each.head] = max(self._most[each.head], float(known.max(initial=0.0)))
            steps = known / _STEP
            self._levels[each.head] &= bool((steps == np.rint(steps)).all())
        # Half precision is enough for a scale, and a scale beyond a hundred has no threshold.
        self._values.add(np.clip(values, -1, 2 * _HUNDRED).astype(np.float16), share)

    def mask_low_confidence(self, positions: np.ndarray) -> list[str]:
        """Set positions (n, m, 3) of a low confidence to NaN, in place; return their counts."""
        if not self._values:
            return []
        values = self._values.view[: len(positions)]
        lost = dict.fromkeys(self._most, 0)
        for i, each in enumerate(self._columns):
            least = self._threshold(each.head)
            seen = values[:, i] >= least if least else values[:, i] > 0
            places = positions[:, each.point]
            lost[each.head] += int((~seen & np.isfinite(places).any(axis=1)).sum())
            places[~seen] = np.nan
        total = positions.shape[0] * positions.shape[1]
        return [
            f"{count} of {total} places are taken as not seen: their {head} is"
            f" {f'below {least:g}' if (least := self._threshold(head)) else '0'} or missing."
            for head, count in lost.items()
            if count
        ]

    def _threshold(self, head: str) -> float:
        """Return the least value of a place that is seen; 0: every value above zero."""
        if self._most[head] <= _LEVELS:
            return 0.0 if self._levels[head] else _LEAST
        return _LEAST * _HUNDRED if self._most[head] <= _HUNDRED else 0.0


_PEOPLE: Final = frozenset(
    {"body", "bodyid", "id", "person", "personid", "user", "userid", "track", "trackid", "skeleton"}
    | {"skeletonid", "trackingid", "subject", "subjectid", "bodyindex"}
)
"""Heads of columns that state the person of a row, without separators of words."""
_CROWD: Final = 20
"""Largest number of people that are read; more are tracking errors."""
_COUNTED: Final = 1000
"""Number of different values, one per row, from which a column is taken as a count of the rows."""


class People:
    """The people that a column names, numbered in the order in which they appear."""

    def __init__(self) -> None:
        """Begin without people."""
        self.labels: dict[str, int] = {}
        self.counts = False
        self._rows = 0

    def __call__(self, word: str) -> str:
        """Return the number of a row's person.

        Raises:
            ValueError: if there are too many people; the text says what is allowed.
        """
        self._rows += 1
        if self.counts:
            return "0"
        if len(self.labels) == _COUNTED and word not in self.labels:
            if self._rows <= _COUNTED + 1:
                self.counts = True
                return "0"
            raise ValueError(f"as a further person, allowed at most {_COUNTED} people")
        return str(self.labels.setdefault(word, len(self.labels)))

    def are_several(self, keys: np.ndarray | None) -> bool:
        """Return whether the column names several people and is not a count of the rows.

        Args:
            keys: times or numbers of the rows' frames (n,), if there are any.
        """
        if self.counts or len(self.labels) < 2:
            return False
        if len(self.labels) < self._rows:
            return True
        return keys is not None and len(np.unique(keys)) < len(keys)


def side_by_side(
    where: str,
    names: tuple[str, ...],
    positions: np.ndarray,
    whose: np.ndarray,
    people: People,
    keys: np.ndarray,
    remedy: str,
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, list[str]]:
    """Return everybody's points "person:point" (p m,), (n, p m, 3), frames (n,) and sentences.

    Args:
        where: the file's name, for messages.
        names: names of the points (m,).
        positions: positions of the points (rows, m, 3).
        whose: number of each row's person (rows,); NaN for nobody.
        people: the people.
        keys: times or numbers of the rows' frames (rows,).
        remedy: what the user can do if a person has several rows of a time, for the message.

    Raises:
        RecordingError: if a row has no time, or time runs backwards for a person.
    """
    if len(lost := np.flatnonzero(~np.isfinite(keys) & np.isfinite(whose))):
        raise RecordingError(f"{where}: row {lost[0] + 1} of the numbers has no time")
    stamps = np.unique(keys[np.isfinite(keys)])
    often = np.bincount(whose[np.isfinite(whose)].astype(int), minlength=len(people.labels))
    kept = np.sort(np.argsort(-often, kind="stable")[:_CROWD])
    labels = list(people.labels)
    notes = [f"The rows are those of {len(labels)} people, whose names are the points' prefixes."]
    if len(kept) < len(labels):
        notes.append(f"Of {len(labels)} people the {_CROWD} that are seen most often are read.")
    count = len(names)
    out = np.full((len(stamps), len(kept) * count, 3), np.nan, dtype=positions.dtype)
    for at, person in enumerate(kept):
        own, name = np.flatnonzero(whose == person), f"{where}: {short(labels[person])}"
        if len(back := np.flatnonzero(np.diff(keys[own]) < 0)):
            before, after = keys[own[back[0]]], keys[own[back[0] + 1]]
            raise RecordingError(f"{name}: time runs backwards from {before:.10g} to {after:.10g}")
        taken, said = drop_duplicate_times(name, keys[own], [positions[own]], remedy)
        own = own[taken]
        out[np.searchsorted(stamps, keys[own]), at * count : (at + 1) * count] = positions[own]
        notes += [f"Of {short(labels[person])}: {each}" for each in said]
    return tuple(f"{labels[k]}:{name}" for k in kept for name in names), out, stamps, notes


_LONGEST: Final = 100
"""Largest number of letters in a name; longer words are ignored, because parsing them is slow."""
_AXIS: Final = re.compile(r"t?(?P<axis>[xyz])\d*", re.IGNORECASE)
_COLUMN: Final = re.compile(
    r"(?P<name>.*?)[\s._:/-]*(?:pos(?:ition)?[\s._:/-]*|(?<=[\s._:/-])t)?(?P<axis>[xyz])\d*"
    r"\s*(?:[\[(](?P<unit>[a-zµ]*)[\])])?",
    re.IGNORECASE,
)
_NO_PLACE: Final = re.compile(
    r"(?:(?:.*[\s._:/-])?(?i:q|quat|quaternion|rot|rotation|ori|orient|orientation|euler|angles?|"
    r"vel|velocity|acc|accel|acceleration|gyro|mag)|.*(?:Quat|Quaternion|Rot|Rotation|Orientation|"
    r"Vel|Velocity|Acc|Acceleration))"
)
"""Names of columns with x, y and z that are not positions."""
_OTHER: Final = re.compile(
    r"(?:q|quat|quaternion|rot|rotation|ori|orient|orientation|euler|angles?|v|vel|velocity|a|acc|"
    r"accel|acceleration|w|gyro|mag|roll|pitch|yaw|(?:joint[\s_]?)?id)[\s._:/-]*[wxyz0-3]?",
    re.IGNORECASE,
)
"""Known heads of a joint's columns that are neither positions nor confidences."""
_CONFIDENCE: Final = re.compile(
    r"(?P<name>.*?)[\s._:/-]*(?P<head>confidence(?:[\s_]?level)?|visibility|likelihood|score|"
    r"quality|(?:joint)?tracking[\s_]?state|(?:(?<=[\s._:/-])|\A)(?:conf|state|tracked|valid|"
    r"visible|probability|prob|p|c))\s*(?:[\[(].*[\])])?"
)
_FRAMES: Final = frozenset({"frame", "frameid", "frameno", "framenumber", "frame#", "frameindex"})
_NANO: Final = re.compile(r"(?P<stem>(?:.*[\s._:/-])?)(?:nano_?sec(?:ond)?s?|nsecs?)", re.I)
_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


@dataclass
class ColumnLayout:
    """Meaning of the columns of a table.

    Attributes:
        points: name -> the columns of x, y and z.
        again: the columns of further points with the name of one of them.
        width: number of columns.
        names: names of the columns in messages.
        confidence: the confidence columns.
        time: the column of the times, or None.
        fine: the column of nanoseconds that are added to the times, or None.
        tick: unit of the times [s], or None.
        frame: the column of the frame numbers, or None.
        whose: the column that states the person of a row, or None.
        unit: unit of length [m], or None.
        unread: columns of points whose meaning is unknown.
    """

    points: dict[str, tuple[int, int, int]]
    width: int
    names: Sequence[str] = ()
    confidence: Sequence[ConfidenceColumn] = ()
    time: int | None = None
    fine: int | None = None
    tick: float | None = None
    frame: int | None = None
    whose: int | None = None
    unit: float | None = None
    unread: Sequence[int] = ()
    again: Sequence[tuple[str, tuple[int, int, int]]] = ()

    def name_of(self, column: int) -> str:
        """Return the name of a column for messages."""
        named = self.names[column] if column < len(self.names) else ""
        return named or f"number {column + 1}"


def layout_from_header(lines: TextLines, header: list[list[str]], width: int) -> ColumnLayout:
    """Return the layout that the rows above the numbers state.

    Args:
        lines: the file, for messages.
        header: the rows, in words.
        width: number of words in the first row of numbers.

    Raises:
        RecordingError: if they name no points.
    """
    header, unit, tick = _without_units(header)
    row = _named(header)
    layout = ColumnLayout({}, max(width, len(row)), row, unit=unit, tick=tick)
    axes: dict[str, list[dict[str, int]]] = {}
    confidences: list[tuple[str, str, int]] = []
    others: list[int] = []
    for column, word in enumerate(row):
        if len(word) > _LONGEST:
            continue
        is_time, tick = time_head(word)
        bare = squashed(word)
        if is_time:
            if layout.time is None:
                layout.time, layout.tick = column, tick or layout.tick
        elif bare in _PEOPLE:
            layout.whose = column if layout.whose is None else layout.whose
        elif bare in _FRAMES:
            layout.frame = column if layout.frame is None else layout.frame
        elif match := _CONFIDENCE.fullmatch(word.lower()):
            confidences.append((match["name"], match["head"], column))
        elif (
            (match := _COLUMN.fullmatch(word))
            and (name := match["name"])
            and not _NO_PLACE.fullmatch(name)
        ):
            copies = axes.setdefault(name, [{}])
            if (axis := match["axis"].lower()) in copies[-1]:
                copies.append({})
            copies[-1][axis] = column
            layout.unit = _METRES.get((match["unit"] or "").lower(), layout.unit)
        else:
            others.append(column)
    whole = [
        (name, (found["x"], found["y"], found["z"]))
        for name, copies in axes.items()
        for found in copies
        if len(found) == 3
    ]
    for name, columns in whole:
        layout.points.setdefault(name, columns)
    layout.again = [each for each in whole if each not in layout.points.items()]
    if not layout.points:
        lines.fail(
            f"got the columns {some([short(word) for word in row if word], 6)}, allowed three"
            " columns for each joint, such as neck.x, neck.y, neck.z"
        )
    alike: dict[str, list[int]] = {}
    for i, name in enumerate(layout.points):
        alike.setdefault(name.lower(), []).append(i)
    layout.confidence = [
        ConfidenceColumn(column, i, head)
        for name, head, column in confidences
        for i in alike.get(name, ())
    ]
    layout.time, layout.fine = _with_nanoseconds(row, layout.time)
    if layout.fine is not None:
        layout.tick = 1.0
    layout.unread = _unread(row, alike, others)
    return layout


def layout_without_header(lines: TextLines, first: list[str], asked: TableOptions) -> ColumnLayout:
    """Return the layout of a table without names.

    Args:
        lines: the file, for messages.
        first: its first row of numbers.
        asked: the names.

    Raises:
        RecordingError: if there are no names, or their number is not a third of the numbers.
    """
    line, width = lines.line + 1, 3 * len(asked.columns)
    while len(first) > width and not first[-1]:
        first.pop()
    if not asked.columns:
        lines.fail(
            f"got {len(first)} numbers and no names above them, allowed a row of names; or state"
            " the names of the points in their order (columns)",
            line,
        )
    if len(set(asked.columns)) < len(asked.columns):
        lines.fail("columns: got a name twice, allowed different names", line)
    if width != len(first):
        lines.fail(
            f"got {len(first)} numbers and {len(asked.columns)} names (columns), allowed three"
            " numbers for each name",
            line,
        )
    points = {name: (3 * i, 3 * i + 1, 3 * i + 2) for i, name in enumerate(asked.columns)}
    return ColumnLayout(points, width)


def _without_units(header: list[list[str]]) -> tuple[list[list[str]], float | None, float | None]:
    """Return the rows without a last row of units, and its units of length [m] and time [s]."""
    units = [word.strip("[]()").lower() for word in header[-1] if word]
    lengths = [_METRES[word] for word in units if word in _METRES]
    ticks = [tick_of(word) for word in units if word not in _METRES]
    if len(header) > 1 and lengths and None not in ticks:
        return header[:-1], lengths[-1], ticks[0] if ticks else None
    return header, None, None


def _named(header: list[list[str]]) -> list[str]:
    """Return the names of the columns; the joints' names may be in a row above the axes."""
    row = header[-1]
    axes = [_AXIS.fullmatch(word) for word in row]
    if len(header) < 2 or sum(map(bool, axes)) < 3:
        return row
    above = [*header[-2], *[""] * len(row)][: len(row)]
    names, name = [], ""
    for over, word, axis in zip(above, row, axes, strict=True):
        # A blank above the coordinates repeats the last name.
        name = over.removeprefix("Name:") if over else name
        if axis or _CONFIDENCE.fullmatch(word.lower()):
            names.append(f"{name}.{axis['axis'] if axis else word}")
        elif tick_of(word) and time_head(over)[0]:
            names.append(f"{over} ({word})")
        else:
            names.append(word or over)
    return names


def _with_nanoseconds(row: list[str], time: int | None) -> tuple[int | None, int | None]:
    """Return the columns of the times and of nanoseconds that belong to a column of seconds."""
    places = {word.lower(): column for column, word in reversed(list(enumerate(row)))}
    for word, column in reversed(places.items()):
        if len(word) <= _LONGEST and (match := _NANO.fullmatch(word)):
            for seconds in ("sec", "secs", "second", "seconds"):
                whole = places.get(match["stem"] + seconds)
                if whole is not None and time in {None, whole}:
                    return whole, column
    return time, None


def _unread(row: list[str], known: Collection[str], others: list[int]) -> list[int]:
    """Return the columns that belong to a known point by their heads, but have no known meaning."""
    found = []
    for column in others:
        word = row[column].lower()
        ends = [mark.start() for mark in re.finditer(r"[\s._:/-]", word)]
        if any(
            word[:end].rstrip(" ._:/-") in known and not _OTHER.fullmatch(word[end + 1 :])
            for end in ends
        ):
            found.append(column)
    return found
