"""The best place for a person and a task, how it was verified, and its file ``optimum.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.errors import InputError
from ergoqp.expressions import pose_as_dict, pose_from_dict
from ergoqp.files.atomic import write_json
from ergoqp.files.read import read_json
from ergoqp.joints import JOINTS
from ergoqp.responses.ik import IkResponse, plain, response_as_dict, response_from_dict

FILE = "optimum.json"
"""Name of the file in a folder of results."""

_KINDS = dict.fromkeys(("number", "reba"), (int,)) | {"note": (str,)}
_KINDS |= dict.fromkeys(("cost", "kkt_residual", "apart", "seconds"), (int, float))
_ARRAYS = {"pose": (4, 4), "posture": (len(JOINTS),)}


@dataclass(frozen=True, eq=False)
class StartResult:
    """Result of one start.

    Attributes:
        number: number of the start, 0 to starts - 1.
        pose: pose of the object at the end (4, 4) [m].
        posture: posture in which the person comes to rest there (32,) [rad];
            `mode="cooperative"`: the posture that was chosen.
        reba: exact score of that posture; 0 if the trial does not count, because the place is
            out of reach or violates a limit.
        cost: smooth cost of that posture at the final tau [points].
        kkt_residual: largest violation of the optimality conditions of the single-level
            problem, recomputed (dimensionless).
        apart: largest difference of a joint between the posture of the program and that in
            which the person comes to rest [rad].
        seconds: time that the start took [s].
        note: why the trial does not count; empty if it does.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = ergoqp.optimise(problem, starts=1)
        >>> [trial] = best.trials
        >>> trial.number, trial.reba == best.reba_after, trial.note
        (0, True, '')
    """

    number: int
    pose: np.ndarray
    posture: np.ndarray
    reba: int
    cost: float
    kkt_residual: float
    apart: float
    seconds: float
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, texts and lists."""
        return {name: plain(value) for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> StartResult:
        """Return the trial from the result of `as_dict`.

        Raises:
            KeyError, TypeError, ValueError: if it does not describe a trial.
        """
        found = _with_arrays({name: values[name] for name in cls.__dataclass_fields__})
        for name, kinds in _KINDS.items():
            value = found[name]
            if isinstance(value, bool) or not isinstance(value, kinds) or value != value:
                raise ValueError(name)
        return cls(**found)


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best place of the object for one person in one task.

    Attributes:
        problem: name of the problem.
        title: the problem in a few words, for people.
        mode: ``"stackelberg"``: the object is placed, and the person comes to rest by comfort;
            ``"cooperative"``: the posture is chosen too, which is a lower bound of what a
            place can achieve.
        solver: name of the nonlinear solver.
        seed: seed of the starts.
        response: the person of the posture: body, weights, comfort.
        pose: best pose of the object's contact frame (4, 4) [m].
        posture: posture of the person there (32,) [rad].
        reba_before: exact score of the given posture.
        reba_after: exact score at the best pose.
        kkt_residual: largest violation of the optimality conditions of the single-level
            problem at the final tau (dimensionless).
        cost_before: smooth cost of the given posture at the final tau [points].
        cost_after: smooth cost at the best pose [points].
        tau_deg: scale of the smooth score in the last stage [deg]; None for a cost without
            one.
        pose_before: given pose of the object (4, 4) [m].
        posture_before: given posture (32,) [rad].
        trials: results of all starts, in order.
        assumptions: sentences on what was assumed.

    Example:
        >>> import ergoqp
        >>> import tempfile
        >>> from ergoqp.placing.optimum import Optimum
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = ergoqp.optimise(problem, starts=1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = Optimum.load(best.save(folder))
        >>> again.reba_after == best.reba_after
        True
        >>> stepper = ergoqp.Stepper(problem, guide=best)
    """

    problem: str
    title: str
    mode: str
    solver: str
    seed: int
    response: IkResponse
    pose: np.ndarray
    posture: np.ndarray
    reba_before: int
    reba_after: int
    kkt_residual: float
    cost_before: float
    cost_after: float
    tau_deg: float | None
    pose_before: np.ndarray
    posture_before: np.ndarray
    trials: tuple[StartResult, ...] = ()
    assumptions: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the result in one line."""
        x, y, z = self.pose[:3, 3]
        return (
            f"Optimum({self.problem!r}, {self.mode}: REBA {self.reba_before} -> {self.reba_after}"
            f" with the object at ({x:z.2f}, {y:z.2f}, {z:z.2f}) m,"
            f" residual {self.kkt_residual:.1e}, {len(self.trials)} starts)"
        )

    def save(self, path: str | Path) -> Path:
        """Write the optimum as JSON and return the path of the file, ``optimum.json`` in a folder.

        Raises:
            OSError: if the file cannot be written.
        """
        path = Path(path)
        if path.suffix != ".json":
            path.mkdir(parents=True, exist_ok=True)
            path = path / FILE
        write_json(path, self.as_dict(), indent=1)
        return path

    def as_dict(self) -> dict[str, Any]:
        """Return the contents of the file: numbers, texts, lists and dicts; angles in rad.

        See ``docs/optimum_json.md``.
        """
        from ergoqp._version import __version__

        values = {name: plain(value) for name, value in vars(self).items()}
        values |= {
            "response": response_as_dict(self.response),
            "pose": pose_as_dict(self.pose),
            "pose_before": pose_as_dict(self.pose_before),
            "trials": [
                trial.as_dict() | {"pose": pose_as_dict(trial.pose)} for trial in self.trials
            ],
        }
        return {"version": __version__, "joints": list(JOINTS), **values}

    @classmethod
    def load(cls, path: str | Path) -> Optimum:
        """Read a file that `save` wrote.

        Args:
            path: the file, or the folder that contains ``optimum.json``.

        Raises:
            InputError: if the file does not exist or is not an optimum.
        """
        path = Path(path)
        path = path / FILE if path.is_dir() else path
        try:
            values = read_json(path, "optimum")
            values = {name: values[name] for name in cls.__dataclass_fields__}
            values["response"] = response_from_dict(values["response"])
            for entry in (values, *values["trials"]):
                for name in entry.keys() & {"pose", "pose_before"}:
                    entry[name] = pose_from_dict(entry[name])
            values["trials"] = tuple(StartResult.from_dict(trial) for trial in values["trials"])
            values["assumptions"] = tuple(values["assumptions"])
            return cls(**_with_arrays(values))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            if isinstance(error, InputError) and str(error).startswith("optimum: "):
                raise
            raise InputError(
                f"optimum: {str(path)!r} is no optimum; give a file that `Optimum.save` wrote"
            ) from None


def _with_arrays(values: dict[str, Any]) -> dict[str, Any]:
    for name, shape in _ARRAYS.items():
        for key in (name, f"{name}_before"):
            if key in values:
                values[key] = np.array(values[key], dtype=float)
                if values[key].shape != shape or not np.isfinite(values[key]).all():
                    raise ValueError(key)
    return values
