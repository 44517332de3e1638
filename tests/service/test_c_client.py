"""The client in C: it compiles everywhere, gives the steps of a `Stepper`, and stops by itself."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from puppet import Fake, N, Puppet, step_answer
from scipy.spatial.transform import Rotation
from service_running import Running, running

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.service.c_header import header
from ergoqp.service.relay import EXECUTE, TOLD
from ergoqp.service.schema import (
    ANSWER,
    HEAD,
    REQUEST,
    REQUEST_HEAD,
    Ask,
    Flag,
    Tell,
    answer_frame,
    note,
    request_frame,
)
from ergoqp.step.causes import Cause, Status
from ergoqp.step.stepper import Stepper

PROBLEM = ergoqp.load_problem("screwing")
START = np.array(PROBLEM.response.comfort)
START[ergoqp.JOINTS.index("right_shoulder_flexion")] = 1.3
START[ergoqp.JOINTS.index("right_elbow_flexion")] = 0.5
STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")
FRAME = int(Flag.frame | Flag.enable)


@pytest.fixture
def puppet() -> Iterator[Puppet]:
    found = Puppet()
    yield found
    found.end()


@pytest.fixture(scope="module")
def stepper() -> Stepper:
    found = Stepper(PROBLEM)
    found.warm_up()
    return found


@pytest.fixture
def fake(tmp_path: Path) -> Iterator[Fake]:
    """A server whose stop has two knots: half of the twist, and zero."""
    found = Fake(tmp_path / "f", lambda asked: bytes(step_answer(asked)))
    yield found
    found.end()


def compile_c(folder: Path, text: str, *command: str) -> subprocess.CompletedProcess[str]:
    (folder / "ergoqp_client.h").write_text(header())
    (folder / "one.c").write_text(text)
    return subprocess.run(
        [*command, "one.c", "-o", "one"], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    "command",
    [
        ("gcc", "-std=c99"),
        ("gcc", "-std=c11"),
        *(("g++", "-x", "c++", f"-std=c++{year}") for year in (11, 14, 17, 20)),
    ],
    ids=lambda command: command[-1],
)
@pytest.mark.slow
def test_the_header_compiles_without_a_warning(command: tuple[str, ...], tmp_path: Path) -> None:
    text = (Path(__file__).with_name("puppet.c")).read_text()
    done = compile_c(tmp_path, text, *command, *STRICT, "-Wshadow", "-Wconversion")
    assert (done.returncode, done.stderr) == (0, "")


def test_it_shares_no_name_with_the_exported_step() -> None:
    names = set(re.findall(r"\bergoqp_\w+", header(), re.IGNORECASE)) - {"ergoqp_client"}
    assert [name for name in names if not name.lower().startswith("ergoqp_client_")] == []


def test_what_cannot_work_is_said_by_the_compiler(tmp_path: Path) -> None:
    late = compile_c(
        tmp_path, "#include <stdio.h>\n#include <ergoqp_client.h>\n", "gcc", "-std=c99", "-I."
    )
    assert "include it before other headers, or compile with -D_GNU_SOURCE" in late.stderr
    raw = Path(ergoqp.__file__).parent / "service/c/ergoqp_client.h"
    done = compile_c(tmp_path, f'#include "{raw}"\n', "gcc")
    assert "`ergoqp serve --header` prints the whole" in done.stderr
    big = compile_c(
        tmp_path, '#include "ergoqp_client.h"\n', "gcc", "-DERGOQP_CLIENT_MOST_ROWS=100000"
    )
    assert "capacities_within_a_frame" in big.stderr


def test_the_command_line_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["serve", "--header"]) == 0
    assert capsys.readouterr().out == header()


def test_its_frames_are_those_of_the_schema(tmp_path: Path) -> None:
    n, m, lines, expected = 5, 3, [], []
    for name, fields, frame in (
        ("REQUEST", REQUEST, request_frame(n)),
        ("ANSWER", ANSWER, answer_frame(n, m)),
    ):
        for field in fields:
            lines.append(f"ERGOQP_CLIENT_{name}_AT_{field.name.upper()}({n}, {m})")
            expected.append(frame.at[field.name].start)
        lines.append(f"ERGOQP_CLIENT_{name}_LENGTH({n}, {m})")
        expected.append(frame.length)
    for name, fields in (("relay_execute", EXECUTE), ("relay_told", TOLD)):
        start = 0
        for field in fields:
            lines.append(f"offsetof(ergoqp_client_{name}, {field.name})")
            expected.append(start)
            start += field.size({})
        lines.append(f"sizeof(ergoqp_client_{name})")
        expected.append(start)
    for kinds, group in ((Ask, "ASK"), (Tell, "TELL"), (Flag, "FLAG"), (Status, "STATUS")):
        for each in kinds:
            lines.append(f"ERGOQP_CLIENT_{group}_{each.name}".upper())
            expected.append(int(each))
    lines.append("ERGOQP_CLIENT_JOINT_RIGHT_ELBOW_FLEXION")
    expected.append(ergoqp.JOINTS.index("right_elbow_flexion"))
    prints = "".join(f'printf("%lu\\n", (unsigned long){line});\n' for line in lines)
    prints += 'printf("%s %s", ergoqp_client_cause_name(10), ergoqp_client_cause_name(99));\n'
    text = f'#include "ergoqp_client.h"\nint main(void) {{\n{prints}return 0;\n}}\n'
    done = compile_c(tmp_path, text, "gcc", "-std=c99")
    assert done.returncode == 0, done.stderr
    out = subprocess.run([tmp_path / "one"], capture_output=True, text=True, check=True).stdout
    *numbers, names = out.splitlines()
    assert [int(number) for number in numbers] == expected
    assert names == f"{Cause(10).name} unknown"


# ---------------------------------------------------------------------------------- live services


def moved(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Return where a period with a twist leads."""
    found = pose.copy()
    found[:3, :3] = Rotation.from_rotvec(0.01 * twist[3:]).as_matrix() @ pose[:3, :3]
    found[:3, 3] += 0.01 * twist[:3]
    return found


def test_it_gives_the_steps_of_a_stepper(
    service: Running, puppet: Puppet, stepper: Stepper
) -> None:
    stepper.reset()
    assert puppet.init(service.socket())
    assert puppet.waits
    puppet.ask("reset")
    posture, pose, twist = START.copy(), np.eye(4), np.zeros(6)
    for number in range(30):
        more: dict[str, Any] = {}
        flags = FRAME
        if number % 3 == 1:
            more["observed"] = np.arange(N) != number
            puppet.give("observed", more["observed"])
            flags |= Flag.observed
        if number > 20:
            more |= {"pose": pose, "twist": twist, "age": 0.003}
            puppet.give("pose", pose)
            puppet.give("twist", twist)
            puppet.ask("age", 0.003)
            flags |= Flag.pose | Flag.twist
        puppet.ask("flags", int(flags))
        mine, theirs = puppet.step(posture), stepper.step(posture, **more)
        assert mine.fresh, puppet.reason
        np.testing.assert_array_equal(mine.twist, theirs.twist)
        np.testing.assert_array_equal(mine.posture_rate, theirs.posture_rate)
        np.testing.assert_array_equal(mine.margins, list(theirs.margins.values()))
        assert (mine.status, mine.cost) == (theirs.status, theirs.cost)
        assert puppet.reason == theirs.reason
        posture = posture + 0.01 * mine.posture_rate
        pose, twist = moved(theirs.pose, theirs.twist), theirs.twist
    np.testing.assert_array_equal(puppet.stop(), stepper.stop())
    assert not puppet.waits
    np.testing.assert_array_equal(puppet.step(what="brake").twist, stepper.brake().twist)
    puppet.ask("flags", int(Flag.enable))
    np.testing.assert_array_equal(puppet.step(posture).twist, stepper.step(None).twist)
    assert puppet.reason.startswith("no posture arrived")
    puppet.ask("flags", FRAME)
    for order, call in (("hold", stepper.hold), ("try_again", stepper.try_again)):
        puppet.ask(order)
        call()
        for _ in range(2):
            mine, theirs = puppet.step(posture), stepper.step(posture)
            np.testing.assert_array_equal(mine.twist, theirs.twist)
            assert (mine.status, puppet.reason) == (theirs.status, theirs.reason)
    assert puppet.counters == (0, 0, 0)
    puppet.ask("flags", int(Flag.frame))
    assert puppet.step(posture).status == stepper.step(posture, enable=False).status == "braking"
    puppet.ask("explain", 0)
    puppet.give("posture", np.full(N, np.nan))
    assert puppet.step().status == "invalid"
    assert re.fullmatch(r"reason \d+", puppet.reason)
    puppet.ask("close")
    assert puppet.waits


def test_it_takes_over_by_the_measured_twist(
    service: Running, puppet: Puppet, stepper: Stepper
) -> None:
    twist = np.array([0.05, 0, -0.05, 0, 0.1, 0])
    stepper.reset(twist)
    puppet.init(service.socket())
    assert puppet.ask("take_over", 1.0, 2.0, float("nan"), 0, 0, 0) == "0"
    assert puppet.ask("take_over", *twist.tolist()) == "1"
    mine, theirs = puppet.step(START), stepper.step(START, twist=twist)
    np.testing.assert_array_equal(mine.twist, theirs.twist)
    puppet.ask("close")


def test_a_loop_has_one_commander(service: Running, puppet: Puppet) -> None:
    puppet.init(service.socket())
    puppet.ask("reset")
    assert puppet.step(START).fresh
    second = Puppet()
    second.init(service.socket())
    second.ask("reset")
    step = second.step(START)
    assert (step.fresh, step.twist.any()) == (False, False)
    assert f"commanded by process {puppet.process.pid}" in second.reason
    puppet.end()
    until = time.monotonic() + 10
    while not second.step(START).fresh:
        assert time.monotonic() < until
    second.end()


@pytest.fixture
def own_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running(tmp_path_factory.mktemp("s"), "screwing", "--interpreted") as found:
        found.client().close()
        yield found


def moving(puppet: Puppet, stepper: Stepper, path: Path) -> np.ndarray:
    """Step until the object moves; return the posture."""
    puppet.init(path, timeout=2.0)
    puppet.ask("reset")
    stepper.reset()
    posture = START.copy()
    for _ in range(25):
        step = puppet.step(posture)
        assert step.fresh, puppet.reason
        stepper.step(posture)
        posture = posture + 0.01 * step.posture_rate
    assert np.abs(step.twist).max() > 0.02
    return posture


@pytest.mark.slow
def test_a_worker_that_hangs_or_dies_leaves_the_certified_stop(
    own_service: Running, puppet: Puppet, stepper: Stepper
) -> None:
    for number in (signal.SIGSTOP, signal.SIGKILL):
        pid = own_service.worker()
        posture = moving(puppet, stepper, own_service.socket())
        expected = stepper.stop()
        os.kill(pid, number)
        # Nobody answers meanwhile, or the next worker, that it does not know the robot.
        np.testing.assert_array_equal(puppet.stop(), expected)
        for twist in expected:
            step = puppet.step(posture, "step") if number == signal.SIGKILL else quick(puppet)
            assert (step.fresh, step.status) == (False, "braking")
            np.testing.assert_array_equal(step.twist, twist)
            assert not step.posture_rate.any()
        assert puppet.reason
        if number == signal.SIGSTOP:
            # It goes on from what the robot executed: the whole stop, and the rest.
            assert "no answer in time" in puppet.reason
            assert puppet.counters[0] == len(expected)
            os.kill(pid, signal.SIGCONT)
            until = time.monotonic() + 20
            while not (step := puppet.step(posture)).fresh:
                assert time.monotonic() < until
                assert not step.twist.any()
            for _ in expected:
                stepper.brake()
            assert step.status == "optimal"
            np.testing.assert_allclose(step.twist, stepper.step(posture).twist, atol=1e-12)
        else:
            until = time.monotonic() + 20
            while not puppet.waits:
                assert time.monotonic() < until
                assert not puppet.step(posture).twist.any()
            assert puppet.reason.endswith("ergoqp_client_take_over")
            for _ in range(3):
                assert not puppet.step(posture).twist.any()
            puppet.ask("reset")
            assert puppet.step(posture).fresh
        puppet.ask("close")


def quick(puppet: Puppet) -> Any:
    """Step without patience."""
    puppet.ask("timeout", 0.01)
    step = puppet.step()
    puppet.ask("timeout", 2.0)
    return step


# ------------------------------------------------------------------------------- servers that lie


def changed(frame: bytearray, at: int, value: bytes) -> bytes:
    frame[at : at + len(value)] = value
    return bytes(frame)


LIES: list[Callable[[bytes], bytes | None]] = [
    lambda a: os.urandom(500),
    lambda a: b"HTTP/1.1 200 OK\r\n\r\n",
    lambda a: b"",
    lambda a: None,
    lambda a: bytes(step_answer(a))[:-9],
    lambda a: b"more" + bytes(step_answer(a)),
    lambda a: bytes(step_answer(a, twist=np.nan)),
    lambda a: bytes(step_answer(a, twist=np.inf)),
    lambda a: bytes(step_answer(a, times=np.nan)),
    lambda a: bytes(step_answer(a, times=-0.01)),
    lambda a: bytes(step_answer(a, times=0.02)),
    lambda a: bytes(step_answer(a, stop=np.nan)),
    lambda a: bytes(step_answer(a, knots=65)),
    lambda a: bytes(step_answer(a, knots=1, stop=0.05)),
    lambda a: bytes(step_answer(a, rows=129)),
    lambda a: HEAD.pack(1 << 31, 1, 2, 77, 1),
    lambda a: HEAD.pack(3, 1, 2, 77, 1),
    lambda a: HEAD.pack(24, 1, Tell.step, 77, HEAD.unpack_from(a)[4]),
    lambda a: HEAD.pack(24, 1, Tell.refused, 77, HEAD.unpack_from(a)[4]),
    lambda a: changed(step_answer(a), 4, b"\x09"),
    lambda a: changed(step_answer(a), 16, b"\x63"),
    lambda a: changed(step_answer(a), 44, b"\x07"),
    lambda a: note(Tell.refused, HEAD.unpack_from(a)[4], "no"),
    lambda a: note(Tell.unknown, HEAD.unpack_from(a)[4], "who?"),
    lambda a: note(Tell.described, HEAD.unpack_from(a)[4], "{}"),
]


@pytest.mark.parametrize("lie", LIES)
def test_an_answer_that_is_none_moves_nothing(
    fake: Fake, puppet: Puppet, lie: Callable[[bytes], bytes | None]
) -> None:
    fake.answer = lie
    puppet.init(fake.path, timeout=0.1)
    for _ in range(2):
        puppet.ask("reset")
        step = puppet.step(START)
        assert (step.fresh, step.twist.any()) == (False, False)
        assert puppet.reason
    # In motion it leaves the stop of the answer before.
    fake.answer = lambda asked: bytes(step_answer(asked))
    puppet.init(fake.path, timeout=2.0)
    puppet.ask("reset")
    until = time.monotonic() + 10
    while not puppet.step(START).fresh:
        assert time.monotonic() < until
    fake.answer = lie
    puppet.ask("timeout", 0.1)
    for twist in (0.05, 0.0, 0.0):
        step = puppet.step(START)
        assert not step.fresh
        np.testing.assert_array_equal(step.twist, twist)
    assert sum(puppet.counters)


def test_more_than_the_capacity_is_refused_by_name(fake: Fake, puppet: Puppet) -> None:
    puppet.init(fake.path)
    puppet.ask("reset")
    # There is room for 64 coordinates, and so for more rows than 128 with 32.
    fake.answer = lambda asked: bytes(step_answer(asked, rows=129))
    assert not puppet.step(START).fresh
    assert "of more rows than ERGOQP_CLIENT_MOST_ROWS" in puppet.reason
    fake.answer = lambda asked: bytes(step_answer(asked, rows=200))
    assert not puppet.step(START).fresh
    assert "compile it with a larger ERGOQP_CLIENT_MOST_ROWS" in puppet.reason
    assert not puppet.init(fake.path, coordinates=65)
    assert "ERGOQP_CLIENT_MOST_COORDINATES" in puppet.reason
    assert not puppet.init(fake.path, dt=0.0)
    assert "dt" in puppet.reason
    assert not puppet.init("/" + 200 * "x")
    assert "path" in puppet.reason


def test_late_answers_are_dropped_and_what_was_executed_is_said(fake: Fake, puppet: Puppet) -> None:
    puppet.init(fake.path, timeout=2.0)
    puppet.ask("reset")
    assert puppet.step(START).fresh
    first = REQUEST_HEAD.unpack_from(fake.requests[-1])
    assert (first[3:6], first[7]) == ((0, 1, 0), 0)
    assert first[8] == int(Flag.stands | Flag.explain) | FRAME

    def slow(asked: bytes) -> bytes:
        time.sleep(0.5)
        return bytes(step_answer(asked, twist=0.3))

    fake.answer = slow
    puppet.ask("timeout", 0.1)
    for twist in (0.05, 0.0):
        np.testing.assert_array_equal(puppet.step(START).twist, twist)
        assert "no answer in time" in puppet.reason
    assert puppet.counters == (2, 0, 0)
    assert len(fake.requests) == 2  # one is outstanding at a time
    time.sleep(1.0)
    fake.answer = lambda asked: bytes(step_answer(asked, twist=0.2))
    puppet.ask("timeout", 2.0)
    step = puppet.step(START)
    assert step.fresh
    np.testing.assert_array_equal(step.twist, 0.2)
    said = REQUEST_HEAD.unpack_from(fake.requests[-1])
    assert (said[3:6], said[7]) == ((77, 3, 1), 2)  # acted on the first, and two periods more
    assert said[8] == int(Flag.explain) | FRAME


def test_the_request_holds_what_was_given(fake: Fake, puppet: Puppet) -> None:
    layout = request_frame(N)
    pose, place, twist = np.arange(16.0), np.arange(16.0) / 7, np.arange(6.0)
    puppet.init(fake.path)
    puppet.ask("reset")
    for name, values in (("pose", pose), ("twist", twist), ("observed", np.arange(N) % 2)):
        puppet.give(name, values)
    puppet.ask("age", 0.25)
    puppet.ask("guide", *place.tolist(), 1.5)
    puppet.ask("flags", 8191)  # what is no part of the input has no effect
    puppet.step(np.arange(N) / 3)
    frame = fake.requests[-1]
    assert len(frame) == layout.length
    for name, values in (
        ("pose", pose),
        ("twist", twist),
        ("guide", place),
        ("promise", [1.5]),
        ("posture", np.arange(N) / 3),
        ("observed", np.arange(N) % 2),
    ):
        np.testing.assert_array_equal(layout.numbers(frame, name), values)
    head = REQUEST_HEAD.unpack_from(frame)
    assert head[9:] == (N, 0, 0.25, 0.01)
    given = Flag.frame | Flag.pose | Flag.twist | Flag.observed | Flag.enable
    assert head[8] == given | Flag.stands | Flag.guide | Flag.explain
    puppet.ask("no_guide")
    puppet.ask("hold")
    puppet.step(START)
    assert REQUEST_HEAD.unpack_from(fake.requests[-1])[8] == (
        given | Flag.no_guide | Flag.hold | Flag.explain
    )
    puppet.ask("try_again")
    for again in (Flag.try_again, Flag(0)):  # said until it was answered
        puppet.step(START)
        assert REQUEST_HEAD.unpack_from(fake.requests[-1])[8] == (
            given | Flag.no_guide | Flag.explain | again
        )
    puppet.step(what="brake")
    assert REQUEST_HEAD.unpack_from(fake.requests[-1])[8] == (
        Flag.brake | Flag.no_guide | Flag.explain
    )


def test_after_a_pause_the_stop_has_gone_on_and_it_asks(fake: Fake, puppet: Puppet) -> None:
    fake.answer = lambda asked: bytes(step_answer(asked, knots=10, dt=0.1))
    puppet.init(fake.path, dt=0.1, longest=0.3)
    puppet.ask("reset")
    assert puppet.step(START).fresh
    assert puppet.ask("send") == "1"
    time.sleep(0.45)
    step = puppet.step(START)
    assert step.fresh is False
    assert puppet.ask("send") == "0"  # the robot may have ramped down by itself
    assert puppet.waits
    assert "passed between two twists" in puppet.reason
    passed = float(puppet.reason.split()[0])
    # Two decimals of the time are said.
    np.testing.assert_allclose(step.twist, 0.1 * (1 - passed // 0.1 / 10), atol=0.0101)
    assert 0.0 < step.twist[0] < 0.07
    time.sleep(0.8)
    for _ in range(7):
        step = puppet.step(START)
    assert not step.twist.any()
    assert len(fake.requests) == 1
    # A pause of three periods is none.
    puppet.ask("reset")
    assert puppet.step(START).fresh
    time.sleep(0.15)
    assert puppet.step(START).fresh


def test_a_program_that_stopped_while_it_waited_has_paused(fake: Fake, puppet: Puppet) -> None:
    waits = [0.25, 0.25, 0.0, 0.8]

    def answer(asked: bytes) -> bytes:
        time.sleep(waits.pop(0))
        return bytes(step_answer(asked, knots=10, dt=0.1))

    fake.answer = answer
    puppet.init(fake.path, dt=0.1, timeout=0.4, longest=0.2)
    puppet.ask("reset")
    assert puppet.step(START).fresh  # it stood meanwhile
    step = puppet.step(START)
    assert not step.fresh
    assert puppet.ask("send") == "0"
    assert "passed between two twists" in puppet.reason
    assert puppet.waits
    # What counts is the time from twist to twist.
    waits[:0] = [0.0, 0.13]
    puppet.ask("reset")
    assert puppet.step(START).fresh
    time.sleep(0.13)
    assert not puppet.step(START).fresh
    assert puppet.waits
    # It has paused as well if no answer is there then.
    puppet.ask("reset")
    assert puppet.step(START).fresh
    assert not puppet.step(START).fresh
    assert puppet.ask("send") == "0"
    assert puppet.waits


def test_reset_forgets_the_stop(fake: Fake, puppet: Puppet) -> None:
    puppet.init(fake.path)
    puppet.ask("reset")
    assert puppet.step(START).fresh
    fake.answer = lambda asked: None
    puppet.ask("reset")  # the robot stands: no stop of before may move it
    assert not puppet.step(START).twist.any()
    assert not puppet.stop().any()


def test_until_it_is_answered_a_motion_that_is_taken_over_ramps_down(
    fake: Fake, puppet: Puppet
) -> None:
    fake.answer = lambda asked: None
    twist = np.array([-0.1, 0, 0, 0, 0.2, 0])
    puppet.init(fake.path, dt=0.1)
    puppet.give("limits", [1.0] * 6 + [0.25] * 3 + [1.0] * 3)
    puppet.ask("take_over", *twist.tolist())
    for share in (0.75, 0.5, 0.25, 0.0, 0.0):
        np.testing.assert_allclose(puppet.step(START).twist, share * twist, atol=1e-15)
    # Every new request tells what the robot was sent meanwhile.
    layout = request_frame(N)
    sent = [layout.numbers(each, "twist") for each in fake.requests]
    np.testing.assert_allclose(sent[0], twist)
    shares = {round(each[0] / twist[0], 6) for each in sent}
    assert shares <= {1.0, 0.75, 0.5, 0.25, 0.0}
    assert len(shares) > 1
    for each in fake.requests:
        assert REQUEST_HEAD.unpack_from(each)[8] & (Flag.takes_over | Flag.twist) == (
            Flag.takes_over | Flag.twist
        )
    # What was measured too long ago is no ground to move on.
    puppet.init(fake.path, dt=0.1, longest=0.2)
    puppet.ask("take_over", *twist.tolist())
    time.sleep(0.3)
    assert not puppet.step(START).twist.any()
    assert puppet.waits
    # Without declared limits it is within one period.
    puppet.init(fake.path, dt=0.1)
    puppet.ask("take_over", *twist.tolist())
    assert not puppet.step(START).twist.any()


def test_a_faster_robot_is_led_along_straight_lines(fake: Fake, puppet: Puppet) -> None:
    puppet.init(fake.path, dt=0.01)
    puppet.ask("reset")
    puppet.step(START)
    for seconds, share in (
        (-1.0, 0.0),
        (0.0, 0.0),
        (0.0025, 0.25),
        (0.01, 1.0),
        (0.015, 0.75),
        (0.02, 0.5),
        (0.025, 0.25),
        (0.03, 0.0),
        (9.0, 0.0),
    ):
        np.testing.assert_allclose(puppet.numbers("at", seconds), 0.1 * share, atol=1e-15)
    fake.answer = lambda asked: None
    time.sleep(0.05)  # the robot has come to rest meanwhile
    puppet.step(START)
    np.testing.assert_array_equal(puppet.numbers("at", 0.0), 0.0)
    np.testing.assert_allclose(puppet.numbers("at", 0.01), 0.05)
    np.testing.assert_allclose(puppet.numbers("at", 0.015), 0.025)


def test_a_line_begins_where_the_last_one_had_come_to(fake: Fake, puppet: Puppet) -> None:
    puppet.init(fake.path, dt=1.0)
    puppet.ask("reset")
    puppet.step(START)
    time.sleep(0.3)
    puppet.step(START)
    here = puppet.numbers("at", 0.0)[0]
    assert 0.03 <= here < 0.07
    np.testing.assert_allclose(puppet.numbers("at", 0.5), (here + 0.1) / 2)


def test_no_call_waits_longer_than_its_timeout(fake: Fake, puppet: Puppet) -> None:
    fake.answer = lambda asked: b""
    puppet.init(fake.path, timeout=0.1)
    puppet.ask("reset")
    for _ in range(3):
        begun = time.monotonic()
        puppet.step(START)
        assert time.monotonic() - begun < 0.3
    assert puppet.counters == (3, 0, 0)
    begun = time.monotonic()
    puppet.init("/nowhere/at.all", timeout=5.0)
    puppet.ask("reset")
    puppet.step(START)
    assert time.monotonic() - begun < 1.0
    assert puppet.reason == "service: nobody answers at /nowhere/at.all"
