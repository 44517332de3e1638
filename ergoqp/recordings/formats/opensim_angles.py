"""Whether joint angles of an OpenSim model are those of a person: their unit, their hinges' signs.

Files state the unit of their angles wrongly, and hinges bend the other way in some models. Either
is another posture, and nothing later shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.formats.opensim_models import OpenSimModel

Angles = Mapping[str, np.ndarray]
"""Coordinate in small letters -> angles [rad] or lengths [m] (n,)."""

_HEADINGS: Final = ("pelvis_rotation", "thorax_rotation", "ground_thorax_rot_y")
_ABOUT: Final = ("plane_elv", "axial_rot", "shoulder_plane", "shoulder_rotation")
"""Of an arm that hangs only the sum of these shows: either may turn on and on."""
_MOST: Final = 3.6
"""No joint turns farther [rad]."""
_LEAST: Final = np.radians(0.1)
"""What is less may be noise [rad]."""
_SMALL: Final = np.radians(4)
"""In a file without a larger angle nobody bends [rad]; as numbers, radians are not larger."""
_FEW: Final = 3
"""So many joints that are small and move are not small."""
_SWAYS: Final = np.radians(0.6)
"""Who stands still moves few joints farther [rad]."""
_STANDS: Final = 0.15
"""Nor the pelvis, or the thorax [m]."""
_KNEES: Final = ("knee_angle_r", "knee_angle_l")
_ELBOWS: Final = ("elbow_flexion", "elbow_flex_r", "elbow_flex_l")
BENT: Final = np.radians(0.5)
"""No elbow or knee is bent less [rad]: a straight one would not show how the limb is turned, which
the file tells, and one that is bent backward would show the opposite."""
_SHOWN: Final = np.radians(5)
"""A hinge that is bent by less shows no sign [rad]."""
_BACKWARD: Final = np.radians(10)
"""Joints of some people can be bent so far backward [rad]."""


def check_unit(model: OpenSimModel, angles: Angles, where: str) -> list[str]:
    """Raise for angles in another unit than the stated one; return what is said of small ones.

    Args:
        model: whose coordinates they are.
        angles: coordinate -> angles [rad] or lengths [m] (n,).
        where: the file's name, for messages.

    Raises:
        RecordingError: a joint turns farther than joints do, or a person moves without bending.
    """
    # How people head is counted on when they turn round and round.
    turned = {
        name: angles[name]
        for name in _of_both_sides(model)
        if name in angles and name not in {*_HEADINGS, *model.moved}
    }
    root = {step for step, _ in model.segments[model.root].steps}
    for name, each in turned.items():
        farthest = float(np.fmax.reduce(np.abs(each), initial=0.0))
        often = name in root or name in _ABOUT
        if farthest > (4 * np.pi if often else _MOST):
            allowed = "two whole turns" if often else f"{_MOST:g} rad"
            raise RecordingError(
                f"{where}: {name} reaches {farthest:.4g} rad, allowed {allowed}: the unit of the"
                " angles (inDegrees) is another"
            )
    most = max(
        (float(np.fmax.reduce(np.abs(each), initial=0.0)) for each in turned.values()), default=0.0
    )
    if not _LEAST < most < _SMALL:
        return []
    small = f"no angle of the joints exceeds {np.degrees(most):.2g} deg"
    wrong = "Angles in radians that are taken as degrees look like this"
    plausible = sum(np.fmax.reduce(np.abs(each), initial=0.0) > _LEAST for each in turned.values())
    moving = sum(_range(each) > _SWAYS for each in turned.values())
    goes = max((_range(angles[name]) for name in model.moved if name in angles), default=0.0)
    if plausible >= _FEW and (moving >= _FEW or goes > _STANDS):
        raise RecordingError(
            f"{where}: {small} while the person moves, allowed those of a movement."
            f" {wrong}: the unit of the angles (inDegrees) is another"
        )
    return [f"{small[0].upper()}{small[1:]}. {wrong}, and so does a person who stands."]


def with_bent_hinges(angles: Angles, where: str) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the angles with elbows and knees that bend positively, and what is said of it.

    Knees of gait2392 and Hamner bend negatively, both of them.

    Args:
        angles: coordinate -> angles [rad] or lengths [m] (n,).
        where: the file's name, for messages.

    Raises:
        RecordingError: an elbow, or one of two knees, is bent backward most of the time.
    """
    knees = {name: each for name, each in angles.items() if name in _KNEES}
    said = []
    if _negative(knees):
        knees = {name: -each for name, each in knees.items()}
        said = [
            "The knees' angles are negative where they bend, as in gait2392: they are reversed."
        ]
    hinges = {name: each for name, each in angles.items() if name in _ELBOWS} | knees
    if wrong := [name for name, each in hinges.items() if _is_backward(each)]:
        most = max(float(-np.nanmin(hinges[name])) for name in wrong)
        raise RecordingError(
            f"{where}: {some(wrong)} {'bends' if len(wrong) == 1 else 'bend'} backward by up to"
            f" {np.degrees(most):.0f} deg, allowed {np.degrees(_BACKWARD):.0f} deg: the sign of the"
            " angle is another"
        )
    for name, each in hinges.items():
        if count := int((each < -_BACKWARD).sum()):
            said.append(
                f"{name} is bent backward by more than {np.degrees(_BACKWARD):.0f} deg in"
                f" {count} of {len(each)} frames, by up to {np.degrees(-np.nanmin(each)):.0f} deg:"
                " it is taken as straight there."
            )
    return {**angles, **{name: np.maximum(each, BENT) for name, each in hinges.items()}}, said


def _of_both_sides(model: OpenSimModel) -> list[str]:
    """Return the names of a model's coordinates, those of both sides."""
    ends = [end for end in model.sides.values() if end]
    bare = [
        (name, next((end for end in ends if name.endswith(end)), "")) for name in model.coordinates
    ]
    return [name.removesuffix(own) + end for name, own in bare for end in (ends if own else [""])]


def _range(values: np.ndarray) -> float:
    """Return how far values (n,) are apart; 0 for those that nobody knows."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _negative(knees: Angles) -> bool:
    """Return whether all knees that show it bend negatively; where none does, whether they are."""
    shown = [_is_backward(each) for each in knees.values() if (np.abs(each) > _BACKWARD).any()]
    if shown:
        return all(shown)
    every = np.concatenate([np.zeros(1), *knees.values()])
    return bool(-np.nanmin(every) > np.nanmax(every))


def _is_backward(hinge: np.ndarray) -> bool:
    """Return whether a hinge (n,) [rad] is bent far backward in most frames in which it is bent."""
    bent = int((np.abs(hinge) > _SHOWN).sum())
    return 2 * int((hinge < -_BACKWARD).sum()) > bent
