"""What a closed loop leaves behind: everything that happened, in arrays, ready to be saved, drawn and judged."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ergoqp.human import Body
from ergoqp.sheets.reba import Assessment
from ergoqp.step.place import Guide


@dataclass(frozen=True)
class Run:
    """One closed loop of a problem with a simulated person.

    Attributes:
        problem: name of the problem.
        title: the problem in a few words, for people.
        body: the simulated person's body (not the controller's model of it).
        joints: names of the joints that the person moves to follow the object.
        dt: control period [s].
        seed: of everything random in the run.
        time: time of each sample [s], shape (n,).
        postures: the person's true posture at each sample, shape (n, 32) [rad].
        base_poses: pelvis in the world, shape (n, 4, 4).
        poses: true pose of the object's contact frame in the world, shape (n, 4, 4).
        twists: object twist sent at each sample, shape (n, 6) [m/s, rad/s].
        reba: exact score of the true posture, shape (n,).
        cost: smooth cost of the measured posture, shape (n,).
        statuses: status of each step.
        reasons: its sentence, empty when there is nothing to say.
        active: names of the limits that held the object back at each step.
        step_time: duration of each step call [s], shape (n,).
        assessment: exact assessment of the first and the last posture (two rows).
        violations: number of steps that broke a limit, per limit, by the independent checker.
        max_violation: the worst of each, in the limit's unit.
        units: unit of each limit.
        person_outside: the simulated person's own joints beyond their range: samples per joint.
        let_go: time at which the person could not reach any more [s], None if never.
        options: the problem's terms and the method's options, for the report: (what, value).
        assumptions: sentences on everything that was taken as given.
        recording: name of the recording that the run started from, None if none.
        start_time: moment of the recording that the run started from [s], None if none.
        unobserved: joints that the controller could not see.
        reba_standing_still: exact score at which the person would come to rest had the object stayed where it was: what the
            robot is to be compared with.
        settle: when the object came to rest for good [s], None if it was still moving at the end.
        guide: the place that the control step was given to be drawn to, None without one.
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

    def save(self, folder: str | Path) -> Path:
        """Write ``run.json``, what the run comes down to, and ``run.npz``, every array of it; see ``docs/run_json.md``.

        Args:
            folder: where to; it is made if it is not there.

        Returns:
            The path of ``run.json``.

        Raises:
            OSError: if the files cannot be written.
        """
        from ergoqp.simulation.run_json import write_run

        return write_run(self, Path(folder))
