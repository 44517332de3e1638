"""``ergoqp optimise`` as a user meets it."""

import json

import pytest
from command_line import mistake

from ergoqp.placing.optimum import Optimum


@pytest.mark.slow
def test_table_and_file(ergoqp, tmp_path):
    outcome = ergoqp("optimise", "dentist", "--starts", 3, "--seed", 2, "--out", "results")
    assert outcome.status == 0, outcome.err
    for words in (
        "now",
        "the person comes to rest",
        "the posture chosen too",
        "REBA",
        "optimality residual",
        "of 3",
    ):
        assert words in outcome.out
    found = Optimum.load(tmp_path / "results")
    assert f"{found.reba_before}, " in outcome.out
    assert found.reba_after < found.reba_before
    values = json.loads((tmp_path / "results" / "optimum.json").read_text(encoding="utf-8"))
    assert values["mode"] == "stackelberg"
    assert len(values["trials"]) == 3


@pytest.mark.slow
def test_from_a_recording(ergoqp, demo, tmp_path):
    outcome = ergoqp(
        "optimise", "screwing", "--from", demo, "--at", 1.0, "--starts", 1, "--out", "results"
    )
    assert outcome.status == 0, outcome.err
    found = Optimum.load(tmp_path / "results")
    assert any(demo.name in sentence for sentence in found.assumptions)
    assert found.response.body.lengths["upper_arm"] != pytest.approx(0.186 * 1.75, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("forearm",), "problem forearm: moves elbow_x"),
        (("dentist", "--solver", "snopt"), "solver: got 'snopt', allowed ipopt, fatrop, sqpmethod"),
        (("dentist", "--mode", "selfish"), "mode: got 'selfish', allowed stackelberg, cooperative"),
        (("dentist", "--starts", "0"), "starts: got 0, allowed a whole number of at least 1"),
        (("dentist", "--at", "3"), "--at: got 3 s, but there is no recording"),
        (
            ("nothing",),
            (
                "'nothing', allowed dentist, desk, low_bin, overhead, screwing, screwing_learned or"
                " the path of a .toml"
            ),
        ),
        (("desk", "--group", "1.7"), "see `ergoqp optimise --help`"),
    ],
)
def test_mistakes(ergoqp, arguments, words):
    assert words in mistake(ergoqp("optimise", *arguments))


def own_problem(lower, upper, direction):
    limits = f"[limits.workspace]\nlower = {lower}\nupper = {upper}\n"
    return (
        f'[response.ik]\nstance = "seated"\n{limits}[limits.tool_axis]\ndirection ='
        f" {direction}\nhalf_angle_deg = 20\n"
    )


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (
            ([2, 2, 2], [3, 3, 3], [1, 0, 0]),
            "none of 40 places of the workspace can be a start (40 out of reach)",
        ),
        (([1.0, 0, 0], [0.5, 1, 1], [1, 0, 0]), "allowed lower <= upper"),
        (([0, 0, 0], [1, 1, 1], [0, 0, 0]), "allowed any vector from 1e-9"),
    ],
)
def test_limits_that_leave_no_place(ergoqp, tmp_path, limits, words):
    (tmp_path / "own.toml").write_text(own_problem(*limits), encoding="utf-8")
    assert words in mistake(ergoqp("optimise", "own.toml", "--starts", 2))
