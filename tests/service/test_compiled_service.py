"""A worker with the compiled step, which answers plain steps in machine code."""

from __future__ import annotations

import os
import re
import socket

import numpy as np
import pytest
from service_running import Running

import ergoqp
from ergoqp.service.schema import REQUEST_HEAD, VERSION, Ask, Flag, request_frame
from ergoqp.step.stepper import Stepper

PROBLEM = ergoqp.load_problem("screwing")
START = np.array(PROBLEM.response.comfort)
START[ergoqp.JOINTS.index("right_shoulder_flexion")] = 1.3


@pytest.fixture(scope="module")
def stepper() -> Stepper:
    return Stepper(PROBLEM, compiled=True)


@pytest.mark.slow
def test_two_loops_of_a_worker_do_not_disturb_each_other(
    compiled_service: Running, stepper: Stepper
) -> None:
    """They share the memory of one step, and are called in turn, with plain steps and others."""
    rng = np.random.default_rng(0)
    clients = [compiled_service.client(f"screwing.{i}", explain=bool(i)) for i in range(2)]
    own = [stepper.sibling(), stepper.sibling()]
    postures = [START.copy(), START + 0.1]
    for client in clients:
        client._longest = 60.0
        client.reset()
    for number in range(150):
        for i in rng.permutation(2):
            more = {}
            if number % 11 == 4 + i:
                more = {"observed": rng.random(32) < 0.8}
            elif number % 13 == 5:
                more = {"enable": False}
            mine, theirs = clients[i].step(postures[i], **more), own[i].step(postures[i], **more)
            assert mine.fresh
            np.testing.assert_array_equal(mine.twist, theirs.twist)
            np.testing.assert_array_equal(mine.posture_rate, theirs.posture_rate)
            np.testing.assert_array_equal(
                list(mine.margins.values()), list(theirs.margins.values())
            )
            assert mine.status == theirs.status
            assert mine.cost == theirs.cost
            if i:  # its numbers are up to ten steps old
                assert re.sub(r"[\d.]+", "", mine.reason) == re.sub(r"[\d.]+", "", theirs.reason)
            postures[i] = postures[i] + 0.01 * mine.posture_rate
    for client in clients:
        client.close()


@pytest.mark.slow
def test_a_loop_has_one_commander(compiled_service: Running) -> None:
    first = compiled_service.client("screwing.0")
    first._longest = 60.0
    first.reset()
    for _ in range(5):
        assert first.step(START).fresh
    with compiled_service.client("screwing.0") as second:
        second._session, second._acted = first._session, first._acted
        second._sequence = first._sequence + 100
        second._longest = np.inf
        step = second.step(START)
        assert not step.fresh
        assert f"commanded by process {os.getpid()} already" in step.reason
    assert first.step(START).fresh
    first.close()


@pytest.mark.slow
def test_what_a_client_does_not_read_ends_its_connection(compiled_service: Running) -> None:
    """It asks and asks, acting on answers that it has not read; nobody else has to wait for it."""
    path = str(compiled_service.socket("screwing.1"))
    layout, ended = request_frame(len(START)), False
    frame = bytearray(layout.length)
    layout.numbers(frame, "posture")[:] = START
    n, usual = len(START), int(Flag.frame | Flag.enable)
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.settimeout(5.0)
        deaf.connect(path)
        for number in range(1, 2000):
            # Each one begins anew, because the session is in an answer.
            bits = usual | int(Flag.stands)
            REQUEST_HEAD.pack_into(
                frame, 0, len(frame), VERSION, Ask.step, 0, number, 0, 0, 0, bits, n, 0, 0.0, 0.01
            )
            try:
                deaf.sendall(frame)
            except (BrokenPipeError, ConnectionResetError):
                ended = True
                break
    assert ended
    with compiled_service.client("screwing.1") as other:
        other.reset()
        assert other.step(START).fresh
