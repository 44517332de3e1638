"""``ergoqp run``: the closed loop of a problem with a simulated person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from ergoqp.cli.commands.common import (
    RecordingOptions,
    load_person_problem,
    make_folder,
    write_report,
    writing,
)
from ergoqp.cli.commands.guide import guide_named, places_to_try
from ergoqp.cli.commands.screen import console, print_assumptions, working
from ergoqp.errors import InputError
from ergoqp.human.person_file import given_person
from ergoqp.joints import JOINTS
from ergoqp.mocap import Recording
from ergoqp.mocap.recorded import as_recorded
from ergoqp.problem.problem import Problem
from ergoqp.problem_files.messages import nearest_first
from ergoqp.report.run_page import write_run_page
from ergoqp.report.tables import run_table
from ergoqp.rest.best_place import PLACES, awkward_place
from ergoqp.rest.person import Senses
from ergoqp.seeking.tries import Place
from ergoqp.sheets.reba import ACTION_LEVELS
from ergoqp.simulation.loop import check_numbers
from ergoqp.simulation.people import KINDS, person_of_kind
from ergoqp.simulation.robot import RobotKind
from ergoqp.simulation.run import Run
from ergoqp.simulation.simulate import simulate
from ergoqp.step.guide import Guide


@dataclass(frozen=True)
class Simulated:
    """Robot, sensors and person of the simulation, as given on the command line.

    Attributes:
        robot: ``NAME=VALUE,...`` of `ergoqp.simulation.robot.RobotKind`; None: as declared.
        bias_deg: ``JOINT=DEG,...``; None: the sensors of the person.
        follower: kind of the person who follows.
        seek: whether the loop tries places.
        as_seen: whether the controller sees only the joints that the recording shows.
    """

    robot: str | None = None
    bias_deg: str | None = None
    follower: str = "alike"
    seek: bool = False
    as_seen: bool = False

    def check(self) -> None:
        """Check the options, before anything is computed.

        Raises:
            InputError: if a name is unknown, or a value is not a number.
        """
        self.terms(Senses())
        if self.follower not in KINDS:
            raise InputError(
                f"--follower: got {self.follower!r}, allowed one of {', '.join(KINDS)}"
            )

    def terms(self, senses: Senses) -> dict[str, Any]:
        """Return the arguments of `simulate` for a person with such senses."""
        terms: dict[str, Any] = {}
        if self.robot is not None:
            names = [entry.name for entry in fields(RobotKind)]
            terms["robot"] = RobotKind(**_pairs("--robot", self.robot, names))
        if self.bias_deg is not None:
            terms["senses"] = replace(
                senses, bias_deg={**senses.bias_deg, **_pairs("--bias-deg", self.bias_deg, JOINTS)}
            )
        return terms


def _pairs(option: str, text: str, names: Sequence[str]) -> dict[str, float]:
    pairs: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        if name.strip() in pairs:
            raise InputError(f"{option}: got {name.strip()} twice, allowed once")
        if name.strip() not in names:
            near = nearest_first(name.strip(), names)
            known = ", ".join(near) if len(near) < 10 else f"joints such as {near[0]}"
            raise InputError(f"{option}: got {part!r}, allowed NAME=VALUE with a NAME of {known}")
        try:
            pairs[name.strip()] = float(value)
        except ValueError:
            raise InputError(f"{option}: got {part!r}, allowed a number after {name}=") from None
    return pairs


def run(
    problem_name: str,
    recording_path: Path | None,
    at: float | None,
    out: Path | None,
    seed: int,
    duration: float,
    options: RecordingOptions,
    guide: str | None = None,
    simulated: Simulated | None = None,
) -> None:
    """Run the closed loop, print the table, write ``run.json``, ``run.npz`` and ``report.html``.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    problem = load_person_problem(problem_name)
    how = simulated or Simulated()
    how.check()
    check_numbers(problem, duration, seed)
    if how.seek and guide is not None:
        raise InputError("--seek: got it beside --guide, allowed one of the two")
    screen = console()
    if recording_path is None:
        options.refuse_without_recording()
        if at is not None:
            raise InputError(f"--at: got {at:g} s, but there is no recording; name one with --from")
        if how.as_seen:
            raise InputError("--as-seen: got it, but there is no recording; name one with --from")
        places = places_to_try(problem) if how.seek else None
        place = None if guide is None else guide_named(problem, guide)
        folder = make_folder(out, problem.name)
        result = _from_awkward_place(problem, screen, seed, duration, options, place, how, places)
    else:
        with working(f"reading {recording_path.name}"):
            recording = options.load(recording_path)
        frame = frame_of_recording(problem, recording, at)
        which = "the worst-scored frame" if at is None else "frame"
        screen.print(
            Text(
                f"starts at {which}, {frame} of 0 to {len(recording.time) - 1}, at"
                f" {recording.time[frame]:.2f} s:"
                f" {_score(problem, recording.postures[frame])}"
            )
        )
        problem, posture, notes = as_recorded(problem, recording, frame)
        places = places_to_try(problem) if how.seek else None
        place = None if guide is None else guide_named(problem, guide)
        folder = make_folder(out, problem.name)
        result = _from_recording(
            problem,
            recording,
            recording_path.name,
            frame,
            posture,
            notes,
            seed,
            duration,
            place,
            how,
            places,
        )
    with writing(folder):
        result.save(folder)
    print_assumptions(screen, result.assumptions)
    screen.print(run_table(result))
    write_report(screen, folder, ("run.json", "run.npz"), lambda path: write_run_page(result, path))


def _from_awkward_place(
    problem: Problem,
    screen: Console,
    seed: int,
    duration: float,
    options: RecordingOptions,
    guide: Guide | None,
    how: Simulated,
    places: list[Place] | None,
) -> Run:
    body = None if options.person_value is None else given_person(options.person_value)
    with working("looking for an awkward place"):
        person = person_of_kind(how.follower, problem, seed, body)
        place, posture = awkward_place(problem, person, seed)
        terms = how.terms(person.senses)
        start = person.at(place, terms.pop("senses", None), seed)
    screen.print(Text(f"starts at the worst of {PLACES} random places: {_score(problem, posture)}"))
    note = (
        f"The object starts at the worst-scored of {PLACES} random places of the workspace (seed"
        f" {seed})."
    )
    with working(f"closed loop, {duration:g} s") as done:
        return simulate(
            problem,
            start,
            duration,
            seed,
            assumptions=[note],
            progress=done,
            guide=guide,
            seek=places,
            **terms,
        )


def _from_recording(
    problem: Problem,
    recording: Recording,
    name: str,
    frame: int,
    posture: np.ndarray,
    notes: list[str],
    seed: int,
    duration: float,
    place: Guide | None,
    how: Simulated,
    places: list[Place] | None,
) -> Run:
    time = float(recording.time[frame])
    person = person_of_kind(how.follower, problem, seed, recording.person)
    terms = how.terms(person.senses)
    start = person.hold(posture, terms.pop("senses", None), seed)
    start.rest(start.pose)
    taken = np.stack([recording.postures[frame], start.posture])
    scores = problem.assess(taken).final
    if not (how.as_seen or recording.observed[frame].all()):
        notes.append(
            "The controller is assumed to see every joint, also those that the recording does not"
            " determine (without them: --as-seen)."
        )
    notes = [
        *recording.assumptions,
        (
            f"The person takes hold of the object in the posture of frame {frame}, at {time:.2f} s,"
            f" of {name}, which scores {scores[0]}, and comes to rest at {scores[1]}; then the run"
            " begins. They are simulated from the grasp on."
        ),
        *notes,
        (
            "The recording says nothing of the object"
            if recording.object_poses is None
            else "The recording's object is not the problem's"
        )
        + ": it is assumed to be in the hand as the problem states.",
    ]
    with working(f"closed loop, {duration:g} s") as done:
        return simulate(
            problem,
            start,
            duration,
            seed,
            observed=recording.observed[frame] if how.as_seen else None,
            recording=name,
            start_time=time,
            assumptions=notes,
            progress=done,
            guide=place,
            seek=places,
            **terms,
        )


def frame_of_recording(problem: Problem, recording: Recording, at: float | None) -> int:
    """Return the frame nearest to a time, or the worst one, see `Assessment.worst`.

    Raises:
        InputError: if the recording has no such time, or shows no posture.
    """
    if not recording.scored.any():
        causes = ", ".join(recording.not_scored)
        raise InputError(f"--from: no frame of the recording shows a posture ({causes})")
    if at is None:
        return problem.assess(recording.scored_postures).worst(recording.time)
    first, last = float(recording.time[0]), float(recording.time[-1])
    # A time as printed with two digits must be allowed.
    if not (math.isfinite(at) and first - 0.005 <= at <= last + 0.005):
        raise InputError(f"--at: got {at:g} s, allowed {first:.2f} to {last:.2f} s")
    return int(np.argmin(np.abs(recording.time - at)))


def _score(problem: Problem, posture: np.ndarray) -> str:
    assessment = problem.assess(posture)
    return f"REBA {assessment.final[0]}, {ACTION_LEVELS[assessment.band[0]]} risk"
