"""The recorder never delays a loop, and what it misses is counted to the last step."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from service_lines import COMFORT, Lines
from service_recordings import Talk, messages, recording, rewritten
from service_running import Running, running

from ergoqp.cli.main import execute
from ergoqp.errors import InputError
from ergoqp.service.client import Client
from ergoqp.service.record import (
    END_METADATA,
    MESSAGE_HEAD,
    Record,
    read_message,
    record_lost,
    record_schema,
)
from ergoqp.service.recorder import Disk, check_record
from ergoqp.service.replayed import record_wrong, replay_record
from ergoqp.service.schema import ANSWER_HEAD, Flag, Mark
from ergoqp.service.served import Served, served


@pytest.fixture(scope="module")
def screwing() -> Served:
    return served("screwing")


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder for sockets, whose paths must be short."""
    with tempfile.TemporaryDirectory(prefix="eqp") as found:
        yield Path(found)


def numbers(path: Path) -> list[int]:
    return [step.number for step in Record(path).messages()]


def unrecorded(path: Path) -> list[int]:
    """Steps whose answers say that an earlier one is not recorded."""
    return [
        step.number
        for step in Record(path).messages()
        if ANSWER_HEAD.unpack_from(step.answer)[10] & Mark.unrecorded
    ]


def ask(talk: Talk, served: Served, count: int) -> None:
    for _ in range(count):
        bits = 0 if talk.session else Flag.stands
        talk.ask(served.problem.response.comfort + 0.001 * talk.sequence, bits)


def test_what_is_in_a_record(screwing: Served, tmp_path: Path) -> None:
    path = tmp_path / "loop.mcap"
    with recording(path, screwing) as found:
        talk = found.talks["screwing"]
        ask(talk, screwing, 30)
        frames = bytes(talk.request.buffer), talk.ask(None)
    *_, last = Record(path).messages()
    assert last.answer == frames[1]
    assert last.loop == "screwing"
    assert abs(last.time_ns - time.time_ns()) < 60e9
    told = Record(path)
    assert len(list(told.messages())) == 31
    assert told.loops["screwing"]["text"] == screwing.text
    assert set(told.loops["screwing"]) > {"machine", "casadi", "numpy", "ergoqp", "dt", "guide"}
    assert told.counts == {"screwing": {"steps": 31, "lost": 0, "dropped": 0, "gone": 0}}
    [view, *_] = messages(path, "/screwing/view")
    assert view["status"] in ("optimal", "settled")
    assert len(view["posture_deg"]) == 32
    comfort = np.degrees(screwing.problem.response.comfort)
    assert list(view["posture_deg"].values()) == pytest.approx(comfort.tolist())
    assert set(view["margins"]) == set(screwing.problem.row_names)
    assert set(view["twist"]) == {"linear", "angular"}
    schema = json.loads(record_schema())
    assert [each["name"] for each in schema["message"]][:3] == ["worker", "number", "lost"]
    assert MESSAGE_HEAD.size == 48


def test_viewers_get_at_most_thirty_a_second(screwing: Served, tmp_path: Path) -> None:
    path = tmp_path / "loop.mcap"
    with recording(path, screwing) as found:
        begun = time.monotonic()
        ask(found.talks["screwing"], screwing, 200)
        took = time.monotonic() - begun
    assert 1 <= len(messages(path, "/screwing/view")) <= 30 * took + 2
    assert sum(step.state is not None for step in Record(path).messages()) <= took + 2


def test_any_reader_of_the_format_reads_it(screwing: Served, tmp_path: Path) -> None:
    from mcap.reader import NonSeekingReader, make_reader

    path = tmp_path / "loop.mcap"
    with recording(path, screwing) as found:
        ask(found.talks["screwing"], screwing, 30)
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count > 30
    with path.open("rb") as file:
        names = [each.name for each in make_reader(file).iter_metadata()]
        assert names == ["ergoqp loop screwing", END_METADATA]
    with path.open("rb") as file:
        steps = [
            m for _, c, m in NonSeekingReader(file).iter_messages() if c.topic.endswith("step")
        ]
    assert [step.sequence for step in steps] == list(range(30))


def test_what_does_not_fit_is_counted_and_marked(screwing: Served, tmp_path: Path) -> None:
    path = tmp_path / "loop.mcap"
    with recording(path, screwing) as found:
        talk = found.talks["screwing"]
        ask(talk, screwing, 5)
        found.recorder.drain()
        fed, marks = found.feed._fed["screwing"], 0
        while not fed.lost:  # nobody reads
            ask(talk, screwing, 1)
        lost_from = fed.number - 1
        for _ in range(7):
            ask(talk, screwing, 1)
            marks += bool(talk.answer[10] & Mark.unrecorded)
        assert (fed.lost, marks) == (8, 7)
        found.recorder.drain()
        ask(talk, screwing, 3)
    assert numbers(path) == [*range(lost_from), *range(lost_from + 8, lost_from + 11)]
    assert unrecorded(path) == [lost_from + 8]
    assert record_lost(path) == record_wrong(path) == 0
    [loop] = replay_record(path).loops.values()
    # The first step after a loss has its state.
    assert (loop.missing, loop.counted, loop.not_computed) == (8, 8, 0)
    gone = rewritten(path, tmp_path / "gone.mcap", lambda _, data: data if keep(data, 3) else None)
    assert record_lost(gone) == 1


def keep(data: bytes, without: int) -> bool:
    return read_message("", data).number != without


def test_a_backlog_is_dropped_and_counted(
    screwing: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "loop.mcap"
    with recording(path, screwing) as found:
        ask(found.talks["screwing"], screwing, 5)
        found.recorder.drain()
        with monkeypatch.context() as patch:
            patch.setattr(Disk, "full", True)
            ask(found.talks["screwing"], screwing, 4)
            found.recorder.drain()
        ask(found.talks["screwing"], screwing, 2)
    record = Record(path)
    assert [step.number for step in record.messages()] == [0, 1, 2, 3, 4, 9, 10]
    assert record.counts["screwing"]["dropped"] == 4
    assert record_lost(path) == 0


def test_a_recorder_after_another_counts_what_went_with_it(
    screwing: Served, tmp_path: Path
) -> None:
    path, second = tmp_path / "loop.mcap", tmp_path / "loop.1.mcap"
    with recording(path, screwing) as found:
        talk = found.talks["screwing"]
        ask(talk, screwing, 5)
        found.write()
        ask(talk, screwing, 4)
        found.recorder.drain()  # in the memory of the one that is killed
        ask(talk, screwing, 3)  # in the buffer
        found.again()
        ask(talk, screwing, 2)
    assert numbers(path) == [0, 1, 2, 3, 4]
    assert numbers(second) == [9, 10, 11, 12, 13]
    record = Record(second)
    assert list(record.messages())
    assert record.counts["screwing"]["gone"] == 4
    assert record_lost(path) == record_lost(path, second) == 0
    assert Record(path).cut_off is False
    assert replay_record(path).notes == ["The file was cut off; it is read up to there."]


def test_the_log_counts_over_all_recorders(
    screwing: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "loop.mcap"
    with recording(path, screwing) as found:
        talk = found.talks["screwing"]
        ask(talk, screwing, 5)
        found.write()
        ask(talk, screwing, 4)
        found.recorder.drain()  # gone with the first recorder
        found.again()
        ask(talk, screwing, 2)
        found.write()
        wait_for(lambda: found.disk.written == found.disk.tell())
        assert found.recorder.told() == "screwing: 7 steps are recorded, 4 are not"
        found.work()  # another worker
        ask(talk := found.talks["screwing"], screwing, 3)
        assert found.recorder.told() == "screwing: 7 steps are recorded, 7 are not"
        found.recorder.drain()
        with monkeypatch.context() as patch:
            patch.setattr(Disk, "full", True)
            ask(talk, screwing, 2)
            found.write()
        wait_for(lambda: found.disk.written == found.disk.tell())
        assert found.recorder.told() == "screwing: 10 steps are recorded, 6 are not"


def test_the_log_names_a_few_loops(screwing: Served, tmp_path: Path) -> None:
    many = dataclasses.replace(screwing, count=20)
    with recording(tmp_path / "loop.mcap", many) as found:
        for talk in found.talks.values():
            ask(talk, screwing, 2)
        words = found.recorder.told()
    assert words.startswith("screwing.0: 0 steps are recorded, 2 are not; screwing.1: 0 steps")
    assert words.endswith("; 12 other loops: 0 steps are recorded, 24 are not")


def wait_for(there: Callable[[], bool], seconds: float = 20.0) -> None:
    until = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < until
        time.sleep(0.01)


def recorder_of(service: Running, begun: int = 1) -> int:
    """Return the process of the newest recorder, once so many have begun."""
    found: list[str] = []

    def there() -> bool:
        found[:] = re.findall(r"recorded in .*: process (\d+)", service.log.read_text())
        return len(found) >= begun

    wait_for(there)
    return int(found[-1])


@pytest.fixture
def recorded(folder: Path) -> Iterator[tuple[Running, Path]]:
    """A service that is recorded, and the file."""
    path = folder / "loop.mcap"
    with running(folder / "s", "screwing", "--interpreted", "--record", str(path)) as service:
        service.client().close()
        recorder_of(service)
        yield service, path


def go(client: Client, served: Served, seconds: float) -> int:
    """Step at 100 Hz; return the number of steps that were not answered in time."""
    before, until = client.late + client.lost + client.refused, time.monotonic() + seconds
    while time.monotonic() < until:
        if not client.step(served.problem.response.comfort).fresh:
            client.reset()  # the test itself was too slow
        time.sleep(0.01)
    return client.late + client.lost + client.refused - before


def marked(client: Client) -> bool:
    """Whether the last answer says that an earlier one is not recorded."""
    return bool(ANSWER_HEAD.unpack_from(client._kept.view)[10] & Mark.unrecorded)


@pytest.mark.slow
def test_a_recorder_that_is_stopped_delays_nobody(
    recorded: tuple[Running, Path], screwing: Served
) -> None:
    service, path = recorded
    pid = recorder_of(service)
    with service.client(timeout=1.0) as client:
        client.reset()
        failed = go(client, screwing, 0.3)
        os.kill(pid, signal.SIGSTOP)
        # Until the buffer is full, and longer.
        until = time.monotonic() + 30
        while not marked(client) and time.monotonic() < until:
            if not client.step(screwing.problem.response.comfort).fresh:
                client.reset()
        assert marked(client)
        failed += go(client, screwing, 0.3)
        os.kill(pid, signal.SIGCONT)
        failed += go(client, screwing, 0.5)
        assert failed == client.late == client.lost == 0
    service.end()
    [loop] = replay_record(path).loops.values()
    assert loop.missing == loop.counted > 10
    assert (loop.wrong, loop.not_computed) == (0, 0)
    assert record_lost(path) == 0


@pytest.mark.slow
def test_a_recorder_that_is_killed_is_replaced(
    recorded: tuple[Running, Path], screwing: Served
) -> None:
    service, path = recorded
    with service.client(timeout=1.0) as client:
        client.reset()
        failed = go(client, screwing, 1.2)
        for number in range(2):
            os.kill(recorder_of(service, number + 1), signal.SIGKILL)
            recorder_of(service, number + 2)
            failed += go(client, screwing, 1.2)
        assert failed == client.late == client.lost == 0
    service.end()
    assert service.log.read_text().count("recorder ended after") == 2
    paths = [path, path.with_name("loop.1.mcap"), path.with_name("loop.2.mcap")]
    assert not path.with_name("loop.3.mcap").exists()
    assert record_lost(*paths) == record_wrong(*paths) == 0
    found = [number for each in paths for number in numbers(each)]
    assert found == sorted(set(found))
    gone = 0
    for each in paths:
        record = Record(each)
        assert list(record.messages())
        gone += record.counts["screwing"]["gone"]
    assert len(found) + gone == found[-1] + 1 > 50


@pytest.mark.slow
def test_a_worker_that_is_killed_is_recorded_too(
    recorded: tuple[Running, Path], screwing: Served
) -> None:
    service, path = recorded
    with service.client(timeout=1.0) as client:
        client.reset()
        go(client, screwing, 0.7)
        os.kill(service.worker(), signal.SIGKILL)
        go(client, screwing, 0.7)
    service.end()
    [loop] = replay_record(path).loops.values()
    assert len({step.worker for step in Record(path).messages()}) == 2
    assert loop.equal == loop.steps > 20
    assert record_lost(path) == 0


@pytest.mark.slow
def test_a_disk_that_is_full_ends_the_recording_alone(
    recorded: tuple[Running, Path], screwing: Served
) -> None:
    service, path = recorded
    with service.client(timeout=1.0) as client:
        client.reset()
        assert go(client, screwing, 1.2) == 0
        most = path.stat().st_size + 1000
        resource.prlimit(recorder_of(service), resource.RLIMIT_FSIZE, (most, most))
        assert go(client, screwing, 2.5) == 0
        assert client.late == client.lost == 0
    with service.client() as client:
        steps = client.description["health"]["steps"]
    service.end()
    log = service.log.read_text()
    assert log.count("the recording has ended: File too large") == 1
    said = re.findall(r"screwing: (\d+) steps are recorded, (\d+) are not", log)
    assert len(said) == 2
    (early, few), (last, missing) = [tuple(map(int, each)) for each in said]
    assert early == last == replay_record(path).steps
    assert 0 < few < missing
    assert last + missing == steps
    assert "is started again" not in log
    assert replay_record(path).wrong == 0
    assert replay_record(path).steps > 50


@pytest.mark.slow
def test_a_file_of_a_killed_service_is_readable(
    recorded: tuple[Running, Path], screwing: Served
) -> None:
    service, path = recorded
    with service.client(timeout=1.0) as client:
        client.reset()
        go(client, screwing, 2.0)
    service.process.kill()
    service.process.wait()
    replayed = replay_record(path)
    assert replayed.steps > 50
    assert replayed.wrong == 0
    assert record_lost(path) == 0


@pytest.mark.slow
def test_a_problem_that_is_loaded_is_not_recorded(folder: Path, screwing: Served) -> None:
    path, text = folder / "loop.mcap", served("desk").text
    arguments = ("screwing", "overhead", "--workers", "1", "--interpreted", "--record", str(path))
    with running(folder / "s", *arguments) as service:
        service.client().close()
        recorder_of(service)

        def step(loop: str, count: int) -> None:
            with Lines.by_unix(service.folder) as lines:
                for i in range(count):
                    report = {"followed": 1000} if i else {"standing": True}
                    said = {"loop": loop, "posture": COMFORT, **report}
                    assert "twist" in lines.ask(step=said)
                lines.ask(step={"loop": loop, "standing": True, "enable": False})

        def load(name: str) -> None:
            with Lines.by_unix(service.folder) as lines:
                assert lines.ask(describe={"loop": "overhead"})["recorded"] is True
                until = time.monotonic() + 20
                while "loaded" not in (answer := lines.ask(load={"name": name, "problem": text})):
                    assert time.monotonic() < until, answer
                assert answer["recorded"] is False

        for loop in ("screwing", "overhead"):
            step(loop, 10)
        load("screwing")
        load("mine")
        for loop in ("screwing", "overhead", "mine"):
            step(loop, 10)
    log = service.log.read_text()
    for name in ("screwing", "mine"):
        assert log.count(f"{name}: not recorded: its problem was sent by a client") == 1
    replayed = replay_record(path)
    assert {name: loop.steps for name, loop in replayed.loops.items()} == {
        "screwing": 11,
        "overhead": 22,
    }
    assert replayed.exact
    assert replayed.equal == replayed.steps
    assert all(not loop.missing for loop in replayed.loops.values())
    assert record_lost(path) == 0


def test_what_is_asked_for_is_checked_at_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "loop.mcap"
    check_record(path)
    path.touch()
    check_record(path, again=True)
    assert execute(["serve", "screwing", "--record", str(path)]) == 2
    assert f"--record: '{path}' exists already" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"there is no folder"):
        check_record(tmp_path / "nowhere" / "loop.mcap")
    with pytest.raises(InputError, match=r"the ending \.mcap"):
        check_record(tmp_path / "loop.bag")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="cannot write in"):
        check_record(tmp_path / "other.mcap")
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert execute(["serve", "screwing", "--record", str(tmp_path / "a.mcap")]) == 2
    assert "--record needs the package 'mcap': install it with" in capsys.readouterr().err
