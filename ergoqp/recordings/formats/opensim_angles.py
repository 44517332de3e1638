"""Check of the joint angles of an OpenSim model: their unit, and the signs of the hinges.

Some files state the unit of their angles wrongly, and in some models hinges bend the other way.
Both give another posture, which no later check would notice.
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
"""In a hanging arm only the sum of two of these is determined, so each may turn without limit."""
_MOST: Final = 3.6
"""Largest angle of any other joint [rad]."""
_LEAST: Final = np.radians(0.1)
"""Smaller angles may be noise [rad]."""
_SMALL: Final = np.radians(4)
"""Nobody bends in a file without a larger angle [rad]; radians taken as degrees look like it."""
_FEW: Final = 3
"""Number of joints with small angles that have to move before the person counts as moving."""
_SWAYS: Final = np.radians(0.6)
"""Range of a joint that few joints exceed in a person who stands still [rad]."""
_STANDS: Final = 0.15
"""Range of the pelvis, or the thorax, in a person who stands still [m]."""
_KNEES: Final = ("knee_angle_r", "knee_angle_l")
_ELBOWS: Final = ("elbow_flexion", "elbow_flex_r", "elbow_flex_l")
BENT: Final = np.radians(0.5)
"""Least bend that an elbow or knee is given [rad]: a straight one would not show the rotation of
the limb, which the file states, and one that is bent backward would show the opposite rotation."""
_SHOWN: Final = np.radians(5)
"""Least bend from which a hinge shows its sign [rad]."""
_BACKWARD: Final = np.radians(10)
"""Largest backward bend of a person's joint [rad]."""


def check_unit(model: OpenSimModel, angles: Angles, where: str) -> list[str]:
    """Raise if the unit of the angles is not the stated one; return a sentence about small ones.

    Args:
        model: the model of the coordinates.
        angles: coordinate -> angles [rad] or lengths [m] (n,).
        where: the file's name, for messages.

    Raises:
        RecordingError: if an angle is too large for a joint, or a person moves without bending.
    """
    # The heading is left out, because it grows when a person turns round and round.
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
                " angles (inDegrees) is wrong"
            )
    most = max(
        (float(np.fmax.reduce(np.abs(each), initial=0.0)) for each in turned.values()), default=0.0
    )
    if not _LEAST < most < _SMALL:
        return []
    small = f"no angle of the joints exceeds {np.degrees(most):.2g} deg"
    wrong = "radians that are taken as degrees look like this"
    plausible = sum(np.fmax.reduce(np.abs(each), initial=0.0) > _LEAST for each in turned.values())
    moving = sum(_range(each) > _SWAYS for each in turned.values())
    goes = max((_range(angles[name]) for name in model.moved if name in angles), default=0.0)
    if plausible >= _FEW and (moving >= _FEW or goes > _STANDS):
        raise RecordingError(
            f"{where}: {small} while the person moves, allowed those of a movement:"
            f" {wrong}, so the unit of the angles (inDegrees) is wrong"
        )
    return [f"{small[0].upper()}{small[1:]}: {wrong}, and so does a person who stands."]


def with_bent_hinges(angles: Angles, where: str) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the angles with positive flexion of elbows and knees, and sentences about changes.

    In gait2392 and Hamner's model, the flexion of both knees is negative.

    Args:
        angles: coordinate -> angles [rad] or lengths [m] (n,).
        where: the file's name, for messages.

    Raises:
        RecordingError: if an elbow, or one of two knees, is bent backward most of the time.
    """
    knees = {name: each for name, each in angles.items() if name in _KNEES}
    said = []
    if _negative(knees):
        knees = {name: -each for name, each in knees.items()}
        said = [
            "The angles of the knees are negative in flexion, as in gait2392: they are reversed."
        ]
    hinges = {name: each for name, each in angles.items() if name in _ELBOWS} | knees
    if wrong := [name for name, each in hinges.items() if _is_backward(each)]:
        most = max(float(-np.nanmin(hinges[name])) for name in wrong)
        raise RecordingError(
            f"{where}: {some(wrong)} {'bends' if len(wrong) == 1 else 'bend'} backward by up to"
            f" {np.degrees(most):.0f} deg, allowed {np.degrees(_BACKWARD):.0f} deg: the sign of the"
            " angle is wrong"
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
    """Return the names of a model's coordinates, on both sides."""
    ends = [end for end in model.sides.values() if end]
    bare = [
        (name, next((end for end in ends if name.endswith(end)), "")) for name in model.coordinates
    ]
    return [name.removesuffix(own) + end for name, own in bare for end in (ends if own else [""])]


def _range(values: np.ndarray) -> float:
    """Return the range of values (n,); 0 if none is known."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _negative(knees: Angles) -> bool:
    """Return whether the flexion of the knees is negative.

    All knees that are bent far have to be negative. If none is bent far, the largest angle decides.
    """
    shown = [_is_backward(each) for each in knees.values() if (np.abs(each) > _BACKWARD).any()]
    if shown:
        return all(shown)
    every = np.concatenate([np.zeros(1), *knees.values()])
    return bool(-np.nanmin(every) > np.nanmax(every))


def _is_backward(hinge: np.ndarray) -> bool:
    """Return whether a hinge (n,) [rad] is far backward in most of the frames in which it bends."""
    bent = int((np.abs(hinge) > _SHOWN).sum())
    return 2 * int((hinge < -_BACKWARD).sum()) > bent
