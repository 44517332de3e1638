"""Joint centres from a file with ergoqp's own joint angles.

Other programs may write them, too, for example a ROS node that publishes `ergoqp.JOINTS`. The
postures are computed from the joint centres as for all other recordings; this gives the same
angles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.human import Body, Kinematics
from ergoqp.joints import JOINTS, spoken
from ergoqp.recordings.formats.opensim import is_of_model
from ergoqp.recordings.formats.opensim_angles import BENT
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.names import CENTRES, parted

_HINGES: Final = ("elbow_flexion", "knee_flexion")
_MOST: Final = 4 * np.pi
"""Largest angle of a joint [rad]; larger numbers are in degrees."""
_BLOCK: Final = 4096


def tell_person(names: Iterable[str]) -> bool:
    """Return whether joint angles are those of a person: ergoqp's own, or an OpenSim model's."""
    names = tuple(names)
    return bool(own_angles(names)) or is_of_model(names)


def own_angles(names: Iterable[str]) -> Mapping[str, str]:
    """Return our joint -> its name in the file, with a common prefix; empty if one is missing."""
    groups: dict[str, dict[str, str]] = {}
    for name in names:
        prefix, own = parted(name)
        groups.setdefault(prefix, {})[own] = name
    whole = (group for group in groups.values() if set(JOINTS) <= set(group))
    return {joint: group[joint] for group in [next(whole, {})] for joint in JOINTS if group}


def placed_by_angles(motion: JointMotion, where: str, body: Body | None = None) -> JointMotion:
    """Return the joint centres that the angles of all our joints determine, in our axes.

    Args:
        motion: the angles.
        where: the file's name, for messages.
        body: the person whose lengths are used; None: an average person.

    Raises:
        RecordingError: if a joint turns by more than two whole turns.
    """
    theirs, person = own_angles(motion.angles), body or Body()
    columns = []
    for joint, name in theirs.items():
        angle = np.asarray(motion.angles[name], dtype=float)
        most = float(np.fmax.reduce(np.abs(angle), initial=0.0))
        if most > _MOST:
            raise RecordingError(
                f"{where}: the {spoken(joint)} reaches {most:.4g} rad, allowed two whole turns:"
                " the angles may be in degrees"
            )
        # A straight hinge would not show the rotation of the limb, which the file states.
        columns.append(np.maximum(angle, BENT) if joint.endswith(_HINGES) else angle)
    postures = np.stack(columns, axis=1)
    function = _centres(person)
    places = [np.array(function(postures[at : at + _BLOCK].T)) for at in _starts(len(postures))]
    positions = np.hstack(places).reshape(len(CENTRES), 3, -1).transpose(2, 0, 1)
    notes = [
        "The joint centres are placed by the file's angles of the joints of ergoqp, with the"
        f" lengths of {'an average' if body is None else 'the'} person of {person.stature:.2f} m.",
        "The file does not state where the person stands: the pelvis stays in one place.",
    ]
    if motion.objects:
        notes.append("The objects are left out: where they are beside the person is unknown.")
    return replace(
        motion,
        names=CENTRES,
        positions=positions,
        notes=(*motion.notes, *notes),
        objects={},
        unit=1.0,
        up="z",
    )


def _starts(count: int) -> range:
    return range(0, count, _BLOCK)


def _centres(body: Body) -> ca.Function:
    """Return a function: posture (32,) -> positions of `CENTRES` in the pelvis frame."""
    posture, kinematics = ca.SX.sym("q", len(JOINTS)), Kinematics(body)
    places = [kinematics.at(centre, posture)[0] for centre in CENTRES]
    return ca.Function("centres", [posture], [ca.densify(ca.vertcat(*places))])
