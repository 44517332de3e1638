"""When the person is at rest: means over windows, steady or long enough, with joints unseen."""

from __future__ import annotations

import numpy as np

from ergoqp.identification.loops import LONGEST, Resting, RestWatch

DT = 0.01


def watched(postures: np.ndarray, still: np.ndarray | None = None) -> list[tuple[int, Resting]]:
    watch, found = RestWatch(), []
    still = np.ones(len(postures), dtype=bool) if still is None else still
    for i, posture in enumerate(postures):
        rest = watch.add((i + 1) * DT, DT, bool(still[i]), posture, np.eye(4))
        if rest is not None:
            found.append((i, rest))
    return found


def test_a_steady_person_is_at_rest_after_two_windows_and_the_mean_is_of_the_last() -> None:
    noise = np.radians(2) * np.random.default_rng(0).standard_normal((250, 32))
    (at, rest), *_ = watched(0.3 + noise)
    assert at == 199
    np.testing.assert_allclose(rest.posture, 0.3 + noise[100:200].mean(axis=0))


def test_one_who_still_moves_is_waited_for_but_not_for_ever() -> None:
    moving = np.linspace(0, 10 * np.radians(20), 1000)[:, None] * np.ones(32)
    (at, _), *_ = watched(moving)
    assert at == round(LONGEST / DT) - 1
    comes = np.radians(30) * np.exp(-np.arange(600) * DT / 0.5)[:, None] * np.ones(32)
    (at, rest), *_ = watched(comes)
    assert 200 < at < 400
    assert np.abs(rest.posture).max() < np.radians(2)


def test_it_begins_anew_when_the_object_moves() -> None:
    still = np.ones(400, dtype=bool)
    still[150] = False
    (at, _), *_ = watched(np.zeros((400, 32)), still)
    assert at == 350


def test_what_is_not_seen_is_not_in_the_mean() -> None:
    postures = np.full((200, 32), 0.5)
    postures[::2, 3] = np.nan
    postures[:, 4] = np.nan
    (_, rest), *_ = watched(postures)
    assert rest.posture[3] == 0.5
    assert np.isnan(rest.posture[4])
    lost = watched(np.full((600, 32), np.nan))
    assert len(lost) == 1
    assert np.isnan(lost[0][1].posture).all()
