"""The best place: verified by the person and the sheet, the same wherever it is computed, and clear
about what is wrong."""

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.limits import AxisCone, JointLimit, TwistLimit, WorkspaceBox
from ergoqp.placing.optimise import SCREENED, StartSolver, begin_from, optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.rest.best_place import workspace_map
from ergoqp.rest.model_person import ModelPerson, sample_person


@pytest.fixture(scope="module")
def problem():
    return ergoqp.load_problem("dentist")


@pytest.fixture(scope="module")
def best(problem) -> Optimum:
    return optimise(problem, starts=6, seed=1)


def with_limit(problem, limit):
    return problem.replace(
        limits=[*(each for each in problem.limits if not isinstance(each, type(limit))), limit]
    )


class TestBest:
    @pytest.mark.slow
    def test_better_and_optimal(self, best):
        assert best.reba_after < best.reba_before
        assert best.kkt_residual <= 1e-6
        assert best.reba_after == min(trial.reba for trial in best.trials if trial.reba)
        assert best.mode == "stackelberg"

    def test_within_its_limits(self, problem, best):
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        assert (best.pose[:3, 3] >= np.asarray(box.lower) - 1e-9).all()
        assert (best.pose[:3, 3] <= np.asarray(box.upper) + 1e-9).all()
        assert best.pose[:3, 0] @ cone.direction >= np.cos(np.radians(cone.half_angle_deg)) - 1e-6
        np.testing.assert_allclose(best.pose[:3, :3].T @ best.pose[:3, :3], np.eye(3), atol=1e-12)

    def test_the_person_comes_to_rest_there(self, problem, best):
        person = ModelPerson(problem.response)
        grasp, soles = person.grasp(best.posture_before), person.stand(best.posture_before)
        settled, reached = person.settle(best.posture, best.pose, grasp, soles, steps=1000)
        assert reached
        np.testing.assert_allclose(settled, best.posture, atol=1e-4)
        assert problem.assess(settled).final[0] == best.reba_after

    def test_narrow_starts_begin_at_the_best_of_eight_places(self, problem, monkeypatch):
        person = ModelPerson(problem.response)
        begin = begin_from(person, problem.response.comfort, None)
        solver = StartSolver(problem, person, begin, "stackelberg", "ipopt", 3, 0.5)
        drawn = []
        settle = solver._settle

        def noted(posture, unknowns):
            rest, reached = settle(posture, unknowns)
            if reached:
                drawn.append(rest)
            return rest, reached

        monkeypatch.setattr(solver, "_settle", noted)
        for number, count in ((0, 1), (1, SCREENED), (2, 1), (3, SCREENED)):
            drawn.clear()
            _, rest = solver._draw(number)
            scores = problem.assess(np.array(drawn)).final
            assert len(drawn) == count
            assert problem.assess(rest).final[0] == scores.min()

    @pytest.mark.slow
    def test_as_low_as_brute_force(self):
        problem = ergoqp.load_problem("desk")
        person = sample_person(problem, 5)
        found = optimise(problem, starts=4, person=person)
        assert found.reba_after <= workspace_map(problem, person, cache=False).best

    def test_cooperative_is_no_worse(self, problem, best):
        bound = optimise(problem, starts=6, seed=1, mode="cooperative")
        assert bound.mode == "cooperative"
        assert bound.reba_after <= best.reba_after
        assert bound.kkt_residual <= 1e-6
        assert bound.cost_after <= best.cost_after + 1e-3

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["dentist", "desk"])
    @pytest.mark.parametrize("solver", ["fatrop", "sqpmethod"])
    def test_other_solvers(self, solver, name):
        problem = ergoqp.load_problem(name)
        found = optimise(problem, starts=2, seed=1, solver=solver)
        assert found.reba_after == optimise(problem, starts=2, seed=1).reba_after
        # CasADi's SQP method ends where it gets no further, within its 60 iterations.
        assert found.kkt_residual <= (1e-4 if solver == "sqpmethod" else 1e-6)

    def test_start_of_ones_own(self, problem, best):
        again = optimise(problem, best.posture_before, starts=6, seed=1, pose=best.pose_before)
        np.testing.assert_allclose(again.pose, best.pose, atol=1e-6)

    def test_another_body(self, problem):
        found = optimise(problem, starts=2, person=Body.of_stature(1.55))
        assert found.response.body.stature == 1.55
        assert any("1.55 m" in sentence for sentence in found.assumptions)

    def test_saved_and_loaded(self, best, tmp_path):
        again = Optimum.load(best.save(tmp_path))
        np.testing.assert_allclose(again.pose, best.pose, atol=1e-14)
        np.testing.assert_array_equal(again.posture, best.posture)
        assert repr(again) == repr(best)

    def test_progress(self, problem):
        shares = []
        optimise(problem, starts=2, progress=shares.append)
        assert shares == [0.5, 1.0]


class TestLimits:
    @pytest.mark.slow
    def test_object_that_only_rises_keeps_its_other_axes(self, problem, best):
        lift = with_limit(problem, TwistLimit(axes=("z",)))
        found = optimise(lift, best.posture_before, starts=2)
        np.testing.assert_allclose(found.pose[:2, 3], best.pose_before[:2, 3], atol=1e-9)
        np.testing.assert_allclose(found.pose[:3, :3], best.pose_before[:3, :3], atol=1e-9)

    def test_narrower_range_holds(self, problem, best):
        limit = JointLimit(ranges_deg={"right_elbow_flexion": (100, 140)})
        found = optimise(with_limit(problem, limit), starts=4, seed=1)
        elbow = ergoqp.JOINTS.index("right_elbow_flexion")
        assert best.posture[elbow] < np.radians(99)
        assert found.posture[elbow] >= np.radians(100) - 1e-3
        assert found.kkt_residual <= 1e-6

    @pytest.mark.slow
    def test_learned_cost_and_boundary(self):
        problem = ergoqp.load_problem("screwing_learned")
        found = optimise(problem, starts=2)
        assert found.tau_deg is None
        assert found.reba_after < found.reba_before
        boundary = problem.limits[-1]
        assert float(np.ravel(np.array(boundary.measure()(found.posture)))[0]) >= -0.051


class TestMistakes:
    @pytest.mark.parametrize(
        ("wrong", "words"),
        [
            (dict(mode="nice"), "mode: got 'nice', allowed stackelberg, cooperative"),
            (dict(solver="cplex"), "solver: got 'cplex', allowed ipopt, fatrop, sqpmethod"),
            (dict(starts=0), "starts: got 0"),
            (dict(starts=2.5), "starts: got 2.5"),
            (dict(seed=-1), "seed: got -1"),
            (dict(jobs=0), "jobs: got 0"),
            (dict(tau_deg=0.0), "tau_deg: got 0.0"),
            (dict(posture=np.zeros(31)), "posture: got shape"),
            (dict(posture=np.zeros(32), pose=np.zeros((4, 4))), "pose: got"),
            (dict(posture=np.zeros(32), pose="abc"), "pose: got 'abc', allowed a"),
            (dict(posture=np.zeros(32), pose=[[1], [1, 2]]), "pose: got .*, allowed a"),
            (dict(person="me"), "person: got 'me', allowed a person alike"),
        ],
    )
    def test_arguments(self, problem, wrong, words):
        with pytest.raises(InputError, match=words):
            optimise(problem, **wrong)

    @pytest.mark.slow
    def test_nothing_in_reach(self, problem, best):
        # Not so far that nobody could reach it: that is refused when the problem is made.
        far = with_limit(problem, WorkspaceBox((1.6, -0.2, 0.2), (1.7, 0.2, 0.3)))
        with pytest.raises(InputError, match=r"none of 2 starts ended .* \(2 out of reach\)"):
            optimise(far, best.posture_before, starts=2)

    def test_no_workspace(self, problem):
        limits = [limit for limit in problem.limits if not isinstance(limit, WorkspaceBox)]
        with pytest.raises(InputError, match=r"no limits\.workspace"):
            optimise(problem.replace(limits=limits))

    def test_object_where_it_may_not_be(self, problem, best):
        lift = with_limit(
            with_limit(problem, TwistLimit(axes=("z",))),
            WorkspaceBox((0.9, -0.2, 0.6), (1.0, 0.2, 1.2)),
        )
        with pytest.raises(InputError, match="where it cannot move"):
            optimise(lift, best.posture_before)

    def test_no_person(self):
        with pytest.raises(InputError, match="LinearResponse"):
            optimise(ergoqp.load_problem("forearm"))
