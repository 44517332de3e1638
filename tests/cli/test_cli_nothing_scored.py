"""A recording of which no frame can be scored: its files are written, and the exit status is 3."""

import csv
import json

import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.mocap.naming import centres_of

ABOVE, BELOW = ("neck", "head", "shoulder"), ("pelvis", "hip")
FRAMES = 300


@pytest.fixture
def halves(tmp_path):
    """A table whose first half shows hips and whose last half shows shoulders, 50 frames apart."""
    pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (FRAMES, 1))
    centres = centres_of(Body(), pelvis, np.zeros((FRAMES, 32)))
    for name, places in centres.items():
        if any(part in name for part in ABOVE):
            places[:150] = np.nan
        if any(part in name for part in BELOW):
            places[100:] = np.nan
    head = ",".join(f"{name}.{axis}" for name in centres for axis in "xyz")
    rows = np.stack(list(centres.values()), axis=1).reshape(FRAMES, -1)
    path = tmp_path / "halves.csv"
    np.savetxt(path, rows, "%.5f", delimiter=",", header=head, comments="")
    return path


def test_files_one_sentence_and_exit_status_3(ergoqp, halves, tmp_path):
    outcome = ergoqp("score", halves, "--rate", "30", "--out", "out")
    assert outcome.status == 3
    said = [line for line in outcome.err.splitlines() if not line.endswith(" ...")]
    assert len(said) == 1
    assert said[0].startswith("ergoqp: halves.csv: no frame shows a trunk (trunk not seen)")
    assert "--mapping" in said[0]
    assert "0 of 300 scored" in outcome.out
    summary = json.loads((tmp_path / "out" / "scores.json").read_text(encoding="utf-8"))
    assert summary["valid_frames"] == summary["exact_frames"] == 0
    assert summary["worst"] is summary["mean_low"] is summary["segments"]["legs"]["usual"] is None
    with (tmp_path / "out" / "scores.csv").open(newline="", encoding="utf-8") as file:
        assert {row["reba_high"] for row in csv.DictReader(file)} == {"0"}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "no frame could be scored" in page
    assert "trunk not seen" in page


def test_the_help_names_the_exit_status(ergoqp):
    assert "the exit status is 3" in " ".join(ergoqp("score", "--help").out.split())
    assert "3 for a recording" in ergoqp("--help").out
