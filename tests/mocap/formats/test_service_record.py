"""A record of the service is read as a recording of the person that its clients saw."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from service_recordings import Talk, recording, rewritten

from ergoqp import load_recording
from ergoqp.cli.main import execute
from ergoqp.errors import InputError, RecordingError
from ergoqp.files.mcap import MAGIC, profile_of
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.mocap.readers import BAG, RECORD, kind_of
from ergoqp.service.schema import Flag
from ergoqp.service.served import Served, served

HIDDEN = "right_wrist_flexion"


def posture_at(problem: Served, number: int) -> np.ndarray:
    """A posture (32,) [rad] that shows the rotation of the upper arms, too."""
    posture = problem.problem.response.comfort + 0.0
    for side in ("right", "left"):
        posture[INDEX[f"{side}_elbow_flexion"]] = 1.2
        posture[INDEX[f"{side}_knee_flexion"]] = 0.2
    posture[INDEX["trunk_flexion"]] = 0.3 + 0.2 * np.sin(number / 8)
    posture[INDEX["right_shoulder_flexion"]] = 0.6 + 0.2 * np.cos(number / 8)
    return np.clip(posture, LOWER + 0.02, UPPER - 0.02)


def work(talk: Talk, problem: Served, count: int) -> np.ndarray:
    """Step along a movement (count, 32) [rad]; a joint is hidden in a part of it."""
    postures = np.array([posture_at(problem, number) for number in range(count)])
    for number, posture in enumerate(postures):
        observed = np.ones(len(JOINTS))
        observed[INDEX[HIDDEN]] = not 10 <= number < 20
        talk.ask(posture, 0 if number else Flag.stands, observed=observed)
        if number % 5 == 0:
            talk.ask(None, Flag.enable)  # a frame that did not arrive
    return postures


@pytest.fixture(scope="module")
def screwing() -> Served:
    return served("screwing")


@pytest.fixture(scope="module")
def movement(screwing: Served, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A record, and the postures in it (40, 32) [rad]."""
    path = tmp_path_factory.mktemp("record") / "loop.mcap"
    with recording(path, screwing) as found:
        postures = work(found.talks["screwing"], screwing, 40)
    return path, postures


def test_the_postures_are_those_of_the_requests(movement: tuple[Path, np.ndarray]) -> None:
    path, postures = movement
    read = load_recording(path)
    assert read.postures.shape == postures.shape
    seen = read.observed
    np.testing.assert_allclose(read.postures[seen], postures[seen], atol=np.radians(0.6))
    assert seen.mean() > 0.97
    assert read.scored.all()
    assert (np.diff(read.time) > 0).all()
    assert any("8 steps without a posture are left out" in said for said in read.assumptions)


def test_a_joint_that_was_not_seen_is_not_seen(movement: tuple[Path, np.ndarray]) -> None:
    path, _ = movement
    read, joint = load_recording(path), INDEX[HIDDEN]
    hidden = np.zeros(40, dtype=bool)
    hidden[10:20] = True
    np.testing.assert_array_equal(read.observed[:, joint], ~hidden)
    np.testing.assert_allclose(read.low[hidden, joint], LOWER[joint], atol=1e-6)
    np.testing.assert_allclose(read.high[hidden, joint], UPPER[joint], atol=1e-6)
    # Nothing else is lost with it.
    assert read.observed[:, INDEX["right_wrist_deviation"]].all()
    window = load_recording(path, window=(read.time[12], read.time[25]))
    assert 8 <= (~window.observed[:, joint]).sum() < len(window.time)


def test_the_object_is_in_the_hand(movement: tuple[Path, np.ndarray], screwing: Served) -> None:
    path, postures = movement
    poses = load_recording(path).object_poses
    assert poses is not None
    contact, pelvis = screwing.problem.response.contact()(postures[0])
    expected = np.linalg.inv(np.array(pelvis)) @ np.array(contact)
    np.testing.assert_allclose(poses[0], expected, atol=1e-6)


def test_without_its_problem_it_has_no_object(
    movement: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    def broken(told: dict[str, str]) -> dict[str, str]:
        return {**told, "text": "nonsense = 1"} if "text" in told else told

    path = rewritten(movement[0], tmp_path / "broken.mcap", metadata=broken)
    read = load_recording(path)
    assert read.object_poses is None
    assert "The object is left out: its place beside the person is unknown." in read.assumptions
    assert len(read.time) == 40


def test_one_of_several_loops_is_chosen_by_name(screwing: Served, tmp_path: Path) -> None:
    path = tmp_path / "several.mcap"
    two = Served("screwing", screwing.text, screwing.folder, screwing.problem, 2)
    with recording(path, two) as found:
        for count, talk in zip((20, 30), found.talks.values(), strict=True):
            work(talk, screwing, count)
    for name, count in (("screwing.0", 20), ("screwing.1", 30)):
        assert len(load_recording(path, subject=name).time) == count
    with pytest.raises(RecordingError, match=r"got 2 loops .*screwing\.0.* state the loop"):
        load_recording(path)
    with pytest.raises(RecordingError, match=r"subject: got 'anna', allowed 'screwing\.0'"):
        load_recording(path, subject="anna")


def test_a_record_is_told_from_a_bag(movement: tuple[Path, np.ndarray], tmp_path: Path) -> None:
    path = movement[0]
    assert kind_of(path) is RECORD
    assert kind_of(rewritten(path, tmp_path / "bag.mcap", profile="ros2")) is BAG
    assert profile_of(MAGIC) is None
    named = tmp_path / "loop.record"
    named.write_bytes(path.read_bytes())
    assert any(
        "read as record of the service" in said for said in load_recording(named).assumptions
    )


def test_a_record_that_was_cut_off_or_broken(
    movement: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    whole, path = movement[0].read_bytes(), tmp_path / "cut.mcap"
    path.write_bytes(whole[: int(0.999 * len(whole))])
    assert "The file was cut off; it is read up to there." in load_recording(path).assumptions
    for share in (0.01, 0.1, 0.5):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(RecordingError, match="got a record without a posture"):
            load_recording(path)
    generator = np.random.default_rng(0)
    for _ in range(60):
        broken = bytearray(whole)
        for at in generator.integers(8, len(whole), 3):
            broken[at] ^= 1 << int(generator.integers(8))
        path.write_bytes(broken)
        with suppress(RecordingError, InputError):  # any other exception is none of a reader
            load_recording(path)


def test_score_and_run_read_it(
    movement: tuple[Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "scores"
    assert execute(["score", str(movement[0]), "--out", str(out)]) == 0
    assert (out / "scores.csv").read_text().count("\n") == 41
    # With one more for the head.
    given = ["run", "screwing", "--from", str(movement[0]), "--duration", "0.2"]
    assert execute([*given, "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run" / "run.json").is_file()
    capsys.readouterr()
