"""What all tests share."""

import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# Several processes test at once: threads of the linear algebra would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


BUDGET = 5.0
"""A test that takes longer has to be marked as slow [s of CPU]; what takes 1 s should be, too.

The same test takes up to three times as long on a machine that is busy or slow."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a test that takes long and is not marked as slow, so that `make test` stays quick."""
    begun = sum(os.times()[:4])
    yield
    spent = sum(os.times()[:4]) - begun
    if spent > BUDGET and item.get_closest_marker("slow") is None:
        pytest.fail(f"took {spent:.1f} s of CPU: mark it as slow", pytrace=False)


@pytest.fixture(autouse=True, scope="module")
def steps_of_a_file_are_built_once() -> Iterator[None]:
    """Share the step function, which has no state, among the steppers of equal problems in a file.

    Building takes most of the time of a short test. Every file builds its own, so that what a test
    runs is known by its file. Nor does it depend on what the cache of compiled steps holds: steps
    are interpreted unless a test asks for something else.
    """
    from ergoqp.step import engine, stepper
    from ergoqp.step.model import callers

    build, built = stepper.shared_step, {}

    def once(problem: Any, solver: Any = "daqp", compiled: Any = False, **options: Any) -> Any:
        try:
            # What calls Python may differ although it is pickled alike.
            alike = (solver, compiled) == ("daqp", False) and not callers(problem)
            key = pickle.dumps((problem, options)) if alike else b""
        except Exception:  # a term that a test defines within itself, or no problem at all
            key = b""
        if not key:
            return build(problem, solver, compiled, **options)
        if key not in built:
            built[key] = build(problem, **options)
        return built[key]

    def interpreted(value: Any) -> Any:
        choice = engine.read_choice(value)
        return False if choice == "auto" else choice

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stepper, "shared_step", once)
        patch.setattr(stepper, "read_choice", interpreted)
        yield


@pytest.fixture(scope="session")
def shared() -> Path:
    """The project's shared folder of reference data, in the checkout or beside it; tests that read
    it skip without."""
    found = (parent / "shared" for parent in Path(__file__).resolve().parents)
    folder = next((folder for folder in found if (folder / "reba").is_dir()), None)
    if folder is None:
        pytest.skip(
            "the folder 'shared' with the reference data is neither in the checkout nor beside it"
        )
    return folder
