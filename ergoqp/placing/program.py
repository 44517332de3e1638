"""The single-level program: the place of the object and the rest of the person in it.

The equations of the posture in which the person comes to rest. They are the optimality conditions
of the person, with relaxed complementarity.

A person who holds an object comes to rest at

    q = argmin 1/2 |q - c|^2_W + B/2 |pelvis - middle of the feet|^2 + a/2 |r(q)|^2 + |e(q)|^2 / d^2
    s.t.  soles stay, l <= q <= u

with c the comfort posture, B the weight of balance, a that of looking, r the residual between
eyes and work, and e the residual between grips and object, without the rotation about a free
tool. This is the fixed point of `ergoqp.rest.model_person.ModelPerson.settle`. With the
damping d the hands yield by less than a millimetre. With the multipliers y = e/d^2 of the
hands and m of the soles the conditions are

    W (s - c) = 2 J' y - a R' r - A' m,    e = d^2 y,    soles where they stand,    q = clip(s)

A hanging arm does not depend on the object. Its angles are a function of those of the trunk.

The unknown s is the posture before it is clipped to its ranges. W (s - q) is the multiplier of
the ranges (Robinson's normal map), so no inequality and no further unknown is needed. The clip
is made smooth after Chen, Harker, Kanzow and Smale. This relaxes complementarity to exactly
(q - l) (q - s) = relaxation^2 / 4.

It includes starting values, the solver and the residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_word
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.limits import JointLimit, OneClassBoundary
from ergoqp.placing.place import Place
from ergoqp.problem.problem import Problem
from ergoqp.responses.holding import Holding, Situated, hang
from ergoqp.responses.ik import IkResponse
from ergoqp.responses.stance_and_gaze import LEG_JOINTS

MODES: Final = ("stackelberg", "cooperative")
"""Who chooses the posture: the person alone, by coming to rest; or the optimiser too.

The second mode is an optimistic bound.
"""

SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "ipopt": {
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": 1e-9,
            "max_iter": 60,
            "mu_strategy": "adaptive",
        },
        "print_time": False,
    },
    "fatrop": {
        "fatrop": {"print_level": 0, "tol": 1e-9, "max_iter": 100},
        "structure_detection": "none",
        "print_time": False,
    },
    "sqpmethod": {
        "qpsol": "qrqp",
        "qpsol_options": {
            "print_iter": False,
            "print_header": False,
            "print_info": False,
            "error_on_fail": False,
        },
        "convexify_strategy": "regularize",
        "max_iter": 60,
        "tol_pr": 1e-9,
        "tol_du": 1e-8,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "print_time": False,
    },
}

SOLVERS: Final = tuple(SETTINGS)
"""Nonlinear solvers by name."""


def check_names(mode: str, solver: str) -> None:
    """Check the names of mode and solver.

    Raises:
        InputError: if one of them is unknown, or CasADi was built without the solver.
    """
    for what, value, allowed in (("mode", mode, MODES), ("solver", solver, SOLVERS)):
        check_word(what, value, allowed)
    if not ca.has_nlpsol(solver):
        others = ", ".join(name for name in SOLVERS if ca.has_nlpsol(name))
        raise InputError(
            f"solver: got {solver!r}, which this build of CasADi does not have, allowed {others}"
        )


@dataclass(frozen=True)
class Rest:
    """The conditions of rest.

    Attributes:
        aims: s of the moving joints, symbols (n,).
        pelvis: x, y, z and yaw of a standing person, symbols (4,); else empty.
        multipliers: y of the hands, then m of the soles, symbols.
        posture: q (32,).
        balance: equations that are linear in the multipliers, one per joint and pelvis
            coordinate, in this order.
        contact: the other equations: hands and soles.
    """

    aims: ca.SX
    pelvis: ca.SX
    multipliers: ca.SX
    posture: ca.SX
    balance: ca.SX
    contact: ca.SX


def rest_conditions(response: IkResponse, place: Situated) -> Rest:
    """Return the conditions under which a person is at rest with the object at a place."""
    standing, hands = response.stance == "standing", len(response.hands)
    moved = [INDEX[joint] for joint in response.chain]
    chain = [joint for joint in moved if joint < 20]
    aims, pelvis = ca.SX.sym("s", len(moved)), ca.SX.sym("b", 4 if standing else 0)
    y, m = ca.SX.sym("y", 6 * hands), ca.SX.sym("m", 12 if standing else 0)
    wanted, posture = ca.SX(place.posture), ca.SX(place.posture)
    for number, joint in enumerate(moved):
        wanted[joint] = aims[number]
        posture[joint] = soft_clip(aims[number], LOWER[joint], UPPER[joint], place.relaxation)
    hang(response, posture)
    holding = Holding(response, place, posture, pelvis)
    discomfort = ca.DM(response.weight_vector) * (wanted - ca.DM(response.comfort))

    compliance, forces, contact = response.damping**2, [], []
    for number, error in enumerate(holding.errors):
        force = y[6 * number : 6 * number + 6]
        free = holding.along_tool(force)
        forces.append(2 * (force - free))
        contact.append(compliance * force + free - (error - holding.along_tool(error)))
    on_chain, on_pelvis = holding.pull(forces, chain)
    seen, seen_by_pelvis = holding.looking(chain)
    balance = [discomfort[chain] - on_chain - seen]
    if standing:
        on_legs, on_base = holding.legs(m)
        for side, on_leg in zip(SIDES, on_legs, strict=True):
            balance.append(discomfort[[INDEX[name] for name in LEG_JOINTS[side]]] + on_leg)
        balance.append(on_base - on_pelvis - seen_by_pelvis)
    contact.append(holding.slipping())
    multipliers = ca.vertcat(y, m)
    return Rest(aims, pelvis, multipliers, posture, ca.vertcat(*balance), ca.vertcat(*contact))


def soft_clip(value: ca.SX, lower: float, upper: float, relaxation: ca.SX) -> ca.SX:
    """Return a value clipped to a range, smoothly.

    It is always strictly inside. At an end it is `relaxation` / 2 away from it.
    """
    below = ca.sqrt((value - lower) ** 2 + relaxation**2)
    above = ca.sqrt((upper - value) ** 2 + relaxation**2)
    return (lower + upper + below - above) / 2


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
    `ergoqp.placing.program.Rest`; for `mode="cooperative"`: the moving joints, the pelvis and the
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
            needed = missing / self.response.weight_vector[self.moved]
            x[leader + np.flatnonzero(held)] -= needed[held]
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
        right = -np.vstack([rest[~held], little * missing]).ravel()
        return np.linalg.lstsq(rows, right, rcond=None)[0]

    def _at_end(self, posture: np.ndarray) -> np.ndarray:
        ends = (posture <= LOWER + _INSIDE) | (posture >= UPPER - _INSIDE)
        return ends[self.moved]

    def solve(self, x: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, float]:
        """Improve the values (n,) near their start, and return them with their `residual`.

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
            return at, float("inf")
        values, *multipliers = (np.array(found[key]).ravel() for key in ("x", "lam_g", "lam_x"))
        return values, self.residual(values, given, *multipliers)

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
        worst = [np.abs(slope).max()]
        bounded = zip(self._bounds, (x, rows), (on_bounds, on_rows), strict=True)
        for (low, high), values, multipliers in bounded:
            worst.append(np.maximum(low - values, values - high).max(initial=0.0))
            end = np.where(multipliers > 0, high - values, values - low)
            # Without an end the multiplier must be zero.
            end = np.where(np.isfinite(end), end, 1.0)
            worst.append(np.abs(multipliers * end).max(initial=0.0))
        largest = float(np.max(worst))
        return largest if np.isfinite(largest) else float("inf")

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
        """``(x, p, on_rows, on_bounds) -> (slope of the Lagrangian, rows)``."""
        x, p, rows = (self._nlp[name] for name in "xpg")
        on_rows, on_bounds = (
            type(x).sym("on_rows", rows.numel()),
            type(x).sym("on_bounds", x.numel()),
        )
        slope = ca.gradient(self._nlp["f"] + ca.dot(on_rows, rows), x) + on_bounds
        return ca.Function("optimality", [x, p, on_rows, on_bounds], [slope, rows])

    def _person(self, situated: Situated) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the unknowns of the person, their posture (32,), and the equations."""
        if self.mode == "stackelberg":
            rest = rest_conditions(self.response, situated)
            own = ca.vertcat(rest.aims, rest.pelvis, rest.multipliers)
            # The equations are linear in the multipliers, so least squares gives them at a
            # posture.
            hands = rest.contact[: 6 * len(self.response.hands)]
            self._balance = rest.multipliers, rest.balance, hands
            return own, rest.posture, ca.vertcat(rest.balance, rest.contact)
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
            ca.densify(part)
            for each in (balance, contact)
            for part in (ca.jacobian(each, multipliers), each)
        ]
        return ca.Function("forces", self._symbols, outputs)

    def _narrowed(self) -> list[int]:
        """Return the moving joints whose range in the problem is narrower than the person's."""
        limit = self.problem.limit_of(JointLimit)
        if limit is None:
            return []
        low, high = limit.range
        return [j for j in self.moved if low[j] > LOWER[j] or high[j] < UPPER[j]]

    def _make_bounds(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the lower and upper bounds of the unknowns, and those of the rows."""
        low, high = np.full(self._count, -np.inf), np.full(self._count, np.inf)
        leader = len(self.place.kinds)
        low[:leader], high[:leader] = self.place.lower, self.place.upper
        if self.mode == "cooperative":
            own = slice(leader, leader + len(self.moved))
            low[own], high[own] = LOWER[self.moved], UPPER[self.moved]
        equal = np.zeros(self._rows.numel())
        limit = self.problem.limit_of(JointLimit)
        ranges = limit.range if limit is not None else (LOWER, UPPER)
        least, most = (side[self._narrow] for side in ranges)
        more = np.zeros(self._boundary + self._own)
        least = np.concatenate([equal, [self.place.least_cosine], least, more])
        most = np.concatenate([equal, [np.inf], most, np.full_like(more, np.inf)])
        return [(low, high), (least, most)]
