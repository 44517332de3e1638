"""The account of one control step: all outputs of its function, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Account:
    """The outputs of the function of a step.

    Attributes:
        status: status of the step, in words.
        values: all outputs, one after the other.
        parts: position of each of `ergoqp.step.inputs.OUTPUTS` in `values`.
    """

    status: str
    values: np.ndarray
    parts: Mapping[str, slice]

    def __call__(self, name: str) -> np.ndarray:
        """Return one output by its name."""
        return self.values[self.parts[name]]

    @property
    def residuals(self) -> dict[str, float]:
        """Residuals of the step by name: ``qp``, ``contact`` and ``accepted``.

        ``qp`` is the largest KKT residual. ``contact`` is the contact motion that the posture
        cannot follow [m/s, rad/s]. ``accepted`` is the certified share of the way from braking to
        the QP's answer.
        """
        qp, contact, accepted = self("residuals").tolist()
        return {"qp": qp, "contact": contact, "accepted": accepted}

    @property
    def drawn(self) -> int:
        """Phase of `ergoqp.step.guide.trial` in which the guide leads; else 0.

        The guide leads on the way to the place, during the wait there, and on the way back.
        """
        return int(self("drawn")[0]) if "drawn" in self.parts else 0
