"""Joint centres of a body: one CasADi function for all bodies, with the lengths as inputs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human import FRACTIONS, Body, Kinematics
from ergoqp.human.body import GROWTH
from ergoqp.joints import JOINTS
from ergoqp.recordings.naming import CENTRES

_MEASURED: Final = tuple(
    centre for centre in CENTRES if not centre.endswith(("nose", "knuckles", "thumb"))
)
"""Centres with an anatomical position; the others only define a direction."""
_BLOCK: Final = 4096


def placed(names: Iterable[str]) -> list[str]:
    """Return those of some centres that have an anatomical position."""
    return [name for name in names if name in _MEASURED]


def centres_of(body: Body, pelvis: np.ndarray, postures: np.ndarray) -> dict[str, np.ndarray]:
    """Return the body's joint centres that have an anatomical position.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].

    Returns:
        Centre -> positions (n, 3) [m].

    Example:
        >>> import numpy as np
        >>> from ergoqp.human import Body
        >>> from ergoqp.recordings.fitting.centres_of import centres_of
        >>> pelvis = np.array([[0.0, 0.0, 0.9, 0.0]])
        >>> centres = centres_of(Body(), pelvis, np.zeros((1, 32)))
        >>> float(centres["left_wrist"][0, 1].round(3))
        0.184
    """
    z, function, growth = np.hstack([pelvis, postures]), _function(), growth_of(body)
    parts = [np.array(function(z[at : at + _BLOCK].T, growth)) for at in range(0, len(z), _BLOCK)]
    places = np.hstack(parts).reshape(len(_MEASURED), 3, -1)
    return {centre: place.T for centre, place in zip(_MEASURED, places, strict=True)}


def growth_of(body: Body) -> np.ndarray:
    """Return a body's growth over the nominal body (14,), in the order of `GROWTH`."""
    nominal = Body()
    whole = body.stature / nominal.stature
    growth = [whole - 1]
    growth += [body.lengths[name] / nominal.lengths[name] - whole for name in FRACTIONS]
    return np.array(growth)


@cache
def _function() -> ca.Function:
    """Return a function: pelvis and posture (36,), growth (14,) -> positions of `_MEASURED`."""
    z, growth = ca.SX.sym("z", 4 + len(JOINTS)), ca.SX.sym("growth", len(GROWTH))
    kinematics = Kinematics(Body(), growth)
    cos, sin = ca.cos(z[3]), ca.sin(z[3])
    yaw = ca.blockcat([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    places = [z[:3] + yaw @ kinematics.at(centre, z[4:])[0] for centre in _MEASURED]
    return ca.Function("centres", [z, growth], [ca.densify(ca.cse(ca.vertcat(*places)))])
