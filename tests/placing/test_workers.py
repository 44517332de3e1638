"""The same trials whoever solves the starts, and none of them lost when a run is killed."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.placing.ledger import FILE
from ergoqp.placing.optimise import optimise
from ergoqp.rest.best_place import awkward_start


@pytest.fixture(scope="module")
def problem():
    return ergoqp.load_problem("dentist")


@pytest.fixture(scope="module")
def alone(problem):
    return optimise(problem, starts=6, seed=3)


def same(one, other):
    assert len(one.trials) == len(other.trials)
    for trial, again in zip(one.trials, other.trials, strict=True):
        np.testing.assert_array_equal(trial.pose, again.pose)
        np.testing.assert_array_equal(trial.posture, again.posture)
        assert (trial.number, trial.reba, trial.kkt_residual) == (
            again.number,
            again.reba,
            again.kkt_residual,
        )
    np.testing.assert_array_equal(one.pose, other.pose)


@pytest.mark.slow
def test_same_in_two_processes(problem, alone):
    same(optimise(problem, starts=6, seed=3, jobs=2), alone)


def test_another_seed_begins_elsewhere(problem, alone):
    other = optimise(problem, alone.posture_before, starts=6, seed=4, pose=alone.pose_before)
    assert any(
        np.abs(a.pose - b.pose).max() > 0
        for a, b in zip(other.trials[1:], alone.trials[1:], strict=True)
    )


@pytest.mark.slow
def test_same_on_a_cluster(problem, alone):
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        host="127.0.0.1",
        silence_logs=50,
    )
    with cluster:
        same(optimise(problem, starts=6, seed=3, scheduler=cluster.scheduler_address), alone)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "ftp://127.0.0.1:8786"])
def test_no_cluster_there(problem, alone, address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("ergoqp.placing.workers.TIMEOUT", 0.5)
    with pytest.raises(
        InputError, match=r"scheduler: got .*, allowed the address of a Dask scheduler that answers"
    ):
        optimise(problem, alone.posture_before, starts=2, scheduler=address)
    # A client that is left would be closed by the garbage collector, in the midst of the next
    # client's start, and wait there for ever.
    assert not [thread for thread in threading.enumerate() if thread.name == "IO loop"]


def test_what_cannot_be_sent(problem, alone):
    class Own:
        name, minimum = "own", 1.0
        symbol = ca.MX.sym("not to be sent")

        def __call__(self, postures):
            return 1 + (np.atleast_2d(postures) ** 2).sum(axis=1)

        def expression(self, q):
            return 1 + ca.sumsqr(q)

    with pytest.raises(
        InputError, match=r"jobs: the terms of problem dentist cannot be sent to other processes"
    ):
        optimise(problem.replace(cost=Own()), alone.posture_before, starts=2, jobs=2)


CHILD = """
import sys, ergoqp
ergoqp.optimise(ergoqp.load_problem("dentist"), starts=200, seed=3, out=sys.argv[1])
"""


@pytest.mark.slow
def test_a_killed_run_goes_on(problem, alone, tmp_path):
    ledger = tmp_path / FILE
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path)])
    try:
        give_up = time.monotonic() + 60
        while not (ledger.is_file() and len(ledger.read_text(encoding="utf-8").splitlines()) >= 3):
            assert child.poll() is None
            assert time.monotonic() < give_up
            time.sleep(0.01)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    finished = [json.loads(line) for line in ledger.read_text(encoding="utf-8").splitlines()]
    assert 3 <= len(finished) < 200
    with ledger.open("a", encoding="utf-8") as file:
        file.write('{"key": "cut off in the mid')
    solved = []
    again = optimise(
        problem, starts=len(finished) + 2, seed=3, out=tmp_path, progress=solved.append
    )
    # Only the two that were missing were solved, and the others are the ones that were finished.
    assert len(solved) == 2
    for entry in finished:
        assert again.trials[entry["trial"]["number"]].seconds == entry["trial"]["seconds"]
    for trial, once in zip(again.trials, alone.trials, strict=False):
        np.testing.assert_array_equal(trial.pose, once.pose)
    nothing = optimise(
        problem,
        starts=len(finished) + 2,
        seed=3,
        out=tmp_path,
        progress=lambda share: pytest.fail("solved again"),
    )
    same(nothing, again)


@pytest.mark.slow
def test_what_was_finished_for_another_task_is_not_taken_over(problem, alone, tmp_path):
    optimise(problem, alone.posture_before, starts=1, out=tmp_path)
    for options in (
        {"seed": 1},
        {"mode": "cooperative"},
        {"tau_deg": 1.0},
        {"posture": problem.response.comfort},
    ):
        solved = []
        arguments = {
            "posture": alone.posture_before,
            "starts": 1,
            "out": tmp_path,
            "progress": solved.append,
            **options,
        }
        optimise(problem, **arguments)
        assert solved == [1.0]
    heavier = ergoqp.load_problem("dentist").replace(task={**problem.task, "load_kg": 8})
    solved = []
    optimise(heavier, alone.posture_before, starts=1, out=tmp_path, progress=solved.append)
    assert solved == [1.0]


def test_awkward_start_is_that_of_run(problem, alone):
    from ergoqp.rest.model_person import Alike

    np.testing.assert_array_equal(
        alone.posture_before, awkward_start(problem, Alike(problem.response), 3)
    )


@pytest.mark.parametrize("address", ["", " ", "nonsense"])
def test_an_address_without_a_port_never_becomes_a_client(problem, alone, monkeypatch, address):
    """A client that failed half-way printed a traceback behind the sentence when it was cleared
    away."""

    def client(*_, **__):
        raise AssertionError("a client was made")

    monkeypatch.setattr("distributed.Client", client)
    with pytest.raises(
        InputError,
        match=(
            r"scheduler: got .*, allowed the address of a Dask scheduler that answers: missing port"
        ),
    ):
        optimise(problem, alone.posture_before, starts=2, scheduler=address)
