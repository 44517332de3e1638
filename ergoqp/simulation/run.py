"""The result of a closed loop: everything that happened, as arrays."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp._version import __version__
from ergoqp.expressions import pose_as_dict
from ergoqp.files.atomic import atomic_write, write_json
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.seeking.next_place import Try
from ergoqp.sheets.reba import Assessment
from ergoqp.step.guide import Guide


@dataclass(frozen=True)
class Run:
    """One closed loop of a problem with a simulated person.

    Attributes:
        problem: name of the problem.
        title: the problem in a few words, for people.
        body: body of the simulated person (not that of the controller's model).
        joints: names of the joints that the person moves to follow the object.
        dt: control period [s].
        seed: seed of everything random in the run.
        time: time of each sample [s], shape (n,).
        postures: the person's true posture at each sample, shape (n, 32) [rad].
        base_poses: pelvis in the world, shape (n, 4, 4) [m].
        poses: true pose of the object's contact frame in the world, shape (n, 4, 4) [m].
        twists: object twist sent at each sample, shape (n, 6) [m/s, rad/s].
        reba: exact score of the true posture, shape (n,) [points].
        cost: smooth cost of the measured posture, shape (n,) [points].
        statuses: status of each step.
        reasons: sentence of each step, empty if there is nothing to report.
        active: names of the limits that held the object back at each step.
        step_time: duration of each step's own call [s], see `Step.solve_time`, shape (n,).
        assessment: exact assessment of the first and the last posture (two rows).
        violations: number of steps that broke a limit, per limit, by the independent checker.
        max_violation: largest violation of each limit, in its unit.
        units: unit of each limit.
        person_outside: number of samples in which a joint of the simulated person was beyond
            its range, per joint.
        let_go: time at which the person could not reach the object any more [s], None if
            never.
        options: terms of the problem and options of the method, for the report: (what, value).
        assumptions: sentences on everything that was assumed.
        recording: name of the recording that the run started from, None if none.
        start_time: time in the recording at which the run started [s], None if none.
        unobserved: joints that the controller could not see.
        reba_standing_still: exact score of the person's rest if the object had stayed where it
            was, for comparison with the robot.
        settle: time at which the object came to rest for good [s], None if it was still moving
            at the end.
        guide: the place that guided the control step, None without one.
        tries: the places that a loop with `seek` tried, and the scores that it measured there.
        follower: kind of the person, one of `ergoqp.simulation.people.kinds`.
        forces: forces of the object on the hands, at the contact frame, world-aligned, shape
            (n, 6) [N, N m]; not finite for people without mass.
        slips: number of times that a hand slipped on the object.
        fell: time at which the person fell [s], None if never.
        unbalanced: share of the time with the centre of mass outside the base of support.

    Example:
        >>> import ergoqp
        >>> import tempfile
        >>> problem = ergoqp.load_problem("screwing")
        >>> run = ergoqp.simulate(problem, problem.response.comfort, duration=0.2)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     name = run.save(folder).name
        >>> name, run.postures.shape, run.let_go
        ('run.json', (20, 32), None)
    """

    problem: str
    title: str
    body: Body
    joints: tuple[str, ...]
    dt: float
    seed: int
    time: np.ndarray
    postures: np.ndarray
    base_poses: np.ndarray
    poses: np.ndarray
    twists: np.ndarray
    reba: np.ndarray
    cost: np.ndarray
    statuses: list[str]
    reasons: list[str]
    active: list[tuple[str, ...]]
    step_time: np.ndarray
    assessment: Assessment
    violations: dict[str, int]
    max_violation: dict[str, float]
    units: dict[str, str]
    person_outside: dict[str, int]
    let_go: float | None
    options: list[tuple[str, str]] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    recording: str | None = None
    start_time: float | None = None
    unobserved: tuple[str, ...] = ()
    reba_standing_still: int = 0
    settle: float | None = None
    guide: Guide | None = None
    tries: tuple[Try, ...] = ()
    follower: str = "alike"
    forces: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    slips: int = 0
    fell: float | None = None
    unbalanced: float = 0.0

    def save(self, folder: str | Path) -> Path:
        """Write ``run.json``, the summary of the run, and ``run.npz``, all its arrays.

        The files are described in ``docs/run_json.md``.

        Args:
            folder: folder of the files; it is created if needed.

        Returns:
            The path of ``run.json``.

        Raises:
            OSError: if the files cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / "run.npz") as scratch:
            np.savez_compressed(scratch, allow_pickle=False, **arrays_of(self))
        path = folder / "run.json"
        write_json(path, summary_of_run(self))
        return path


def summary_of_run(run: Run) -> dict[str, Any]:
    """Return the contents of ``run.json``: numbers, texts, lists and dicts.

    Values that are unknown or not finite are None.
    """
    before, after = (
        {name: int(scores[row]) for name, scores in run.assessment.segments.items()}
        for row in (0, -1)
    )
    microseconds = 1e6 * run.step_time
    return {
        "version": __version__,
        "problem": run.problem,
        "title": run.title,
        "recording": run.recording,
        "start_time_s": _seconds(run.start_time),
        "seed": run.seed,
        "dt": run.dt,
        "steps": len(run.time),
        "duration_s": round(len(run.time) * run.dt, 9),
        "reba_before": int(run.reba[0]),
        "reba_after": int(run.reba[-1]),
        "reba_best": int(run.reba[run.reba > 0].min(initial=15)),
        "reba_standing_still": run.reba_standing_still,
        "segments_before": before,
        "segments_after": after,
        "status_counts": dict(Counter(run.statuses)),
        "step_time_us": {
            "median": float(np.median(microseconds)),
            "p99": float(np.percentile(microseconds, 99)),
            "max": float(microseconds.max()),
        },
        "settle_s": _seconds(run.settle),
        "guide": _place(run.guide),
        "tries": [_try(each) for each in run.tries],
        "let_go_s": _seconds(run.let_go),
        "violations": dict(run.violations),
        "max_violation": {name: _finite(value) for name, value in run.max_violation.items()},
        "units": dict(run.units),
        "person_outside": dict(run.person_outside),
        "person": run.body.as_dict(),
        "follower": run.follower,
        "hand_force_n": hand_forces(run.forces),
        "slips": run.slips,
        "fell_s": _seconds(run.fell),
        "unbalanced_share": run.unbalanced,
        "unobserved": list(run.unobserved),
        "options": dict(run.options),
        "assumptions": list(run.assumptions),
    }


_PLAIN = ("time", "postures", "base_poses", "forces", "poses", "twists", "reba", "cost")


def arrays_of(run: Run) -> dict[str, np.ndarray]:
    """Return the contents of ``run.npz``.

    Texts are arrays of fixed-width strings, so that no pickle is needed.
    """
    names = sorted({name for active in run.active for name in active})
    return {
        **{name: getattr(run, name) for name in _PLAIN},
        "step_time": run.step_time,
        "statuses": np.array(run.statuses, dtype=np.str_),
        "reasons": np.array(run.reasons, dtype=np.str_),
        "active": np.array(
            [[name in active for name in names] for active in run.active], dtype=bool
        ),
        "active_names": np.array(names, dtype=np.str_),
        "joints": np.array(JOINTS, dtype=np.str_),
    }


def hand_forces(wrenches: np.ndarray) -> dict[str, float] | None:
    """Return the size of the forces on the hands; None for people without mass."""
    forces = np.linalg.norm(wrenches[:, :3], axis=1)
    forces = forces[np.isfinite(forces)]
    if not forces.size:
        return None
    return {
        "median": float(np.median(forces)),
        "p99": float(np.percentile(forces, 99)),
        "peak": float(forces.max()),
    }


def _place(guide: Guide | None) -> dict[str, Any] | None:
    return None if guide is None else pose_as_dict(guide.pose) | {"promise": guide.promise}


def _try(tried: Try) -> dict[str, Any]:
    return pose_as_dict(tried.pose) | {
        "name": tried.name,
        "why": tried.why,
        "begun_s": _seconds(tried.begun),
        "ended_s": _seconds(tried.ended),
        "score": _finite(tried.score),
        "note": tried.note,
    }


def _seconds(value: float | None) -> float | None:
    """Return a time without the rounding errors of multiples of the period."""
    return None if value is None else round(float(value), 9)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
