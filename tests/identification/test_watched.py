"""A loop as it was watched: its rests, and how late the person follows."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.files import read as npz
from ergoqp.identification.identify import Identifier
from ergoqp.identification.loops import LoopLog, delay_of, rests_in, watched
from ergoqp.rest.best_place import awkward_place
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.robot import moved
from ergoqp.simulation.run import Run

DT = 0.01


def led(late: float, noise_deg: float = 0.0, moves: bool = True, seed: int = 0) -> LoopLog:
    """Postures that are linear in where the object was `late` seconds before."""
    rng, n = np.random.default_rng(seed), 2000
    time = DT * np.arange(n)
    poses, postures = np.tile(np.eye(4), (n, 1, 1)), np.zeros((n, 32))
    # From place to place, a second each, and there for half a second.
    places = 0.15 * rng.uniform(-1, 1, (20, 3)) * moves
    stops = np.repeat(1.5 * np.arange(20), 2) + np.tile([0.0, 0.5], 20)

    def way(at: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(at, stops, np.repeat(axis, 2)) for axis in places.T], axis=1)

    poses[:, :3, 3] = way(time)
    postures[:] = 0.3 + way(time - late) @ rng.normal(size=(3, 32))
    postures += np.radians(noise_deg) * rng.standard_normal(postures.shape)
    return LoopLog(time, postures, poses)


@cache
def logged() -> tuple[Any, list[dict[str, Any]], Run, float]:
    """A loop with a follower: the problem, what the stepper's log got, the same as a run."""
    problem = ergoqp.load_problem("screwing")
    person = person_of_kind("follower", problem, 3)
    place, _ = awkward_place(problem, person, 3)
    holding, log = person.at(place, None, 3), []
    run = ergoqp.simulate(problem, holding.copy(), 25.0, 3)
    stepper, pose = ergoqp.Stepper(problem, log=log.append), place
    for _ in range(2500):
        pose = moved(pose, stepper.step(holding.posture, pose).twist * stepper.dt)
        holding.follow(pose, stepper.dt)
    return problem, log, run, holding.senses.delay + holding.senses.hand_time


@pytest.mark.parametrize("late", [0.0, 0.05, 0.123, 0.3, 0.4])
def test_a_known_delay_is_found(late: float) -> None:
    assert delay_of(led(late)) == pytest.approx(late, abs=2e-3)
    assert delay_of(led(late, noise_deg=2.0)) == pytest.approx(late, abs=0.03)


def test_a_delay_is_not_made_up() -> None:
    assert delay_of(led(0.2, noise_deg=2.0, moves=False)) is None
    assert delay_of(led(0.2, moves=False)) is None
    lost = led(0.2)
    noise = np.random.default_rng(0).standard_normal(lost.postures.shape)
    assert delay_of(LoopLog(lost.time, noise, lost.poses)) is None
    assert delay_of(LoopLog(lost.time, lost.postures * np.nan, lost.poses)) is None
    assert delay_of(LoopLog(lost.time[:50], lost.postures[:50], lost.poses[:50])) is None
    assert delay_of(led(0.9)) is None, "longer than any that is tried"


def test_lost_frames_and_uneven_periods_do_not_matter() -> None:
    loop, rng = led(0.2), np.random.default_rng(1)
    loop.postures[rng.random(len(loop.time)) < 0.2] = np.nan
    loop.postures[:, 4] = np.nan
    kept = rng.random(len(loop.time)) < 0.7
    loop = LoopLog(loop.time[kept], loop.postures[kept], loop.poses[kept])
    assert delay_of(loop) == pytest.approx(0.2, abs=0.01)


def test_every_stay_is_one_rest_the_last() -> None:
    n = 3000
    poses, postures = np.tile(np.eye(4), (n, 1, 1)), np.zeros((n, 32))
    # Ten seconds at each of three places, the first two seconds of each on the way.
    time = DT * np.arange(n)
    poses[:, 0, 3] = 0.2 * (time // 10) + 0.1 * np.minimum(time % 10, 2.0)
    postures[:] = (time // 10)[:, None] + 0.001 * (time % 10)[:, None]
    found = rests_in(LoopLog(time, postures, poses))
    assert len(found) == 3
    assert [round(float(rest.pose[0, 3]), 6) for rest in found] == [0.2, 0.4, 0.6]
    assert [rest.posture[0] // 1 for rest in found] == [0, 1, 2]
    assert all(rest.time % 10 > 8 for rest in found), "the last one, not the first"
    with pytest.raises(InputError, match="rests: got a loop in which the object never rested"):
        rests_in(led(0.1))


@pytest.mark.slow
def test_a_run_its_folder_and_a_log_say_who_stands_there(tmp_path: Path) -> None:
    problem, log, run, late = logged()
    run.save(tmp_path)
    people = [ergoqp.identify(problem, given) for given in (run, str(tmp_path), tmp_path, log)]
    for person in people:
        assert person.rests >= 1
        assert person.delay == pytest.approx(late, abs=0.06)
    np.testing.assert_array_equal(people[0].traits, people[1].traits)
    np.testing.assert_array_equal(people[1].traits, people[2].traits)
    again = Identifier(problem).identify(rests_in(watched(log)))  # type: ignore[arg-type]
    np.testing.assert_array_equal(people[3].traits, again.traits)
    pair = (run.postures[-1], run.poses[-1])
    assert ergoqp.identify(problem, [pair]).delay is None


@pytest.mark.slow
def test_what_a_log_did_not_see_is_not_seen() -> None:
    problem, log, _, _ = logged()
    entries = [dict(entry) for entry in log[:40]]
    entries[3]["observed"] = np.arange(32) != 5
    entries[4]["age"] = np.array([0.01])
    entries[5]["frame"] = np.array([0.0])
    loop = watched(entries)
    assert loop is not None
    assert np.flatnonzero(np.isnan(loop.postures[3])).tolist() == [5]
    assert np.isnan(loop.postures[4:6]).all()
    assert np.isfinite(loop.postures[6]).all()
    np.testing.assert_allclose(np.diff(loop.time), problem.dt)
    np.testing.assert_allclose(loop.poses[0, 3], [0, 0, 0, 1])


@pytest.mark.slow
def test_mistakes_are_one_sentence(tmp_path: Path) -> None:
    problem, log, _, _ = logged()
    with pytest.raises(InputError, match=r"rests: got the folder .*, allowed one that a run"):
        ergoqp.identify(problem, tmp_path)
    with pytest.raises(InputError, match="rests: entry 1 of the log is not one of a stepper's"):
        ergoqp.identify(problem, [log[0], {}])
    blind = dict(log[0]) | {"has_pose": np.array([0.0])}
    with pytest.raises(InputError, match="rests: entry 0 of the log has no pose"):
        ergoqp.identify(problem, [blind])


@pytest.mark.slow
def test_what_a_stepper_refused_and_its_braking_are_no_samples() -> None:
    problem, log, _, _ = logged()
    kept = watched(log)
    assert kept is not None
    entries = [dict(entry) for entry in log]
    for number, wrong in ((100, np.nan), (200, np.inf), (300, 1e12), (400, -1.0)):
        entries[number]["dt"] = np.array([wrong])
    entries[500] |= {"ask": np.array([1.0]), "has_pose": np.array([0.0])}
    loop = watched(entries)
    assert loop is not None
    assert len(loop.time) == len(kept.time) - 5
    assert loop.time[-1] == pytest.approx(kept.time[-1] - 4 * problem.dt)
    assert ergoqp.identify(problem, entries).rests >= 1


@cache
def logged_shortly() -> tuple[Any, list[dict[str, Any]]]:
    """The first steps of a loop: the problem, and what the stepper's log got."""
    problem, log = ergoqp.load_problem("screwing"), []
    posture = problem.response.comfort
    stepper = ergoqp.Stepper(problem, log=log.append)
    pose = ergoqp.Stepper(problem).step(posture).pose
    for _ in range(40):
        pose = moved(pose, stepper.step(posture, pose).twist * stepper.dt)
    return problem, log


@pytest.mark.parametrize("name", ["age", "ask", "frame", "observed", "posture", "pose", "dt"])
@pytest.mark.parametrize("wrong", [None, "text", [1.0, 2.0, 3.0], np.zeros((2, 2, 2))])
def test_entries_that_are_nearly_right_are_one_sentence(name: str, wrong: Any) -> None:
    problem, log = logged_shortly()
    entries = [dict(entry) for entry in log]
    del entries[7][name]
    with pytest.raises(InputError, match=r"^rests: entry 7 of the log is not one of a stepper's"):
        ergoqp.identify(problem, entries)
    entries[7][name] = wrong
    with suppress(InputError):  # a pose that is not read may be anything
        ergoqp.identify(problem, entries)


@pytest.mark.slow
def test_a_folder_with_a_pipe_or_too_much_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, _, run, _ = logged()
    run.save(tmp_path)
    monkeypatch.setattr(npz, "LARGEST", 10_000)
    with pytest.raises(InputError, match=r"got \d+ bytes of arrays, allowed 10000"):
        ergoqp.identify(problem, tmp_path)
    (tmp_path / "run.npz").unlink()
    os.mkfifo(tmp_path / "run.npz")
    with pytest.raises(InputError, match=r"^rests: got the folder .*is no file"):
        ergoqp.identify(problem, tmp_path)


@pytest.mark.slow
def test_folders_of_anything_are_one_sentence(tmp_path: Path) -> None:
    problem, _, run, _ = logged()
    run.save(tmp_path)
    whole, path = (tmp_path / "run.npz").read_bytes(), tmp_path / "run.npz"
    for wrong in (b"", b"PK", whole[:1000], whole[:-40], b"junk" * 100):
        path.write_bytes(wrong)
        with pytest.raises(InputError, match=r"^rests: got the folder"):
            ergoqp.identify(problem, tmp_path)
    right = {"time": run.time, "postures": run.postures, "poses": run.poses}
    mirror = run.poses.copy()
    mirror[5, :3, 0] *= -1
    for name, wrong in (
        ("postures", run.postures[:30]),
        ("time", run.time[:30]),
        ("postures", run.postures[:, :5]),
        ("poses", run.poses[:, :3, :3]),
        ("time", np.array(3.0)),
        ("time", run.time[:, None]),
        ("time", run.time.astype(str)),
        ("postures", run.postures * 1j),
        ("postures", run.postures * 1e200),
        ("poses", run.poses * 2),
        ("poses", mirror),
        ("time", run.time[::-1]),
        ("time", run.time * 0),
        ("time", run.time * 1e6),
        ("time", run.time * np.nan),
    ):
        np.savez(path, **(right | {name: wrong}))
        with pytest.raises(InputError, match=r"^rests: (got )?the folder"):
            ergoqp.identify(problem, tmp_path)
    np.savez(path, **right)
    assert ergoqp.identify(problem, tmp_path).rests >= 1
