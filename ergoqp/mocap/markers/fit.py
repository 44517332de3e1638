"""Places of markers on the fitted body, lost markers, and names that do not fit to places.

Assignment of markers to landmarks of the body, and checks that they are where their names say.

Check that markers are where their names say, by orders that every body has.

A marker that is named wrongly for the whole take keeps its distances, so the other checks do not
notice it. But the markers along a limb have an order, both sides are equally long, left is to the
left, and the face is in front. A violation counts if it lasts nearly all the time, because a marker
may also fall off early in the take.

Detection of limb markers that do not keep their distances: exchanged or fallen off. Two or three
markers are not a rigid shape that can be tracked (`ergoqp.mocap.markers.rigid`). But along a limb
each marker keeps its distance from its neighbours, as far as skin and joints allow.

Places of markers on the fitted body: their offsets and residuals. One function serves all people
and all marker sets: the person's lengths and the markers' offsets are its inputs, so nothing is
compiled again.

Estimation of lost markers: postures from the markers that are seen.

A few Gauss-Newton steps solve many frames at once. The joints stay within their ranges and are
weakly pulled to the posture of the first fit. A marker that is far from its place on the body
weighs less (Cauchy's loss). The standard deviation of a marker that is not seen follows from the
curvature: it is small only if nearby markers determine the marker. Lengths and offsets are inputs
of the one compiled function.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from itertools import islice
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.human import Body, Kinematics
from ergoqp.human.body import Marker, base_jacobian
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER, spoken
from ergoqp.mocap.fitting.neutral import first_middle
from ergoqp.mocap.formats.text import some
from ergoqp.mocap.markers.rigid import brought_to, shape_of
from ergoqp.mocap.naming import LANDMARK_SEGMENTS, RIGID, evaluated, growth_of, of_any_body
from ergoqp.mocap.recording import JointMotion

_NEARLY_ALL: Final = 0.9
"""Share of the frames in which a violation has to occur."""
_ALONG: Final = (
    ("acromion", "upper_arm", "outer_elbow"),
    ("outer_elbow", "forearm", "wrist_thumb"),
    ("outer_elbow", "wrist_thumb", "hand"),
    ("outer_elbow", "wrist_small", "hand"),
    ("asis", "thigh", "outer_knee"),
    ("outer_knee", "shank", "outer_ankle"),
    ("outer_ankle", "heel", "forefoot"),
)
"""The second landmark is nearer to the first than the third is, on each side."""
_UP: Final = (("back", "c7"), ("xiphoid", "notch"))
"""The first landmark is nearer to the hips than the second."""
_ALIKE: Final = (
    ("acromion", "outer_elbow"),
    ("outer_elbow", "wrist_thumb"),
    ("asis", "outer_knee"),
    ("outer_knee", "outer_ankle"),
    ("outer_ankle", "forefoot"),
)
"""Pairs of landmarks that are equally far apart on the right and on the left."""
_UNLIKE: Final = 1.35
"""Largest ratio of the distances on both sides."""
_APART: Final = (
    ("outer_elbow", "acromion", 0.15),
    ("wrist_thumb", "acromion", 0.20),
    ("wrist_small", "acromion", 0.20),
    ("thigh", "asis", 0.08),
    ("outer_knee", "asis", 0.10),
    ("shank", "asis", 0.10),
    ("outer_ankle", "asis", 0.15),
)
"""Landmark, pair that defines the sideways direction, and how far crossed limbs may cross [m]."""
_WIDE: Final = 0.14
"""Largest width of a wrist between its two markers [m]: a wrist is up to 8 cm wide, and the markers
of a bar across it stand up to 3 cm off the skin on each side."""

AS_STATED: Final = "The markers are where their names say, as stated"
"""Begin of the sentence about markers in impossible places whose names are trusted."""


def check_order(where: str, at: Mapping[str, np.ndarray], *, trusted: bool = False) -> list[str]:
    """Raise if markers cannot be where their names say.

    Args:
        where: the recording's name, for messages.
        at: landmark -> positions (n, 3) [m] in a sample of frames; NaN where not seen.
        trusted: whether the names are right, wherever the markers are.

    Returns:
        A sentence with all such markers if the names are trusted; else none.

    Raises:
        RecordingError: if so, with the first landmarks.
    """
    found = list(_impossible(at)) if trusted else list(islice(_impossible(at), 1))
    if not found:
        return []
    if not trusted:
        raise RecordingError(
            f"{where}: got markers in impossible places ({found[0]}), allowed markers where their"
            " names say; exchange their names (mapping), reverse a mirrored axis, or state that"
            " the names are right (trust names)"
        )
    return [f"{AS_STATED}, although {some(found, 4, longest=90)}."]


def _impossible(at: Mapping[str, np.ndarray]) -> Iterator[str]:
    for side in SIDES:
        for names in _ALONG:
            origin, near, far = (f"{side}_{name}" for name in names)
            if origin in at and near in at and far in at:
                yield from _beyond(origin, at[origin], near, far, at)
        pair = [f"{side}_wrist_{which}" for which in ("thumb", "small")]
        if all(name in at for name in pair):
            wide = _lengths(at[pair[0]] - at[pair[1]])
            if _nearly_always(wide - _WIDE):
                yield f"the {side} wrist is {_cm(wide)} wide between its markers"
    for one, other in _ALIKE:
        if all(f"{side}_{name}" in at for side in SIDES for name in (one, other)):
            right, left = (_lengths(at[f"{side}_{one}"] - at[f"{side}_{other}"]) for side in SIDES)
            longer = np.maximum(right, left) - _UNLIKE * np.minimum(right, left)
            if _nearly_always(longer):
                yield (
                    f"{spoken(one)} and {spoken(other)} are {_cm(right)} apart on the right and"
                    f" {_cm(left)} on the left"
                )
    yield from _turned(at)


def _beyond(
    origin: str, place: np.ndarray, near: str, far: str, at: Mapping[str, np.ndarray]
) -> Iterator[str]:
    """Yield an error in words if the first of two landmarks is not nearer to a place (n, 3)."""
    if _nearly_always(_lengths(at[near] - place) - _lengths(at[far] - place)):
        yield f"{spoken(near)} is farther from {spoken(origin)} than {spoken(far)}"


def _turned(at: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield errors in words: sides that are exchanged, and fronts that are behind."""
    across: dict[str, np.ndarray] = {}
    for name in ("asis", "acromion"):
        if all(f"{side}_{name}" in at for side in SIDES):
            left = at[f"left_{name}"] - at[f"right_{name}"]
            across[name] = left / np.maximum(_lengths(left)[:, None], 1e-9)
    for name, reference, most in _APART:
        if reference in across and all(f"{side}_{name}" in at for side in SIDES):
            apart = at[f"left_{name}"] - at[f"right_{name}"]
            if _nearly_always(-(apart * across[reference]).sum(axis=1) - most):
                yield f"the left {spoken(name)} is to the right of the right one"
    if "asis" not in across:
        return
    hips = (at["left_asis"] + at["right_asis"]) / 2
    for near, far in _UP:
        if near in at and far in at:
            yield from _beyond("hips", hips, near, far, at)
    if "acromion" not in across:
        return
    up = (at["left_acromion"] + at["right_acromion"]) / 2 - hips
    for which, front, behind in (
        ("acromion", "notch", "c7"),
        ("acromion", "xiphoid", "back"),
        ("acromion", "head_front", "head_back"),
        ("asis", "asis", "psis"),
    ):
        before, after = (
            first_middle(at, (name,), (f"right_{name}", f"left_{name}")) for name in (front, behind)
        )
        if before is None or after is None:
            continue
        ahead = np.cross(across[which], up)
        if _nearly_always(((after - before) * ahead).sum(axis=1)):
            yield f"{spoken(front)} is behind {spoken(behind)}"


def _nearly_always(values: np.ndarray) -> bool:
    """Return whether values (n,) are above zero in nearly all frames that have one."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and float((known > 0).mean()) >= _NEARLY_ALL


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=1)


def _cm(lengths: np.ndarray) -> str:
    return f"{100 * np.nanmedian(lengths):.0f} cm"


SIZE: Final = 4 + len(JOINTS)
"""Number of variables of a pelvis and a posture."""
SEGMENTS: Final = (
    "pelvis",
    "trunk",
    "head",
    *(
        f"{side}_{name}"
        for side in SIDES
        for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    ),
)
"""One frame of each segment that markers may be fixed to."""


def segments(z: ca.SX, kinematics: Kinematics, yaw: ca.SX) -> Iterator[tuple[ca.SX, ca.SX, ca.SX]]:
    """Yield position (3,) [m], axes (3, 3) and Jacobian (6, 36) of `SEGMENTS` in the world.

    Args:
        z: pelvis and posture, from `of_any_body`.
        kinematics: the body, from there.
        yaw: its yaw, from there.
    """
    for frame in SEGMENTS:
        place, turn, jacobian = kinematics.at(frame, z[4:])
        own = ca.vertcat(yaw @ jacobian[:3, :], yaw @ jacobian[3:, :])
        moved = ca.horzcat(base_jacobian(yaw @ place), own)
        yield z[:3] + yaw @ place, yaw @ turn, moved


_BLOCK: Final = 4096
_ROUNDS: Final = 3
_ASTRAY: Final = 3.0
"""Positions farther away than this many times the median are not used for a marker's place."""


def markers_on(
    body: Body,
    pelvis: np.ndarray,
    postures: np.ndarray,
    markers: Mapping[str, np.ndarray],
    landmarks: Mapping[str, str],
) -> dict[str, Marker]:
    """Return the places of markers on a body: each on the nearby segment with which it moves.

    The markers of pelvis, trunk or head are all on one segment, in the shape that they keep: a
    tilting pelvis rotates against both segments to which its markers may be fixed.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].
        markers: name -> positions (n, 3) [m]; NaN where not seen.
        landmarks: name -> the landmark that it marks, or the segment that it is on.
    """
    turns, places = _frames(body, pelvis, postures)
    found: dict[str, Marker] = {}
    for names in _together(markers, landmarks):
        best: tuple[float, str, list[np.ndarray]] | None = None
        mark = landmarks[names[0]]
        for frame in LANDMARK_SEGMENTS.get(mark, [mark]):
            i = SEGMENTS.index(frame)
            local = [
                np.einsum("nji,nj->ni", turns[:, i], markers[name] - places[:, i]) for name in names
            ]
            offsets, usual = zip(*map(_fit_middle, local), strict=True)
            if best is None or sum(usual) < best[0]:
                best = (sum(usual), frame, list(offsets))
        assert best is not None
        _, frame, offsets = best
        shape = shape_of(np.stack([markers[name] for name in names], axis=1))
        if shape is not None and (rigid := brought_to(shape, np.array(offsets))) is not None:
            # A marker that is never seen with the others is not in the shape.
            offsets = list(np.where(np.isfinite(rigid[0]), rigid[0], offsets))
        for name, offset in zip(names, offsets, strict=True):
            away = np.linalg.norm(markers[name] - _placed(turns, places, frame, offset), axis=1)
            away = away[np.isfinite(away)]
            residual = float(np.sqrt(np.mean(away**2)))
            found[name] = Marker(
                frame, (float(offset[0]), float(offset[1]), float(offset[2])), residual
            )
    lost = Marker("pelvis", (0.0, 0.0, 0.0), float("nan"))
    return {name: found.get(name, lost) for name in markers}


def places_of_markers(
    body: Body, pelvis: np.ndarray, postures: np.ndarray, sits: Mapping[str, Marker]
) -> dict[str, np.ndarray]:
    """Return marker -> positions (n, 3) [m], from its place on a body.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].
        sits: marker -> its place on the body, from `markers_on`.
    """
    turns, places = _frames(body, pelvis, postures)
    return {
        name: _placed(turns, places, each.frame, np.array(each.offset))
        for name, each in sits.items()
    }


def _placed(turns: np.ndarray, places: np.ndarray, frame: str, offset: np.ndarray) -> np.ndarray:
    """Return a marker (n, 3) [m] on one of the frames (rotations n, f, 3, 3; places n, f, 3)."""
    i = SEGMENTS.index(frame)
    return places[:, i] + turns[:, i] @ offset


def _together(
    markers: Mapping[str, np.ndarray], landmarks: Mapping[str, str]
) -> list[tuple[str, ...]]:
    """Return groups of the markers that are seen: a rigid segment's together, others alone."""
    groups: dict[str, tuple[str, ...]] = {}
    for name, path in markers.items():
        if np.isfinite(path).all(axis=1).any():
            mark = landmarks[name]
            rigid = (part for part, parts in RIGID.items() if mark in (part, *parts))
            group = next(rigid, name)
            groups[group] = (*groups.get(group, ()), name)
    return list(groups.values())


def _fit_middle(local: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the mean of points (n, 3) without outliers, and the median distance from it."""
    local = local[np.isfinite(local).all(axis=1)]
    offset = np.median(local, axis=0)
    for _ in range(_ROUNDS):
        away = np.linalg.norm(local - offset, axis=1)
        near = away <= _ASTRAY * max(float(np.median(away)), 1e-6)
        offset = local[near].mean(axis=0)
    return offset, float(np.sqrt(np.median(((local - offset) ** 2).sum(axis=1))))


def _frames(body: Body, pelvis: np.ndarray, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (n, f, 3, 3) and positions (n, f, 3) [m] of `SEGMENTS`."""
    values = evaluated(_function(), body, pelvis, postures).T.reshape(-1, len(SEGMENTS), 4, 3)
    return np.swapaxes(values[:, :, 1:], 2, 3), values[:, :, 0]


@cache
def _function() -> ca.Function:
    """Return a function: pelvis and posture (36,), growth (14,) -> position and axes of each."""
    z, growth, body, yaw = of_any_body()
    rows = [part for place, turn, _ in segments(z, body, yaw) for part in (place, ca.vec(turn))]
    return ca.Function("frames", [z, growth], [ca.densify(ca.cse(ca.vertcat(*rows)))])


_SOLVED_BLOCK: Final = 512
"""Frames that are solved at once; the curvatures of more would need much memory."""
_SKIN: Final = 0.01
"""Least standard deviation of a marker on the skin [m]."""
_ANEW: Final = 1.5
"""Factor on a marker's residual for its own error where it is not seen: the fit follows the markers
that are seen, and in a new posture the skin moves otherwise."""
_FAR: Final = (0.3, 0.3, 0.15, 0.08, 0.03, 0.03)
"""Distance at which a marker weighs half [m], per round: a limb may start far from its place."""
_DRAWN: Final = np.array([0.2, 0.2, 0.2, 0.5, *np.full(len(JOINTS), 0.35)])
"""Standard deviation of the posture from the one it is pulled to: position [m], angles [rad]."""


def told_markers(
    body: Body, start: np.ndarray, markers: Mapping[str, np.ndarray], sits: Mapping[str, Marker]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return estimated positions of markers from those that are seen, and standard deviations.

    Args:
        body: the person.
        start: pelvis and posture to start from and to be pulled to (n, 36).
        markers: name -> positions (n, 3) [m]; NaN where not seen.
        sits: name -> place on the body.

    Returns:
        Name -> positions (n, 3) [m], and name -> standard deviation (n,) [m], of every marker.
    """
    names = [name for name in markers if np.isfinite(sits[name].residual)]
    frames = np.array([SEGMENTS.index(sits[name].frame) for name in names])
    offsets = np.array([sits[name].offset for name in names])
    residuals = np.array([sits[name].residual for name in names])
    exact, anew = np.maximum(residuals, _SKIN), np.maximum(_ANEW * residuals, _SKIN)
    growth = growth_of(body)
    places, spread = [], []
    for at in range(0, len(start), _SOLVED_BLOCK):
        rows = slice(at, at + _SOLVED_BLOCK)
        seen = np.stack([markers[name][rows] for name in names], axis=1)
        place, sure = _solved(start[rows], growth, seen, frames, offsets, exact)
        places.append(place)
        spread.append(np.sqrt(sure**2 + anew**2))
    place, sure = np.concatenate(places), np.concatenate(spread)
    return (
        {name: place[:, i] for i, name in enumerate(names)},
        {name: sure[:, i] for i, name in enumerate(names)},
    )


def _solved(
    start: np.ndarray,
    growth: np.ndarray,
    seen: np.ndarray,
    frames: np.ndarray,
    offsets: np.ndarray,
    exact: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return estimated positions of markers (n, m, 3) and their standard deviations (n, m) [m]."""
    z = start.copy()
    lower = np.concatenate([np.full(4, -np.inf), LOWER])
    upper = np.concatenate([np.full(4, np.inf), UPPER])
    drawn = 1 / _DRAWN**2
    for half in _FAR:
        place, slope = _placed_with_slope(z, growth, frames, offsets)
        curved, pull = _normal(place, slope, seen, exact, half)
        pull += drawn * (start - z)
        step = np.linalg.solve(curved + np.diag(drawn), pull[:, :, None])[:, :, 0]
        z = np.clip(z + np.clip(step, -0.5, 0.5), lower, upper)
    place, slope = _placed_with_slope(z, growth, frames, offsets)
    curved, _ = _normal(place, slope, seen, exact, _FAR[-1])
    unsure = np.linalg.inv(curved + np.diag(drawn))
    flat = slope.reshape(len(z), -1, SIZE)
    spread = ((flat @ unsure) * flat).sum(axis=2).reshape(*seen.shape[:2], 3).sum(axis=2)
    return place, np.sqrt(np.maximum(spread, 0.0))


def _normal(
    place: np.ndarray, slope: np.ndarray, seen: np.ndarray, exact: np.ndarray, half: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the Hessian (n, 36, 36) and the negative gradient (n, 36) for the seen markers."""
    there = np.asarray(np.isfinite(seen).all(axis=2))
    miss = np.where(there[:, :, None], seen - place, 0.0)
    far = np.linalg.norm(miss, axis=2)
    weight = there / exact**2 / (1 + (far / np.maximum(half, 3 * exact)) ** 2)
    root = np.sqrt(weight)[:, :, None]
    rows = (root[..., None] * slope).reshape(len(place), -1, SIZE)
    across = np.swapaxes(rows, 1, 2)
    return across @ rows, (across @ (root * miss).reshape(len(place), -1, 1))[:, :, 0]


def _placed_with_slope(
    z: np.ndarray, growth: np.ndarray, frames: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return markers (n, m, 3) [m] and their Jacobians by pelvis and posture (n, m, 3, 36)."""
    values = _values(z, growth).reshape(len(z), len(SEGMENTS), -1)[:, frames]
    origin, turn = values[:, :, :3], values[:, :, 3:12].reshape(*values.shape[:2], 3, 3)
    moved = values[:, :, 12:].reshape(*values.shape[:2], SIZE, 6)
    # CasADi's matrices are stored by columns.
    arm = np.einsum("nmji,mj->nmi", turn, offsets)
    about = np.cross(moved[..., 3:], arm[:, :, None])
    return origin + arm, np.swapaxes(moved[..., :3] + about, 2, 3)


def _values(z: np.ndarray, growth: np.ndarray) -> np.ndarray:
    """Return the values of the compiled function, one row per frame."""
    function = _jacobian_function()
    given = np.zeros((_SOLVED_BLOCK, SIZE))
    given[: len(z)] = z
    lengths = np.tile(growth, (_SOLVED_BLOCK, 1))
    found = np.empty((_SOLVED_BLOCK, function.size1_out(0)))
    # The results go into NumPy's memory, because CasADi's matrices would take most of the time.
    # CasADi's stubs ask for a length, which these methods do not take.
    buffer, evaluate = function.buffer()
    for i, array in enumerate((given, lengths)):
        buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
    buffer.set_res(0, found.data)  # pyright: ignore[reportCallIssue]
    evaluate()
    return found[: len(z)]


@cache
def _jacobian_function() -> ca.Function:
    """Return a function: pelvis and posture, growth -> position, axes and Jacobian of segments."""
    z, growth, body, yaw = of_any_body()
    rows = [ca.vec(part) for parts in segments(z, body, yaw) for part in parts]
    one = ca.Function("segments", [z, growth], [ca.densify(ca.cse(ca.vertcat(*rows)))])
    return one.map(_SOLVED_BLOCK)


_LEAST: Final = 10
"""Least number of markers that are seen in a frame."""
_SURE: Final = 0.025
"""Largest standard deviation of an estimate that is used [m]; such an error turns a bone by about 5
degrees. In real takes, no gap that was filled has a larger error (`benchmarks.recording_told`)."""
_STEADY: Final = 0.03
"""Largest residual of a marker that is used and estimated [m]."""


def has_gaps(motion: JointMotion, used: Mapping[str, str]) -> bool:
    """Return whether a used marker that is seen at all is lost in some frame."""
    seen = (np.isfinite(motion.of(name)[:, 0]) for name in used)
    return any(each.any() and not each.all() for each in seen)


def completed(
    motion: JointMotion,
    sits: Mapping[str, Marker],
    body: Body,
    pelvis: np.ndarray,
    postures: np.ndarray,
    axes: np.ndarray,
    along: Mapping[str, np.ndarray],
) -> JointMotion | None:
    """Return the motion with lost markers as estimated from the others; None if none is.

    Args:
        motion: the markers, in the file's unit and axes.
        sits: used marker -> its place on the body.
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4), from a fit without the lost markers.
        postures: joint angles from the same fit (n, 32) [rad].
        axes: from the file's unit and axes to metres along ours (3, 3).
        along: marker -> shift of the fitted person against the recording (n, 3) [m], if any:
            everything above the hips is shifted if the skeleton leans and is straightened.
    """
    sits = {name: each for name, each in sits.items() if each.residual < _STEADY}
    if len(sits) < _LEAST:
        return None
    places = [motion.names.index(name) for name in sits]
    seen = np.isfinite(motion.positions[:, places, 0])
    gaps = np.flatnonzero(~seen.all(axis=1) & (seen.sum(axis=1) >= _LEAST))
    if not len(gaps):
        return None
    away = {name: along.get(name, np.zeros((len(motion.time), 1))) for name in sits}
    positions, back = motion.positions.copy(), np.linalg.inv(axes).T
    count, told = 0, np.zeros(len(motion.time), dtype=bool)
    for at in range(0, len(gaps), _BLOCK):
        rows = gaps[at : at + _BLOCK]
        markers = {
            name: motion.positions[rows, i].astype(float) @ axes.T + away[name][rows]
            for name, i in zip(sits, places, strict=True)
        }
        start = np.hstack([pelvis[rows], postures[rows]])
        found, spread = told_markers(body, start, markers, sits)
        for name, i in zip(sits, places, strict=True):
            put = np.isnan(markers[name][:, 0]) & (spread[name] < _SURE)
            positions[rows[put], i] = (found[name] - away[name][rows])[put] @ back
            count += int(put.sum())
            told[rows[put]] = True
    if not count:
        return None
    said = (
        f"In {int(told.sum())} of {len(told)} frames lost markers are estimated from the others,"
        f" with a standard deviation below {100 * _SURE:g} cm ({count} places)."
    )
    return replace(motion, positions=positions, notes=(*motion.notes, said))
