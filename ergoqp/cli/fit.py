"""``ergoqp fit``: learn a cost, a boundary or a response from data, test it, and save it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ergoqp.arguments import LARGEST_SEED, check_whole, part_of
from ergoqp.cli.common import (
    console,
    counted,
    load_person_problem,
    make_folder,
    print_assumptions,
    working,
    writing,
)
from ergoqp.cli.options import RecordingOptions, argument, grouped, option, out_option
from ergoqp.coordinates import REPORT_JOINTS, SCORED_JOINTS
from ergoqp.costs.cost import LearnedCost
from ergoqp.costs.gmr import Gmr
from ergoqp.costs.load import KINDS, Quality, cross_validate, evaluation_time, quality_of
from ergoqp.datasets.data import DataSet, read_data
from ergoqp.datasets.postures import MOST_PER_SCORE, posture_data
from ergoqp.errors import ErgoqpError, InputError, MissingExtraError
from ergoqp.files.read import read_json, read_npz
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.learning.one_class import OneClass
from ergoqp.mocap import Recording
from ergoqp.mocap.recorded import held_poses, seat_above_feet
from ergoqp.report.charts.over_time import prediction_picture
from ergoqp.report.tables import table_of
from ergoqp.responses.gmr import GmrResponse
from ergoqp.responses.ik import IkResponse

ABOUT = """Learn a cost from labelled postures, test it on unseen ones, and keep it.

Prints a table and writes COST.npz (for [cost.learned] in a problem file, or ergoqp.load_cost) and
COST.png. With response it learns how the posture follows the object of a recording.

\b
Examples:
  ergoqp fit svr                                     10 000 random postures, scored by the sheet
  ergoqp fit gmr --set components=30 --folds 3
  ergoqp fit svr --data forearm                      elbow and wrist of the right arm
  ergoqp fit quadratic --data my_postures.csv        columns trunk_flexion_deg ..., score
  ergoqp fit boundary --joints scored                for [limits.one_class_boundary]
  ergoqp fit response take.bvh --problem screwing    for [response.gmr]; or a folder of ergoqp run
"""

FITTED: Final = tuple(kind for kind in KINDS if kind != "sklearn")
"""Kinds of costs that the command can fit. `from_sklearn` is for estimators fitted elsewhere."""

DATA: Final = ("sheet", "interval", "forearm")
"""Data sets that the command creates itself."""

_OWN: Final = ("quadratic", "neural")
"""Kinds with a fit that is part of the package and needs nothing else."""

_GIVEN: Final = (
    *("data", "cls", "progress", "points", "coordinates"),
    *("postures", "poses", "cost", "person"),
)
"""What the command gives to a fit itself."""


Joints = StrEnum("Joints", {"report": "report", "scored": "scored"})
"""The joints of drawn postures."""

Kind = StrEnum("Kind", {"gmr": "gmr"})
"""The kinds of learned responses."""


@dataclass(frozen=True)
class Response:
    """What only a response needs."""

    kind: Annotated[Kind, option(None, "response: kind of the model.")] = Kind.gmr
    problem: Annotated[
        str, option("NAME|FILE", "response: the task, with its hands, tool and stance.")
    ] = "screwing"
    by_hand: Annotated[
        bool, option(None, "response: the hand stands for the object.", "--by-hand")
    ] = False


@grouped(response=Response, read=RecordingOptions)
def command(
    cost: Annotated[
        str,
        argument("COST", "quadratic, gmr, svr, one_class_ladder, neural; boundary; or response."),
    ],
    recording: Annotated[
        Path | None,
        typer.Argument(
            metavar="RECORDING",
            help="response: a recording of a person who holds an object, or the folder of a run.",
            show_default=False,
        ),
    ] = None,
    data: Annotated[
        str, option("NAME|FILE", "sheet, interval, forearm, or a CSV file of your own.")
    ] = "sheet",
    joints: Annotated[
        Joints,
        option(None, "The 20 joints of the EPFL report, or all 22 that the sheet reads."),
    ] = Joints.report,
    per_score: Annotated[int, option("N", "Postures of each score, where data are drawn.")] = 1000,
    seed: Annotated[int, option("N", "Seed of data, folds and fit.")] = 0,
    folds: Annotated[int, option("N", "Folds of the cross-validation.")] = 5,
    settings: Annotated[
        list[str] | None,
        option("NAME=VALUE", "An option of the cost's own fit; may be repeated.", "--set"),
    ] = None,
    out: Annotated[Path | None, out_option("fit-COST")] = None,
    *,
    response: Response,
    read: RecordingOptions,
) -> None:
    """Fit a cost, a boundary or a response.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    of_recording = recording, response, read
    if cost == "response":
        if recording is None or not recording.exists():
            got = "none" if recording is None else f"{recording}: no such file"
            raise InputError(f"recording: got {got}, allowed a recording or the folder of a run")
        if data == "forearm":
            raise InputError("--data: got 'forearm', allowed postures: sheet, interval or a file")
        check_extra("sklearn")
        make, learn = GmrResponse.fit, partial(fit_response, recording, response, read)
    elif of_recording != (None, Response(), RecordingOptions()):
        raise InputError(
            f"cost: got {cost!r} and a recording or how to read it, allowed 'response'"
        )
    elif cost == "boundary":
        check_extra("sklearn")
        make, learn = OneClass.fit, fit_boundary
    elif cost in FITTED:
        own = cost in _OWN and data != "forearm"
        check_extra(*(() if own else ("sklearn",)), "matplotlib")
        module, name = KINDS[cost].split(":")
        make = getattr(import_module(module), name).fit
        learn = partial(fit, cost, make)
    else:
        raise InputError(f"cost: got {cost!r}, allowed {', '.join(FITTED)}, boundary or response")
    options = read_settings(make, settings or [])
    with working("data") as done:
        points = load_data(data, joints.value, per_score, seed, folds, done)
    screen = console()
    screen.print(
        Text(f"{len(points)} points of {len(points.coordinates)} coordinates: {points.source}")
    )
    learn(points, options, seed, folds, screen, make_out=partial(make_folder, out, f"fit-{cost}"))


def fit(
    kind: str,
    make: Callable[..., LearnedCost],
    data: DataSet,
    options: dict[str, Any],
    seed: int,
    folds: int,
    screen: Console,
    make_out: Callable[[], Path],
) -> None:
    """Fit a cost, print one table, and write the model and a picture.

    Args:
        kind: kind of cost, one of `FITTED`.
        make: its fit.
        data: labelled points.
        options: options of the fit.
        seed: seed of folds and fit.
        folds: number of folds of the cross-validation.
        screen: console for the table.
        make_out: returns the folder of the results.
    """
    takes = inspect.signature(make).parameters

    def fit_one(part: DataSet, progress: Callable[[float], None]) -> LearnedCost:
        ours = {"seed": seed, "progress": progress}
        return make(part, **{name: ours[name] for name in ours if name in takes} | options)

    with working(f"cross-validation, {folds} folds") as done:
        number = count()

        def fit_fold(part: DataSet) -> LearnedCost:
            begun = next(number)
            return fit_one(part, part_of(done, begun / folds, (begun + 1) / folds))

        values, found = cross_validate(fit_fold, data, folds, seed, done)
    with working(f"fitting {kind} to all points") as done:
        cost = fit_one(data, done)
    unseen = quality_of(values, data.labels)
    folder = make_out()
    model, picture = folder / f"{kind}.npz", folder / f"{kind}.png"
    with writing(folder):
        prediction_picture(values, data.labels, f"{kind}: predictions of unseen points", picture)
    notes = {
        "data": data.source,
        "points": len(data),
        "folds": folds,
        "seed": seed,
        "unseen": unseen.as_dict(),
    }
    cost.save(model, notes)
    medians = np.full(len(data), np.median(data.labels))
    rows = {
        "points it was fitted to": quality_of(cost.predict(data.points), data.labels),
        "unseen points": unseen,
        "always the median score": quality_of(medians, data.labels),
    }
    screen.print(_table(kind, rows, float(np.std([fold.mae for fold in found]))))
    time = evaluation_time(cost.value_and_gradient, cost.coordinates.spread(data.points[:200]))
    screen.print(
        Text(f"value and gradient {time:.0f} µs, model {model.stat().st_size / 1e3:.0f} kB")
    )
    for path in (model, picture):
        screen.print(Text(f"{path.name:<24} {path}"), soft_wrap=True)


def check_extra(*modules: str) -> None:
    """Raise an error at once, not after minutes of work, if the extra ``learn`` is missing.

    Args:
        modules: modules that are needed.

    Raises:
        MissingExtraError: if one is not installed.
    """
    for module in modules:
        try:
            import_module(module)
        except ImportError:
            raise MissingExtraError("ergoqp fit", "learn", module) from None


def load_data(
    source: str,
    joints: str,
    per_score: int,
    seed: int,
    folds: int,
    progress: Callable[[float], None],
) -> DataSet:
    """Return the data set of a name or a file.

    Raises:
        ErgoqpError: if there is none, or an option cannot be used.
    """
    check_whole("--per-score", per_score, 1, MOST_PER_SCORE)
    check_whole("--folds", folds, 2)
    check_whole("--seed", seed, 0, LARGEST_SEED)
    if joints == "scored" and source != "sheet":
        raise InputError(
            f"--joints: got 'scored' with the data {source!r}, allowed only with 'sheet'"
        )
    if source in ("sheet", "interval"):
        names = SCORED_JOINTS if joints == "scored" else REPORT_JOINTS
        return posture_data(per_score, labels=source, seed=seed, joints=names, progress=progress)
    if source == "forearm":
        from ergoqp.lab.forearm import forearm_data

        return forearm_data(per_score=per_score, seed=seed, progress=progress)
    if not Path(source).suffix:
        raise InputError(
            f"--data: got {source!r}, allowed {', '.join(DATA)} or the path of a CSV file"
        )
    return read_data(source)


def read_settings(make: Callable[..., Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return the options of a fit from texts ``name=value``.

    Raises:
        InputError: if the fit has no such option, or a text is not ``NAME=VALUE``.
    """
    allowed = [name for name in inspect.signature(make).parameters if name not in _GIVEN]
    options: dict[str, Any] = {}
    for text in settings:
        name, equals, value = text.partition("=")
        name = name.strip().replace("-", "_")
        if not equals or name not in allowed:
            raise InputError(
                f"--set: got {text!r}, allowed NAME=VALUE with a name of {', '.join(allowed)}"
            )
        try:
            options[name] = ast.literal_eval(value)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            options[name] = value
    return options


def _table(kind: str, found: Mapping[str, Quality], spread: float) -> Table:
    rows = []
    for name, each in found.items():
        error = f"{each.mae:.3f}" + (f" ± {spread:.3f}" if name == "unseen points" else "")
        shares = (f"{each.exact:.1%}", f"{each.within1:.1%}")
        rows.append((name, error, *shares, f"{each.spearman:.3f}", f"{each.worst:.2f}"))
    title = f"{kind}: predicted score against the label"
    head = ("mean error, points", "exact", "within 1", "rank correlation", "worst, points")
    return table_of(title, ("", *head), rows, framed=True)


def fit_boundary(
    data: DataSet,
    options: dict[str, Any],
    seed: int,
    folds: int,
    screen: Console,
    make_out: Callable[[], Path],
) -> None:
    """Fit a one-class SVM, print how many unseen points are inside, and write the model.

    Args:
        data: points; their labels do not matter.
        options: options of `OneClass.fit`.
        seed: seed of the folds.
        folds: number of folds of the cross-validation, at least 2.
        screen: console for the table.
        make_out: returns the folder of the results.
    """
    fold = np.random.default_rng(seed).permutation(len(data)) % folds
    inside = []
    with working(f"cross-validation, {folds} folds") as done:
        for number in range(folds):
            model = OneClass.fit(data.points[fold != number], data.coordinates, **options)
            inside.append(float((model.margin(data.points[fold == number]) >= 0).mean()))
            done((number + 1) / folds)
    model = OneClass.fit(data.points, data.coordinates, **options)
    rows = [
        ("points it was fitted to", f"{(model.margin(data.points) >= 0).mean():.1%}"),
        ("unseen points", f"{np.mean(inside):.1%} ± {np.std(inside):.1%}"),
    ]
    path = make_out() / "boundary.npz"
    model.save(path)
    screen.print(table_of("boundary: points inside", ("", "inside"), rows, framed=True))
    screen.print(Text(f"{len(model.weights)} kernels, {path.stat().st_size / 1e3:.0f} kB"))
    screen.print(Text(f"{path.name:<24} {path}"), soft_wrap=True)


def fit_response(
    path: Path,
    asked: Response,
    read: RecordingOptions,
    data: DataSet,
    options: dict[str, Any],
    seed: int,
    folds: int,
    screen: Console,
    make_out: Callable[[], Path],
) -> None:
    """Fit a response, print how well it knows the last part of the time, and write the model.

    Args:
        path: the recording, or the folder of a run.
        asked: what only a response needs.
        read: how to read the recording.
        data: labelled points for the first model, V(q).
        options: options of `GmrResponse.fit`.
        seed: seed of both models.
        folds: the last part of the time is one of so many.
        screen: console for the table.
        make_out: returns the folder of the results.

    Raises:
        ErgoqpError: if there is no recording, or none that shows how the posture follows an object.
    """
    person = load_person_problem(asked.problem).response
    if not isinstance(person, IkResponse):
        raise InputError(f"--problem: got {asked.problem!r}, allowed one with [response.ik]")
    with working("recording") as done:
        recording = recorded_run(path) if path.is_dir() else read.load(path, done)
    above = seat_above_feet(recording, int(np.argmax(recording.scored)))
    stance = "standing" if above is None else "seated"
    person = replace(person, body=recording.person, stance=stance, seat_height=above)
    postures, poses = held_poses(recording, person, asked.by_hand)
    with working("first model, V(q)"):
        cost = Gmr.fit(data, seed=seed)
    begin = len(postures) * (folds - 1) // folds
    learn = partial(GmrResponse.fit, **{"cost": cost, "person": person, "seed": seed, **options})
    with working("second model") as done:
        model = learn(postures, poses, progress=done)
    path = make_out() / "response.npz"
    model.save(path)
    try:
        with working(f"the same without the last of {folds} parts of the time") as done:
            part = learn(postures[:begin], poses[:begin], progress=done)
    except InputError as error:
        screen.print(Text(f"Too little is left without the last of {folds} parts: {error}"))
    else:
        joints = [JOINTS.index(name) for name in part.joints]
        x = part.x_r(poses[begin:])
        rows = []
        for name, guess in (
            ("second model", part.regression.mean(x)[:, :-1]),
            ("always the mean posture", postures[:begin, joints].mean(axis=0)),
        ):
            error = np.sqrt(np.mean((postures[begin:, joints] - guess) ** 2))
            rows.append((name, f"{np.degrees(error):.1f}"))
        title = f"response: the last of {folds} parts of the time, unseen"
        screen.print(table_of(title, ("", "error of an angle, deg"), rows, framed=True))
    gaussians = counted(len(model.mixture.weights), "Gaussian", "Gaussians")
    frames = f"{len(postures)} of {len(recording.time)} frames"
    found = f"{frames}, {len(model.joints)} joints, {gaussians}"
    screen.print(Text(f"{found}, {path.stat().st_size / 1e3:.0f} kB"))
    screen.print(Text(f"{path.name:<24} {path}"), soft_wrap=True)
    print_assumptions(screen, recording.assumptions)


def recorded_run(folder: Path) -> Recording:
    """Return the postures and poses of a run that was saved in a folder, as a recording.

    Raises:
        InputError: if no run was saved there.
    """
    try:
        names = ("time", "postures", "base_poses", "poses")
        arrays = read_npz(folder / "run.npz", names)
        body = read_json(folder / "run.json", "run")["person"]
        person = Body(body["stature_m"], body["lengths_m"], body["mass_kg"])
    except (ErgoqpError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"recording: got the folder {folder}, allowed one that a run was saved in ({error})"
        ) from None
    time, postures, base, poses = (arrays[name] for name in names)
    seen = np.ones(postures.shape, dtype=bool)
    return Recording(time, postures, base, seen, np.zeros(len(time)), poses, (), person)
