"""Shoulder joints below acromion markers that slide when the arm is raised.

When an arm is raised, the skin over the acromion moves up and inward, and the acromion turns about
the joint. The joint is then not as far below the marker as while the arm hangs. The difference is
the slide s(e), which depends on the elevation e of the upper arm, in the axes of the trunk:
joint = joint below the marker + offset - s(e).

The marker outside the elbow keeps its distance from the joint, whatever the rotation of the arm: it
moves on a sphere about the joint. Offset, slide and radius are those of the best sphere. A sphere
shows only the part of the slide that is along the arm. So the slide is sought near a share of the
displacement d(e) that the marker itself has in the trunk, on average at an elevation. The rest of
d(e), and what does not depend on the elevation, is movement of the shoulder girdle, and the joint
moves with it. The result is the mean of a Gaussian, found by Gauss-Newton steps. Its covariance
gives the doubt about the direction of the upper arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

_KNOTS: Final = np.array([0.0, 30.0, 60.0, 90.0, 120.0, 150.0])
"""Elevations between which displacement and slide are linear [deg]; above, they are constant. At
the first, both are zero."""
_COUNT: Final = len(_KNOTS) - 1
_HANGING: Final = 35.0
_RAISED: Final = 50.0
"""Elevations up to which an arm hangs, and above which it is raised [deg]. They are those of the
marker outside the elbow, which adds 9 deg."""
_FEW: Final = 10
"""Least number of frames with a raised arm, and number of frames with which a cell counts fully."""
_ENOUGH: Final = 2000
"""Largest number of frames that are used."""
_CELL: Final = 0.2
"""Size of cells of directions. All frames of a cell count as one measurement: their errors are
alike."""
_DIRECTIONS: Final = 4
"""Least number of cells that show a sphere."""
_LEAST: Final = 0.006
"""Largest slide that is taken as none [m]: 1.2 deg of an upper arm."""
_SHARE: Final = (0.65, 0.35)
"""Mean and standard deviation of the share of the displacement that is slide, of each axis."""
_DEVIATES: Final = (0.006, 0.1, 0.3, 2.0)
"""Standard deviation of the slide at a knot from that share: a constant [m], and shares of the
displacement, of its own standard deviation, and of what the displacement leaves of the marker's
movement above the noise: whoever shrugs does it a few times, which no average removes."""
_OFFSET: Final = 0.005
"""Standard deviation of a coordinate of the offset [m]."""
_RADIUS: Final = ((1.0, 0.03), (0.95, 0.05))
"""Radius and its standard deviation, as shares of the length of the hanging arm, or of the lowest
third: a marker that slides makes the arm longer."""
_STEP: Final = (0.03, 0.01)
"""Usual first and second differences of the displacement between knots [m]."""
_NOISE: Final = (0.004, 0.012)
"""Range of the standard deviation of lengths and displacements in a cell [m]."""
_FAR: Final = 0.02
"""Deviation of a length at which a frame weighs half [m]."""
_ROUNDS: Final = 6
_WIDE: Final = 1.3
"""Factor on the standard deviation across the arm for the half-angle."""
_USUALLY: Final = 3.0
"""Factor on its usual deviation up to which a length shows no slide."""


@dataclass(frozen=True, eq=False)
class Sliding:
    """How the acromion's marker of a side slides, in the axes ahead, left and up of the trunk.

    Attributes:
        offset: of the joint from where it is below the marker (3,) [m].
        slide: of the marker at the elevations `_KNOTS` but the first (k, 3) [m].
        radius: distance of the joint from the marker outside the elbow [m].
        usual: usual deviation of that distance [m].
        covariance: of the joint's place, for each degree of elevation (181, 3, 3) [m^2].
        highest: highest elevation [deg].
        hangs: whether the arm hangs in some frames.
        shown: whether the arm points in enough directions to show the sphere.
    """

    offset: np.ndarray
    slide: np.ndarray
    radius: float
    usual: float
    covariance: np.ndarray
    highest: float
    hangs: bool
    shown: bool

    def at(self, elevation: np.ndarray) -> np.ndarray:
        """Return the slide at elevations (n,) [deg] as (n, 3) [m]."""
        return _shares(elevation) @ self.slide

    @property
    def slides(self) -> bool:
        """Whether the joint is moved; else all are left where they are below the marker."""
        moved = self.offset - self.at(np.minimum(_KNOTS, self.highest))
        return self.shown and float(np.linalg.norm(moved, axis=1).max()) >= _LEAST

    def joint(
        self, below: np.ndarray, elbow: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the joint (n, 3) [m], and the doubt about the upper arm (n,) [rad].

        The doubt is the half-angle by which the direction of the upper arm may be off. Where elbow
        or trunk are not seen, the joint is the given one.

        Args:
            below: joint below a marker that does not slide (n, 3) [m]; NaN where not seen.
            elbow: marker outside the elbow (n, 3) [m]; NaN where not seen.
            axes: axes of the trunk as rows (n, 3, 3).
        """
        arm = turned(axes, elbow - below)
        seen = np.isfinite(arm).all(axis=1)
        raised = np.where(seen, elevation_of(arm), 0.0)
        slid = self.at(raised)
        arm = arm - (self.offset - slid)
        length = np.linalg.norm(arm, axis=1, keepdims=True)
        along = arm / np.where(length > 0, length, 1)
        spread = self.covariance[np.rint(raised).astype(int)]
        across = np.trace(spread, axis1=1, axis2=2) - np.einsum(
            "ni,nij,nj->n", along, spread, along
        )
        off = np.abs(length[:, 0] - self.radius)
        doubt = np.hypot(_WIDE * np.sqrt(np.maximum(across, 0.0)), off) / self.radius
        calm = (np.linalg.norm(slid, axis=1) < _LEAST) & (off < _USUALLY * self.usual) & self.hangs
        if self.slides:
            moved = np.einsum("nij,ni->nj", axes, self.offset - slid)
            below = np.where(np.expand_dims(seen, 1), below + moved, below)
        return below, np.where(seen & ~calm, doubt, 0.0)


def axes_of(down: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return the axes ahead, left and up of a trunk as rows (n, 3, 3).

    Args:
        down: direction down the trunk (n, 3).
        left: direction to its left, perpendicular to it (n, 3).
    """
    return np.stack([np.cross(down, left), left, -down], axis=1)


def turned(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) in some axes, given as rows (n, 3, 3)."""
    return np.einsum("nij,nj->ni", axes, vectors)


def elevation_of(arm: np.ndarray) -> np.ndarray:
    """Return the angles between down and vectors in the axes of the trunk (n, 3) as (n,) [deg]."""
    return np.degrees(np.arctan2(np.hypot(arm[:, 0], arm[:, 1]), -arm[:, 2]))


def sliding_of(arm: np.ndarray, marker: np.ndarray) -> Sliding | None:
    """Return how the acromion's marker of a side slides; None if the arm is raised in few frames.

    Args:
        arm: from the joint below the marker to the marker outside the elbow, in the axes of the
            trunk (n, 3) [m]; NaN where not seen, here and below.
        marker: acromion's marker from a place on the trunk, in those axes (n, 3) [m].
    """
    seen = np.isfinite(arm).all(axis=1) & np.isfinite(marker).all(axis=1)
    length = np.linalg.norm(arm, axis=1)
    usual = float(np.median(length[seen])) if seen.any() else 0.0
    # Markers that are exchanged or have fallen off are left out.
    seen &= np.abs(length - usual) < usual / 2
    if not seen.any():
        return None
    rows = np.flatnonzero(seen)
    rows = rows[:: -(-len(rows) // _ENOUGH)]
    arm, marker, length = arm[rows], marker[rows], length[rows]
    raised = elevation_of(arm)
    if (raised > _RAISED).sum() < _FEW:
        return None
    cells = np.rint(arm / length[:, None] / _CELL).astype(int) @ [1, 100, 10_000]
    _, cell, count = np.unique(cells, return_inverse=True, return_counts=True)
    weight = 1 / np.maximum(count[cell], _FEW)
    shares = _shares(raised)
    moves, error, rest = _displacement(shares, marker, weight)

    lowest = float(np.quantile(raised, 0.05))
    hangs = lowest <= _HANGING
    low = raised <= (_HANGING if hangs else np.quantile(raised, 1 / 3))
    radius, spread = np.array(_RADIUS[0 if hangs else 1]) * float(np.median(length[low]))
    anyhow = _DEVIATES[0] + _DEVIATES[3] * (rest - _NOISE[0])
    deviates = np.hypot(np.hypot(anyhow, _DEVIATES[1] * moves), _DEVIATES[2] * error)
    # Offset, share of each axis, deviation at each knot, and radius.
    prior = np.array([*3 * [0.0], *3 * [_SHARE[0]], *np.zeros(3 * _COUNT), radius])
    sure = np.array([*3 * [_OFFSET], *3 * [_SHARE[1]], *deviates.ravel(), spread]) ** -2
    slopes, found, noise = _slopes(shares, moves), prior, _NOISE[0]
    covariance = np.diag(1 / sure)
    for _ in range(_ROUNDS):
        bone = arm - slopes @ found
        length = np.linalg.norm(bone, axis=1)
        off = length - found[-1]
        rows = -np.einsum("ni,nip->np", bone / length[:, None], slopes)
        rows[:, -1] = -1.0
        weighted = rows * (weight / (1 + (off / _FAR) ** 2) / noise**2)[:, None]
        covariance = np.linalg.inv(weighted.T @ rows + np.diag(sure))
        found = found - covariance @ (weighted.T @ off + (found - prior) * sure)
        usual = max(1.4826 * float(np.median(np.abs(off))), _NOISE[0] / 2)
        noise = float(np.clip(1.5 * usual, *_NOISE))
    every = _slopes(_shares(np.arange(181.0)), moves)
    return Sliding(
        offset=found[:3],
        slide=found[3:6] * moves + found[6:-1].reshape(_COUNT, 3),
        radius=float(found[-1]),
        usual=usual,
        covariance=every @ covariance @ np.swapaxes(every, 1, 2),
        highest=float(np.quantile(raised, 0.995)),
        hangs=hangs,
        shown=len(count) >= _DIRECTIONS,
    )


def _shares(elevation: np.ndarray) -> np.ndarray:
    """Return the shares of all knots but the first at elevations (n,) [deg] as (n, k)."""
    return np.stack([np.interp(elevation, _KNOTS, row) for row in np.eye(_COUNT + 1)[1:]], axis=1)


def _displacement(
    shares: np.ndarray, marker: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return a marker's mean displacement at each knot (k, 3) [m], and its error (k, 1) [m].

    Last is how far the marker is from that displacement, root of the mean square [m].

    Where the take shows no elevation, the displacement changes as steeply as beside: it is zero for
    a hanging arm even if none hangs.
    """
    terms = np.column_stack([np.ones(len(shares)), shares])
    steps = np.pad(np.eye(_COUNT) - np.eye(_COUNT, k=-1), [(0, 0), (1, 0)]) / _STEP[0]
    rough = np.vstack([steps, np.diff(steps, axis=0) * _STEP[0] / _STEP[1]])
    found, noise, error = np.zeros((_COUNT + 1, 3)), _NOISE[0], np.zeros((_COUNT + 1, 1))
    for _ in range(3):
        weighted = terms * weight[:, None] / noise**2
        covariance = np.linalg.inv(weighted.T @ terms + rough.T @ rough)
        found, error = covariance @ weighted.T @ marker, np.sqrt(np.diag(covariance))[:, None]
        left = ((marker - terms @ found) ** 2).mean(axis=1)
        noise = max(_NOISE[0], float(np.sqrt(weight @ left / weight.sum())))
    return found[1:], error[1:], noise


def _slopes(shares: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return the slopes of the joint's place by the unknowns (n, 3, unknowns)."""
    found, axis = np.zeros((len(shares), 3, 7 + 3 * _COUNT)), np.arange(3)
    found[:, axis, axis] = 1.0
    found[:, axis, 3 + axis] = -shares @ moves
    for knot in range(_COUNT):
        found[:, axis, 6 + 3 * knot + axis] = -shares[:, knot, None]
    return found


def sliding_said(sliding: Mapping[str, Sliding], doubts: Mapping[str, np.ndarray]) -> list[str]:
    """Return a sentence about the markers that slide, or none if none does.

    Args:
        sliding: side -> how its marker slides.
        doubts: ``right_upper_arm``, ``left_upper_arm`` -> half-angle by which its direction may be
            off (n,) [rad].
    """
    far = {
        side: f"{side} {1000 * np.linalg.norm(each.at(np.array([each.highest]))):.0f} mm at"
        f" {each.highest:.0f} deg of elevation"
        for side, each in sliding.items()
        if each.slides
    }
    if not far:
        return []
    off = max(np.degrees(np.quantile(doubts[f"{side}_upper_arm"], 0.95)) for side in far)
    return [
        f"When an arm is raised, the acromion's marker slides: {', '.join(far.values())}. That"
        " shoulder is placed by the sphere on which the elbow moves about it, and the direction of"
        f" its upper arm may be off by {off:.0f} deg."
    ]
