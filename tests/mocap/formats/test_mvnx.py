"""MVNX files: segments and joint angles of Xsens, whatever else is in the XML."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_files import MVNX, mvnx_frame, read, refused, write

from ergoqp.mocap.formats import mvnx
from ergoqp.mocap.formats.mvnx import read_mvnx

UNIFORM = "The frames are uniform in time, 0.1 s apart."
POSED = "1 calibration poses (N-pose, T-pose) of the file are left out."
ROOT = '<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">'


def test_segments_turns_angles_times_and_notes(tmp_path: Path) -> None:
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", MVNX))
    assert motion.names == ("Pelvis", "L5")
    np.testing.assert_array_equal(motion.positions[2], [[2, 0, 1], [2, 0.5, 1.5]])
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    np.testing.assert_array_equal(motion.turns["Pelvis"], [[0, 0, 0, 1]] * 3)
    assert motion.turns["L5"][0] == pytest.approx([0, 0, 0.6, 0.8])
    assert list(motion.angles) == ["jL5S1 abduction", "jL5S1 rotation", "jL5S1 flexion"]
    assert motion.angles["jL5S1 rotation"] == pytest.approx(np.radians([2, 2, 2]))
    assert motion.angles["jL5S1 flexion"] == pytest.approx(np.radians([0, 10, 20]))
    assert (motion.unit, motion.up, motion.markers) == (1.0, "z", False)
    assert motion.notes == (UNIFORM, POSED)


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + MVNX,
        MVNX.replace("\n", "\r\n"),
        MVNX.encode("utf-16").replace(b"U\0T\0F\0-\0008\0", b"U\0T\0F\0-\0001\0006\0"),
        MVNX.replace("Somebody", "Jürgen").replace("UTF-8", "latin-1").encode("latin-1"),
        MVNX.replace(' xmlns="http://www.xsens.com/mvn/mvnx"', ""),
        MVNX.replace("<", "<x:")
        .replace("<x:/", "</x:")
        .replace("<x:?", "<?")
        .replace("xmlns=", "xmlns:x="),
        MVNX.replace("?>\n", '?>\n<!DOCTYPE mvnx SYSTEM "http://www.xsens.com/mvnx.dtd">\n'),
        MVNX.replace("<frames ", "<!-- <frame/> --><?pi <frame?><frames "),
        MVNX.replace(' type="normal"', ""),
        MVNX.replace("<position>", "<position>\n\t").replace("</mvnx>", "<securityCode/></mvnx>"),
        MVNX.replace("<orientation>", "<time>1</time><footContacts>0</footContacts><orientation>"),
        MVNX.replace("</orientation>", "</orientation><jointAngleXZY>9 9 9</jointAngleXZY>"),
    ],
)
def test_harmless_variants(content: str | bytes, tmp_path: Path) -> None:
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", content))
    assert motion.names == ("Pelvis", "L5")
    np.testing.assert_array_equal(motion.positions[1], [[1, 0, 1], [1, 0.5, 1.5]])
    assert motion.angles["jL5S1 flexion"] == pytest.approx(np.radians([0, 10, 20]))
    assert motion.notes == (UNIFORM, POSED)


def test_a_file_without_joint_angles(tmp_path: Path) -> None:
    content = MVNX.replace("<jointAngle>", "<other>").replace("</jointAngle>", "</other>")
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", content))
    assert motion.angles == {}
    assert motion.positions.shape == (3, 2, 3)


HANDS = {"RightHand": (0.5, -0.5, 0.5, 0.5), "LeftHand": (0.5, 0.5, 0.5, -0.5)}
"""Orientation in a T-pose of the hands in version 3, w, x, y, z; in version 4 they have none."""
BENT = Rotation.from_euler("ZYX", [[0, 0, 0], [20, -70, 5], [-30, 15, 60]], degrees=True)
"""Orientation of both hands from the T-pose on."""


def hands(pose: str, axes: str, orientation: str | None = None) -> str:
    """A file of two hands whose axes are those of a version, with a calibration pose."""
    segments = "".join(f'<segment label="{name}"/>' for name in HANDS)
    own = [
        Rotation.from_quat(quaternion, scalar_first=True)
        if axes == "version 3"
        else Rotation.identity()
        for quaternion in HANDS.values()
    ]

    def frame(i: int, kind: str, turn: Rotation, given: str | None = None) -> str:
        both = [(turn * each).as_quat(scalar_first=True) for each in own]
        words = " ".join(map(str, np.concatenate(both)))
        return (
            f'<frame index="{i}" type="{kind}"><position>0 -1 1 0 1 1</position>'
            f"<orientation>{words if given is None else given}</orientation></frame>"
        )

    frames = frame(-1, pose, Rotation.identity(), orientation)
    frames += "".join(frame(i, "normal", turn) for i, turn in enumerate(BENT))
    return (
        f'{ROOT}<subject label="A" frameRate="10"><segments>{segments}</segments>'
        f"<frames>{frames}</frames></subject></mvnx>"
    )


@pytest.mark.parametrize("pose", ["identity", "tpose"])
@pytest.mark.parametrize("axes", ["version 3", "version 4"])
def test_hands_have_the_axes_that_the_t_pose_shows(pose: str, axes: str, tmp_path: Path) -> None:
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", hands(pose, axes)))
    for (name, quaternion), out in zip(HANDS.items(), (-1, 1), strict=True):
        turn = Rotation.from_quat(motion.turns[name])
        expected = BENT * Rotation.from_quat(quaternion, scalar_first=True)
        assert (turn * expected.inv()).magnitude() == pytest.approx(0, abs=1e-5)
        # Knuckles and thumb as in namings.toml: in the T-pose to the side, and ahead and below.
        assert turn[0].apply([0, 0, -0.15]) == pytest.approx([0, 0.15 * out, 0], abs=1e-6)
        thumb = turn[0].apply([0.0371, 0.0928 * out, 0])
        assert thumb == pytest.approx([0.0928, 0, -0.0371], abs=1e-6)


@pytest.mark.parametrize(
    ("pose", "orientation"),
    [
        ("npose", None),
        ("tpose", ""),
        ("tpose", "1 0 0"),
        ("tpose", "1 0 0 zero 1 0 0 zero"),
        ("tpose", "nan nan nan nan 0 0 0 0"),
        ("tpose", "1e300 0 0 0 5 0 0 0"),
    ],
)
def test_without_a_t_pose_the_axes_are_those_of_version_3(
    pose: str, orientation: str | None, tmp_path: Path
) -> None:
    content = hands(pose, "version 3", orientation)
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", content))
    assert POSED in motion.notes
    turn = Rotation.from_quat(motion.turns["RightHand"])
    assert turn[0].apply([0, 0, -0.15]) == pytest.approx([0, -0.15, 0], abs=1e-6)


def test_a_hand_that_is_not_seen_stays_so(tmp_path: Path) -> None:
    content = hands("tpose", "version 4")
    last = content.rindex("<orientation>")
    lost = content[:last] + "<orientation>nan nan nan nan 1 0 0 0</orientation></frame>"
    lost += content[content.rindex("</frames>") :]
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", lost))
    assert np.isnan(motion.turns["RightHand"]).all(axis=1).tolist() == [False, False, True]
    assert np.isfinite(motion.turns["LeftHand"]).all()


@pytest.mark.parametrize("block", [1, 2, 3])
def test_blocks_are_as_the_whole(
    block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "a.mvnx", MVNX)
    whole = read(read_mvnx, path)
    monkeypatch.setattr(mvnx, "_BLOCK", block)
    told: list[float] = []
    motion = read_mvnx(path, told.append, mvnx.TableOptions())
    np.testing.assert_array_equal(motion.positions, whole.positions)
    np.testing.assert_array_equal(motion.turns["L5"], whole.turns["L5"])
    assert told == sorted(told)
    some = MVNX.replace("<jointAngle>1 2 10</jointAngle>", "")
    refused(read_mvnx, write(path, some), r"^a\.mvnx: got joint angles \(jointAngle\) in some of")


def test_frames_that_are_there_twice_or_lost(tmp_path: Path) -> None:
    frames = mvnx_frame(1) + mvnx_frame(1) + mvnx_frame(5)
    motion = read(
        read_mvnx,
        write(
            tmp_path / "a.mvnx", MVNX.replace(mvnx_frame(1), frames, 1).replace(mvnx_frame(2), "")
        ),
    )
    assert motion.time == pytest.approx([0, 0.1, 0.5])
    assert motion.notes[0].startswith("1 of 4 frames have the time of the frame before")


def bomb(levels: int) -> str:
    entities = "".join(
        f'<!ENTITY e{i} "{f"&e{i - 1};" * 10 if i else "ha"}">' for i in range(levels)
    )
    return MVNX.replace("?>\n", f"?>\n<!DOCTYPE mvnx [{entities}]>\n").replace(
        "1 2 10<", f"&e{levels - 1};<"
    )


DECLARED = "^a.mvnx, line 2: got declarations of its own "


@pytest.mark.parametrize(
    "content",
    [
        bomb(1),
        bomb(12),
        MVNX.replace("?>\n", f'?>\n<!DOCTYPE mvnx [<!ENTITY e "{"ha" * 10**5}">]>\n').replace(
            "1 2 10<", "&e;" * 10**4 + "<"
        ),
        MVNX.replace("?>\n", f'?>\n<!DOCTYPE mvnx [<!ATTLIST frame x CDATA "{"ha" * 10**5}">]>\n'),
        MVNX.replace("?>\n", '?>\n<!DOCTYPE mvnx [<!ENTITY e SYSTEM "/etc/passwd">]>\n'),
        bomb(12).replace("UTF-8", "UTF-16").encode("utf-16"),
    ],
)
def test_declarations_are_refused_before_they_grow(content: str | bytes, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mvnx", content)
    tracemalloc.start()
    try:
        refused(read_mvnx, path, DECLARED)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def twice(label: str) -> str:
    """A second person, who is 1 m farther to the left and has no frame 1."""
    begin, end = MVNX.index("  <subject"), MVNX.index("</mvnx>")
    other = MVNX[begin:end].replace("Somebody", label).replace(mvnx_frame(1), "")
    return MVNX[:end] + other.replace("<position>2 0 1", "<position>2 1 1") + MVNX[end:]


def test_two_people(tmp_path: Path) -> None:
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", twice("B")))
    assert motion.names == ("Somebody:Pelvis", "Somebody:L5", "B:Pelvis", "B:L5")
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    np.testing.assert_array_equal(
        motion.positions[2], [[2, 0, 1], [2, 0.5, 1.5], [2, 1, 1], [2, 0.5, 1.5]]
    )
    assert np.isnan(motion.positions[1, 2:]).all()
    assert not np.isnan(motion.positions[:, :2]).any()
    assert np.isnan(motion.turns["B:L5"]).all(axis=1).tolist() == [False, True, False]
    assert motion.turns["B:L5"][2] == pytest.approx([0, 0, 0.6, 0.8])
    assert motion.angles["B:jL5S1 flexion"][[0, 2]] == pytest.approx(np.radians([0, 20]))
    assert motion.notes == (UNIFORM, f"Somebody: {POSED}", f"B: {POSED}")


BROKEN = {
    "empty": ("", "^a.mvnx, line 1: no XML at column 1 .*; the file is cut or damaged"),
    "other": ("HIERARCHY\n", "^a.mvnx, line 1: no XML at column 1 "),
    "other XML": ("<a><b/></a>", "^a.mvnx: got no segments, allowed an MVNX file with a subject"),
    "cut in an element": (MVNX[: MVNX.rindex("<position") + 4], r"^a.mvnx, line 29: no XML"),
    "cut in a text": (MVNX[: MVNX.rindex("</position")], r"^a.mvnx, line 29: no XML"),
    "cut in the head": (MVNX[:200], "^a.mvnx, line 5: no XML"),
    "cut behind the frames": (MVNX[: MVNX.rindex("</subject")], "^a.mvnx, line 33: no XML"),
    "an entity": (MVNX.replace("Somebody", "&who;"), "^a.mvnx, line 3: no XML"),
    "no subject": (
        MVNX.replace("<subject", "<object").replace("</subject", "</object"),
        "^a.mvnx: got no segments, allowed an MVNX file with a subject",
    ),
    "somebody without segments": (
        MVNX.replace("  </subject>", '  </subject><subject label="B" frameRate="10"/>'),
        "^a.mvnx: got no segments, allowed an MVNX file with a subject",
    ),
    "people of one name": (
        twice("Somebody"),
        "^a.mvnx: got 2 people with the labels 'Somebody', 'Somebody', allowed a different name",
    ),
    "somebody without a name": (twice(""), "^a.mvnx: got 2 people with the labels 'Somebody', ''"),
    "two rates": (
        twice("B").replace('"B" frameRate="10"', '"B" frameRate="20"'),
        "^a.mvnx: got people with 10, 20 frames per second, allowed the same for all",
    ),
    "frames and no segments": (
        MVNX.replace("segments>", "things>").replace("1 0 0 0 0.8 0 0 0.6", ""),
        "^a.mvnx: got no segments, allowed an MVNX file with a subject",
    ),
    "no frames": (MVNX.replace("normal", "tpose"), "^a.mvnx: got no frame of movement, allowed"),
    "no rate": (MVNX.replace("frameRate", "rate"), "^a.mvnx: frameRate: got '', allowed frames"),
    "rate 0": (MVNX.replace('frameRate="10"', 'frameRate="0"'), "frameRate: got '0', allowed"),
    "rate nan": (
        MVNX.replace('frameRate="10"', 'frameRate="nan"'),
        "frameRate: got 'nan', allowed",
    ),
    "a segment twice": (
        MVNX.replace('"L5"', '"Pelvis"'),
        "got the segment 'Pelvis' twice, allowed",
    ),
    "a nameless segment": (MVNX.replace('label="L5"', ""), "got the segment '' without a name"),
    "a segment behind": (
        MVNX.replace("</frames>", '</frames><segments><segment label="T8"/></segments>'),
        "got the segment 'T8' after a frame, allowed each once and before the frames",
    ),
    "a joint behind": (
        MVNX.replace("</frames>", '</frames><joints><joint label="jT8"/></joints>'),
        "got the joint 'jT8' after a frame",
    ),
    "few numbers": (
        MVNX.replace("1 0.5 1.5", "1.5"),
        "^a.mvnx: frame '1': got 4 words for position, allowed 6 numbers",
    ),
    "no place": (
        MVNX.replace("position>", "velocity>"),
        "frame '0': got 0 words for position, allowed 6 numbers",
    ),
    "some without angles": (
        MVNX.replace("<jointAngle>1 2 10</jointAngle>", ""),
        r"got joint angles \(jointAngle\) in some of the frames, allowed in all or none",
    ),
    "a word": (
        MVNX.replace("1 2 10", "1 two 10"),
        "frame '1': got 'two' among 3 words for jointAngle",
    ),
    "joined digits": (MVNX.replace("1 2 10", "1 2 1_0"), "frame '1': got '1_0' among 3 words"),
    "too large": (MVNX.replace("1 2 10", "1 2 1e300"), "frame '1': got '1e300' among 3 words"),
    "no index": (
        MVNX.replace('index="1"', ""),
        "got a frame with the index 'None', allowed a whole",
    ),
    "index ²": (MVNX.replace('index="1"', 'index="²"'), "got a frame with the index '²', allowed"),
    "index --1": (MVNX.replace('index="1"', 'index="--1"'), "got a frame with the index '--1'"),
    "a long index": (
        MVNX.replace('index="1"', f'index="{"9" * 5000}"'),
        "time runs backwards from frame 2 to 3",
    ),
    "time back": (MVNX.replace('index="1"', 'index="7"'), "time runs backwards from frame 2 to 3"),
    "deep": (ROOT + "<a>" * 10**5, "got elements nested too deeply"),
    "a long prolog": (
        MVNX.replace("?>\n", f"?>\n<!-- {'x' * (2 << 20)} -->\n"),
        "1 MB stand above the first element; this is no MVNX file",
    ),
    "a long name": (
        MVNX.replace("Somebody", "x" * (20 << 20)),
        "no element begins or ends in 16 MB; this is no MVNX file",
    ),
    "unknown encoding": (MVNX.replace("UTF-8", "klingon"), "line 1: got .*, allowed"),
    "wide encoding": (MVNX.replace("UTF-8", "shift_jis"), "line 1: got an encoding that is not"),
    "not UTF-8": (MVNX.replace("Somebody", "Jürgen").encode("latin-1"), "line 3: no XML"),
    "garbage": (bytes(range(256)) * 20, "line 1: no XML at column 1 "),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    refused(read_mvnx, write(tmp_path / "a.mvnx", content), sentence)


def test_places_that_are_no_file(tmp_path: Path) -> None:
    refused(read_mvnx, tmp_path / "missing.mvnx", "no such file")
    refused(read_mvnx, tmp_path, "is not a file")
    refused(read_mvnx, tmp_path / ("x" * 5000), "cannot be read")


@pytest.mark.slow
def test_frames_are_let_go_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mvnx, "_BLOCK", 100)
    monkeypatch.setattr(mvnx, "_CHUNK", 1 << 14)
    frames = "".join(map(mvnx_frame, range(3, 3003)))
    path = write(tmp_path / "a.mvnx", MVNX.replace("    </frames>", frames + "    </frames>"))
    tracemalloc.start()
    try:
        assert len(read(read_mvnx, path).time) == 3003
        assert tracemalloc.get_traced_memory()[1] < 1.5e6
    finally:
        tracemalloc.stop()


def test_the_file_of_another(shared: Path) -> None:
    path = shared / "mocap" / "mvnx" / "xsens_kicking_part1.mvnx"
    motion = read(read_mvnx, path)
    space = {"m": "http://www.xsens.com/mvn/mvnx"}
    tree = ElementTree.parse(path)
    segments = [str(e.get("label")) for e in tree.findall(".//m:segments/m:segment", space)]
    joints = [str(e.get("label")) for e in tree.findall(".//m:joints/m:joint", space)]
    frames = [f for f in tree.findall(".//m:frame", space) if f.get("type") == "normal"]

    def numbers(what: str, width: int) -> np.ndarray:
        texts = [str(frame.findtext(f"m:{what}", None, space)) for frame in frames]
        return np.array([text.split() for text in texts], float).reshape(len(frames), -1, width)

    assert (len(frames), len(segments), len(joints)) == (180, 23, 22)
    assert motion.names == tuple(segments)
    np.testing.assert_array_equal(motion.positions, numbers("position", 3).astype(np.float32))
    turns = numbers("orientation", 4)
    for i, name in enumerate(segments):
        expected = Rotation.from_quat(turns[:, i], scalar_first=True)
        turned = Rotation.from_quat(motion.turns[name]) * expected.inv()
        assert turned.magnitude() == pytest.approx(0, abs=1e-5)
    angles = np.radians(numbers("jointAngle", 3))
    for i, joint in enumerate(joints):
        for j, axis in enumerate(("abduction", "rotation", "flexion")):
            assert motion.angles[f"{joint} {axis}"] == pytest.approx(angles[:, i, j], abs=1e-6)
    assert motion.time == pytest.approx(np.arange(180) / 240)
    assert motion.notes[-1] == "2 calibration poses (N-pose, T-pose) of the file are left out."
