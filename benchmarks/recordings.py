"""Angles that are read from recordings, against plain geometry and against the truth.

Run ``python -m benchmarks.recordings [--quick | --full] [--json FILE]``. The reference recordings
are looked for in ``../shared/mocap/bvh``; without them only what the project makes is measured.

``geometry.FILE.ANGLE_rms_deg``: the angle that is read, against the one between the file's own
joint centres, RMS over frames and sides: ``trunk`` (from the vertical), ``elbow``, ``knee``,
``elevation`` (of the upper arm from the trunk). ``.constant``: had the median been said of every
frame. ``geometry.FILE.ANGLE_max_deg``: largest, of the frames in which all is seen.
``geometry.FILE.marked``: share of the frames of which a part cannot be right.
``geometry.FILE.trunk_score_off``: mean trunk score less that of the plain forward lean.

``made.MOVEMENT.elevation_rms_deg``: shoulders of our own person through every branch, elbows bent
by 3, 30 and 90 deg, centres with 3 mm of noise. ``made.wrong_branches``: frames in which flexion is
more than 90 deg off, and the arm not within 3 deg of straight sideways.
``made.upright_score.LEAN``: mean trunk score of upright walking by a skeleton that leans
(``.vertical``: had the trunk been measured to the vertical). ``made.stoop_off_deg``: how far the
deepest trunk angles of stoops are from what they are.

``run_from_worse``: runs of ``ergoqp run screwing --from``, three seeds each, from postures of the
screwing recording and ten of others (``--quick``: two and one seed), that end with a higher score
than had the object been left alone; ``.share_better``: that end with a lower one;
``.as_seen``: worse, where the controller sees no joint that the recording does not tell;
``.as_given``: worse, had the recorded posture, feet and all, been the start of the same person in
the problem as it is.

``wrong_outcomes``: recordings broken in some way (`benchmarks.recording_outcomes`; three seeds each
with ``--full``) of which a frame is scored with the truth more than 12 deg outside the ends of an
angle, or that are not refused with the right sentence, or refused without need;
``.without_ends``: had the likeliest angles been all that is said; ``.of_noise``: of these
recordings, those with noise on every coordinate, which is not in the ends; ``.narrower`` (in the
full run): with ends of 97 % of the movements, measured from 30, in place of 99 % from 100.

``centres_per_s``: frames per second and core, from joint centres to postures, fit error and what is
not scored; ``.read``: from a BVH file on. Nothing is compiled for a person.

``interval_``, ``silent_``, ``share_scored``, ``branches``, ``refused_whole``: see
`benchmarks.recording_intervals`.

``reference.``, ``marker_fit_mm.`` and ``markers_per_s``: see `benchmarks.recording_references`.
``told.``: see `benchmarks.recording_told`.
"""

from __future__ import annotations

import tempfile
import time
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.made_motions import (
    BODY,
    SHOULDERS,
    Places,
    fitted,
    leaning,
    read_angles,
    shoulders,
    stoop,
    walk,
)
from benchmarks.recording_intervals import NARROWER, measure_intervals
from benchmarks.recording_outcomes import broken_files, cases, seen, silent_file, unseen_number
from benchmarks.recording_references import measure_references
from benchmarks.report import Report, run
from ergoqp import reba
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import Recording, load_recording
from ergoqp.mocap.assumptions import measured_lengths, suggested_stature
from ergoqp.mocap.fitting.axes import axes_of, find_unit, find_up
from ergoqp.mocap.fitting.neutral import leans
from ergoqp.mocap.joints import ReadOptions, joints_of
from ergoqp.mocap.load import CALIBRATION
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.readers import read_motion
from ergoqp.mocap.recorded import as_recorded
from ergoqp.problem.load import load_problem
from ergoqp.sheets.description import elevation_of
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.simulate import simulate

SHARED = Path(__file__).resolve().parents[2] / "shared" / "mocap" / "bvh"
ANGLES = ("trunk", "elbow", "knee", "elevation")
NOISE = 0.003
"""Of every coordinate of made centres [m]."""
FROM = {
    "cmu_62_04_screwing_keyframes": (3, 4, 5, 6, 7, 8, 9, 10, 11),
    "xsens_motionbox": (100, 150, 400, 600, 800),
    "toolbox_freebvh": (5, 40),
    "cmu_131_01_walk_max": (200, 360, 600),
}
"""Frames in which a hand can hold the tool."""
LONG = 20.0
"""Of a run [s]."""
POLE = np.radians(3.0)
"""Nearer to straight sideways an arm has no flexion [rad]."""


def places_of(path: Path) -> Places:
    """Return a file's own joint centres [m], z up."""
    paths = joints_of(read_motion(path), path.name, ReadOptions()).paths
    stature, up = suggested_stature(measured_lengths(paths)), find_up(paths)
    assert stature is not None
    assert up is not None
    axes = find_unit(stature, path.name) * axes_of(up)
    return {centre: each @ axes.T for centre, each in paths.items()}


def plain_angles(places: Places) -> dict[str, np.ndarray]:
    """Return the angles between joint centres (n, 1 or 2) [deg]."""
    trunk = places["neck"] - (places["right_hip"] + places["left_hip"]) / 2
    vertical = np.broadcast_to([0.0, 0.0, 1.0], trunk.shape)
    found = {"trunk": [_between(trunk, vertical)], "elbow": [], "knee": [], "elevation": []}
    for side in SIDES:
        at = {name.removeprefix(f"{side}_"): path for name, path in places.items()}
        upper_arm = at["elbow"] - at["shoulder"]
        found["elevation"].append(_between(upper_arm, -trunk))
        found["elbow"].append(_between(upper_arm, at["wrist"] - at["elbow"]))
        found["knee"].append(_between(at["knee"] - at["hip"], at["ankle"] - at["knee"]))
    return {name: np.stack(each, axis=1) for name, each in found.items()}


def geometry(report: Report, path: Path) -> None:
    """Print how far what is read from a file is from its plain geometry."""
    recording, places = load_recording(path), places_of(path)
    plain = plain_angles(places)
    read, name = read_angles(recording.postures), f"geometry.{path.stem}"
    work = ~recording.not_scored.get(CALIBRATION, np.zeros(len(recording.time), dtype=bool))
    for angle in ANGLES:
        off = (read[angle] - plain[angle])[work]
        report.figure(f"{name}.{angle}_rms_deg", _rms(off))
        constant = (plain[angle] - np.median(plain[angle][work], axis=0))[work]
        report.figure(f"{name}.{angle}_rms_deg.constant", _rms(constant))
        clear = np.abs(read[angle] - plain[angle])[recording.scored & seen(recording)]
        report.figure(f"{name}.{angle}_max_deg", clear.max())
    marked = np.logical_or.reduce([~work & False, *recording.doubts.values()])
    report.figure(f"{name}.marked", float(np.mean(marked)))
    plainly = recording.postures.copy()
    plainly[:, INDEX["trunk_flexion"]] = leans(places)[0]
    means = [_trunk_score(each[recording.scored]) for each in (recording.postures, plainly)]
    report.figure(f"{name}.trunk_score_off", means[0] - means[1])


def made_shoulders(report: Report) -> None:
    """Print how shoulders are read that go through every branch."""
    wrong, generator = 0, np.random.default_rng(1000)
    for name in SHOULDERS:
        off = []
        for elbow in (3.0, 30.0, 90.0):
            truth = shoulders(name, elbow)
            pelvis = np.tile([0.0, 0.0, 0.9, 0.5], (len(truth), 1))
            places = {
                centre: path + NOISE * generator.standard_normal(path.shape)
                for centre, path in centres_of(BODY, pelvis, truth).items()
            }
            found = fitted(places, neutral="vertical").postures
            off.append(np.degrees(elevation_of(found)[0] - elevation_of(truth)[0]))
            flexion = [INDEX[f"{side}_shoulder_flexion"] for side in SIDES]
            shows = np.abs(np.cos(truth[:, [each + 1 for each in flexion]])) > np.sin(POLE)
            wrong += int((shows & (np.abs(np.degrees(found - truth)[:, flexion]) > 90)).sum())
        key = name.replace(",", "").replace(" ", "_")
        report.figure(f"made.{key}.elevation_rms_deg", _rms(np.array(off)))
    report.figure("made.wrong_branches", wrong)


def made_trunks(report: Report) -> None:
    """Print how trunks are read that are upright, and that are not."""
    for lean in (-30, -20, -10, 0, 10, 20, 30):
        places = leaning(walk()[0], lean)
        report.figure(f"made.upright_score.{lean}", _score(fitted(places)))
        plain = _score(fitted(places, neutral="vertical"))
        report.figure(f"made.upright_score.{lean}.vertical", plain)
    off = []
    for deepest, stands in ((70.0, True), (40.0, True), (60.0, False), (30.0, False)):
        recording = fitted(stoop(deepest=deepest, stands=stands)[0])
        trunk = np.degrees(recording.postures[:, INDEX["trunk_flexion"]])
        off.append(abs(trunk.max() - deepest))
    report.figure("made.stoop_off_deg", max(off))


def outcomes(report: Report, paths: list[Path]) -> None:
    """Print what becomes of recordings that are broken."""
    walked, stooped = walk()[0], stoop()[0]
    made = {centre: np.concatenate([walked[centre], stooped[centre]]) for centre in walked}
    people = {"made": made, **{path.stem: places_of(path) for path in paths}}
    seeds = report.pick((1000,), (1000, 1001, 1002))
    found, every, count, noisy, narrower = 0, 0, 0, 0, 0
    for name, places in people.items():
        truth = fitted(places)
        for seed, case in product(seeds, cases()):
            wrong, all_scored = case.wrong(places, truth, seed)
            found, every, count = found + bool(wrong), every + bool(all_scored), count + 1
            if wrong:
                report.say(f"{name}, {case.name}: {wrong}")
                noisy += "of noise" in case.name
            if report.full:
                with patch.multiple("ergoqp.mocap.fitting.unknown", **NARROWER):
                    narrower += bool(case.wrong(places, truth, seed)[0])
    with tempfile.TemporaryDirectory() as folder:
        for path in paths:
            whole = path.read_text(encoding="utf-8")
            found_out = {
                what: silent_file(text, Path(folder)) for what, text in broken_files(whole)
            }
            found_out["NaN"] = unseen_number(whole, Path(folder))
            for what, wrong in found_out.items():
                found, every, count = found + bool(wrong), every + bool(wrong), count + 1
                if wrong:
                    report.say(f"{path.stem}, {what}: {wrong}")
    report.figure("wrong_outcomes", found, f"of {count}")
    report.figure("wrong_outcomes.without_ends", every)
    report.figure("wrong_outcomes.of_noise", noisy)
    if report.full:
        report.figure("wrong_outcomes.narrower", narrower)


def speed(report: Report, paths: list[Path]) -> None:
    """Print how many frames are read in a second on one core."""
    places = {centre: np.tile(path, (20, 1)) for centre, path in walk(10.0)[0].items()}
    fitted(walk(1.0)[0])  # builds the one function that there is
    begin = time.perf_counter()
    fitted(places)
    count = len(places["neck"])
    report.figure("centres_per_s", count / (time.perf_counter() - begin), f"{count} frames")
    for path in paths:
        begin = time.perf_counter()
        frames = len(load_recording(path).time)
        took = time.perf_counter() - begin
        report.figure(f"centres_per_s.read.{path.stem}", frames / took, f"{frames} frames")


def runs_from(report: Report, paths: list[Path]) -> None:
    """Print how runs end that begin in a recorded posture."""
    problem, ends = load_problem("screwing"), []
    for path in paths:
        frames, recording = FROM.get(path.stem, ()), load_recording(path)
        for frame in report.pick(frames[:1], frames):
            for seed in report.pick((1000,), (1000, 1001, 1002)):
                body, seen = recording.person, recording.observed[frame]
                given = simulate(
                    problem, recording.postures[frame], LONG, seed, person=body, observed=seen
                )
                own, posture, _ = as_recorded(problem, recording, frame)
                start = person_of_kind("alike", own, seed, body).hold(posture, seed=seed)
                start.rest(start.pose)
                runs = [simulate(own, start, LONG, seed, observed=each) for each in (None, seen)]
                ends.append(
                    [int(each.reba[-1]) - each.reba_standing_still for each in (*runs, given)]
                )
    if ends:
        after, as_seen, given = np.array(ends).T
        report.figure("run_from_worse", float((after > 0).sum()), f"of {len(ends)}")
        report.figure("run_from_worse.share_better", float((after < 0).mean()))
        report.figure("run_from_worse.as_seen", float((as_seen > 0).sum()))
        report.figure("run_from_worse.as_given", float((given > 0).sum()))


def _score(recording: Recording) -> float:
    return _trunk_score(recording.scored_postures)


def _trunk_score(postures: np.ndarray) -> float:
    return float(reba.assess(postures).segments["trunk"].mean())


def _between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    sizes = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=1) / sizes, -1, 1)))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def measure(report: Report) -> None:
    """Print every figure."""
    paths = sorted(SHARED.glob("*.bvh"))
    if not paths:
        report.say(f"no reference recordings in {SHARED}: only what the project makes")
    for path in paths:
        geometry(report, path)
    made_shoulders(report)
    made_trunks(report)
    outcomes(report, paths)
    measure_intervals(report)
    runs_from(report, paths)
    measure_references(report)
    speed(report, paths)


if __name__ == "__main__":
    run(measure, __doc__ or "")
