"""ergoqp: the robot moves the object so that the person's posture gets better.

>>> import ergoqp
>>> problem = ergoqp.load_problem("screwing")
>>> stepper = problem.stepper()
>>> step = stepper.step(problem.response.comfort)
>>> step.twist.shape
(6,)

What needs CasADi or MuJoCo is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ergoqp import errors as errors
from ergoqp.joints import JOINTS as JOINTS
from ergoqp.sheets import reba as reba

if TYPE_CHECKING:
    from ergoqp.comparison.compare import compare as compare
    from ergoqp.costs.learned import load_cost as load_cost
    from ergoqp.problem.control import Control as Control
    from ergoqp.problem.problem import Problem as Problem
    from ergoqp.problem.robot import DeclaredRobot as DeclaredRobot
    from ergoqp.problem_files.load import load_problem as load_problem
    from ergoqp.recordings import load_recording as load_recording
    from ergoqp.step.answer import Step as Step
    from ergoqp.step.log import replay as replay
    from ergoqp.step.stepper import Stepper as Stepper

__version__ = "0.1.0"

__all__ = [
    "JOINTS",
    "Control",
    "DeclaredRobot",
    "Problem",
    "Step",
    "Stepper",
    "__version__",
    "compare",
    "errors",
    "load_cost",
    "load_problem",
    "load_recording",
    "reba",
    "replay",
]

_LATER = {
    "Control": "ergoqp.problem.control",
    "DeclaredRobot": "ergoqp.problem.robot",
    "Problem": "ergoqp.problem.problem",
    "Step": "ergoqp.step.stepper",
    "Stepper": "ergoqp.step.stepper",
    "compare": "ergoqp.comparison.compare",
    "load_cost": "ergoqp.costs.learned",
    "load_problem": "ergoqp.problem_files.load",
    "load_recording": "ergoqp.recordings",
    "replay": "ergoqp.step.log",
}


def __getattr__(name: str) -> Any:
    """Import what is used for the first time."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_LATER[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, those not imported yet included."""
    return sorted({*globals(), *__all__})
