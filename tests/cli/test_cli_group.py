"""The command line's places for a group and a population."""

import csv
import json

import pytest
from command_line import mistake


@pytest.mark.slow
def test_one_place_for_a_group(ergoqp, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "optimum.json").touch()
    done = ergoqp(
        "group",
        "desk",
        "--people",
        "1.6,1.9",
        "--starts",
        "1",
        "--load-kg",
        "6",
        "--out",
        tmp_path / "out",
    )
    assert done.status == 0, done.err
    # What another command left in the folder is not this one's.
    assert "optimum.json" not in done.out
    summary = json.loads((tmp_path / "out" / "group.json").read_text(encoding="utf-8"))
    assert [member["label"] for member in summary["members"]] == ["1.60 m", "1.90 m"]
    # 5 to 10 kg are one point in score A.
    assert all("load of 6 kg +1" in " ".join(member["reasons"]) for member in summary["members"])
    for word in ("1.60 m", "alone", "highest", "adjustable", "height", "group.npz", "report.html"):
        assert word in done.out
    assert "One place for 2 people" in (tmp_path / "out" / "report.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.slow
def test_a_population_has_a_row_each(ergoqp, tmp_path):
    done = ergoqp(
        "population", "desk", "--statures", "1.6,1.9", "--starts", "1", "--out", tmp_path / "out"
    )
    assert done.status == 0, done.err
    assert "2 people, 1 start each" in done.err
    with (tmp_path / "out" / "population.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["person"] for row in rows] == ["1.60 m", "1.90 m"]
    assert all(1 <= int(row["reba_best"]) <= int(row["reba_before"]) for row in rows)
    assert "1.60 m" in done.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--people"),
        (
            ("--people", "tall,small"),
            (
                "--people: got 'tall,small', allowed statures in metres with commas between, or how"
                " many"
            ),
        ),
        (("--people", "1.6,9"), "stature: got 9.0 m"),
        (("--people", "0"), "got 0 people"),
        (
            ("--people", "1.7", "--objective", "best"),
            "--objective: got 'best', allowed minimax, mean",
        ),
        (("--people", "1.7", "--load-kg", "1,2"), "--load-kg: got '1,2', allowed"),
        (("--people", "1.7", "--load-kg", "nan"), "load_kg: got nan"),
        (("--people", "1.7", "--hands", "three"), "hands: got 'three', allowed right, left, both"),
        (("--people", "1.7", "--starts", "0"), "starts: got 0, allowed"),
        (("--people", "1.7", "--starts", "101"), "starts: got 101, allowed"),
        (("--people", "1.7", "--jobs", "0"), "jobs: got 0, allowed a whole number of at least 1"),
        (("--people", "1.7", "--seed", "-1"), "seed: got -1, allowed a whole number of at least 0"),
        (("--people", "1.7", "--person", "1.8"), "--person"),
    ],
)
def test_mistakes_of_groups(ergoqp, arguments, words):
    outcome = ergoqp("group", "desk", *arguments)
    assert words in mistake(outcome)
    if words.startswith(("starts", "jobs", "seed")):  # before any work is spoken of
        assert " ..." not in outcome.err


@pytest.mark.parametrize(
    "command",
    [("run", "desk"), ("optimise", "desk"), ("group", "desk", "--people", "2")],
)
def test_a_seed_that_is_too_large_is_told_the_largest(ergoqp, command):
    said = mistake(ergoqp(*command, "--seed", "99999999999999999999"))
    assert "seed: got 99999999999999999999, allowed a whole number from 0 to 922337203685" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--statures"),
        (("--statures", "1.7,x"), "--statures: got '1.7,x', allowed statures in metres"),
        (("--statures", "9"), "stature: got 9.0 m"),
        (("--statures", "1.7", "--loads-kg", "1;2"), "--loads-kg: got '1;2', allowed kilograms"),
        (("--statures", "1.7", "--hands", "both,three"), "hands: got 'three', allowed right"),
        (("--statures", "1.7", "--mode", "selfish"), "mode: got 'selfish', allowed stackelberg"),
        (("--statures", "1.7", "--jobs", "0"), "jobs: got 0, allowed"),
        (("--statures", "1.7", "--objective", "mean"), "--objective"),
    ],
)
def test_mistakes_of_populations(ergoqp, arguments, words):
    assert words in mistake(ergoqp("population", "desk", *arguments))
