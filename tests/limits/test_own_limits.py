"""A limit of the user's own is held by everybody: the step, the guide, the optimum, the maps, the
starts and the checker."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import pytest
from step_samples import Held, bold_of, comfort_of, held_pose, near_comfort, problem_of

from ergoqp.errors import InputError, ProblemError
from ergoqp.limits import Ball, KeepOut, LimitContext, Rows, WorkspaceBox
from ergoqp.limits.limit import straight_margins
from ergoqp.placing.optimise import optimise
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import awkward_start, workspace_map
from ergoqp.rest.model_person import ModelPerson, sample_person
from ergoqp.simulation.check import Checker
from ergoqp.step.stepper import Stepper


@dataclass(frozen=True)
class HalfSpace:
    """The contact point stays where normal . point >= least: a wall of the user's own."""

    normal: tuple[float, float, float]
    least: float
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    yield_zone: float = 0.0
    hard = True
    margin_is_lower_bound = False
    unit = "m"
    names = ("wall",)
    recovers = (True,)

    def measure(self) -> None:
        """Need nothing."""

    def rows(self, context: LimitContext) -> Rows:
        """One row, with one end."""
        matrix = ca.SX(1, 6)
        matrix[0, :3] = ca.DM(self.normal).T
        far = ca.dot(ca.DM(self.normal), context.pose[:3, 3]) - self.least
        free = ca.SX([ca.inf])
        return context.reduced("wall", Rows(matrix, far, free, free, ca.SX(1, 1)))

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Exact: it is straight."""
        return straight_margins(self.rows(context), displacement, context)


@dataclass(frozen=True)
class Said(HalfSpace):
    """One that says in a word what it holds."""

    kind: object = None

    def __init__(self, normal: tuple[float, float, float], least: float, kind: object) -> None:
        super().__init__(normal, least)
        object.__setattr__(self, "kind", kind)


@dataclass(frozen=True)
class Elbows:
    """The elbows are together bent by at least so much: a limit of the posture, measured outside of
    the scalars."""

    least: float
    tolerance: float = 1e-4
    recovery_time: float = 1.0
    yield_zone: float = 0.0
    hard = False
    margin_is_lower_bound = False
    unit = "rad"
    names: tuple[str, ...] = ("elbows",)
    recovers = (True,)
    joints: tuple[int, ...] = field(default=())

    def measure(self) -> ca.Function:
        """Their sum."""
        q = ca.MX.sym("q", 32)
        return ca.Function("sum", [q], [ca.sum1(q[list(self.joints)])])

    def rows(self, context: LimitContext) -> Rows:
        """One row through S."""
        matrix = ca.sum1(context.sensitivity[list(self.joints), :])
        shift = ca.sum1(context.shift[list(self.joints)])
        free = ca.SX([ca.inf])
        return Rows(
            matrix, context.readings["elbows"] + shift - self.least, free, free, ca.SX(1, 1)
        )

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Straight in the model."""
        return straight_margins(self.rows(context), displacement)


def walled(least: float, name: str = "screwing") -> Problem:
    problem = problem_of(name)
    return problem.replace(limits=[*problem.limits, HalfSpace((1.0, 0.0, 0.0), least)])


def test_nothing_is_own_in_the_problems_of_the_package() -> None:
    assert problem_of("screwing").own_limits.limits == ()
    assert problem_of("screwing").own_limits.ends is None
    assert problem_of("forearm").own_limits.limits == ()


def test_a_second_box_is_own() -> None:
    problem = problem_of("screwing")
    first = problem.limit_of(WorkspaceBox)

    class Second(WorkspaceBox):
        names = ("second x", "second y", "second z")

    second = Second(first.lower, first.upper)
    assert problem.replace(limits=[*problem.limits, second]).own_limits.limits == (second,)


def test_a_box_whose_rows_are_others_is_judged_by_them_too() -> None:
    problem = problem_of("screwing")
    first, *others = sorted(problem.limits, key=lambda each: not isinstance(each, WorkspaceBox))

    @dataclass(frozen=True)
    class Narrow(WorkspaceBox):
        def rows(self, context: LimitContext) -> Rows:
            """Half of it."""
            rows = super().rows(context)
            return replace(rows, to_upper=rows.to_upper - 0.1)

    class Named(WorkspaceBox):
        names = ("named x", "named y", "named z")

    narrow = Narrow(first.lower, first.upper)
    assert problem.replace(limits=[narrow, *others]).own_limits.limits == (narrow,)
    named = Named(first.lower, first.upper)
    # Places look at the first box there is: the second is judged by nobody else.
    assert problem.replace(limits=[named, *others]).own_limits.limits == ()
    assert problem.replace(limits=[named, first, *others]).own_limits.limits == (first,)


@pytest.mark.parametrize("kind", ["workspace", "joints"])
def test_a_word_for_what_it_holds_judges_nothing_by_itself(kind: str) -> None:
    """A wall that said to hold the workspace, and stood first, was judged by nobody."""
    pose = held_pose("screwing")
    wall, problem = Said((1.0, 0.0, 0.0), float(pose[0, 3]) + 0.05, kind), problem_of("screwing")
    problem = problem.replace(limits=[wall, *problem.limits])
    assert problem.own_limits.limits == (wall,)
    with pytest.raises(InputError, match="which is outside wall"):
        Stepper(problem, guide=pose)
    after = pose.copy()
    after[0, 3] -= 0.01
    broken = Checker(problem).check(
        np.zeros(6), np.zeros(6), pose, None, np.zeros(32), 0.01, after=after
    )
    assert broken == ["wall"]


@pytest.mark.parametrize("kind", ["height", "", 5, ["workspace"]])
def test_a_word_that_nobody_knows_is_refused(kind: object) -> None:
    problem = problem_of("screwing")
    with pytest.raises(
        ProblemError,
        match=r"^limits: kind of wall: got .*, allowed workspace, tool axis, joints, boundary,"
        " length, or None$",
    ):
        problem.replace(limits=[*problem.limits, Said((1.0, 0.0, 0.0), 0.1, kind)])


FIGURES = ["speed", "acceleration", "axes", "jerk", "workspace", "tool axis", "joint range"]
FIGURES += ["joint rate", "boundary", "arm length"]


@pytest.mark.parametrize("figure", FIGURES)
def test_no_row_is_named_like_a_figure_of_the_checker(figure: str) -> None:
    """It switched that figure off."""
    problem = problem_of("screwing")
    with pytest.raises(
        ProblemError,
        match=f"^limits: got a row named '{figure}', allowed other names than those of the"
        " checker's own figures: ",
    ):
        problem.replace(limits=[*problem.limits, KeepOut(Ball((5, 5, 5), 0.1), name=figure)])


def test_these_are_all_figures_of_the_checker() -> None:
    found = {
        name
        for problem in ("screwing", "screwing_learned", "forearm")
        for name in Checker(problem_of(problem)).units
    }
    assert found == set(FIGURES)


@pytest.mark.slow
def test_the_guide_is_not_a_place_behind_the_wall() -> None:
    pose = held_pose("screwing")
    Stepper(walled(pose[0, 3] - 0.01), guide=pose)
    with pytest.raises(
        InputError,
        match=r"guide: got the place \(.*\) m, which is outside wall, allowed where all limits"
        " hold",
    ):
        Stepper(walled(pose[0, 3] + 0.01), guide=pose)


@pytest.mark.slow
def test_the_step_and_the_checker_hold_it() -> None:
    wall = float(held_pose("screwing")[0, 3]) - 0.02
    bold, rng = bold_of("screwing"), np.random.default_rng(1)
    problem = bold.replace(limits=[*bold.limits, HalfSpace((1.0, 0.0, 0.0), wall)])
    loop, checker, nearest = Held(Stepper(problem), held_pose("screwing")), Checker(problem), np.inf
    previous = np.zeros(6)
    for number in range(400):
        if number % 50 == 0:
            q = near_comfort("screwing", rng, 60)
        before = loop.pose
        step = loop.step(q)
        assert (
            checker.check(
                step.twist,
                previous,
                before,
                q,
                step.posture_rate,
                0.01,
                stops=step.status == "braking",
            )
            == []
        )
        previous, nearest = step.twist, min(nearest, loop.pose[0, 3] - wall)
    assert -1e-8 <= nearest < 0.002
    # And the checker would have seen it.
    assert checker.check(
        np.array([-0.1, 0, 0, 0, 0, 0]),
        np.array([-0.1, 0, 0, 0, 0, 0]),
        loop.pose,
        None,
        np.zeros(32),
        5.0,
    )
    assert checker.units["wall"] == "m"
    assert checker.max_violation["wall"] > 0.01


def test_a_limit_of_the_posture_is_checked_by_what_it_measures() -> None:
    joints = (problem_of("screwing").coordinates.index("right_elbow_flexion"),)
    problem = problem_of("screwing")
    problem = problem.replace(limits=[*problem.limits, Elbows(1.0, joints=joints)])
    q, rate = comfort_of("screwing"), np.zeros(32)
    q[joints[0]], rate[joints[0]] = 1.01, -0.5
    checker, still = Checker(problem), np.zeros(6)
    assert checker.check(still, still, held_pose("screwing"), q, rate, 0.01) == []
    assert checker.check(still, still, held_pose("screwing"), q, rate, 0.05) == ["elbows"]
    assert checker.max_violation["elbows"] == pytest.approx(0.015)
    # Braking comes before it, and what gave way was said.
    assert checker.check(still, still, held_pose("screwing"), q, rate, 0.05, stops=True) == []
    assert (
        checker.check(still, still, held_pose("screwing"), q, rate, 0.05, gave_way=("elbows",))
        == []
    )


def test_a_place_without_a_posture_is_judged_by_limits_of_the_object_alone() -> None:
    joints = (problem_of("screwing").coordinates.index("right_elbow_flexion"),)
    problem = walled(0.3)
    own = problem.replace(limits=[*problem.limits, Elbows(1.0, joints=joints)]).own_limits
    inside, behind = np.eye(4), np.eye(4)
    inside[0, 3], behind[0, 3] = 0.4, 0.2
    straight, bent = np.zeros(32), np.zeros(32)
    bent[joints[0]] = 1.1
    assert [own.broken(pose) for pose in (inside, behind)] == ["", "outside wall"]
    assert [own.broken(inside, posture) for posture in (straight, bent)] == ["outside elbows", ""]
    assert own.broken(behind, bent) == "outside wall"


@pytest.mark.slow
@pytest.mark.parametrize("posture", [False, True], ids=["object", "posture"])
def test_the_optimum_holds_it(posture: bool) -> None:
    """A wall at 0.399 m, and the optimum stood at 0.349 without a word."""
    problem, start = problem_of("screwing"), comfort_of("screwing")
    free = optimise(problem, start, starts=6, seed=0)
    if posture:
        joints = tuple(
            problem.coordinates.index(f"{side}_elbow_flexion") for side in ("right", "left")
        )
        least = float(free.posture[list(joints)].sum()) + 0.1
        own = problem.replace(limits=[*problem.limits, Elbows(least, joints=joints)])
        found = optimise(own, start, starts=6, seed=0)
        assert free.posture[list(joints)].sum() < least
        assert found.posture[list(joints)].sum() >= least - 1e-3
    else:
        wall = float(free.pose[0, 3]) + 0.05
        found = optimise(walled(wall), start, starts=6, seed=0)
        assert found.pose[0, 3] >= wall - 1e-5
    assert found.reba_after >= free.reba_after
    assert found.kkt_residual < 1e-5


@pytest.mark.slow
def test_maps_and_starts_are_not_behind_the_wall() -> None:
    box = problem_of("low_bin").limit_of(WorkspaceBox)
    problem = walled((box.lower[0] + box.upper[0]) / 2, "low_bin")
    person = ModelPerson(problem.response)
    reached, plain = (
        workspace_map(each, person, spacing=0.2, cache=False)
        for each in (problem, problem_of("low_bin"))
    )
    behind = reached.poses[:, 0, 3] < (box.lower[0] + box.upper[0]) / 2 - 1e-5
    assert (plain.scores[behind] > 0).any()
    assert not reached.scores[behind].any()
    np.testing.assert_array_equal(reached.scores[~behind], plain.scores[~behind])
    for seed in range(3):
        someone = sample_person(problem, seed)
        posture = awkward_start(problem, someone, seed, 10)
        assert someone.contact(posture)[0][0, 3] >= (box.lower[0] + box.upper[0]) / 2 - 0.03


def test_it_goes_to_another_process() -> None:
    problem = problem_of("screwing")
    before = problem.own_limits
    again = pickle.loads(pickle.dumps(problem))
    assert again.own_limits.limits == before.limits == ()
    assert again.own_limits.every == again.row_limits
