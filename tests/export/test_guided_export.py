"""The exported step that can be drawn to a place: equal to the step in Python, phase by phase."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_step import build, load_wrapper
from step_calls import wandering_steps

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.errors import InputError
from ergoqp.export.folder import export_step
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.problem import Problem
from ergoqp.simulation.robot import moved
from ergoqp.step.causes import Status
from ergoqp.step.guide import Guide, read_guide
from ergoqp.step.stepper import Stepper

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc"),
]


@cache
def task() -> tuple[Problem, np.ndarray, Optimum]:
    """A problem, a posture from which descent alone stays at a worse place, and a better one."""
    problem = ergoqp.load_problem("desk")
    posture = problem.response.comfort.copy()  # type: ignore[attr-defined]
    best = ergoqp.optimise(problem, posture, starts=4)
    return problem, posture, best


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, str]:
    problem, _, best = task()
    folder = tmp_path_factory.mktemp("export") / "step"
    export_step(problem, folder, Guide(best.pose, firm=True))
    text = (folder / "README.md").read_text()
    assert "`ergoqp_guide` sets another place" in text
    assert "@" not in text.replace("example", "")
    return load_wrapper(folder), str(build(folder))


def same(step: Any, answer: Any) -> None:
    assert Status(answer.status).name == step.status
    assert answer.drawn == step.drawn
    np.testing.assert_allclose(answer.twist[:], step.twist, atol=1e-9, rtol=0)
    np.testing.assert_allclose(answer.pose[:], step.pose.ravel(), atol=1e-9, rtol=0)


def test_it_is_drawn_as_in_python_phase_by_phase(exported: tuple[Any, str]) -> None:
    problem, posture, best = task()
    firm = Guide(best.pose, firm=True)
    stepper, other = Stepper(problem, guide=firm), exported[0].Stepper(exported[1])
    far = best.pose.copy()
    far[2, 3] -= 0.15
    pose, seen = stepper.step(posture).pose, set()
    other.step(posture)
    for number in range(6000):
        if number == 2500:
            stepper.guide(far)
            other.guide(far)
        if number == 4500:
            stepper.guide(best)
            other.guide(best.pose, read_guide(problem, best).expected)
        if number == 5500:
            stepper.try_again()
            other.try_again()
        if number == 5800:
            stepper.guide(None)
            other.guide(None)
        step, answer = stepper.step(posture, pose), other.step(posture, pose=pose.ravel())
        same(step, answer)
        seen.add(step.drawn)
        pose = moved(pose, step.twist * problem.dt)
        # A person who does not follow: places are judged, and found wanting.
        posture = posture + 0.7 * step.posture_rate * problem.dt
    assert {0, 1, 2} <= seen


def test_whatever_comes_in_the_answers_are_those_of_python(exported: tuple[Any, str]) -> None:
    problem, _, best = task()
    firm = Guide(best.pose, firm=True)
    stepper, other = Stepper(problem, guide=firm), exported[0].Stepper(exported[1])
    for call, step in wandering_steps(problem, stepper, 300, seed=5):
        given = {name: value for name, value in call.items() if name != "posture"}
        same(step, other.step(call["posture"], **given))


def test_to_begin_anew_or_to_take_over_is_the_first_place_again(
    exported: tuple[Any, str],
) -> None:
    problem, posture, best = task()
    other = exported[0].Stepper(exported[1])

    def first(stepper: Any) -> list[list[float]]:
        """Twists of a loop with somebody who stays as they are: where to shows in them."""
        here, twists = best.pose.copy(), []
        here[2, 3] += 0.1
        for _ in range(1000):
            twists.append(stepper.step(posture, pose=here).twist[:])
            here = moved(here, np.array(twists[-1]) * problem.dt)
        return twists

    before = first(other)
    other.reset()
    assert first(other) == before
    other.reset()
    other.guide(None)
    alone = first(other)
    other.take_over([0.0] * 6)
    assert first(other) == before, "the place that it was exported with"
    fresh = exported[0].Stepper(exported[1])
    fresh._memory.raw = b"\xff" * len(fresh._memory)
    fresh.take_over([0.0] * 6)
    assert first(fresh) == before, "nothing is left of what was in the memory"
    assert alone != before


def test_a_place_that_is_none_is_refused_and_changes_nothing(exported: tuple[Any, str]) -> None:
    _, posture, best = task()
    other, again = exported[0].Stepper(exported[1]), exported[0].Stepper(exported[1])
    mirror, far, skew, nan = (best.pose.copy() for _ in range(4))
    mirror[:3, 0] *= -1
    far[0, 3] = 101.0
    skew[:3, :3] *= 1.01
    nan[0, 0] = np.nan
    for wrong in (mirror, far, skew, nan, np.zeros((4, 4))):
        with pytest.raises(ValueError, match="guide: got what is no rigid pose"):
            other.guide(wrong)
    with pytest.raises(ValueError, match="guide: got what is no rigid pose or no number"):
        other.guide(best.pose, np.nan)
    with pytest.raises(ValueError, match="guide: got what is no rigid pose or no number"):
        other.guide(best.pose, np.inf)
    with pytest.raises(ValueError, match="guide: got 3 numbers, allowed 16"):
        other.guide([1.0, 2.0, 3.0])
    for _ in range(50):
        assert other.step(posture).twist[:] == again.step(posture).twist[:]


def test_one_that_knows_descent_alone_says_so(tmp_path: Path) -> None:
    problem = ergoqp.load_problem("forearm")
    export_step(problem, tmp_path / "step")
    wrapper, library = load_wrapper(tmp_path / "step"), str(build(tmp_path / "step"))
    stepper = wrapper.Stepper(library)
    with pytest.raises(ValueError, match="guide: this step was exported without one"):
        stepper.guide(np.eye(4))
    stepper.try_again()
    with pytest.raises(InputError, match="guide: problem forearm moves"):
        export_step(problem, tmp_path / "guided", np.eye(4))
    assert not (tmp_path / "guided").exists()
    assert "descends the cost" in (tmp_path / "step/README.md").read_text()


def test_the_command_takes_a_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, _, best = task()
    place = best.save(tmp_path / "optimum")
    arguments = ["export", "desk", "--out", str(tmp_path / "step"), "--guide"]
    assert execute([*arguments, str(place)]) == 0
    assert "int ergoqp_guide(" in (tmp_path / "step/include/ergoqp_step.h").read_text()
    assert execute([*arguments, str(tmp_path / "none.json")]) == 2
    assert "--guide:" in capsys.readouterr().err
