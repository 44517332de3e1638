"""An option that is left out is what the function behind the command takes by itself."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest

from ergoqp.cli import compare, fit, group, run, score
from ergoqp.cli.options import RecordingOptions, SearchOptions
from ergoqp.comparison.compare import compare as compare_solvers
from ergoqp.datasets.postures import posture_data
from ergoqp.lab.forearm import forearm_data
from ergoqp.lab.group import best_for_group
from ergoqp.mocap import load_recording
from ergoqp.placing.optimise import optimise
from ergoqp.responses.gmr import GmrResponse
from ergoqp.sheets.options import DEFAULTS
from ergoqp.simulation.simulate import simulate


def defaults_of(function: Callable[..., Any]) -> dict[str, Any]:
    """The defaults of a function's parameters by name, of those that have one."""
    parameters = inspect.signature(function).parameters.items()
    return {name: each.default for name, each in parameters if each.default is not each.empty}


@pytest.mark.parametrize(
    ("command", "function", "shared"),
    [
        (compare.command, compare_solvers, {"solvers", "steps", "seed", "accuracy"}),
        (fit.command, posture_data, {"per_score", "seed"}),
        (fit.command, forearm_data, {"per_score", "seed"}),
        (fit.command, GmrResponse.fit, {"seed"}),
        (group.command, best_for_group, {"objective", "starts", "jobs"}),
        (run.command, simulate, {"seed", "duration", "guide"}),
        (SearchOptions, optimise, {"starts", "jobs", "seed", "mode", "solver"}),
        (RecordingOptions, load_recording, {"unit_to_m", "up", "mapping", "window", "rate"}),
    ],
)
def test_of_a_command_and_its_function(
    command: Callable[..., Any], function: Callable[..., Any], shared: set[str]
) -> None:
    asked, given = defaults_of(command), defaults_of(function)
    assert {name: asked[name] for name in shared} == {name: given[name] for name in shared}


def test_of_the_options_of_a_task() -> None:
    asked, sides = defaults_of(score.command), {"arm_supported", "shoulder_raised"}
    for name, value in DEFAULTS.items():
        assert asked[name] == (None if name in sides else value), name
