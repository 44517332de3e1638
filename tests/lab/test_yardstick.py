"""The best that there is: places within the limits, scored by the person's own rest there."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.errors import InputError
from ergoqp.lab.yardstick import Judge, Place, Workspace
from ergoqp.limits import AxisCone, Ball, KeepOut, WorkspaceBox
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.best_place import workspace_map
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.people import person_of_kind


@pytest.mark.parametrize("name", TASKS)
def test_every_place_is_within_the_limits(name: str) -> None:
    problem = load_problem(name)
    places = Workspace(problem)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    toward = np.array(cone.direction) / np.linalg.norm(cone.direction)
    corners = np.array(np.meshgrid(*[[-1, 1]] * 5)).reshape(5, -1).T
    for point in [*places.spread(40), *corners]:
        pose = places.pose(point)
        assert np.all(pose[:3, 3] >= np.array(box.lower) - 1e-12)
        assert np.all(pose[:3, 3] <= np.array(box.upper) + 1e-12)
        assert pose[:3, 0] @ toward >= np.cos(np.radians(cone.half_angle_deg)) - 1e-9
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)


def test_places_are_spread_evenly() -> None:
    points = Workspace(load_problem("screwing")).spread(64)
    counts, _ = np.histogramdd(points[:, :3], bins=2, range=[(-1, 1)] * 3)
    assert counts.min() >= 5
    assert np.abs(points.mean(axis=0)).max() < 0.1


def test_a_place_is_scored_by_the_rest_there_and_the_start_stays() -> None:
    problem = load_problem("screwing")
    judge, person = Judge(problem), person_of_kind("follower", problem, 4)
    start = person.hold(person.comfort)
    before, pose = start.posture, judge.workspace.pose(np.array([0.2, -0.3, 0.5, 0.0, 0.0]))
    place = judge.carried(start, pose)
    np.testing.assert_array_equal(start.posture, before)
    there = start.copy()
    assert there.carry(pose)
    assert place.score == problem.assess(there.posture).final[0] > 0
    far = pose.copy()
    far[0, 3] += 3.0
    assert judge.carried(start, far).score == 0


def test_the_corners_of_the_cone_are_among_the_places() -> None:
    problem = load_problem("screwing")
    places, cone = Workspace(problem), problem.limit_of(AxisCone)
    for point in ([0, 0, 0, 1, 0], [0, 0, 0, -1, 0], [0, 0, 0, 0, 1], [0, 0, 0, 0, -1]):
        axis = places.pose(np.array(point, dtype=float))[:3, 0]
        tilt = np.degrees(np.arccos(axis @ np.array(cone.direction)))
        assert 0.8 * cone.half_angle_deg < tilt < cone.half_angle_deg


def test_what_a_limit_of_ones_own_forbids_is_no_place() -> None:
    problem = load_problem("screwing")
    person = person_of_kind("follower", problem, 4)
    start = person.hold(person.comfort)
    pose = Judge(problem).workspace.pose(np.array([0.0, 0.0, 0.2, 0.0, 0.0]))
    assert Judge(problem).carried(start, pose).score > 0
    region = KeepOut(Ball(tuple(pose[:3, 3]), 0.05))
    assert Judge(problem.replace(limits=[*problem.limits, region])).carried(start, pose).score == 0


def test_the_search_goes_on_from_the_best_both_ways_and_among_equals_from_the_surest() -> None:
    problem = load_problem("screwing")
    judge, low = Judge(problem), np.array([0.3, -0.4, 0.5, 0.2, -0.3])
    seen = []

    class Bowl(Judge):
        """Scores all 4, and says that one point is the surest."""

        def carried(self, start, pose):
            away = np.array([np.linalg.norm((pose - judge.workspace.pose(low))[:3])])
            seen.append(float(away[0]))
            return Place(pose, 4, float(away[0]), np.zeros(32))

    person = person_of_kind("follower", problem, 1)
    found = Bowl(problem).best(person.hold(person.comfort), places=12, around=1)
    assert min(seen[12:]) < 0.6 * min(seen[:12])
    assert found[0].value == min(seen)
    assert (
        Place(low, 3, 9.0, low).rank < Place(low, 4, 0.0, low).rank < Place(low, 0, 0.0, low).rank
    )


def test_the_best_is_no_worse_than_any_place_that_is_known() -> None:
    problem = load_problem("low_bin")
    judge, person = Judge(problem), person_of_kind("stubborn", problem, 2)
    start = person.hold(person.comfort)
    known = [judge.workspace.pose(point) for point in judge.workspace.spread(40)[-5:]]
    best = judge.best(start, known, places=8, around=1, enough=0)
    looked = [place.pose for place in best]
    assert all(any(np.array_equal(pose, other) for other in looked) for pose in known)
    scores = [place.score for place in best if place.score]
    assert best[0].score == min(scores)
    assert all(best[0].score <= (judge.carried(start, pose).score or 15) for pose in known)
    assert len(best) > 13, "places around the best are looked at too"


@pytest.mark.slow
def test_it_finds_what_a_fine_grid_finds_for_people_alike() -> None:
    """Against the older map by brute force, which settles place by place outward from comfort."""
    problem = load_problem("desk")
    judge = Judge(problem)
    for seed in range(3):
        person = sample_person(problem, seed)
        best = judge.best(person.hold(person.comfort))[0].score
        assert best <= workspace_map(problem, person).best


def test_nothing_more_is_looked_for_once_it_is_enough() -> None:
    problem = load_problem("screwing")
    judge, person = Judge(problem), person_of_kind("follower", problem, 1)
    assert len(judge.best(person.hold(person.comfort), enough=15)) == 1


def test_a_problem_without_a_workspace_is_refused() -> None:
    problem = load_problem("screwing")
    bare = problem.replace(limits=[each for each in problem.limits if type(each) is not AxisCone])
    with pytest.raises(InputError, match=r"got no limits\.tool_axis"):
        Workspace(bare)
