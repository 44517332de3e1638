"""Names of bodies and whose they are, by the names of their files."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_files import BODY, folder_of, read, write

from ergoqp.mocap.formats.bodies import read_bodies


@pytest.mark.parametrize(
    ("files", "objects"),
    [
        (["ann_hip", "ann_neck", "box"], ["box"]),
        (["ann_hip", "ann_neck"], ["hip", "neck"]),
        (["hip", "box"], ["box", "hip"]),
    ],
)
def test_the_bodies_of_a_person_are_no_objects(
    files: list[str], objects: list[str], tmp_path: Path
) -> None:
    folder = folder_of(tmp_path, **dict.fromkeys(files, BODY))
    assert list(read(read_bodies, folder, rate=10).objects) == objects


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["giver_hip_pose", "giver_neck_pose", "baton_pose"], ["baton", "hip", "neck"]),
        (["a_x", "a_y", "b_x", "b_y"], ["x", "y", "b_x", "b_y"]),
        (["one"], ["one"]),
        (["hip", "hips"], ["hip", "hips"]),
        (["s1_hip", "s1_"], ["s1_", "s1_hip"]),
    ],
)
def test_names(files: list[str], names: list[str], tmp_path: Path) -> None:
    folder = folder_of(tmp_path, **dict.fromkeys(files, BODY))
    assert read(read_bodies, folder, rate=10).names == tuple(names)


def test_files_of_one_name_are_two_bodies(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, hip=BODY)
    write(folder / "hip.txt", BODY)
    write(folder / "notes.txt", "x marks the place\n")
    write(folder / "hip.json", BODY)
    assert read(read_bodies, folder, rate=10).names == ("hip.csv", "hip.txt")


def of_two() -> dict[str, str]:
    bodies = ("hip", "chest", "neck", "head", "LHand", "RHand")
    files = {f"{who}_{body}_pose": BODY for who in ("giver", "taker") for body in bodies}
    return {**files, "baton_pose": BODY}


def test_two_people_by_the_begins_of_their_files(tmp_path: Path) -> None:
    motion = read(read_bodies, folder_of(tmp_path, **of_two()), rate=10)
    assert motion.names[:2] == ("baton", "giver:LHand")
    assert {name.partition(":")[0] for name in motion.names} == {"baton", "giver", "taker"}
    assert list(motion.objects) == ["baton"]
    few = of_two()
    del few["taker_hip_pose"]
    (tmp_path / "few").mkdir()
    motion = read(read_bodies, folder_of(tmp_path / "few", **few), rate=10)
    assert "taker_head" in motion.names
    assert "head" in motion.names


def test_sides_are_no_people(tmp_path: Path) -> None:
    files = {name.replace("giver", "Left").replace("taker", "r"): BODY for name in of_two()}
    motion = read(read_bodies, folder_of(tmp_path, **files), rate=10)
    assert "Left_head" in motion.names
    assert "r_head" in motion.names
    assert len(motion.objects) == len(motion.names)
