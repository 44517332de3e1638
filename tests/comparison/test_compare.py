"""A small comparison from beginning to end, its figures and its files, read as others would read
them."""

from __future__ import annotations

import importlib.util
import json
import sys
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import ergoqp
from ergoqp.comparison.compare import DEADLINE, Comparison, figures_of, try_solver
from ergoqp.comparison.record import load_sequence, save_sequences
from ergoqp.errors import InputError, MissingExtraError
from ergoqp.solvers.session import QpAnswer, judge


@cache
def small() -> Comparison:
    return ergoqp.compare(
        ergoqp.load_problem("desk"), ["daqp", "qrqp", "highs"], steps=40, derive=6
    )


@pytest.mark.slow
def test_the_exact_solver_is_exact_and_the_figures_say_so() -> None:
    found = small()
    assert list(found.figures) == ["daqp", "qrqp", "highs"]
    daqp = found.figures["daqp"]
    assert daqp["success_1e-3"] == daqp["success_1e-6"] == 1.0
    assert daqp["wrong_flags"] == 0
    assert daqp["infeasible_named"] == 1.0
    assert daqp["qps"] == sum(map(len, found.sequences)) == 40 + 18
    assert daqp["p50_us"] <= daqp["p95_us"] <= daqp["p99_us"] <= daqp["max_us"]
    assert 0 < daqp["warm_ratio"] < 3
    assert daqp["warm_iterations_ratio"] < 1
    assert min(one["sgm_time"] for one in found.figures.values()) == 1.0
    # Who cannot start warm has no such figure.
    assert "warm_ratio" not in found.figures["highs"]


@pytest.mark.slow
def test_figures_count_what_was_said_against_what_is_so() -> None:
    sequence = small().sequences[0].thinned(10)
    trial = try_solver("daqp", sequence, False, 1e-6)
    said = np.array(["solved"] * 6 + ["infeasible", "infeasible", "stopped", "solved"])
    residuals = trial.residuals.copy()
    residuals[9] = (0.0, 1e-4, 0.0, 0.0)
    spoilt = replace(trial, flags=said, residuals=residuals)
    figures = figures_of([spoilt], 1e-6)
    assert figures["wrong_solved"] == 1
    assert figures["wrong_infeasible"] == 2
    assert figures["wrong_flags"] == 3
    assert figures["success_1e-6"] == pytest.approx(0.6)
    assert figures["success_1e-3"] == pytest.approx(0.7)
    assert figures["sgm_us"] > 1e6 * DEADLINE / 100
    without = replace(spoilt, sequence=replace(sequence, feasible=False))
    other = figures_of([trial, without], 1e-6)
    assert other["solved_infeasible"] == other["wrong_flags"] == 7
    assert other["infeasible_named"] == pytest.approx(0.2)


@pytest.mark.slow
def test_what_is_saved_reads_back_and_serves_qpbenchmark(tmp_path: Path) -> None:
    found = small()
    path = found.save(tmp_path / "out")
    kept = json.loads(path.read_text())
    assert kept["problem"] == "desk"
    assert kept["solvers"]["daqp"] == found.figures["daqp"]
    assert (tmp_path / "out" / "compare.png").read_bytes().startswith(b"\x89PNG")
    files = sorted((tmp_path / "out" / "sequences").glob("*.npz"))
    assert {file.stem for file in files} == {one.name for one in found.sequences}
    for file in files:
        back = load_sequence(file)
        given = next(one for one in found.sequences if one.name == back.name)
        assert (back.feasible, back.follows, back.family) == (
            given.feasible,
            given.follows,
            given.family,
        )
        for one, other in zip(back, given, strict=True):
            for name in ("H", "g", "A", "lbA", "ubA", "lb", "ub"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.slow
def test_every_key_and_figure_is_documented() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "compare_json.md").read_text(
        encoding="utf-8"
    )
    found = small()
    keys = {
        *found.as_dict(),
        *found.as_dict()["sequences"][0],
        *(key for one in found.figures.values() for key in one),
    }
    assert [key for key in sorted(keys) if f"`{key}`" not in text] == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_qpbenchmark_and_qpsolvers_solve_what_is_saved(tmp_path: Path) -> None:
    pytest.importorskip("qpbenchmark", reason="qpbenchmark is absent")
    import qpsolvers

    sequences = [
        *small().sequences,
        *ergoqp.compare(ergoqp.load_problem("forearm"), ["daqp"], 5, derive=2).sequences,
    ]
    save_sequences(sequences, tmp_path / "sequences")
    test_set = _module(tmp_path / "ergoqp_sequences.py").ErgoqpSequences()
    problems = list(test_set)
    assert (
        len(problems)
        == test_set.count_problems()
        == sum(len(one) for one in sequences if one.feasible)
    )
    by_name = {f"{one.name}.{i}": qp for one in sequences for i, qp in enumerate(one)}
    equalities = 0
    for problem in problems:
        qp = by_name[problem.name]
        problem.check_constraints()
        solution = qpsolvers.solve_problem(problem, solver="daqp")
        assert solution.is_optimal(1e-6), problem.name
        equalities += problem.A is not None
        ours = try_solver("daqp", replace(sequences[0], qps=(qp,)), False, 1e-6)
        np.testing.assert_allclose(solution.x, ours.points[0], atol=1e-5)
        lam = np.zeros(qp.size[1])
        answer = QpAnswer(solution.x, lam, np.zeros(qp.size[0]), "solved")
        assert judge(qp, answer).primal < 1e-6
    assert equalities == 5 + 2 + 2


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_without_matplotlib_everything_else_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    (tmp_path / "compare.png").write_text("of another comparison")
    with pytest.raises(
        MissingExtraError,
        match=r"picture of a comparison needs the package 'matplotlib'.*\[solvers\]'`",
    ):
        small().save(tmp_path)
    assert (tmp_path / "compare.json").is_file()
    assert not (tmp_path / "compare.png").exists()
    assert len(list((tmp_path / "sequences").glob("*.npz"))) == len(small().sequences)


def test_mistakes_are_named_before_anything_is_recorded(tmp_path: Path) -> None:
    problem = ergoqp.load_problem("desk")
    for options, said in (
        ({"solvers": ["simplex"]}, "solver: got 'simplex', allowed one of daqp"),
        ({"solvers": []}, "solvers: got none"),
        ({"steps": 0}, "steps: got 0, allowed 1 to"),
        ({"seed": -1}, "seed: got -1"),
        ({"accuracy": 0.0}, "accuracy: got 0.0"),
        ({"derive": -1}, "derive: got -1"),
    ):
        with pytest.raises(InputError) as error:
            ergoqp.compare(problem, **options)
        assert said in str(error.value)
    (tmp_path / "not.npz").write_text("nothing")
    with pytest.raises(InputError, match=r"sequence: not\.npz: is no \.npz file"):
        load_sequence(tmp_path / "not.npz")
    with warnings.catch_warnings():
        np.savez(tmp_path / "other.npz", P=np.eye(2))
    with pytest.raises(InputError, match=r"other\.npz: got P, allowed only with"):
        load_sequence(tmp_path / "other.npz")
