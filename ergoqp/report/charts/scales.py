"""Scales from data to pixels, their ticks, and thinning of long series that keeps all extremes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Scale:
    """A mapping of an interval of data onto pixels.

    Attributes:
        low: data at `start`.
        high: data at `end`.
        start: pixel.
        end: pixel; less than `start` for an axis that points up.
        logarithmic: whether the scale is logarithmic; both ends are then positive.
    """

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool = False

    def __call__(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the pixels of values; same shape."""
        data, low, high = np.asarray(values, dtype=float), self.low, self.high
        if self.logarithmic:
            data, low, high = np.log(data), np.log(low), np.log(high)
        return self.start + (data - low) / (high - low) * (self.end - self.start)

    def at(self, value: float) -> float:
        """Return the pixel of one value."""
        return float(self(value))

    def ticks(self, count: int = 6) -> list[float]:
        """Return about `count` round numbers within the interval."""
        if self.logarithmic:
            decades = np.arange(np.floor(np.log10(self.low)), np.ceil(np.log10(self.high)) + 1)
            steps = (1.0, 2.0, 5.0) if len(decades) <= 4 else (1.0,)
            candidates = [step * 10.0**decade for decade in decades for step in steps]
            return [
                value
                for value in candidates
                if self.low * (1 - 1e-9) <= value <= self.high * (1 + 1e-9)
            ]
        return round_ticks(self.low, self.high, count)


def round_ticks(low: float, high: float, count: int = 6) -> list[float]:
    """Return about `count` multiples of 1, 2 or 5 times a power of ten within an interval."""
    raw = (high - low) / max(count, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(
        multiple * power
        for multiple in (1.0, 2.0, 5.0, 10.0)
        if multiple * power >= raw * (1 - 1e-9)
    )
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return [float(k * step) for k in np.arange(first, last + 1)]


def padded(
    values: NDArray[np.float64], *, share: float = 0.08, least: float = 1e-6
) -> tuple[float, float]:
    """Return an interval around finite values, with room at both ends.

    Args:
        values: any shape; values that are not finite are ignored.
        share: room at each end, relative to the width.
        least: smallest width, for values that are all equal.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    room = max(share * (high - low), (least - (high - low)) / 2)
    return low - room, high + room


def words_of(value: float) -> str:
    """Return the number of a tick as text without trailing zeros or rounding errors."""
    text = np.format_float_positional(value + 0.0, 6, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def columns_of(x: NDArray[np.float64], columns: int) -> NDArray[np.int64]:
    """Return the column, 0 to `columns` - 1, of each ascending position x (n,)."""
    width = float(x[-1] - x[0]) if len(x) else 0.0
    if width <= 0:
        return np.zeros(len(x), dtype=np.int64)
    return np.minimum(((x - x[0]) / width * columns).astype(np.int64), columns - 1)


Line = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Positions (n,) and values (n,)."""


def thinned(x: NDArray[np.float64], y: NDArray[np.float64], columns: int = 700) -> Line:
    """Return at most four points per column: first, lowest, highest and last, so no peak is lost.

    Args:
        x: ascending, shape (n,).
        y: shape (n,); NaN for no value. A column without any number becomes one NaN, which
            interrupts a line.
        columns: number of columns, about one per pixel.
    """
    if len(x) <= 4 * columns:
        return x, y
    column = columns_of(x, columns)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    ends = np.append(starts[1:], len(x))
    kept: list[int] = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        piece = y[start:end]
        finite = np.flatnonzero(np.isfinite(piece))
        if finite.size:
            values = piece[finite]
            kept += (start + np.unique(finite[[0, values.argmin(), values.argmax(), -1]])).tolist()
        else:
            kept.append(start)
    return x[kept], y[kept]


def changes(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the positions at which a piecewise constant series changes its value.

    The first sample is one of them.
    """
    return (
        np.flatnonzero(np.diff(values, prepend=values[0] - 1))
        if len(values)
        else np.zeros(0, dtype=np.int64)
    )


def highest_per_column(
    x: NDArray[np.float64], values: NDArray[np.int64], columns: int = 700
) -> list[tuple[float, float, int]]:
    """Return stretches (from, to, value) of a piecewise constant series.

    Within a column the highest value wins.

    Args:
        x: ascending, shape (n,).
        values: shape (n,).
        columns: number of columns, about one per pixel.
    """
    if not len(x):
        return []
    if len(x) > columns:
        column = columns_of(x, columns)
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        x, values = np.append(x[starts], x[-1]), np.maximum.reduceat(values, starts)
    else:
        x = np.append(x, x[-1])
    first = changes(values)
    last = np.append(first[1:], len(values))
    return [(float(x[i]), float(x[j]), int(values[i])) for i, j in zip(first, last, strict=True)]
