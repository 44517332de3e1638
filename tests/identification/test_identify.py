"""Who stands there, from their rests: people of the model's kind and of others, and bad input."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.identification.identify import WIDTHS, Identified, Identifier, Unexplained
from ergoqp.identification.promising import LIKELY, Candidate, CandidateSearch, chosen
from ergoqp.joints import JOINTS
from ergoqp.problem.geometry import Workspace
from ergoqp.simulation.people import person_of_kind

NOISE = np.radians(2.0) / np.sqrt(5)


@cache
def rests_of_kind(kind: str, name: str, seed: int) -> Any:
    """Ten noisy rests to be identified by, and eight exact ones to be predicted."""
    problem, rng = ergoqp.load_problem(name), np.random.default_rng(seed)
    person = person_of_kind(kind, problem, seed)
    home, workspace, found = person.hold(person.comfort), Workspace(problem), []
    for _ in range(200):
        there, pose = home.copy(), workspace.pose(rng.uniform(-1, 1, 5))
        if there.carry(pose):
            found.append((there.posture.copy(), pose))
        if len(found) == 18:
            break
    assert len(found) == 18
    noisy = [(posture + NOISE * rng.standard_normal(32), pose) for posture, pose in found[:10]]
    return problem, noisy, found[10:]


@cache
def identified(kind: str, name: str, seed: int) -> Identified:
    problem, rests, _ = rests_of_kind(kind, name, seed)
    return ergoqp.identify(problem, rests)


def off_deg(person: Identified, unseen: Any) -> float:
    parts = [(person.posture_at(pose) - posture)[person.joints] for posture, pose in unseen]
    return float(np.median(np.degrees(np.sqrt(np.mean(np.array(parts) ** 2, axis=1)))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name", "most"),
    [("alike", "screwing", 2.0), ("alike", "desk", 2.0), ("follower", "dentist", 5.0)],
)
def test_rests_at_unseen_places_are_predicted(kind: str, name: str, most: float) -> None:
    problem, _, unseen = rests_of_kind(kind, name, 1)
    nobody = Identifier(problem).identify([rests_of_kind(kind, name, 1)[1][0]])
    person = identified(kind, name, 1)
    assert off_deg(person, unseen) < most
    # One rest is no person: what is gained is gained from the other nine.
    assert off_deg(person, unseen) < 0.7 * off_deg(nobody, unseen)
    assert person.residual_deg < 3.0
    assert person.rests == 10


@pytest.mark.slow
def test_what_no_traits_explain_is_expected_elsewhere_too() -> None:
    gained = []
    for kind, name in (("follower", "dentist"), ("follower", "screwing"), ("alike", "desk")):
        problem, rests, unseen = rests_of_kind(kind, name, 1)
        person = identified(kind, name, 1)
        plain = replace(person, beyond=Identifier(problem).nobody(rests).beyond)
        gained.append(off_deg(plain, unseen) - off_deg(person, unseen))
        near, (posture, pose) = person.joints, rests[0]
        misses = [
            np.abs((each.posture_at(pose) - posture)[near]).mean() for each in (person, plain)
        ]
        assert misses[0] <= misses[1]
    # Whoever is the model's kind needs none of it, and others are known better by it.
    assert min(gained[:2]) > 0.2
    assert gained[2] == 0.0


@pytest.mark.slow
def test_half_of_what_is_read_too_much_everywhere_is_taken_for_a_habit() -> None:
    problem, rests, _ = rests_of_kind("alike", "desk", 1)
    elbow = identified("alike", "desk", 1).joints[3]
    shifted = np.radians(8.0) * (np.arange(32) == elbow)
    person = ergoqp.identify(problem, [(posture + shifted, pose) for posture, pose in rests])
    plain = replace(person, beyond=Identifier(problem).nobody(rests).beyond)
    bias = np.radians(person.bias_deg[JOINTS[elbow]])
    assert bias > np.radians(3.0)
    added = [(person.posture_at(pose) - plain.posture_at(pose))[elbow] for _, pose in rests]
    assert 0.4 < np.mean(added) / bias < 0.65


@pytest.mark.slow
def test_a_joint_that_was_not_seen_is_as_unsure_as_can_be() -> None:
    problem, rests, _ = rests_of_kind("follower", "dentist", 1)
    hidden = identified("follower", "dentist", 1).joints[4]
    unseen = [(np.where(np.arange(32) == hidden, np.nan, q), pose) for q, pose in rests]
    person = ergoqp.identify(problem, unseen)
    assert person.beyond.width > 0
    at = person.unsure(rests[0][1])
    np.testing.assert_allclose(at[4], person.beyond.width, rtol=1e-3)
    assert np.delete(at, 4).max() < 0.9 * person.beyond.width


@pytest.mark.slow
def test_the_person_is_a_response_and_a_body() -> None:
    problem, rests, _ = rests_of_kind("alike", "screwing", 1)
    person = identified("alike", "screwing", 1)
    again = problem.replace(response=person.response)
    assert again.response.body.as_dict() == person.body.as_dict()
    step = ergoqp.Stepper(again).step(*rests[0])
    assert step.status in ("optimal", "settled", "relaxed", "recovering")


@pytest.mark.slow
def test_what_rests_do_not_say_stays_wide() -> None:
    person = identified("alike", "screwing", 1)
    comfort = person.comfort_deg
    assert set(comfort) == set(person.bias_deg)
    widths = np.array([width for _, width in comfort.values()])
    assert np.all(widths > 0)
    assert np.all(widths <= 15.0 + 1e-6)
    # Hip, knee and ankle of one leg are told apart by nothing but habit.
    assert comfort["right_hip_rotation"][1] > 3.0
    assert np.all(np.linalg.eigvalsh(person.covariance) > 0)


def test_joints_that_are_not_seen_do_not_count() -> None:
    problem, rests, unseen = rests_of_kind("alike", "screwing", 1)
    hidden = [(np.where(np.arange(32) % 5 == 2, np.nan, q), pose) for q, pose in rests]
    assert off_deg(ergoqp.identify(problem, hidden), unseen) < 4.0


@pytest.mark.slow
def test_a_rest_that_fits_nobody_counts_little() -> None:
    problem, rests, unseen = rests_of_kind("alike", "desk", 1)
    odd = rests[0][0].copy()
    odd[[0, 6, 9]] += np.radians([40, -50, 60])
    assert off_deg(ergoqp.identify(problem, [*rests[1:], (odd, rests[0][1])]), unseen) < 3.0


def test_time_is_bounded() -> None:
    problem, rests, _ = rests_of_kind("alike", "screwing", 1)
    short = ergoqp.identify(problem, rests, longest=0.0)
    assert np.isfinite(short.posture_at(rests[0][1])).all()
    assert short.residual_deg > identified("alike", "screwing", 1).residual_deg


def test_places_are_promised_by_what_is_gained() -> None:
    problem, _, _ = rests_of_kind("follower", "dentist", 1)
    person, promising = identified("follower", "dentist", 1), CandidateSearch(problem, 2.0)
    places = promising.places(person, 5.0)
    gains = [place.gain for place in places]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 1.0
    assert all(0 <= gain <= 4.0 for gain in gains)
    box = problem.limits
    assert box
    # Below the lowest score there is nothing to gain.
    assert promising.places(person, 0.9)[0].gain == 0.0
    living = person_of_kind("follower", problem, 1)
    holding = living.hold(living.comfort)
    start = int(problem.assess(holding.posture).final[0])
    assert holding.carry(places[0].pose)
    assert int(problem.assess(holding.posture).final[0]) <= min(start, 3)


@pytest.mark.slow
def test_where_more_is_unsure_more_may_be_gained() -> None:
    person, promising = (
        identified("follower", "dentist", 1),
        CandidateSearch(ergoqp.load_problem("dentist"), 2.0),
    )
    far = np.eye(4)
    far[:3, 3] = 50.0
    never = np.zeros((1, len(person.joints)))
    widths = (0.0, WIDTHS[-1])
    by_width = [replace(person, beyond=Unexplained([far], never, (each,))) for each in widths]
    # Of a place that is a little worse than the best so far.
    place = promising.places(by_width[0], 5.0)[10]
    found = [promising.places(each, place.score - 0.3, [place.pose]) for each in by_width]
    sure, unsure = (
        next(each for each in places if np.all(each.pose == place.pose)) for places in found
    )
    assert unsure.score == sure.score
    assert unsure.gain > 1.2 * sure.gain


def test_places_are_chosen_for_what_they_add_to_each_other() -> None:
    likely = np.ones(LIKELY)
    half = np.arange(LIKELY) % 2
    first = Candidate(np.eye(4), 1.0, 1.0, 2 * likely + half)
    same = Candidate(np.eye(4), 1.0, 1.0, 2 * likely + half + 0.01)
    other = Candidate(np.eye(4), 0.5, 1.0, 3.05 * likely - half)
    assert chosen([same, other, first], 2) == [first, other]
    assert len(chosen([same], 3)) == 1


@pytest.mark.parametrize(
    ("rests", "said"),
    [
        ([], "rests: got none"),
        (3, "rests: got 3, allowed a list"),
        ([1.0], r"rests\[0\]: got 1.0, allowed a posture and a pose"),
        ([(np.zeros(31), np.eye(4))], r"rests\[0\]: posture: got .*, allowed 32 angles"),
        ([(np.full(32, np.inf), np.eye(4))], r"rests\[0\]: posture: got inf"),
        ([("me", np.eye(4))], r"rests\[0\]: posture: got 'me'"),
        ([(np.zeros(32), np.zeros((4, 4)))], r"rests\[0\]: pose: got"),
    ],
)
def test_mistakes_are_one_sentence(rests: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        ergoqp.identify(ergoqp.load_problem("desk"), rests)


def test_problems_that_say_not_where_people_rest_are_refused() -> None:
    with pytest.raises(InputError, match="response"):
        ergoqp.identify(ergoqp.load_problem("forearm"), [(np.zeros(32), np.eye(4))])
