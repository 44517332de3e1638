"""Joint angles of recordings against those that other programs computed of the same movement.

Figures of `benchmarks.recordings`, by hand. ``reference.FILE.JOINT_rms_deg``: how far our angle is
from theirs, root of the mean square, what they differ by all the time removed: the zero of an
angle is a convention. ``_constant_deg``: the same of their mean, as a guess: their standard
deviation. Both only where that exceeds 8 degrees. ``_rms_deg.in_range``: had their angle been held
within the range that our joint has. ``_off_deg``: where it does not: with what they differ by all
the time; ``.standing``: of a person who stands still with hanging arms, as a guess.
``marker_fit_mm.FILE``: how far markers are from where they sit on the fitted body, root of the
mean square over the markers, median over the frames; ``.standing``: on a body that stands where
the fitted one is. ``markers_per_s``: frames of 39 markers per second, from arrays to postures.

Mapping of Vicon's angles (Plug-in Gait): knee, ankle and elbow x; hip x, which is to the pelvis,
less the pelvis' x; elevation of the upper arm by shoulder x and y, lean of the thorax by its x and
y. That of Xsens' is in `benchmarks.recording_xsens`.

OpenSim's thoracoscapular model has ``shoulder_elv`` to the scapula, which itself turns on the
thorax by up to 50 degrees: its files are read with that turn, and the arm is higher than
``shoulder_elv`` then. ``reference.FILE.elevation_off_deg``: elevation by forward kinematics of our
posture against ``shoulder_elv`` where the file's columns of the scapula are left out; ``.scapula``:
where they are read, which is what the scapula adds. ``reference.FILE.trunk_score``: mean score of
the trunk of somebody who walks upright. ``reference.FILE.stoop_off_deg``: how far our trunk is at
most from the line between hips (by Bell et al. 1990, not by what we take them by) and the middle of
C7 and breastbone, to the vertical; ``.upright``: of somebody who stands upright, as a guess.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.made_markers import markers_of
from benchmarks.made_motions import BODY, moved
from benchmarks.recording_told import measure_told
from benchmarks.recording_xsens import xsens
from benchmarks.report import Report
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.mocap import Recording, fit_postures, load_recording
from ergoqp.mocap.joints import joints_of
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.markers.fit import places_of_markers
from ergoqp.mocap.readers import read_motion
from ergoqp.sheets import reba
from ergoqp.sheets.description import elevation_of

SHARED = Path(__file__).resolve().parents[2] / "shared" / "mocap"
VARIES = 8.0
"""Only what varies by more can be told from a constant [deg]."""
VICON = ("pycgm_Movement_trial", "pycgm_Sample_Static")
STOOP = "millard_stoop1_t169_f620f800"
FULL_BODY = (*VICON, STOOP, "millard_neu_t169_f250f350")
Pairs = Mapping[str, tuple[np.ndarray, np.ndarray]]


def measure_references(report: Report) -> None:
    """Print the figures; nothing of files that are not there."""
    for name in VICON:
        path = SHARED / "c3d" / f"{name}.c3d"
        if path.is_file():
            _compared(report, name, vicon(path))
    path = SHARED / "mvnx" / "xsens_kicking_part1.mvnx"
    if path.is_file():
        _compared(report, path.stem, xsens(path))
    for name in ("thoracoscapular_ABD01", "thoracoscapular_FLX21"):
        path = SHARED / "mot" / f"{name}.mot"
        if path.is_file():
            report.figure(f"reference.{name}.elevation_off_deg", opensim(path, scapula=False))
            key = f"reference.{name}.elevation_off_deg.scapula"
            report.figure(key, opensim(path, scapula=True))
    path = SHARED / "c3d" / f"{VICON[0]}.c3d"
    if path.is_file():
        score = reba.assess(load_recording(path).scored_postures).segments["trunk"].mean()
        report.figure(f"reference.{VICON[0]}.trunk_score", float(score))
    path = SHARED / "c3d" / f"{STOOP}.c3d"
    if path.is_file():
        ours, plain = stooped(path)
        report.figure(f"reference.{STOOP}.stoop_off_deg", float(np.abs(ours - plain).max()))
        report.figure(f"reference.{STOOP}.stoop_off_deg.upright", float(plain.max()))
    for name in FULL_BODY:
        path = SHARED / "c3d" / f"{name}.c3d"
        if path.is_file():
            fit, standing = marker_fit(path)
            report.figure(f"marker_fit_mm.{name}", 1000 * fit)
            report.figure(f"marker_fit_mm.{name}.standing", 1000 * standing)
    moving = [SHARED / "c3d" / f"{name}.c3d" for name in (VICON[0], STOOP)]
    measure_told(report, [path for path in moving if path.is_file()])
    report.figure("markers_per_s", markers_per_second(report.pick(20, 100)))


def vicon(path: Path) -> Pairs:
    """Return joint -> our angles and Vicon's [deg], those that the file has beside its markers."""
    theirs, ours = read_motion(path).angles, load_recording(path)

    def thorax(axis: str) -> np.ndarray:
        return theirs[f"LThoraxAngles {axis}"].astype(float)

    lean = _lean(_ours(ours, "trunk_flexion"), _ours(ours, "trunk_side_bend"))
    found = {"thorax": (lean, _lean(thorax("x"), thorax("y")))}
    for side in SIDES:

        def of(angle: str, axis: str = "x", letter: str = side[0].upper()) -> np.ndarray:
            return theirs[f"{letter}{angle} {axis}"].astype(float)

        found |= {
            f"{side}_knee": (_ours(ours, f"{side}_knee_flexion"), of("KneeAngles")),
            f"{side}_hip": (
                _ours(ours, f"{side}_hip_flexion"),
                of("HipAngles") - of("PelvisAngles"),
            ),
            f"{side}_ankle": (_ours(ours, f"{side}_ankle_flexion"), of("AnkleAngles")),
            f"{side}_elbow": (_ours(ours, f"{side}_elbow_flexion"), of("ElbowAngles")),
            f"{side}_elevation": (
                elevation_of(ours.postures)[0][:, SIDES.index(side)],
                _lean(of("ShoulderAngles"), of("ShoulderAngles", "y")),
            ),
        }
    return {name: (np.degrees(a), np.degrees(b)) for name, (a, b) in found.items()}


def opensim(path: Path, *, scapula: bool) -> float:
    """Return how far the right arm's elevation is from a file's ``shoulder_elv`` (RMS) [deg]."""
    motion = read_motion(path)
    if not scapula:
        kept = {name: each for name, each in motion.angles.items() if "scapula" not in name}
        motion = replace(motion, angles=kept)
    recording = recording_of(motion, path.name, ReadOptions(unit=1.0, up="y"))
    ours = elevation_of(recording.postures)[0][:, SIDES.index("right")]
    away = np.degrees(ours - motion.angles["shoulder_elv"])[recording.scored]
    return float(np.sqrt(np.mean(away**2)))


def stooped(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the lean of our trunk, and that of plain geometry of the markers [deg]."""
    motion, ours = read_motion(path), load_recording(path)
    front, back, neck = (
        (motion.of(one) + motion.of(other)) / 2
        for one, other in (("RASI", "LASI"), ("RPSI", "LPSI"), ("C7", "CLAV"))
    )
    left = motion.of("LASI") - motion.of("RASI")
    width = np.linalg.norm(left, axis=1, keepdims=True)
    left /= width
    ahead = front - back
    ahead -= (ahead * left).sum(axis=1, keepdims=True) * left
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    hips = front - 0.19 * width * ahead - 0.30 * width * np.cross(ahead, left)
    trunk = neck - hips
    plain = np.degrees(np.arccos(trunk[:, 2] / np.linalg.norm(trunk, axis=1)))
    lean = _lean(_ours(ours, "trunk_flexion"), _ours(ours, "trunk_side_bend"))
    return np.degrees(lean), plain


def marker_fit(path: Path) -> tuple[float, float]:
    """Return how far markers are from where they sit, on the fitted and on a standing body [m]."""
    ours, motion = load_recording(path), read_motion(path)
    found = joints_of(motion, path.name, ReadOptions())
    poses = ours.base_poses[found.frames]
    pelvis = np.column_stack([poses[:, :3, 3], np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])
    postures = ours.postures[found.frames]

    def median(postures: np.ndarray) -> float:
        there = places_of_markers(ours.person, pelvis, postures, ours.markers)
        away = [np.sum((found.markers[name] - path) ** 2, axis=1) for name, path in there.items()]
        return float(np.median(np.sqrt(np.nanmean(away, axis=0))))

    return median(postures), median(np.zeros_like(postures))


def markers_per_second(times: int) -> float:
    """Return how many frames of 39 markers become postures in a second."""
    names, places = markers_of(BODY, *moved())
    places = np.tile(places, (times, 1, 1))
    fit_postures(names, places[:1000], 120.0)
    begin = time.perf_counter()
    fit_postures(names, places, 120.0)
    return len(places) / (time.perf_counter() - begin)


def _compared(report: Report, file: str, pairs: Pairs) -> None:
    for joint, (ours, theirs) in pairs.items():
        seen = np.isfinite(theirs)
        away, spread = (ours - theirs)[seen], float(np.std(theirs[seen]))
        name = f"reference.{file}.{joint}"
        if spread > VARIES:
            report.figure(f"{name}_rms_deg", float(np.std(away)))
            report.figure(f"{name}_constant_deg", spread)
            if joint in INDEX:
                least, greatest = np.degrees([LOWER[INDEX[joint]], UPPER[INDEX[joint]]])
                held = (ours - np.clip(theirs, least, greatest))[seen]
                report.figure(f"{name}_rms_deg.in_range", float(np.std(held)))
        else:
            report.figure(f"{name}_off_deg", float(np.sqrt(np.mean(away**2))))
            report.figure(f"{name}_off_deg.standing", float(np.sqrt(np.mean(theirs[seen] ** 2))))


def _lean(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return how far a bone is from its zero that is turned by two angles, one after the other."""
    return np.arccos(np.clip(np.cos(one) * np.cos(other), -1, 1))


def _ours(recording: Recording, joint: str) -> np.ndarray:
    return recording.postures[:, INDEX[joint]]
