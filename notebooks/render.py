"""Run the notebooks at full size and write them with their outputs.

The call is ``python notebooks/render.py [NAME ...]``.

Each ``NAME.py`` (percent format of jupytext) becomes ``NAME.ipynb``, and its figures
``figures/*.png``. Names are beginnings: ``01`` renders ``01_gmr_cosine``.
"""

from __future__ import annotations

import base64
import os
import sys
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from studies import few_colours

FOLDER = Path(__file__).resolve().parent
LARGEST = 400_000
"""Bytes of a rendered notebook at most: it is read on the web."""


def sources(beginnings: list[str]) -> list[Path]:
    """Return the notebooks whose names begin so; without beginnings, all."""
    return sorted(
        path
        for path in FOLDER.glob("[0-9][0-9]_*.py")
        if not beginnings or any(path.name.startswith(text) for text in beginnings)
    )


def render(source: Path) -> Path:
    """Run one notebook and write it beside its source.

    Raises:
        RuntimeError: if the result is too large or tells where it was run.
    """
    notebook = jupytext.read(source, fmt="py:percent")
    NotebookClient(
        notebook, timeout=3600, kernel_name="python3", resources={"metadata": {"path": str(FOLDER)}}
    ).execute()
    # What differs from machine to machine and from run to run is left out.
    notebook.metadata = nbformat.from_dict(
        {
            "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
            "language_info": {"name": "python"},
        }
    )
    for number, cell in enumerate(notebook.cells):
        cell.metadata, cell.id = nbformat.from_dict({}), f"cell-{number:02d}"
        for output in cell.get("outputs", ()):
            output.get("metadata", {}).clear()
            if "image/png" in output.get("data", {}):
                picture = few_colours(base64.b64decode(output["data"]["image/png"]))
                output["data"]["image/png"] = base64.b64encode(picture).decode()
    text = nbformat.writes(notebook, version=4)
    for place in (str(FOLDER), str(Path.home()), sys.prefix):
        if place != "/" and place in text:
            raise RuntimeError(f"{source.name}: an output names the folder {place}")
    if len(text) > LARGEST:
        raise RuntimeError(
            f"{source.name}: {len(text)} bytes, allowed {LARGEST}: fewer or smaller figures"
        )
    result = source.with_suffix(".ipynb")
    result.write_text(text + "\n", encoding="utf-8")
    return result


if __name__ == "__main__":
    os.environ.pop("ERGOQP_NOTEBOOK_SIZE", None)
    for source in sources(sys.argv[1:]):
        result = render(source)
        print(f"{result.name}: {result.stat().st_size / 1e3:.0f} kB", flush=True)
