"""Workers that die in the middle of the work: one sentence, in finite time, and what was finished
is kept."""

import dataclasses
import functools
import os
import threading
import time

import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.errors import WorkersError
from ergoqp.placing.ledger import FILE
from ergoqp.placing.optimise import optimise

KEPT = "with `out` the starts that were finished are kept"


@pytest.fixture(scope="module")
def problem():
    return ergoqp.load_problem("dentist")


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


def after_first(action):
    """Return a progress that does something once, when the first start is finished."""
    once = []

    def progress(share: float) -> None:
        if not once:
            once.append(share)
            action()

    return progress


@pytest.mark.slow
def test_the_only_worker_is_gone(problem, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr("ergoqp.placing.workers.PATIENCE", 2.0)
    retire = after_first(lambda: cluster.scale(0))
    with pytest.raises(
        WorkersError,
        match=rf"scheduler: tcp://.* has had no worker for 2 s, allowed a cluster with one; {KEPT}",
    ):
        optimise(
            problem, starts=400, out=tmp_path, scheduler=cluster.scheduler_address, progress=retire
        )
    assert (tmp_path / FILE).read_text(encoding="utf-8").count("\n") >= 1


@pytest.mark.slow
def test_a_worker_that_is_late_is_waited_for(problem, cluster):
    cluster.scale(0)
    later = threading.Timer(4.0, lambda: cluster.scale(1))
    later.start()
    try:
        assert len(optimise(problem, starts=2, scheduler=cluster.scheduler_address).trials) == 2
    finally:
        later.join()


class Elsewhere:
    """A cost that does something when a process that did not make it asks for its expression."""

    name, minimum = "elsewhere", 0.0

    def __init__(self, then):
        self.home, self.then = os.getpid(), then

    def expression(self, q):
        if os.getpid() != self.home:
            self.then()
        return ca.sumsqr(q)

    def __call__(self, postures):
        return np.sum(np.atleast_2d(postures) ** 2, axis=1)


def missing() -> None:
    raise FileNotFoundError("my_labels.csv is not on this machine")


@pytest.mark.slow
def test_what_a_start_itself_raises_is_not_told_of_the_scheduler(problem, cluster):
    own = dataclasses.replace(problem, cost=Elsewhere(missing))
    with pytest.raises(FileNotFoundError, match=r"my_labels\.csv is not on this machine"):
        optimise(own, starts=2, scheduler=cluster.scheduler_address)


@pytest.mark.slow
def test_a_start_that_takes_long_is_waited_for(problem, cluster, monkeypatch):
    monkeypatch.setattr("ergoqp.placing.workers.PATIENCE", 0.5)
    slow = dataclasses.replace(problem, cost=Elsewhere(functools.partial(time.sleep, 4.0)))
    assert len(optimise(slow, starts=1, scheduler=cluster.scheduler_address).trials) == 1


@pytest.mark.slow
def test_the_scheduler_is_gone(problem, cluster, tmp_path):
    end = after_first(lambda: threading.Thread(target=cluster.close).start())
    with pytest.raises(
        WorkersError, match=rf"scheduler: tcp://.* does not answer any more .*; {KEPT}"
    ):
        optimise(
            problem, starts=400, out=tmp_path, scheduler=cluster.scheduler_address, progress=end
        )


@pytest.mark.slow
def test_a_process_of_this_machine_is_ended(problem, tmp_path):
    psutil = pytest.importorskip("psutil")

    def end() -> None:
        workers = [
            child
            for child in psutil.Process().children(recursive=True)
            if "popen_loky" in " ".join(child.cmdline())
        ]
        workers[0].kill()

    with pytest.raises(
        WorkersError, match=rf"jobs: one of 2 processes that solved starts was ended, .*; {KEPT}"
    ):
        optimise(problem, starts=400, out=tmp_path, jobs=2, progress=after_first(end))
    assert len(optimise(problem, starts=1, out=tmp_path, jobs=2).trials) == 1
