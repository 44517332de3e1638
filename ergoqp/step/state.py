"""The state that one step hands to the next, as one vector.

The same inputs and the same state always give the same answers.
"""

from __future__ import annotations

import numpy as np

from ergoqp.step.model import StepModel
from ergoqp.step.robot_watch.watch import taken_over
from ergoqp.step.under_way.history import initial_history


def initial_state(model: StepModel, twist: np.ndarray | None = None) -> np.ndarray:
    """Return the state at the start of a loop.

    Args:
        model: model of the step.
        twist: twist with which the object already moves (6,) [m/s, rad/s]. None: it stands still.
    """
    parts = {name: np.zeros(size) for name, size in model.state.items()}
    history = initial_history(model.history, np.zeros(6) if twist is None else twist)
    parts["history"] = np.concatenate([part.ravel(order="F") for part in history.values()])
    if twist is not None:
        for name, block in taken_over(model, twist).items():
            parts[name] = block[:, None]
    return np.concatenate([part.ravel(order="F") for part in parts.values()])
