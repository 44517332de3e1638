"""Our names of joint centres, and the comparison of names that programs write."""

from __future__ import annotations

import re
from typing import Final

CENTRES: Final[tuple[str, ...]] = (
    "pelvis",
    "neck",
    "head",
    "head_top",
    "nose",
    *(
        f"{side}_{name}"
        for side in ("right", "left")
        for name in ("shoulder", "elbow", "wrist", "knuckles", "thumb")
    ),
    *(f"{side}_{name}" for side in ("right", "left") for name in ("hip", "knee", "ankle", "toe")),
)
"""The joint centres that a recording can be mapped to: frames of `ergoqp.human.FRAMES`.

``pelvis`` is the middle of the hip centres, ``neck`` the base of the neck, ``head`` the base of the
skull.

Example:
    >>> from ergoqp.recordings.names import CENTRES
    >>> "right_elbow" in CENTRES
    True
"""


_NAMELESS: Final = re.compile(r"[*U]?\d*|C_\d+|unlabell?ed.*", re.IGNORECASE)


def nameless(name: str) -> bool:
    """Return whether a marker's name, without its prefix, is one that programs give by default.

    >>> nameless("*21"), nameless("Anna:U7"), nameless("LASI")
    (True, True, False)
    """
    return _NAMELESS.fullmatch(name.rpartition(":")[2]) is not None


def squashed(name: str) -> str:
    """Return a name in small letters, without the separators of its words.

    >>> squashed("Left Elbow_2") == squashed("LEFT.ELBOW-2")
    True
    """
    return re.sub(r"[\s_.\-]+", "", name.casefold())


def parted(name: str) -> tuple[str, str]:
    """Return the prefix of a joint's or marker's name, which states the person, and the rest.

    The prefix stands before the last colon or slash. A slash at the very front is ignored.

    >>> parted("Anna:LASI"), parted("/human/left_elbow"), parted("neck")
    (('Anna', 'LASI'), ('human', 'left_elbow'), ('', 'neck'))
    """
    at = max(name.rfind(":"), name.rfind("/"))
    return name[: max(at, 0)].lstrip("/"), name[at + 1 :]
