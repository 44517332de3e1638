"""``ergoqp compare`` as a user meets it."""

import json
import sys

import pytest
from command_line import mistake


@pytest.mark.slow
def test_compare_prints_the_tables_and_writes_the_files(ergoqp, tmp_path):
    outcome = ergoqp("compare", "dentist", "--solvers", "daqp,qrqp", "--steps", 25, "--seed", 3)
    assert outcome.status == 0, outcome.err
    for said in (
        "the QPs of 25 control steps, seed 3",
        "dentist.3+near_singular",
        "active set",
        "infeasible named",
        "warm / cold",
    ):
        assert said in outcome.out
    folder = tmp_path / "ergoqp-out" / "compare-dentist"
    assert sorted(file.name for file in folder.iterdir()) == [
        "compare.json",
        "compare.png",
        "ergoqp_sequences.py",
        "sequences",
    ]
    kept = json.loads((folder / "compare.json").read_text())
    assert set(kept["solvers"]) == {"daqp", "qrqp"}
    assert kept["steps"] == 25


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("compare", "desk", "--solvers", "simplex"),
            "solver: got 'simplex', allowed one of daqp, quadprog",
        ),
        (("compare", "desk", "--solvers", ","), "solvers: got none"),
        (("compare", "desk", "--steps", "0"), "steps: got 0"),
        (("compare", "desk", "--accuracy", "2"), "accuracy: got 2.0"),
        (("compare", "nowhere"), "problem: got 'nowhere'"),
    ],
)
def test_mistakes_give_one_sentence_and_leave_nothing(ergoqp, tmp_path, arguments, said):
    assert said in mistake(ergoqp(*arguments))
    assert not list(tmp_path.iterdir())


def test_a_solver_that_is_not_installed_names_its_extra(ergoqp, monkeypatch):
    monkeypatch.setitem(sys.modules, "piqp", None)
    assert "solver 'piqp' needs the package 'piqp'" in mistake(
        ergoqp("compare", "desk", "--solvers", "daqp,piqp")
    )
