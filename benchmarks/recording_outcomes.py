"""What becomes of recordings that are broken: a sentence, or a result that says what it lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.made_motions import Places, fitted
from ergoqp.errors import ErgoqpError, RecordingError
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import Recording, load_recording
from ergoqp.mocap.fitting.axes import UPS, axes_of
from ergoqp.sheets.description import between_elevations

Change = Callable[[Places, np.random.Generator], Places]
"""Breaks joint centres."""

OFF: Final = 12.0
"""A posture is wrong of which trunk, an elbow, a knee or an upper arm is further off [deg]."""
_FEW: Final = 100
MIRRORED: Final = "left and right are exchanged, or an axis is mirrored"


@dataclass(frozen=True)
class Case:
    """How joint centres are broken, and what should become of it.

    Attributes:
        name: what is wrong with them.
        change: breaks them.
        refusal: part of the sentence with which they should be refused; empty: they are read.
        least: share of the frames that should be known to `OFF`.
        options: of `ergoqp.fit_postures`.
    """

    name: str
    change: Change
    refusal: str = ""
    least: float = 0.0
    options: dict[str, Any] = field(default_factory=dict)

    def wrong(self, places: Places, truth: Recording, seed: int) -> tuple[str, str]:
        """Return what is wrong with the outcome, and what would be without ends of the angles.

        Empty texts if nothing is. A frame is a silent wrong posture that is scored and has the
        truth more than `OFF` outside the ends of its angles.

        Args:
            places: the centres as they are (n, 3) [m].
            truth: what is read from those.
            seed: of what is random.
        """
        broken = self.change(places, np.random.default_rng(seed))
        try:
            found = fitted(broken, **self.options)
        except ErgoqpError as error:
            wrong = "" if self.refusal and self.refusal in str(error) else f"refused: {error}"
            return wrong, wrong
        if self.refusal:
            wrong = f"read, and not refused with {self.refusal!r}"
            return wrong, wrong
        every = _silent(replace(found, spans={}), truth)
        share = float(known(found).mean())
        # A recording of a few frames does not tell how fast its angles move.
        if len(found.time) > _FEW and share < self.least * known(truth).mean():
            return f"only {share:.0%} of the frames are known", every
        return _silent(found, truth), every


def broken_files(text: str) -> Iterator[tuple[str, str]]:
    """Return what is wrong with BVH files, and their texts; each should be refused.

    Args:
        text: a file that is not broken.
    """
    for share in np.linspace(0.0, 0.999, 12):
        yield f"cut after {share:.0%}", text[: int(share * len(text))]
    head, frames, rest = text.partition("Frames:")
    count, rows = rest.split("\n", 1)
    _, _, numbers = rows.partition("\n")
    yield "a billion frames declared", f"{head}{frames} 1000000000\n{rows}"
    yield "a frame less declared", f"{head}{frames} {int(count) - 1}\n{rows}"
    yield "time running backwards", f"{head}{frames}{count}\nFrame Time: -0.01\n{numbers}"
    yield "a decimal comma", f"{head}{frames}{count}\n{rows.replace('.', ',')}"
    yield "no skeleton", frames + rest


def silent_file(text: str, folder: Path) -> str:
    """Return what is wrong with the outcome of a broken file; an empty text if nothing is."""
    path = folder / "broken.bvh"
    path.write_text(text, encoding="utf-8")
    try:
        load_recording(path)
    except RecordingError as error:
        return "" if path.name in str(error) else f"refused without its name: {error}"
    return "read, and not refused"


def unseen_number(text: str, folder: Path) -> str:
    """Return what is wrong with the outcome of a BVH file in which the first number is missing.

    It should be read, and nothing seen in that frame; an empty text if it is.

    Args:
        text: a file that is not broken.
        folder: where it is written.
    """
    head, mark, rest = text.partition("Frame Time:")
    time, numbers = rest.split("\n", 1)
    path = folder / "broken.bvh"
    first = numbers.split(maxsplit=1)[0]
    path.write_text(f"{head}{mark}{time}\n{numbers.replace(first, 'nan', 1)}", encoding="utf-8")
    try:
        recording = load_recording(path)
    except RecordingError as error:
        return f"refused: {error}"
    return "the frame counts as seen" if recording.observed[0].any() else ""


def cases() -> Iterator[Case]:
    """Return what can be wrong with joint centres."""
    yield Case("10 % of the frames missing", lost_frames(0.1), least=0.8)
    yield Case("60 % of the frames missing", lost_frames(0.6), least=0.2)
    yield Case("10 % of the points missing", lost_points(0.1), least=0.5)
    yield Case("60 % of the points missing", lost_points(0.6))
    for up in UPS:
        yield Case(f"vertical along {up}", turned(up), least=0.9, options={"up": None})
    for unit in (1.0, 100.0, 1000.0):
        yield Case(f"{unit:g} to the metre", scaled(unit), least=0.9, options={"unit_to_m": None})
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        yield Case(f"{name}s exchanged for a while", exchanged(name), least=0.5)
    for centre in ("neck", "left_shoulder", "right_elbow", "left_wrist", "left_hip", "right_knee"):
        for far in (0.05, 0.1, 0.15, 0.3):
            yield Case(f"{centre} jumps by {far:g} m", moved(centre, far), least=0.5)
            yield Case(f"{centre} drifts by {far:g} m", moved(centre, far, drift=True), least=0.5)
    for size, least in ((0.003, 0.95), (0.01, 0.2), (0.02, 0.0)):
        yield Case(f"{1000 * size:g} mm of noise", noisy(size), least=least)
    legs = only("hip", "knee", "ankle")
    yield Case("legs alone", legs, "the upper trunk cannot be placed")
    yield Case("mirrored", scaled(np.array([1.0, -1.0, 1.0])), MIRRORED)
    yield Case("in one point", scaled(0.0), "positions: ")
    yield Case("nobody", scaled(np.nan), "positions: ")


def lost_frames(share: float) -> Change:
    """A share of the frames is not there."""

    def change(places: Places, generator: np.random.Generator) -> Places:
        lost = generator.random((len(places["neck"]), 1)) < share
        return {centre: np.where(lost, np.nan, path) for centre, path in places.items()}

    return change


def lost_points(share: float) -> Change:
    """A share of the points is not there."""

    def change(places: Places, generator: np.random.Generator) -> Places:
        return {
            centre: np.where(generator.random((len(path), 1)) < share, np.nan, path)
            for centre, path in places.items()
        }

    return change


def turned(up: str) -> Change:
    """Another axis is vertical."""
    return lambda places, _: {centre: path @ axes_of(up) for centre, path in places.items()}


def scaled(factor: float | np.ndarray) -> Change:
    """The unit is another, or the direction of an axis."""
    return lambda places, _: {centre: factor * path for centre, path in places.items()}


def exchanged(name: str) -> Change:
    """Left and right are exchanged for a while."""

    def change(places: Places, _: np.random.Generator) -> Places:
        rows, found = _while(places), {centre: path.copy() for centre, path in places.items()}
        for side, other in (("right", "left"), ("left", "right")):
            found[f"{side}_{name}"][rows] = places[f"{other}_{name}"][rows]
        return found

    return change


def moved(centre: str, far: float, *, drift: bool = False) -> Change:
    """A point is elsewhere for a while, at once or bit by bit [m]."""

    def change(places: Places, generator: np.random.Generator) -> Places:
        rows, found = _while(places), dict(places)
        aside = Rotation.random(rng=generator).apply([far, 0.0, 0.0])
        count = len(places[centre][rows])
        share = np.sin(np.linspace(0, np.pi, count)) if drift else np.ones(count)
        found[centre] = places[centre].copy()
        found[centre][rows] += share[:, None] * aside
        return found

    return change


def noisy(size: float) -> Change:
    """Every coordinate has noise, anew in every frame [m]."""
    return lambda places, generator: {
        centre: path + size * generator.standard_normal(path.shape)
        for centre, path in places.items()
    }


def only(*ends: str) -> Change:
    """Only some centres are there."""
    return lambda places, _: {c: path for c, path in places.items() if c.endswith(ends)}


def known(recording: Recording) -> np.ndarray:
    """Return the frames in which all that is ever seen is known to `OFF` (n,) bool."""
    ends = _judged(np.stack([recording.low.T, recording.high.T]))
    told = [name for name in ends if recording.observed[:, _JOINTS[name]].any()]
    wide = [ends[name][1] - ends[name][0] > 2 * OFF for name in told]
    return recording.scored & ~np.logical_or.reduce([np.zeros_like(recording.scored), *wide])


def seen(recording: Recording) -> np.ndarray:
    """Return the frames in which all that is ever seen is seen (n,) bool."""
    return recording.seen


def outside(recording: Recording, truth: np.ndarray) -> np.ndarray:
    """Return how far postures are outside the ends of a recording's at most (n,) [deg].

    Args:
        recording: the recording.
        truth: the postures (n, 32) [rad].
    """
    ends = _judged(np.stack([recording.low.T, recording.high.T]))
    right = _judged(np.stack([truth.T, truth.T]))
    off = [np.maximum(ends[n][0] - right[n][0], right[n][1] - ends[n][1]) for n in ends]
    return np.max([np.zeros(len(truth)), *off], axis=0)


_JOINTS: Final = {
    name: INDEX[name]
    for name in (
        "trunk_flexion",
        "trunk_side_bend",
        *(f"{side}_{each}" for side in SIDES for each in ("shoulder_flexion", "elbow_flexion")),
        *(f"{side}_knee_flexion" for side in SIDES),
    )
}
"""Joints that are judged; the flexion of a shoulder stands for the elevation of the arm."""


def _judged(ends: np.ndarray) -> dict[str, np.ndarray]:
    """Return joint -> lower and upper end (2, n) [deg] of ends of postures (2, 32, n) [rad]."""
    found, raised = np.degrees(ends), np.degrees(between_elevations(ends))
    judged = {name: found[:, joint] for name, joint in _JOINTS.items()}
    for name in judged:
        if "shoulder" in name:
            # Behind the body an elevation is negative.
            low, high = raised[:, _JOINTS[name]]
            both = np.sort(np.abs([low, high]), axis=0)
            judged[name] = np.stack([np.where(low * high < 0, 0.0, both[0]), both[1]])
    return judged


def _silent(found: Recording, truth: Recording) -> str:
    off = np.where(found.scored & truth.scored, outside(found, truth.postures), 0.0)
    if (off <= OFF).all():
        return ""
    return f"{(off > OFF).sum()} frames are scored up to {off.max():.0f} deg wrongly"


def _while(places: Places) -> slice:
    """Return a tenth of the frames."""
    count = len(places["neck"])
    return slice(count // 3, count // 3 + max(2, count // 10))
