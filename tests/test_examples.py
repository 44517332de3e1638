"""The examples run as they are, without a warning, and say what they promise."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from service_running import running

from ergoqp.service.c_header import header

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
