"""``ergoqp run --guide``: what it writes, and what it says about mistakes."""

import json

import numpy as np
import pytest
from command_line import mistake

from ergoqp.placing.optimise import optimise
from ergoqp.problem.load import load_problem


@pytest.fixture(scope="module")
def optimum(tmp_path_factory):
    problem = load_problem("desk")
    folder = tmp_path_factory.mktemp("optimum")
    found = optimise(problem, problem.response.comfort, starts=2)
    found.save(folder)
    return found, folder


@pytest.mark.slow
def test_a_run_is_told_the_place(ergoqp, tmp_path, optimum):
    found, folder = optimum
    outcome = ergoqp(
        "run",
        "desk",
        "--duration",
        "1",
        "--guide",
        folder / "optimum.json",
        "--out",
        tmp_path / "out",
    )
    assert outcome.status == 0, outcome.err
    place = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))["guide"]
    np.testing.assert_allclose(place["position_m"], found.pose[:3, 3])
    assert np.linalg.norm(place["quaternion_xyzw"]) == pytest.approx(1)
    assert place["promise"] == pytest.approx(float(load_problem("desk").cost(found.posture)[0]))
    assert "The guide is the place" in " ".join(outcome.out.split())


@pytest.mark.slow
def test_the_best_place_is_looked_for(ergoqp, tmp_path):
    outcome = ergoqp("run", "desk", "--duration", "0.5", "--guide", "best", "--out", tmp_path)
    assert outcome.status == 0, outcome.err
    assert "looking for the best place" in outcome.err
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["guide"]["promise"] < 2


@pytest.mark.slow
def test_mistakes(ergoqp, tmp_path, optimum):
    _, folder = optimum
    remedy = "give best or an optimum.json of `ergoqp optimise`"
    assert f"--guide: 'nowhere.json': no such file; {remedy}" in mistake(
        ergoqp("run", "desk", "--guide", "nowhere.json")
    )
    (tmp_path / "group.json").write_text('{"problem": "desk", "people": 2}', encoding="utf-8")
    told = mistake(ergoqp("run", "desk", "--guide", "group.json"))
    assert f"--guide: 'group.json' cannot be read as an optimum; {remedy}" in told
    assert "guide: got a place of problem 'desk', allowed one of problem screwing" in mistake(
        ergoqp("run", "screwing", "--guide", folder)
    )
    assert not (tmp_path / "ergoqp-out").exists()


@pytest.mark.slow
def test_places_are_tried(ergoqp, tmp_path):
    outcome = ergoqp("run", "desk", "--seek", "--duration", "12", "--out", tmp_path)
    assert outcome.status == 0, outcome.err
    tried = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["tries"]
    assert tried[0]["name"] == "descent"
    assert "places tried" in outcome.out
    assert "Places tried" in (tmp_path / "report.html").read_text(encoding="utf-8")
    told = mistake(ergoqp("run", "desk", "--seek", "--guide", "best"))
    assert "--seek: got it beside --guide, allowed one of the two" in told
