"""Rest postures of many places at once, as machine code: `ModelPerson.settle`, place by lane.

The step of the person is written as C once per structure. Its numbers, such as lengths and
weights, are read from a table, so people of one structure share one library.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import InputError
from ergoqp.joints import LOWER, UPPER
from ergoqp.native.compiled import CompilerError, c_text, loaded, shared_library
from ergoqp.native.content import value_key
from ergoqp.native.shipped import shipped
from ergoqp.rest.model_person import (
    HALVED,
    HISTORY,
    MOST_HALVINGS,
    NEAR,
    PATIENCE,
    REACHED,
    REACHED_ANGLE,
    RIDGE,
    STEPS,
    STILL,
    ModelPerson,
    N,
)

LANES: Final = 4
"""Places in one pass."""

WORTH_COMPILING: Final = 2000
"""The interpreter takes some seconds for so many places, as a compiler does."""

_TERMS: Final = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQRT: "root({0})",
    ca.OP_SIN: "sine({0})",
    ca.OP_COS: "cosine({0})",
    ca.OP_ASIN: "arcsine({0})",
    ca.OP_ACOS: "arccosine({0})",
    ca.OP_ATAN2: "arctangent2({0}, {1})",
    ca.OP_FABS: "size({0})",
    ca.OP_FMIN: "least({0}, {1})",
    ca.OP_FMAX: "most({0}, {1})",
    ca.OP_LT: "truth({0} < {1})",
    ca.OP_LE: "truth({0} <= {1})",
    ca.OP_NOT: "truth({0} == 0.0)",
    ca.OP_AND: "truth(({0} != 0.0) & ({1} != 0.0))",
    ca.OP_OR: "truth(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_IF_ELSE_ZERO: "chosen({0} != 0.0, {1}, all(0.0))",
}
"""C of every operation of a person's step, on all lanes."""

_REACH: Final = np.array([REACHED, REACHED_ANGLE])

_INPUTS: Final = ("q", "locked", "targets", "soles", "gain", "relax")
_OUTPUTS: Final = ("step[{0}]", "away[0]", "away[1]")


class BatchedRests:
    """Rest postures of one person at many places, compiled.

    Args:
        person: the person.
        lanes: places in one pass, 1, 2, 4 or 8.
        build: whether it is compiled if the cache lacks it, which takes some seconds.

    Raises:
        InputError: if the person's step has an operation that this code does not know.
        CompilerError: if there is no C compiler, or it fails, or it is not to be compiled.
    """

    def __init__(self, person: ModelPerson, lanes: int = LANES, build: bool = True) -> None:
        """Compile the step of the person, or find it in the package or in the cache."""
        self._relax = 0.5 * person.response.relaxation_time
        self._targets = _step_of(person).numel_in(2)
        sources, self._constants = rests_sources(person, lanes)
        known = shipped("rests", value_key(sources) or "", None)
        library = known or shared_library("rests", sources, (), (), build)
        self._call = loaded(library).ergoqp_rests
        self._call.restype = None

    def settle(
        self,
        postures: np.ndarray,
        poses: np.ndarray,
        grasp: np.ndarray,
        soles: np.ndarray,
        steps: int = STEPS,
        tolerance: float = STILL,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return rest postures (n, 32) [rad] and which places are reached (n,).

        Args:
            postures: the posture to settle from at each place (n, 32), or one for all (32,) [rad].
            poses: places of the object (n, 4, 4).
            grasp: grips in the contact frame (k, 4, 4).
            soles: poses of the soles (4, 8).
            steps: largest number of steps.
            tolerance: a step in which no joint moves by as much is the last one [rad].
        """
        poses = np.asarray(poses, dtype=float)
        count = len(poses)
        rests = np.array(np.broadcast_to(postures, (count, N)), dtype=float, order="C")
        targets = np.empty((count, self._targets))
        for number, grip in enumerate(grasp):
            columns = (poses @ grip).transpose(0, 2, 1).reshape(count, 16)
            targets[:, 16 * number : 16 * number + 16] = columns
        found = np.empty((count, 2))
        self._call(
            _pointer(rests),
            ctypes.c_longlong(count),
            _pointer(targets),
            _pointer(np.ravel(np.asarray(soles, dtype=float), order="F")),
            _pointer(self._constants),
            _pointer(LOWER),
            _pointer(UPPER),
            ctypes.c_double(self._relax),
            ctypes.c_longlong(steps),
            ctypes.c_double(tolerance),
            ctypes.c_longlong(min(PATIENCE, steps)),
            _pointer(_REACH),
            _pointer(found),
        )
        return rests, np.all(found < _REACH, axis=1)

    def settle_at(
        self, posture: np.ndarray, pose: np.ndarray, grasp: np.ndarray, soles: np.ndarray
    ) -> tuple[np.ndarray, np.bool_]:
        """Return what `settle` gives at one place: posture (32,) and whether it is reached."""
        postures, reached = self.settle(posture, pose[None], grasp, soles)
        return postures[0], reached[0]


def rests_sources(person: ModelPerson, lanes: int = LANES) -> tuple[dict[str, str], np.ndarray]:
    """Return C of a person's rests, text by file name, and the table of its numbers.

    People of one structure have the same text.

    Raises:
        InputError: if the person's step has an operation that this code does not know.
    """
    function = _step_of(person)
    source, constants = step_source(function)
    numbers = {"LANES": lanes, "JOINTS": N, "TARGETS": function.numel_in(2)}
    numbers |= {"HISTORY": HISTORY, "NEAR": NEAR, "RIDGE": RIDGE}
    numbers |= {"HALVED": HALVED, "MOST_HALVINGS": MOST_HALVINGS}
    defines = "".join(f"#define {key} {value!r}\n" for key, value in numbers.items())
    sources = {
        "rests.c": defines + c_text("rests.c"),
        "rests.h": c_text("rests.h"),
        "step.h": source,
    }
    return sources, constants


def _step_of(person: ModelPerson) -> ca.Function:
    return person._step  # pyright: ignore[reportPrivateUsage]


Settle = Callable[
    [np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, bool | np.bool_]
]
"""`ModelPerson.settle`: posture, pose, grasp and soles -> posture at rest, whether reached."""


def settling(person: ModelPerson, places: int) -> Settle:
    """Return how a person settles soonest at so many places, one after the other.

    It is compiled if that comes with the package, is in the cache or pays, and interpreted
    otherwise. Where the object is within reach, both come to rest within 2e-6 rad of each other;
    in a few of 10 000 places a person who could rest in two postures rests in another one.
    """
    own = type(person)
    if own.settle is not ModelPerson.settle or own.move is not ModelPerson.move:
        return person.settle
    try:
        return BatchedRests(person, build=places >= WORTH_COMPILING).settle_at
    except (CompilerError, InputError):
        return person.settle


@lru_cache(maxsize=16)
def step_source(function: ca.Function) -> tuple[str, np.ndarray]:
    """Return C of a person's step on lanes, and the table of its numbers.

    Raises:
        InputError: if the function has an operation that this code does not know.
    """
    constants: list[float] = []
    lines = []
    for number in range(function.n_instructions()):
        kind = function.instruction_id(number)
        given, made = function.instruction_input(number), function.instruction_output(number)
        if kind == ca.OP_CONST:
            lines.append(f"    w{made[0]} = all(c[{len(constants)}]);")
            constants.append(function.instruction_constant(number))
        elif kind == ca.OP_INPUT:
            name, at = _INPUTS[given[0]], f"[{given[1]}]" if given[0] < 4 else ""
            lines.append(f"    w{made[0]} = {name}{at};")
        elif kind == ca.OP_OUTPUT:
            lines.append(f"    {_OUTPUTS[made[0]].format(made[1])} = w{given[0]};")
        elif kind in _TERMS:
            term = _TERMS[kind].format(*(f"w{each}" for each in given))
            lines.append(f"    w{made[0]} = {term};")
        else:
            raise InputError(f"rests: got operation {kind} in the step, allowed those of a person")
    names = ", ".join(f"w{each}" for each in range(function.sz_w()))
    text = "\n".join(
        (
            "static void person_step(const lanes* q, const lanes* locked, const lanes* targets,",
            "                        const lanes* soles, lanes gain, lanes relax, const double* c,",
            "                        lanes* step, lanes* away) {",
            f"    lanes {names};",
            *lines,
            "}",
            "",
        )
    )
    return text, np.array(constants)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
