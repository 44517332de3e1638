"""SVG as text: elements whose attributes and content are escaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import NDArray


def element(name: str, content: str | Iterable[str] = "", /, **attributes: object) -> str:
    """Return one element.

    Args:
        name: of the element.
        content: markup inside it, already escaped; see `text` for words.
        attributes: an underscore in a name stands for a hyphen, one at its end is dropped
            (``class_``); numbers are written with two decimals; None leaves the attribute out.
    """
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(number(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    inside = content if isinstance(content, str) else "".join(content)
    return f"<{name}{written}>{inside}</{name}>" if inside else f"<{name}{written}/>"


def text(words: str, x: float, y: float, /, **attributes: object) -> str:
    """Return a line of text with its anchor at (x, y)."""
    return element("text", escape(words), x=x, y=y, **attributes)


def tooltip(words: str) -> str:
    """Return what a browser shows when the pointer rests on the element around it."""
    return element("title", escape(words))


def number(value: object) -> str:
    """Write a value: numbers with at most two decimals, everything else as it is."""
    if isinstance(value, (float, np.floating)):
        return f"{value:.2f}".rstrip("0").rstrip(".")
    return str(value)


def path(x: NDArray[np.float64], y: NDArray[np.float64], *, steps: bool = False) -> str:
    """Return path data through points; a point that is not finite interrupts the line.

    Args:
        x: shape (n,) [px].
        y: shape (n,) [px].
        steps: hold each value until the next point.
    """
    words: list[str] = []
    pen_down = False
    for px, py, finite in zip(
        np.round(x, 1).tolist(), np.round(y, 1).tolist(), np.isfinite(x + y).tolist(), strict=True
    ):
        if not finite:
            pen_down = False
        elif not pen_down:
            words.append(f"M{px:g} {py:g}")
            pen_down = True
        else:
            words.append(f"H{px:g}V{py:g}" if steps else f"L{px:g} {py:g}")
    return "".join(words)


def picture(
    content: Iterable[str], width: float, height: float, title: str, description: str
) -> str:
    """Return a whole picture that scales with its place.

    Args:
        content: elements, back to front.
        width: of the drawing [px].
        height: of the drawing [px].
        title: name of the picture, for screen readers.
        description: what is to be seen, in a sentence or two with the numbers that matter.
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
