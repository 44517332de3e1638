"""Compile what a wheel holds: steps and rests of the problems that come with the package.

Run ``python -m tools.libraries --out FOLDER [--problems NAME ...] [--jobs 2]``.

Each problem is compiled without and with a guide, for a robot of which nothing and of which
everything is declared, for every processor of the machine and for the third level of x86-64.
The rests are those of the problem's person, and of one with other weights of the joints. Problems
and people of one structure share a library.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import ergoqp
from ergoqp.errors import ErgoqpError
from ergoqp.native.compiled import (
    FLAGS,
    V3,
    compile_in,
    daqp_archive,
    daqp_include,
    sources_of,
)
from ergoqp.native.content import value_key
from ergoqp.native.shipped import VARIANTS, digest, machine
from ergoqp.responses.ik import IkResponse
from ergoqp.rest.batch import rests_sources
from ergoqp.rest.model_person import ModelPerson, sample_person
from ergoqp.step.certification import stop_sources
from ergoqp.step.engine import layout_of, shipped_key
from ergoqp.step.function import build_shared_step
from ergoqp.step.model import StepModel

ROOT: Final = Path(__file__).resolve().parents[1]

ROBOT: Final = {
    "delay": 0.01,
    "lag": 0.02,
    "gain_error": 0.02,
    "pose_delay": 0.01,
    "pose_noise": 1e-3,
    "pose_noise_deg": 0.2,
    "longest_hold": 0.02,
}
"""A robot of which everything is declared."""

NEWEST: Final = (2, 28)
"""The newest C library that the wheel may need."""

_OLDER: Final = """#include <features.h>
#if defined(__x86_64__) && defined(__GLIBC__)
__asm__(".symver exp,exp@GLIBC_2.2.5");
__asm__(".symver log,log@GLIBC_2.2.5");
__asm__(".symver pow,pow@GLIBC_2.2.5");
__asm__(".symver hypot,hypot@GLIBC_2.2.5");
#endif
"""
"""Functions with a newer version of which the older one has the same values."""


def variants() -> dict[str, tuple[str, ...]]:
    """Return the compiler's flags of each variant for this machine."""
    v3 = {VARIANTS[0]: tuple(V3.values())} if platform.machine() == "x86_64" else {}
    return v3 | {VARIANTS[1]: ()}


def write(
    folder: Path, name: str, key: str, layout: Any, sources: dict[str, str], variant: str
) -> Path:
    """Write a library with its record; return its path."""
    sources = sources | {"older.h": _OLDER}
    flags = (*FLAGS, *variants()[variant], "-s", "-include", "older.h")
    with tempfile.TemporaryDirectory() as scratch:
        made = compile_in(Path(scratch), sources, [daqp_archive()], [daqp_include()], flags)
        content = made.read_bytes()
    path = folder / f"{name}-{key}-{variant}.so"
    path.write_bytes(content)
    record = {"key": key, "version": ergoqp.__version__, "machine": machine(), "layout": layout}
    text = json.dumps(record | {"sha256": digest(content)}, indent=1)
    path.with_suffix(".json").write_text(text, encoding="utf-8")
    if sys.platform == "linux" and (needed := newest(path)) > NEWEST:
        raise ErgoqpError(f"{path.name}: got one that needs glibc {needed}, allowed {NEWEST}")
    return path


def newest(path: Path) -> tuple[int, ...]:
    """Return the newest version of glibc that a library needs."""
    command = ["readelf", "--dyn-syms", "--wide", str(path)]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = re.findall(r"@GLIBC_([\d.]+)", shown)
    return max((tuple(map(int, each.split("."))) for each in found), default=(0,))


def models(names: Sequence[str]) -> dict[str, StepModel]:
    """Return a problem of each structure, by key."""
    found = dict[str, StepModel]()
    for name in names:
        problem = ergoqp.load_problem(name)
        for robot in (problem.robot, ergoqp.DeclaredRobot(**ROBOT)):
            for guided in (False, True):
                try:
                    model = StepModel(problem.replace(robot=robot), guided)
                except ErgoqpError as error:
                    print(f"{name}: not with such a robot: {error}")
                    continue
                if (key := shipped_key(model)) is not None:
                    found.setdefault(key, model)
    return found


def rests(names: Sequence[str]) -> list[dict[str, str]]:
    """Return the sources of the rests of a person of each structure.

    Where joints have weights of their own, less of the arithmetic can be joined.
    """
    found = dict[str | None, dict[str, str]]()
    for problem in map(ergoqp.load_problem, names):
        if not isinstance(problem.response, IkResponse):
            continue
        for person in (ModelPerson(problem.response), sample_person(problem, seed=0)):
            sources, _ = rests_sources(person)
            found.setdefault(value_key(sources), sources)
    return list(found.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--problems", nargs="+")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    names = given.problems or sorted(each.stem for each in (ROOT / "problems").glob("*.toml"))
    given.out.mkdir(parents=True, exist_ok=True)
    for variant in VARIANTS:
        for old in given.out.glob(f"*-{variant}.*"):
            old.unlink()
    stop = stop_sources()
    with ThreadPoolExecutor(given.jobs) as pool:
        jobs = [
            pool.submit(write, given.out, "stop", value_key(stop) or "", None, stop, VARIANTS[1])
        ]
        for sources in rests(names):
            parts = given.out, "rests", value_key(sources) or "", None, sources
            jobs += [pool.submit(write, *parts, variant) for variant in variants()]
        for key, model in models(names).items():
            _, sources = sources_of(
                lambda solver, model=model: build_shared_step(
                    model.problem, solver, guided=model.guided, unrolled=True
                )
            )
            parts = given.out, "step", key, layout_of(model), sources
            jobs += [pool.submit(write, *parts, variant) for variant in variants()]
        for job in jobs:
            path = job.result()
            print(f"{path.name} {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
