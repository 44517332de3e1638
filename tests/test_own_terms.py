"""Terms of a user's own: one example wheel with all five, installed and used."""

import importlib
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError, ProblemError, RecordingError
from ergoqp.human import Body
from ergoqp.limits import AxisCone
from ergoqp.mocap.demo_recording import demo_recording
from ergoqp.mocap.load import load_recording
from ergoqp.mocap.readers import read_motion
from ergoqp.problem import schema as own_terms
from ergoqp.problem.load import load_problem, problem_from_dict
from ergoqp.registry import GROUPS, registered
from ergoqp.responses import IkResponse
from ergoqp.simulation.robot import moved

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "own_terms"
PROBLEM = """
title = "with terms of our own"

[response.stiff_trunk]
stature = 1.8
stiffness = 20.0

[cost.low_arms]
weight = 4.0

[limits.ceiling]
height = 1.25
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder in which the example's wheel is installed."""
    pytest.importorskip("hatchling")
    out = tmp_path_factory.mktemp("own")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
    subprocess.run(build, cwd=EXAMPLE, check=True, capture_output=True)
    folder, wheel = out / "site", next(out.glob("*.whl"))
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*install, "--target", str(folder), str(wheel)], check=True)
    return folder


@pytest.fixture
def on_path(site, monkeypatch):
    """That folder on the path, for this test alone."""
    monkeypatch.syspath_prepend(str(site))
    importlib.invalidate_caches()
    yield
    for name in [name for name in sys.modules if name.split(".")[0] == "own_terms"]:
        del sys.modules[name]


@pytest.fixture
def problem(on_path, tmp_path):
    (tmp_path / "ours.toml").write_text(PROBLEM)
    return load_problem(tmp_path / "ours.toml")


def test_they_are_known_and_nothing_is_imported(on_path):
    assert registered("limit") == ("ceiling",)
    assert registered("solver") == ("qrqp_twice",)
    load_problem("screwing")
    assert "own_terms" not in sys.modules


def test_a_problem_file_names_limit_cost_and_response(problem):
    assert problem.cost.weight == 4.0
    assert [limit.height for limit in problem.limits if hasattr(limit, "height")] == [1.25]
    assert "ceiling" in problem.row_names
    plain = load_problem("screwing").response
    trunk = problem.coordinates.index("trunk_flexion")
    assert problem.response.weight_vector[trunk] == 20.0 > plain.weight_vector[trunk]


@pytest.mark.slow
def test_the_loop_keeps_the_limit_with_the_own_solver(problem):
    q = (
        np.asarray(problem.response.comfort)
        + np.radians(20) * np.eye(32)[problem.coordinates.index("right_shoulder_flexion")]
    )
    twists = {}
    for solver in ("daqp", "qrqp_twice"):
        stepper = ergoqp.Stepper(problem, solver=solver)
        pose = np.array(problem.response.contact()(q)[0])
        pose[2, 3] = 1.2
        steps = []
        for _ in range(60):
            steps.append(stepper.step(q, pose))
            pose = moved(pose, steps[-1].twist * stepper.dt)
        assert pose[2, 3] <= 1.25
        assert {step.status for step in steps} <= {"optimal", "settled", "relaxed"}
        twists[solver] = steps[-1].twist
    np.testing.assert_allclose(twists["qrqp_twice"], twists["daqp"], atol=1e-5)


def test_a_recording_is_read_by_the_own_reader(on_path, tmp_path):
    demo_recording(tmp_path / "demo.bvh")
    from ergoqp.mocap.formats.bvh import read_bvh

    motion = read_bvh(tmp_path / "demo.bvh")
    head = " ".join(["time", *(f"{name}.{axis}" for name in motion.names for axis in "xyz")])
    rows = np.column_stack([motion.time, motion.positions.reshape(len(motion.time), -1)])[:5]
    lines = [" ".join(map(repr, row)) for row in rows.tolist()]
    (tmp_path / "demo.centres").write_text("\n".join([head, *lines]))
    recording = load_recording(tmp_path / "demo.centres")
    assert recording.postures.shape == (5, 32)
    (tmp_path / "bad.centres").write_text(head + "\n1 2 x\n")
    with pytest.raises(RecordingError, match=r"bad\.centres: got could not convert"):
        load_recording(tmp_path / "bad.centres")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", r"got the first line '', allowed time name\.x"),
        (b"\xff\xfe\x00", r"got byte 0, which is not UTF-8, allowed a text"),
        (b"time", r"got the first line 'time', allowed"),
        (b"time a.x a.y\n1 2 3\n", r"got the first line 'time a\.x a\.y', allowed"),
        (b"time a.x a.y a.z\n", r"got 0 frames that do not fit the first line, allowed at least"),
        (b"time a.x a.y a.z\n1 2\n", r"got 1 frames that do not fit .* each of 4 numbers"),
        (b"time a.x a.y a.z\n1 2 3 4\n1 2\n", r"got setting an array element"),
        (None, "cannot be read: No such file"),
    ],
)
def test_the_own_reader_refuses_what_is_no_such_file(on_path, tmp_path, content, sentence):
    if content is not None:
        (tmp_path / "bad.centres").write_bytes(content)
    with pytest.raises(RecordingError, match=rf"^bad\.centres: {sentence}"):
        load_recording(tmp_path / "bad.centres")


BONE = "time,x,y,z,q0,q1,q2,q3\n0,1,2,3,1,0,0,0\n1,1.5,2,3,0.8,0,0,0.6\n"


def test_a_folder_is_read_by_an_own_reader(on_path, tmp_path):
    folder = tmp_path / "small.poses"
    folder.mkdir()
    (folder / "hand.csv").write_text(BONE)
    (folder / "take.toml").write_text('rate = 50\norder = "wxyz"\n')
    motion = read_motion(folder)
    assert motion.names == ("hand",)
    assert motion.positions.tolist() == [[[1, 2, 3]], [[1.5, 2, 3]]]
    assert motion.turns["hand"] == pytest.approx(np.array([[0, 0, 0, 1], [0, 0, 0.6, 0.8]]))
    assert motion.time.tolist() == [0, 0.02]
    for content, words in (
        (BONE + "1,2\n", "got setting an array element .*, allowed numbers below the names"),
        ("a,b\n1,2\n", "got 'x' is not in list, allowed numbers below"),
        ("", "got not enough values"),
    ):
        (folder / "hand.csv").write_text(content)
        with pytest.raises(RecordingError, match=rf"^small\.poses/hand\.csv: {words}"):
            read_motion(folder)
    (folder / "hand.csv").unlink()
    with pytest.raises(RecordingError, match=r"^small\.poses: got 0 tables, allowed one per bone"):
        read_motion(folder)
    (folder / "take.toml").write_text("rate = 0\n")
    with pytest.raises(RecordingError, match=r"take\.toml: got order '' and rate 0, allowed an"):
        read_motion(folder)


def test_the_bones_of_a_handover_are_a_posture(on_path, shared, tmp_path):
    """The same take, once as a table per bone and once as a take of Motive."""
    folder = tmp_path / "giver.poses"
    folder.mkdir()
    for path in (shared / "mocap" / "kth_handover_giver").glob("giver_*.csv"):
        name = path.name.removeprefix("giver_").removesuffix("_pose_saved.csv")
        shutil.copy(path, folder / f"{name}.csv")
    (folder / "take.toml").write_text('rate = 120\norder = "xyzw"\n')
    told = read_motion(folder)
    take = read_motion(shared / "mocap" / "motive" / "derived_motive_skeleton_giver.csv")
    for name in told.names:
        same = f"Giver:{name}"
        np.testing.assert_allclose(told.of(name), take.of(same), atol=2e-6)
        np.testing.assert_allclose(told.turns[name], take.turns[same], atol=2e-6)


def test_mistakes_in_their_tables_are_sentences(on_path):
    base = {"response": {"ik": {}}}
    with pytest.raises(ProblemError, match=r"limits\.ceiling\.height: got nothing, required"):
        problem_from_dict({**base, "limits": {"ceiling": {}}}, "p")
    with pytest.raises(
        ProblemError, match=r"limits\.ceiling\.height: got 'high', allowed a number"
    ):
        problem_from_dict({**base, "limits": {"ceiling": {"height": "high"}}}, "p")
    with pytest.raises(ProblemError, match=r"limits\.cieling: got a key that is not known"):
        problem_from_dict({**base, "limits": {"cieling": {"height": 1.0}}}, "p")
    with pytest.raises(ProblemError, match="only one of"):
        problem_from_dict({**base, "cost": {"low_arms": {}, "smooth_reba": {}}}, "p")


def seated(stature: float = 1.7) -> IkResponse:
    """A response of one's own that sits."""
    return IkResponse(body=Body.of_stature(stature), stance="seated")


@dataclass(frozen=True)
class Listed(AxisCone):
    """A limit with a key whose default is made anew."""

    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    half_angle_deg: float = 40.0
    others: tuple[float, ...] = field(default_factory=tuple)


def takes_anything(height: float, **others: float) -> AxisCone:
    return AxisCone((0, 0, height), **others)


def test_whoever_sits_by_an_own_response_is_scored_as_one_who_sits(monkeypatch):
    registers(monkeypatch, "response", {"seated": seated})
    assert problem_from_dict({"response": {"seated": {}}}, "p").task["seated"] is True


def test_own_defaults_are_made_by_the_term_itself(monkeypatch):
    registers(monkeypatch, "limit", {"listed": Listed})
    raw = {"response": {"ik": {}}, "limits": {"listed": {"half_angle_deg": 30.0}}}
    assert problem_from_dict(raw, "p").limits[-1] == Listed(half_angle_deg=30.0)


def test_a_term_whose_keys_nobody_knows_is_refused(monkeypatch):
    registers(monkeypatch, "limit", {"any": takes_anything})
    raw = {"response": {"ik": {}}, "limits": {"any": {"height": 1.2}}}
    with pytest.raises(
        ProblemError, match=r"any: got the parameter \*\*others.*, allowed only ones"
    ):
        problem_from_dict(raw, "p")


def registers(monkeypatch, kind, terms):
    """Register terms of a kind without a package."""
    names = {what: tuple(terms) if what == kind else () for what in GROUPS}
    monkeypatch.setattr(own_terms, "registered", names.__getitem__)
    monkeypatch.setattr(own_terms, "own_term", lambda _, name: terms[name])


def test_a_term_that_cannot_be_imported_is_a_sentence(on_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "own_terms.ceiling", None)
    raw = {"response": {"ik": {}}, "limits": {"ceiling": {"height": 1.0}}}
    with pytest.raises(ProblemError, match=r"limit ceiling: got ModuleNotFoundError .* from own_t"):
        problem_from_dict(raw, "p")
    with pytest.raises(InputError, match=r"solver: got .nonsense., allowed .*qrqp_twice"):
        ergoqp.Stepper(load_problem("screwing"), solver="nonsense")
