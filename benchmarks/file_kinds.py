"""The kinds of files that the package reads: whole ones to begin with, and what reads them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.made_markers import markers_of, write_c3d, write_table
from benchmarks.made_motions import BODY
from ergoqp.costs.load import load_cost
from ergoqp.datasets.data import DataSet, cached_data
from ergoqp.errors import ErgoqpError
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.learning.model_file import load_model, save_model
from ergoqp.learning.one_class import load_one_class
from ergoqp.mocap import load_recording
from ergoqp.mocap.formats.bvh import write_bvh
from ergoqp.mocap.naming import centres_of
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.load import load_problem
from ergoqp.registry import data_folder

Rng = np.random.Generator


@dataclass(frozen=True)
class Kind:
    """One kind.

    Attributes:
        name: for people.
        suffix: of its files.
        text: whether it is text.
        made: a whole one.
        read: what the package does with a path.
    """

    name: str
    suffix: str
    text: bool
    made: Callable[[Rng], bytes]
    read: Callable[[Path], Any]


def _one_of(contents: list[bytes], rng: Rng) -> bytes:
    return contents[rng.integers(len(contents))]


def problems(folder: Path) -> Kind:
    """Problem files."""
    whole = [path.read_bytes() for path in sorted(data_folder("problems").glob("*.toml"))]
    return Kind("problem", ".toml", True, partial(_one_of, whole), load_problem)


def models(folder: Path) -> Kind:
    """Learned models as files, bytes changed."""
    whole = [path.read_bytes() for path in sorted(data_folder("models").glob("*.npz"))]
    return Kind("model", ".npz", False, partial(_one_of, whole), _read_model)


def forged_models(folder: Path) -> Kind:
    """Learned models with changed arrays and a new checksum, and headers that claim too much."""
    whole = [load_model(path) for path in sorted(data_folder("models").glob("*.npz"))]
    return Kind("forged model", ".npz", False, partial(_forged, whole, folder), _read_model)


def _forged(whole: list[tuple[dict, dict]], folder: Path, rng: Rng) -> bytes:
    header, arrays = whole[rng.integers(len(whole))]
    header, arrays = json.loads(json.dumps(header)), dict(arrays)
    if rng.random() < 0.15:
        return _claiming(rng)
    name = str(rng.choice(sorted(arrays)))
    value = np.array(arrays[name], copy=True)
    change = rng.integers(7)
    if change == 0:
        del arrays[name]
    elif change == 1 and value.dtype.kind == "f" and value.size:
        with np.errstate(over="ignore"):
            value.flat[rng.integers(value.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e308])
        arrays[name] = value
    elif change == 2:
        arrays[name] = value[:-1] if value.ndim and len(value) else np.zeros((2, 2))
    elif change == 3:
        arrays[name] = value.T if value.ndim > 1 else value[None]
    elif change == 4:
        arrays[name] = np.array(["words"] * 3)
    elif change == 5:
        keys = [key for key in header if key != "kind"]
        header[str(rng.choice(keys))] = (rng.choice([0, 1]) and "x") or None
    else:
        arrays[name] = np.zeros(0)
    header.pop("format", None)
    path = folder / "forged.npz"
    save_model(path, header, arrays)
    return path.read_bytes()


def _claiming(rng: Rng) -> bytes:
    """An array that says it is far larger than it is."""
    import zipfile

    file = io.BytesIO()
    count = int(rng.choice([10**13, 10**9, 2**63 - 1, 10**6]))
    head = (
        f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}".ljust(117).encode()
        + b"\n"
    )
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(
            "header.npy",
            b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + b"\x00" * 1000,
        )
        if rng.random() < 0.5:
            packed.writestr("weights.npy", b"\x00" * 400_000_000)
    return file.getvalue()


def _read_model(path: Path) -> None:
    try:
        load_cost(path)
    except ErgoqpError as error:
        if "one_class" not in str(error) and "kind 'one" not in str(error):
            raise
        load_one_class(path)


def recordings(folder: Path) -> Kind:
    """Recordings."""
    body, rng = Body.of_stature(1.7), np.random.default_rng(0)
    whole = []
    for number in range(3):
        postures = np.cumsum(0.02 * rng.normal(size=(6, len(JOINTS))), axis=0)
        bases = np.tile(np.eye(4), (6, 1, 1))
        bases[:, 2, 3] = 0.95
        whole.append(
            write_bvh(folder / f"take{number}.bvh", postures, bases, body, 0.02).read_bytes()
        )
    return Kind("recording", ".bvh", True, partial(_one_of, whole), load_recording)


def markers(folder: Path) -> Kind:
    """Recordings of markers, bytes changed."""
    names, places = markers_of(BODY, np.zeros((6, 4)), np.zeros((6, len(JOINTS))))
    write_c3d(folder / "take.c3d", names, places, 50.0)
    whole = [(folder / "take.c3d").read_bytes()]
    return Kind("markers", ".c3d", False, partial(_one_of, whole), load_recording)


def tables(folder: Path) -> Kind:
    """Tables of joint centres."""
    paths = centres_of(BODY, np.zeros((6, 4)), np.zeros((6, len(JOINTS))))
    write_table(folder / "take.csv", tuple(paths), np.stack(list(paths.values()), axis=1), 50.0)
    whole = [(folder / "take.csv").read_bytes()]
    return Kind("table", ".csv", True, partial(_one_of, whole), load_recording)


def people(folder: Path) -> Kind:
    """Person files, beside a recording."""
    take = folder / "whole.bvh"
    bases = np.tile(np.eye(4), (4, 1, 1))
    bases[:, 2, 3] = 0.95
    write_bvh(take, np.zeros((4, len(JOINTS))), bases, Body.of_stature(1.7), 0.02)
    whole = [
        b"stature = 1.70\n",
        b"stature = 1.70\nmass_kg = 70\n",
        b"[lengths]\nthigh = 0.42\nupper_arm = 0.31\n",
    ]
    return Kind(
        "person",
        ".toml",
        True,
        partial(_one_of, whole),
        lambda path: load_recording(take, person=path),
    )


def optima(folder: Path) -> Kind:
    """Optima, and the guides that they are read as."""
    from ergoqp.step.guide import read_guide

    problem = load_problem("screwing")
    best = optimise(problem, problem.response.comfort, starts=1, seed=0)  # pyright: ignore
    best.save(folder / "whole.json")
    whole = [(folder / "whole.json").read_bytes()]
    return Kind(
        "optimum",
        ".json",
        True,
        partial(_one_of, whole),
        lambda path: read_guide(problem, Optimum.load(path)),
    )


def caches(folder: Path) -> Kind:
    """Data in the user's cache: whatever is there, what was asked for comes back."""
    import os

    os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
    data = DataSet(np.ones((3, 2)), np.arange(3.0), ("a", "b"), "made")
    cached_data("kind", {"n": 1}, lambda: data)
    kept = next((folder / "cache").rglob("*.npz"))
    whole = [kept.read_bytes()]

    def read(path: Path) -> None:
        if path.is_file():
            kept.write_bytes(path.read_bytes())
        got = cached_data("kind", {"n": 1}, lambda: data)
        if got.points.shape[1:] != (2,):
            raise AssertionError("something else came back")

    return Kind("cache", ".npz", False, partial(_one_of, whole), read)


KINDS = (
    problems,
    models,
    forged_models,
    recordings,
    markers,
    tables,
    people,
    optima,
    caches,
)
"""What makes each kind in a folder."""
