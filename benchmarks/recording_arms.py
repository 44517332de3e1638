"""Raised arms of marker takes in which the acromion's marker slides: how far off, how doubtful.

Run ``python -m benchmarks.recording_arms [--quick | --full] [--json FILE]``. Takes are those of
`benchmarks.made_arms`: seven movements of the shoulders, elbows bent by 3, 20 and 90 deg, after
hanging arms and without any low arm. BIN is the lower end of 30 deg of true elevation.

``arm_error_deg.BIN``: angle between the upper arm that is read and the true one, root of the mean
square, where the marker slides by 0, 45 / 35 and 60 / 50 mm (up / in at 120 deg), each with a joint
that itself stays, or rises by 30 mm and moves in by 10. The made person's forearms have no carrying
angle; ``.carrying_10``, ``.carrying_15``: with one of so many degrees.
``.elbow_moves``: elbows bend from 3 to 90 deg and straighten again all the time, and are not kept.
Controls: ``.below``, had the joint been below the marker by 47 mm; ``.fixed``, the centre of a
sphere that is fixed to the trunk; ``.known``, the true joint: what is left is due to the elbow.
``arm_covered.elbow_too``: share of the frames in which this error is at most the half-angle of
doubt and 1 deg, because the noise of the markers is not in it; ``.none``: had the half-angle been
0.
``shoulder_error_deg.BIN``, ``arm_covered``: the same without the error of the elbow: against the
upper arm that is read from the true joint. ``arm_half_deg.BIN``: mean half-angle. These three with
a carrying angle of 10 deg.
``judged.CLASS``: of takes on which nothing was tuned but the width of the doubt in ``shrugs``, in
the worst bin; ``.half_deg`` is the mean half-angle of the worst bin, ``.covered`` that of all
frames.
``arm_bins.BIN``: share of the frames whose interval of the upper arm's score is at most one point
wide, as read by `ergoqp.mocap.fit_postures`; ``arm_bins_ratio``: of the bins, the smallest over the
largest. ``upper_arm_covered``: share of the frames with the true score inside; ``.direction``: had
the true upper arm been rotated about its own length as is read. A narrow interval that does not
hold is worth nothing, so both belong together: ``.half_angle_times_X`` is what is reached with
smaller doubts. ``posture.BIN.error_deg``: of the upper arms of these postures. Kinds and ``.below``
as above.
``real.FILE.SIDE``: real takes. Per bin of read elevation, the median length of the upper arm and
from neck to shoulder; the figure is the range of these medians [mm]; ``.below``: as above.
``.arm_bins.BIN``: as above, by read elevation: what is true is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.made_arms import (
    Slide,
    Take,
    bending,
    busy,
    one_arm,
    raised,
    reaching,
    shrugging,
    slowly,
    take_of,
)
from benchmarks.made_motions import BODY, RATE, SHOULDERS
from benchmarks.report import Report, run
from ergoqp import reba
from ergoqp.errors import ErgoqpError
from ergoqp.human import Body
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import Recording, fit_postures, load_recording
from ergoqp.mocap.fitting.unknown import Doubt, Ends, changes_by
from ergoqp.mocap.joints import Found, ReadOptions, joints_of
from ergoqp.mocap.markers.bones import Widths
from ergoqp.mocap.markers.joints import centres_of_landmarks
from ergoqp.mocap.naming import best_set, centres_of
from ergoqp.mocap.readers import read_motion
from ergoqp.mocap.recording import JointMotion
from ergoqp.sheets.description import elevation_of

SHARED: Final = Path(__file__).resolve().parents[2] / "shared"
BINS: Final = (0, 30, 60, 90, 120, 150)
NOISE: Final = 1.0
"""Error that is due to the noise of the markers [deg]."""
SKIN: Final = ((0.0, 0.0, 0.0), (0.045, 0.035, 0.0), (0.060, 0.050, 0.0))
RISE: Final = ((0.0, 0.0), (0.030, 0.010))
TUNED: Final = [Slide(skin, rise) for skin in SKIN for rise in RISE]
SLID: Final = [each for each in TUNED if each.skin[0]]
"""Those of which the classes that are judged are made."""
CARRYING: Final = (0.0, 10.0, 15.0)
"""Carrying angles; for 10 deg the rule of Plug-in Gait is exact [deg]."""
ADULT: Final = 10.0
"""That of adults: 10 to 15 deg [deg]."""
ELBOWS: Final = (3.0, 20.0, 90.0)
"""Bends of the elbows, which are kept [deg]."""
SAMPLE: Final = ("raised sideways", "forward, and out over the side", "around")
"""Movements of the smaller sample."""
SIZE: Final = (0.28, 0.15)
"""Of a pelvis; no arm depends on it."""
PRIOR: Final = 0.15
"""Weight of the first guess of the fixed sphere, per root of the number of frames."""
Errors = dict[str, np.ndarray]


def _from_30(elevation: np.ndarray) -> np.ndarray:
    return np.clip((elevation - 30) / 90, 0, 1)


def _smooth(elevation: np.ndarray) -> np.ndarray:
    return (1 - np.cos(np.radians(elevation))) / 1.5


def _same(postures: np.ndarray) -> np.ndarray:
    return postures


def _with(**changes: object) -> list[Slide]:
    return [replace(each, **changes) for each in SLID]  # type: ignore[arg-type]


def _only(*skins: tuple[float, float, float]) -> list[Slide]:
    return [Slide(skin, rise) for skin in skins for rise in RISE]


JUDGED: Final[dict[str, tuple[list[Slide], Callable[[np.ndarray], np.ndarray]]]] = {
    "from_30_deg": (_with(shape=_from_30), _same),
    "quadratic": (_with(shape=lambda elevation: np.clip(elevation / 120, 0, 1) ** 2), _same),
    "to_180_deg": (_with(shape=_smooth), _same),
    "only_up": (_only((0.05, 0.0, 0.0)), _same),
    "only_in": (_only((0.0, 0.05, 0.0)), _same),
    "ahead_or_behind": (_only((0.0, 0.0, 0.03), (0.0, 0.0, -0.03)), _same),
    "down": (_only((-0.02, 0.0, 0.0)), _same),
    "one_arm": (SLID, one_arm),
    "bends_and_walks": (SLID, busy),
    "shrugs": (_with(girdle=shrugging), _same),
    "shrugs_slowly": (_with(girdle=slowly), _same),
    "shrugs_no_slide": ([Slide(girdle=shrugging)], _same),
    "reaches": (_with(girdle=reaching), _same),
    "reaches_no_slide": ([Slide(girdle=reaching)], _same),
    "noise_3_mm": (_with(noise=0.003), _same),
    "stature_1.55": (_with(body=Body.of_stature(1.55)), _same),
    "stature_1.95": (_with(body=Body.of_stature(1.95)), _same),
}


def errors(take: Take) -> Errors:
    """Return errors and doubts of both upper arms (2 n,) [deg], and their elevation.

    Keys are ``true`` and ``joint``, against the true arm and the one that is read from the true
    joint, followed by the name of a control; ``half`` and ``elevation``.
    """
    count = len(take.places)
    motion = JointMotion(take.names, take.places, np.arange(count) / RATE, unit=1.0, markers=True)
    found = joints_of(motion, "made", ReadOptions(unit=1.0, up="z"))
    best = best_set(take.names)
    assert best is not None
    own = best[0].found_in(take.names)
    at = {mark: take.places[:, take.names.index(name)] for mark, name in own.items()}
    plain = centres_of_landmarks(at, Widths(), SIZE)
    below = {side: plain[f"{side}_shoulder"] for side in SIDES}
    fixed = {side: _fixed(at, plain, side) for side in SIDES}
    arms = {
        "": {side: _arm(found.paths, side) for side in SIDES},
        ".below": {side: _arm(plain, side) for side in SIDES},
        ".fixed": _arms_from(at, below, fixed),
        ".known": _arms_from(at, below, take.joints),
    }
    every = {
        f"{against}{name}": np.concatenate([_between(each[side], truth[side]) for side in SIDES])
        for name, each in arms.items()
        for against, truth in (("true", take.arms), ("joint", arms[".known"]))
    }
    half = np.concatenate([found.doubts[f"{side}_upper_arm"] for side in SIDES])
    return every | {"half": np.degrees(half), "elevation": take.elevation.T.ravel()}


def _arm(centres: Mapping[str, np.ndarray], side: str) -> np.ndarray:
    return centres[f"{side}_elbow"].astype(float) - centres[f"{side}_shoulder"]


def _arms_from(
    at: dict[str, np.ndarray], below: dict[str, np.ndarray], joints: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return side -> upper arm that is read if the joint, below its marker, is a given one."""
    moved = dict(at)
    for side in SIDES:
        moved[f"{side}_acromion"] = at[f"{side}_acromion"] + joints[side] - below[side]
    centres = centres_of_landmarks(moved, Widths(), SIZE)
    return {side: _arm(centres, side) for side in SIDES}


def _fixed(at: dict[str, np.ndarray], centres: dict[str, np.ndarray], side: str) -> np.ndarray:
    """Return the centre of the elbow's sphere, fixed to the trunk (n, 3) [m]."""
    neck = centres["neck"]
    down = _unit(centres[f"{side}_shoulder"] - at[f"{side}_acromion"])
    left = at["left_acromion"] - at["right_acromion"]
    left = _unit(left - (left * down).sum(axis=1, keepdims=True) * down)
    axes = np.stack([np.cross(down, left), left, -down], axis=1)
    elbow, guess = (
        np.einsum("nij,nj->ni", axes, each - neck)
        for each in (at[f"{side}_outer_elbow"], centres[f"{side}_shoulder"])
    )
    low = np.argsort(elbow[:, 2])[: max(10, len(elbow) // 20)]
    first = np.append(guess[low].mean(axis=0), np.linalg.norm((elbow - guess)[low], axis=1).mean())
    found, weight = first.copy(), PRIOR * np.sqrt(len(elbow))
    for _ in range(8):
        away = found[:3] - elbow
        length = np.linalg.norm(away, axis=1)
        rows = np.column_stack([away / length[:, None], -np.ones(len(elbow))])
        rows = np.vstack([rows, weight * np.eye(4)])
        left_over = np.append(found[3] - length, weight * (first - found))
        found = found + np.linalg.lstsq(rows, left_over)[0]
    return neck + np.einsum("nij,i->nj", axes, found[:3])


def made(report: Report) -> None:
    """Print the figures of the takes by which the fit was tuned."""
    names = report.pick(SAMPLE, tuple(SHOULDERS))
    for carrying in CARRYING:
        slides = [replace(each, carrying=carrying) for each in report.pick(TUNED[3:4], TUNED)]
        for kind, elbows in (("", ELBOWS), (".elbow_moves", (None,))):
            every, kind = pooled(slides, elbows, names), kind + _kind(carrying)
            for low, rows in bins(every):
                for control in ("", ".below", ".fixed", ".known"):
                    error = _rms(every[f"true{control}"][rows])
                    report.figure(f"arm_error_deg.{low}{kind}{control}", error)
            for name in ("", ".none"):
                half = 0 * every["half"] if name else every["half"]
                report.figure(f"arm_covered.elbow_too{kind}{name}", _covered(every["true"], half))
            if carrying == ADULT and not kind.startswith(".elbow"):
                _of_shoulders(report, every)


def _of_shoulders(report: Report, every: Errors) -> None:
    """Print the figures of `made` that do not depend on the elbow."""
    for low, rows in bins(every):
        for control in ("", ".below", ".fixed"):
            report.figure(
                f"shoulder_error_deg.{low}{control}", _rms(every[f"joint{control}"][rows])
            )
        report.figure(f"arm_half_deg.{low}", every["half"][rows].mean())
    report.figure("arm_covered", _covered(every["joint"], every["half"]))
    report.figure("arm_covered.none", _covered(every["joint"], 0 * every["half"]))


def _kind(carrying: float) -> str:
    return f".carrying_{carrying:.0f}" if carrying else ""


def judged(report: Report) -> None:
    """Print the figures of takes on which nothing was tuned."""
    elbows = report.pick((20.0,), ELBOWS)
    names = report.pick(SAMPLE, tuple(SHOULDERS))
    for name, (slides, change) in JUDGED.items():
        every = pooled(report.pick(slides[:1], slides), elbows, names, change)
        for control in ("", ".below", ".fixed"):
            worst = max(_rms(every[f"joint{control}"][rows]) for _, rows in bins(every))
            report.figure(f"judged.{name}{control}", worst)
        half = max(float(every["half"][rows].mean()) for _, rows in bins(every))
        report.figure(f"judged.{name}.half_deg", half)
        report.figure(f"judged.{name}.covered", _covered(every["joint"], every["half"]))


def scores(report: Report) -> None:
    """Print the intervals of the upper arms' scores, and how far off postures are."""
    for carrying in report.pick((ADULT,), CARRYING):
        read_as("", report, carrying)
    with patch("ergoqp.mocap.markers.joints._sliding", lambda *_: {}):
        read_as(".below", report, ADULT)
    for share in report.pick((0.0,), (0.0, 0.5, 0.75)):
        with patch("ergoqp.mocap.fitting.unknown.changes_by", _with_less(share)):
            read_as(f".half_angle_times_{share:g}", report, ADULT)


def _with_less(share: float) -> Callable[[np.ndarray, Doubt, np.ndarray], dict[int, Ends]]:
    """Return what turns doubts into changes of angles, for a share of the half-angles."""

    def changes(postures: np.ndarray, doubt: Doubt, time: np.ndarray) -> dict[int, Ends]:
        arms = {arm: share * half for arm, half in doubt.arms.items()}
        return changes_by(postures, replace(doubt, arms=arms), time)

    return changes


def read_as(control: str, report: Report, carrying: float) -> None:
    """Print the figures of `scores`, under the name of a control."""
    found: list[np.ndarray] = []
    slides = [replace(each, carrying=carrying) for each in report.pick(SLID[:1], TUNED)]
    elbows = report.pick((3.0, 90.0), ELBOWS)
    for slide, elbow, hang in product(slides, (*elbows, None), (True, False)):
        for name in report.pick(SAMPLE, tuple(SHOULDERS)):
            truth = _raised(name, elbow, hang=hang)
            take = take_of(truth, slide)
            read = fit_postures(take.names, take.places, RATE, neutral="vertical")
            found += list(_scored(read, truth, take, np.nan if elbow is None else elbow))
    off, elevation, low, score, points, high, elbow, shown = np.concatenate(found, axis=1)
    narrow, holds = (high - low <= 1) & (shown > 0), (low <= score) & (score <= high)
    direction = (low <= points) & (points <= high)
    kind = _kind(carrying) + control
    shares: list[float] = []
    for lower, rows in bins({"elevation": elevation}):
        shares.append(float(narrow[rows].mean()))
        report.figure(f"arm_bins.{lower}{kind}", shares[-1])
        report.figure(f"arm_bins.{lower}.covered{kind}", holds[rows].mean())
        report.figure(f"posture.{lower}.error_deg{kind}", _rms(off[rows]))
    report.figure(f"arm_bins_ratio{kind}", min(shares) / max(shares))
    report.figure(f"upper_arm_covered{kind}", holds.mean())
    report.figure(f"upper_arm_covered.direction{kind}", direction.mean())
    for bend in (*elbows, None):
        rows = np.isnan(elbow) if bend is None else elbow == bend
        own = bins({"elevation": np.where(rows, elevation, np.nan)})
        each = [float(narrow[its].mean()) for _, its in own]
        name = "elbow_moves" if bend is None else f"elbow_{bend:.0f}"
        report.figure(f"arm_bins_ratio.{name}{kind}", min(each) / max(each))
        report.figure(f"upper_arm_covered.{name}{kind}", holds[rows].mean())


def _scored(read: Recording, truth: np.ndarray, take: Take, elbow: float) -> Iterator[np.ndarray]:
    """Return of each side what `read_as` needs of the frames (8, n).

    The error and the elevation [deg]; of the score the lower end, the true one, the true one with
    the rotation that is read, and the upper end; the bend [deg]; whether the frame is scored.
    """
    right, ours = (centres_of(BODY, np.zeros((len(truth), 4)), p) for p in (truth, read.postures))
    found = reba.assess(read.postures, low=read.low, high=read.high)
    turned = truth.copy()
    turns = [INDEX[f"{side}_shoulder_rotation"] for side in SIDES]
    turned[:, turns] = read.postures[:, turns]
    scored, points = (reba.assess(each).segments for each in (truth, turned))
    for i, side in enumerate(SIDES):
        arm = f"{side}_upper_arm"
        yield np.stack(
            [
                _between(_arm(ours, side), _arm(right, side)),
                take.elevation[:, i],
                found.segments_low[arm],
                scored[arm],
                points[arm],
                found.segments_high[arm],
                np.full(len(truth), elbow),
                read.scored,
            ]
        )


def pooled(
    slides: list[Slide],
    elbows: tuple[float | None, ...],
    names: tuple[str, ...],
    change: Callable[[np.ndarray], np.ndarray] = _same,
) -> Errors:
    """Return the errors of some movements, after hanging arms and without any low arm."""
    found = [
        errors(take_of(change(_raised(name, elbow, hang=hang)), slide))
        for slide in slides
        for name in names
        for elbow in elbows
        for hang in (True, False)
    ]
    return {key: np.concatenate([each[key] for each in found]) for key in found[0]}


def _raised(name: str, elbow: float | None, *, hang: bool) -> np.ndarray:
    """Return the postures of a movement with elbows bent by an angle [deg]; None: they move."""
    found = raised(name, elbow or 0.0, hang=hang)
    return bending(found) if elbow is None else found


def bins(every: Errors) -> list[tuple[int, np.ndarray]]:
    """Return the lower end of each bin, and its frames."""
    rows = [(low, (every["elevation"] >= low) & (every["elevation"] < low + 30)) for low in BINS]
    return [(low, each) for low, each in rows if each.any()]


def real(report: Report) -> None:
    """Print how much bones of real takes change with the elevation, before and after."""
    paths = [*sorted((SHARED / "mocap" / "c3d").glob("*.c3d"))]
    paths += [SHARED / "recording_faults" / name for name in ("btk_shd01.c3d", "btk_T.trc")]
    for path in filter(Path.is_file, paths):
        try:
            motion = read_motion(path)
            found = joints_of(motion, path.name, ReadOptions())
        except ErgoqpError as refused:
            report.say(f"{path.name}: {str(refused)[:90]}")
            continue
        for side in SIDES if found.doubts else ():
            _bones(report, path.stem, side, found)
    path = SHARED / "recording_faults" / "btk_shd01.c3d"
    if path.is_file():
        _intervals(report, path, "")
        with patch("ergoqp.mocap.markers.joints._sliding", lambda *_: {}):
            _intervals(report, path, ".below")


def _intervals(report: Report, path: Path, control: str) -> None:
    """Print the share of narrow intervals of the scores of a real take's upper arms by bins."""
    read = load_recording(path)
    found, elevation = (
        reba.assess(read.postures, low=read.low, high=read.high),
        np.degrees(elevation_of(read.postures)[0]),
    )
    for i, side in enumerate(SIDES):
        arm = f"{side}_upper_arm"
        narrow = (found.segments_high[arm] - found.segments_low[arm] <= 1) & read.scored
        for low, rows in bins({"elevation": elevation[:, i]}):
            report.figure(f"real.{path.stem}.{side}.arm_bins.{low}{control}", narrow[rows].mean())


def _bones(report: Report, name: str, side: str, found: Found) -> None:
    """Print the lengths of upper arm and from neck to shoulder of a side in bins of elevation."""
    paths = {centre: path.astype(float) for centre, path in found.paths.items()}
    if f"{side}_elbow" not in paths or not found.doubts[f"{side}_upper_arm"].any():
        return
    at = {found.landmarks[marker]: path for marker, path in found.markers.items()}
    plain = centres_of_landmarks(at, Widths(), SIZE)
    paths = {centre: path[found.frames] for centre, path in paths.items()}
    down = plain[f"{side}_shoulder"] - at[f"{side}_acromion"]
    elevation = _between(_arm(paths, side), down)
    lengths = {
        what: {key: np.linalg.norm(each[end] - each[start], axis=1) for key, each in both.items()}
        for both in ({"": paths, ".below": plain},)
        for what, start, end in (
            ("upper_arm", f"{side}_shoulder", f"{side}_elbow"),
            ("neck", "neck", f"{side}_shoulder"),
        )
    }
    half = np.degrees(found.doubts[f"{side}_upper_arm"][found.frames])
    medians: dict[str, list[float]] = {}
    for low, rows in bins({"elevation": elevation}):
        if rows.sum() < 10:
            continue
        said = f"{name} {side} {low:>3}, {rows.sum()} frames:"
        for what, each in lengths.items():
            for key in (".below", ""):
                medians.setdefault(f"{what}{key}", []).append(1000 * np.nanmedian(each[key][rows]))
            before, after = (medians[f"{what}{key}"][-1] for key in (".below", ""))
            said += f" {what} {before:.0f} before, {after:.0f} mm;"
        report.say(f"{said} half-angle {half[rows].mean():.1f} deg")
    for what, each in medians.items():
        report.figure(f"real.{name}.{side}.{what}", np.ptp(each), "mm")


def _covered(error: np.ndarray, half: np.ndarray) -> float:
    return float(np.mean(error <= half + NOISE))


def _between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=1)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def measure(report: Report) -> None:
    """Print every figure."""
    made(report)
    judged(report)
    scores(report)
    real(report)


if __name__ == "__main__":
    run(measure, __doc__ or "")
