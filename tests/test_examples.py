"""The examples run as they are, without a warning, and say what they promise."""

import subprocess
import sys
from pathlib import Path

import pytest

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
