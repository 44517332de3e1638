"""No answer of the step has changed unnoticed, see `pinned`."""

import numpy as np
import pytest
from pinned import EVERY, LOOPS, answers, load, stepper_of, told


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPS)
def test_answers_are_what_they_were(name: str) -> None:
    inputs, kept, reasons = load(name)
    steps = list(answers(stepper_of(LOOPS[name]), inputs))
    np.testing.assert_allclose([step.twist for step in steps], kept["sent"], rtol=1e-7, atol=1e-9)
    assert [f"{step.status}: {step.reason}" for step in steps] == reasons
    np.testing.assert_allclose(
        [told(step) for step in steps[EVERY - 1 :: EVERY]], kept["told"], rtol=1e-6, atol=1e-8
    )
