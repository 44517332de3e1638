"""A response: a person who would rather move anything than the trunk."""

from __future__ import annotations

from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.responses import IkResponse


def stiff_trunk(stature: float = 1.75, stiffness: float = 10.0) -> IkResponse:
    """Return the package's response with the trunk's joints so many times as dear."""
    trunk = {name: stiffness for name in JOINTS if name.startswith("trunk")}
    return IkResponse(body=Body.of_stature(stature), weights=trunk)
