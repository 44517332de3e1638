"""A class where an object belongs: the message says what to write."""

from __future__ import annotations

from typing import Any

import pytest
from step_samples import problem_of

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import ErgoqpError
from ergoqp.human import Body
from ergoqp.limits import JointLimit, OneClassBoundary, TwistLimit
from ergoqp.problem.settings import Control
from ergoqp.responses import IkResponse


class OwnCost:
    """A cost of one's own, whose name comes with the object."""

    minimum = 1.0

    def __init__(self, name: str) -> None:
        self.name = name

    def expression(self, q: Any) -> Any:
        return q[0]

    def __call__(self, postures: Any) -> Any:
        return postures


class OneClass:
    def margin_and_slope(self, q: Any) -> Any:
        return q


@pytest.mark.parametrize(
    ("what", "term", "name"),
    [
        ("cost", OwnCost, "OwnCost"),
        ("cost", SmoothReba, "SmoothReba"),
        ("response", IkResponse, "IkResponse"),
        ("limits", [TwistLimit], "TwistLimit"),
        ("limits", [TwistLimit(), JointLimit], "JointLimit"),
        ("control", Control, "Control"),
    ],
)
def test_a_class_in_place_of_an_object_is_told(what: str, term: Any, name: str) -> None:
    with pytest.raises(ErgoqpError) as caught:
        problem_of("screwing").replace(**{what: term})
    said = str(caught.value)
    assert said.startswith(f"{what}: got <class ")
    assert said.endswith(f", allowed an object, not the class: {name}(...)")


def test_a_class_is_told_by_the_terms_too() -> None:
    wrong: Any = Body
    with pytest.raises(ErgoqpError, match=r"body: got .*, not the class: Body\(\.\.\.\)$"):
        IkResponse(body=wrong)
    wrong = OneClass
    with pytest.raises(ErgoqpError, match=r"model: got .*, not the class: OneClass\(\.\.\.\)$"):
        OneClassBoundary(wrong)


def test_a_class_that_is_no_such_term_is_told_what_a_term_has() -> None:
    for what in ("cost", "response"):
        with pytest.raises(ErgoqpError, match=f"got <class 'int'>, allowed a {what} with "):
            problem_of("screwing").replace(**{what: int})
