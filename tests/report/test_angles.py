"""The angles of a recording as files: what is read back is what was written."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from ergoqp.joints import JOINTS
from ergoqp.mocap import load_recording
from ergoqp.mocap.demo_recording import demo_recording
from ergoqp.report import seen
from ergoqp.report.scores import write_angles
from ergoqp.sheets.description import elevation_of


@pytest.mark.parametrize("block", [7, 4096])
def test_what_is_written_is_read_back(
    block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(seen, "_BLOCK", block)
    recording = load_recording(demo_recording(tmp_path / "demo.bvh"))
    recording.errors["head"][3] = np.nan
    table, motion = write_angles(recording, tmp_path)
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(recording.time)
    elevation, plane = np.degrees(elevation_of(recording.postures))
    for i in (0, 3, 100, 180):
        read = [float(rows[i][f"{joint}_deg"] or "nan") for joint in JOINTS]
        told = np.where(recording.observed[i], np.degrees(recording.postures[i]), np.nan)
        assert read == pytest.approx(told, abs=1e-4, nan_ok=True)
        assert float(rows[i]["time_s"]) == pytest.approx(recording.time[i], abs=1e-6)
        assert rows[i]["scored"] == "1"
        assert float(rows[i]["left_elevation_deg"]) == pytest.approx(elevation[i, 1], abs=1e-4)
        assert float(rows[i]["right_elevation_plane_deg"]) == pytest.approx(plane[i, 0], abs=1e-4)
        error = 1e3 * recording.errors["left_ankle"][i]
        assert float(rows[i]["left_ankle_error_mm"]) == pytest.approx(error, abs=0.01)
    assert rows[3]["head_error_mm"] == ""

    lines = motion.read_text(encoding="utf-8").splitlines()
    end = lines.index("endheader")
    stated = dict(line.split("=") for line in lines[1:end])
    names = lines[end + 1].split("\t")
    values = np.array([line.split("\t") for line in lines[end + 2 :]], dtype=float)
    assert stated["inDegrees"] == "yes"
    assert values.shape == (int(stated["nRows"]), int(stated["nColumns"])) == (181, len(names))
    assert names[:33] == ["time", *JOINTS]
    np.testing.assert_allclose(values[:, 1:33], np.degrees(recording.postures), atol=1e-5)
