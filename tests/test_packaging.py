"""What is installed is all that is needed: the wheel away from the checkout, the source
distribution, the public names."""

import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

import ergoqp

ROOT = Path(__file__).resolve().parents[1]


def call(*command, cwd, **environment):
    clean = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env={**clean, **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """The wheel and the source distribution, built without a network."""
    pytest.importorskip("hatchling")
    out = tmp_path_factory.mktemp("dist")
    call(
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "-t",
        "sdist",
        "-t",
        "wheel",
        "-d",
        out,
        cwd=ROOT,
    )
    return next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


@pytest.fixture(scope="module")
def installed(distributions, tmp_path_factory):
    """The Python of an environment that holds the wheel, and sees this one's dependencies but not
    the checkout."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    packages = Path(
        call(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder
        ).strip()
    )
    call(
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--no-deps",
        "--no-index",
        distributions[0],
        cwd=folder,
    )
    # Later on the path than the wheel, and only the folder itself: its .pth files, the editable
    # install's too, do not count.
    for place in {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}:
        with (packages / "dependencies.pth").open("a", encoding="utf-8") as file:
            file.write(f"{place}\n")
    return python


def test_wheel_holds_the_data(distributions):
    names = zipfile.ZipFile(distributions[0]).namelist()
    for kind in ("models", "problems"):
        for path in (ROOT / kind).iterdir():
            assert f"ergoqp/{kind}/{path.name}" in names
    for path in (ROOT / "ergoqp").rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            assert str(path.relative_to(ROOT)) in names
    assert not [name for name in names if name.startswith(("tests", "benchmarks", "examples"))]
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_source_distribution_holds_everything(distributions):
    with tarfile.open(distributions[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    kinds = ("ergoqp", "models", "problems", "examples", "docs", "tests", "benchmarks", "tools")
    for kind in kinds:
        for path in (ROOT / kind).rglob("*"):
            # The pages of the reference are made when the site is built.
            made = "__pycache__" in path.parts or path.parent == ROOT / "docs" / "reference"
            if path.is_file() and not made:
                assert str(path.relative_to(ROOT)) in names
    assert {
        "README.md",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "LICENSE",
        "CITATION.cff",
        "Makefile",
        "pyproject.toml",
    } <= names


def test_wheel_works_elsewhere(installed, tmp_path):
    code = (
        "import ergoqp; from pathlib import Path; from ergoqp.human import Body\n"
        "from ergoqp.registry import data_folder\nassert data_folder('models').parent =="
        " Path(ergoqp.__file__).parent\nprint(ergoqp.__file__,"
        " ergoqp.load_problem('screwing').name, Body().model.nq)"
    )
    place, name, size = call(installed, "-W", "error", "-c", code, cwd=tmp_path).split()
    assert not Path(place).is_relative_to(ROOT)
    assert (name, size) == ("screwing", "36")


@pytest.mark.slow
def test_command_of_the_wheel(installed, tmp_path):
    command = installed.parent / "ergoqp"
    assert call(command, "--version", cwd=tmp_path) == f"ergoqp {ergoqp.__version__}\n"
    assert "PROBLEM" in call(command, "run", "--help", cwd=tmp_path)
    call(command, "run", "desk", "--duration", "0.2", cwd=tmp_path)
    assert (tmp_path / "ergoqp-out" / "desk" / "run.json").is_file()


def test_public_names():
    assert set(ergoqp.__all__) == {
        "JOINTS",
        "Client",
        "Control",
        "Problem",
        "Step",
        "Seeker",
        "Stepper",
        "__version__",
        "compare",
        "errors",
        "identify",
        "load_cost",
        "load_problem",
        "load_recording",
        "fit_postures",
        "formulate",
        "reba",
        "replay",
        "DeclaredRobot",
        "Formulation",
        "Formulator",
        "Frames",
        "benchmark_step",
        "calibrate_frames",
        "initial_state",
        "optimise",
        "simulate",
        "step_function",
    }
    for name in ergoqp.__all__:
        assert getattr(ergoqp, name) is not None
        assert name in dir(ergoqp)
    for folder in ("limits", "placing", "step"):
        assert getattr(ergoqp, folder).__name__ == f"ergoqp.{folder}"
        assert folder in dir(ergoqp)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        ergoqp.nonsense  # noqa: B018


def test_every_folder_is_a_package_and_reachable():
    package = ROOT / "ergoqp"
    folders = {path.parent for path in package.rglob("*.py")}
    assert [str(each) for each in folders if not (each / "__init__.py").is_file()] == []
    for folder in sorted(each.name for each in folders if each.parent == package):
        if folder == "whole_body":
            pytest.importorskip("mink")
        assert getattr(ergoqp, folder).__name__ == f"ergoqp.{folder}"


def test_help_needs_no_extra():
    """What is listed is imported by `help`: what needs a package that is missing is not listed."""
    code = (
        "import sys; sys.modules['mink'] = None\n"
        "import inspect, pydoc, ergoqp\n"
        "names = dict(inspect.getmembers(ergoqp))\n"
        "print('limits' in names, 'whole_body' in names, len(pydoc.render_doc(ergoqp)) > 1000)\n"
        "try: ergoqp.whole_body\n"
        "except ergoqp.errors.MissingExtraError as error: print('whole-body' in str(error))\n"
    )
    assert call(sys.executable, "-c", code, cwd=ROOT) == "True False True\nTrue\n"


def test_import_is_light():
    heavy = ("casadi", "mujoco", "pydantic", "typer", "viser")
    code = f"import sys, ergoqp; print([name for name in {heavy} if name in sys.modules])"
    assert call(sys.executable, "-W", "error", "-c", code, cwd=ROOT) == "[]\n"


def test_version_is_said_once():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == ergoqp.__version__
    assert f"## [{ergoqp.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_readme_names_what_is_there():
    """Links lead somewhere."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)]+)\)", text):
        assert (ROOT / target).exists(), target
    assert len(text.splitlines()) <= 130


def test_the_site_names_what_is_there():
    """Benchmarks that are named exist, and problems that exist are named."""
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    for name in re.findall(r"(?:python -m |`)benchmarks\.(\w+)", text):
        assert (ROOT / "benchmarks" / f"{name}.py").is_file(), name
    for path in (ROOT / "problems").glob("*.toml"):
        assert f"`{path.stem}`" in text


def test_readme_on_a_package_index(distributions):
    """There are no files beside it: links and pictures have whole addresses."""
    wheel = zipfile.ZipFile(distributions[0])
    name = next(name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    text = wheel.read(name).decode("utf-8").partition("\n\n")[2]
    targets = re.findall(r"\]\(([^)]+)\)", text)
    assert len(targets) > 5
    assert all(target.startswith("https://") for target in targets)
    assert "<!-- given" not in text


def test_the_files_that_contributing_names_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = re.findall(r"`(ergoqp/[\w/.]+|benchmarks/[\w/.]+|tests/[\w/.]+)`", text)
    # Of a row of the table, files without a folder are in that of the one before.
    for row in re.findall(r"^\| .* \| (`.*) \|$", text, re.MULTILINE):
        folder = ""
        for name in re.findall(r"`([\w/.]+)`", row):
            folder = name.rpartition("/")[0] if "/" in name else folder
            named.append(f"ergoqp/{name if '/' in name else f'{folder}/{name}'}")
    assert len(named) > 30
    assert [name for name in named if not (ROOT / name).exists()] == []
