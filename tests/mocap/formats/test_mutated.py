"""Files changed at random: one sentence, or a movement whose times increase; nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_files import MOTIVE, MVNX, NEXUS, STORAGE, TABLE, TRC, Reader, read, write

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.motive import read_motive
from ergoqp.mocap.formats.mvnx import read_mvnx
from ergoqp.mocap.formats.nexus import read_nexus
from ergoqp.mocap.formats.opensim import read_storage
from ergoqp.mocap.formats.table import read_table
from ergoqp.mocap.formats.trc import read_trc
from ergoqp.mocap.recording import JointMotion

FORMATS = {
    "table": (read_table, TABLE),
    "semicolons": (read_table, TABLE.replace(",", ";").replace(".", ",")),
    "two rows above": (read_table, ",neck,,,\ntime,x,y,z,score\n(s),mm,mm,mm,\n0,1,2,3,1\n"),
    "two people": (
        read_table,
        "time,id,a.x,a.y,a.z,a.c,mood\n12:00:00,1,1,2,3,0.1,x\n12:00:00,Al,1,2,3,0.9,y\n"
        "12:00:00.5,1,1,2,3,0.9,y\n12:00:01,Al,1,2,4,0.9,y\n",
    ),
    "trc": (read_trc, TRC),
    "storage": (read_storage, STORAGE),
    "motive": (read_motive, MOTIVE),
    "mvnx": (read_mvnx, MVNX),
    "nexus": (read_nexus, NEXUS),
}
SIGNS = ("", " ", "\n", "\r", "\r\n", "\t", ",", ";", '"', "\x00", "\x0c", "\x85", "\u2028", "é")
NUMBERS = (
    "nan",
    "inf",
    "-1e9",
    "1e30",
    "1e300",
    "5e-324",
    "9" * 30,
    "9" * 5000,
    "1_0",
    "²",
    "1,2,3",
)
TAGS = ("<", ">", "</frame>", "<frame>", "<segments>", "&lt;", "]]>", "=", "endheader\n", "nRows=")
WORDS = ("Rigid Body", "Marker", "Unlabeled", "Position", "time", ".x", "Frame", "(ms)", "μs")
PIECES = st.sampled_from(SIGNS + NUMBERS + TAGS + WORDS)
SLOW = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]


def check(reader: Reader, path: Path) -> None:
    """Check that a file is read well, or refused well."""
    try:
        motion = read(reader, path, ("neck", "hip"), 10)
    except RecordingError as error:
        text = str(error)
        assert text.startswith((path.name, "'", "a."))
        assert "\n" not in text
        assert len(text) < 600
        return
    check_motion(motion)


def check_motion(motion: JointMotion) -> None:
    count = len(motion.time)
    assert count
    assert motion.time.dtype == float
    assert np.isfinite(motion.time).all()
    assert motion.time[0] == 0
    assert (np.diff(motion.time) > 0).all()
    assert motion.positions.shape == (count, len(motion.names), 3)
    assert not np.isinf(motion.positions).any()
    assert len(set(motion.names)) == len(motion.names)
    assert all(motion.names)
    assert motion.names or motion.angles
    for turns in motion.turns.values():
        assert turns.shape == (count, 4)
        size = np.linalg.norm(turns, axis=1)
        assert size[np.isfinite(size)] == pytest.approx(1, abs=1e-6)
    for poses in motion.objects.values():
        assert poses.shape == (count, 4, 4)
    for angles in motion.angles.values():
        assert angles.shape == (count,)
        assert not np.isinf(angles).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
@settings(deadline=2000, max_examples=150, suppress_health_check=SLOW)
@given(data=st.data())
def test_no_change_of_text_breaks_a_reader(name: str, data: st.DataObject, tmp_path: Path) -> None:
    reader, text = FORMATS[name]
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 40)))
        new = data.draw(PIECES | st.text(max_size=8) | st.just(text[start:end] * 2))
        text = text[:start] + new + text[end:]
    check(reader, write(tmp_path / "take.csv", text.encode("utf-8", "surrogatepass")))


@pytest.mark.parametrize("name", FORMATS)
@settings(deadline=2000, max_examples=100, suppress_health_check=SLOW)
@given(data=st.data())
def test_no_change_of_bytes_breaks_a_reader(name: str, data: st.DataObject, tmp_path: Path) -> None:
    reader, text = FORMATS[name]
    content = bytearray(text.encode())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)) | st.just(len(content)))]
    check(reader, write(tmp_path / "take.csv", bytes(content)))


@pytest.mark.parametrize("name", FORMATS)
def test_no_cut_breaks_a_reader(name: str, tmp_path: Path) -> None:
    reader, text = FORMATS[name]
    content = text.encode()
    for end in range(len(content)):
        check(reader, write(tmp_path / "take.csv", content[:end]))


@pytest.mark.parametrize("name", FORMATS)
@settings(deadline=2000, max_examples=50, suppress_health_check=SLOW)
@given(content=st.binary(max_size=300))
def test_no_bytes_break_a_reader(name: str, content: bytes, tmp_path: Path) -> None:
    reader, _ = FORMATS[name]
    check(reader, write(tmp_path / "take.csv", content))
