"""Words in columns that stand for numbers: clock times, and a tracker's words for being seen."""

from __future__ import annotations

import datetime
import re
from typing import Final

from ergoqp.recordings.formats.opening import short
from ergoqp.recordings.formats.rows import is_number
from ergoqp.recordings.names import squashed

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


class Clock:
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

        >>> clock = Clock()
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


def surety(word: str) -> str:
    """Return the confidence that a tracker's word for a joint stands for, as a number in words.

    >>> surety("NOT_TRACKED"), surety("Inferred"), surety("0.7")
    ('0', '1', '0.7')
    """
    if is_number(word):
        return word
    return "0" if squashed(word).endswith(tuple(_LOST)) else "1"
