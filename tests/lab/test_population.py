"""The same task for other people."""

import pickle

import numpy as np
import pytest

from ergoqp.errors import InputError
from ergoqp.joints import INDEX
from ergoqp.lab.population import STATURES, best_of_population, population, variant
from ergoqp.limits import WorkspaceBox
from ergoqp.problem.load import load_problem


@pytest.fixture(scope="module")
def screwing():
    return load_problem("screwing")


@pytest.mark.slow
def test_every_combination_once_with_its_label(screwing):
    found = dict(population(screwing, (1.5, 1.9), ("right", "both"), (0.5, 6.0)))
    assert list(found) == [
        "1.50 m, right hand, 0.5 kg",
        "1.90 m, right hand, 0.5 kg",
        "1.50 m, both hands, 0.5 kg",
        "1.90 m, both hands, 0.5 kg",
        "1.50 m, right hand, 6 kg",
        "1.90 m, right hand, 6 kg",
        "1.50 m, both hands, 6 kg",
        "1.90 m, both hands, 6 kg",
    ]
    problem = found["1.90 m, both hands, 6 kg"]
    assert problem.response.body.stature == 1.9
    assert problem.response.hands == ("right", "left")
    assert problem.task["load_kg"] == 6.0


def test_only_statures_by_default(screwing):
    found = list(population(screwing))
    assert [problem.response.body.stature for _, problem in found] == list(STATURES)
    assert all(
        problem.cost is screwing.cost and problem.task == screwing.task for _, problem in found
    )


def test_the_load_is_in_the_score_and_in_the_cost(screwing):
    heavy = variant(screwing, load_kg=12.0)
    postures = np.zeros((1, 32))
    postures[0, INDEX["trunk_flexion"]] = np.radians(40)
    assert heavy.assess(postures).final[0] > screwing.assess(postures).final[0]
    assert heavy.cost(postures)[0] > screwing.cost(postures)[0] + 0.5


def test_the_other_hand_moves(screwing):
    assert "left_elbow_flexion" in variant(screwing, hands="left").joints
    assert "right_elbow_flexion" not in variant(screwing, hands="left").joints


def test_a_problem_goes_to_another_process(screwing):
    sent = pickle.loads(pickle.dumps(variant(screwing, stature=1.6, load_kg=7.0)))
    postures = np.radians(np.random.default_rng(1).uniform(-10, 50, (3, 32)))
    assert np.array_equal(sent.cost(postures), variant(screwing, load_kg=7.0).cost(postures))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"statures": ()}, "statures: got nothing"),
        ({"statures": (3.0,)}, "stature: got 3.0 m"),
        ({"hands": ("three",)}, "hands: got 'three', allowed right, left, both"),
        ({"loads_kg": (-1.0,)}, "load"),
        ({"statures": ("x",)}, "stature: got 'x', allowed a number of metres"),
        ({"statures": 1.7}, "statures: got 1.7, allowed a list"),
        ({"hands": (["right"],)}, r"hands: got \['right'\], allowed right, left, both"),
        ({"loads_kg": ("x",)}, "load_kg: got 'x', allowed a number of kilograms"),
    ],
)
def test_mistakes_are_named(screwing, arguments, words):
    with pytest.raises(InputError, match=words):
        list(population(screwing, **arguments))


def test_a_learned_cost_knows_no_load():
    with pytest.raises(InputError, match="was learned without"):
        variant(load_problem("screwing_learned"), load_kg=3.0)


def test_only_people_have_statures():
    with pytest.raises(InputError, match="allowed IkResponse"):
        variant(load_problem("forearm"), stature=1.6)


@pytest.mark.slow
def test_everybody_has_their_own_best_place_and_who_has_none_says_why(screwing):
    box = WorkspaceBox((0.35, -0.1, 2.1), (0.45, 0.1, 2.15))
    high = screwing.replace(
        limits=[box if isinstance(limit, WorkspaceBox) else limit for limit in screwing.limits]
    )
    shares = []
    people = [("small", variant(high, stature=1.3)), ("tall", variant(screwing, stature=1.9))]
    small, tall = best_of_population(people, starts=2, progress=shares.append)
    assert small.optimum is None
    assert "(40 out of reach)" in small.note
    assert tall.optimum.response.body.stature == 1.9
    assert 1 <= tall.starts_at_best <= 2
    assert shares == [0.0, 0.5, 1.0]
