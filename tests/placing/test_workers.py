"""The same trials and people whoever does the work, and one sentence where it cannot be done."""

import os
import threading
import time

import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError, WorkersError
from ergoqp.lab.cluster import on_cluster
from ergoqp.lab.population import best_of_population, population
from ergoqp.placing.optimise import optimise
from ergoqp.placing.parallel import in_order
from ergoqp.rest.best_place import awkward_start


@pytest.fixture(scope="module")
def problem():
    return ergoqp.load_problem("dentist")


@pytest.fixture(scope="module")
def alone(problem):
    return optimise(problem, starts=6, seed=3)


@pytest.fixture
def cluster():
    distributed = pytest.importorskip("distributed")
    # Workers are not brought back: a nanny would.
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        host="127.0.0.1",
        silence_logs=50,
    ) as cluster:
        yield cluster


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
    told = []
    same(optimise(problem, starts=6, seed=3, jobs=2, progress=told.append), alone)
    assert told == pytest.approx([1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6, 1.0])


@pytest.mark.slow
def test_another_seed_begins_elsewhere(problem, alone):
    other = optimise(problem, alone.posture_before, starts=6, seed=4, pose=alone.pose_before)
    assert any(
        np.abs(a.pose - b.pose).max() > 0
        for a, b in zip(other.trials[1:], alone.trials[1:], strict=True)
    )


def test_awkward_start_is_that_of_run(problem, alone):
    from ergoqp.rest.model_person import ModelPerson

    np.testing.assert_array_equal(
        alone.posture_before, awkward_start(problem, ModelPerson(problem.response), 3)
    )


def test_what_cannot_be_sent(problem, alone):
    class Own:
        name, minimum = "own", 1.0
        symbol = ca.MX.sym("not to be sent")

        def __call__(self, postures):
            return 1 + (np.atleast_2d(postures) ** 2).sum(axis=1)

        def expression(self, q):
            return 1 + ca.sumsqr(q)

    with pytest.raises(
        InputError, match=r"jobs: the terms of the problem cannot be sent to other processes"
    ):
        optimise(problem.replace(cost=Own()), alone.posture_before, starts=2, jobs=2)


def ended(number):
    if number == 1:
        os._exit(1)
    return number


@pytest.mark.slow
def test_a_process_of_this_machine_is_ended():
    with pytest.raises(WorkersError, match=r"jobs: one of 2 processes was ended, .*fewer jobs"):
        in_order(ended, [(number,) for number in range(8)], 2)
    assert in_order(abs, [(-1,), (2,)], 2) == [1, 2]


@pytest.mark.slow
def test_same_people_on_a_cluster(problem, cluster):
    people = list(population(problem, [1.6, 1.8]))
    told = []
    found = best_of_population(
        people, starts=2, scheduler=cluster.scheduler_address, progress=told.append
    )
    assert [each.label for each in found] == ["1.60 m", "1.80 m"]
    for each, here in zip(found, best_of_population(people, starts=2), strict=True):
        same(each.optimum, here.optimum)
    assert told == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "ftp://127.0.0.1:8786"])
def test_no_cluster_there(address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("ergoqp.lab.cluster.TIMEOUT", 0.5)
    with pytest.raises(
        InputError, match=r"scheduler: got .*, allowed the address of a Dask scheduler that answers"
    ):
        list(on_cluster(abs, [(1,)], address))
    # A client that is left would be closed by the garbage collector, in the midst of the next
    # client's start, and wait there for ever.
    assert not [thread for thread in threading.enumerate() if thread.name == "IO loop"]


@pytest.mark.parametrize("address", ["", " ", "nonsense"])
def test_an_address_without_a_port_never_becomes_a_client(monkeypatch, address):
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
        list(on_cluster(abs, [(1,)], address))


def after_first(results, action):
    """Yield results, and do something once, when the first one is there."""
    for number, each in enumerate(results):
        if number == 0:
            action()
        yield each


@pytest.mark.slow
def test_the_only_worker_is_gone(cluster, monkeypatch):
    monkeypatch.setattr("ergoqp.lab.cluster.PATIENCE", 2.0)
    results = on_cluster(time.sleep, [(0.05,)] * 400, cluster.scheduler_address)
    with pytest.raises(
        WorkersError,
        match=r"scheduler: tcp://.* has had no worker for 2 s; add one",
    ):
        list(after_first(results, lambda: cluster.scale(0)))


@pytest.mark.slow
def test_a_worker_that_is_late_is_waited_for(cluster):
    cluster.scale(0)
    later = threading.Timer(4.0, lambda: cluster.scale(1))
    later.start()
    try:
        assert list(on_cluster(abs, [(-3,)], cluster.scheduler_address)) == [(0, 3)]
    finally:
        later.join()


def missing():
    raise FileNotFoundError("my_labels.csv is not on this machine")


@pytest.mark.slow
def test_what_a_call_itself_raises_is_not_told_of_the_scheduler(cluster):
    with pytest.raises(FileNotFoundError, match=r"my_labels\.csv is not on this machine"):
        list(on_cluster(missing, [()], cluster.scheduler_address))


@pytest.mark.slow
def test_a_call_that_takes_long_is_waited_for(cluster, monkeypatch):
    monkeypatch.setattr("ergoqp.lab.cluster.PATIENCE", 0.5)
    assert list(on_cluster(time.sleep, [(4.0,)], cluster.scheduler_address)) == [(0, None)]


@pytest.mark.slow
def test_the_scheduler_is_gone(cluster):
    results = on_cluster(time.sleep, [(0.05,)] * 400, cluster.scheduler_address)
    with pytest.raises(WorkersError, match=r"scheduler: tcp://.* does not answer any more "):
        list(after_first(results, lambda: threading.Thread(target=cluster.close).start()))
