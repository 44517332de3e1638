"""The known OpenSim models: which coordinate rotates which segment about which axis.

Axes are OpenSim's: x forward, y up, z to the right. They are given for the right side; the left
side is mirrored. A segment's long axis is its y. The numbers are those of the published models:
Rajagopal et al. 2016 (OpenCap's LaiUhlrich2022, gait2392 and Hamner's model have the same rotations
except for the sign of the knee), Seth et al. 2019, and Wu et al. 2016 as used for lifting boxes by
pyomeca's authors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

Axis = tuple[float, float, float]
Step = tuple[str | float, Axis]
"""A coordinate, in small letters and without its side, or a fixed angle [rad]; and its axis."""

X: Final[Axis] = (1.0, 0.0, 0.0)
Y: Final[Axis] = (0.0, 1.0, 0.0)
Z: Final[Axis] = (0.0, 0.0, 1.0)
_BACK_X: Final[Axis] = (-1.0, 0.0, 0.0)
_BACK_Z: Final[Axis] = (0.0, 0.0, -1.0)


@dataclass(frozen=True)
class Segment:
    """The orientation of a segment.

    Attributes:
        parent: the segment that it hangs from; None: the ground.
        steps: rotations, each about the axes that result from those before.
        needed: coordinates without which it is unknown; other missing coordinates are zero.
    """

    parent: str | None
    steps: tuple[Step, ...]
    needed: tuple[str, ...]


@dataclass(frozen=True)
class OpenSimModel:
    """A model.

    Attributes:
        title: its name in messages.
        telling: coordinates that identify a file of this model.
        segments: its segments, each after its parent; all but pelvis and trunk exist on both sides.
        sides: side of the body -> ending of its coordinates.
        root: the segment that the translations move, ``pelvis`` or ``trunk``.
        moved: these translations, along x, y and z.
        origin: from the translated point to the middle of the hips, or to the base of the neck, in
            the axes of the root [m].
        ground: rotations of the ground's axes to those in which the root moves.
        notes: sentences about the model.
    """

    title: str
    telling: tuple[str, ...]
    segments: Mapping[str, Segment]
    sides: Mapping[str, str]
    root: str
    moved: tuple[str, str, str]
    origin: Axis
    ground: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, those of the right side for both."""
        turned = {
            step + ("" if name in {"pelvis", "trunk"} else self.sides["right"]): None
            for name, segment in self.segments.items()
            for step, _ in segment.steps
            if isinstance(step, str)
        }
        return (*turned, *self.moved)


def _steps(names: tuple[str, ...], *axes: Axis) -> tuple[Step, ...]:
    return tuple(zip(names, axes, strict=True))


_BELOW: Final = (
    "The pelvis is placed below the neck along the thorax and has the same heading, because the"
    " file has no hips; the trunk has no twist."
)
_TO_SCAPULA: Final = (
    "The angles of the shoulder are those of the upper arm to the scapula, and the rotation of the"
    " scapula on the thorax is added: the arm is higher than its elevation in the file."
)
_PELVIS: Final = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
_LUMBAR: Final = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")
_HIP: Final = ("hip_flexion", "hip_adduction", "hip_rotation")
_ARM: Final = ("arm_flex", "arm_add", "arm_rot")

FULL_BODY: Final = OpenSimModel(
    title="Rajagopal, OpenCap or gait2392",
    telling=("pelvis_tilt",),
    # Planar models have the first coordinate of each joint only.
    segments={
        "pelvis": Segment(None, _steps(_PELVIS, Z, X, Y), _PELVIS[:1]),
        "trunk": Segment("pelvis", _steps(_LUMBAR, Z, X, Y), _LUMBAR[:1]),
        "upper_arm": Segment("trunk", _steps(_ARM, Z, X, Y), _ARM[:1]),
        # The hinge is turned inward by 13 degrees, and the forearm with it.
        "forearm": Segment("upper_arm", ((0.228, Y), ("elbow_flex", Z)), ("elbow_flex",)),
        # At zero the palm points forward, a quarter turn from ours.
        "hand": Segment(
            "forearm",
            (("pro_sup", Y), ("wrist_flex", Z), ("wrist_dev", X), (-math.pi / 2, Y)),
            ("pro_sup",),
        ),
        "thigh": Segment("pelvis", _steps(_HIP, Z, X, Y), _HIP[:1]),
        "shank": Segment("thigh", (("knee_angle", _BACK_Z),), ("knee_angle",)),
        # The models' two axes are oblique and would also turn the foot outward. Our ankle has no
        # joint for that, so the moved toe would be read as inversion.
        "foot": Segment("shank", (("ankle_angle", Z), ("subtalar_angle", X)), ("ankle_angle",)),
    },
    sides={"right": "_r", "left": "_l"},
    root="pelvis",
    moved=("pelvis_tx", "pelvis_ty", "pelvis_tz"),
    origin=(-0.06, -0.08, 0.0),
)

_THORAX: Final = tuple(f"ground_thorax_rot_{name}" for name in "xyz")
_SCAPULA: Final = (
    "scapula_abduction",
    "scapula_elevation",
    "scapula_upward_rot",
    "scapula_winging",
)
_HUMERUS: Final = ("plane_elv", "shoulder_elv", "axial_rot")
_ELBOW: Final = Segment("upper_arm", ((0.049, Y), ("elbow_flexion", Z)), ("elbow_flexion",))

THORACOSCAPULAR: Final = OpenSimModel(
    title="thoracoscapular shoulder",
    telling=(*_THORAX, *_SCAPULA),
    segments={
        "trunk": Segment(None, _steps(_THORAX, X, Y, Z), _THORAX),
        # On the ellipsoid of the thorax, then from the joint's axes to the bone's.
        "scapula": Segment(
            "trunk",
            (
                (-1.07, Y),
                *_steps(_SCAPULA, Y, _BACK_X, Z, Y),
                (0.2854, Z),
                (1.1416, Y),
                (0.5181, X),
            ),
            _SCAPULA,
        ),
        # The last step is from the bone's axes to the line between shoulder and elbow.
        "upper_arm": Segment(
            "scapula",
            (
                *_steps(_HUMERUS, Y, _BACK_X, (-0.0846, 0.9947, -0.0584)),
                (0.0596, (0.8632, 0.0, 0.5049)),
            ),
            _HUMERUS,
        ),
        "forearm": _ELBOW,
        # At zero the palm faces the thigh, like ours.
        "hand": Segment("forearm", (("pro_sup", Y),), ("pro_sup",)),
    },
    sides={"right": ""},
    root="trunk",
    moved=("ground_thorax_tx", "ground_thorax_ty", "ground_thorax_tz"),
    origin=(-0.06, 0.0, 0.0),
    notes=(_BELOW, _TO_SCAPULA, "The wrist is straight, because the model has no wrist."),
)

THORACOHUMERAL: Final = replace(
    THORACOSCAPULAR,
    telling=_THORAX,
    segments={
        **{name: each for name, each in THORACOSCAPULAR.segments.items() if name != "scapula"},
        "upper_arm": Segment("trunk", _steps(_HUMERUS, Y, _BACK_X, Y), _HUMERUS),
    },
    notes=(
        _BELOW,
        "The file has no scapula: the angles of the shoulder are taken as those of the upper arm to"
        " the thorax (ISB's plane of elevation, elevation and axial rotation).",
        THORACOSCAPULAR.notes[2],
    ),
)

_TILT: Final = ("thorax_tilt", "thorax_list", "thorax_rotation")
_CLAVICLE: Final = tuple(f"sternoclavicular_r{i}" for i in (1, 2, 3))
_ACROMION: Final = tuple(f"acromioclavicular_r{i}" for i in (1, 2, 3))
_SHOULDER: Final = ("shoulder_plane", "shoulder_ele", "shoulder_rotation")

UPPER_LIMB: Final = OpenSimModel(
    title="Wu's upper limb",
    telling=_TILT,
    segments={
        "trunk": Segment(None, _steps(_TILT, Z, X, Y), _TILT),
        "clavicle": Segment(
            "trunk",
            _steps(
                _CLAVICLE,
                (0.0153, 0.9893, -0.1451),
                (-0.9945, 0.0, -0.1050),
                (-0.1038, 0.1454, 0.9839),
            ),
            _CLAVICLE[:2],
        ),
        # To the axes of the joint and back, and then to those of the shoulder's socket.
        "scapula": Segment(
            "clavicle",
            (
                (-0.52, X),
                (0.52, Y),
                *_steps(_ACROMION, Z, Y, _BACK_X),
                (-0.52, Y),
                (0.52, X),
                (0.0748, X),
                (0.5327, Y),
                (-0.7991, Z),
            ),
            _ACROMION,
        ),
        # The last step is from the bone's axes to the line between shoulder and elbow.
        "upper_arm": Segment(
            "scapula",
            (*_steps(_SHOULDER, Y, Z, Y), (0.0472, (0.8958, 0.0, 0.4443))),
            _SHOULDER,
        ),
        "forearm": _ELBOW,
        # At zero the palm faces the thigh, like ours; the wrist's first angle bends to the thumb.
        "hand": Segment(
            "forearm", (("pro_sup", Y), ("hand_r_add", Z), ("hand_r_flex", X)), ("pro_sup",)
        ),
    },
    sides={"right": ""},
    root="trunk",
    moved=("thorax_tx", "thorax_ty", "thorax_tz"),
    origin=(-0.06, 0.0, 0.0),
    # In its ground z is up, and people face along -x.
    ground=((1.5708, X), (3.15159, Y)),
    notes=(_BELOW, _TO_SCAPULA),
)

MODELS: Final = (FULL_BODY, THORACOSCAPULAR, THORACOHUMERAL, UPPER_LIMB)
"""The known models; the first whose `telling` coordinates are all in the file is used."""
