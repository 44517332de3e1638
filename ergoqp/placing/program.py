"""The single-level program: the place of the object and the rest of the person in it.

It includes starting values, the solver and the residual.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.limits import JointLimit, OneClassBoundary
from ergoqp.placing.nlp_solvers import SETTINGS, check_names
from ergoqp.placing.optimality import Solution, optimality_function, violation
from ergoqp.placing.place import Place
from ergoqp.placing.rest import rest_conditions
from ergoqp.problem.problem import Problem
from ergoqp.responses.holding import Holding, Situated, hang
from ergoqp.responses.ik import IkResponse

EASE: Final = 1e-3
"""Weight of the person's comfort relative to the cost [points/rad^2 per unit of joint weight].

Where the sheet is flat, it selects the most comfortable of equally good places.
"""

NEAR: Final = 0.5
"""Largest change of a joint from its start in one solution of the program [rad]."""
NEAR_PELVIS: Final = 0.3
"""Largest change of the pelvis [m, rad]."""

N = len(JOINTS)
# weight of the contact residual in the multiplier guess
_LITTLE = 0.03
_INSIDE = 1e-3  # distance of starting values from the ends of joints [rad]


def smooth_cost(problem: Problem, posture: np.ndarray, tau_deg: float) -> float:
    """Return the cost of a posture (32,) [points].

    It is the smooth score at a scale [deg], or the problem's own cost if that is another one.
    """
    cost = problem.cost
    if isinstance(cost, SmoothReba):
        return cost.value_at_scale(posture, float(np.radians(tau_deg)))
    return float(np.ravel(cost(posture))[0])


class Program:
    """The nonlinear program of one problem and one person, with the data of a start as parameters.

    The unknowns are those of the place, then, for `mode="stackelberg"`, those of
    `ergoqp.placing.rest.Rest`; for `mode="cooperative"`: the moving joints, the pelvis and the
    turn of each hand about the tool. The success flag of the solver is not used.
    """

    def __init__(self, problem: Problem, response: IkResponse, mode: str, solver: str) -> None:
        """Build the program. The solver is created at its first use.

        Raises:
            InputError: as `Place.of`, or if the mode or the solver is unknown.
        """
        check_names(mode, solver)
        self.problem, self.response, self.mode, self.solver = problem, response, mode, solver
        self.place = Place.of(problem)
        self.moved = [INDEX[joint] for joint in response.chain]
        hands, cost = len(response.hands), problem.cost
        posture, anchor = ca.SX.sym("posture", N), ca.SX.sym("anchor", 4, 4)
        grasp, soles = ca.SX.sym("grasp", 4, 4 * hands), ca.SX.sym("soles", 4, 8)
        relaxation, tau = ca.SX.sym("relaxation"), ca.SX.sym("tau")
        unknowns = ca.SX.sym("x", len(self.place.kinds))
        position, rotation = self.place.expression(unknowns, anchor)
        situated = Situated(posture, grasp, soles, position, rotation, relaxation)
        own, q, self._rows = self._person(situated)
        x = ca.vertcat(unknowns, own)
        given = ca.vertcat(posture, ca.vec(grasp), ca.vec(soles), ca.vec(anchor), relaxation, tau)
        cosine = ca.dot(ca.DM(self.place.direction), rotation[:, 0])
        off = q[self.moved] - ca.DM(response.comfort[self.moved])
        ease = EASE / 2 * ca.dot(ca.DM(response.weight_vector[self.moved]), off**2)
        self._narrow = self._narrowed()
        rows = ca.vertcat(self._rows, cosine, q[self._narrow])
        self._count = x.numel()
        pose = ca.vertcat(ca.horzcat(rotation, position), ca.SX([[0, 0, 0, 1]]))
        own_ends = problem.own_limits.ends
        self._own = 0 if own_ends is None else own_ends.numel_out(0)
        boundary = problem.limit_of(OneClassBoundary)
        self._boundary = boundary is not None
        self._symbols = [x, given]
        smooth = isinstance(cost, SmoothReba)
        scalars = own_ends is None or own_ends.is_a("SXFunction")
        told: Any = (q, ease, rows, tau, pose)
        if not (smooth and scalars and boundary is None):
            # Terms that are not scalar expressions stay as they are, around the scalar model
            # of the person.
            model = ca.Function("model", [x, given], [q, ease, rows, tau, ca.densify(pose)])
            x, given = ca.MX.sym("x", x.numel()), ca.MX.sym("given", given.numel())
            told = model(x, given)
        q, ease, rows, tau, pose = told
        if boundary is not None:
            margin, _ = boundary.model.margin_and_slope(boundary.model.coordinates.pick(q))
            rows = ca.vertcat(rows, margin)
        if own_ends is not None:
            rows = ca.vertcat(rows, own_ends(q, pose))
        value = cost.at_scale(q, tau) if smooth else cost.expression(q)
        self._nlp: dict[str, Any] = {"x": x, "p": given, "g": rows, "f": value + ease}
        self.posture: Any = ca.Function("posture", [self._nlp["x"], self._nlp["p"]], [q])
        self._bounds = self._make_bounds()

    def given(
        self,
        posture: np.ndarray,
        grasp: np.ndarray,
        soles: np.ndarray,
        anchor: np.ndarray,
        relaxation: float,
        tau_deg: float,
    ) -> np.ndarray:
        """Return the parameters as numbers; `grasp` (k, 4, 4), `soles` (4, 8), `anchor` (4, 4)."""
        blocks = (posture, np.hstack(list(grasp)), soles, anchor)
        return np.concatenate(
            [*(np.ravel(block, order="F") for block in blocks), [relaxation, np.radians(tau_deg)]]
        )

    def start(
        self, unknowns: np.ndarray, posture: np.ndarray, pelvis: np.ndarray, given: np.ndarray
    ) -> np.ndarray:
        """Return starting values: a place (n,), the rest posture (32,) there, the pelvis (4, 4)."""
        x = np.zeros(self._count)
        leader, joints = len(unknowns), len(self.moved)
        x[:leader] = unknowns
        x[leader : leader + joints] = np.clip(posture, LOWER + _INSIDE, UPPER - _INSIDE)[self.moved]
        at = leader + joints
        if self.response.stance == "standing":
            x[at : at + 4] = *pelvis[:3, 3], np.arctan2(pelvis[1, 0], pelvis[0, 0])
            at += 4
        if self.mode == "stackelberg":
            x[at:] = self._multipliers(x, given, posture)
            held = self._at_end(posture)
            missing = np.array(self._forces(x, given)[1]).ravel()[:joints]
            x[leader + np.flatnonzero(held)] -= (missing / self.response.weight_vector[self.moved])[
                held
            ]
        return x

    def _multipliers(self, x: np.ndarray, given: np.ndarray, posture: np.ndarray) -> np.ndarray:
        """Return the multipliers that fit the balance of forces best.

        The force that holds a joint at its end is unknown, so the equation of that joint gives
        no information on the forces of the hands. Where the other equations are not
        sufficient, the contact residual contributes with a small weight.
        """
        slope, rest, yielding, missing = (np.array(part) for part in self._forces(x, given))
        held = np.append(self._at_end(posture), np.zeros(len(rest) - len(self.moved), dtype=bool))
        little = _LITTLE / self.response.damping**2
        rows = np.vstack([slope[~held], little * yielding])
        return np.linalg.lstsq(
            rows, -np.vstack([rest[~held], little * missing]).ravel(), rcond=None
        )[0]

    def _at_end(self, posture: np.ndarray) -> np.ndarray:
        ends = (posture <= LOWER + _INSIDE) | (posture >= UPPER - _INSIDE)
        return ends[self.moved]

    def solve(self, x: np.ndarray, given: np.ndarray) -> Solution:
        """Improve values near their start, and return them with their distance from optimality.

        Farther away than `NEAR` and `NEAR_PELVIS` the equations have solutions in which no
        person is at rest. The residual does not include these bounds, so a solution that stops
        at one of them is not optimal.
        """
        (low, high), (least, most) = self._bounds
        at = np.clip(x, low, high)
        nearest, farthest = self._around(at)
        near, far = np.maximum(low, nearest), np.minimum(high, farthest)
        try:
            found = self._solver(x0=at, p=given, lbx=near, ubx=far, lbg=least, ubg=most)
        except RuntimeError:
            # Some solvers raise when a value is not a number. This start then ends here.
            return Solution(at, float("inf"))
        values, on_rows, on_bounds = (
            np.array(found[key]).ravel() for key in ("x", "lam_g", "lam_x")
        )
        return Solution(values, self.residual(values, given, on_rows, on_bounds))

    def residual(
        self, x: np.ndarray, given: np.ndarray, on_rows: np.ndarray, on_bounds: np.ndarray
    ) -> float:
        """Return the largest violation of the optimality conditions; inf if any is not a number.

        It is taken over the slope of the Lagrangian [points per unit], the rows and bounds
        [their units], and the products of multipliers and distances to their ends. A positive
        multiplier belongs to the upper end.
        """
        slope, rows = (
            np.array(part).ravel() for part in self._optimality(x, given, on_rows, on_bounds)
        )
        bounded = zip(self._bounds, (x, rows), (on_bounds, on_rows), strict=True)
        return violation(slope, bounded)

    def _around(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values between which the solver may move, (n,) each; inf: no bound."""
        near = np.full(self._count, np.inf)
        leader, joints = len(self.place.kinds), len(self.moved)
        own = slice(leader, leader + joints)
        near[own] = NEAR
        if self.response.stance == "standing":
            near[leader + joints : leader + joints + 4] = NEAR_PELVIS
        low, high = x - near, x + near
        # An aim beyond the range only says how strongly the joint is held at its end.
        low[own] = np.where(
            low[own] < LOWER[self.moved], -np.inf, np.minimum(low[own], UPPER[self.moved] - NEAR)
        )
        high[own] = np.where(
            high[own] > UPPER[self.moved], np.inf, np.maximum(high[own], LOWER[self.moved] + NEAR)
        )
        return low, high

    @cached_property
    def _solver(self) -> ca.Function:
        options = {"error_on_fail": False, **SETTINGS[self.solver]}
        if self.solver == "fatrop":
            (_, _), (least, most) = self._bounds
            options["equality"] = (least == most).tolist()
        return ca.nlpsol("program", self.solver, self._nlp, options)

    @cached_property
    def _optimality(self) -> ca.Function:
        return optimality_function(self._nlp)

    def _person(self, situated: Situated) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the unknowns of the person, their posture (32,), and the equations."""
        if self.mode == "stackelberg":
            rest = rest_conditions(self.response, situated)
            own, equations = (
                ca.vertcat(rest.aims, rest.pelvis, rest.multipliers),
                ca.vertcat(rest.balance, rest.contact),
            )
            # The equations are linear in the multipliers, so least squares gives them at a
            # posture.
            self._balance = (
                rest.multipliers,
                rest.balance,
                rest.contact[: 6 * len(self.response.hands)],
            )
            return own, rest.posture, equations
        joints = ca.SX.sym("q", len(self.moved))
        pelvis = ca.SX.sym("b", 4 if self.response.stance == "standing" else 0)
        turns = ca.SX.sym("t", len(self.response.hands) if self.response.free_about_tool else 0)
        posture = ca.SX(situated.posture)
        for number, joint in enumerate(self.moved):
            posture[joint] = joints[number]
        hang(self.response, posture)
        holding = Holding(self.response, situated, posture, pelvis)
        errors = [
            error - (holding.about_tool(turns[i]) if turns.numel() else ca.SX(6, 1))
            for i, error in enumerate(holding.errors)
        ]
        return ca.vertcat(joints, pelvis, turns), posture, ca.vertcat(*errors, holding.slipping())

    @cached_property
    def _forces(self) -> ca.Function:
        multipliers, balance, contact = self._balance
        outputs = [
            ca.jacobian(balance, multipliers),
            balance,
            ca.jacobian(contact, multipliers),
            contact,
        ]
        return ca.Function("forces", self._symbols, [ca.densify(part) for part in outputs])

    def _narrowed(self) -> list[int]:
        """Return the moving joints whose range in the problem is narrower than the person's."""
        limit = self.problem.limit_of(JointLimit)
        if limit is None:
            return []
        low, high = limit.range
        return [
            joint for joint in self.moved if low[joint] > LOWER[joint] or high[joint] < UPPER[joint]
        ]

    def _make_bounds(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Return the bounds of unknowns and rows."""
        low, high = np.full(self._count, -np.inf), np.full(self._count, np.inf)
        leader = len(self.place.kinds)
        low[:leader], high[:leader] = self.place.lower, self.place.upper
        if self.mode == "cooperative":
            own = slice(leader, leader + len(self.moved))
            low[own], high[own] = LOWER[self.moved], UPPER[self.moved]
        equal = np.zeros(self._rows.numel())
        limit = self.problem.limit_of(JointLimit)
        ranges = limit.range if limit is not None else (LOWER, UPPER)
        cosines = (self.place.least_cosine, np.inf)
        ends = [
            np.concatenate([equal, [end], side[self._narrow]])
            for end, side in zip(cosines, ranges, strict=True)
        ]
        more = self._boundary + self._own
        ends = [np.append(ends[0], np.zeros(more)), np.append(ends[1], np.full(more, np.inf))]
        return (low, high), (ends[0], ends[1])
