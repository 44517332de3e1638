"""A person or a program says no: the object stays at rest until asked again."""

from __future__ import annotations

import numpy as np
import pytest
from step_samples import Held, comfort_of, held_pose, near_comfort, problem_of

from ergoqp.step.guide import Guide
from ergoqp.step.stepper import Stepper


@pytest.mark.slow
def test_held_it_comes_to_rest_and_says_so() -> None:
    stepper = Stepper(problem_of("screwing"))
    posture = near_comfort("screwing", np.random.default_rng(0), 20)
    for _ in range(60):
        moving = stepper.step(posture)
    assert moving.twist.any()
    stepper.hold()
    for _ in range(300):
        held = stepper.step(posture)
    assert held.status == "braking"
    assert not held.twist.any()
    assert "held: the object stays at rest until try_again()" in held.reason
    stepper.try_again()
    for _ in range(60):
        moving = stepper.step(posture)
    assert moving.twist.any()
    stepper.hold()
    stepper.reset()
    assert "held" not in stepper.step(posture).reason


@pytest.mark.slow
def test_asked_again_a_guide_is_tried_anew() -> None:
    place = held_pose("screwing")
    place[0, 3] += 0.1
    stepper = Stepper(problem_of("screwing"), guide=Guide(place, firm=True))
    loop, posture = Held(stepper, held_pose("screwing")), comfort_of("screwing")
    for _ in range(2):
        assert sum(loop.step(posture).drawn > 0 for _ in range(1500)) > 50
        assert not any(loop.step(posture).drawn for _ in range(300))
        stepper.try_again()
