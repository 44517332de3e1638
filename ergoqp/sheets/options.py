"""Parameters of REBA, and task options that joint angles cannot tell.

Task options that joint angles cannot tell: load, shock, coupling, activity, support, stance. They
are explicit inputs. They are checked and never guessed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Annotated, Any, Final, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import Range, check_parameters, check_whole, shown
from ergoqp.errors import InputError
from ergoqp.joints import SIDES
from ergoqp.sheets.description import Sheet, load_description, read_sheet

_DESCRIPTION: Final = load_description("reba")
_DEFAULT: Final[dict[str, float]] = _DESCRIPTION["numbers"]

_ASCENDING: Final = (
    ("trunk_upright_deg", "trunk_bent_deg", "trunk_deep_deg"),
    ("knee_bent_deg", "knee_deep_deg"),
    ("upper_arm_low_deg", "upper_arm_middle_deg", "upper_arm_high_deg"),
    ("elbow_low_deg", "elbow_high_deg"),
    ("load_low_kg", "load_high_kg"),
)

_Angle = Annotated[float, Range(0.0, 180.0, "deg")]
_Extension = Annotated[float, Range(-180.0, 180.0, "deg")]
_Mass = Annotated[float, Range(0.0, 1000.0, "kg")]


@dataclass(frozen=True, kw_only=True)
class Method:
    """How the REBA sheet is read.

    The defaults follow the publication. Each field is a point on which implementations are
    known to disagree.

    The reference of an angle is not a parameter: the trunk is measured to the vertical, neck
    and upper arm to the trunk, the forearm to the upper arm, and the knee is 0 when straight.
    Angles that are measured otherwise must be converted first.

    Attributes:
        band_ends: an angle exactly at the end of a band (within 1e-9 rad) gets the ``"lower"``
            of the two scores (20 deg is "0-20") or the ``"higher"``. This holds for the
            thresholds of modifiers too.
        load_ends: points at exactly 5 and 10 kg: ``"inner"`` as printed ("5-10" includes
            both), else the ``"lower"`` or the ``"higher"`` points.
        additive: twist and side bend of neck and trunk give one point each, clamped to the
            table, instead of one point together.
        trunk_extension: score over 20 deg of extension: ``"worksheet"``: 3; ``"capped"``: 2,
            as in implementations that never test it; ``"mirrored"``: as for flexion, so 4 over
            60 deg.
        adduction: an upper arm that crosses the body counts as abducted.
        knees_when_seated: bent knees count also when the person sits.
        arms: ``"whole"``: each arm is scored, and the higher score B counts. ``"segments"``:
            the worse of both arms counts in each segment; the score is then never lower.
        upper_arm: what the bands of the upper arm read: the ``"flexion"`` of the shoulder, or
            the ``"elevation"`` of the arm, which does not depend on how the joints reach it
            (see `ergoqp.sheets.description`). Only assessments can use elevation. Costs use
            flexion, because elevation depends on several joints.
        final_max: upper end of the final score, 15; some implementations stop at 12.
        neck_extension_deg: extension counts past this angle; negative: flexion below that
            amount counts as extension [deg].
        neck_flexion_deg: end of the neck's first band [deg].
        neck_side_bend_deg: threshold of the modifier [deg].
        neck_twist_deg: threshold of the modifier [deg].
        trunk_upright_deg: the trunk is upright up to this angle, in both directions [deg].
        trunk_bent_deg: end of the trunk's second band, in both directions [deg].
        trunk_deep_deg: start of the trunk's last band [deg].
        trunk_side_bend_deg: threshold of the modifier [deg].
        trunk_twist_deg: threshold of the modifier [deg].
        knee_bent_deg: +1 past this angle [deg].
        knee_deep_deg: +2 past this angle; 180 for no such band [deg].
        upper_arm_low_deg: end of the first band, in both directions [deg].
        upper_arm_middle_deg: end of the second band [deg].
        upper_arm_high_deg: end of the third band [deg].
        shoulder_abduction_deg: threshold of the modifier [deg].
        shoulder_rotation_deg: threshold of the modifier, in both directions [deg].
        elbow_low_deg: lower end of the good band [deg].
        elbow_high_deg: upper end of the good band; 180 for no upper end [deg].
        wrist_flexion_deg: end of the first band, in both directions [deg].
        wrist_deviation_deg: threshold of the modifier, in both directions [deg].
        forearm_pronation_deg: threshold of the twisted wrist, in both directions [deg].
        load_low_kg: one point from this mass [kg].
        load_high_kg: two points past this mass [kg].

    Raises:
        InputError: if a value is out of its range, or edges are not in ascending order.

    Source:
        S. Hignett and L. McAtamney, Rapid entire body assessment (REBA), Applied Ergonomics 31
        (2000) 201-205.

    Example:
        >>> import numpy as np
        >>> from ergoqp import JOINTS, reba
        >>> posture = np.zeros(32)
        >>> posture[JOINTS.index("trunk_flexion")] = np.radians(20)
        >>> [int(reba.assess(posture, reba.Method(band_ends=ends)).segments["trunk"][0])
        ...  for ends in ("lower", "higher")]
        [2, 3]
    """

    band_ends: Literal["lower", "higher"] = "lower"
    load_ends: Literal["inner", "lower", "higher"] = "inner"
    additive: bool = False
    trunk_extension: Literal["worksheet", "capped", "mirrored"] = "worksheet"
    adduction: bool = False
    knees_when_seated: bool = False
    arms: Literal["whole", "segments"] = "whole"
    upper_arm: Literal["flexion", "elevation"] = "flexion"
    final_max: int = 15
    neck_extension_deg: _Extension = _DEFAULT["neck_extension_deg"]
    neck_flexion_deg: _Angle = _DEFAULT["neck_flexion_deg"]
    neck_side_bend_deg: _Angle = _DEFAULT["neck_side_bend_deg"]
    neck_twist_deg: _Angle = _DEFAULT["neck_twist_deg"]
    trunk_upright_deg: _Angle = _DEFAULT["trunk_upright_deg"]
    trunk_bent_deg: _Angle = _DEFAULT["trunk_bent_deg"]
    trunk_deep_deg: _Angle = _DEFAULT["trunk_deep_deg"]
    trunk_side_bend_deg: _Angle = _DEFAULT["trunk_side_bend_deg"]
    trunk_twist_deg: _Angle = _DEFAULT["trunk_twist_deg"]
    knee_bent_deg: _Angle = _DEFAULT["knee_bent_deg"]
    knee_deep_deg: _Angle = _DEFAULT["knee_deep_deg"]
    upper_arm_low_deg: _Angle = _DEFAULT["upper_arm_low_deg"]
    upper_arm_middle_deg: _Angle = _DEFAULT["upper_arm_middle_deg"]
    upper_arm_high_deg: _Angle = _DEFAULT["upper_arm_high_deg"]
    shoulder_abduction_deg: _Angle = _DEFAULT["shoulder_abduction_deg"]
    shoulder_rotation_deg: _Angle = _DEFAULT["shoulder_rotation_deg"]
    elbow_low_deg: _Angle = _DEFAULT["elbow_low_deg"]
    elbow_high_deg: _Angle = _DEFAULT["elbow_high_deg"]
    wrist_flexion_deg: _Angle = _DEFAULT["wrist_flexion_deg"]
    wrist_deviation_deg: _Angle = _DEFAULT["wrist_deviation_deg"]
    forearm_pronation_deg: _Angle = _DEFAULT["forearm_pronation_deg"]
    load_low_kg: _Mass = _DEFAULT["load_low_kg"]
    load_high_kg: _Mass = _DEFAULT["load_high_kg"]

    def __post_init__(self) -> None:
        """Check every value, so that every method gives a valid sheet."""
        check_parameters(self, "Method.")
        check_whole("Method.final_max", self.final_max, 12, 15)
        if self.neck_extension_deg <= -self.neck_flexion_deg:
            raise InputError(
                f"Method.neck_extension_deg: got {self.neck_extension_deg:g}, allowed: more than "
                f"{-self.neck_flexion_deg:g}, so that the neck's first band is not empty"
            )
        for names in _ASCENDING:
            values = [getattr(self, name) for name in names]
            if any(low >= high for low, high in itertools.pairwise(values)):
                raise InputError(
                    f"Method.{', '.join(names)}: got {values}, allowed: ascending values"
                )


def read_method(method: Method | None) -> Method:
    """Return a method, the default for None.

    Raises:
        InputError: if it is neither a `Method` nor None.
    """
    if method is not None and not isinstance(method, Method):
        raise InputError(f"method: got {shown(method)}, allowed: a reba.Method")
    return Method() if method is None else method


def check_by_joint(method: Method, what: str) -> None:
    """Raise an error for a method that reads several joints at once.

    Such a method cannot be used where joints are read one by one.

    Args:
        method: how the sheet is read.
        what: the function that would read it, for the message.

    Raises:
        InputError: if the method reads the elevation of the upper arm.
    """
    if method.upper_arm != "flexion":
        raise InputError(
            f"{what}: got Method.upper_arm {method.upper_arm!r}, allowed: 'flexion', as an"
            " elevation mixes joints"
        )


@lru_cache(maxsize=64)
def sheet_of(method: Method) -> Sheet:
    """Return the REBA sheet with the values of a method."""
    return read_sheet(
        _DESCRIPTION, asdict(method), ties=method.band_ends, load_ties=method.load_ends
    )


Pair = tuple[NDArray[np.bool_], NDArray[np.bool_]]

_LOAD: Final = Range(0.0, unit="kg", usual=(0.0, 50.0))
_COUPLING, _ACTIVITY = (Range(0, _DESCRIPTION["points"][name]) for name in ("coupling", "activity"))


class TaskOptions(TypedDict, total=False):
    """The options of a task as keywords, one value for all postures.

    The meanings are those of :func:`ergoqp.sheets.reba.assess`.

    Example:
        >>> from ergoqp.costs.smooth_reba import SmoothReba
        >>> from ergoqp.sheets.options import TaskOptions
        >>> SmoothReba(**TaskOptions(load_kg=12.0, coupling=1)).minimum
        3.0
    """

    load_kg: Annotated[float, _LOAD]
    shock: bool
    coupling: Annotated[int, _COUPLING]
    activity: Annotated[int, _ACTIVITY]
    seated: bool
    one_leg: bool
    arm_supported: tuple[bool, bool]
    shoulder_raised: tuple[bool, bool]


DEFAULTS: Final = TaskOptions(
    load_kg=0.0,
    shock=False,
    coupling=0,
    activity=0,
    seated=False,
    one_leg=False,
    arm_supported=(False, False),
    shoulder_raised=(False, False),
)
"""Values of the options that are not given."""


@dataclass(frozen=True, eq=False)
class Task:
    """Options of a task, each a 0-d array or one value per posture, shape (n,).

    Attributes:
        points: points of ``load`` (with shock), ``coupling`` and ``activity``; int8.
        flags: value of each option, or the (right, left) pair for options of one side; bool.
        load_kg: the mass [kg].
        shock: there is a shock or a rapid build-up of force.
    """

    points: dict[str, NDArray[np.int8]]
    flags: dict[str, NDArray[np.bool_] | Pair]
    load_kg: NDArray[np.float64]
    shock: NDArray[np.bool_]

    def flag(self, option: str, side: str = "") -> NDArray[np.bool_]:
        """Return the values of an option, on one side if it has two."""
        value = self.flags[option]
        return value[SIDES.index(side)] if isinstance(value, tuple) else value

    def rows(self, rows: slice | int) -> Task:
        """Return the options of some postures. A value for all postures stays a single value."""

        def cut(value: NDArray) -> NDArray:
            return value if value.ndim == 0 else np.asarray(value[rows])

        return Task(
            {name: cut(value) for name, value in self.points.items()},
            {
                name: (cut(value[0]), cut(value[1])) if isinstance(value, tuple) else cut(value)
                for name, value in self.flags.items()
            },
            cut(self.load_kg),
            cut(self.shock),
        )


def read_task(sheet: Sheet, count: int | None, options: Mapping[str, Any]) -> Task:
    """Check the options of a task.

    Args:
        sheet: gives the allowed points and the load bands.
        count: number of postures n; None if only single values are allowed.
        options: the given options of `TaskOptions`, each one value or one per posture.

    Raises:
        TypeError: if an option does not exist.
        InputError: if a value is not allowed. The message names the option, the value and what
            is allowed.
    """
    if unknown := [name for name in options if name not in DEFAULTS]:
        raise TypeError(f"task: got {shown(unknown[0])}, allowed {', '.join(DEFAULTS)}")
    given = {**DEFAULTS, **options}
    load = _numbers("load_kg", given["load_kg"], count)
    wrong = ~(np.isfinite(load) & (load >= _LOAD.low))
    if wrong.any():
        raise InputError(
            f"load_kg: got {load[wrong].flat[0]:g}, allowed: a finite mass of {_LOAD.low:g} kg or"
            " more"
        )
    shocks = _flags("shock", given["shock"], count)
    points = {"load": (sheet.load.score(load) + sheet.shock * shocks).astype(np.int8)}
    for name in ("coupling", "activity"):
        points[name] = whole_numbers(name, given[name], 0, sheet.points[name], count)
    flags: dict[str, NDArray[np.bool_] | Pair] = {
        name: _flags(name, given[name], count) for name in ("seated", "one_leg")
    }
    flags |= {
        name: _pair(name, given[name], count) for name in ("arm_supported", "shoulder_raised")
    }
    return Task(points, flags, load, shocks)


def whole_numbers(
    name: str, value: ArrayLike, low: int, high: int, count: int | None
) -> NDArray[np.int8]:
    """Return whole numbers in a range as int8, shape () or (n,).

    Args:
        name: name of the value in messages.
        value: number or numbers.
        low: smallest allowed.
        high: largest allowed.
        count: allowed length n, None for single values only, -1 for any shape.

    Raises:
        InputError: if they are not whole numbers in the range.
    """
    numbers = _numbers(name, value, count)
    wrong = ~((numbers >= low) & (numbers <= high) & (numbers == np.round(numbers)))
    if wrong.any():
        raise InputError(
            f"{name}: got {numbers[wrong].flat[0]:g}, allowed: a whole number from {low} to {high}"
        )
    return numbers.astype(np.int8)


def _numbers(name: str, value: ArrayLike, count: int | None) -> NDArray[np.float64]:
    array = np.asarray(value)
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name}: got {shown(value)}, allowed: a number{_or_row(count)}")
    return _shaped(name, array.astype(float), count)


def _flags(name: str, value: ArrayLike, count: int | None) -> NDArray[np.bool_]:
    array = np.asarray(value)
    numeric = array.dtype.kind in "iuf" and bool(((array == 0) | (array == 1)).all())
    if array.dtype.kind != "b" and not numeric:
        raise InputError(f"{name}: got {shown(value)}, allowed: True or False{_or_row(count)}")
    return _shaped(name, array.astype(bool), count)


def _pair(name: str, value: tuple[ArrayLike, ArrayLike], count: int | None) -> Pair:
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise InputError(f"{name}: got {shown(value)}, allowed: a pair (right, left)")
    return _flags(f"{name} (right)", value[0], count), _flags(f"{name} (left)", value[1], count)


def _shaped(name: str, array: NDArray, count: int | None) -> NDArray:
    if array.ndim == 0 or count == -1 or (count is not None and array.shape == (count,)):
        return array
    rows = "" if count is None else f" or one per posture, shape ({count},)"
    raise InputError(f"{name}: got shape {array.shape}, allowed: a single value{rows}")


def _or_row(count: int | None) -> str:
    return "" if count is None else " or one per posture"
