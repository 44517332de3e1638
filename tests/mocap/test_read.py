"""What of a file was read, and as what, is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.made_markers import markers_of
from benchmarks.made_motions import BODY, RATE, moved, walk
from ergoqp.mocap import load_recording
from ergoqp.mocap.demo_recording import demo_recording
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.recording import JointMotion


def motion_of(places: dict[str, np.ndarray], **more: Any) -> JointMotion:
    positions = np.stack(list(places.values()), axis=1)
    time = np.arange(len(positions)) / RATE
    return JointMotion(tuple(places), positions, time, **more)


def poses(path: np.ndarray) -> np.ndarray:
    found = np.tile(np.eye(4), (len(path), 1, 1))
    found[:, :3, 3] = path
    return found


def test_joints_objects_and_what_is_left() -> None:
    places = walk()[0]
    things = {"box": poses(places["right_wrist"]), "chest": poses(places["neck"])}
    given = motion_of({**places, "tail": places["pelvis"]}, objects=things)
    recording = recording_of(given, "take", ReadOptions(unit=1.0, up="z"))
    assert recording.read == {
        **{name: name for name in places},
        "tail": "",
        "box": "object",
        "chest": "",
    }
    count = len(places)
    said = f"{count} of {count + 1} joints are read; not read: tail."
    assert said in recording.assumptions


def test_names_are_those_of_the_file() -> None:
    names, places = markers_of(BODY, *(each[:120] for each in moved()))
    given = {f"A:{name}": places[:, i] for i, name in enumerate(names)}
    given |= {f"cup:{i}": places[:, 0] + 0.1 * np.eye(3)[i] for i in range(3)}
    given["A:VSAC"] = (given["A:LPSI"] + given["A:RPSI"]) / 2
    given["A:S2"] = given["A:VSAC"]
    given["A:R_wrist_ulna"] = given.pop("A:RWRB")
    given = {name: path.copy() for name, path in given.items()}
    # A marker that is lost for a while is estimated; the names stay.
    given["A:LTIB"][40:60] = np.nan
    recording = recording_of(motion_of(given), "take", ReadOptions(unit=1.0, up="z"))
    assert set(recording.read) == {*given, "cup"}
    assert recording.read["A:LASI"] == "left_asis"
    assert recording.read["A:RBAK"] == "trunk"
    assert recording.read["A:S2"] == ""
    assert recording.read["A:R_wrist_ulna"] == (
        "right_wrist_small (guessed: a name of another marker set)"
    )
    uses = {recording.read[name] for name in ("cup", "cup:0", "cup:2")}
    assert uses in ({"object"}, {""})
    assert f"{len(names) + 1} of {len(names) + 2} markers are read; not read: S2." in (
        recording.assumptions
    )


def test_a_joint_of_two_centres_and_all_that_is_read() -> None:
    places = {name: path for name, path in walk()[0].items() if name != "neck"}
    named = {name.replace("toe", "foot_index"): path for name, path in places.items()}
    heads = ("head", "head_top", "pelvis", "knuckles", "thumb")
    named = {name: path for name, path in named.items() if not name.endswith(heads)}
    recording = recording_of(motion_of(named), "take", ReadOptions(unit=1.0, up="z"))
    assert recording.read["left_shoulder"] == "neck, left_shoulder"
    assert not any("not read" in sentence for sentence in recording.assumptions)


def test_columns_of_a_table(tmp_path: Path) -> None:
    places, path = walk()[0], tmp_path / "take.csv"
    head = ["time", "mood", *(f"{name}.{axis}" for name in places for axis in "xyz")]
    head.append("neck.confidence")
    flat = np.stack(list(places.values()), axis=1).reshape(len(places["neck"]), -1)
    rows = [f"{i / RATE:.4f},3,{','.join(f'{v:.4f}' for v in row)},1" for i, row in enumerate(flat)]
    path.write_text("\n".join([",".join(head), *rows]) + "\n", encoding="utf-8")
    read = load_recording(path).read
    assert (read["time"], read["mood"], read["neck.confidence"]) == ("time", "", "confidence")
    assert read["right_wrist"] == "right_wrist"


@pytest.mark.parametrize("name", ["osim_walk_free_01.trc", "osim_subject01_walk1_ik.mot"])
def test_files_of_others(name: str, shared: Path) -> None:
    folder = shared / "recording_faults"
    if not folder.is_dir():
        pytest.skip("the shared folder has no recording_faults")
    recording = load_recording(folder / name)
    (sentence,) = [each for each in recording.assumptions if " are read; not read: " in each]
    count = sum(map(bool, recording.read.values()))
    assert sentence.startswith(f"{count} of {len(recording.read)} ")


def test_a_skeleton_of_our_own_is_read_to_the_last_joint(tmp_path: Path) -> None:
    recording = load_recording(demo_recording(tmp_path / "demo.bvh"))
    assert [name for name, use in recording.read.items() if not use] == ["trunk"]
