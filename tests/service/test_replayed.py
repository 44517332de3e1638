"""A record's steps are computed again bit for bit, and what was changed in it is found."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from service_recordings import Recording, Talk, recording, rewritten

from ergoqp.cli.main import execute
from ergoqp.errors import RecordingError
from ergoqp.joints import INDEX
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.service.record import MESSAGE_HEAD, Record, read_message, record_lost
from ergoqp.service.replayed import STATE, Replayed, record_wrong, replay_record
from ergoqp.service.schema import (
    ANSWER_HEAD,
    REQUEST_HEAD,
    Flag,
    Mark,
    Tell,
    answer_frame,
    request_frame,
)
from ergoqp.service.served import Served, served
from ergoqp.step.rest import UNKNOWN


@pytest.fixture(scope="module")
def screwing() -> Served:
    problem = load_problem("screwing")
    return served("screwing", guide=place_of(problem, problem.response.comfort))


@pytest.fixture(scope="module")
def eventful(screwing: Served, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record of a loop to which everything happens."""
    path = tmp_path_factory.mktemp("record") / "loop.mcap"
    with recording(path, screwing) as found:
        everything(found.talks["screwing"], screwing.problem, halfway=found.write)
    return path


def awkward(problem: Problem) -> np.ndarray:
    """A posture (32,) [rad] from which the object moves."""
    posture = problem.response.comfort + 0.0
    posture[[INDEX["trunk_flexion"], INDEX["right_shoulder_flexion"]]] += 0.3, 0.4
    return posture


def place_of(problem: Problem, posture: np.ndarray) -> np.ndarray:
    return np.array(problem.response.contact()(posture)[0])


def everything(talk: Talk, problem: Problem, rounds: int = 8, halfway: Any = None) -> None:
    """Have a loop go through all that changes its state otherwise than a usual step."""
    base, comfort = awkward(problem), problem.response.comfort
    place, goal = place_of(problem, base), place_of(problem, comfort)

    def posture() -> np.ndarray:
        return base + 0.01 * np.sin(talk.sequence / 20 + np.arange(len(comfort)))

    talk.ask(posture())  # the service does not know what the robot does
    talk.ask(posture(), Flag.stands, pose=place)
    for _ in range(rounds):
        talk.ask(posture())
        talk.ask(None, Flag.enable)  # a lost frame
        talk.ask(posture(), twist=talk.twist)
    seen = np.ones(len(comfort))
    seen[-1] = 0
    talk.ask(posture(), observed=seen)
    talk.ask(posture(), act=False)  # its answer came too late
    talk.ask(posture(), act=False, followed=2)
    talk.ask(posture(), followed=5)
    talk.ask(posture(), followed=1, dt=0.012)
    talk.sequence -= 1
    talk.ask(posture())  # a sequence again
    if halfway is not None:
        halfway()
    for _ in range(rounds):
        talk.ask(posture(), Flag.hold)
    talk.ask(posture(), Flag.try_again)
    for _ in range(rounds):
        talk.ask(posture(), guide=goal, promise=UNKNOWN)
    talk.ask(posture(), Flag.no_guide | Flag.explain)
    talk.ask(np.full(len(comfort), np.nan))
    talk.ask(posture(), Flag.brake)
    talk.ask(posture(), Flag.takes_over, twist=[0.01, 0.0, 0.0, 0.0, 0.0, 0.02])
    for _ in range(rounds):
        talk.ask(posture(), age=0.02)


def only(replayed: Replayed) -> Any:
    [loop] = replayed.loops.values()
    return loop


def test_everything_is_computed_again_bit_for_bit(eventful: Path) -> None:
    replayed = replay_record(eventful)
    assert replayed.exact
    assert replayed.notes == []
    assert replayed.steps == replayed.equal > 50
    assert replayed.first is None
    assert record_lost(eventful) == record_wrong(eventful) == 0
    marks, kinds, moves = 0, set(), 0
    for step in Record(eventful).messages():
        head = ANSWER_HEAD.unpack_from(step.answer)
        kinds.add(head[2])
        if head[2] == Tell.step:
            moves += bool(answer_frame(32, 36).numbers(step.answer, "twist").any())
        marks |= head[10]
        changes = head[10] & (Mark.begun | Mark.undone)
        changes |= REQUEST_HEAD.unpack_from(step.request)[8] & Flag.try_again
        assert not changes or step.state is not None
    assert kinds == {Tell.step, Tell.unknown, Tell.refused}
    assert moves > 30
    assert marks & Mark.begun
    assert marks & Mark.undone
    assert not marks & Mark.unrecorded


def test_a_worker_that_is_replaced_begins_anew(screwing: Served, tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with recording(path, screwing) as found:
        for _ in range(2):
            everything(found.talks["screwing"], screwing.problem, 2)
            found.work()
    assert only(replay_record(path)).equal == replay_record(path).steps > 40
    assert record_lost(path) == 0


@pytest.mark.parametrize("which", ["request", "answer"])
def test_a_flipped_bit_is_found(eventful: Path, tmp_path: Path, which: str) -> None:
    def flipped(_: str, data: bytes) -> bytes:
        step = read_message("", data)
        if step.number != 11:
            return data
        changed = bytearray(data)
        if which == "request":
            at = MESSAGE_HEAD.size + request_frame(32).at["posture"].start + 8 * 7
        else:
            at = MESSAGE_HEAD.size + len(step.request) + answer_frame(32, 36).at["twist"].start
        changed[at + 6] ^= 1
        return bytes(changed)

    path = rewritten(eventful, tmp_path / "flipped.mcap", flipped)
    replayed = replay_record(path)
    first = replayed.first
    assert first is not None
    assert first.number == 11
    assert "twist" in first.fields
    assert first.recorded is not None
    assert not np.array_equal(first.recorded, first.computed)
    # The next step begins where the robot is, which the changed request does not know.
    assert (replayed.wrong == 1) == (which == "answer")
    assert record_wrong(path) == replayed.wrong


@pytest.mark.parametrize("name", ["status", "causes", "knots", "cost", "stop", "reason"])
def test_every_field_counts(eventful: Path, tmp_path: Path, name: str) -> None:
    def changed(_: str, data: bytes) -> bytes:
        step = read_message("", data)
        if step.number != 9:
            return data
        at = MESSAGE_HEAD.size + len(step.request) + answer_frame(32, 36).at[name].start
        return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]

    first = replay_record(rewritten(eventful, tmp_path / "changed.mcap", changed)).first
    assert first is not None
    assert first.fields == (name,)


def test_a_changed_state_is_found(eventful: Path, tmp_path: Path) -> None:
    def changed(_: str, data: bytes) -> bytes:
        step = read_message("", data)
        if step.state is None or step.number < 20:
            return data
        at = MESSAGE_HEAD.size + len(step.request) + len(step.answer)
        return data[:at] + struct.pack("<d", step.state[0] + 1e-12) + data[at + 8 :]

    first = replay_record(rewritten(eventful, tmp_path / "state.mcap", changed)).first
    assert first is not None
    assert first.fields == (STATE,)


@pytest.mark.parametrize("gone", [range(3, 9), range(30, 32), range(0, 5), (2, 7, 31, 40)])
def test_it_continues_after_a_gap(eventful: Path, tmp_path: Path, gone: Any) -> None:
    def left_out(_: str, data: bytes) -> bytes | None:
        return None if read_message("", data).number in gone else data

    path = rewritten(eventful, tmp_path / "gap.mcap", left_out)
    loop = only(replay_record(path))
    assert loop.wrong == 0
    assert (loop.not_computed > 0) == (30 not in gone)  # a step whose state is recorded is next
    assert loop.equal > 20
    # What is missing at the very beginning may be in a file before this one.
    assert loop.missing == (0 if 0 in gone else len(gone))
    assert loop.steps == loop.equal + loop.not_computed
    assert record_lost(path) == len(gone)


def test_it_can_begin_at_every_recorded_state(eventful: Path, tmp_path: Path) -> None:
    states = [s.number for s in Record(eventful).messages() if s.state is not None]
    assert len(states) > 8
    for first in states:

        def later(_: str, data: bytes, first: int = first) -> bytes | None:
            return data if read_message("", data).number >= first else None

        loop = only(replay_record(rewritten(eventful, tmp_path / "later.mcap", later)))
        assert (loop.wrong, loop.not_computed) == (0, 0)


def test_another_machine_compares_within_a_tolerance(eventful: Path, tmp_path: Path) -> None:
    def elsewhere(told: dict[str, str]) -> dict[str, str]:
        return {**told, "machine": "pdp11"} if "machine" in told else told

    def nearly(_: str, data: bytes, much: float = 1e-12) -> bytes:
        step = read_message("", data)
        if len(step.answer) < 1000:
            return data
        at = MESSAGE_HEAD.size + len(step.request) + answer_frame(32, 36).at["twist"].start
        (twist,) = struct.unpack_from("<d", data, at)
        return data[:at] + struct.pack("<d", twist + much) + data[at + 8 :]

    path = rewritten(eventful, tmp_path / "there.mcap", nearly, elsewhere)
    replayed = replay_record(path)
    assert not replayed.exact
    assert replayed.notes[0].startswith("Recorded with machine pdp11, computed with ")
    assert replayed.wrong == 0
    assert replay_record(rewritten(eventful, tmp_path / "here.mcap", nearly)).wrong > 50
    far = rewritten(path, tmp_path / "far.mcap", lambda topic, data: nearly(topic, data, 1e-6))
    assert replay_record(far).wrong > 50


def test_another_problem_is_refused(eventful: Path, tmp_path: Path) -> None:
    def other(told: dict[str, str]) -> dict[str, str]:
        if "text" not in told:
            return told
        return {**told, "text": told["text"] + "\n# another\n"}

    path = rewritten(eventful, tmp_path / "other.mcap", metadata=other)
    with pytest.raises(RecordingError, match="is not the one that was served"):
        replay_record(path)

    def forearm(told: dict[str, str]) -> dict[str, str]:
        if "text" not in told:
            return told
        found = served("forearm")
        return {**told, "text": found.text, "digest": str(found.digest), "guide": ""}

    path = rewritten(eventful, tmp_path / "forearm.mcap", metadata=forearm)
    with pytest.raises(RecordingError, match="the requests of loop screwing do not fit it"):
        replay_record(path)


def test_a_file_that_was_cut_off_is_read_up_to_there(eventful: Path, tmp_path: Path) -> None:
    whole = eventful.read_bytes()
    found = set()
    for share in (0.7, 0.95, 0.999):
        path = tmp_path / "cut.mcap"
        path.write_bytes(whole[: int(share * len(whole))])
        replayed = replay_record(path)
        assert "The file was cut off; it is read up to there." in replayed.notes
        assert replayed.wrong == 0
        found.add(replayed.steps)
    assert max(found) == replay_record(eventful).steps > min(found)


def test_what_is_no_record_is_refused(eventful: Path, tmp_path: Path) -> None:
    path = tmp_path / "no.mcap"
    for content, words in (
        (b"", "is no record of the service"),
        (b"\x89MCAP0\r\n", "is no record of the service"),
        (b"nonsense" * 100, "is no record of the service"),
        (eventful.read_bytes()[:60], "holds no step"),
    ):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=words):
            replay_record(path)
    with pytest.raises(RecordingError, match="profile 'ros2'"):
        replay_record(rewritten(eventful, tmp_path / "ros.mcap", profile="ros2"))
    with pytest.raises(RecordingError, match="cannot be read"):
        replay_record(tmp_path)


def test_the_command(
    eventful: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], screwing: Served
) -> None:
    assert execute(["replay", str(eventful)]) == 0
    said = capsys.readouterr().out
    count = replay_record(eventful).steps
    assert said == f"loop screwing: {count} steps, {count} equal bit for bit\n"

    def changed(_: str, data: bytes) -> bytes | None:
        step = read_message("", data)
        at = MESSAGE_HEAD.size + len(step.request) + answer_frame(32, 36).at["twist"].start
        if step.number == 5:
            return None
        return data[:at] + struct.pack("<d", 7.0) + data[at + 8 :] if step.number == 4 else data

    path = rewritten(eventful, tmp_path / "changed.mcap", changed)
    assert execute(["replay", str(path)]) == 1
    said = capsys.readouterr().out
    assert "1 different, 1 missing in the record, which counts 0, " in said
    assert "not computed because steps before them are missing" in said
    assert "first different: step 4 of loop screwing, in twist\n  recorded twist 7 " in said
    assert execute(["replay", "pyproject.toml"]) == 2
    assert "pyproject.toml: is no record of the service" in capsys.readouterr().err


@pytest.mark.slow
def test_the_compiled_step_is_replayed_compiled(screwing: Served, tmp_path: Path) -> None:
    problem = served("screwing", guide=screwing.guide)
    problem.prepare(compiled=True)
    path = tmp_path / "compiled.mcap"
    with recording(path, problem) as found:
        everything(found.talks["screwing"], problem.problem)
    replayed = replay_record(path)
    assert replayed.exact
    assert replayed.equal == replayed.steps

    def begun(told: dict[str, str]) -> dict[str, str]:
        return {**told, "engine": "interpreted"} if "engine" in told else told

    # The answers tell how they were computed, whatever the service had begun with.
    later = replay_record(rewritten(path, tmp_path / "later.mcap", metadata=begun))
    assert later.equal == replayed.steps


def test_several_loops_are_kept_apart(screwing: Served, tmp_path: Path) -> None:
    path = tmp_path / "several.mcap"
    two = Served("screwing", screwing.text, screwing.folder, screwing.problem, 2, screwing.guide)
    with recording(path, two) as found:
        assert isinstance(found, Recording)
        for number in range(20):
            for name, talk in found.talks.items():
                bits = 0 if number else Flag.stands
                talk.ask(two.problem.response.comfort + 0.01 * len(name) * number, bits)
    replayed = replay_record(path)
    assert list(replayed.loops) == ["screwing.0", "screwing.1"]
    assert [each.equal for each in replayed.loops.values()] == [20, 20]
