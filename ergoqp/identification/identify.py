"""Identification of a person from their postures at rest: the most likely traits.

The part of a person's rests that no traits explain, and its prediction at other places. People are
not the model with other parameters. Their rests differ from those of the most likely traits by some
degrees, and similarly at places close to each other. So what was measured beyond the model is a
Gaussian process over places. All joints share one width and one noise, the most likely ones of
`WIDTHS` and `NOISES`. If noise alone is most likely, the process is zero.

C. E. Rasmussen, C. K. I. Williams: Gaussian Processes for Machine Learning, 2006, section 2.2
(prediction) and 5.4 (marginal likelihood). The model is fitted before, not together with it.

Each measured rest is predicted as the rest of a person with unknown traits. The most likely traits
minimise the prediction error of all rests plus the deviation from people in general (`traits`). The
search uses Levenberg-Marquardt steps. A rest that does not fit counts less (Student's t).

The error must be one of prediction. The conditions of rest are linear in weights and comfort, but
noise of a tenth of a degree upsets them, and joints at their ends violate them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from ergoqp.arguments import check_kind
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.human.body import GROWTH
from ergoqp.identification.loops import Resting, delay_of, rests_in, rests_of, watched
from ergoqp.identification.rest_model import ModelRest, RestModel, Situation, situation_of
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem.geometry import between
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse

WIDTHS: Final = tuple(np.radians([0.0, 1.5, 3.0, 5.0]))
"""Possible standard deviations of people from the model [rad]."""

NOISES: Final = tuple(np.radians([1.0, 2.0]))
"""Possible standard deviations of a rest's angles that differ the next time [rad]."""

REACH: Final = 0.3
"""Places this far apart have little in common [m]."""

_TURN: Final = 0.3
"""A turn of the tool's axis by one radian counts as this distance [m]."""

_FLUKE: Final = 3 * WIDTHS[-1]
"""A larger difference means that the person did something else; it counts as not seen [rad]."""

_UNSEEN: Final = 1e3
"""Variance of a joint that was not seen [rad^2].

It is the same for every noise, so it does not affect which noise is most likely.
"""


class Unexplained:
    """Prediction of the part beyond the model.

    Args:
        poses: poses of the rests (k, 4, 4).
        beyond: measured angles beyond the model (k, n) [rad]; NaN if a joint was not seen.
        widths: compared widths, `WIDTHS` except in controls [rad].
        noises: compared noises [rad].

    Attributes:
        width: the most likely width [rad].
    """

    def __init__(
        self,
        poses: Any,
        beyond: np.ndarray,
        widths: Sequence[float] = WIDTHS,
        noises: Sequence[float] = NOISES,
    ) -> None:
        """Find the most likely width and noise."""
        self._places = np.array([_place(pose) for pose in poses])
        seen = (np.abs(beyond) <= _FLUKE).T
        self._beyond = np.where(seen, beyond.T, 0.0)
        known, once = seen[:, :, None], np.eye(len(self._places))
        alike = np.array([self._alike(pose) for pose in poses])
        found = [
            (*self._fitted(width**2 * alike + np.where(known, noise**2, _UNSEEN) * once), width)
            for width in widths
            for noise in noises
        ]
        _, self._inverse, self.width = max(found, key=lambda each: each[0])

    def at(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the prediction for every joint at a place (4, 4): mean and deviation (n,) [rad].

        The deviation is that of the process with this width, without noise. It does not include the
        uncertainty of the width or of the traits. Few rests that the traits explain give a width of
        zero.
        """
        alike = self.width**2 * self._alike(pose)
        weights = alike @ self._inverse
        mean = np.einsum("jk,jk->j", weights, self._beyond)
        return mean, np.sqrt(np.maximum(0.0, self.width**2 - weights @ alike))

    def _alike(self, pose: Any) -> np.ndarray:
        away = np.linalg.norm(self._places - _place(pose), axis=1)
        return np.exp(-0.5 * (away / REACH) ** 2)

    def _fitted(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the log likelihood of the measurements, and the inverses (n, k, k)."""
        inverse = np.linalg.inv(covariance)
        fits = np.einsum("jk,jkl,jl->", self._beyond, inverse, self._beyond)
        volume = np.linalg.slogdet(inverse)[1].sum()
        return 0.5 * float(volume - fits), inverse


def _place(pose: Any) -> np.ndarray:
    """Return position and tool axis of a pose (4, 4) as one vector (6,) [m]."""
    given = np.asarray(pose, dtype=float)
    return np.concatenate([given[:3, 3], _TURN * given[:3, 0]])


NOISE: Final = float(np.radians(1.5))
"""Deviation of the angles of a rest from the prediction of the best model [rad]."""

_FREEDOM: Final = 4.0
"""Degrees of freedom of Student's t distribution, in which outliers count less."""

HABIT: Final = 0.5
"""Share of an identified bias that counts as a habit, because rests cannot separate the two."""

_PART: Final = 0.2
"""Length of a part of a path, in metres plus 0.3 times the turn [m]."""

_STEPS: Final = 20
_GAIN: Final = 1e-2
"""The search ends when a step improves the fit by a smaller share."""


@dataclass(frozen=True, eq=False)
class Identified:
    """An identified person.

    Attributes:
        problem: the task.
        traits: the most likely traits (p,), each in the unit of `ergoqp.identification.rest_model`.
        covariance: covariance of the traits (p, p), in their units.
        situation: how the object is held, and where the soles are.
        residual_deg: RMS difference of measured and predicted joints over all rests [deg].
        rests: number of rests.
        beyond: the part of the rests that no traits explain, with its prediction elsewhere.
        delay: delay with which the person follows the object [s]. None: it does not show.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> posture = problem.response.comfort
        >>> pose = problem.response.contact()(posture)[0].full()
        >>> found = ergoqp.identify(problem, [(posture, pose)])
        >>> theirs = problem.replace(response=found.response)
        >>> theirs.response.comfort.shape, round(float(found.body.stature), 1)
        ((32,), 1.7)
    """

    problem: Problem
    traits: np.ndarray
    covariance: np.ndarray
    situation: Situation
    residual_deg: float
    rests: int
    beyond: Unexplained
    _model: RestModel
    _known: tuple[tuple[np.ndarray, np.ndarray], ...]
    delay: float | None = None

    def predict(self, pose: Any, slopes: bool = True) -> ModelRest:
        """Return how this person would rest with the object at `pose` (4, 4) [m].

        The search starts from the nearest known rest. `posture` includes the part that no traits
        explain; `z`, `gap` and the slopes are those of the traits alone.
        """
        near, begin = min(self._known, key=lambda each: _apart(each[0], pose))
        goal = np.asarray(pose, dtype=float)
        # Far away there are other rests, with the elbow turned over. So the search goes in parts.
        parts = int(_apart(near, goal) / _PART)
        for part in range(1, parts + 1):
            way = between(near, goal, part / (parts + 1))
            begin = self._model.rest(self.traits, self.situation, way, begin, 8, False).z
        rest = self._model.rest(self.traits, self.situation, goal, begin, slopes=slopes)
        posture, (mean, _) = rest.posture.copy(), self.beyond.at(goal)
        posture[self.joints] += mean
        return replace(rest, posture=posture)

    def unsure(self, pose: np.ndarray) -> np.ndarray:
        """Return the deviation of the joints (n,) at `pose` that no traits explain [rad]."""
        return self.beyond.at(pose)[1]

    @property
    def joints(self) -> list[int]:
        """Numbers of the joints that follow by themselves."""
        return self._model.layout.joints

    @property
    def habits(self) -> int:
        """Number of the traits, from the first on, that decide where the person rests."""
        return self._model.layout.parts["bias"].start

    def posture_at(self, pose: Any) -> np.ndarray:
        """Return the posture (32,) [rad] in which this person would rest with the object there."""
        return self.predict(pose, slopes=False).posture

    @property
    def comfort_deg(self) -> dict[str, tuple[float, float]]:
        """Favourite angle of each joint and its posterior standard deviation [deg].

        Rests show the direction in which people would rather be, but hardly how far. The standard
        deviation shows how uncertain the angle is.
        """
        layout = self._model.layout
        part = layout.parts["comfort"]
        comfort = self.response.comfort[layout.joints]
        sd = np.sqrt(np.diag(self.covariance)[part])
        return {
            JOINTS[joint]: (float(np.degrees(angle)), float(np.degrees(width)))
            for joint, angle, width in zip(layout.joints, comfort, sd, strict=True)
        }

    @property
    def bias_deg(self) -> dict[str, float]:
        """Bias of the sensors (reading minus angle) per joint, as far as rests show it [deg]."""
        layout = self._model.layout
        bias = np.degrees(self.traits[layout.parts["bias"]])
        return dict(zip([JOINTS[joint] for joint in layout.joints], bias.tolist(), strict=True))

    @property
    def body(self) -> Body:
        """The body of the person, as far as rests show it."""
        layout, body = self._model.layout, self._model.response.body
        growth = dict(
            zip(GROWTH, layout.growth @ self.traits[layout.parts["lengths"]], strict=True)
        )
        whole = 1 + growth["stature"]
        lengths = {name: length * (whole + growth[name]) for name, length in body.lengths.items()}
        return Body(body.stature * whole, lengths, body.mass)

    @property
    def response(self) -> IkResponse:
        """The person as a response, for `Problem.replace`: steps and optima are then theirs.

        It contains the traits, but not `beyond`.
        """
        layout, given = self._model.layout, self._model.response
        weights, comfort = given.weight_vector.copy(), given.comfort.copy()
        joints, parts = layout.joints, layout.parts
        weights[joints] *= np.exp(self.traits[parts["weights"]])
        comfort[joints] = np.clip(
            comfort[joints] + self.traits[parts["comfort"]], LOWER[joints], UPPER[joints]
        )
        named = {"body": self.body, "weights": _by_name(weights)}
        named["comfort_deg"] = _by_name(np.degrees(comfort))
        fields = {name: getattr(given, name) for name in given.__dataclass_fields__}
        return IkResponse(**{**fields, **named})


def identify(problem: Problem, rests: Any, *, longest: float = np.inf) -> Identified:
    """Return the most likely person, given their postures at rest.

    Args:
        problem: the task; its response is the assumption about an unknown person.
        rests: `Resting`s, or pairs of a posture (32,) [rad] and a pose (4, 4) [m]; NaN stands for a
            joint that was not seen. Or a loop, in which rests and the delay of the person are
            found: an `ergoqp.simulation.run.Run`, the folder of one, or the log of a stepper.
        longest: time after which no further step is taken [s].

    Raises:
        InputError: if the problem has no `ergoqp.responses.ik.IkResponse`, or there is no rest.

    Source:
        The steps are those of Levenberg and Marquardt. A rest that does not fit counts less, under
        Student's t distribution.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> posture = problem.response.comfort
        >>> pose = problem.response.contact()(posture)[0].full()
        >>> found = ergoqp.identify(problem, [(posture, pose)])
        >>> found.rests, found.posture_at(pose).shape
        (1, (32,))
    """
    identifier, loop = Identifier(problem), watched(rests, problem.frames)
    if loop is None:
        return identifier.identify(rests, longest=longest)
    found = identifier.identify(rests_in(loop), longest=longest)
    return replace(found, delay=delay_of(loop))


class Identifier:
    """Identifies people of one problem repeatedly.

    Args:
        problem: the task.

    Raises:
        InputError: if its response has no model of rest.
    """

    def __init__(self, problem: Problem) -> None:
        """Build the model once."""
        check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
        if not isinstance(problem.response, IkResponse):
            raise InputError(
                f"problem {problem.name}: got response {type(problem.response).__name__}, allowed"
                " one that says where people rest, such as IkResponse"
            )
        self.problem, self._model = problem, RestModel(problem.response)

    def identify(self, rests: Any, *, longest: float = np.inf) -> Identified:
        """Return the most likely person; see `identify`."""
        fit = _Fit(self.problem, self._model, rests_of(rests))
        return fit.solved(time.perf_counter() + longest)

    def nobody(self, rests: Any) -> Identified:
        """Return the problem's own person who holds the object as in the rests, as a control."""
        return _Fit(self.problem, self._model, rests_of(rests)).solved(np.inf, steps=0)


class _Fit:
    """Levenberg-Marquardt steps on the traits."""

    def __init__(self, problem: Problem, model: RestModel, rests: Sequence[Resting]) -> None:
        self.problem, self.model, self.rests = problem, model, rests
        layout = self.layout = model.layout
        standing_in = model.response.comfort
        seen = [np.where(np.isfinite(rest.posture), rest.posture, standing_in) for rest in rests]
        self.situation = situation_of(model.response, seen)
        self.begins = [model.begin(np.clip(each, LOWER, UPPER)) for each in seen]
        self.measured = np.array([rest.posture[layout.joints] for rest in rests])
        self.mask = np.isfinite(self.measured)

    def solved(self, until: float, steps: int = _STEPS) -> Identified:
        """Return the identified person; with zero steps the problem's own person."""
        sd = self.layout.sd
        n = len(self.layout.joints)
        traits, damping = np.zeros(len(sd)), 1e-2
        predicted = self._predict(traits, self.begins)
        value, off = self._value(traits, predicted)
        information = np.diag(1 / sd**2)
        for _ in range(steps):
            information, pull = np.diag(1 / sd**2), traits / sd**2
            for rest, each, mask in zip(predicted, off, self.mask, strict=True):
                slope = np.hstack([rest.by_traits, np.eye(n)])[mask]
                counts = 1 / (1 + each[mask] ** 2 / (_FREEDOM * NOISE**2)) / NOISE**2
                counts *= (_FREEDOM + 1) / _FREEDOM
                information += slope.T @ (counts[:, None] * slope)
                pull -= slope.T @ (counts * each[mask])
            step = -np.linalg.solve(information + damping * np.diag(np.diag(information)), pull)
            there = self._predict(traits + step, self.begins)
            after, off_there = self._value(traits + step, there)
            if after < value:
                gained = value - after
                traits, predicted, off, value = traits + step, there, off_there, after
                damping = max(damping / 5, 1e-4)
                if gained < _GAIN * max(1.0, value):
                    break
            else:
                damping *= 6
                if damping > 1e3:
                    break
            if time.perf_counter() > until:
                break
        error = off[self.mask]
        bias = traits[self.layout.parts["bias"]]
        beyond = np.where(self.mask, off + HABIT * bias, np.nan)
        widths = WIDTHS if steps else (0.0,)
        return Identified(
            problem=self.problem,
            traits=traits,
            covariance=np.linalg.inv(information),
            situation=self.situation,
            residual_deg=float(np.degrees(np.sqrt(np.mean(error**2)))) if error.size else 0.0,
            rests=len(self.rests),
            beyond=Unexplained([rest.pose for rest in self.rests], beyond, widths),
            _model=self.model,
            _known=tuple(
                (rest.pose, found.z) for rest, found in zip(self.rests, predicted, strict=True)
            ),
        )

    def _predict(self, traits: np.ndarray, begins: Sequence[np.ndarray]) -> list[ModelRest]:
        return [
            self.model.rest(traits, self.situation, rest.pose, begin)
            for rest, begin in zip(self.rests, begins, strict=True)
        ]

    def _value(
        self, traits: np.ndarray, predicted: Sequence[ModelRest]
    ) -> tuple[float, np.ndarray]:
        """Return the negative log posterior, and measured minus predicted angles (k, n)."""
        n, parts, sd = len(self.layout.joints), self.layout.parts, self.layout.sd
        model = np.array([rest.z[:n] for rest in predicted]) + traits[parts["bias"]]
        off = np.where(self.mask, self.measured - model, 0.0)
        far = np.log1p(off**2 / (_FREEDOM * NOISE**2))
        return float(0.5 * (_FREEDOM + 1) * far.sum() + 0.5 * np.sum((traits / sd) ** 2)), off


def _by_name(values: np.ndarray) -> dict[str, float]:
    return {joint: float(value) for joint, value in zip(JOINTS, values, strict=True)}


def _apart(pose: np.ndarray, other: np.ndarray) -> float:
    return float(
        np.linalg.norm(pose[:3, 3] - other[:3, 3])
        + 0.3 * np.linalg.norm(pose[:3, 0] - other[:3, 0])
    )
