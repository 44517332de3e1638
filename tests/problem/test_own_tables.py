"""Tables of own terms: the types and names of what they are made with, and what they make."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ergoqp.costs.cost import LearnedCost
from ergoqp.errors import ProblemError
from ergoqp.limits import AxisCone
from ergoqp.problem import schema as own_terms
from ergoqp.problem.load import COSTS, LIMITS, RESPONSES, problem_from_dict
from ergoqp.problem.schema import CostTable, LimitsTable, ResponseTable
from ergoqp.registry import GROUPS


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch):
    """Return a function that makes a limit of an own term and tells what the term was given."""

    def make(term: Any, keys: dict[str, Any], name: str = "own") -> dict[str, Any]:
        def own_term(kind: str, name: str) -> Any:
            return term

        names = {what: (name,) if what == "limit" else () for what in GROUPS}
        monkeypatch.setattr(own_terms, "registered", names.__getitem__)
        monkeypatch.setattr(own_terms, "own_term", own_term)
        SEEN.clear()
        problem_from_dict({"response": {"ik": {}}, "limits": {name: keys}}, "p")
        return dict(SEEN)

    return make


SEEN: dict[str, Any] = {}


def note(**keys: Any) -> AxisCone:
    SEEN.update(keys)
    return AxisCone((0, 0, 1), 60.0)


def lists(
    numbers: list[float],
    pairs: list[tuple[float, float]],
    triple: tuple[float, float, float],
    some: tuple[float, ...] | None = None,
    by_name: dict[str, tuple[float, float]] | None = None,
) -> AxisCone:
    return note(numbers=numbers, pairs=pairs, triple=triple, some=some, by_name=by_name)


def arrays(point: np.ndarray, matrix: NDArray[np.float64] | None = None) -> AxisCone:
    return note(point=point, matrix=matrix)


def paths(model: Path) -> AxisCone:
    return note(model=model)


def clashes(schema: float, copy: int, validate: str, model_config: bool, _low: float) -> AxisCone:
    return note(schema=schema, copy=copy, validate=validate, model_config=model_config, _low=_low)


def test_lists_and_tuples_within_each_other(made) -> None:
    keys = {"numbers": [1.0, 2], "pairs": [[1.0, 2.0]], "triple": [1, 2.0, 3.0]}
    more = {"some": [1.0], "by_name": {"a": [1.0, 2.0]}}
    assert made(lists, keys | more) == {
        "numbers": [1.0, 2],
        "pairs": [(1.0, 2.0)],
        "triple": (1, 2.0, 3.0),
        "some": (1.0,),
        "by_name": {"a": (1.0, 2.0)},
    }
    with pytest.raises(ProblemError, match=r"limits\.own\.numbers\.1: got '2', allowed a number"):
        made(lists, keys | {"numbers": [1.0, "2"]})
    with pytest.raises(
        ProblemError, match=r"limits\.own\.numbers: got 1\.0, allowed a list of numbers"
    ):
        made(lists, keys | {"numbers": 1.0})


def test_arrays(made) -> None:
    seen = made(arrays, {"point": [1, 2, 3], "matrix": [[1.0, 0.0], [0.0, 1.0]]})
    assert (seen["point"].dtype, seen["point"].tolist()) == (np.dtype(float), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(seen["matrix"], np.eye(2))
    for value in ([[1.0], [1.0, 2.0]], ["1"], 1.0, [True]):
        with pytest.raises(ProblemError, match=r"limits\.own\.point: got .*, allowed an array of"):
            made(arrays, {"point": value})


def test_paths(made) -> None:
    assert made(paths, {"model": "my.npz"}) == {"model": Path("my.npz")}
    with pytest.raises(ProblemError, match=r"limits\.own\.model: got 1, allowed"):
        made(paths, {"model": 1})


def test_names_that_pydantic_has_too(made) -> None:
    keys = {"schema": 1.0, "copy": 2, "validate": "x", "model_config": True, "_low": 0.5}
    assert made(clashes, keys) == keys
    for name in ("model_config", "schema", "copy", "__base__"):
        assert made(clashes, keys, name) == keys
    with pytest.raises(ProblemError, match=r"limits\.own\.copy: got 'x', allowed a whole number"):
        made(clashes, keys | {"copy": "x"})
    with pytest.raises(
        ProblemError, match=r"own\.skema: got a key .*, allowed schema \(the nearest\)"
    ):
        made(clashes, keys | {"skema": 1.0})
    with pytest.raises(ProblemError, match=r"own\.own_0: got a key that is not known"):
        made(clashes, keys | {"own_0": 1.0})


def of_a_cost(cost: LearnedCost) -> AxisCone:
    return note(cost=cost)


def test_a_parameter_that_no_file_can_say_is_named(made) -> None:
    words = r"own: got the parameter cost: .*LearnedCost.*, allowed numbers, texts, lists"
    with pytest.raises(ProblemError, match=words):
        made(of_a_cost, {"cost": 1.0})


def five() -> int:
    return 5


@dataclass(frozen=True)
class NoState:
    """A response without names."""

    coordinates: Any = 5
    largest = joints = weight_vector = None

    def expression(self) -> None: ...

    sensitivity = contact = expression


@pytest.mark.parametrize(
    ("term", "sentence"),
    [
        (five, r"p: response\.own: got 5, allowed a response with coordinates, .*contact"),
        (NoState, r"p: response\.own coordinates: got 5, allowed names of the state"),
    ],
)
def test_what_is_no_response_is_a_sentence(monkeypatch, term: Any, sentence: str) -> None:
    names = {what: ("own",) if what == "response" else () for what in GROUPS}
    monkeypatch.setattr(own_terms, "registered", names.__getitem__)
    monkeypatch.setattr(own_terms, "own_term", lambda kind, name: term)
    with pytest.raises(ProblemError, match=sentence):
        problem_from_dict({"response": {"own": {}}}, "p")


def test_every_table_is_registered() -> None:
    for terms, table in ((COSTS, CostTable), (RESPONSES, ResponseTable), (LIMITS, LimitsTable)):
        assert set(terms) == set(table.model_fields)
