"""People like the controller's model, but with other numbers: they reach and relax."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ergoqp.errors import InputError
from ergoqp.expressions import Evaluator
from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.responses.holding import soles_of
from ergoqp.responses.ik import IkResponse
from ergoqp.responses.stance_and_gaze import LEG_JOINTS, TOOL_AXES, move_sole, with_bent_knees
from ergoqp.rest.person_protocol import Holding, Person, SensorModel

N = len(JOINTS)
REACHED = 0.02
"""A grip within this distance of its target counts as reached [m]."""
REACHED_ANGLE = 0.15
"""The tool axis must be within this angle too [rad]."""

STEPS = 1000
"""Largest number of steps until a person is at rest."""
PATIENCE = 150
"""An object that is out of reach after so many steps counts as out of reach."""
STILL = 1e-8
"""A step in which no joint moves by as much is the last one [rad]."""

HALVED = 100
"""After each so many steps those that are not small are halved.

An arm that is just too short swings to both sides of its rest with whole steps.
"""
MOST_HALVINGS = 3
"""Steps are not halved more often."""
NEAR = 1e-3
"""From steps as small as this the next ones are extrapolated [rad].

Where a person could rest in two postures, one in a thousand places ends in the other one than by
plain steps because of it. Later extrapolation takes more time and changes no fewer.
"""
HISTORY = 5
"""Number of changes of the step that are extrapolated from."""
RIDGE = 1e-10
"""Ridge of their least squares, relative to each one's square."""


@dataclass(frozen=True)
class Start:
    """Start of a loop: posture, pose of the object, grasp, and where the soles stand."""

    posture: np.ndarray
    pose: np.ndarray
    grasp: np.ndarray
    soles: np.ndarray


@dataclass(frozen=True)
class ModelPerson(Person):
    """A person like the controller's model, but with other numbers.

    The posture moves by the person's own `IkResponse`. Errors of the grip and of the soles are
    fed back, so that nothing drifts. The posture at rest is the one nearest to comfort, in the
    person's own weights, that keeps contact and ranges.

    Attributes:
        response: body, weights and comfort of the person.
    """

    response: IkResponse
    kind: ClassVar[str] = "alike"
    manner: ClassVar[str] = "built like the controller's model with other joint weights"

    def __getstate__(self) -> dict[str, Any]:
        """Pickle as the fields: expressions cannot be sent to a process, and are rebuilt there."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @cached_property
    def _step(self) -> ca.Function:
        """The function of one step of the person toward the targets.

        It is ``(q, locked, targets (4, 4 k), soles (4, 8), gain, relax) -> (step (32,), distance,
        angle)``.

        The distance is the largest distance of a grip or a sole from its target [m].
        """
        response = self.response
        k = len(response.hands)
        q, locked = ca.SX.sym("q", N), ca.SX.sym("locked", N)
        targets, soles = ca.SX.sym("targets", 4, 4 * k), ca.SX.sym("soles", 4, 8)
        gain, relax = ca.SX.sym("gain"), ca.SX.sym("relax")
        grips = response.grips()(q)
        errors, distances, angles = [], [], []
        for hand in range(k):
            have, want = grips[:, 4 * hand : 4 * hand + 4], targets[:, 4 * hand : 4 * hand + 4]
            error = _pose_error(have, want)
            errors.append(ca.vertcat(_capped(error[:3], 0.10), _capped(error[3:], 0.4)))
            distances.append(ca.norm_2(error[:3]))
            turn = error[3:]
            if response.free_about_tool:
                axis = have[:3, :3] @ ca.DM(TOOL_AXES[response.tool][0])
                turn = turn - axis * ca.dot(axis, turn)
            angles.append(ca.norm_2(turn))
        step = response.reach()(q, locked, gain * ca.vertcat(*errors))
        step = step + relax * response.drift()(q, locked)
        if response.stance == "standing":
            sole_step, slipped = self._sole_step(q, soles)
            step = step + sole_step * (1 - locked)
            distances.append(slipped)
        outputs: list[ca.SX] = [step, ca.mmax(ca.vertcat(*distances)), ca.mmax(ca.vertcat(*angles))]
        return ca.Function(
            "person",
            [q, locked, targets, soles, gain, relax],
            ca.cse([ca.densify(part) for part in outputs]),
            ["q", "locked", "targets", "soles", "gain", "relax"],
            ["step", "distance", "angle"],
        )

    def _sole_step(self, q: ca.SX, soles: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return one Newton step of the legs that moves the soles back to their place on the floor.

        The second value is their distance from it [m].
        """
        pelvis = self.response.contact()(q)[1]
        kinematics, bent = self.response.kinematics, with_bent_knees(q)
        step, off = ca.SX(N, 1), ca.SX(0)
        for number, side in enumerate(SIDES):
            position, rotation, _ = kinematics.at(f"{side}_sole", q)
            want = soles[:, 4 * number : 4 * number + 4]
            local = ca.horzcat(
                pelvis[:3, :3].T @ want[:3, :3], pelvis[:3, :3].T @ (want[:3, 3] - pelvis[:3, 3])
            )
            error = _pose_error(ca.horzcat(rotation, position), local)
            hip = kinematics.at(f"{side}_hip", q)[0]
            at_hip = ca.vertcat(error[:3] + ca.cross(error[3:], hip - position), error[3:])
            leg = move_sole(kinematics, bent, side, at_hip)
            # Far from its place a leg must not jump to the other solution of its bend.
            small = ca.fmin(1, 0.1 / (ca.norm_inf(leg) + 1e-12))
            step[[INDEX[name] for name in LEG_JOINTS[side]]] = leg * small
            off = ca.fmax(off, ca.norm_2(error[:3]))
        return step, off

    @cached_property
    def _sole_poses(self) -> ca.Function:
        return soles_of(self.response)

    def stand(self, posture: np.ndarray) -> np.ndarray:
        """Return the poses of the soles in the world at a posture (4, 8). They stay there."""
        return np.array(self._sole_poses(posture))

    def contact(self, posture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return contact frame and pelvis in the world (4, 4) each at a posture."""
        contact, pelvis = self.response.contact()(posture)
        return np.array(contact), np.array(pelvis)

    def grasp(self, posture: np.ndarray) -> np.ndarray:
        """Return the grips in the contact frame (k, 4, 4) at a posture: how the object is held."""
        contact = self.contact(posture)[0]
        grips = np.array(self.response.grips()(posture))
        each = np.split(grips, len(self.response.hands), axis=1)
        return np.stack([np.linalg.solve(contact, grip) for grip in each])

    def move(
        self, posture: np.ndarray, targets: np.ndarray, soles: np.ndarray, gain: float, relax: float
    ) -> tuple[np.ndarray, float, float]:
        """Return (next posture (32,), grip distance [m], tool angle [rad]) after one step.

        The step is toward the targets of the grips (4, 4 k).

        Joints stop at the ends of their ranges. The others continue without them.
        """
        locked = np.zeros(N)
        step, distance, angle = self._call(posture, locked, targets, soles, gain, relax)
        for _ in range(3):
            after = posture + step
            blocked = (after > UPPER) & (posture >= UPPER - 1e-9)
            blocked |= (after < LOWER) & (posture <= LOWER + 1e-9)
            newly = blocked & (locked < 0.5)
            if not newly.any():
                break
            locked[newly] = 1.0
            step, distance, angle = self._call(posture, locked, targets, soles, gain, relax)
        return np.clip(posture + step, LOWER, UPPER), distance, angle

    def settle(
        self,
        posture: np.ndarray,
        pose: np.ndarray,
        grasp: np.ndarray,
        soles: np.ndarray,
        steps: int = STEPS,
    ) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,), whether the object is reached).

        The object stays at `pose` (4, 4). The person moves by `move` until they are at rest within
        1e-6 rad, with shorter steps if that takes long. Near the end the steps are extrapolated
        (Anderson, "Iterative procedures for nonlinear integral equations", 1965), which takes half
        as many of them. In a few of 10 000 places they swing on; then this is where they are.
        """
        targets = np.hstack([pose @ grip for grip in grasp])
        relax = 0.5 * self.response.relaxation_time
        memory = deque[tuple[np.ndarray, np.ndarray]](maxlen=HISTORY + 1)
        end, reached = posture, False
        for number in range(steps):
            end, distance, angle = self.move(posture, targets, soles, 1.0, relax)
            reached = distance < REACHED and angle < REACHED_ANGLE
            step, posture = end - posture, end
            change = float(np.abs(step).max())
            if change < STILL or (number + 1 >= PATIENCE and not reached):
                break
            memory.append((step, end))
            if change < NEAR and len(memory) > 1:
                posture = np.clip(end - _excess(memory), LOWER, UPPER)
            elif number >= HALVED:
                posture = end - (1.0 - 0.5 ** min(number // HALVED, MOST_HALVINGS)) * step
        return end, reached

    @cached_property
    def _evaluator(self) -> Evaluator:
        return Evaluator(self._step)

    def _call(self, *values: np.ndarray | float) -> tuple[np.ndarray, float, float]:
        evaluator = self._evaluator
        for array, value in zip(evaluator.inputs.values(), values, strict=True):
            array[:] = np.ravel(value, order="F")
        evaluator.evaluate()
        step, distance, angle = evaluator.outputs.values()
        return step.copy(), float(distance[0]), float(angle[0])

    @property
    def body(self) -> Body:
        """Body of the person."""
        return self.response.body

    @property
    def comfort(self) -> np.ndarray:
        """Posture of the person with nothing to reach for (32,) [rad]."""
        return self.response.comfort

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        return self.response.footing

    def hold(
        self, posture: np.ndarray, senses: SensorModel | None = None, seed: int = 0
    ) -> ModelHolding:
        """Return the person holding the object in a posture (32,) [rad]. The seed has no effect."""
        return self.holding(self.start_at(posture), senses)

    def holding(self, start: Start, senses: SensorModel | None = None) -> ModelHolding:
        """Return the person holding the object as at a start."""
        return ModelHolding(self, start, senses or self.senses)

    def start_at(self, posture: np.ndarray, pose: np.ndarray | None = None) -> Start:
        """Return the start with the person holding the object in a posture (32,) [rad].

        The object is at `pose` (4, 4); None: as the posture holds it.
        """
        contact, grasp = self.contact(posture)[0], self.grasp(posture)
        if pose is None:
            return Start(posture, contact, grasp, self.stand(posture))
        held = np.stack([np.linalg.solve(pose, contact @ grip) for grip in grasp])
        return Start(posture, pose, held, self.stand(posture))

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,) [rad], whether the object at `pose` is reached)."""
        return self.settle(self.comfort, pose, *self._held_at_ease)

    @cached_property
    def _held_at_ease(self) -> tuple[np.ndarray, np.ndarray]:
        return self.grasp(self.comfort), self.stand(self.comfort)


def _excess(memory: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return by how much the last end of (step, end) overshoots where the steps would vanish."""
    steps, ends = (np.diff(part, axis=0) for part in zip(*memory, strict=True))
    products = steps @ steps.T
    products[np.diag_indices(len(products))] *= 1.0 + RIDGE
    products[np.diag_indices(len(products))] += 1e-300
    return np.linalg.solve(products, steps @ memory[-1][0]) @ ends


def _pose_error(have: ca.SX, want: ca.SX) -> ca.SX:
    """Return the motion (6,) from one pose to another, to first order, with a bounded turn."""
    turn = sum((ca.cross(have[:3, i], want[:3, i]) for i in range(3)), ca.SX(3, 1)) / 2
    return ca.vertcat(want[:3, 3] - have[:3, 3], turn)


def _capped(vector: ca.SX, most: float) -> ca.SX:
    return vector * ca.fmin(1, most / (ca.norm_2(vector) + 1e-12))


def person_of(problem: Problem) -> IkResponse:
    """Return the response of a problem, which is its model of the person.

    Raises:
        InputError: if the response is of another type.
    """
    response = problem.response
    if not isinstance(response, IkResponse):
        raise InputError(
            f"problem {problem.name}: got a response of type {type(response).__name__}, allowed"
            " IkResponse ([response.ik] in a file)"
        )
    return response


def sample_person(problem: Problem, seed: int, body: Body | None = None) -> ModelPerson:
    """Return a person of the kind `alike` for a problem. The same seed gives the same person.

    The joint weights are multiplied by log-uniform factors of 0.5 to 2. The stature is within
    0.10 m of that of the controller's model.

    Args:
        problem: its response must be an `IkResponse`.
        seed: seed of the person.
        body: body of the person; None: one with a drawn stature.

    Raises:
        InputError: if the response of the problem is of another type.

    Example:
        >>> import ergoqp
        >>> from ergoqp.human import Body
        >>> from ergoqp.rest.model_person import sample_person
        >>> problem = ergoqp.load_problem("screwing")
        >>> sample_person(problem, seed=1, body=Body(1.68)).body.stature
        1.68
    """
    response = person_of(problem)
    rng = np.random.default_rng([seed, 1])
    factors = np.exp(rng.uniform(np.log(0.5), np.log(2.0), len(JOINTS)))
    stature = response.body.stature + rng.uniform(-0.10, 0.10)
    weights = dict(zip(JOINTS, (response.weight_vector * factors).tolist(), strict=True))
    return ModelPerson(replace(response, body=body or Body.of_stature(stature), weights=weights))


class ModelHolding(Holding[ModelPerson]):
    """The state of a person of the kind `alike` who holds the object.

    Args:
        person: the person.
        start: how they hold the object, and where it is.
        senses: the delay of the person.
    """

    def __init__(self, person: ModelPerson, start: Start, senses: SensorModel) -> None:
        """Start to hold the object as in `start`."""
        self.person, self.start, self.senses = person, start, senses
        self._posture, self.pose = start.posture.copy(), start.pose.copy()
        self._late = deque[np.ndarray]()

    @property
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""
        return self._posture

    @property
    def base(self) -> np.ndarray:
        """Pelvis in the world (4, 4) [m]."""
        return self.person.contact(self.posture)[1]

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow the object with the person's delay, and relax."""
        if not self._late:
            self._late.extend([self.pose] * (1 + round(self.senses.delay / dt)))
        self.pose = pose
        self._late.append(pose)
        followed = self._late.popleft()
        held = np.hstack([followed @ grip for grip in self.start.grasp])
        follow = 1.0 - float(np.exp(-dt / self.senses.hand_time))
        self._posture, self.gap, _ = self.person.move(
            self.posture, held, self.start.soles, follow, dt
        )

    def rest(self, pose: np.ndarray) -> bool:
        """Settle with the object at a pose."""
        start = self.start
        posture, reached = self.person.settle(self.posture, pose, start.grasp, start.soles)
        self._posture, self.pose = posture, pose
        self._late.clear()
        return reached
