"""``ergoqp fit`` as a user meets it."""

import numpy as np
import pytest
from command_line import mistake
from step_samples import near_comfort

import ergoqp as package
from ergoqp.coordinates import SCORED_JOINTS
from ergoqp.datasets.postures import posture_data
from ergoqp.learning.one_class import load_one_class
from ergoqp.mocap.demo_recording import demo_recording
from ergoqp.responses.gmr import GmrResponse


def test_fit_writes_a_model_that_works_and_a_picture(ergoqp, tmp_path):
    outcome = ergoqp("fit", "quadratic", "--per-score", 30, "--folds", 3, "--seed", 2)
    assert outcome.status == 0, outcome.err
    assert "300 points of 20 coordinates" in outcome.out
    assert "unseen points" in outcome.out
    folder = tmp_path / "ergoqp-out" / "fit-quadratic"
    assert (folder / "quadratic.png").read_bytes().startswith(b"\x89PNG")
    cost = package.load_cost(folder / "quadratic.npz")
    data = posture_data(30, seed=2)
    states = cost.coordinates.spread(data.points[:5])
    assert cost(states) == pytest.approx(
        [float(cost.function(state)) for state in states], abs=1e-10
    )


def test_fit_to_a_table_of_ones_own(ergoqp, tmp_path):
    rng = np.random.default_rng(0)
    rows = [f"{angle:.2f},{1 + abs(angle) / 20:.3f}" for angle in rng.uniform(-30, 60, 60)]
    (tmp_path / "mine.csv").write_text("trunk_flexion_deg,score\n" + "\n".join(rows) + "\n")
    outcome = ergoqp("fit", "svr", "--data", "mine.csv", "--set", "C=5.0", "--out", "here")
    assert outcome.status == 0, outcome.err
    assert "60 points of 1 coordinates: mine.csv" in outcome.out
    assert (tmp_path / "here" / "svr.npz").is_file()


def test_fit_a_boundary(ergoqp, tmp_path):
    outcome = ergoqp(
        "fit", "boundary", "--joints", "scored", "--per-score", 40, "--folds", 2, "--set", "nu=0.05"
    )
    assert outcome.status == 0, outcome.err
    assert "400 points of 22 coordinates" in outcome.out
    model = load_one_class(tmp_path / "ergoqp-out" / "fit-boundary" / "boundary.npz")
    assert 0.9 < (model.margin(posture_data(40, joints=SCORED_JOINTS).points) >= 0).mean() < 1.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("fit", "forest"), "cost: got 'forest', allowed quadratic, gmr"),
        (
            ("fit", "svr", "--data", "mocap"),
            "--data: got 'mocap', allowed sheet, interval, forearm",
        ),
        (("fit", "svr", "--data", "absent.csv"), "absent.csv: cannot be read"),
        (("fit", "quadratic", "--per-score", "0"), "--per-score: got 0"),
        (("fit", "quadratic", "--per-score", "3", "--folds", "1"), "--folds: got 1"),
        (("fit", "svr", "--set", "D=3"), "--set: got 'D=3', allowed NAME=VALUE with a name of"),
        (
            ("fit", "svr", "--data", "interval", "--joints", "scored"),
            "--joints: got 'scored' with the data 'interval'",
        ),
        (("fit", "boundary", "--set", "nu=2", "--per-score", "9"), "nu"),
        (("fit", "svr", "--set", "C"), "--set: got 'C'"),
        (
            ("fit", "svr", "--seed", "-1"),
            "--seed: got -1, allowed a whole number from 0 to 4294967295",
        ),
        (
            ("fit", "svr", "--per-score", "9", "--set", "C=abc"),
            "svr C: got 'abc', allowed a number from 1e-09 to 1e+09",
        ),
        (
            ("fit", "svr", "--per-score", "9", "--set", "epsilon="),
            "svr epsilon: got '', allowed a number from 0 to 1e+09",
        ),
        (
            ("fit", "svr", "--per-score", "9", "--set", "widths=3"),
            "svr widths: got 3, allowed a list of numbers",
        ),
        (
            ("fit", "svr", "--per-score", "9", "--set", "shares=[1, 2]"),
            "svr shares: got 2, allowed 0 to 1",
        ),
        (
            ("fit", "svr", "--per-score", "9", "--set", "seed=-3"),
            "svr seed: got -3, allowed a whole number from 0",
        ),
        (
            ("fit", "svr", "--per-score", "9", "--set", "max_vectors=2.5"),
            "svr max_vectors: got 2.5, allowed a whole number",
        ),
        (
            ("fit", "gmr", "--per-score", "9", "--set", "seed=-3"),
            "seed: got -3, allowed a whole number from 0",
        ),
        (
            ("fit", "gmr", "--per-score", "9", "--set", "regularisation=a"),
            "regularisation: got 'a', allowed a number from 1e-12 to",
        ),
        (
            ("fit", "neural", "--per-score", "9", "--set", "steps=True"),
            "neural steps: got True, allowed a whole number",
        ),
        (
            ("fit", "neural", "--per-score", "9", "--set", "rate=nan"),
            "neural rate: got 'nan', allowed a number from 1e-09 to 1000",
        ),
        (
            ("fit", "one_class_ladder", "--per-score", "9", "--set", "nu=a"),
            "one_class_ladder nu: got 'a', allowed a number from 1e-06",
        ),
        (
            ("fit", "one_class_ladder", "--per-score", "9", "--set", "pull=1"),
            "one_class_ladder pull: got 1, allowed 0 to",
        ),
        (
            ("fit", "quadratic", "--per-score", "100000000000"),
            "--per-score: got 100000000000, allowed a whole number from 1",
        ),
        (("fit", "quadratic", "--out", ""), "got an empty text, allowed a folder"),
        (("fit", "gmr", "--per-score", "2", "--folds", "2", "--set", "components=50"), "50"),
    ],
)
def test_mistakes_give_one_sentence_and_leave_nothing(ergoqp, tmp_path, arguments, said):
    assert said in mistake(ergoqp(*arguments))
    assert not list(tmp_path.rglob("*.npz*"))


def test_fit_a_response_to_a_recording_and_to_a_run(ergoqp, tmp_path):
    demo_recording(tmp_path / "demo.bvh")
    quick = ("--per-score", 30, "--set", "components=2")
    outcome = ergoqp("fit", "response", "demo.bvh", "--by-hand", "--kind", "gmr", *quick)
    assert outcome.status == 0, outcome.err
    assert "always the mean posture" in outcome.out
    path = tmp_path / "ergoqp-out" / "fit-response" / "response.npz"
    model = GmrResponse.load(path)
    assert len(model.mixture.weights) == 2
    (tmp_path / "own.toml").write_text(f'[response.gmr]\nmodel = "{path}"\n')
    assert package.load_problem(tmp_path / "own.toml").response.joints == model.joints

    problem = package.load_problem("screwing")
    run = package.simulate(
        problem, near_comfort("screwing", np.random.default_rng(5), 20), duration=3
    )
    run.save(tmp_path / "run")
    outcome = ergoqp("fit", "response", "run", "--out", "here", *quick)
    assert outcome.status == 0, outcome.err
    assert "2 Gaussians" in outcome.out
    brief = ergoqp("fit", "response", "demo.bvh", "--by-hand", "--window", "0:1.2", *quick[:2])
    assert brief.status == 0, brief.err
    assert "Too little is left without the last of 5 parts: postures: got 2" in brief.out
    assert "37 of 37 frames" in brief.out
    assert "assumed" in brief.out
    assert GmrResponse.load(tmp_path / "here" / "response.npz").person.body == run.body


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "recording: got none, allowed a recording or the folder of a run"),
        (
            ("absent.bvh",),
            "recording: got absent.bvh: no such file, allowed a recording or the folder",
        ),
        (("demo.bvh",), "recording: has no held object; name one with --thing, or let the hand"),
        ((".",), "recording: got the folder ., allowed one that a run was saved in"),
        (("demo.bvh", "--problem", "forearm"), "problem forearm: moves elbow_x"),
        (("demo.bvh", "--by-hand", "--set", "components=900"), "postures: got"),
        (("demo.bvh", "--by-hand", "--set", "components=[]"), "components: got None, allowed"),
        (("demo.bvh", "--by-hand", "--set", "seed=-3"), "seed: got -3"),
        (("demo.bvh", "--by-hand", "--data", "forearm"), "--data: got 'forearm', allowed postures"),
        (("demo.bvh", "--by-hand", "--window", "0:0.01"), "frames, allowed some for each Gaussian"),
        (("demo.bvh", "--set", "person=1"), "--set: got 'person=1', allowed NAME=VALUE"),
    ],
)
def test_mistakes_of_a_response_in_one_sentence(ergoqp, tmp_path, arguments, said):
    demo_recording(tmp_path / "demo.bvh")
    assert said in mistake(ergoqp("fit", "response", *arguments, "--per-score", 30))


@pytest.mark.parametrize("more", [("take.bvh",), ("--by-hand",), ("--rate", "30")])
def test_a_cost_takes_no_recording(ergoqp, more):
    said = mistake(ergoqp("fit", "quadratic", *more))
    assert "cost: got 'quadratic' and a recording or how to read it, allowed 'response'" in said
