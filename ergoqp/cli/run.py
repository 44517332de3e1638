"""``ergoqp run``: the closed loop of a problem with a simulated person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from rich.console import Console
from rich.text import Text

from ergoqp.arguments import check_word
from ergoqp.cli.common import (
    console,
    load_person_problem,
    make_folder,
    print_assumptions,
    score_words,
    working,
    write_report,
    writing,
)
from ergoqp.cli.options import At, ProblemName, RecordingOptions, grouped, option, out_option
from ergoqp.cli.options import Guide as GuideName
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.lab.yardstick import rule_pose
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.messages import nearest_first
from ergoqp.problem.problem import Problem
from ergoqp.report.run_page import write_run_page
from ergoqp.report.tables import run_table
from ergoqp.rest.best_place import PLACES, awkward_place
from ergoqp.rest.model_person import person_of
from ergoqp.rest.person_protocol import Holding, SensorModel
from ergoqp.seeking.next_place import Place
from ergoqp.simulation.loop import check_numbers
from ergoqp.simulation.people import kinds, person_of_kind
from ergoqp.simulation.robot import RobotKind
from ergoqp.simulation.simulate import simulate
from ergoqp.step.guide import Guide, read_guide

if TYPE_CHECKING:
    from ergoqp.mocap import Recording

ABOUT = """Run the closed loop of a problem with a simulated person who follows the object.

Prints a table and writes report.html, run.json and run.npz.

\b
Examples:
  ergoqp run screwing                                at an awkward place, drawn with the seed
  ergoqp run screwing --from take.bvh                at the worst-scored frame of a recording
  ergoqp run my_task.toml --from take.bvh --at 3.2   your own problem, at 3.2 s
  ergoqp run overhead --guide best                   with the best place as a guide
  ergoqp run screwing --seek --duration 60           tries places, ends at the best one
  ergoqp run screwing --follower looking             with a person who watches the work
  ergoqp run screwing --robot lag=0.1                with an undeclared lag of the robot
  ergoqp run screwing --bias-deg right_knee_flexion=-4   with a wrong knee angle
"""


@dataclass(frozen=True)
class Simulated:
    """Robot, sensors and person of the simulation."""

    seek: Annotated[
        bool,
        option(
            None,
            "Try several places and end at the one with the lowest measured score; takes up to"
            " 60 s.",
            "--seek",
        ),
    ] = False
    robot: Annotated[
        str | None,
        option(
            "NAME=VALUE,...",
            "Errors of the simulated robot, such as lag=0.1,gain=1.02 [as declared].",
        ),
    ] = None
    bias_deg: Annotated[
        str | None,
        option(
            "JOINT=DEG,...",
            "Constant errors of measured angles, such as right_knee_flexion=5 [none].",
        ),
    ] = None
    as_seen: Annotated[
        bool,
        option(
            None, "The controller sees only the joints that the recording determines.", "--as-seen"
        ),
    ] = False
    follower: Annotated[
        str,
        option(
            "KIND",
            "Kind of person: alike (like the controller's model), follower, dead_zone,"
            " stubborn, stepping, pushed, looking, trembling or mass.",
        ),
    ] = "alike"

    def check(self) -> None:
        """Check the options, before anything is computed.

        Raises:
            InputError: if a name is unknown, or a value is not a number.
        """
        self.robot_kind()
        self.senses(SensorModel())
        check_word("--follower", self.follower, kinds())

    def robot_kind(self) -> RobotKind | None:
        """Return the robot that is asked for; None: as declared."""
        if self.robot is None:
            return None
        names = [entry.name for entry in fields(RobotKind)]
        return RobotKind(**_pairs("--robot", self.robot, names))

    def senses(self, own: SensorModel) -> SensorModel:
        """Return a person's sensors with the constant errors that are asked for."""
        if self.bias_deg is None:
            return own
        errors = _pairs("--bias-deg", self.bias_deg, JOINTS)
        return replace(own, bias_deg={**own.bias_deg, **errors})


@grouped(read=RecordingOptions, simulated=Simulated)
def command(
    name: ProblemName,
    recording: Annotated[
        Path | None,
        option("RECORDING", "Start in a posture of a recording, with its person's body.", "--from"),
    ] = None,
    at: At = None,
    out: Annotated[Path | None, out_option("PROBLEM")] = None,
    seed: Annotated[int, option("N", "Seed of the person, the noise and the start.")] = 0,
    duration: Annotated[float, option("SECONDS", "Duration of the run.")] = 20.0,
    *,
    read: RecordingOptions,
    guide: GuideName = None,
    simulated: Simulated,
) -> None:
    """Run the closed loop, print the table, write ``run.json``, ``run.npz`` and ``report.html``.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    problem = load_person_problem(name)
    simulated.check()
    check_numbers(problem, duration, seed)
    if simulated.seek and guide is not None:
        raise InputError("--seek: got it beside --guide, allowed one of the two")
    screen = console()
    if recording is None:
        read.refuse_without_recording(at)
        if simulated.as_seen:
            raise InputError("--as-seen: got it, but there is no recording; name one with --from")
        begin = partial(_at_awkward_place, problem, screen, seed, read.body, simulated)
    else:
        with working(f"reading {recording.name}"):
            taken = read.load(recording)
        frame = frame_of_recording(problem, taken, at)
        which = "the worst-scored frame" if at is None else "frame"
        screen.print(
            Text(
                f"starts at {which}, {frame} of 0 to {len(taken.time) - 1}, at"
                f" {taken.time[frame]:.2f} s: REBA {score_words(problem, taken.postures[frame])}"
            )
        )
        from ergoqp.mocap.recorded import as_recorded  # slow to import, and needed by few runs

        problem, posture, notes = as_recorded(problem, taken, frame)
        begin = partial(
            _as_recorded, problem, taken, recording.name, frame, posture, notes, seed, simulated
        )
    places = places_to_try(problem) if simulated.seek else None
    place = None if guide is None else guide_named(problem, guide)
    folder = make_folder(out, problem.name)
    start, terms = begin()
    with working(f"closed loop, {duration:g} s") as done:
        result = simulate(
            problem,
            start,
            duration,
            seed,
            progress=done,
            guide=place,
            seek=places,
            robot=simulated.robot_kind(),
            **terms,
        )
    with writing(folder):
        result.save(folder)
    print_assumptions(screen, result.assumptions)
    screen.print(run_table(result))
    write_report(screen, folder, ("run.json", "run.npz"), lambda path: write_run_page(result, path))


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


def _at_awkward_place(
    problem: Problem, screen: Console, seed: int, body: Body | None, how: Simulated
) -> tuple[Holding, dict[str, Any]]:
    """Return the person at an awkward place, and terms of `simulate`."""
    with working("looking for an awkward place"):
        person = person_of_kind(how.follower, problem, seed, body)
        place, posture = awkward_place(problem, person, seed)
        start = person.at(place, how.senses(person.senses), seed)
    words = f"starts at the worst of {PLACES} random places: REBA {score_words(problem, posture)}"
    screen.print(Text(words))
    note = (
        f"The object starts at the worst-scored of {PLACES} random places of the workspace (seed"
        f" {seed})."
    )
    return start, {"assumptions": [note]}


def _as_recorded(
    problem: Problem,
    recording: Recording,
    name: str,
    frame: int,
    posture: np.ndarray,
    notes: list[str],
    seed: int,
    how: Simulated,
) -> tuple[Holding, dict[str, Any]]:
    """Return the person of a recording, and terms of `simulate`."""
    time = float(recording.time[frame])
    person = person_of_kind(how.follower, problem, seed, recording.person)
    start = person.hold(posture, how.senses(person.senses), seed)
    start.rest(start.pose)
    taken = np.stack([recording.postures[frame], start.posture])
    scores = problem.assess(taken).final
    if not (how.as_seen or recording.observed[frame].all()):
        notes.append(
            "The controller is assumed to see every joint, also those that the recording does not"
            " determine (without them: --as-seen)."
        )
    unknown = "The recording's object is not the problem's"
    if recording.object_poses is None:
        unknown = "The recording says nothing of the object"
    notes = [
        *recording.assumptions,
        (
            f"The person takes hold of the object in the posture of frame {frame}, at {time:.2f} s,"
            f" of {name}, which scores {scores[0]}, and comes to rest at {scores[1]}; then the run"
            " begins. They are simulated from the grasp on."
        ),
        *notes,
        f"{unknown}: it is assumed to be in the hand as the problem states.",
    ]
    terms = {"recording": name, "start_time": time, "assumptions": notes}
    return start, terms | {"observed": recording.observed[frame] if how.as_seen else None}


def frame_of_recording(problem: Problem, recording: Recording, at: float | None) -> int:
    """Return the frame nearest to a time, or the worst one, see `Assessment.worst`.

    Raises:
        InputError: if the recording has no such time, or shows no posture.
    """
    if not recording.scored.any():
        causes = ", ".join(recording.not_scored)
        raise InputError(f"--from: no frame of the recording shows a posture ({causes})")
    if at is None:
        # A limb that is not seen for a while is no posture to begin in.
        shown = np.where(recording.whole[:, None], recording.postures, np.nan)
        return problem.assess(shown).worst(recording.time)
    first, last = float(recording.time[0]), float(recording.time[-1])
    # A time as printed with two digits must be allowed.
    if not (math.isfinite(at) and first - 0.005 <= at <= last + 0.005):
        raise InputError(f"--at: got {at:g} s, allowed {first:.2f} to {last:.2f} s")
    return int(np.argmin(np.abs(recording.time - at)))


def places_to_try(problem: Problem) -> list[Place]:
    """Return the places that ``--seek`` tries after descent: the model's best, and the rule's."""
    with working("looking for the model's best place") as done:
        best = optimise(problem, person_of(problem).comfort, progress=done)
    rule = rule_pose(problem, person_of(problem).body)
    return [Place("the model's best", best.pose), Place("elbow height, 0.40 m ahead", rule)]


def guide_named(problem: Problem, name: str) -> Guide:
    """Return the place that ``--guide`` names.

    Args:
        problem: the task.
        name: ``best``: the place is searched for the controller's model of the person; else
            the path of an ``optimum.json``.

    Raises:
        InputError: if the file does not exist, it is of another problem, or the place cannot
            be used.
    """
    if name == "best":
        with working("looking for the best place") as done:
            return read_guide(problem, optimise(problem, person_of(problem).comfort, progress=done))
    path, remedy = Path(name), "give best or an optimum.json of `ergoqp optimise`"
    if not path.exists():
        raise InputError(f"--guide: {name!r}: no such file; {remedy}")
    try:
        found = Optimum.load(path)
    except InputError:
        raise InputError(f"--guide: {name!r} cannot be read as an optimum; {remedy}") from None
    return read_guide(problem, found)
