"""A workspace in which nobody can hold the object is refused when the problem is made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import ProblemError
from ergoqp.human import Body
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, TwistLimit, WorkspaceBox
from ergoqp.problem.problem import no_room
from ergoqp.responses import IkResponse
from ergoqp.simulation.people import person_of_kind

WAY_OUT = "enlarge the workspace or loosen the limits"
FRONT = WorkspaceBox((0.25, -0.55, 0.7), (0.8, 0.35, 1.75))
LEFT, RIGHT = Box((0.2, -0.6, 0.6), (0.5, 0.4, 1.8)), Box((0.5, -0.6, 0.6), (0.9, 0.4, 1.8))


def kept(*regions: Any) -> list[KeepOut]:
    return [KeepOut(region, name=f"k{number}") for number, region in enumerate(regions)]


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ([WorkspaceBox((2.0, -0.5, 0.7), (2.6, 0.4, 1.7))], "40 out of reach"),
        ([WorkspaceBox((-0.5, -0.5, 3.1), (0.5, 0.4, 4.0))], "40 out of reach"),
        ([FRONT, *kept(Ball((0.5, 0.0, 1.0), 2.5))], "40 in k0"),
        ([FRONT, *kept(LEFT, RIGHT)], "18 in k0, 22 in k1"),
        ([FRONT, *kept(HalfSpace((1, 0, 0), 0.8))], "40 in k0"),
        (
            [WorkspaceBox((1.4, -0.5, 0.7), (2.5, 0.4, 1.7)), *kept(Box((1, -1, 0), (2.0, 1, 2)))],
            "18 in k0, 22 out of reach",
        ),
    ],
)
def test_a_workspace_without_a_place_is_refused_in_one_sentence(
    limits: list[Any], said: str
) -> None:
    base = ergoqp.load_problem("screwing")
    sentence = f"none of 40 places of the workspace can be a start ({said}); {WAY_OUT}"
    with pytest.raises(ProblemError) as caught:
        base.replace(limits=[TwistLimit(), *limits])
    assert str(caught.value) == f"limits: {sentence}"


@pytest.mark.parametrize(
    "limits",
    [
        # The tallest reach it with a step, some people only its nearest part.
        [WorkspaceBox((1.7, -0.5, 0.7), (2.6, 0.4, 1.7))],
        # All of its corners are out of reach, and its middle is not.
        [WorkspaceBox((-2.0, -2.0, 0.2), (2.0, 2.0, 2.5))],
        # A gap of 0.1 mm, a corner, and a region of a user, of which nobody knows where it ends.
        [FRONT, *kept(LEFT, Box((0.5001, -0.6, 0.6), (0.9, 0.4, 1.8)))],
        [FRONT, *kept(Ball((0.25, -0.55, 0.7), 1.42))],
        [FRONT, *kept(HalfSpace((1, 0, 0), 0.799))],
    ],
)
def test_a_workspace_with_a_place_is_not_refused(limits: list[Any]) -> None:
    assert ergoqp.load_problem("screwing").replace(limits=[TwistLimit(), *limits])


def test_a_model_of_larger_people_reaches_further() -> None:
    far = [WorkspaceBox((1.98, -0.5, 0.7), (2.6, 0.4, 1.7))]
    assert no_room(far, IkResponse(body=Body(1.75)))
    assert not no_room(far, IkResponse(body=Body(2.3)))


def test_a_response_that_is_no_body_says_nothing_of_reach() -> None:
    assert not no_room([WorkspaceBox((9.0, 9.0, 9.0), (9.1, 9.1, 9.1))], object())


@pytest.mark.parametrize("kind", ["alike", "mass", "stepping"])
def test_nobody_of_two_metres_ten_reaches_what_is_refused(kind: str) -> None:
    problem = ergoqp.load_problem("screwing")
    person, pose = person_of_kind(kind, problem, 0, Body(2.1)), np.eye(4)
    edge = next(
        x
        for x in np.arange(1.5, 2.5, 0.01)
        if no_room([WorkspaceBox((x, -0.3, 0.9), (x, 0.3, 1.2))], problem.response)
    )
    assert 1.9 < edge < 2.0
    pose[:3, 3] = edge, 0.0, 1.0
    assert not person.reach(pose)[1]
    pose[:3, 3] = 1.1, -0.1, 1.1
    assert person.reach(pose)[1]


def test_what_is_refused_has_no_free_place_and_most_that_has_none_is_refused() -> None:
    rng = np.random.default_rng(0)
    full = refused = 0
    for _ in range(150):
        regions: list[Any] = []
        for kind in rng.integers(3, size=rng.integers(1, 5)):
            at = rng.uniform([0.25, -0.55, 0.7], [0.8, 0.35, 1.75])
            if kind == 0:
                regions.append(Ball(tuple(at), float(rng.uniform(0.2, 1.3))))
            elif kind == 1:
                half = rng.uniform(0.1, 1.2, 3)
                regions.append(Box(tuple(at - half), tuple(at + half)))
            else:
                normal = rng.normal(size=3)
                normal /= np.linalg.norm(normal)
                regions.append(HalfSpace(tuple(normal), float(normal @ at + rng.uniform(-0.3, 1))))
        points = rng.uniform(FRONT.lower, FRONT.upper, (4000, 3))
        free = np.all([outside(region, points) for region in regions], axis=0)
        says = bool(no_room([FRONT, *kept(*regions)], object()))
        assert not (says and free.any())
        full, refused = full + (not free.any()), refused + says
    assert full > 40
    assert refused > 0.8 * full


def outside(region: Any, points: np.ndarray) -> np.ndarray:
    if isinstance(region, Ball):
        return np.linalg.norm(points - region.centre, axis=1) > region.radius
    if isinstance(region, HalfSpace):
        return points @ region.normal > region.offset
    return np.any((points < region.lower) | (points > region.upper), axis=1)


def test_a_file_is_refused_in_the_words_of_a_run(tmp_path: Path) -> None:
    text = (Path(ergoqp.__file__).parents[1] / "problems" / "screwing.toml").read_text()
    text = text.replace("lower = [0.25", "lower = [2.25").replace("upper = [0.80", "upper = [2.80")
    path = tmp_path / "far.toml"
    path.write_text(text)
    with pytest.raises(ProblemError) as caught:
        ergoqp.load_problem(path)
    assert str(caught.value) == (
        "far: limits: none of 40 places of the workspace can be a start (40 out of reach);"
        f" {WAY_OUT}"
    )
