"""Names of own terms that are taken: by the package itself, or by two packages at once."""

import importlib
from pathlib import Path

import pytest

import ergoqp
from ergoqp.errors import InputError, ProblemError, RecordingError
from ergoqp.mocap.load import load_recording
from ergoqp.problem.load import problem_from_dict
from ergoqp.registry import GROUPS
from ergoqp.simulation.people import kinds
from ergoqp.solvers import solver_named


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Return a function that installs a distribution that registers one name."""

    def install(distribution: str, kind: str, name: str, value: str) -> None:
        information = tmp_path / "site" / f"{distribution}-1.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text(f"Name: {distribution}\nVersion: 1\n")
        (information / "entry_points.txt").write_text(f"[{GROUPS[kind]}]\n{name} = {value}\n")
        monkeypatch.syspath_prepend(str(tmp_path / "site"))
        importlib.invalidate_caches()

    return install


@pytest.mark.parametrize(
    ("kind", "name", "tables"),
    [
        ("limit", "workspace", {"limits": {"workspace": {"lower": [0, 0, 0], "upper": [1, 1, 1]}}}),
        ("cost", "learned", {"cost": {"learned": {"model": "svr"}}}),
        ("response", "ik", {}),
    ],
)
def test_a_table_that_a_package_registers_too_is_refused(installed, kind, name, tables):
    installed("theirs", kind, name, "json:loads")
    raw = {"response": {"ik": {}}, **tables}
    words = rf"{kind} {name}: got an entry point of theirs, allowed any name but one of ergoqp's"
    with pytest.raises(ProblemError, match=words):
        problem_from_dict(raw, "p")


def test_a_name_that_nobody_uses_does_no_harm(installed):
    installed("theirs", "limit", "workspace", "json:loads")
    assert problem_from_dict({"response": {"ik": {}}}, "p").name == "p"


def test_a_solver_that_a_package_registers_too_is_refused(installed):
    installed("theirs", "solver", "highs", "json:loads")
    with pytest.raises(InputError, match=r"solver highs: got an entry point of theirs, allowed"):
        solver_named("highs")
    assert solver_named("daqp").name == "daqp"


def test_a_solver_of_qpsolvers_that_a_package_registers_too_is_refused(installed, monkeypatch):
    qpsolvers = pytest.importorskip("qpsolvers")
    monkeypatch.setattr(qpsolvers, "available_solvers", ["fine"])
    installed("theirs", "solver", "fine", "json:loads")
    with pytest.raises(InputError, match=r"solver fine: got an entry point of theirs, allowed"):
        solver_named("fine")


def test_a_reader_of_a_known_ending_is_refused(installed, tmp_path):
    installed("theirs", "reader", "BVH", "json:loads")
    (tmp_path / "take.bvh").write_text("HIERARCHY")
    with pytest.raises(InputError, match=r"reader bvh: got an entry point of theirs, allowed"):
        load_recording(tmp_path / "take.bvh")


def test_two_packages_of_one_name_are_refused_whatever_the_order(installed):
    installed("ours", "limit", "ceiling", "json:loads")
    installed("theirs", "limit", "ceiling", "json:dumps")
    raw = {"response": {"ik": {}}, "limits": {"ceiling": {"height": 1.0}}}
    words = r"limit ceiling: got entry points of ours, theirs, allowed one package with that name"
    with pytest.raises(ProblemError, match=words):
        problem_from_dict(raw, "p")


def test_an_ending_has_no_case(installed, tmp_path):
    installed("ours", "reader", "CenTres", "no_such_module:read")
    (tmp_path / "take.centres").touch()
    with pytest.raises(InputError, match=r"reader centres: got ModuleNotFoundError"):
        load_recording(tmp_path / "take.centres")
    (tmp_path / "take.other").touch()
    with pytest.raises(RecordingError, match=r"allowed \.bvh, .*\.centres"):
        load_recording(tmp_path / "take.other")
    installed("theirs", "reader", "centres", "json:loads")
    with pytest.raises(InputError, match=r"reader centres: got entry points of ours, theirs"):
        load_recording(tmp_path / "take.centres")


@pytest.mark.slow
def test_terms_of_other_names_leave_the_step_alone(installed):
    installed("theirs", "solver", "highs", "json:loads")
    assert ergoqp.Stepper(ergoqp.load_problem("screwing")).dt > 0


def test_people_like_the_model_that_a_package_registers_too_are_refused(installed):
    installed("theirs", "person", "alike", "json:loads")
    with pytest.raises(InputError, match=r"person alike: got an entry point of theirs, allowed"):
        kinds()


def test_people_who_are_registered_later_are_known(installed):
    installed("theirs", "person", "newcomer", "json:loads")
    assert "newcomer" in kinds()
