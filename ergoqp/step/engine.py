"""How a step is computed: interpreted, or by machine code that is there or is compiled beside it.

The answers are the same to the last bit, so a loop can go from one to the other at any step.

- ``compiled="auto"``: the compiled step of the cache, if it is there. Otherwise the loop steps
  interpreted, and after 10 s of stepping another process compiles, at the lowest priority and one
  at a time for a user. Once it has, the next step is computed compiled. ``ERGOQP_COMPILE=never``
  forbids it. Whatever fails is a warning in the log, and the interpreted step goes on.
- ``compiled=True``: the compiled step; who makes the loop waits for it.
- ``compiled=False``: never.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final, Literal, TypeAlias

import casadi as ca
import numpy as np

from ergoqp.arguments import flag, shown
from ergoqp.errors import ErgoqpError, InputError, in_words
from ergoqp.problem.problem import Problem
from ergoqp.solvers import read_solver
from ergoqp.solvers.daqp import Daqp
from ergoqp.step.certification import stop_function
from ergoqp.step.function import INPUTS, shared_step
from ergoqp.step.guide import GUIDE_INPUTS
from ergoqp.step.layout import count
from ergoqp.step.model import StepModel
from ergoqp.step.structure import structure_of

_LOG: Final = logging.getLogger(__name__)

Choice: TypeAlias = bool | Literal["auto"]
"""Whether a step is compiled, see `ergoqp.Stepper`."""

PATIENCE: Final = 10.0
"""After so much time of stepping, compiling begins [s]."""

_PAUSE: Final = 1.0
"""A longer time between two calls counts as this much stepping [s]."""

_SWITCH: Final = "ERGOQP_COMPILE"
"""Environment variable that forbids to compile in the background: ``never``."""

_NAME: Final = "step"

Stop: TypeAlias = Callable[[np.ndarray, float], np.ndarray]


def read_choice(value: Any) -> Choice:
    """Return whether to compile: ``"auto"``, True or False.

    Raises:
        InputError: if it is none of these.
    """
    if isinstance(value, str) and value == "auto":
        return "auto"
    try:
        return flag("compiled", value)
    except InputError:
        raise InputError(f"compiled: got {shown(value)}, allowed 'auto', True or False") from None


def may_compile_beside() -> bool:
    """Return whether the user allows to compile in the background."""
    return os.environ.get(_SWITCH) != "never"


def engine_of(function: ca.Function) -> str:
    """Return how a function of the step is computed: ``"interpreted"`` or ``"compiled"``."""
    from ergoqp.native.compiled import library_of

    return "interpreted" if library_of(function) is None else "compiled"


class Engine:
    """What computes the step of a loop, now and later.

    Args:
        model: model of the step.
        solver: name of the QP solver, or the solver.
        choice: whether to compile.

    Attributes:
        waits: whether a compiled step may come while the loop runs, see `change`.
    """

    def __init__(self, model: StepModel, solver: Any, choice: Choice) -> None:
        """Compile nothing yet."""
        self._model, self._solver = model, solver
        self._problem, self._guided = model.problem, model.guided
        self._choice, daqp = choice, type(read_solver(solver)) is Daqp
        self._daqp = daqp
        self._key = self._short_key() if daqp and choice is not False else None
        self.waits = daqp and choice == "auto" and may_compile_beside()
        self._stepped, self._last = 0.0, time.perf_counter()
        self._thread: threading.Thread | None = None
        self._ready: tuple[ca.Function, Stop | None] | None = None

    def compiled(self) -> ca.Function | None:
        """Return the compiled step if it is wanted now; ``"auto"`` takes only what is there.

        Raises:
            InputError, CompilerError: as `ergoqp.step_function`.
        """
        if self._choice is True:
            return self._found() or self._compiled_now()
        if self._choice is False:
            return None
        try:
            function = self._found()
        except ErgoqpError as error:
            _LOG.warning("%s goes on interpreted: %s", self, error)
            function, self.waits = None, False
        self.waits = self.waits and function is None
        return function

    def change(self, stepper: Any) -> None:
        """Have a stepper go on with the compiled step once it is there.

        It is called before every step. After `PATIENCE` of stepping, compiling begins.
        """
        if self._ready is not None:
            stepper.function, stepper._closed_stop = self._ready
            stepper._evaluator.replace(stepper.function)
            stepper._call, stepper._later = stepper._evaluator.evaluate, None
        elif not self.waits:
            stepper._later = None
        elif self._thread is None:
            now = time.perf_counter()
            self._stepped += min(now - self._last, _PAUSE)
            self._last = now
            if self._stepped > PATIENCE:
                self._thread = threading.Thread(target=self._work, name="compiler", daemon=True)
                self._thread.start()

    def __str__(self) -> str:
        """Name what is computed."""
        return f"the step of {self._problem.name}"

    def _short_key(self, any_compiler: bool = False) -> str | None:
        from ergoqp.native.compiled import short_key

        return short_key(_NAME, structure_of(self._model), any_compiler=any_compiler)

    def _found(self) -> ca.Function | None:
        """Return the compiled step of the cache, within milliseconds.

        Of a problem with terms of the user's only the C code tells what they are.
        """
        from ergoqp.native.compiled import external, found
        from ergoqp.native.shipped import shipped

        key = shipped_key(self._model) if self._daqp else None
        library = None if key is None else shipped(_NAME, key, layout_of(self._model))
        if library is not None:
            return external(_NAME, library)
        function = None if self._key is None else found(_NAME, self._key)
        if function is None and self._choice == "auto" and (key := self._short_key(True)):
            # The answers are the same to the bit whichever compiler made it.
            function = found(_NAME, key)
        if function is not None:
            check_layout(function, self._model)
        return function

    def _compiled_now(self) -> ca.Function:
        from ergoqp.native.compiled import keep

        with _waiting(f"compiling {self}"):
            function = shared_step(self._problem, self._solver, True, guided=self._guided)
        # The key says too that no file of the package has changed meanwhile.
        if self._key is not None and self._key == self._short_key():
            keep(function, self._key)
            keep(function, self._short_key(any_compiler=True) or self._key)
        return function

    def _work(self) -> None:
        """Compile in another process, and load what it has made."""
        began = time.monotonic()
        try:
            _LOG.info("%s is compiled in the background", self)
            if self._key is None:
                raise InputError(
                    "only its C code tells what it computes (terms of your own, or files of the"
                    " package that have changed); compiled=True compiles it"
                )
            _compile_apart(self._problem, self._guided)
            function = self._found()
            if function is None:
                raise InputError("the compiled step is not in the cache")
            ready = function, closed_stop(self._model)
            _LOG.info("%s is compiled, after %.0f s", self, time.monotonic() - began)
            self._ready = ready
        except Exception as error:  # nothing of this may end the loop
            words = str(error) if isinstance(error, ErgoqpError) else in_words(error)
            _LOG.warning("%s goes on interpreted: %s", self, words)
            self.waits = False


@contextmanager
def _waiting(words: str) -> Iterator[None]:
    """Show on a terminal that something takes long, and for how long."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        bar.add_task(words, total=None)
        yield


def closed_stop(model: StepModel) -> Stop | None:
    """Return the certified stop in closed form; None without a compiler, and for a surface."""
    from ergoqp.native.compiled import CompilerError

    if model.problem.surface is not None:
        return None
    with suppress(CompilerError):
        return stop_function(model)
    return None


def shipped_key(model: StepModel) -> str | None:
    """Return the key of the step of a structure that comes with the package; None: it has none."""
    from ergoqp.native.content import value_key

    return value_key(structure_of(model))


def layout_of(model: StepModel) -> dict[str, Any]:
    """Return the inputs of a compiled step that are not the same for all, in order, with shapes."""
    sizes = {name: list(np.shape(value)) for name, value in model.constants.items()}
    return {
        "inputs": [*INPUTS, *(GUIDE_INPUTS if model.guided else ())],
        "constants": sizes,
        "state": count(model.state),
    }


def check_layout(function: ca.Function, model: StepModel) -> None:
    """Check that a compiled step has the inputs and the state of a model.

    Raises:
        InputError: if it has not.
    """
    names = [*INPUTS, *(GUIDE_INPUTS if model.guided else ()), *model.constants]
    sizes = {name: np.shape(value) for name, value in model.constants.items()}
    sizes["state"] = (count(model.state), 1)
    if function.name_in() == names:
        names = [name for name, size in sizes.items() if function.size_in(name) != size]
        if not names:
            return
    raise InputError(f"the compiled step has another layout ({', '.join(names[:3])}, ...)")


def _compile_apart(problem: Problem, guided: bool) -> None:
    """Have another process compile a step into the cache.

    Raises:
        InputError: if it has not, with its words.
    """
    order = pickle.dumps((problem, guided))
    code = f"from {__name__} import compile_ordered; compile_ordered()"
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        # It finds what this process has imported, and goes on when this one is interrupted.
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
    )
    said = child.communicate(order)[1].decode(errors="replace").strip().splitlines()
    if child.returncode < 0:
        name = signal.Signals(-child.returncode).name
        raise InputError(f"the process that compiled it was ended by {name}")
    if child.returncode:
        raise InputError(said[-1] if said else "the process that compiled it gave up")


def compile_ordered() -> None:
    """Compile the step that standard input holds; it is all that this process does."""
    from ergoqp.native.compiled import one_at_a_time

    os.nice(19)
    try:
        with one_at_a_time(_NAME):
            problem, guided = pickle.load(sys.stdin.buffer)
            model = StepModel(problem, guided)
            Engine(model, "daqp", choice=True).compiled()
            closed_stop(model)
    except ErgoqpError as error:
        sys.exit(str(error))
