"""What was decided and is not yet seen in the measured pose: sent twists on their way, and the share that is still to be sent."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

Expression = ca.SX


@dataclass(frozen=True)
class UnderWay:
    """The object's motion between where it was measured and where it comes to rest if the virtual twist were zero from now on.

    Attributes:
        total: displacement (6,) [m, rad].
        twists: what is under way, piece by piece (6, k).
        seconds: for how long each piece still acts (k,) [s].
        tail: of what is older than the pieces: positive and negative parts (6, 2) [m, rad]; None: nothing is.
        turn: largest angle of the part that a robot may have done already [rad]; None: there is none.
        gain_error: share by which all of it may be larger or smaller.
        noise: how far off the measured pose is at most (6,) [m, rad].
        hold: for how long one twist may go on beyond its period [s].
    """

    total: Expression
    twists: Expression
    seconds: Expression
    tail: Expression | None
    turn: Expression | None
    gain_error: float
    noise: np.ndarray
    hold: float

    def lost(self, matrix: Expression) -> tuple[Expression, Expression]:
        """Return how much of the distance to the lower and the upper end of rows (m, 6) cannot be counted on.

        The rows are those at the end of `total`. A robot is declared by its upper ends: any share of each piece may be done
        already, so a piece that leads away from an end is not counted, and one that leads to it in full.
        """
        done = matrix @ self.twists
        up, down = (ca.fmax(part, 0) @ self.seconds for part in (done, -done))
        if self.tail is not None:
            ahead, back = (ca.fmax(part, 0) for part in (matrix, -matrix))
            up += ahead @ self.tail[:, 0] + back @ self.tail[:, 1]
            down += ahead @ self.tail[:, 1] + back @ self.tail[:, 0]
        below, above = up + self.gain_error * down, down + self.gain_error * up
        if self.noise.any():
            aside = ca.fabs(matrix) @ ca.DM(self.noise)
            below, above = below + aside, above + aside
        if self.hold:
            below, above = below + self.hold * _most(-done), above + self.hold * _most(done)
        return below, above


def _most(values: Expression) -> Expression:
    """The largest positive entry of each row."""
    most = 0 * values[:, 0]
    for column in ca.horzsplit(values):
        most = ca.fmax(most, column)
    return most
