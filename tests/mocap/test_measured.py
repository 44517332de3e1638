"""Which lengths of a person a recording measures, and on which sides."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.human import FRACTIONS, Body
from ergoqp.mocap import fit_postures
from ergoqp.mocap.assumptions import side_measured
from ergoqp.mocap.naming import centres_of

CENTRES = centres_of(Body(), np.tile([0.0, 0.0, 0.9, 0.0], (50, 1)), np.zeros((50, 32)))


def measured(*gone: str, **options: float) -> tuple[str, ...]:
    names = [name for name in CENTRES if name not in gone]
    return fit_postures(
        names, np.stack([CENTRES[name] for name in names], axis=1), 50.0, **options
    ).measured


def test_what_is_between_two_centres_is_measured() -> None:
    whole = set(measured())
    assert whole <= set(FRACTIONS)
    assert {"trunk", "upper_arm", "forearm", "thigh", "shank", "foot_length"} <= whole
    assert not whole & {"hand", "foot_height"}
    wrists = measured("right_wrist", "left_wrist")
    assert whole - set(wrists) == {"forearm"}
    assert measured(person=1.75) == ()


@pytest.mark.parametrize(
    ("segment", "gone", "side"),
    [
        ("forearm", (), None),
        ("forearm", ("left_wrist",), "right"),
        ("forearm", ("right_elbow",), "left"),
        ("forearm", ("right_elbow", "left_wrist"), None),
        ("foot_length", ("right_toe",), "left"),
        ("shoulder_width", (), None),
        ("hand", (), None),
    ],
)
def test_the_side_on_which_alone_it_is(segment: str, gone: tuple[str, ...], side: str) -> None:
    assert side_measured(segment, set(CENTRES) - set(gone)) == side
