"""The examples run as they are, without a warning, and say what they promise."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from service_running import running

from ergoqp.joints import JOINTS
from ergoqp.service.c_header import header
from ergoqp.service.command import STEP_KEYS
from ergoqp.service.tcp import TOKEN_FILE

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SAYS = {
    "01_step_in_a_loop": ["at the start: REBA", "without a frame: braking, no posture arrived"],
    "02_own_problem_from_python": ["smooth_reba", "quadratic", "limits broken 0 times"],
    "03_score_a_recording": ["negligible", "worst: REBA", "trunk"],
    "04_learned_cost": ["480 to learn from", "within one point", "boundary margin"],
    "05_best_place": [
        "best place: REBA",
        "if the posture could be chosen too",
        "a person of 1.95 m",
        "limits broken 0 times",
    ],
    "06_place_for_a_group": ["one place for all: x", "1.60 m: REBA", "adjustable z: highest"],
    "08_robot_that_lags": [
        "robot: late by",
        "lag declared:",
        "brought it to rest in",
        "asked to brake",
    ],
    "07_whole_body": [
        "keep 0.05 m",
        "first step: optimal",
        "held back by the distance",
        "limits of the arm broken 0 times",
    ],
}


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(SAYS)
    assert [path.name for path in EXAMPLES.glob("*.cpp")] == ["service_loop.cpp"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SAYS)
def test_example(name, tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "error", str(EXAMPLES / f"{name}.py")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    for words in SAYS[name]:
        assert words in done.stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_example_in_cpp(tmp_path_factory):
    folder = tmp_path_factory.mktemp("e")
    (folder / "ergoqp_client.h").write_text(header())
    strict = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
    for year in (11, 20):
        command = ["g++", f"-std=c++{year}", "-O2", *strict, "-I.", "-o", "service_loop"]
        subprocess.run([*command, EXAMPLES / "service_loop.cpp"], cwd=folder, check=True)
    with running(folder / "s", "screwing", "--interpreted") as service:
        service.client().close()
        done = subprocess.run(
            ["./service_loop", service.socket(), "4"], cwd=folder, capture_output=True, text=True
        )
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    costs = [float(cost) for cost in re.findall(r"cost ([0-9.]+)", done.stdout)[1:]]
    assert len(costs) == 7
    # It makes the posture better, also where a busy machine lets it brake at times.
    assert costs[-1] < costs[0] - 0.1
    assert lines[-1].startswith("at rest; late")


@pytest.mark.skipif(os.name != "posix" or not shutil.which("sh"), reason="there is no shell")
def test_example_in_a_shell(tmp_path):
    done = subprocess.run(
        ["sh", str(EXAMPLES / "service_loop.sh")],
        cwd=tmp_path,
        env={**os.environ, "ERGOQP": f"{sys.executable} -m ergoqp", "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.count(": optimal, twist ") == 4
    assert "after three periods of the stop: optimal" in done.stdout
    assert "without a frame: braking, no posture arrived" in done.stdout
    assert not list(tmp_path.iterdir())


def test_example_in_matlab_names_what_there_is():
    """What can be said without MATLAB: its blocks are closed, and its keys are those of a step."""
    text = (EXAMPLES / "service_loop.m").read_text()
    code = re.sub(r"%.*", "", re.sub(r"'[^'\n]*'", "''", text))
    opened = len(re.findall(r"^\s*(?:if|for|while)\b", code, re.MULTILINE))
    assert opened == len(re.findall(r"^\s*end\b", code, re.MULTILINE)) > 0
    assert code.count("(") == code.count(")")
    named = set(re.findall(r"'(\w+)_deg'", text))
    assert len(named) == 10
    assert named <= set(JOINTS)
    keys = set(re.findall(r"struct\('(\w+)', (?!step\b)", text)) - {"trunk_flexion_deg"}
    keys |= set(re.findall(r"\bstep\.(\w+)", text)) | set(re.findall(r"posture, '(\w+)'", text))
    assert keys == {"posture", "standing", "followed"}
    assert keys <= set(STEP_KEYS)
    assert TOKEN_FILE in text


@pytest.mark.slow
def test_example_in_octave():
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("Octave is not installed")
    has = [octave, "--eval", "pkg load instrument-control; exit(~exist('tcpclient'))"]
    if subprocess.run(has, capture_output=True, timeout=60).returncode:
        pytest.skip("Octave has no package instrument-control with tcpclient")
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", "screwing", "--interpreted", "--tcp", "0") as service,
    ):
        service.client().close()
        port = service.log.read_text().partition("at port ")[2].partition(",")[0]
        said = f"port = {port}; token_file = '{service.folder / TOKEN_FILE}'; service_loop"
        done = subprocess.run(
            [octave, "--eval", said], cwd=EXAMPLES, capture_output=True, text=True, timeout=120
        )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("optimal : twist [") == 4
    assert "braking no posture arrived: twist [" in done.stdout
