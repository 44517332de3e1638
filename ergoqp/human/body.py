"""The body of a person: ``models/human.xml`` scaled, and its kinematics as expressions.

Pose of every frame of the body, and how it moves with the joints.

Both are CasADi functions that are built from the loaded model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, Final, TypeVar, cast

import casadi as ca
import mujoco
import numpy as np

from ergoqp.arguments import check_kind, check_number, check_real, shown
from ergoqp.errors import InputError
from ergoqp.expressions import matrix_of
from ergoqp.joints import INDEX, JOINTS
from ergoqp.registry import data_folder


@dataclass(frozen=True)
class Marker:
    """Position of a marker on the body.

    Attributes:
        frame: frame that it moves with, one of `ergoqp.human.FRAMES`.
        offset: position in that frame, along its axes [m].
        residual: root of the mean squared distance between the marker and this position on the
            fitted body [m]; NaN if it was never seen.
    """

    frame: str
    offset: tuple[float, float, float]
    residual: float


FRACTIONS: Final[dict[str, float]] = {
    "trunk": 0.300,
    "shoulder_height": 0.288,
    "shoulder_width": 0.210,
    "neck": 0.052,
    "head": 0.118,
    "upper_arm": 0.186,
    "forearm": 0.146,
    "hand": 0.108,
    "hip_width": 0.100,
    "thigh": 0.245,
    "shank": 0.246,
    "foot_height": 0.039,
    "foot_length": 0.152,
}
"""Lengths of segments, as shares of the stature.

``trunk`` is measured from the middle of the hip centres to the base of the neck,
``shoulder_height`` from the same point to the height of the shoulder centres. The two widths
are between joint centres, so they are smaller than the outer widths of Winter.

Source:
    Drillis and Contini (1966), as in figure 4.1 of Winter.

Example:
    >>> from ergoqp.human import FRACTIONS
    >>> round(FRACTIONS["forearm"] * 1.75, 4)
    0.2555
"""

NOMINAL_STATURE: Final = 1.75
"""Stature of the unscaled ``models/human.xml`` [m]."""

NOMINAL_MASS: Final = 70.0
"""Mass of the unscaled ``models/human.xml`` [kg]."""

STATURE_RANGE: Final = (1.2, 2.3)
"""Statures that are accepted [m]."""

MASS_RANGE: Final = (20.0, 300.0)
"""Masses that are accepted [kg]."""

BELIEVABLE: Final = (0.6, 1.6)
"""Shortest and longest allowed segment, as a multiple of one of average proportions."""

_LENGTHS: Final = "a table of segments, each with its length [m]"

# Scales of the x, y and z offsets of everything that is attached to a body of the model.
_SCALED_BY: Final[dict[str, tuple[str, str, str]]] = {
    "pelvis": ("girth", "hip_width", "girth"),
    "trunk_twist": ("girth", "shoulder_width", "trunk"),
    "neck_twist": ("girth", "girth", "neck"),
    "head": ("girth", "girth", "head"),
    "shoulder_rotation": ("girth", "girth", "upper_arm"),
    "forearm_pronation": ("girth", "girth", "forearm"),
    "wrist_deviation": ("girth", "girth", "hand"),
    "hip_rotation": ("girth", "girth", "thigh"),
    "knee_flexion": ("girth", "girth", "shank"),
    "ankle_inversion": ("foot_length", "girth", "foot_height"),
}


@dataclass(frozen=True)
class Body:
    """The body of a person: segment lengths, mass, and the MuJoCo model made from them.

    Attributes:
        stature: standing height [m].
        lengths: length of every segment of `FRACTIONS` [m]. Lengths that are not given follow
            from the stature.
        mass: body mass [kg]. 0: that of a normal build for the stature.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Source:
        The segment lengths of an average person are those of Drillis and Contini (1966).

    Example:
        >>> from ergoqp.human import Body
        >>> body = Body(stature=1.60)
        >>> round(body.lengths["forearm"], 4), round(body.mass, 1)
        (0.2336, 58.5)
        >>> round(Body.of_lengths({"forearm": 0.27}).stature, 2)
        1.85
    """

    stature: float = NOMINAL_STATURE
    lengths: Mapping[str, float] = field(default_factory=dict)
    mass: float = 0.0

    def __post_init__(self) -> None:
        """Check the values, and fill in from the stature those that were not given."""
        low, high = STATURE_RANGE
        if isinstance(self.stature, float):
            # Show few digits in the message: a stature from measured lengths has many.
            check_number("stature", round(self.stature, 3), low, high, "m")
        check_number("stature", self.stature, low, high, "m")
        object.__setattr__(self, "stature", float(self.stature))
        check_kind("segment lengths", self.lengths, Mapping, _LENGTHS)
        if unknown := [name for name in self.lengths if name not in FRACTIONS]:
            raise InputError(f"segment lengths: got {shown(unknown)}, allowed {sorted(FRACTIONS)}")
        filled = {name: fraction * self.stature for name, fraction in FRACTIONS.items()}
        for name, length in self.lengths.items():
            check_number(f"length of {name}", length, 0.0, 1e6, "m")
            if not 0.4 <= length / filled[name] <= 2.0:
                raise InputError(
                    f"length of {name}: got {length:.3f} m, allowed {0.4 * filled[name]:.3f} to"
                    f" {2 * filled[name]:.3f} m for a stature of {self.stature:.2f} m"
                )
            filled[name] = float(length)
        object.__setattr__(self, "lengths", filled)
        # The default is 70 kg at 1.75 m, with the same build at every stature.
        check_real("mass", self.mass, "kilograms")
        mass = self.mass or NOMINAL_MASS * (self.stature / NOMINAL_STATURE) ** 2
        check_number("mass", mass, *MASS_RANGE, "kg")
        object.__setattr__(self, "mass", float(mass))

    def as_dict(self) -> dict[str, Any]:
        """Return the body as plain numbers, for files."""
        return {
            "stature_m": self.stature,
            "mass_kg": self.mass,
            "lengths_m": dict(self.lengths),
        }

    @classmethod
    def of_stature(cls, stature: float, mass: float = 0.0) -> Body:
        """Return the body of average proportions with a stature [m].

        A mass of 0 means that of a normal build [kg].

        Raises:
            InputError: if the stature or the mass is out of range.
        """
        return cls(stature=stature, mass=mass)

    @classmethod
    def of_lengths(cls, lengths: Mapping[str, float], mass: float = 0.0) -> Body:
        """Return the body with measured segment lengths [m].

        All other lengths follow from the stature, and the stature follows from the measured
        lengths.

        Args:
            lengths: lengths of one or more segments of `FRACTIONS` [m]. The stature is the
                weighted median of the statures that each length suggests.
            mass: body mass [kg], 0 for a normal build.

        Raises:
            InputError: if a name is unknown, or a length is not possible for a person.
        """
        check_kind("segment lengths", lengths, Mapping, _LENGTHS)
        if not lengths or (set(lengths) - set(FRACTIONS)):
            raise InputError(
                f"segment lengths: got {shown(list(lengths))}, allowed a non-empty part of"
                f" {sorted(FRACTIONS)}"
            )
        for name, length in lengths.items():
            check_number(f"length of {name}", length, 0.01, 10.0, "m")
        return cls(stature=stature_of(lengths), lengths=lengths, mass=mass)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Scaled MuJoCo model: base x, y, z, yaw, then the 32 hinges in the order of `JOINTS`."""
        return self.spec().compile()

    def spec(self) -> mujoco.MjSpec:
        """Return a new specification of the model, to add it to a larger one."""
        girth = self.stature / NOMINAL_STATURE
        factor = {
            name: length / (FRACTIONS[name] * NOMINAL_STATURE)
            for name, length in self.lengths.items()
        }
        factor["girth"] = girth

        def scale_of(owner: str) -> np.ndarray:
            key = owner.removeprefix("right_").removeprefix("left_")
            return np.array(
                [factor[name] for name in _SCALED_BY.get(key, ("girth", "girth", "girth"))]
            )

        spec = mujoco.MjSpec.from_string(_nominal_xml())
        for child in spec.bodies[1:]:
            scale = scale_of(child.parent.name)
            if child.name.endswith("shoulder_flexion"):
                scale[2] = factor["shoulder_height"]
            child.pos = np.asarray(child.pos) * scale
        for site in spec.sites:
            site.pos = np.asarray(site.pos) * scale_of(site.parent.name)
        for geom in spec.geoms:
            scale = scale_of(geom.parent.name)
            geom.mass *= self.mass / NOMINAL_MASS
            geom.size = np.asarray(geom.size) * girth
            if geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE:
                geom.fromto = np.asarray(geom.fromto) * np.tile(scale, 2)
            else:
                geom.pos = np.asarray(geom.pos) * scale
        return spec


def stature_of(lengths: Mapping[str, float]) -> float:
    """Return the stature [m] that measured lengths suggest.

    It is the median of the statures that the segments suggest, weighted by their nominal
    lengths.
    """
    names = list(lengths)
    suggestions = np.array([lengths[name] / FRACTIONS[name] for name in names])
    weights = np.array([FRACTIONS[name] for name in names])
    order = np.argsort(suggestions)
    cumulative = np.cumsum(weights[order])
    return float(suggestions[order][np.searchsorted(cumulative, 0.5 * cumulative[-1])])


def believable(segment: str, stature: float) -> tuple[float, float]:
    """Return the shortest and the longest allowed length of a segment at a stature [m].

    Args:
        segment: a segment of `FRACTIONS`.
        stature: stature of the person [m].
    """
    low, high = BELIEVABLE
    average = FRACTIONS[segment] * stature
    return low * average, high * average


@lru_cache(maxsize=1)
def _nominal_xml() -> str:
    return (data_folder("models") / "human.xml").read_text(encoding="utf-8")


GROWTH: Final[tuple[str, ...]] = ("stature", *FRACTIONS)
"""What may be larger than in the loaded body: everything at once, or one length."""

_STEP: Final = 0.1


class Offsets:
    """Offsets of bodies and sites in their parents, as expressions [m].

    Args:
        body: the loaded body.
        growth: relative growth (14,) in the order of `GROWTH`, or None for none.
        offsets: symbols that take the place of the offsets of the body, see `offsets_of`, or None.
    """

    def __init__(self, body: Body, growth: ca.SX | None, offsets: ca.SX | None = None) -> None:
        """Compute the slopes of the offsets, (n, 3, 14) each, from larger bodies."""
        self._model, self._growth = body.model, growth
        self._symbols = None if offsets is None else _placed(offsets)
        if growth is None:
            return
        here = _positions(body)
        slopes = [here]
        for name in FRACTIONS:
            lengths = dict(body.lengths) | {name: (1 + _STEP) * body.lengths[name]}
            larger = _positions(Body(body.stature, lengths, body.mass))
            slopes.append(((larger[0] - here[0]) / _STEP, (larger[1] - here[1]) / _STEP))
        self._slopes = [np.stack(parts, axis=-1) for parts in zip(*slopes, strict=True)]

    def body(self, number: int) -> ca.SX:
        """Return the position of a body in its parent (3,) [m]."""
        return self._grown(self._model.body_pos[number], 0, number)

    def site(self, name: str) -> ca.SX:
        """Return the position of a site in its body (3,) [m]."""
        number = self._model.site(name).id
        return self._grown(self._model.site_pos[number], 1, number)

    def _grown(self, nominal: np.ndarray, which: int, number: int) -> ca.SX:
        if self._symbols is not None:
            return self._symbols[which][number]
        if self._growth is None:
            return ca.SX(ca.DM(nominal))
        slope = self._slopes[which][number]
        return ca.SX(ca.DM(nominal)) + ca.sparsify(ca.SX(ca.DM(slope))) @ self._growth


def _positions(body: Body) -> tuple[np.ndarray, np.ndarray]:
    return body.model.body_pos.copy(), body.model.site_pos.copy()


@lru_cache(maxsize=1)
def _nonzero() -> tuple[np.ndarray, np.ndarray]:
    """Return which offsets of bodies and sites (n, 3) are not zero in a body of any size."""
    bodies, sites = _positions(Body())
    # The pelvis is where the kinematics begin.
    bodies[: Body().model.body("pelvis").id + 1] = 0
    return bodies != 0, sites != 0


def offsets_of(body: Body) -> np.ndarray:
    """Return the offsets of bodies and sites that are not zero, one after the other (k,) [m].

    They are all that the kinematics of two bodies differ in.
    """
    parts = zip(_positions(body), _nonzero(), strict=True)
    return np.concatenate([part[chosen] for part, chosen in parts])


def _placed(offsets: ca.SX) -> list[list[ca.SX]]:
    """Return the offset (3,) of each body and of each site, from those of `offsets_of`."""
    number, parts = 0, []
    for chosen in _nonzero():
        part = []
        for row in chosen:
            place = ca.SX(3, 1)
            for axis in np.flatnonzero(row).tolist():
                place[axis] = offsets[number]
                number += 1
            part.append(place)
        parts.append(part)
    return parts


Expression = TypeVar("Expression", ca.SX, ca.MX, ca.DM)

FRAMES: Final[tuple[str, ...]] = (
    "pelvis",
    "trunk",
    "neck",
    "head",
    "head_top",
    "nose",
    "eyes",
    *(
        f"{side}_{name}"
        for side in ("right", "left")
        for name in ("shoulder", "elbow", "wrist", "grip", "knuckles", "fingertips", "thumb")
    ),
    *(
        f"{side}_{name}"
        for side in ("right", "left")
        for name in ("hip", "knee", "ankle", "toe", "heel", "sole")
    ),
)
"""Names of the frames (sites of ``models/human.xml``).

``grip`` is where a tool is held. Its x axis points out of the fist along the hand, z to the
thumb. With the elbow at 90 degrees and all other angles at zero it has the axes of the world.
All other frames have the axes of their segment.

Example:
    >>> from ergoqp.human import FRAMES
    >>> "right_grip" in FRAMES, len(FRAMES)
    (True, 33)
"""


class Kinematics:
    """Frames of a body in its pelvis frame, as functions of the posture.

    The pelvis frame is upright: x forward, y left, z up. `at` gives the pose and the geometric
    Jacobian of a frame. `base_jacobian` gives the Jacobian with respect to the motion of the
    pelvis.

    Args:
        body: the person; all numbers come from its loaded MuJoCo model.
        growth: relative growth of the person over `body`, in the order of
            `ergoqp.human.body.GROWTH`; None: no growth.
        offsets: symbols (k,) that take the place of the offsets of `body`, in the order of
            `ergoqp.human.body.offsets_of`; None: its own.

    Example:
        >>> import numpy as np
        >>> import casadi as ca
        >>> from ergoqp.human import Body, Kinematics
        >>> position, rotation, jacobian = Kinematics(Body()).at("right_grip", ca.DM.zeros(32))
        >>> position.full().ravel().round(2).tolist(), jacobian.shape
        ([0.0, -0.16, -0.17], (6, 32))
    """

    def __init__(
        self, body: Body, growth: ca.SX | None = None, offsets: ca.SX | None = None
    ) -> None:
        """Read the tree of the loaded model."""
        self.body, self._growth = body, growth
        self._given = offsets
        self._offsets = Offsets(body, growth, offsets)
        self._q = ca.SX.sym("q", len(JOINTS))
        self._bodies = _forward(body.model, self._offsets, self._q)
        self._functions: dict[str, ca.Function] = {}

    def function(self, frame: str) -> ca.Function:
        """Return ``q (32,) -> (p (3,), R (3, 3), J (6, 32))`` of a frame, in the pelvis frame.

        If the body has a growth, it is a second input.

        The rows of ``J`` are linear first, at the origin of the frame, along the axes of the
        pelvis.

        Raises:
            InputError: if there is no such frame.
        """
        if frame not in FRAMES:
            raise InputError(f"frame: got {frame!r}, allowed one of {', '.join(FRAMES)}")
        if frame in self._functions:
            return self._functions[frame]
        model = self.body.model
        site = model.site(frame)
        owner = int(site.bodyid[0])
        position, rotation, axes = self._bodies[owner]
        origin = position + rotation @ self._offsets.site(frame)
        orientation = _clean(rotation @ ca.DM(_matrix(site.quat)))
        jacobian = ca.SX(6, len(JOINTS))
        for joint, axis, anchor in axes:
            jacobian[:3, joint] = ca.cross(axis, origin - anchor)
            jacobian[3:, joint] = axis
        outputs = ca.cse([_clean(origin), orientation, _clean(jacobian)])
        given = {"q": self._q} | ({} if self._growth is None else {"growth": self._growth})
        given |= {} if self._given is None else {"offsets": self._given}
        self._functions[frame] = ca.Function(
            frame, list(given.values()), outputs, list(given), ["position", "rotation", "jacobian"]
        )
        return self._functions[frame]

    def at(self, frame: str, q: Expression) -> tuple[Expression, Expression, Expression]:
        """Return position (3,) [m], rotation (3, 3) and Jacobian (6, 32) of a frame.

        They are those at the posture `q` (32,) [rad].
        """
        # If the body has a growth, growth and posture are symbols of the same type.
        function, growth = self.function(frame), self._growth
        more = [each for each in (growth, self._given) if each is not None]
        frames = function(cast("ca.SX", q), *more)
        position, rotation, jacobian = cast("tuple[Expression, Expression, Expression]", frames)
        return position, rotation, jacobian


def base_jacobian(position: Expression) -> Expression:
    """Return the Jacobian of a point of the pelvis frame with respect to the pelvis rates, (6, 4).

    The rates are x, y, z [m/s] and yaw [rad/s].
    """
    kind = type(position)
    jacobian = kind(6, 4) if kind is not ca.MX else ca.MX(6, 4)
    jacobian[:3, :3] = ca.DM.eye(3)
    jacobian[0, 3] = -position[1]
    jacobian[1, 3] = position[0]
    jacobian[5, 3] = 1
    return cast("Expression", jacobian)


_Axis = tuple[int, ca.SX, ca.SX]


def _forward(
    model: mujoco.MjModel, offsets: Offsets, q: ca.SX
) -> dict[int, tuple[ca.SX, ca.SX, list[_Axis]]]:
    """Return the pose of each body, and (joint, axis, anchor) of each hinge above it."""
    pelvis = model.body("pelvis").id
    bodies: dict[int, tuple[ca.SX, ca.SX, list[_Axis]]] = {pelvis: (ca.SX(3, 1), ca.SX.eye(3), [])}
    for body in range(pelvis + 1, model.nbody):
        position, rotation, axes = bodies[int(model.body_parentid[body])]
        position = position + rotation @ offsets.body(body)
        rotation = rotation @ ca.DM(_matrix(model.body_quat[body]))
        for number in range(
            model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]
        ):
            joint = INDEX[model.joint(number).name]
            axis = ca.DM(model.jnt_axis[number])
            axes = [*axes, (joint, _clean(rotation @ axis), position)]
            rotation = _clean(rotation @ _about(axis, q[joint]))
        bodies[body] = (_clean(position), rotation, axes)
    return bodies


def _about(axis: ca.DM, angle: ca.SX) -> ca.SX:
    """Return the rotation by `angle` about a unit `axis` (Rodrigues)."""
    cross = ca.skew(axis)
    return _clean(ca.SX.eye(3) + ca.sin(angle) * cross + (1 - ca.cos(angle)) * (cross @ cross))


def _clean(expression: ca.SX) -> ca.SX:
    """Drop entries that are zero by structure, so that later products do not contain them."""
    return ca.sparsify(ca.simplify(expression))


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    matrix = matrix_of(quaternion)
    # Quarter turns give 2e-16 instead of 0. Such entries would only make the expressions
    # larger.
    matrix[np.abs(matrix) < 1e-14] = 0.0
    return matrix
