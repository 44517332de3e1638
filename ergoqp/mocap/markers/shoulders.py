"""Shoulder joints below acromion markers that slide when the arm is raised.

When an arm is raised, the skin over the acromion moves up and inward, and the acromion turns about
the joint. So the joint is not where it is below the marker of a hanging arm: it is lower and
further out by the slide. The slide s depends on the elevation e of the upper arm, in the axes of
the trunk: joint = joint below the marker + offset - s(e).

The marker outside the elbow keeps its distance from the joint, whatever the rotation of the arm. It
moves on a sphere, and offset, slide and radius are those with which it does so best. The sphere
alone shows only the part of the slide along the arm. So the slide is sought near a share of the
displacement d(e) that the acromion's marker itself has in the trunk on average at an elevation. The
rest of d(e), and all that does not go with the elevation, is a movement of the shoulder girdle and
is kept: the joint moves with it. This is the mean of a Gaussian, by Gauss-Newton steps, and its
covariance gives the doubt about the direction of the upper arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.human.body import stature_of
from ergoqp.joints import SIDES
from ergoqp.mocap.markers.rigid import usual_distance

_KNOTS: Final = np.array([0.0, 30.0, 60.0, 90.0, 120.0, 150.0])
"""Elevations between which displacement and slide are linear [deg]; above, they are constant."""
_COUNT: Final = len(_KNOTS) - 1
_SIZE: Final = 7 + 3 * _COUNT
"""Number of unknowns: offset (3), shares (3), deviations at each knot (3), and the radius."""
_RAISED: Final = 50.0
"""Elevation above which an arm is raised [deg]; a marker outside the elbow adds 9 deg to it."""
_HANGING: Final = 35.0
"""Elevation below which the marker has not slid [deg]."""
_FEW: Final = 10
"""Least number of frames with a raised arm."""
_LEAST: Final = 0.008
"""Largest slide that is not told from none [m]: 1.5 deg of an upper arm."""

_SHARE: Final = (0.65, 0.35)
"""Mean and standard deviation of the share of the displacement that is slide, per axis."""
_DEVIATES: Final = (0.004, 0.1, 0.3)
"""Standard deviation of the slide at a knot from that share: a constant [m], and the parts of the
displacement and of its standard deviation."""
_OFFSET: Final = 0.005
"""Standard deviation of a coordinate of the offset [m]."""
_BELOW: Final = 0.02
"""That of the slide at 120 deg [m], for takes in which no arm hangs and where it began is not
seen."""
_UPPER_ARM: Final = 0.174
"""Length of the upper arm as a share of the stature: between those of Drillis and Contini (1966),
0.186, and of de Leva (1996), 0.162."""
_LENGTH: Final = (0.03, 0.08)
"""Standard deviation of the radius, as a share: from hanging arms, and from the stature."""
_NOISE: Final = 0.004
"""Least standard deviation of lengths and displacements in one direction of the arm [m]."""
_NOISY: Final = (_NOISE, 0.012)
"""Range of the former as it is found in the take [m]."""
_STEP: Final = (0.03, 0.01)
"""Usual first and second differences of the displacement between knots [m]."""
_FAR: Final = 0.02
"""Deviation of a length at which a frame weighs half [m]."""
_CELL: Final = 0.2
"""Size of cells of directions; the frames of a cell weigh as one measurement, because their errors
are alike."""
_MOST: Final = 10
"""Number of frames from which a cell weighs fully."""
_ROUNDS: Final = 8
_WIDE: Final = 1.3
"""Factor on the standard deviation across the arm for the half-angle."""
_USUAL: Final = 3.0
"""Factor on the usual deviation of a length up to which it shows no slide."""


@dataclass(frozen=True, eq=False)
class Sliding:
    """Place of a side's shoulder joint below its marker, in the axes ahead, left, up of the trunk.

    Attributes:
        offset: of the joint from where it is below the marker (3,) [m].
        slide: of the marker at the elevations `_KNOTS` (k, 3) [m].
        radius: distance of the joint from the marker outside the elbow [m].
        covariance: of the joint's place, for each degree of elevation (181, 3, 3) [m^2].
        usual: usual deviation of that distance [m].
        highest: highest elevation [deg].
        hangs: whether the take shows a hanging arm.
    """

    offset: np.ndarray
    slide: np.ndarray
    radius: float
    covariance: np.ndarray
    usual: float
    highest: float
    hangs: bool

    def at(self, elevation: np.ndarray) -> np.ndarray:
        """Return the slide at elevations (n,) [deg] as (n, 3) [m]."""
        return np.stack([np.interp(elevation, _KNOTS, axis) for axis in self.slide.T], axis=1)

    @property
    def slides(self) -> bool:
        """Whether the marker slides by more than is told from nothing."""
        moved = self.offset - self.at(np.array([*_KNOTS[_KNOTS < self.highest], self.highest]))
        return float(np.linalg.norm(moved, axis=1).max()) >= _LEAST

    def joint(
        self, below: np.ndarray, elbow: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the joint (n, 3) [m], and the doubt about the upper arm (n,) [rad].

        The doubt is the half-angle by which the direction of the upper arm may be off. The joint is
        the given one where the elbow or the trunk is not seen, and everywhere if nothing slides.

        Args:
            below: joint below the marker as if it did not slide (n, 3) [m].
            elbow: marker outside the elbow (n, 3) [m].
            axes: axes of the trunk as rows (n, 3, 3).
        """
        arm = np.einsum("nij,nj->ni", axes, elbow - below)
        seen = np.isfinite(arm).all(axis=1)
        raised = elevation_of(np.where(seen[:, None], arm, [0.0, 0.0, -1.0]))
        slid = self.at(raised)
        arm = arm - (self.offset - slid)
        length = np.linalg.norm(arm, axis=1, keepdims=True)
        along = arm / np.where(length > 0, length, 1)
        spread = self.covariance[np.rint(raised).astype(int)]
        across = np.trace(spread, axis1=1, axis2=2)
        across = across - np.einsum("ni,nij,nj->n", along, spread, along)
        off = np.abs(length[:, 0] - self.radius)
        doubt = np.hypot(_WIDE * np.sqrt(np.maximum(across, 0.0)), off) / self.radius
        calm = (np.linalg.norm(slid, axis=1) < _LEAST) & (off < _USUAL * self.usual)
        doubt = np.where(seen & ~(calm & self.hangs), doubt, 0.0)
        if not self.slides:
            return below, doubt
        moved = np.einsum("nij,ni->nj", axes, self.offset - slid)
        return np.where(seen[:, None], below + moved, below), doubt


def axes_of(down: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return the axes ahead, left, up of a trunk as rows (n, 3, 3).

    Args:
        down: direction down the trunk (n, 3).
        left: direction to its left, perpendicular to it (n, 3).
    """
    return np.stack([np.cross(down, left), left, -down], axis=1)


def elevation_of(arm: np.ndarray) -> np.ndarray:
    """Return the angles of vectors in the axes of the trunk (n, 3) from down (n,) [deg]."""
    return np.degrees(np.arctan2(np.hypot(arm[:, 0], arm[:, 1]), -arm[:, 2]))


def usual_radius(centres: Mapping[str, np.ndarray], elbow: float) -> float:
    """Return the distance of a shoulder from the marker outside the elbow by proportions [m].

    It is NaN if no length of the person is known but that of the upper arm.

    Args:
        centres: joint centre -> positions (n, 3) [m].
        elbow: distance of the elbow's joint from its marker [m].
    """
    pairs = {
        segment: [(f"{side}_{one}", f"{side}_{other}") for side in SIDES]
        for segment, one, other in (
            ("forearm", "elbow", "wrist"),
            ("thigh", "hip", "knee"),
            ("shank", "knee", "ankle"),
        )
    }
    pairs["hip_width"] = [("right_hip", "left_hip")]
    lengths = {
        segment: float(np.mean(known))
        for segment, ends in pairs.items()
        if (known := [d for a, b in ends if np.isfinite(d := _distance(centres, a, b))])
    }
    if not lengths:
        return float("nan")
    return float(np.hypot(_UPPER_ARM * stature_of(lengths), elbow))


def _distance(centres: Mapping[str, np.ndarray], one: str, other: str) -> float:
    both = one in centres and other in centres
    return usual_distance(centres[one], centres[other]) if both else float("nan")


def sliding_of(arm: np.ndarray, marker: np.ndarray, radius: float) -> Sliding | None:
    """Return how a shoulder's marker slides; None if no arm is raised, or too little is seen.

    Args:
        arm: from the joint below the marker to the marker outside the elbow, in the axes of the
            trunk (n, 3) [m]; NaN where not seen, here and below.
        marker: the acromion's marker from a place on the trunk, in those axes (n, 3) [m].
        radius: usual length of these arms [m].
    """
    length = np.linalg.norm(arm, axis=1)
    seen = np.isfinite(marker).all(axis=1) & (np.abs(length - radius) < radius / 2)
    arm, marker, length = arm[seen], marker[seen], length[seen]
    raised = elevation_of(arm)
    if (raised > _RAISED).sum() < _FEW:
        return None
    cells = np.rint(arm / length[:, None] / _CELL)
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    weight = 1 / np.maximum(count[cell.ravel()], _MOST)
    shares = _shares(raised)
    moves, uncertain = _displacement(shares, marker, weight)

    lowest = float(np.quantile(raised, 0.05))
    hangs = lowest <= _HANGING
    unseen = 0.0 if hangs else _BELOW * lowest / 120
    if hangs:
        radius = float(np.median(length[raised <= _HANGING]))
    deviates = [_DEVIATES[0] + 0 * moves, _DEVIATES[1] * moves, _DEVIATES[2] * uncertain]
    spread = np.concatenate(
        [
            np.full(3, np.hypot(_OFFSET, unseen)),
            np.full(3, _SHARE[1]),
            np.linalg.norm(deviates, axis=0).ravel(),
            [_LENGTH[0 if hangs else 1] * radius],
        ]
    )
    prior = np.concatenate([np.zeros(3), np.full(3, _SHARE[0]), np.zeros(3 * _COUNT), [radius]])
    slopes, noise = _slopes(shares, moves), _NOISE
    found = np.concatenate([prior[:-1], [np.median(length)]])
    for _ in range(_ROUNDS):
        bone = arm - slopes @ found
        length = np.linalg.norm(bone, axis=1)
        off = length - found[-1]
        rows = -np.einsum("ni,nip->np", bone / length[:, None], slopes)
        rows[:, -1] = -1.0
        weighted = rows * (weight / (1 + (off / _FAR) ** 2) / noise**2)[:, None]
        curvature = weighted.T @ rows + np.diag(spread**-2)
        slope = weighted.T @ off + (found - prior) / spread**2
        found = found - np.linalg.solve(curvature, slope)
        usual = 1.4826 * float(np.median(np.abs(off)))
        noise = float(np.clip(1.5 * usual, *_NOISY))
    every = _slopes(_shares(np.arange(181.0)), moves)
    slide = found[3:6] * moves + found[6:-1].reshape(_COUNT, 3)
    return Sliding(
        offset=found[:3],
        slide=np.vstack([np.zeros(3), slide]),
        radius=float(found[-1]),
        covariance=every @ np.linalg.inv(curvature) @ np.swapaxes(every, 1, 2),
        usual=max(usual, _NOISE / 2),
        highest=float(np.quantile(raised, 0.995)),
        hangs=hangs,
    )


def _shares(elevation: np.ndarray) -> np.ndarray:
    """Return the weights of the knots but the first at elevations (n,) [deg] as (n, k - 1)."""
    return np.stack([np.interp(elevation, _KNOTS, row) for row in np.eye(_COUNT + 1)[1:]], axis=1)


def _displacement(
    shares: np.ndarray, marker: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a marker's mean displacement at each knot (k, 3), and its standard deviations [m].

    Without frames at an elevation it goes on as steeply as beside: a take that shows no hanging arm
    is thought to begin at a displacement of zero.
    """
    terms = np.column_stack([np.ones(len(shares)), shares])
    steps = np.pad(np.eye(_COUNT) - np.eye(_COUNT, k=-1), [(0, 0), (1, 0)])
    bends = np.diff(steps, axis=0)
    smooth = steps.T @ steps / _STEP[0] ** 2 + bends.T @ bends / _STEP[1] ** 2
    noise = _NOISE
    for _ in range(3):
        weighted = terms * weight[:, None] / noise**2
        curvature = weighted.T @ terms + smooth
        found = np.linalg.solve(curvature, weighted.T @ marker)
        left = ((marker - terms @ found) ** 2).mean(axis=1)
        noise = max(_NOISE, float(np.sqrt(weight @ left / weight.sum())))
    uncertain = np.sqrt(np.diag(np.linalg.inv(curvature)))
    return found[1:], np.repeat(uncertain[1:, None], 3, axis=1)


def _slopes(shares: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return the slopes of the joint's place by the unknowns (n, 3, unknowns)."""
    found, axis = np.zeros((len(shares), 3, _SIZE)), np.arange(3)
    found[:, axis, axis] = 1.0
    found[:, axis, 3 + axis] = -shares @ moves
    for knot in range(_COUNT):
        found[:, axis, 6 + 3 * knot + axis] = -shares[:, knot, None]
    return found


def sliding_said(sliding: Mapping[str, Sliding], doubts: Mapping[str, np.ndarray]) -> list[str]:
    """Return a sentence about the markers that slide, or none if none does.

    Args:
        sliding: side -> how its marker slides.
        doubts: upper arm -> half-angle by which its direction may be off (n,) [rad].
    """
    far = []
    for side, each in sliding.items():
        if each.slides:
            slid = float(np.linalg.norm(each.at(np.array([each.highest]))))
            half = np.degrees(np.quantile(doubts[f"{side}_upper_arm"], 0.95))
            far.append(f"{side} by {1000 * slid:.0f} mm at {each.highest:.0f} deg of elevation"
                       f" (the upper arm's direction may be off by {half:.0f} deg)")
    if not far:
        return []
    return [
        "The acromion's marker slides when the arm is raised:"
        f" {', '.join(far)}. The shoulder is not taken"
        " from this marker alone, but from the sphere on which the elbow moves about it."
    ]
