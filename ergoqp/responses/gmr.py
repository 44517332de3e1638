"""The second model of the EPFL report: posture and cost in relation to the object's pose.

A Gaussian mixture over (x_r, q, V), fitted to a recording of a person at work (section 3.2). Its
regression on x_r says how posture and cost follow the object: eq. 2.8 is dq/dx_r. It knows the
postures that were recorded and nothing else: no body, no floor, no reach.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ergoqp.arguments import (
    LARGEST_SEED,
    Progress,
    check_kind,
    check_number,
    check_whole,
    names_of,
    read_array,
    shown,
    table_of_numbers,
    unseen,
)
from ergoqp.errors import InputError, ModelError, last_line
from ergoqp.expressions import read_pose, shifted
from ergoqp.joints import INDEX, JOINTS
from ergoqp.learning.mixtures import (
    Conditional,
    MixtureRegression,
    Prediction,
    estimate,
    mixture_of,
)
from ergoqp.learning.model_file import load_model, save_model
from ergoqp.responses.ik import IkResponse, response_as_dict, response_from_dict
from ergoqp.responses.stance_and_gaze import about_tool

Array = NDArray[np.float64]

COMPONENTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 24)
"""Numbers of Gaussians among which the Bayesian information criterion chooses."""

KIND: Final = "gmr_response"
"""Kind of the model, in its file."""

_MOVES: Final = (0.01, np.radians(2.0))
"""An object that moves less than this, by its standard deviation, shows nothing [m, rad]."""

_FARTHEST: Final = np.radians(150.0)
"""Largest turn from the mean: half a turn on, a rotation vector jumps [rad]."""

_STAYS: Final = np.radians(0.1)
"""A joint that moves less than this, by its standard deviation, is taken to stay [rad]."""


def mean_pose(poses: ArrayLike, free: bool = False) -> Array:
    """Return the mean (4, 4) of poses (n, 4, 4): of their positions, and of their rotations.

    If they are `free` to turn about their x axis, the tool's, only the mean of this axis counts.
    """
    poses = np.asarray(poses, dtype=float)
    mean, first, rotations = np.eye(4), poses[0, :3, :3], Rotation.from_matrix(poses[:, :3, :3])
    mean[:3, 3] = poses[:, :3, 3].mean(axis=0)
    mean[:3, :3] = rotations.mean().as_matrix()
    if free:
        axis = poses[:, :3, 0].mean(axis=0)
        swing = _swings(axis[np.newaxis] / np.linalg.norm(axis), first[:, 0])
        mean[:3, :3] = Rotation.from_rotvec(swing[0]).as_matrix() @ first
    return mean


def coordinates_of(poses: ArrayLike, mean: Array, free: bool = False) -> Array:
    """Return x_r (n, 6) of poses (n, 4, 4): position and rotation vector relative to a mean pose.

    Both are along the axes of the world [m, rad]. If the poses are `free` to turn about their x
    axis, the tool's, the rotation is the shortest one between these axes.
    """
    poses = np.asarray(poses, dtype=float)
    if free:
        turns = _swings(poses[:, :3, 0], mean[:3, 0])
    else:
        turns = Rotation.from_matrix(poses[:, :3, :3] @ mean[:3, :3].T).as_rotvec()
    return np.hstack([poses[:, :3, 3] - mean[:3, 3], turns])


def _swings(axes: Array, axis: Array) -> Array:
    """Return the shortest turns (n, 3) [rad] from a unit vector (3,) to others (n, 3)."""
    across = np.cross(axis, axes)
    sines = np.linalg.norm(across, axis=1)
    angles = np.arctan2(sines, axes @ axis)
    return across * (angles / np.maximum(sines, 1e-12))[:, np.newaxis]


def _independent(columns: Array) -> float:
    """Return the share of the rows of a recording (n, d) that counts as independent.

    Rows that follow each other are alike. It is one over the integral of the autocorrelation up to
    its first zero.
    """
    spectrum = np.fft.rfft(columns - columns.mean(axis=0), 2 * len(columns), axis=0)
    alike = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: len(columns)].sum(axis=1)
    ends = np.append(alike, 0.0) <= 0
    return float(alike[0] / (alike[0] + 2 * alike[1 : int(np.argmax(ends))].sum()))


@dataclass(frozen=True, eq=False)
class GmrResponse:
    """S(q) = dq/dx_r of a Gaussian mixture over (x_r, q, V), eq. 2.8 of the EPFL report.

    x_r is the pose of the contact frame. In the control step it follows from the posture, by the
    `contact` of a model person. If the hand may turn about the tool's axis, x_r does not count such
    turns. The step keeps all limits of the object with it as with any response. It is for study:
    far from what was recorded it extends a straight line, and along axes in which the object did
    not move, S is zero. `notebooks/07_second_model` compares it with the model person.

    Attributes:
        person: model person with the body, the hands and the tool of the recording.
        mixture: Gaussians over x_r (6), the joints, and V.
        joints: joints that move with the object, in the order of the mixture's columns.
        mean: pose (4, 4) that x_r is relative to, see `coordinates_of`.

    Raises:
        ModelError: if the mixture has a wrong number of columns, or no density over x_r.
        InputError: if a joint does not exist, or the mean is no rigid motion.

    Source:
        EPFL semester report, "Learning ergonomic human-robot interaction", section 3.2 and
        equations 2.4 to 2.8.
    """

    person: IkResponse
    mixture: MixtureRegression
    joints: tuple[str, ...]
    mean: Array

    coordinates = JOINTS
    largest = float(np.pi)

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        check_kind("person", self.person, IkResponse, "an IkResponse")
        check_kind("mixture", self.mixture, MixtureRegression, "a MixtureRegression")
        allowed = "names of ergoqp.JOINTS, each once"
        joints = names_of("joints", self.joints, allowed)
        if not set(joints) <= set(JOINTS) or len(set(joints)) < len(joints):
            raise InputError(f"joints: got {shown(joints)}, allowed {allowed}")
        columns, wanted = self.mixture.means.shape[1], 7 + len(joints)
        if columns != wanted:
            raise ModelError(
                f"gmr response: got a mixture of {columns} columns, allowed {wanted}: x_r,"
                f" {len(joints)} joints, V"
            )
        object.__setattr__(self, "joints", joints)
        read_pose("mean", self.mean)
        object.__setattr__(self, "mean", np.array(self.mean, dtype=float))
        _ = self.regression  # what has no density is found here and not in the loop

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields only; another process builds the expressions again."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @classmethod
    def fit(
        cls,
        postures: ArrayLike,
        poses: ArrayLike,
        cost: Callable[[Array], Array],
        person: IkResponse,
        components: int | Sequence[int] = COMPONENTS,
        seed: int = 0,
        *,
        regularisation: float = 1e-3,
        progress: Progress = unseen,
    ) -> Self:
        """Fit by EM. The number of Gaussians is the one with the lowest BIC.

        Rows of a recording that follow each other are alike, and BIC counts only as many as are
        independent. With all of them it would take many more Gaussians, which know the recording
        and nothing else.

        Args:
            postures: recorded (n, 32), in the order of time [rad].
            poses: pose of the object in each (n, 4, 4), in the world of the person's `contact`. Its
                frame is the contact frame [m].
            cost: V~, the first model; it gives the cost (n,) of postures.
            person: model person with the body, the hands and the tool of the recording.
            components: numbers of Gaussians to choose from, or one.
            seed: seed of the starts.
            regularisation: added to every variance, as a share of the column's.
            progress: called with the share that is done.

        Raises:
            InputError: if the arrays do not fit together, the object or the person never moves, the
                object turns too far, or there are fewer frames than one Gaussian needs.
            MissingExtraError: if scikit-learn is not installed.
        """
        count = len(table_of_numbers("postures", postures, InputError))
        postures = read_array("postures", postures, (count, len(JOINTS)), "numbers (n, 32)")
        poses = read_array("poses", poses, (count, 4, 4), f"poses ({count}, 4, 4)")
        if count < 2:
            raise InputError(f"postures: got {count} frames, allowed some for each Gaussian")
        check_whole("seed", seed, 0, LARGEST_SEED)
        check_number("regularisation", regularisation, 1e-9, 1.0)
        listed = isinstance(components, list | tuple | range)
        several: Sequence[Any] = (components if listed else [components]) or [None]
        for each in several:
            check_whole("components", each, 1)
        poses = np.array([read_pose("poses", pose) for pose in poses])
        free = person.free_about_tool
        mean = mean_pose(poses, free)
        x = coordinates_of(poses, mean, free)
        moves, turns = (float(np.sqrt(np.var(part, axis=0).sum())) for part in (x[:, :3], x[:, 3:]))
        if moves < _MOVES[0] and turns < _MOVES[1]:
            raise InputError(
                f"object: it moves by {1e3 * moves:.1f} mm and {np.degrees(turns):.1f} deg, which"
                " shows nothing of how the posture follows it; allowed a standard deviation from"
                f" {1e3 * _MOVES[0]:g} mm or {np.degrees(_MOVES[1]):g} deg on"
            )
        farthest = float(np.linalg.norm(x[:, 3:], axis=1).max())
        if farthest > _FARTHEST:
            raise InputError(
                f"object: it turns by {np.degrees(farthest):.0f} deg from its mean, allowed up to"
                f" {np.degrees(_FARTHEST):.0f} deg: take a part of the recording"
            )
        moved = np.flatnonzero(postures.std(axis=0) > _STAYS)
        if not moved.size:
            raise InputError("postures: no joint moves, which shows nothing of how they follow")
        values = read_array("cost", cost(postures), (count,), f"{count} numbers, one per posture")
        columns = np.column_stack([x, postures[:, moved], values])
        least = columns.shape[1] + 2
        fitting = [each for each in several if each * least <= count]
        if not fitting:
            raise InputError(
                f"postures: got {count} frames, allowed at least {min(several) * least}:"
                f" {least} for each Gaussian over {columns.shape[1]} columns"
            )
        # Columns of several units: each in its own standard deviation.
        scale = np.maximum(columns.std(axis=0), 1e-6)
        columns /= scale
        share, found = _independent(columns[:, :6]), {}
        for each, done in zip(fitting, np.cumsum(fitting), strict=True):
            fitted = estimate(columns, each, seed, "full", regularisation, "kmeans")
            likelihood = 2 * count * fitted.score(columns)
            size = (fitted.bic(columns) + likelihood) / np.log(count)
            found[size * np.log(max(2, count * share)) - share * likelihood] = fitted
            progress(float(done / sum(fitting)))
        best = mixture_of(found[min(found)])
        mixture = MixtureRegression(
            best.weights, best.means * scale, best.covariances * np.outer(scale, scale)
        )
        return cls(person, mixture, tuple(JOINTS[joint] for joint in moved), mean)

    @cached_property
    def regression(self) -> Conditional:
        """The regression of (q, V) on x_r, eq. 2.5 to 2.8, for arrays of `coordinates_of`."""
        return self.mixture.split(range(6), range(6, 7 + len(self.joints)))

    def x_r(self, poses: ArrayLike) -> Array:
        """Return x_r (n, 6) of poses of the object (n, 4, 4), see `coordinates_of`."""
        return coordinates_of(poses, self.mean, self.person.free_about_tool)

    def prediction(self, pose: ca.MX) -> Prediction:
        """Return joints and V (m + 1,) at a pose (4, 4) with covariance and derivative.

        All are expressions. The derivative (m + 1, 6) is along a twist in the axes of the world.
        """
        x, rates = self._coordinates(pose)
        found = self.regression.expression(x)
        return found._replace(derivative=found.derivative @ rates)

    def slopes(self) -> ca.Function:
        """Return ``pose (4, 4) -> (dq/dx_r (32, 6), dV/dx_r (1, 6))`` along a twist, eq. 2.8."""
        pose = ca.MX.sym("pose", 4, 4)
        derivative = self.prediction(pose).derivative
        rows = ca.DM(np.eye(len(JOINTS))[:, [INDEX[joint] for joint in self.joints]])
        S = ca.densify(ca.sparsify(rows) @ derivative[:-1, :])
        return ca.Function("slopes", [pose], [S, derivative[-1, :]], ["pose"], ["S", "dV"])

    @property
    def stance(self) -> str:
        """``"standing"`` or ``"seated"``."""
        return self.person.stance

    @property
    def weight_vector(self) -> np.ndarray:
        """Relative cost of moving each joint (32,): that of the model person."""
        return self.person.weight_vector

    @property
    def comfort(self) -> np.ndarray:
        """Comfort posture of the model person (32,) [rad]."""
        return self.person.comfort

    def expression(self, q: ca.MX) -> ca.MX:
        """Return S (32, 6) at `q` (32,) [rad]."""
        return self.sensitivity()(q, 0)[0]

    def contact(self) -> ca.Function:
        """Return ``q (32,) -> (contact pose (4, 4), pelvis pose (4, 4))`` of the model person."""
        return self.person.contact()

    def sensitivity(self) -> ca.Function:
        """Return ``(q (32,), locked (32,)) -> (S (32, 6), E (6, 6))``.

        With the Jacobian J of the contact, E is I - J S without turns about a free tool: the hand
        leaves the object by so much where the mixture moves it otherwise.
        """
        return self._sensitivity

    @cached_property
    def _sensitivity(self) -> ca.Function:
        q = ca.SX.sym("q", len(JOINTS))
        pose = self.contact()(q)[0]
        rotation, turns = pose[:3, :3], ca.jacobian(ca.vec(pose[:3, :3]), q)
        turning = [
            ca.inv_skew(ca.reshape(turns[:, joint], 3, 3) @ rotation.T)
            for joint in range(len(JOINTS))
        ]
        J = ca.vertcat(ca.jacobian(pose[:3, 3], q), ca.horzcat(*turning))
        kept = ca.SX.eye(6) - about_tool(rotation[:, 0], self.person.free_about_tool)
        parts = ca.cse([pose, ca.densify(kept), ca.densify(kept @ J)])
        geometry = ca.Function("geometry", [q], parts)
        state, locked = ca.MX.sym("q", len(JOINTS)), ca.MX.sym("locked", len(JOINTS))
        here, kept, jacobian = geometry(state)
        S = self.slopes()(here)[0] * ca.repmat(1 - locked, 1, 6)
        return ca.Function(
            "sensitivity",
            [state, locked],
            [S, kept - jacobian @ S],
            ["q", "locked"],
            ["sensitivity", "unmet"],
        )

    def _coordinates(self, pose: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return x_r (6,) of a pose, and its derivative (6, 6) along a twist."""
        here, twist, mean = ca.SX.sym("pose", 4, 4), ca.SX.sym("twist", 6), ca.DM(self.mean)
        moved = shifted(here, twist)
        if self.person.free_about_tool:
            across, cosine = ca.cross(mean[:3, 0], moved[:3, 0]), ca.dot(mean[:3, 0], moved[:3, 0])
        else:
            turn = moved[:3, :3] @ mean[:3, :3].T
            across, cosine = ca.inv_skew(turn - turn.T) / 2, (ca.trace(turn) - 1) / 2
        # No division by zero, at the mean and half a turn from it.
        sine = ca.sqrt(ca.sumsqr(across) + 1e-12)
        x = ca.vertcat(moved[:3, 3] - mean[:3, 3], across / sine * ca.atan2(sine, cosine))
        both = [x, ca.densify(ca.jacobian(x, twist))]
        at_rest = [ca.substitute(each, twist, ca.SX.zeros(6)) for each in both]
        found = ca.Function("coordinates", [here], ca.cse(at_rest))(pose)
        return found[0], found[1]

    def save(self, path: Path | str) -> None:
        """Write the model. It holds no code.

        Raises:
            ModelError: if the file cannot be written.
        """
        header = {
            "kind": KIND,
            "joints": list(self.joints),
            "person": response_as_dict(self.person),
        }
        arrays = {name: getattr(self.mixture, name) for name in ("weights", "means", "covariances")}
        save_model(path, header, arrays | {"mean": self.mean})

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Return the model that `save` wrote.

        Raises:
            ModelError: if there is no such file, or it holds something else.
        """
        header, arrays = load_model(path)
        if header.get("kind") != KIND:
            raise ModelError(
                f"{Path(path).name}: holds a model of kind {header.get('kind')!r}, allowed {KIND!r}"
            )
        try:
            mean, person = arrays.pop("mean"), response_from_dict(header["person"])
            return cls(person, MixtureRegression(**arrays), header["joints"], mean)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ModelError(
                f"{Path(path).name}: does not hold what a model of kind {KIND!r} needs"
                f" ({last_line(error)})"
            ) from None
