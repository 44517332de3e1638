"""What blocks of pages need and readers have: recordings, robots, cameras."""

from __future__ import annotations

import atexit
import itertools
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from page_blocks import blocks_of

import ergoqp
from benchmarks.made_markers import markers_of, write_c3d, write_table
from benchmarks.made_motions import BODY, RATE, moved, posture
from ergoqp.mocap.demo_recording import demo_recording
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.people import person_of_kind


def _take() -> dict[str, Any]:
    demo_recording(Path("take.bvh"))
    return {}


def _trial() -> dict[str, Any]:
    """A walk and a stoop as markers, and the same person standing."""
    names, places = markers_of(BODY, *moved())
    write_c3d(Path("trial.c3d"), names, places, RATE)
    write_table(Path("table.csv"), names, places, RATE)
    still = markers_of(BODY, np.tile([0.0, 0.0, 0.9, 0.0], (60, 1)), posture(60))[1]
    write_c3d(Path("static.c3d"), names, still, RATE)
    return {"names": names, "positions": places, "rate": RATE}


def _robot() -> dict[str, Any]:
    """A robot that does what it is told for a few periods, and a camera that sees the person."""
    problem = ergoqp.load_problem("screwing")
    posture = problem.response.comfort
    state = SimpleNamespace(left=5)
    late = itertools.cycle([False, True])

    def running() -> bool:
        state.left -= 1
        return state.left >= 0

    robot = SimpleNamespace(
        is_running=running,
        object_pose=lambda: None,
        object_twist=lambda: np.zeros(6),
        stands=lambda: True,
        send=lambda twist: None,
        wait=lambda: None,
        is_late=lambda: next(late),
    )
    camera = SimpleNamespace(latest=lambda: SimpleNamespace(posture=posture, age=0.01))
    return {"robot": robot, "camera": camera, "log": lambda *said: None}


def _service() -> dict[str, Any]:
    """A service in the usual folder, which is here, and what a loop has besides."""
    command = [sys.executable, "-m", "ergoqp", "serve", "screwing", "--interpreted"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    atexit.register(lambda: (process.terminate(), process.wait()))
    until = time.monotonic() + 60
    while True:
        try:
            ergoqp.Client("screwing").close()
            return _robot()
        except ergoqp.errors.ErgoqpError:
            assert time.monotonic() < until
            time.sleep(0.05)


def _relay() -> dict[str, Any]:
    """A relay in the usual folder, and a robot that has not moved yet."""
    command = [sys.executable, "-m", "ergoqp", "relay"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    atexit.register(lambda: (process.terminate(), process.wait()))
    until = time.monotonic() + 60
    with ergoqp.Client("screwing", relay="relay", timeout=1.0) as client:
        while not (client.step(None), client.relay_stands)[1]:
            assert time.monotonic() < until
            time.sleep(0.05)
    return _robot()


def _posture() -> dict[str, Any]:
    problem = ergoqp.load_problem("screwing")
    return {"posture": awkward_start(problem, person_of_kind("alike", problem, 0), 0)}


def _my_terms() -> dict[str, Any]:
    """The module, the problem file and the entry points that the page on own terms shows."""
    shown = blocks_of(Path(__file__).resolve().parents[2] / "docs" / "extend.md")
    parts = [block.text for block in shown if block.text.startswith("# in my_terms.py\n")]
    Path("my_terms.py").write_text("\n".join(parts), encoding="utf-8")
    points = next(block.text for block in shown if "entry-points" in block.text)
    info = Path("my_terms-0.1.dist-info")
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-terms\nVersion: 0.1\n")
    points = re.sub(r'\[project\.entry-points\."(.+)"\]', r"[\1]", points).replace('"', "")
    (info / "entry_points.txt").write_text(points, encoding="utf-8")
    problem = next(block.text for block in shown if block.language == "toml")
    Path("mine.toml").write_text(problem, encoding="utf-8")
    sys.path.insert(0, str(Path.cwd()))
    return {}


def _patient() -> dict[str, Any]:
    """A dentist's posture at a place that an arm beside the chair reaches."""
    problem = ergoqp.load_problem("dentist")
    person = sample_person(problem, seed=0, body=problem.response.body)
    return {"posture": awkward_start(problem, person, seed=4, places=1)}


def _run() -> dict[str, Any]:
    problem = ergoqp.load_problem("screwing")
    ergoqp.simulate(problem, problem.response.comfort, 0.2).save(Path())
    return {}


def _my_task() -> dict[str, Any]:
    """The first problem of the page on problems, as its reader saved it."""
    page = Path(__file__).resolve().parents[2] / "docs" / "problem.md"
    first = next(block for block in blocks_of(page) if block.language == "toml")
    Path("my_task.toml").write_text(first.text, encoding="utf-8")
    return {}


def _built_step() -> dict[str, Any]:
    """The folder ``step`` of an export, its shared library built, without what makes it fast."""
    Path("step/build").mkdir()
    folders = [f"-I{name}" for name in ("include", "src", "daqp/include")]
    sources = [f"src/{name}.c" for name in ("ergoqp_core", "ergoqp_step", "ergoqp_names", "qp")]
    parts = [*folders, *sources, "daqp/lib/libdaqpstat.a", "-lm"]
    command = ["gcc", "-std=c99", "-O0", "-shared", "-fPIC", *parts]
    subprocess.run([*command, "-o", "build/libergoqp_step.so"], cwd="step", check=True)
    return {}


GIVEN: dict[str, Callable[[], dict[str, Any]]] = {
    "take": _take,
    "trial": _trial,
    "robot": _robot,
    "service": _service,
    "relay": _relay,
    "posture": _posture,
    "patient": _patient,
    "run": _run,
    "my_terms": _my_terms,
    "my_task": _my_task,
    "built_step": _built_step,
}
"""Name -> what makes it in the working folder; what it returns is there for Python blocks."""
