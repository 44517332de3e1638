"""Folders with a table of poses for each body: names, order of quaternions, poses."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_files import BODY, read, refused, write

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.bodies import is_folder_of_bodies, read_bodies

POSED = "The quaternions are taken as "


def folder_of(path: Path, **files: str | bytes) -> Path:
    folder = path / "take"
    folder.mkdir()
    for name, content in files.items():
        write(folder / f"{name}.csv", content)
    return folder


def table(places: np.ndarray, turns: np.ndarray, head: str = "x,y,z,q0,q1,q2,q3") -> str:
    rows = [",".join(map(str, row)) for row in np.hstack([places, turns])]
    return "\n".join([head, *rows, ""])


def arm(order: list[int], generator: np.random.Generator, **lost: slice) -> dict[str, str]:
    """Tables of an upper arm, and of a forearm that hinges on it."""
    upper, hinge = Rotation.random(50, rng=generator), Rotation.random(50, rng=generator)
    place = generator.normal(size=(50, 3))
    below = place + upper.apply([0, 0, -0.3])
    turns = {"upper": upper.as_quat()[:, order], "fore": hinge.as_quat()[:, order]}
    for name, frames in lost.items():
        turns[name][frames] = 0
    return {"upper": table(place, turns["upper"]), "fore": table(below, turns["fore"])}


def test_names_places_turns_poses_and_times(tmp_path: Path) -> None:
    other = BODY.replace("1,2,3", "4,5,6").replace("1.5,2,3", "4.5,5,6")
    folder = folder_of(tmp_path, ann_LHand_pose=BODY, ann_Hip_pose=other)
    assert is_folder_of_bodies(folder)
    motion = read(read_bodies, folder, rate=10)
    assert motion.names == ("Hip", "LHand")
    np.testing.assert_array_equal(motion.of("LHand"), [[1, 2, 3], [1.5, 2, 3], [1, 2, 3]])
    np.testing.assert_array_equal(motion.of("Hip")[1], [4.5, 5, 6])
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.turns["Hip"][1] == pytest.approx([0, 0, 0.6, 0.8])
    pose = motion.objects["Hip"][1]
    assert pose[:3, :3] == pytest.approx(Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix())
    np.testing.assert_array_equal(pose[:, 3], [4.5, 5, 6, 1])
    assert motion.notes[0] == "There are 10 frames per second, as stated."
    assert (motion.unit, motion.up, motion.markers) == (None, None, False)


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + BODY,
        BODY.replace("\n", "\r\n"),
        BODY.rstrip(),
        BODY.replace(",", "\t"),
        BODY.replace(",", " "),
        BODY.replace(",", ";").replace(".", ","),
        BODY.replace("x,y,z,q0,q1,q2,q3", '"X", "Y", "Z", "Q0", "Q1", "Q2", "Q3"'),
        BODY.replace("q0,q1,q2,q3", "qx,qy,qz,qw"),
        BODY.replace("\n", ",7\n").replace("q3,7", "q3,error"),
        "q3,z,y,x,q2,q1,q0\n1,3,2,1,0,0,0\n0.8,3,2,1.5,0.6,0,0\n1,3,2,1,0,0,0\n",
        "x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n1.5,2,3,.8,0,0,.6\n1,2,3,1,0,0,0\n",
    ],
)
def test_the_same_table_of_other_programs(content: str, tmp_path: Path) -> None:
    motion = read(read_bodies, folder_of(tmp_path, box=content), rate=10)
    assert motion.names == ("box",)
    np.testing.assert_array_equal(motion.of("box"), [[1, 2, 3], [1.5, 2, 3], [1, 2, 3]])
    assert motion.turns["box"][1] == pytest.approx([0, 0, 0.6, 0.8])


@pytest.mark.parametrize(
    ("order", "said"), [([0, 1, 2, 3], "x, y, z, w"), ([3, 0, 1, 2], "w, x, y, z")]
)
@pytest.mark.parametrize("lost", [{}, {"upper": slice(20)}, {"fore": slice(None)}])
def test_the_order_of_quaternions_is_found(
    order: list[int], said: str, lost: dict[str, slice], tmp_path: Path
) -> None:
    files = arm(order, np.random.default_rng(4), **lost)
    motion = read(read_bodies, folder_of(tmp_path, **files), rate=10)
    assert any(note.startswith(f"{POSED}{said}: a bone's neighbour") for note in motion.notes)
    upper = Rotation.random(50, rng=np.random.default_rng(4)).as_quat()
    seen = slice(20, None) if "upper" in lost else slice(None)
    assert motion.turns["upper"][seen] == pytest.approx(upper[seen], abs=1e-6)
    for name, frames in lost.items():
        assert np.isnan(motion.turns[name][frames]).all()
        assert np.isnan(motion.objects[name][frames, :3, :3]).all()


def test_each_table_may_tell_its_order(tmp_path: Path) -> None:
    last, first = (
        BODY.replace("q0,q1,q2,q3", "qx,qy,qz,qw"),
        "x,y,z,qw,qx,qy,qz\n1,2,3,0.8,0,0,.6\n",
    )
    rows = first + "1,2,3,1,0,0,0\n" * 2
    motion = read(read_bodies, folder_of(tmp_path, a=last, b=rows), rate=10)
    assert motion.turns["a"][1] == pytest.approx([0, 0, 0.6, 0.8])
    assert motion.turns["b"][0] == pytest.approx([0, 0, 0.6, 0.8])
    assert not any(note.startswith(POSED) for note in motion.notes)
    files = arm([3, 0, 1, 2], np.random.default_rng(4))
    fore = files["fore"].replace("q0,q1,q2,q3", "qw,qx,qy,qz")
    (tmp_path / "other").mkdir()
    folder = folder_of(tmp_path / "other", upper=files["upper"], fore=fore)
    motion = read(read_bodies, folder, rate=10)
    upper = Rotation.random(50, rng=np.random.default_rng(4)).as_quat()
    assert motion.turns["upper"] == pytest.approx(upper, abs=1e-6)


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


def test_one_body_does_not_tell_its_order(tmp_path: Path) -> None:
    motion = read(read_bodies, folder_of(tmp_path, box=BODY), rate=10)
    assert motion.notes[1] == f"{POSED}x, y, z, w: with one body nothing tells their order."


@pytest.mark.parametrize("row", [",,,,,,", "nan,nan,nan,nan,nan,nan,nan", "1,2,3,0,0,0,0"])
def test_what_is_not_seen_keeps_its_time(row: str, tmp_path: Path) -> None:
    content = BODY.replace("1.5,2,3,0,0,0.6,0.8", row)
    motion = read(read_bodies, folder_of(tmp_path, a=content, b=BODY), rate=10)
    assert motion.positions.shape == (3, 2, 3)
    assert np.isnan(motion.turns["a"][1]).all()
    assert np.isnan(motion.of("a")[1]).all() == ("2" not in row)


@pytest.mark.parametrize("number", ["1e30", "5", "0.2"])
def test_what_is_no_unit_quaternion_is_not_seen(number: str, tmp_path: Path) -> None:
    content = BODY.replace("1,2,3,0,0,0,1", f"1,2,3,0,0,0,{number}")
    motion = read(read_bodies, folder_of(tmp_path, a=content, b=BODY), rate=10)
    np.testing.assert_array_equal(np.isnan(motion.turns["a"][:, 0]), [True, False, True])


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


BROKEN = {
    "other lengths": (BODY + "1,2,3,0,0,0,1\n", "take: got 3 rows for box and 4 for a, allowed"),
    "head only": ("x,y,z,q0,q1,q2,q3\n", "a.csv: got no row below the names, allowed poses"),
    "cut in a row": (
        BODY[:-6],
        "a.csv, line 4: got a row of 5 numbers, allowed 7: the file is cut",
    ),
    "a wide row": (BODY.replace("1.5", "1,5"), "a.csv, line 3: got a row of 8 numbers, allowed 7"),
    "a word": (BODY.replace("1.5", "one"), "a.csv, line 3: got 'one', allowed a number"),
    "a column twice": (BODY.replace("q3\n", "q3,x\n"), "a.csv, line 1: got the column x twice"),
    "infinite": (BODY.replace("1.5", "inf"), "a.csv, line 3: got a number that is not finite"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_table_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    folder = folder_of(tmp_path, a=content, box=BODY)
    with pytest.raises(RecordingError, match=sentence):
        read(read_bodies, folder, rate=10)


@pytest.mark.parametrize(
    "content",
    ["", "x,y,z\n1,2,3\n", BODY[:8], "x y z,q0 q1 q2 q3\n1,2\n", bytes(999), BODY.encode("utf-16")],
)
def test_a_folder_without_poses(content: str | bytes, tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a=content)
    assert not is_folder_of_bodies(folder)
    refused(
        read_bodies, folder, "take: got no table of poses, allowed one with the columns", rate=1
    )


def test_a_rate_is_needed(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a=BODY)
    refused(read_bodies, folder, r"^take: got tables of poses without times, allowed .* \(rate\)$")
    refused(read_bodies, folder, "take: rate: got -1, allowed frames per second", rate=-1)


def test_what_is_no_folder(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", BODY)
    refused(read_bodies, path, "'a.csv' cannot be read: Not a directory, allowed a folder", rate=1)
    refused(read_bodies, tmp_path / "none", "'none' cannot be read: No such file", rate=1)
    with pytest.raises(RecordingError, match="cannot be read: embedded null byte"):
        read(read_bodies, Path("a\0b"), rate=1)


def test_the_bones_of_a_handover(shared: Path) -> None:
    folder = shared / "mocap" / "kth_handover_giver"
    motion = read(read_bodies, folder, rate=120)
    arms = [f"{side}{bone}" for side in "LR" for bone in ("FArm", "Hand", "Shoulder", "UArm")]
    assert motion.names == ("baton", *arms, "ab", "chest", "head", "hip", "neck")
    for name in motion.names:
        path = folder / f"{'' if name == 'baton' else 'giver_'}{name}_pose_saved.csv"
        with path.open(newline="") as file:
            numbers = np.array([[float(w) for w in row] for row in list(csv.reader(file))[1:]])
        np.testing.assert_array_equal(motion.of(name), numbers[:, :3].astype(np.float32))
        assert motion.turns[name] == pytest.approx(numbers[:, 3:], abs=1e-6)
        expected = Rotation.from_quat(numbers[:, 3:]).as_matrix()
        # What is not the giver's is the thing that is given.
        assert (name in motion.objects) == (name == "baton")
        if name in motion.objects:
            assert motion.objects[name][:, :3, :3] == pytest.approx(expected, abs=1e-6)
    assert motion.time == pytest.approx(np.arange(801) / 120)
    assert motion.notes[1].startswith(f"{POSED}x, y, z, w: a bone's neighbour moves by 1 mm in its")
    assert motion.notes[2] == "76 of 801 frames are the frame before once more."
