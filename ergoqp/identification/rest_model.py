"""Where a person comes to rest, and how this depends on their traits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ergoqp.expressions.evaluator import Evaluator
from ergoqp.identification.energy import RestEnergy
from ergoqp.identification.traits import Layout
from ergoqp.responses.holding import soles_of
from ergoqp.responses.ik import IkResponse

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
        for name, value in (person | self._place(situation, pose)).items():
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

    def _place(self, situation: Situation, pose: np.ndarray) -> dict[str, np.ndarray]:
        return {
            "posture": situation.posture,
            "grasp": situation.grasp,
            "soles": situation.soles,
            "pose": pose,
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
    stood, grasps, soles = soles_of(response), [], []
    for posture in postures:
        contact = np.array(response.contact()(posture)[0])
        grips = np.array(response.grips()(posture))
        grasps.append(np.linalg.solve(contact, grips))
        soles.append(np.array(stood(posture)))
    rigid = [_rigid(part) for part in np.split(np.mean(grasps, axis=0), len(response.hands), 1)]
    feet = [_rigid(part) for part in np.split(np.mean(soles, axis=0), 2, axis=1)]
    return Situation(np.mean(postures, axis=0), np.hstack(rigid), np.hstack(feet))


def _rigid(mean: np.ndarray) -> np.ndarray:
    """Return the rigid motion (4, 4) nearest to a mean of rigid motions."""
    pose = mean.copy()
    left, _, right = np.linalg.svd(mean[:3, :3])
    pose[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return pose
