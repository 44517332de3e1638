"""Nexus' CSV: what is in a trial's trajectories, whatever sections stand above them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_files import NEXUS, read, refused, write

from benchmarks.made_markers import markers_of
from benchmarks.made_motions import BODY, moved, read_angles
from ergoqp.mocap import load_recording
from ergoqp.mocap.formats.nexus import read_nexus
from ergoqp.mocap.readers import kind_of

DEVICES = """Devices
1000
,,Force.Fx,,
Frame,Sub Frame,Fx,Fy,Fz
,,N,N,N
5,0,1,2,3
5,1,1,2,3

"""


@pytest.mark.parametrize(
    "content",
    [
        NEXUS,
        "\ufeff" + NEXUS,
        NEXUS.replace("\n", "\r\n"),
        DEVICES + NEXUS,
        NEXUS + "\n",
        NEXUS.replace(",", "\t"),
        NEXUS.replace("Trajectories", '"Trajectories",,,'),
        NEXUS.replace(",", ";").replace(".", ","),
        NEXUS.replace("Anna:LASI", '"Anna:LASI"'),
    ],
)
def test_markers_times_and_notes(content: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", content)
    assert kind_of(path).title == "Nexus CSV"
    motion = read(read_nexus, path)
    assert motion.names == ("Anna:LASI", "Anna:R Knee")
    np.testing.assert_array_equal(motion.positions[0], [[1, 2, 3], [4, 5, 6]])
    assert np.isnan(motion.positions[1, 1]).all()
    assert motion.positions[2, 1, 2] == 6.25
    assert motion.time == pytest.approx([0, 0.1, 0.3])
    assert (motion.markers, motion.unit) == (True, 0.001)
    assert "1 trajectories have no label and are left out." in motion.notes


BROKEN = {
    "a frame twice": (NEXUS.replace("\n6,", "\n5,"), "1 of 3 frames have the time of the frame"),
    "no trajectories": (DEVICES, "the file ends in line .*, required is the section Trajectories"),
    "no rate": (NEXUS.replace("\n10\n", "\nmany\n"), "line 2: got 'many', allowed frames per sec"),
    "rate nan": (NEXUS.replace("\n10\n", "\nnan\n"), "line 2: got 'nan', allowed frames per sec"),
    "rate 0": (NEXUS.replace("\n10\n", "\n0\n"), "line 2: got '0', allowed frames per second"),
    "no axes": (NEXUS.replace("Frame,Sub", "A,B"), "line 4: got 'A,B Frame,.*, allowed Frame, Sub"),
    "no names": (NEXUS.replace("Anna:LASI", "").replace("Anna:R Knee", ""), "got no marker with"),
    "no unit": (NEXUS.replace("mm", "ft"), "got the units 'ft', allowed mm, cm or m"),
    "two units": (NEXUS.replace("mm", "m", 3), "got the units 'm, mm', allowed mm, cm or m"),
    "a word": (NEXUS.replace("2.5", "x"), "line 7: .*'x'"),
    "another section behind": (NEXUS + "\n" + DEVICES, "line 10: "),
    "no frames": (NEXUS[: NEXUS.index("5,0")], "got no row of numbers"),
    "cut in the head": (NEXUS[:20], "the file ends in line"),
    "time runs back": (NEXUS.replace("\n8,", "\n2,"), "time runs backwards"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_broken(what: str, tmp_path: Path) -> None:
    content, match = BROKEN[what]
    refused(read_nexus, write(tmp_path / "a.csv", content), match)


def test_a_walk_is_scored_as_from_arrays(tmp_path: Path) -> None:
    pelvis, postures = (each[:240] for each in moved())
    names, places = markers_of(BODY, pelvis, postures)
    rows = ["Trajectories", "60", ",," + ",,,".join(f"Anna:{name}" for name in names)]
    rows += ["Frame,Sub Frame" + ",X,Y,Z" * len(names), "," + ",mm" * 3 * len(names)]
    flat = 1000 * places.reshape(len(places), -1)
    rows += [f"{i},0," + ",".join(f"{v:.3f}" for v in row) for i, row in enumerate(flat, 1)]
    recording = load_recording(write(tmp_path / "walk.csv", "\n".join(rows)))
    assert recording.scored.all()
    found, right = read_angles(recording.postures), read_angles(postures)
    for name in ("trunk", "knee"):
        assert np.abs(found[name] - right[name]).max() < 0.5
