"""Tables in which each person has a row for each frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_files import read, refused, write

from ergoqp.mocap.formats.columns import People
from ergoqp.mocap.formats.table import read_table

NAN = np.nan
HEADS = [
    "body_id",
    "id",
    "person",
    "Person ID",
    "user",
    "track_id",
    "skeleton",
    "trackingId",
    "body",
]


def table(*rows: str, head: str = "time,id,neck.x,neck.y,neck.z") -> str:
    return "\n".join([head, *rows, ""])


ROWS = ("0,7,1,2,3", "0,9,4,5,6", "0.1,9,4,5,7", "0.1,7,1,2,4", "0.2,7,1,2,5", "0.3,9,4,5,8")


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4, 5], [0, 3, 4, 1, 2, 5], [1, 0, 2, 3, 5, 4]])
def test_everybody_is_at_everybodys_times(head: str, order: list[int], tmp_path: Path) -> None:
    content = table(*[ROWS[i] for i in order]).replace("id", head)
    if order[0] == 1:
        order = [1, 0]
    motion = read(read_table, write(tmp_path / "a.csv", content))
    first, second = ("9", "7") if order[0] == 1 else ("7", "9")
    assert motion.names == (f"{first}:neck", f"{second}:neck")
    assert motion.time == pytest.approx([0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(motion.of("7:neck")[:, 2], [3, 4, 5, NAN])
    np.testing.assert_array_equal(motion.of("9:neck")[:, 2], [6, 7, NAN, 8])
    assert "The rows are those of 2 people, whose names are the points' prefixes." in motion.notes


def test_names_of_people_are_words_too(tmp_path: Path) -> None:
    content = table("0,Ann B,1,2,3", "0,Çem,4,5,6", "0.1,Ann B,1,2,3", "0.1,,7,7,7")
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.names == ("Ann B:neck", "Çem:neck")
    np.testing.assert_array_equal(motion.of("Çem:neck"), [[4, 5, 6], [NAN] * 3])


@pytest.mark.parametrize("rows", [("0,7,1,2,3", "0.1,7,1,2,4"), ("0,,1,2,3", "0.1,7,1,2,4")])
def test_one_person_changes_nothing(rows: tuple[str, ...], tmp_path: Path) -> None:
    motion = read(read_table, write(tmp_path / "a.csv", table(*rows)))
    assert (motion.names, motion.notes) == (
        ("neck",),
        ("The frames are uniform in time, 0.1 s apart.",),
    )


@pytest.mark.parametrize("count", [3, 2000])
def test_a_count_of_the_rows_is_nobody(count: int, tmp_path: Path) -> None:
    content = table(*[f"{i / 10},{i},1,2,{i}" for i in range(count)])
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.names == ("neck",)
    assert len(motion.time) == count
    assert "The column id has another value in each row and is not used." in motion.notes


def test_an_id_that_changes_midway_is_somebody_else(tmp_path: Path) -> None:
    rows = [f"{i / 10},{1 + i // 5},1,2,{i}" for i in range(10)]
    motion = read(read_table, write(tmp_path / "a.csv", table(*rows)))
    assert motion.names == ("1:neck", "2:neck")
    np.testing.assert_array_equal(np.isnan(motion.of("1:neck")[:, 0]), np.arange(10) > 4)


def test_frames_by_their_numbers(tmp_path: Path) -> None:
    head = "frame,id,neck.x,neck.y,neck.z"
    content = table("5,1,1,2,3", "5,2,4,5,6", "6,1,1,2,4", ",,,,", "8,2,4,5,7", head=head)
    path = write(tmp_path / "a.csv", content)
    motion = read(read_table, path, rate=10)
    assert motion.time == pytest.approx([0, 0.1, 0.3])
    np.testing.assert_array_equal(motion.of("2:neck")[:, 2], [6, NAN, 7])
    nothing = write(tmp_path / "b.csv", content.replace("frame", "temperature"))
    refused(read_table, nothing, "got the rows of 2 people without times, allowed a col", rate=10)


def test_a_stated_rate_where_the_times_of_people_are_coarse(tmp_path: Path) -> None:
    rows = [f"{f},{f // 10},{p},1,2,{f}" for f in range(20) for p in (1, 2)]
    head = "frame,time,id,neck.x,neck.y,neck.z"
    path = write(tmp_path / "a.csv", table(*rows, head=head))
    refused(read_table, path, r"^a.csv: '1': 18 of 20 frames have the time of .* \(rate\)$")
    motion = read(read_table, path, rate=10)
    assert motion.time == pytest.approx(np.arange(20) / 10)
    np.testing.assert_array_equal(motion.of("2:neck")[:, 2], np.arange(20))


def test_what_is_wrong_with_somebodys_times_is_told(tmp_path: Path) -> None:
    for rows, sentence in (
        (["0.2,7,1,2,3", "0,9,1,2,3", "0.1,7,1,2,3"], "'7': time runs backwards from 0.2 to 0.1"),
        (["0,7,1,2,3", "0,9,1,2,3", ",7,1,2,3"], "row 3 of the numbers has no time"),
    ):
        refused(read_table, write(tmp_path / "a.csv", table(*rows)), sentence)


def test_a_crowd(tmp_path: Path) -> None:
    rows = [f"{t},{p},1,2,3" for t in range(3) for p in range(25) if t == 0 or p >= 3]
    motion = read(read_table, write(tmp_path / "a.csv", table(*rows).replace("time", "time (s)")))
    assert len(motion.names) == 20
    assert "0:neck" not in motion.names
    assert "Of 25 people the 20 that are seen most often are read." in motion.notes


def test_more_people_than_anybody_tracks() -> None:
    people = People()
    people("a")
    for i in range(999):
        people("a")
        people(f"{i}")
    with pytest.raises(ValueError, match=r"^as a further person, allowed at most 1000 people"):
        people("one")
