"""`follower`: weighs hands, feet, balance and ease with weights of their own."""

from __future__ import annotations

from typing import ClassVar

from ergoqp.simulation.people.soft_person import SoftPerson


class FollowerPerson(SoftPerson):
    """Follows the object at once, with the whole body."""

    kind: ClassVar[str] = "follower"
    manner: ClassVar[str] = "who weighs hands, feet, balance and ease in a way of their own"


draw = FollowerPerson.drawn
