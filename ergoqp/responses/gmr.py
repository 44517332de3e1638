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
    read_array,
    unseen,
)
from ergoqp.errors import InputError, ModelError, last_line
from ergoqp.expressions import shifted
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

Array = NDArray[np.float64]

COMPONENTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 24)
"""Numbers of Gaussians among which the Bayesian information criterion chooses."""

KIND: Final = "gmr_response"
"""Kind of the model, in its file."""

_MOVES: Final = (0.01, np.radians(2.0))
"""An object that moves less than this, by its standard deviation, shows nothing [m, rad]."""

_STAYS: Final = np.radians(0.1)
"""A joint that moves less than this, by its standard deviation, is taken to stay [rad]."""


def mean_pose(poses: ArrayLike) -> Array:
    """Return the mean (4, 4) of poses (n, 4, 4): of their positions, and of their rotations."""
    poses = np.asarray(poses, dtype=float)
    mean = np.eye(4)
    mean[:3, 3] = poses[:, :3, 3].mean(axis=0)
    mean[:3, :3] = Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix()
    return mean


def coordinates_of(poses: ArrayLike, mean: Array) -> Array:
    """Return x_r (n, 6) of poses (n, 4, 4): position and rotation vector relative to a mean pose.

    Both are along the axes of the world [m, rad].
    """
    poses = np.asarray(poses, dtype=float)
    turns = Rotation.from_matrix(poses[:, :3, :3] @ mean[:3, :3].T).as_rotvec()
    return np.hstack([poses[:, :3, 3] - mean[:3, 3], turns])


@dataclass(frozen=True, eq=False)
class GmrResponse:
    """S(q) = dq/dx_r of a Gaussian mixture over (x_r, q, V), eq. 2.8 of the EPFL report.

    Where the object is follows from the posture, by the grip of a model person. The step keeps all
    limits of the object with it as with any response. It is for study: it repeats the postures of
    its recording, and it leads to worse postures than the prior `IkResponse`
    (`notebooks/07_second_model`).

    Attributes:
        person: model person whose `contact` is the pose x_r of a posture.
        mixture: Gaussians over x_r (6), the joints, and V.
        joints: joints that move with the object, in the order of the mixture's columns.
        mean: pose (4, 4) that x_r is relative to, see `coordinates_of`.

    Raises:
        ModelError: if the mixture has a wrong number of columns, or a joint does not exist.

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
        check_kind("person", self.person, IkResponse, "an IkResponse", ModelError)
        object.__setattr__(self, "joints", tuple(self.joints))
        columns, wanted = self.mixture.means.shape[1], 7 + len(self.joints)
        if columns != wanted or not set(self.joints) <= set(JOINTS):
            raise ModelError(
                f"gmr response: got a mixture of {columns} columns for the joints"
                f" {', '.join(self.joints)}, allowed {wanted} columns (x_r, these joints, V) and"
                " joints of ergoqp.JOINTS"
            )
        object.__setattr__(self, "mean", np.asarray(self.mean, dtype=float))

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

        Args:
            postures: recorded (n, 32) [rad].
            poses: pose of the object in each (n, 4, 4), in the world of the person's `contact` [m].
            cost: V~, the first model; it gives the cost (n,) of postures.
            person: model person that tells where the object is in a posture.
            components: numbers of Gaussians to choose from, or one.
            seed: seed of the starts.
            regularisation: added to every variance, as a share of the column's.
            progress: called with the share that is done.

        Raises:
            InputError: if the arrays do not fit together, the object or the person never moves, or
                there are fewer frames than one Gaussian needs.
            MissingExtraError: if scikit-learn is not installed.
        """
        count = len(np.atleast_1d(np.asarray(postures)))
        postures = read_array("postures", postures, (count, len(JOINTS)), "numbers (n, 32)")
        poses = read_array("poses", poses, (count, 4, 4), f"poses ({count}, 4, 4)")
        if count < 2:
            raise InputError(f"postures: got {count} frames, allowed some for each Gaussian")
        check_whole("seed", seed, 0, LARGEST_SEED)
        check_number("regularisation", regularisation, 1e-9, 1.0)
        several = [components] if isinstance(components, int) else list(components)
        for each in several:
            check_whole("components", each, 1)
        rotations = poses[:, :3, :3]
        if not np.allclose(rotations @ np.swapaxes(rotations, 1, 2), np.eye(3), atol=1e-3):
            raise InputError("poses: got a matrix that is no rigid motion, allowed rigid motions")
        mean = mean_pose(poses)
        x = coordinates_of(poses, mean)
        spread = [float(np.sqrt(np.var(part, axis=0).sum())) for part in (x[:, :3], x[:, 3:])]
        if spread[0] < _MOVES[0] and spread[1] < _MOVES[1]:
            raise InputError(
                f"object: it moves by {1e3 * spread[0]:.1f} mm and {np.degrees(spread[1]):.1f} deg"
                " (standard deviation), which shows nothing of how the posture follows it; allowed"
                f" from {1e3 * _MOVES[0]:g} mm or {np.degrees(_MOVES[1]):g} deg on"
            )
        joints = tuple(
            name for name, moves in zip(JOINTS, postures.std(axis=0), strict=True) if moves > _STAYS
        )
        if not joints:
            raise InputError("postures: no joint moves, which shows nothing of how they follow")
        values = np.asarray(cost(postures), dtype=float)
        columns = np.column_stack([x, postures[:, [INDEX[name] for name in joints]], values])
        least = columns.shape[1] + 2
        fitting = [each for each in several if each * least <= count]
        if not fitting:
            raise InputError(
                f"postures: got {count} frames, allowed at least {min(several) * least}:"
                f" {least} for each Gaussian over {columns.shape[1]} columns"
            )
        # Columns of several units: each in its own standard deviation.
        scale = np.maximum(columns.std(axis=0), 1e-6)
        found = []
        for each, done in zip(fitting, np.cumsum(fitting), strict=True):
            found.append(estimate(columns / scale, each, seed, "full", regularisation, "kmeans"))
            progress(float(done / sum(fitting)))
        best = mixture_of(min(found, key=lambda one: one.bic(columns / scale)))
        mixture = MixtureRegression(
            best.weights, best.means * scale, best.covariances * np.outer(scale, scale)
        )
        return cls(person, mixture, joints, mean)

    @cached_property
    def regression(self) -> Conditional:
        """The regression of (q, V) on x_r, eq. 2.5 to 2.8, for arrays of `coordinates_of`."""
        return self.mixture.split(range(6), range(6, 7 + len(self.joints)))

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
        # Joints that do not move take the row of zeros that is put below.
        rows = ca.vertcat(derivative[:-1, :], ca.MX.zeros(1, 6))
        at = [self.joints.index(name) if name in self.joints else -1 for name in JOINTS]
        last = rows.shape[0] - 1
        S = rows[[last if number < 0 else number for number in at], :]
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

        E is I - J S with the Jacobian J of the grip: where the mixture moves the joints otherwise
        than the object moves, the hand would leave it.
        """
        return self._sensitivity

    @cached_property
    def _sensitivity(self) -> ca.Function:
        q = ca.SX.sym("q", len(JOINTS))
        pose = self.contact()(q)[0]
        turns = ca.jacobian(ca.vec(pose[:3, :3]), q)
        turning = [
            ca.inv_skew(ca.reshape(turns[:, joint], 3, 3) @ pose[:3, :3].T)
            for joint in range(len(JOINTS))
        ]
        J = ca.vertcat(ca.jacobian(pose[:3, 3], q), ca.horzcat(*turning))
        geometry = ca.Function("geometry", [q], ca.cse([pose, ca.densify(J)]))
        state, held = ca.MX.sym("q", len(JOINTS)), ca.MX.sym("locked", len(JOINTS))
        here, jacobian = geometry(state)
        S = self.slopes()(here)[0] * ca.repmat(1 - held, 1, 6)
        return ca.Function(
            "sensitivity",
            [state, held],
            [ca.densify(S), ca.MX.eye(6) - jacobian @ S],
            ["q", "locked"],
            ["sensitivity", "unmet"],
        )

    def _coordinates(self, pose: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return x_r (6,) of a pose, and its derivative (6, 6) along a twist."""
        here, twist, mean = ca.SX.sym("pose", 4, 4), ca.SX.sym("twist", 6), ca.DM(self.mean)
        moved = shifted(here, twist)
        turn = moved[:3, :3] @ mean[:3, :3].T
        axis = ca.inv_skew(turn - turn.T) / 2
        sine = ca.sqrt(ca.sumsqr(axis) + 1e-30)
        angle = ca.atan2(sine, (ca.trace(turn) - 1) / 2)
        x = ca.vertcat(moved[:3, 3] - mean[:3, 3], axis / sine * angle)
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
            mean = np.asarray(arrays.pop("mean"), dtype=float).reshape(4, 4)
            person = response_from_dict(header["person"])
            return cls(person, MixtureRegression(**arrays), tuple(header["joints"]), mean)
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(
                f"{Path(path).name}: does not hold what a model of kind {KIND!r} needs"
                f" ({last_line(error)})"
            ) from None
