"""Poses, Jacobians and distances of person, arm and object, and the terms of the step.

The terms of the control step, evaluated for the whole-body formulation. They are the data of its
QP, and how person and pelvis follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import casadi as ca
import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import check_kind
from ergoqp.errors import ProblemError
from ergoqp.expressions import Evaluator, call_by_name
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.solvers import solver_named
from ergoqp.step.answer import Step
from ergoqp.step.model import StepModel
from ergoqp.step.objective import CAUTION_EPS, cost_function
from ergoqp.step.qp import QP_DATA, build_qp, movable_names, qp_data
from ergoqp.whole_body.scene import Scene


@dataclass(frozen=True)
class Closeness:
    """The near pairs.

    Attributes:
        pairs: rows of `Scene.pairs` (m,).
        distances: distance of each pair (m,) [m], negative if they overlap.
        gradients: derivative of each distance with respect to all velocities (m, nv) [m/rad]; zero
            if both touch at a point.
    """

    pairs: np.ndarray
    distances: np.ndarray
    gradients: np.ndarray


class Separation:
    """Measures the pairs of a scene.

    MuJoCo gives the nearest points of a pair. The rate of the distance is the relative motion of
    both points along the line between them, with the opposite sign if they overlap.
    """

    def __init__(self, scene: Scene) -> None:
        """Compute the data of the first test: the bounding spheres of all geoms."""
        self.scene = scene
        model = scene.model
        self._first, self._second = scene.pairs.T
        self._radii = model.geom_rbound[self._first] + model.geom_rbound[self._second]
        self._points, self._jacobians = np.zeros(6), np.zeros((2, 3, model.nv))

    def near(self, data: mujoco.MjData, range_: float) -> Closeness:
        """Return the pairs within a range [m], with gradients.

        `data` must be up to date (`mj_kinematics`, `mj_comPos`).
        """
        rows, distances, gradients = [], [], []
        for row in self._candidates(data, range_):
            distance = self._distance(data, int(row), range_)
            if distance < range_:
                rows.append(row)
                distances.append(distance)
                gradients.append(self._gradient(data, int(row), distance))
        shape = (len(rows), self.scene.model.nv)
        return Closeness(
            np.array(rows, dtype=int), np.array(distances), np.array(gradients).reshape(shape)
        )

    def smallest(self, data: mujoco.MjData, range_: float = 1.0) -> tuple[float, int]:
        """Return the smallest distance of all pairs [m] and its row in `Scene.pairs`.

        If no pair is within the range, return (range, -1).
        """
        least, which = range_, -1
        for row in self._candidates(data, range_):
            distance = self._distance(data, int(row), least)
            if distance < least:
                least, which = distance, int(row)
        return least, which

    def _candidates(self, data: mujoco.MjData, range_: float) -> np.ndarray:
        apart = data.geom_xpos[self._first] - data.geom_xpos[self._second]
        return np.flatnonzero(np.einsum("ij,ij->i", apart, apart) <= (self._radii + range_) ** 2)

    def _distance(self, data: mujoco.MjData, row: int, range_: float) -> float:
        """Return the distance of a pair [m], and set the nearest points."""
        pair = int(self._first[row]), int(self._second[row])
        return mujoco.mj_geomDistance(self.scene.model, data, *pair, range_, self._points)

    def _gradient(self, data: mujoco.MjData, row: int, distance: float) -> np.ndarray:
        """Return the gradient of a distance that was measured last."""
        points = self._points
        model, pair = self.scene.model, (int(self._first[row]), int(self._second[row]))
        for jacobian, point, geom in zip(self._jacobians, points.reshape(2, 3), pair, strict=True):
            mujoco.mj_jac(model, data, jacobian, None, point, int(model.geom_bodyid[geom]))
        line = points[3:] - points[:3]
        length = float(np.linalg.norm(line))
        if length < 1e-9:
            return np.zeros(model.nv)
        return np.sign(distance) * (line / length) @ (self._jacobians[1] - self._jacobians[0])


@dataclass
class Moment:
    """The data of one step, set by the step and read by tasks and limits.

    Attributes:
        dt: period [s].
        jacobian: Jacobian of the contact frame with respect to the arm's joints, world-aligned,
            linear first (6, k).
        terms: result of `ergoqp.whole_body.state.terms_function`.
        H: curvature of the object's own objective (6, 6).
        g: slope of the object's own objective (6,).
        low: lower bound of the twist (6,) [m/s, rad/s].
        high: upper bound of the twist (6,) [m/s, rad/s].
        arm_speed: speeds of the arm's joints in the last period (k,) [rad/s].
        arm_low: lower bounds of the speeds of the arm's joints (k,) [rad/s].
        arm_high: upper bounds of the speeds of the arm's joints (k,) [rad/s].
        arm_wish: desired speeds in the null space (k,) [rad/s].
        offset: correction in addition to the twist xi, J dq = xi + offset. It brings the object
            back to the straight path of its twists, because arms move in arcs (6,) [m/s, rad/s].
        close: the near pairs. None: no distance is kept.
        approach: largest speed at which each of them may approach (m,) [m/s].
    """

    dt: float
    jacobian: np.ndarray
    terms: dict[str, np.ndarray]
    H: np.ndarray
    g: np.ndarray
    low: np.ndarray
    high: np.ndarray
    arm_speed: np.ndarray
    arm_low: np.ndarray
    arm_high: np.ndarray
    arm_wish: np.ndarray
    offset: np.ndarray = field(default_factory=lambda: np.zeros(6))
    close: Closeness | None = None
    approach: np.ndarray = field(default_factory=lambda: np.zeros(0))


SAME: Final = 1e-6
"""Twists this close to each other count as equal [m/s, rad/s]."""


def person_of(problem: Problem) -> IkResponse:
    """Return the person of a problem.

    Raises:
        ProblemError: if its state is not the posture of a person with a body.
        InputError: if the argument is not a Problem.
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    response = problem.response
    if not isinstance(response, IkResponse):
        raise ProblemError(
            f"whole body: got a response of type {type(response).__name__}, allowed IkResponse: a"
            " person's body"
        )
    return response


def terms_function(problem: Problem) -> ca.Function:
    """Return everything that the whole-body QP takes from the control step, as one function.

    Its inputs are those of `ergoqp.step.qp.qp_data`. In addition to the data of that
    function it returns

    - ``slope`` (32,): T dV/dq, the slope of the cost for each joint [points s/rad];
    - ``root`` (33, 32): a matrix whose Gram matrix is T^2 B, the step's curvature in the posture;
    - ``carried`` (4, 6): how the pelvis follows the object, from the model's stance and S.

    Raises:
        ProblemError: if the state is not the posture of a person with a body.
    """
    place = pelvis_function(person_of(problem))
    model, data = StepModel(problem), qp_data(problem)
    mx = model.symbols(data.name_in(), ca.MX)
    parts = call_by_name(data, mx)
    _, value, gradient = cost_function(model)(mx["posture"], mx["observed"])
    ahead, control = problem.control.look_ahead, problem.control
    excess = ca.fmax(value - problem.cost.minimum, 0) + CAUTION_EPS
    caution = ahead * np.sqrt(control.caution * problem.response.weight_vector)
    parts["slope"] = ahead * gradient
    own = ahead * gradient.T / ca.sqrt(2 * excess)
    parts["root"] = ca.vertcat(own, ca.MX(ca.diag(ca.DM(caution))))
    parts["carried"] = place(mx["posture"])[1] @ parts["S"]
    return mx.function("terms", parts)


def own_objective(terms: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return curvature (6, 6) and slope (6,) of the object's part of the step's objective.

    The part consists of effort, smoothing and contact. It is what remains without the part of the
    posture, which acts on the person's joints through S.
    """
    root = terms["root"] @ terms["S"]
    return terms["H"] - root.T @ root, terms["g"] - terms["S"].T @ terms["slope"]


def pelvis_function(person: IkResponse) -> ca.Function:
    """Return ``q (32,) -> (pelvis x, y, z [m] and yaw [rad] (4,), its derivative (4, 32))``.

    It follows from the person's stance.
    """
    q = ca.SX.sym("q", len(JOINTS))
    pose = person.contact()(q)[1]
    place = ca.densify(ca.vertcat(pose[:3, 3], ca.atan2(pose[1, 0], pose[0, 0])))
    return ca.Function("pelvis", [q], [place, ca.densify(ca.jacobian(place, q))])


class StepTerms:
    """The terms of the QP that the object's own step solved.

    Args:
        problem: the task.
    """

    def __init__(self, problem: Problem) -> None:
        """Build the functions once."""
        self._dt = problem.dt
        self._terms = Evaluator(terms_function(problem))
        self._qp = build_qp(solver_named("daqp"), len(movable_names(problem)))

    def __call__(
        self,
        step: Step,
        posture: np.ndarray,
        previous: np.ndarray,
        observed: np.ndarray,
        unimproved: float,
    ) -> tuple[dict[str, np.ndarray], np.ndarray | float]:
        """Return the terms, see `terms_function`, and the slack that the step's rows needed (m,).

        The step locks joints at their end, and its last pass treats joints near their end like all
        other rows. The answer of the step shows which of the QPs with these locks it solved.

        Args:
            step: the object's step.
            posture: posture of the person (32,) [rad].
            previous: twist of the last period (6,).
            observed: (32,) 0 for joints that the sensors do not see.
            unimproved: time without an improvement before the step [s].
        """
        given = {"posture": posture, "observed": observed, "pose": step.pose, "dt": self._dt}
        given |= {"previous": previous, "stalled": unimproved}
        given |= {"locked": step.account("locked"), "final": 0.0}
        terms = self._terms(given)
        if not step.locked and not terms["cap"].any():
            return terms, 0.0
        slack: np.ndarray | float = 0.0
        for final in (0.0, 1.0):
            terms = self._terms(given | {"final": final})
            twist, slack, _, _ = (
                np.array(part).ravel() for part in self._qp(*(terms[name] for name in QP_DATA))
            )
            if np.abs(twist - step.twist).max() < SAME:
                break
        return terms, slack


_RETREAT: Final = 0.05
_LOOK: Final = 0.15


class Sight:
    """One scene as a step sees it.

    Args:
        scene: scene of person, robot and object.
        person: person in it.
        configuration: mink's copy of the positions, which is kept up to date.
        distance: distance to keep [m]. None: none.
        reserve: distance kept in addition [m].
        pace: the object's time to stop from full speed [s].
    """

    def __init__(
        self,
        scene: Scene,
        person: IkResponse,
        configuration: mink.Configuration,
        distance: float | None,
        reserve: float,
        pace: float,
    ) -> None:
        """Build the functions once."""
        self._scene, self._configuration = scene, configuration
        self._pelvis, self._separation = pelvis_function(person), Separation(scene)
        self._distance, self._reserve, self._pace = distance, reserve, pace

    def look(
        self, posture: np.ndarray, positions: np.ndarray, after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the contact frame (4, 4), and its Jacobian for the arm's joints (6, k).

        The Jacobian is that of the middle of the coming period.

        The arm turns while it moves. With the Jacobian of the start, the object would leave its
        straight path by the change of the Jacobian in half a period, always to the same side.

        Args:
            posture: posture of the person (32,) [rad].
            positions: positions of the arm's joints (k,) [rad].
            after: positions after half a period at the last speeds (k,) [rad].
        """
        scene, site = self._scene, self._scene.contact_site
        data = self.place(posture, positions)
        contact, jacobian = scene.contact_pose(data), np.zeros((6, scene.model.nv))
        data = self.place(posture, after)
        mujoco.mj_jacSite(scene.model, data, jacobian[:3], jacobian[3:], site)
        return contact, jacobian[:, scene.arm]

    def place(self, posture: np.ndarray, positions: np.ndarray) -> mujoco.MjData:
        """Set the positions of person and arm."""
        pelvis = np.array(self._pelvis(posture)[0]).ravel()
        self._configuration.update(self._scene.qpos(pelvis, posture, positions))
        return self._configuration.data

    def near(self) -> tuple[Closeness | None, float]:
        """Return the near pairs and the smallest distance [m] at the positions set last."""
        if self._distance is None:
            return None, float("inf")
        data = self._configuration.data
        close = self._separation.near(data, self._distance + self._reserve + _LOOK)
        least = (
            float(close.distances.min()) if len(close.pairs) else self._separation.smallest(data)[0]
        )
        return close, least

    def approach(self, close: Closeness, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the largest speeds of approach (m,) [m/s].

        They are the remaining distance over the object's time to stop from full speed. So the
        approach becomes ever slower, with no more deceleration than the object has. If the distance
        is already too small, the robot retreats, as fast as its joints allow and at most at 0.05
        m/s.

        Args:
            close: the near pairs.
            low: lower bounds of the speeds of the arm's joints (k,) [rad/s].
            high: upper bounds of these speeds (k,) [rad/s].
        """
        left = close.distances - (self._distance or 0.0) - self._reserve
        allowed = np.where(left >= 0, left, np.maximum(left, -_RETREAT * self._pace)) / self._pace
        arm = -close.gradients[:, self._scene.arm]
        least = np.minimum(arm * low, arm * high).sum(axis=1)
        return np.maximum(allowed, least)


_ROUNDING = 1e-12


def stopping_speed(distance: ArrayLike, acceleration: ArrayLike, dt: float) -> np.ndarray:
    """Return the largest speed of this period from which a stop stays within a distance.

    The speed is held for one period and then falls by a dt per period. After k + 1 periods the
    joint has moved v dt + (v - a dt) dt + ... So v = d / ((k + 1) dt) + a dt k / 2 with k =
    floor((sqrt(1 + 8 d / (a dt^2)) - 1) / 2). (The continuous sqrt(2 a d) would overshoot by up to
    the motion of one period.)

    Args:
        distance: remaining distance; negative counts as zero [rad].
        acceleration: deceleration that may be used [rad/s^2].
        dt: period [s].
    """
    d, a = np.maximum(np.asarray(distance, dtype=float), 0.0), np.asarray(acceleration, dtype=float)
    k = np.floor((np.sqrt(1 + 8 * d / (a * dt**2)) - 1) / 2 + _ROUNDING)
    return d / ((k + 1) * dt) + a * dt * k / 2


def joint_bounds(
    position: np.ndarray,
    speed: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    velocity: np.ndarray,
    acceleration: np.ndarray,
    dt: float,
    pace: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper bound of the speed of every joint in this period (k,) each.

    The bounds follow from position through the stop, rate and acceleration. They always include the
    joint's own braking. So bounds of joints that kept them before are never empty.

    Args:
        position: positions of the joints (k,) [rad].
        speed: speeds of the last period (k,) [rad/s].
        limits: least and greatest positions (k,) each [rad].
        velocity: largest speeds (k,) [rad/s].
        acceleration: largest accelerations (k,) [rad/s^2].
        dt: period [s].
        pace: time constant of the approach to the ends of the ranges [s], if it is longer than the
            stop. Joints can stop sooner than the object that they carry may.
    """
    brake = np.sign(speed) * np.maximum(np.abs(speed) - acceleration * dt, 0.0)
    up, down = (
        np.minimum(
            np.minimum(velocity, stopping_speed(left, acceleration, dt)),
            np.maximum(left, 0.0) / max(pace, dt),
        )
        for left in (limits[1] - position, position - limits[0])
    )
    low = np.minimum(np.maximum(-down, speed - acceleration * dt), brake)
    high = np.maximum(np.minimum(up, speed + acceleration * dt), brake)
    return low, high
