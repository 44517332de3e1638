"""One place for several people: the search against an independent enumeration, who pays, who cannot
reach, and the files."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ergoqp.cli.population import COLUMNS
from ergoqp.errors import InputError
from ergoqp.lab.group import best_for_group
from ergoqp.lab.group_search import (
    AXES,
    Equilibrium,
    PlaceSearch,
    drawn_people,
    keys,
    merit,
    read_people,
    shared_grid,
)
from ergoqp.lab.population import variant
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.placing.optimise import optimise
from ergoqp.placing.place import PoseParametrization
from ergoqp.problem.load import load_problem
from ergoqp.rest.best_place import workspace_poses

STATURES = (1.5, 1.7, 2.0)


@pytest.fixture(autouse=True, scope="module")
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def with_box(problem, lower, upper):
    box = WorkspaceBox(lower, upper)
    return problem.replace(
        limits=[box if isinstance(limit, WorkspaceBox) else limit for limit in problem.limits]
    )


@pytest.fixture(scope="module")
def low_bin():
    return load_problem("low_bin")


@pytest.fixture(scope="module")
def mean(low_bin):
    return best_for_group(low_bin, STATURES, "mean", starts=1, spacing=0.2)


@pytest.mark.slow
def test_the_group_rests_at_its_place_as_told(low_bin, mean):
    """Settled and scored here once more, without the search's code, from comfort."""
    scores = []
    for person, member in zip(read_people(low_bin, STATURES), mean.members, strict=True):
        follower = person.follower
        comfort = follower.response.comfort
        posture, reached = follower.settle(
            comfort, mean.pose, follower.grasp(comfort), follower.stand(comfort)
        )
        assert reached
        assert low_bin.assess(posture).final[0] <= member.reba
        assert low_bin.assess(member.posture).final[0] == member.reba
        assert np.allclose(follower.contact(member.posture)[0][:3, 3], mean.pose[:3, 3], atol=0.02)
        scores.append(member.reba)
    assert mean.maximum == max(scores)
    assert mean.mean == pytest.approx(np.mean(scores))


@pytest.mark.slow
def test_the_place_is_in_the_workspace(low_bin, mean):
    box, cone = low_bin.limit_of(WorkspaceBox), low_bin.limit_of(AxisCone)
    assert (mean.pose[:3, 3] >= np.array(box.lower) - 1e-9).all()
    assert (mean.pose[:3, 3] <= np.array(box.upper) + 1e-9).all()
    angle = np.arccos(np.clip(mean.pose[:3, 0] @ np.array(cone.direction), -1, 1))
    assert angle <= np.radians(cone.half_angle_deg) + 1e-6
    assert np.allclose(mean.pose[:3, :3].T @ mean.pose[:3, :3], np.eye(3))


@pytest.mark.slow
def test_between_the_places_is_never_worse_than_on_them(mean):
    reached = mean.grid.scores[:, mean.grid.reached_by_all]
    assert mean.mean <= reached.mean(axis=0).min()


@pytest.mark.slow
def test_nobody_is_better_off_than_alone(mean):
    assert all(member.pays >= 0 for member in mean.members)
    assert mean.own_mean <= mean.mean


@pytest.mark.slow
def test_a_fixed_place_is_never_better_than_one_that_can_be_adjusted(low_bin):
    grid = shared_grid(low_bin, read_people(low_bin, STATURES), 0.2)
    fixed = grid.scores[:, grid.reached_by_all].mean(axis=0).min()
    for number, axis in enumerate(AXES, start=1):
        free = grid.with_free(axis)
        assert free.shape[1] * grid.shape[number - 1] == grid.scores.shape[1]
        assert free[:, (free > 0).all(axis=0)].mean(axis=0).min() <= fixed
    # One entry by hand: the best height of the second person at the first place.
    column = grid.scores[1].reshape(grid.shape)[0, 0, :, 0]
    assert (
        grid.with_free("z")[1].reshape(grid.shape[0], grid.shape[1], grid.shape[3])[0, 0, 0]
        == column[column > 0].min()
    )


@pytest.mark.slow
def test_what_can_be_set_is_never_worse_than_fixed(mean):
    assert list(mean.free) == ["none", *AXES]
    assert mean.free["none"] == (mean.maximum, mean.mean)
    assert all(score <= mean.mean for _, score in mean.free.values())


@pytest.mark.slow
def test_the_grid_is_the_maps_own_in_the_order_of_the_poses(low_bin):
    people = read_people(low_bin, STATURES)
    grid = shared_grid(low_bin, people, 0.25)
    assert np.array_equal(grid.poses, workspace_poses(low_bin, 0.25))
    for number in range(0, grid.scores.shape[1], 7):
        follower, posture = people[0].follower, grid.postures[0, number]
        if grid.scores[0, number]:
            assert np.allclose(
                follower.contact(posture)[0][:3, 3], grid.poses[number, :3, 3], atol=0.02
            )
            assert low_bin.assess(posture).final[0] == grid.scores[0, number]


@pytest.mark.slow
def test_two_processes_find_the_same(low_bin):
    desk = load_problem("desk")
    one, two = (
        best_for_group(desk, (1.5, 1.9), spacing=0.25, starts=2, jobs=jobs, cache=False)
        for jobs in (1, 2)
    )
    assert np.array_equal(one.pose, two.pose)
    assert np.array_equal(one.grid.scores, two.grid.scores)
    assert [member.reba for member in one.members] == [member.reba for member in two.members]


@pytest.mark.slow
def test_a_stopped_study_goes_on_from_what_is_kept(low_bin, monkeypatch):
    people = read_people(low_bin, (1.6, 1.8))
    shared_grid(low_bin, people[:1], 0.2)
    settled = []
    monkeypatch.setattr(
        "ergoqp.rest.best_place._compute",
        lambda *arguments: settled.append(arguments) or _nothing(),
    )
    with pytest.raises(RuntimeError, match="only the second"):
        shared_grid(low_bin, people, 0.2)
    assert [person.response.body.stature for _, person, _ in settled] == [1.8]


def _nothing():
    raise RuntimeError("only the second")


def test_minimax_looks_at_the_worst_first():
    scores, costs = (
        np.array([[1, 3, 3, 0], [5, 3, 3, 1]]),
        np.array([[1.0, 3, 2, np.inf], [5.0, 3, 3, 1]]),
    )
    order = {
        objective: np.lexsort(keys(scores, costs, objective).T[::-1]).tolist()
        for objective in ("minimax", "mean")
    }
    assert order == {"minimax": [2, 1, 0, 3], "mean": [2, 1, 0, 3]}
    scores[0, 0], scores[1, 0] = 1, 4
    assert np.lexsort(keys(scores, costs, "mean").T[::-1])[0] == 0
    assert np.lexsort(keys(scores, costs, "minimax").T[::-1])[0] == 2


def test_the_soft_maximum_is_a_maximum():
    costs = np.array([[1.0, 2.0], [6.0, 2.0]])
    assert merit(costs, "minimax") == pytest.approx([6.0 + 0.25 * np.log(0.5), 2.0], abs=1e-6)
    assert merit(costs, "mean") == pytest.approx([3.5, 2.0])


def test_points_and_poses_are_the_same(low_bin):
    placing = PoseParametrization.of(low_bin)
    point = np.array([0.4, 0.1, 0.5, 0.2, -0.15])
    assert placing.point(placing.pose(point)) == pytest.approx(point)
    assert placing.holds(point)
    assert not placing.holds(point + np.array([0, 0, 0.2, 0, 0]))
    assert not placing.holds(np.array([0.4, 0.1, 0.5, 0.35, 0.35]))


def test_a_worse_way_to_a_place_counts(low_bin):
    people = read_people(low_bin, (1.7,))
    search = PlaceSearch(low_bin, people, shared_grid(low_bin, people, 0.2), "mean")
    stay = search.at(search.starts(1)[0])
    lucky = Equilibrium(stay.point, np.array([1]), np.array([0.5]), np.zeros((1, 32)))
    assert search.resettled_from_comfort(lucky).scores[0] > 1
    unlucky = replace(lucky, scores=np.array([14]))
    assert search.resettled_from_comfort(unlucky).scores[0] == 14


@pytest.mark.slow
def test_desk_can_only_rise_and_tilt():
    found = best_for_group(load_problem("desk"), (1.5, 1.9), starts=1)
    assert found.pose[:2, 3] == pytest.approx([0.42, 0.0])
    assert set(found.free) == {"none", "z", "tilt"}
    assert found.seated


@pytest.mark.slow
def test_who_cannot_reach_is_named(low_bin):
    far = with_box(load_problem("overhead"), (0.3, -0.1, 2.05), (0.4, 0.1, 2.1))
    with pytest.raises(InputError, match=r"group: 1\.40 m cannot reach any place of the workspace"):
        best_for_group(far, (1.4, 2.0), spacing=0.2)


def test_who_is_left_out_where_most_can_reach_is_named(low_bin, monkeypatch):
    scores = np.array([[2, 2, 0], [0, 3, 3], [4, 0, 4]])
    grid = SimpleNamespace(scores=scores, reached_by_all=(scores > 0).all(axis=0))
    monkeypatch.setattr("ergoqp.lab.group.shared_grid", lambda *arguments, **options: grid)
    with pytest.raises(
        InputError, match=r"no place is reached by all; where most can reach, 1\.60 m cannot"
    ):
        best_for_group(low_bin, (1.5, 1.6, 1.7))


@pytest.mark.slow
def test_drawn_people_are_of_their_seeds(low_bin):
    people = drawn_people(low_bin, 3, 4)
    assert [person.label.partition(", ")[2] for person in people] == ["seed 4", "seed 5", "seed 6"]
    again = drawn_people(low_bin, 2, 5)
    assert people[1].follower.response == again[0].follower.response
    assert best_for_group(low_bin, people[:1], starts=1, spacing=0.3).maximum <= 4


@pytest.mark.parametrize(
    ("count", "seed", "words"), [(1.5, 0, r"group: got 1\.5 people"), (1, "a", "seed: got 'a'")]
)
def test_what_draws_nobody_is_named(low_bin, count, seed, words):
    with pytest.raises(InputError, match=words):
        drawn_people(low_bin, count, seed)


def test_people_of_the_same_stature_keep_their_names_apart(low_bin):
    assert [person.label for person in read_people(low_bin, (1.7, 1.7, 1.7))] == [
        "1.70 m",
        "1.70 m (2)",
        "1.70 m (3)",
    ]


@pytest.mark.parametrize(
    ("people", "options", "words"),
    [
        ((), {}, "group: got 0 people"),
        ((1.7,) * 201, {}, "group: got 201 people"),
        ((3.0,), {}, "stature: got 3.0 m"),
        (("tall",), {}, "group: got a str, allowed statures"),
        ((1.7,), {"objective": "median"}, "objective: got 'median', allowed minimax, mean"),
        ((1.7,), {"spacing": 0.0}, "spacing: got 0.0 m"),
        ((1.7,), {"starts": 0}, "starts: got 0"),
        ((1.7,), {"jobs": 0}, "jobs: got 0"),
        (3, {}, "group: got 3, allowed a list"),
        ((1.7,), {"starts": "a"}, "starts: got 'a', allowed a whole number from 1 to 100"),
        ((1.7,), {"starts": 1.5}, r"starts: got 1\.5, allowed a whole number"),
        ((1.7,), {"spacing": "a"}, "spacing: got 'a', allowed a number of metres"),
        ((1.7,), {"jobs": "a"}, "jobs: got 'a', allowed a whole number"),
    ],
)
def test_mistakes_are_named(low_bin, people, options, words):
    with pytest.raises(InputError, match=words):
        best_for_group(low_bin, people, **options)


def test_other_hands_are_not_the_same_task(low_bin):
    with pytest.raises(InputError, match="hands"):
        read_people(low_bin, drawn_people(variant(low_bin, hands="right"), 1))


def test_a_workspace_is_needed(low_bin):
    bare = low_bin.replace(
        limits=[limit for limit in low_bin.limits if not isinstance(limit, AxisCone)]
    )
    with pytest.raises(InputError, match=r"has no limits\.tool_axis"):
        best_for_group(bare, (1.7,))


@pytest.mark.slow
def test_the_files(mean, tmp_path):
    summary = json.loads(mean.save(tmp_path / "out").read_text(encoding="utf-8"))
    assert summary["mean"] == pytest.approx(mean.mean)
    assert summary["free"]["none"]["maximum"] == mean.free["none"][0]
    assert [member["pays"] for member in summary["members"]] == [
        member.pays for member in mean.members
    ]
    assert summary["position_m"] == pytest.approx(mean.pose[:3, 3].tolist(), abs=1e-6)
    with np.load(tmp_path / "out" / "group.npz", allow_pickle=False) as arrays:
        assert arrays["scores"].shape == (3, *mean.grid.shape)
        assert arrays["labels"].tolist() == ["1.50 m", "1.70 m", "2.00 m"]


@pytest.mark.slow
def test_every_key_array_and_column_is_documented(mean, tmp_path):
    text = (Path(__file__).resolve().parents[2] / "docs" / "group_json.md").read_text(
        encoding="utf-8"
    )
    summary = json.loads(mean.save(tmp_path / "out").read_text(encoding="utf-8"))
    with np.load(tmp_path / "out" / "group.npz", allow_pickle=False) as arrays:
        keys = {
            *summary,
            *summary["members"][0],
            *summary["free"],
            *summary["free"]["none"],
            *arrays.files,
            *COLUMNS,
        }
    assert [key for key in sorted(keys) if f"`{key}`" not in text] == []


@pytest.mark.slow
def test_one_person_alone_is_the_single_optimum(low_bin):
    """Two methods that share nothing but the person and the sheet find the same score."""
    (member,) = best_for_group(low_bin, (1.75,), "mean", starts=2).members
    assert member.reba == member.own_reba == optimise(low_bin, starts=6).reba_after
