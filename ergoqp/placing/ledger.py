"""Finished starts in a file, line by line, so that a run that was killed can continue."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.files.cache import content_of, digest_of
from ergoqp.files.read import json_of
from ergoqp.joints import JOINTS
from ergoqp.limits import OneClassBoundary
from ergoqp.placing.optimise import PlaceTask
from ergoqp.placing.optimum import Trial, response_as_dict
from ergoqp.simulation.robot import moved

FILE = "optimum_starts.jsonl"
"""Name of the file in a folder of results."""

VERSION = 2
"""Version of the method. Trials of another version are not reused."""

_PROBES = 64


class Ledger:
    """The trials of one task, in a file that may also contain those of other tasks.

    Nothing is lost except a line that was cut off.

    Attributes:
        trials: trials of the task, by number.
    """

    def __init__(self, folder: Path, key: str) -> None:
        """Read the file. If it does not exist, the first trial creates it.

        Raises:
            OSError: if the file exists and cannot be read.
        """
        self._path, self._key = folder / FILE, key
        self.trials: dict[int, Trial] = {}
        text = (
            self._path.read_text(encoding="utf-8", errors="replace") if self._path.is_file() else ""
        )
        # A process that was killed while writing leaves half a line. The next line must not
        # continue it.
        self._before = "" if not text or text.endswith("\n") else "\n"
        for line in text.splitlines():
            try:
                entry = json_of(line, FILE)
                if entry["key"] == key:
                    trial = Trial.from_dict(entry["trial"])
                    self.trials[trial.number] = trial
            except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
                continue

    def add(self, trial: Trial) -> None:
        """Keep a trial. It is on the disk when this returns.

        Raises:
            OSError: if it cannot be written.
        """
        self.trials[trial.number] = trial
        line = json.dumps({"key": self._key, "trial": trial.as_dict()})
        with self._path.open("a", encoding="utf-8") as file:
            file.write(f"{self._before}{line}\n")
            file.flush()
            os.fsync(file.fileno())
        self._before = ""


def key_of(task: PlaceTask) -> str:
    """Return a short text for everything that a trial depends on besides its number.

    Cost and limits are identified by their fields and, because their code may change without
    them, by their values at some postures and places.
    """
    problem, begin = task.problem, task.begin
    content = {
        "version": VERSION,
        "cost": [
            problem.cost.name,
            content_of(problem.cost),
            np.asarray(problem.cost(_postures(task))).tolist(),
        ],
        "task": [dict(problem.task), asdict(problem.method)],
        "limits": [[content_of(limit), _said(task, limit)] for limit in problem.limits],
        "person": response_as_dict(task.person.response),
        "begin": [part.tolist() for part in (begin.posture, begin.pose, begin.grasp, begin.soles)],
        "options": [task.mode, task.solver, task.seed, task.tau_deg],
    }
    return digest_of(content)


def _postures(task: PlaceTask) -> np.ndarray:
    """Return postures from near comfort, where data are, to far from it (n, 32) [rad]."""
    far = np.linspace(0.02, 1.0, _PROBES)[:, None]
    drawn = np.random.default_rng(7).uniform(-1.0, 1.0, (_PROBES, len(JOINTS)))
    return task.person.response.comfort + far * drawn


def _said(task: PlaceTask, limit: Any) -> list[Any]:
    """Return a limit's values at some postures and places, empty if its fields define it."""
    own = task.problem.own_limits
    if any(limit is each for each in own.limits):
        turns = np.random.default_rng(8).uniform(-np.pi, np.pi, (_PROBES, 6))
        places = [moved(np.eye(4), turn / [2, 2, 2, 1, 1, 1]) for turn in turns]
        return [
            own.margins(limit, posture, pose).tolist()
            for posture, pose in zip(_postures(task), places, strict=True)
        ]
    if isinstance(limit, OneClassBoundary):
        measure = limit.measure()
        return [float(np.ravel(np.array(measure(posture)))[0]) for posture in _postures(task)]
    return []
