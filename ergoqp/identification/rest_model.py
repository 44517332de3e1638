"""Where a person comes to rest, by unknown traits and what they minimise.

The unknown traits of a person: habits, lengths and a bias of the sensors, with their priors. The
priors are those of people in general, not of a data set. Standard deviations: a factor e for the
weight of a joint, 15 deg for a favourite angle, 6 % for stature, 4 % for a segment in addition, 2
deg for the bias of a joint angle. (The within-sex spread of stature is 4 %; the fractions of
Drillis and Contini vary by 3 to 5 %.)

The quantity that a person at rest minimises: discomfort, imbalance, strained gaze, lost contact. At
rest the person minimises 1/2 |r|^2 over joints and pelvis, with the residuals

    sqrt(w_j) (q_j - c_j),   sqrt(B) (pelvis - middle of the feet),   sqrt(a) gaze,
    sqrt(2) e / d  (hands),  slip / s  (soles),  sqrt(k) max(0, q - u), sqrt(k) max(0, l - q)

This is the rest of `ergoqp.responses.ik.IkResponse`, but soles and ranges are slightly soft. So it
is one least-squares problem, and differentiable in all unknown traits of the person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.expressions import Evaluator, slices
from ergoqp.human import Kinematics
from ergoqp.human.body import GROWTH
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.responses.holding import Holding, Situated, hang
from ergoqp.responses.ik import IkResponse
from ergoqp.responses.stance_and_gaze import gaze
from ergoqp.rest.model_person import ModelPerson

WEIGHT_SD: Final = 1.0
"""Standard deviation of the logarithm of a joint's weight."""
COMFORT_SD: Final = float(np.radians(15.0))
"""Standard deviation of a favourite angle [rad]."""
BIAS_SD: Final = float(np.radians(2.0))
"""Standard deviation of the bias of a sensor [rad]."""
SEAT_SD: Final = 0.03
"""Standard deviation of the height of the hip centres when seated [m]."""

LENGTHS: Final[dict[str, tuple[tuple[str, ...], float]]] = {
    "stature": (("stature",), 0.06),
    "trunk": (("trunk", "shoulder_height"), 0.04),
    "shoulder_width": (("shoulder_width",), 0.05),
    "upper_arm": (("upper_arm",), 0.04),
    "forearm": (("forearm", "hand"), 0.04),
    "legs": (("thigh", "shank"), 0.04),
}
"""Unknown lengths: the segments that grow together, and the standard deviation of their share."""


@dataclass(frozen=True)
class Layout:
    """Positions of the traits in one vector; all are zero for the problem's own person.

    Attributes:
        response: the person of the problem.
    """

    response: IkResponse

    @cached_property
    def joints(self) -> list[int]:
        """Numbers of the joints that follow by themselves."""
        return [INDEX[joint] for joint in self.response.chain]

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Slices of weights (log), comfort [rad], lengths (shares), seat [m] and bias [rad]."""
        n = len(self.joints)
        seats = int(self.response.stance == "seated")
        sizes = {"weights": n, "comfort": n, "lengths": len(LENGTHS), "seat": seats, "bias": n}
        return slices(sizes)

    @cached_property
    def sd(self) -> np.ndarray:
        """Standard deviation of each trait."""
        n = len(self.joints)
        seat = [SEAT_SD] * (self.response.stance == "seated")
        lengths = [sd for _, sd in LENGTHS.values()]
        return np.array([*[WEIGHT_SD] * n, *[COMFORT_SD] * n, *lengths, *seat, *[BIAS_SD] * n])

    @cached_property
    def growth(self) -> np.ndarray:
        """Map (14, k) from the shares of the lengths to the growth of a body."""
        grown = np.zeros((len(GROWTH), len(LENGTHS)))
        for number, (together, _) in enumerate(LENGTHS.values()):
            for name in together:
                grown[GROWTH.index(name), number] = 1.0
        return grown


_SOLE: Final = 0.004
"""Softness of soles [m, rad]."""
_RANGE: Final = 400.0
"""Stiffness of the ends of ranges, in units of joint weights."""
_ROUND: Final = 0.01
"""Width of the smooth start of an end [rad]."""


class RestEnergy:
    """Residuals of a person who holds an object, as functions of posture, place and person.

    Args:
        response: the person of the problem.

    Attributes:
        joints: numbers of the joints that move (n,). `z` holds these joints, and for a standing
            person then x, y, z and yaw of the pelvis.
    """

    def __init__(self, response: IkResponse) -> None:
        """Build the expressions."""
        self.response, self.layout = response, Layout(response)
        self.joints = self.layout.joints

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        n, hands = len(self.joints), len(self.response.hands)
        shapes = {
            "z": (n + 4 * (self.response.stance == "standing"), 1),
            "posture": (32, 1),
            "grasp": (4, 4 * hands),
            "soles": (4, 8),
            "pose": (4, 4),
            "weights": (n, 1),
            "comfort": (n, 1),
            "growth": (len(GROWTH), 1),
            "seat": (1, 1),
        }
        return {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}

    @cached_property
    def _residuals(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Residuals, the whole posture (32,), and the largest distance of a hand [m]."""
        sx, n, response = self._symbols, len(self.joints), self.response
        angles, pelvis, pose = sx["z"][:n], sx["z"][n:], sx["pose"]
        posture = ca.SX(sx["posture"])
        posture[self.joints] = angles
        hang(response, posture)
        place = Situated(
            posture, sx["grasp"], sx["soles"], pose[:3, 3], pose[:3, :3], relaxation=ca.SX(0)
        )
        kinematics = Kinematics(response.body, sx["growth"])
        seat = response.seat + sx["seat"] if response.stance == "seated" else None
        holding = Holding(response, place, posture, pelvis, kinematics, seat)
        rows = [ca.sqrt(sx["weights"]) * (angles - sx["comfort"])]
        for error in holding.errors:
            rows.append(np.sqrt(2) / response.damping * (error - holding.along_tool(error)))
        if response.stance == "standing":
            rows.append(holding.slipping() / _SOLE)
            feet = [kinematics.at(f"{side}_sole", posture)[0] for side in SIDES]
            rows.append(np.sqrt(response.balance) * (feet[0] + feet[1])[:2] / 2)
        if response.looks:
            work = holding.work
            seen = gaze(kinematics, posture, work, [])
            missed = sum((error[:3] for error in holding.errors), ca.SX(3, 1))
            missed = missed / len(holding.errors)
            rows.append(np.sqrt(response.attention) * (seen.residual + 2 * seen.by_work @ missed))
        for beyond in (angles - ca.DM(UPPER[self.joints]), ca.DM(LOWER[self.joints]) - angles):
            rows.append(np.sqrt(_RANGE) * (beyond + ca.sqrt(beyond**2 + _ROUND**2)) / 2)
        gaps = [ca.norm_2(error[:3]) for error in holding.errors]
        return ca.vertcat(*rows), posture, ca.mmax(ca.vertcat(*gaps))

    @cached_property
    def slope(self) -> Evaluator:
        """``(z, ...) -> residual (m,), by_z (m, k)``."""
        residual, _, _ = self._residuals
        by_z = ca.jacobian(residual, self._symbols["z"])
        return self._evaluator("slope", {"residual": residual, "by_z": by_z})

    @cached_property
    def by_lengths(self) -> Evaluator:
        """``(z, ...) -> by_growth (m, 14), by_seat (m, 1)``."""
        residual, _, _ = self._residuals
        by = {f"by_{n}": ca.jacobian(residual, self._symbols[n]) for n in ("growth", "seat")}
        return self._evaluator("by_lengths", by)

    @cached_property
    def whole(self) -> Evaluator:
        """``(z, ...) -> whole (32,), gap``, with the joints that do not follow by themselves."""
        _, posture, gap = self._residuals
        return self._evaluator("whole", {"whole": posture, "gap": gap})

    def _evaluator(self, name: str, outputs: dict[str, ca.SX]) -> Evaluator:
        sx, parts = self._symbols, ca.cse([ca.densify(part) for part in outputs.values()])
        return Evaluator(ca.Function(name, list(sx.values()), parts, list(sx), list(outputs)))


_LONGEST: Final = 0.3
"""Longest step of a joint [rad] and of the pelvis [m]."""
_DONE: Final = 5e-4
"""The search ends after a step this short [rad]."""


@dataclass(frozen=True, eq=False)
class Situation:
    """What is the same in all rests of a person.

    Attributes:
        posture: posture (32,) [rad]; it gives the joints that do not follow by themselves.
        grasp: grips in the contact frame side by side (4, 4 k).
        soles: right and left sole in the world (4, 8).
    """

    posture: np.ndarray
    grasp: np.ndarray
    soles: np.ndarray


@dataclass(frozen=True, eq=False)
class ModelRest:
    """A rest of the model.

    Attributes:
        z: joints, then the pelvis.
        posture: all joints (32,) [rad].
        by_traits: derivative of the joints with respect to the traits (n, p), without the bias.
        gap: largest distance of a hand from its place on the object [m].
    """

    z: np.ndarray
    posture: np.ndarray
    by_traits: np.ndarray
    gap: float


class RestModel:
    """Rests of people who differ from a problem's person only in their traits.

    Args:
        response: the person of the problem.
    """

    def __init__(self, response: IkResponse) -> None:
        """Build the energy."""
        self.layout, self._energy = Layout(response), RestEnergy(response)
        self.response = response
        self._weights = response.weight_vector[self.layout.joints]
        self._comfort = response.comfort[self.layout.joints]

    def begin(self, posture: np.ndarray) -> np.ndarray:
        """Return the start of the search for a rest: joints and pelvis of a posture (32,) [rad]."""
        z = posture[self.layout.joints]
        if self.response.stance == "seated":
            return z
        pelvis = np.array(self.response.contact()(posture)[1])
        return np.concatenate([z, pelvis[:3, 3], [np.arctan2(pelvis[1, 0], pelvis[0, 0])]])

    def rest(
        self,
        traits: np.ndarray,
        situation: Situation,
        pose: np.ndarray,
        begin: np.ndarray,
        steps: int = 30,
        slopes: bool = True,
    ) -> ModelRest:
        """Return the rest with the object at `pose` (4, 4), with a search from `begin`.

        The search uses Levenberg-Marquardt steps. The derivative follows from the implicit function
        theorem with the Gauss-Newton Hessian.
        """
        person = self._person(traits)
        slope = self._energy.slope
        for name, value in (person | vars(situation) | {"pose": pose}).items():
            slope.inputs[name][:] = np.ravel(value, order="F")
        z, damping = begin.copy(), 1e-3
        energy, residual, by_z = self._at(z)
        hessian = by_z.T @ by_z
        for _ in range(steps):
            downhill = by_z.T @ residual
            damped = hessian + damping * np.eye(len(z))
            step = -np.linalg.solve(damped, downhill)
            step *= min(1.0, _LONGEST / max(1e-12, float(np.abs(step).max())))
            there = self._at(z + step)
            if there[0] <= energy + 1e-12:
                z, damping = z + step, damping / 4
                energy, residual, by_z = there
                hessian = by_z.T @ by_z
                if np.abs(step).max() < _DONE:
                    break
            else:
                damping = 8 * max(damping, 1e-3)
                if damping > 1e6:
                    break
        self._copy_to(self._energy.whole, z)
        outputs = self._energy.whole.outputs
        posture, gap = outputs["whole"].copy(), float(outputs["gap"][0])
        n = len(self.layout.joints)
        by_traits = self._by_traits(z, person, by_z, hessian) if slopes else np.zeros((n, 0))
        return ModelRest(z, posture, by_traits, gap)

    def _person(self, traits: np.ndarray) -> dict[str, Any]:
        parts = self.layout.parts
        seat = traits[parts["seat"]]
        return {
            "weights": self._weights * np.exp(traits[parts["weights"]]),
            "comfort": self._comfort + traits[parts["comfort"]],
            "growth": self.layout.growth @ traits[parts["lengths"]],
            "seat": float(seat[0]) if seat.size else 0.0,
        }

    def _at(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        slope = self._energy.slope
        slope.inputs["z"][:] = z
        slope.evaluate()
        residual = slope.outputs["residual"].copy()
        by_z = slope.outputs["by_z"].reshape(len(residual), len(z), order="F").copy()
        return 0.5 * float(residual @ residual), residual, by_z

    def _copy_to(self, evaluator: Evaluator, z: np.ndarray) -> None:
        for name, array in self._energy.slope.inputs.items():
            evaluator.inputs[name][:] = array
        evaluator.inputs["z"][:] = z
        evaluator.evaluate()

    def _by_traits(
        self, z: np.ndarray, person: dict[str, Any], by_z: np.ndarray, hessian: np.ndarray
    ) -> np.ndarray:
        n, size = len(self.layout.joints), len(by_z)
        self._copy_to(self._energy.by_lengths, z)
        outputs = self._energy.by_lengths.outputs
        by_growth = outputs["by_growth"].reshape(size, -1, order="F") @ self.layout.growth
        columns = [by_growth]
        if self.response.stance == "seated":
            columns.append(outputs["by_seat"].reshape(size, 1))
        weights = np.asarray(person["weights"])
        pull = np.zeros((len(z), 2 * n))
        pull[:n, :n] = np.diag(weights * (z[:n] - person["comfort"]))
        pull[:n, n:] = -np.diag(weights)
        forces = np.hstack([pull, by_z.T @ np.hstack(columns)])
        ridge = hessian + 1e-9 * np.trace(hessian) / len(z) * np.eye(len(z))
        return -np.linalg.solve(ridge, forces)[:n]


def situation_of(response: IkResponse, postures: Sequence[np.ndarray]) -> Situation:
    """Return how the object is held, and where the soles are, as means over postures (32,)."""
    person = ModelPerson(response)
    grasp = np.mean([person.grasp(posture) for posture in postures], axis=0)
    soles = np.mean([person.stand(posture) for posture in postures], axis=0)
    rigid = [_rigid(part) for part in grasp]
    feet = [_rigid(part) for part in np.split(soles, 2, axis=1)]
    return Situation(np.mean(postures, axis=0), np.hstack(rigid), np.hstack(feet))


def _rigid(mean: np.ndarray) -> np.ndarray:
    """Return the rigid motion (4, 4) nearest to a mean of rigid motions."""
    pose = mean.copy()
    left, _, right = np.linalg.svd(mean[:3, :3])
    pose[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return pose
