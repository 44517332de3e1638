"""ergoqp: the robot moves the object so that the person's posture gets better.

>>> import ergoqp
>>> problem = ergoqp.load_problem("screwing")
>>> stepper = ergoqp.Stepper(problem)
>>> step = stepper.step(problem.response.comfort)
>>> step.twist.shape
(6,)

Everything that needs CasADi or MuJoCo is imported at its first use. The same holds for the
folders of the package, such as `ergoqp.limits`.
"""

from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from ergoqp import errors as errors
from ergoqp._version import __version__ as __version__
from ergoqp.joints import JOINTS as JOINTS

if TYPE_CHECKING:
    from ergoqp.comparison.compare import compare as compare
    from ergoqp.costs.load import load_cost as load_cost
    from ergoqp.identification.calibrate import calibrate_frames as calibrate_frames
    from ergoqp.identification.identify import identify as identify
    from ergoqp.mocap.load import fit_postures as fit_postures
    from ergoqp.mocap.load import load_recording as load_recording
    from ergoqp.placing.optimise import optimise as optimise
    from ergoqp.problem.load import load_problem as load_problem
    from ergoqp.problem.problem import Problem as Problem
    from ergoqp.problem.settings import Control as Control
    from ergoqp.problem.settings import DeclaredRobot as DeclaredRobot
    from ergoqp.problem.settings import Frames as Frames
    from ergoqp.seeking.seeker import Seeker as Seeker
    from ergoqp.service.client import Client as Client
    from ergoqp.sheets import reba as reba
    from ergoqp.simulation.simulate import simulate as simulate
    from ergoqp.step.answer import Step as Step
    from ergoqp.step.formulate import Formulation as Formulation
    from ergoqp.step.formulate import Formulator as Formulator
    from ergoqp.step.formulate import formulate as formulate
    from ergoqp.step.function import initial_state as initial_state
    from ergoqp.step.function import step_function as step_function
    from ergoqp.step.replay import replay as replay
    from ergoqp.step.stepper import Stepper as Stepper
    from ergoqp.step.timing import benchmark_step as benchmark_step

_LATER = {
    "Client": "ergoqp.service.client",
    "Control": "ergoqp.problem.settings",
    "DeclaredRobot": "ergoqp.problem.settings",
    "Formulation": "ergoqp.step.formulate",
    "Formulator": "ergoqp.step.formulate",
    "Frames": "ergoqp.problem.settings",
    "Problem": "ergoqp.problem.problem",
    "Seeker": "ergoqp.seeking.seeker",
    "Step": "ergoqp.step.answer",
    "Stepper": "ergoqp.step.stepper",
    "benchmark_step": "ergoqp.step.timing",
    "calibrate_frames": "ergoqp.identification.calibrate",
    "compare": "ergoqp.comparison.compare",
    "fit_postures": "ergoqp.mocap.load",
    "formulate": "ergoqp.step.formulate",
    "identify": "ergoqp.identification.identify",
    "initial_state": "ergoqp.step.function",
    "load_cost": "ergoqp.costs.load",
    "load_problem": "ergoqp.problem.load",
    "load_recording": "ergoqp.mocap.load",
    "optimise": "ergoqp.placing.optimise",
    "replay": "ergoqp.step.replay",
    "simulate": "ergoqp.simulation.simulate",
    "step_function": "ergoqp.step.function",
}

_EXTRAS = {"whole_body": "mink"}
"""Folders that can only be imported if a package is installed, by folder; an extra installs it."""

__all__ = ["JOINTS", "__version__", "errors", "reba", *_LATER]  # pyright: ignore


def __getattr__(name: str) -> Any:
    """Import a name at its first use."""
    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
    elif name == "reba":
        value = import_module("ergoqp.sheets.reba")
    elif name in _folders():
        value = import_module(f"ergoqp.{name}")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def _folders() -> set[str]:
    return {found.name for found in iter_modules(__path__) if not found.name.startswith("_")}


def __dir__() -> list[str]:
    """List the public names, including those that are not imported yet.

    `help` and `inspect.getmembers` import every name that is listed here. So a folder whose
    extra is not installed is left out: its import would fail with the message that names the
    extra.
    """
    missing = {folder for folder, package in _EXTRAS.items() if find_spec(package) is None}
    return sorted({*globals(), *__all__, *_folders()} - missing)
