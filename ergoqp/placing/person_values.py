"""A person as plain values: for files, cache keys and other processes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.responses.ik import IkResponse

_TERMS = (
    "hands",
    "stance",
    "seat_height",
    "tool",
    "free_about_tool",
    "balance",
    "relaxation_time",
    "damping",
    "looks",
    "attention",
    "free_arm",
)


def response_as_dict(response: IkResponse) -> dict[str, Any]:
    """Return a response as numbers, texts and lists. `response_from_dict` makes an equal one."""
    return {
        **response.body.as_dict(),
        "weights": dict(zip(JOINTS, response.weight_vector.tolist(), strict=True)),
        "comfort_deg": {name: float(degrees) for name, degrees in response.comfort_deg.items()},
        **{name: plain(getattr(response, name)) for name in _TERMS},
    }


def response_from_dict(values: Mapping[str, Any]) -> IkResponse:
    """Return the response from the result of `response_as_dict`.

    Raises:
        KeyError, TypeError, InputError: if it does not describe a response.
    """
    body = Body(values["stature_m"], values["lengths_m"], values["mass_kg"])
    terms = {name: values[name] for name in _TERMS}
    return IkResponse(
        body=body, weights=values["weights"], comfort_deg=values["comfort_deg"], **terms
    )


def plain(value: Any) -> Any:
    """Return arrays and tuples as lists, NumPy numbers as Python numbers, all else unchanged."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return list(value)
    return value.item() if isinstance(value, np.generic) else value
