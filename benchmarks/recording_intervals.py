"""Whether the truth is between the lowest and the highest score of a recording, and how far apart.

Figures of `benchmarks.recordings`, by hand. Parts are taken away from takes in which every scored
joint is seen: those of `TAKES` that are there, and a walk and a stoop that are made. The truth is
what is read of the whole take. The zero of trunk and neck is stated (the vertical), so that only
what is taken away is unknown. Classes:

- ``nothing_lost``; ``plain_skeleton``: no nose and no thumbs; ``forearm_lost``, ``arm_lost``: of
  one side, all the time; ``arm_lost_1s``: for a second; ``legs_lost``, ``head_lost``,
  ``neck_lost``; ``shoulder_lost``: one of the two; ``hips_lost_1s``: with the pelvis, for a second;
- ``markers_lost_10``, ``markers_lost_30``: each marker of a marker take is lost in runs of 0.3 s,
  10 or 30 % of the time.

``interval_holds.CLASS``: share of the frames with the truth inside, each take with the same weight;
``.least``: of the take in which it is least; ``interval_width.CLASS``: mean width [points],
``.p95``; ``.full_range``, of both: had every joint that is lost been anywhere in its range, and
those that are seen known exactly; ``.narrower``: as in `benchmarks.recordings`;
``interval_exact.CLASS``: share of the frames whose best estimate is the truth.
``interval_width.zero_not_stated``: of whole takes whose zero is found by the rules instead.

``share_scored``: smallest share of scored frames of the files that are there, calibration poses
apart, where a trunk is seen at all; ``share_scored.FILE``. ``branches``: frames of them with an arm
below 30 deg of elevation that is read with more than 120 deg of flexion. ``refused_whole``: files
of people that are not read.

``silent_wrong``: frames of walks with the true score outside: people who stoop, skeletons that
lean, carts, T-poses that lean; ``silent_width``: mean width of these; ``silent_wrong.point``: had
the best estimate been all that is said.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.made_markers import markers_of
from benchmarks.made_motions import BODY, RATE, Places, leaning, moved, posture
from benchmarks.report import Report
from ergoqp import reba
from ergoqp.errors import ErgoqpError
from ergoqp.human.body import Marker
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import Recording, fit_postures, load_recording
from ergoqp.mocap.assumptions import axes_to_ours, measured_lengths, suggested_stature
from ergoqp.mocap.fitting.axes import find_unit
from ergoqp.mocap.fitting.posture import THUMB
from ergoqp.mocap.joints import ReadOptions, joints_of
from ergoqp.mocap.load import CALIBRATION
from ergoqp.mocap.markers.fit import places_of_markers
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.readers import read_motion
from ergoqp.sheets.description import elevation_of

SHARED = Path(__file__).resolve().parents[2] / "shared"
TAKES: Final = (
    "bvh/toolbox_freebvh.bvh",
    "c3d/millard_stoop1_t169_f620f800.c3d",
    "c3d/pycgm_Movement_trial.c3d",
    "c3d/pycgm_Sample_Static.c3d",
    "kinect/azure_kinect_body_tracking_part1.csv",
    "mvnx/xsens_kicking_part1.mvnx",
)
"""Recordings in which every scored joint is seen."""
NOBODY: Final = (
    "motive_v121_rigidbodies_markers.csv",
    "motive_v123_empty_no_bodies.csv",
    "c3dorg_pc_real.c3d",
    "6_decimal_commas_and_commas.csv",
    "bmc_walk.trc",
    "2b_sides_exchanged_as_told.csv",
)
"""Files that show nobody, name nobody, or have to be refused."""
FORMATS: Final = (".bvh", ".c3d", ".csv", ".mot", ".mvnx", ".trc")
MORE: Final = {"nose": Marker("head", (0.12, 0.0, 0.0), 0.0)} | {
    f"{side}_{name}": Marker(f"{side}_wrist", offset, 0.0)
    for side, out in zip(SIDES, (-1.0, 1.0), strict=True)
    for name, offset in (
        ("knuckles", (0.0, 0.0, -0.08)),
        ("thumb", (0.05 * np.cos(THUMB), -out * 0.05 * np.sin(THUMB), -0.03)),
    )
}
"""Points of the whole body that are no joint centres."""
ARM: Final = ("elbow", "wrist", "knuckles", "thumb")


@dataclass(frozen=True)
class Take:
    """Joint centres or markers of somebody.

    Attributes:
        name: the take's name.
        places: name -> positions (n, 3) [m], z up.
        rate: frames per second [Hz].
    """

    name: str
    places: Places
    rate: float

    def read(self, places: Places | None = None, neutral: str | None = "vertical") -> Recording:
        """Return what is read of the take, or of the same take with other places."""
        given = self.places if places is None else places
        positions = np.stack(list(given.values()), axis=1)
        return fit_postures(list(given), positions, self.rate, neutral=neutral)


def whole(pelvis: np.ndarray, postures: np.ndarray) -> Places:
    """Return the centres of the made person with nose, knuckles and thumbs (n, 3) [m]."""
    return centres_of(BODY, pelvis, postures) | places_of_markers(BODY, pelvis, postures, MORE)


def takes() -> Iterator[Take]:
    """Return takes of joint centres in which every scored joint is seen."""
    pelvis, postures = moved()
    yield Take("made", whole(pelvis, postures), RATE)
    for name in TAKES:
        path = SHARED / "mocap" / name
        if not path.exists():
            continue
        motion = read_motion(path)
        found = joints_of(motion, path.name, ReadOptions())
        stature = suggested_stature(measured_lengths(found.paths))
        assert stature is not None
        unit = found.unit or find_unit(stature, path.name)
        axes = unit * axes_to_ours(path.name, found.paths, motion.up, [])
        rate = 1 / float(np.median(np.diff(motion.time)))
        yield Take(path.stem, {name: each @ axes.T for name, each in found.paths.items()}, rate)


def marker_takes() -> Iterator[Take]:
    """Return takes of markers."""
    names, positions = markers_of(BODY, *moved())
    yield Take("made", dict(zip(names, np.moveaxis(positions, 1, 0), strict=True)), RATE)
    for name in TAKES:
        path = SHARED / "mocap" / name
        if path.exists() and path.suffix == ".c3d":
            motion = read_motion(path)
            size = joints_of(motion, path.name, ReadOptions())
            assert size.markers
            scale = motion.unit or 0.001
            rate = 1 / float(np.median(np.diff(motion.time)))
            used = [each for each in motion.names if each in size.landmarks]
            places = {each: scale * motion.of(each).astype(float) for each in used}
            yield Take(path.stem, places, rate)


Loss = Callable[[Take, np.random.Generator], Places]


def without(*ends: str, one_side: bool = False, seconds: float | None = None) -> Loss:
    """Return what takes centres away whose names end so, all the time or for some seconds."""

    def loss(take: Take, generator: np.random.Generator) -> Places:
        side = str(generator.choice(SIDES)) if one_side else ""
        count = len(next(iter(take.places.values())))
        rows = slice(None)
        if seconds is not None:
            long = min(max(1, round(seconds * take.rate)), count)
            first = int(generator.integers(0, count - long + 1))
            rows = slice(first, first + long)
        found = dict(take.places)
        for name, path in take.places.items():
            if name.startswith(side) and name.endswith(ends):
                found[name] = path.copy()
                found[name][rows] = np.nan
        return found

    return loss


def in_runs(share: float, seconds: float = 0.3) -> Loss:
    """Return what takes each marker away in runs."""

    def loss(take: Take, generator: np.random.Generator) -> Places:
        found = {}
        for name, path in take.places.items():
            long = max(1, round(seconds * take.rate))
            starts = generator.random(len(path)) < -np.log(1 - share) / long
            gone = np.convolve(starts, np.ones(long))[: len(path)] > 0
            found[name] = np.where(gone[:, None], np.nan, path)
        return found

    return loss


CLASSES: Final[Mapping[str, Loss]] = {
    "nothing_lost": lambda take, _: take.places,
    "plain_skeleton": without("nose", "thumb"),
    "forearm_lost": without("wrist", "knuckles", "thumb", one_side=True),
    "arm_lost_1s": without(*ARM, one_side=True, seconds=1.0),
    "arm_lost": without(*ARM, one_side=True),
    "legs_lost": without("knee", "ankle", "toe"),
    "head_lost": without("head", "head_top", "nose"),
    "neck_lost": without("neck"),
    "shoulder_lost": without("shoulder", one_side=True),
    "hips_lost_1s": without("hip", "pelvis", seconds=1.0),
}
OF_MARKERS: Final[Mapping[str, Loss]] = {
    "markers_lost_10": in_runs(0.1),
    "markers_lost_30": in_runs(0.3),
}


NARROWER: Final = {"_MOST": 0.97, "_PAIRS": 30}
"""Other values by which the ends in gaps are narrower, and hold less."""
LONG: Final = {"arm_lost_1s": 3.0, "hips_lost_1s": 3.0}
"""Takes are longer than this [s]: in a shorter one there is little else than what is lost."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Scores of some frames (n,): true, lowest, best, highest, and both ends of full ranges."""

    truth: np.ndarray
    low: np.ndarray
    best: np.ndarray
    high: np.ndarray
    full_low: np.ndarray
    full_high: np.ndarray

    @property
    def holds(self) -> np.ndarray:
        """Whether the truth is inside (n,)."""
        return (self.low <= self.truth) & (self.truth <= self.high)

    @property
    def full_holds(self) -> np.ndarray:
        """Whether it is inside with full ranges (n,)."""
        return (self.full_low <= self.truth) & (self.truth <= self.full_high)


def _mean(each: list[np.ndarray]) -> float:
    """Return the mean of takes, each with the same weight."""
    return float(np.mean([values.mean() for values in each]))


def intervals(report: Report) -> None:
    """Print whether the intervals hold and how wide they are."""
    draws = report.pick(2, 8)
    for classes, found in ((CLASSES, list(takes())), (OF_MARKERS, list(marker_takes()))):
        truths = [take.read() for take in found]
        for name, loss in classes.items():
            scores = _each(name, loss, found, truths, draws)
            holds = [float(each.holds.mean()) for each in scores]
            widths = [each.high - each.low for each in scores]
            report.figure(f"interval_holds.{name}", float(np.mean(holds)))
            report.figure(f"interval_holds.{name}.least", min(holds), "of a take")
            report.figure(f"interval_width.{name}", _mean(widths))
            if name == "arm_lost_1s":
                with patch.multiple("ergoqp.mocap.fitting.unknown", **NARROWER):
                    other = _each(name, loss, found, truths, draws)
                narrow = _mean([each.high - each.low for each in other])
                report.figure(f"interval_width.{name}.narrower", narrow)
            p95 = float(np.percentile(np.concatenate(widths), 95))
            report.figure(f"interval_width.{name}.p95", p95)
            full = _mean([each.full_high - each.full_low for each in scores])
            report.figure(f"interval_width.{name}.full_range", full)
            full = _mean([each.full_holds for each in scores])
            report.figure(f"interval_holds.{name}.full_range", full)
            report.figure(f"interval_exact.{name}", _mean([e.best == e.truth for e in scores]))
        if classes is CLASSES:
            wide = [_ends(take.read(neutral=None)) for take in found]
            width = np.concatenate([high - low for low, _, high in wide])
            report.figure("interval_width.zero_not_stated", float(width.mean()))


def _each(
    name: str, loss: Loss, found: list[Take], truths: list[Recording], draws: int
) -> list[Judged]:
    """Return the scores of all takes from which something is taken away."""
    scores = [
        _judged(take, truth, loss(take, np.random.default_rng([7000, k])))
        for take, truth in zip(found, truths, strict=True)
        if len(truth.time) > LONG.get(name, 0.0) * take.rate
        for k in range(1 if name in ("nothing_lost", "plain_skeleton") else draws)
    ]
    return [each for each in scores if each.truth.size]


def _ends(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return lowest, best and highest score of the scored frames."""
    found = reba.assess(recording.postures, low=recording.low, high=recording.high)
    here = recording.scored
    return found.final_low[here], found.final[here], found.final_high[here]


def _judged(take: Take, truth: Recording, places: Places) -> Judged:
    """Return the scores of a take from which something is taken away.

    Frames in which the whole take itself is not known are left out, and those of a loss for some
    time in which nothing is lost.
    """
    found, right = take.read(places), reba.assess(truth.postures, low=truth.low, high=truth.high)
    lost = np.zeros(len(found.time), dtype=bool)
    for name, path in places.items():
        lost |= np.isnan(path[:, 0]) & np.isfinite(take.places[name][:, 0])
    here = truth.scored & found.scored & (right.final_low == right.final_high)
    here &= lost if lost.any() else True
    assessed = reba.assess(found.postures, low=found.low, high=found.high)
    hidden = np.where(found.observed, found.postures, np.nan)
    full = reba.assess(found.postures, low=hidden, high=hidden)
    return Judged(
        right.final[here],
        assessed.final_low[here],
        assessed.final[here],
        assessed.final_high[here],
        full.final_low[here],
        full.final_high[here],
    )


def files(report: Report) -> None:
    """Print which files are read, and which share of their frames is scored."""
    shares, wrong_ways, refused = [], 0, 0
    paths = sorted(p for p in (SHARED / "mocap").rglob("*") if p.suffix in FORMATS)
    paths = [p for p in paths if p.parent.name != "kth_handover_giver"]
    paths += sorted(p for p in (SHARED / "recording_faults").glob("*") if p.suffix in FORMATS)
    for path in paths:
        if path.name in NOBODY:
            continue
        try:
            recording = load_recording(path)
        except ErgoqpError as error:
            refused += 1
            report.say(f"{path.name}: refused: {error}")
            continue
        work = ~recording.not_scored.get(CALIBRATION, np.zeros(len(recording.time), dtype=bool))
        if recording.observed[:, INDEX["trunk_flexion"]].any():
            shares.append(float(recording.scored[work].mean()))
            report.figure(f"share_scored.{path.name}", shares[-1], quiet=True)
        flexion = recording.postures[:, [INDEX[f"{side}_shoulder_flexion"] for side in SIDES]]
        low = np.degrees(elevation_of(recording.postures)[0]) < 30
        wrong_ways += int((low & (np.abs(np.degrees(flexion)) > 120)).sum())
    if paths:
        report.figure("share_scored", min(shares), f"the smallest of {len(shares)}")
        report.figure("branches", wrong_ways)
        report.figure("refused_whole", refused, f"of {len(paths)}")


def walking(
    stoops: float = 0.0, neck: float = 0.0, pushes: bool = False
) -> tuple[Places, np.ndarray]:
    """Somebody who walks stooped by some degrees, and perhaps pushes a cart: centres, postures."""
    time = np.arange(int(6 * RATE)) / RATE
    phase = 2 * np.pi * 0.9 * time
    elbow, arm = (70.0, 30.0) if pushes else (25.0, 0.8 * stoops)
    postures = posture(
        len(time),
        trunk_flexion=stoops,
        neck_flexion=neck,
        arms_elbow_flexion=elbow,
        arms_shoulder_flexion=arm,
    )
    for side, turn in zip(SIDES, (0.0, np.pi), strict=True):
        swing, bend = np.sin(phase + turn), np.maximum(np.cos(phase + turn), 0)
        postures[:, INDEX[f"{side}_hip_flexion"]] = np.radians(8 + 22 * swing + 15 * bend)
        postures[:, INDEX[f"{side}_knee_flexion"]] = np.radians(8 + 50 * bend)
        if not pushes:
            postures[:, INDEX[f"{side}_shoulder_flexion"]] += np.radians(-15 * swing)
    way = np.column_stack([1.2 * time, 0 * time, np.full(len(time), 0.88), 0 * time])
    return whole(way, postures), postures


def with_t_pose(places: Places, postures: np.ndarray, leans: float) -> tuple[Places, np.ndarray]:
    """The same after a second of a T-pose in which the person leans by some degrees."""
    posed = posture(int(RATE), trunk_flexion=leans, arms_shoulder_abduction=90.0)
    still = whole(np.tile([0.0, 0.0, 0.88, 0.0], (len(posed), 1)), posed)
    both = {name: np.concatenate([still[name], path]) for name, path in places.items()}
    return both, np.concatenate([posed, postures])


def people_who_walk() -> Iterator[tuple[str, Places, np.ndarray]]:
    """Return name, centres and true postures of walks whose lean nothing confirms."""
    for stoops in (10.0, 15.0, 25.0, 30.0, 40.0, 60.0):
        for neck in (0.0, -min(stoops / 2, 20.0)):
            yield f"stoops {stoops:g}, neck {neck:g}", *walking(stoops, neck)
    for stoops in (10.0, 20.0, 30.0):
        yield f"pushes a cart, {stoops:g}", *walking(stoops, pushes=True)
    upright, postures = walking()
    for lean in (5.0, 10.0, 15.0, 20.0, -5.0, -10.0, -15.0, -20.0):
        yield f"skeleton leans {lean:g}", leaning(upright, lean), postures
    for lean in (-13.5, -8.0, 8.0):
        yield f"T-pose leans {lean:g}", *with_t_pose(upright, postures, lean)
    places, both = with_t_pose(upright, postures, -6.0)
    yield "T-pose leans -6, skeleton -7.5", leaning(places, -7.5), both


def silent(report: Report) -> None:
    """Print the walks of which the truth is outside."""
    wrong, point, widths = 0, 0, []
    for name, places, postures in people_who_walk():
        positions = np.stack(list(places.values()), axis=1)
        recording = fit_postures(list(places), positions, RATE)
        truth = reba.assess(postures).final[recording.scored]
        low, best, high = _ends(recording)
        out = int(((truth < low) | (truth > high)).sum())
        wrong, point = wrong + out, point + int((best != truth).sum())
        widths.append(float((high - low).mean()))
        if out:
            report.say(f"{name}: the truth is outside in {out} frames")
    report.figure("silent_wrong", wrong)
    report.figure("silent_wrong.point", point)
    report.figure("silent_width", float(np.mean(widths)), f"mean of {len(widths)} walks")


def measure_intervals(report: Report) -> None:
    """Print every figure of this file."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        silent(report)
        intervals(report)
        files(report)
