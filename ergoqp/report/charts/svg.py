"""SVG as text: elements with escaped attributes and contents."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import NDArray


def element(name: str, content: str | Iterable[str] = "", /, **attributes: object) -> str:
    """Return one element.

    Args:
        name: name of the element.
        content: markup inside it, already escaped; for words see `text`.
        attributes: attributes; an underscore in a name becomes a hyphen, one at its end is
            dropped (``class_``); numbers are written with two decimals; None omits the
            attribute.
    """
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(number(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    inside = content if isinstance(content, str) else "".join(content)
    return f"<{name}{written}>{inside}</{name}>" if inside else f"<{name}{written}/>"


def line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    """Return a straight line [px] of a class."""
    return element("line", x1=x1, x2=x2, y1=y1, y2=y2, class_=style)


def rect(
    x: float, y: float, width: float, height: float, content: str = "", /, **attributes: object
) -> str:
    """Return a rectangle with its upper left corner at (x, y) [px]."""
    return element("rect", content, x=x, y=y, width=width, height=height, **attributes)


def circle(x: float, y: float, r: float, style: str) -> str:
    """Return a circle around (x, y) [px] of a class."""
    return element("circle", cx=x, cy=y, r=r, class_=style)


def text(words: str, x: float, y: float, /, **attributes: object) -> str:
    """Return a line of text with its anchor at (x, y)."""
    return element("text", escape(words), x=x, y=y, **attributes)


def tooltip(words: str) -> str:
    """Return the text that a browser shows when the pointer rests on the enclosing element."""
    return element("title", escape(words))


def number(value: object) -> str:
    """Return a value as text: numbers with at most two decimals, all else unchanged."""
    if isinstance(value, (float, np.floating)):
        return f"{value:.2f}".rstrip("0").rstrip(".")
    return str(value)


def path(x: NDArray[np.float64], y: NDArray[np.float64], *, steps: bool = False) -> str:
    """Return path data through points. A point that is not finite interrupts the line.

    Points are written relative to the one before, which is half as long.

    Args:
        x: shape (n,) [px].
        y: shape (n,) [px].
        steps: hold each value until the next point.
    """
    finite = np.isfinite(x + y)
    # Use whole tenths of a pixel, so that differences of rounded numbers do not drift.
    across, down = (
        np.round(10 * np.where(finite, each, 0)).astype(int).tolist() for each in (x, y)
    )
    words: list[str] = []
    last: tuple[int, int] | None = None
    for px, py, there in zip(across, down, finite.tolist(), strict=True):
        if not there:
            last = None
            continue
        if last is None:
            words.append(f"M{px / 10:g} {py / 10:g}")
        else:
            right, below = (px - last[0]) / 10, (py - last[1]) / 10
            words.append(
                f"h{right:g}v{below:g}"
                if steps
                else f"l{right:g}{'' if below < 0 else ' '}{below:g}"
            )
        last = px, py
    return "".join(words)


def area(x: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
    """Return path data of the area between two lines that hold each value until the next point.

    Args:
        x: ascending, shape (n,) [px].
        low: one line, shape (n,) [px]; a value that is not finite interrupts the area.
        high: the other, the same.
    """
    finite = np.isfinite(low + high)
    words: list[str] = []
    for first, last in _stretches(finite):
        # The area ends where the next one begins, also if that has no value.
        across = np.round(x[first : min(last + 1, len(x))], 1)
        across = np.append(across, across[-1:]) if last == len(x) else across
        there = _steps(across, np.round(low[first:last], 1))
        back = _steps(across, np.round(high[first:last], 1))[::-1]
        points = [f"{number(px)} {number(py)}" for px, py in (*there, *back)]
        words.append(f"M{'L'.join(points)}Z")
    return "".join(words)


def _stretches(there: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last + 1 of every stretch of true values (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _steps(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Return the corners of a line that holds each value y (n,) from one x (n + 1,) to the next."""
    return list(zip(np.repeat(x, 2)[1:-1].tolist(), np.repeat(y, 2).tolist(), strict=True))


def picture(
    content: Iterable[str], width: float, height: float, title: str, description: str
) -> str:
    """Return a complete picture that scales with its place.

    Args:
        content: elements, back to front.
        width: width of the drawing [px].
        height: height of the drawing [px].
        title: name of the picture for screen readers.
        description: description of the contents, one or two sentences with the important
            numbers.
    """
    return element(
        "svg",
        [tooltip(title), element("desc", escape(description)), *content],
        viewBox=f"0 0 {number(width)} {number(height)}",
        class_="chart",
        role="img",
        aria_label=f"{title}. {description}",
        style=f"max-width:{number(width)}px",
    )
