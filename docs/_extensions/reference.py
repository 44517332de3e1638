"""The reference: a page for every public name, and the lists of them on `docs/reference.md`.

The pages are made anew in ``docs/reference/`` whenever the site is built.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any, Final

from public_names import NAMES, PUBLIC, docstring_of, found
from sphinx.application import Sphinx

_INDEX: Final = "reference"
_COLON: Final = "\ue000"
"""Stands for a colon, of the characters that nobody else uses."""


def _directive(name: str) -> list[str]:
    value = found(name)
    if isinstance(value, type):
        options = ["members", "class-doc-from: class"]
        # An error, a table of keywords and an enumeration inherit what Python gives to all of them.
        if not issubclass(value, (BaseException, dict, int)):
            options += ["inherited-members: Protocol, ABC"]
        return ["autoclass", *options]
    return ["autofunction"] if inspect.isroutine(value) else ["autodata", "no-value"]


def _page(name: str) -> str:
    kind, *options = _directive(name)
    module, _, last = name.rpartition(".")
    lines = [
        last,
        "=" * len(last),
        "",
        ".. code-block:: python",
        "",
        f"   from {module} import {last}",
        "",
    ]
    lines += [
        f".. {kind}:: {name}",
        *(f"   :{o}" if ":" in o else f"   :{o}:" for o in options),
        "",
    ]
    return "\n".join(lines)


def write_pages(app: Sphinx) -> None:
    """Write the pages; what is the same already is left as it is, so that it is not read anew."""
    folder = Path(app.srcdir) / _INDEX
    folder.mkdir(exist_ok=True)
    pages = {f"{name}.rst": _page(name) for name in NAMES}
    for stale in set(folder.iterdir()) - {folder / file for file in pages}:
        stale.unlink()
    for file, text in pages.items():
        path = folder / file
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def add_lists(app: Sphinx, document: str, source: list[str]) -> None:
    """Put the names by group at the end of the index page, each with its first sentence."""
    if document != _INDEX:
        return
    for group, names in PUBLIC.items():
        source[0] += f"\n## {group}\n\n| name | what it is |\n|---|---|\n"
        for name in names:
            first = docstring_of(name).split("\n\n")[0].replace("\n", " ").replace("|", r"\|")
            source[0] += f"| [`{name.removeprefix('ergoqp.')}`]({_INDEX}/{name}.rst) | {first} |\n"
        listed = "\n".join(f"{_INDEX}/{name}" for name in names)
        source[0] += f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def outdated(*_: Any) -> list[str]:
    """Return the index page: what stands on it is told by docstrings."""
    return [_INDEX]


def hide_colon(app: Sphinx, what: str, name: str, *rest: Any) -> None:
    """Hide a colon in the first line of a property: Napoleon takes it for the end of a type.

    What is said of a constant is read from its own file, wherever the constant is imported from.
    """
    lines = rest[-1]
    if what == "data":
        lines[:] = docstring_of(name).splitlines()
    if what in ("attribute", "data", "property") and lines:
        lines[0] = lines[0].replace(":", _COLON)


def show_colon(app: Sphinx, what: str, name: str, *rest: Any) -> None:
    """Show it again."""
    rest[-1][:] = [line.replace(_COLON, ":") for line in rest[-1]]


def setup(app: Sphinx) -> dict[str, Any]:
    """Make the pages before the site is read."""
    app.connect("builder-inited", write_pages)
    app.connect("source-read", add_lists)
    app.connect("autodoc-process-docstring", hide_colon, priority=400)
    app.connect("autodoc-process-docstring", show_colon, priority=600)
    app.connect("env-get-outdated", outdated)
    return {"parallel_read_safe": True}
