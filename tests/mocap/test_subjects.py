"""Whose joints and markers there are: people and things by the prefix of their names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_motions import walk
from ergoqp.arguments import unseen
from ergoqp.errors import InputError, RecordingError
from ergoqp.mocap.formats.c3d import read_c3d
from ergoqp.mocap.formats.text import TableOptions
from ergoqp.mocap.joints import of_subject
from ergoqp.mocap.naming import CENTRES
from ergoqp.mocap.recording import JointMotion

COUNT = 60
HEAD_AND_TRUNK = ("LFHD", "RFHD", "LBHD", "RBHD", "C7", "T10", "CLAV", "STRN")
MARKERS = (*HEAD_AND_TRUNK, "LSHO", "RSHO", "LASI", "RASI", "LPSI", "RPSI")
BOX = np.array([[0, 0, 0], [400, 0, 0], [400, 300, 0], [0, 300, 20], [200, 150, 250.0]])


def motion_of(names: list[str], seed: int = 0, **more: object) -> JointMotion:
    positions = np.random.default_rng(seed).normal(size=(COUNT, len(names), 3))
    return JointMotion(tuple(names), positions, np.arange(COUNT) / 10, **more)  # pyright: ignore


def whose(name: str, names: tuple[str, ...] = MARKERS) -> list[str]:
    return [f"{name}:{each}" for each in names]


def chosen(motion: JointMotion, subject: str | None = None) -> JointMotion:
    return of_subject(motion, subject, "take")


def with_thing(
    motion: JointMotion, name: str, points: np.ndarray, first: int | None = None
) -> JointMotion:
    """Return a motion with a thing's points (n, m, 3) behind the others or before them."""
    at = len(motion.names) if first is None else first
    names = [f"{name}:{i}" for i in range(points.shape[1])]
    places = [motion.positions[:, :at], points, motion.positions[:, at:]]
    joined = (*motion.names[:at], *names, *motion.names[at:])
    return replace(motion, names=joined, positions=np.concatenate(places, axis=1))


def carried(seed: int = 1, scale: float = 1.0) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """Return points (n, m, 3) of a box, its turns and where its middle is (n, 3) [mm]."""
    draw = np.random.default_rng(seed)
    steps = Rotation.from_rotvec(0.1 * draw.normal(size=(COUNT, 3)))
    turns = [Rotation.identity()]
    for step in list(steps)[1:]:
        turns.append(step * turns[-1])
    turn = Rotation.concatenate(turns)
    place = 1000 + np.cumsum(20 * draw.normal(size=(COUNT, 3)), axis=0)
    shape = scale * (BOX - BOX.mean(axis=0))
    return np.stack([turn.apply(p) for p in shape], axis=1) + place[:, None], turn, place


def test_one_person_without_a_name_is_left_as_it_is() -> None:
    motion = motion_of(list(MARKERS))
    assert chosen(motion) is motion
    nobody = motion_of([])
    assert chosen(nobody) is nobody
    with pytest.raises(InputError) as caught:
        chosen(motion, "Ann")
    sentence = "take: subject: got 'Ann', allowed None: there is no prefix"
    assert str(caught.value) == sentence


def test_one_person_with_a_name() -> None:
    # A skeleton's own prefix stays: a mapping file may have it.
    bones = motion_of(whose("mixamorig", CENTRES))
    assert chosen(bones) is bones
    assert chosen(motion_of(["walker:a", "walker:b"])).names == ("walker:a", "walker:b")
    # Marker sets are known without.
    for subject in (None, "Ann"):
        found = chosen(motion_of(whose("Ann")), subject)
        assert found.names == MARKERS
        assert found.notes == ("The person is 'Ann'.",)


def test_two_people_are_asked_for() -> None:
    motion = motion_of([*whose("Ann"), *whose("Bob")])
    with pytest.raises(RecordingError) as caught:
        chosen(motion)
    assert str(caught.value) == (
        "take: got 2 people (Ann, Bob), allowed one; state the person whose posture is meant"
        " (subject)"
    )
    with pytest.raises(InputError) as unknown:
        chosen(motion, "ann")
    assert str(unknown.value) == "take: subject: got 'ann', allowed 'Ann', 'Bob'"
    unnamed = motion_of([*MARKERS, *whose("Bob")])
    with pytest.raises(RecordingError, match=r"got 2 people \(without a name, Bob\), allowed one"):
        chosen(unnamed)


def test_a_great_many_people_are_one_sentence() -> None:
    motion = motion_of([name for i in range(30) for name in whose(f"{i}" * 50)])
    with pytest.raises(RecordingError) as caught:
        chosen(motion)
    assert len(str(caught.value)) < 800


@pytest.mark.parametrize("subject", ["Ann", "Bob"])
def test_a_person_is_chosen(subject: str) -> None:
    turns = {"Ann:C7": np.zeros((COUNT, 4)), "Bob:C7": np.ones((COUNT, 4))}
    names = [*whose("Ann"), *whose("Bob")]
    motion = motion_of(names, rest=np.arange(84.0).reshape(28, 3), notes=("Said.",), turns=turns)
    found, at = chosen(motion, subject), names.index(f"{subject}:LFHD")
    assert found.names == MARKERS
    np.testing.assert_array_equal(found.positions, motion.positions[:, at : at + 14])
    assert found.rest is not None
    np.testing.assert_array_equal(found.rest, motion.rest[at : at + 14])  # pyright: ignore
    assert set(found.turns) == {"C7"}
    np.testing.assert_array_equal(found.turns["C7"], turns[f"{subject}:C7"])
    assert dict(found.objects) == {}
    other = "Bob" if subject == "Ann" else "Ann"
    assert found.notes == (
        f"The person is {subject!r}.",
        f"Also in the recording, and left out: '{other}'.",
        "Said.",
    )


def test_what_has_no_name_belongs_to_the_person() -> None:
    motion = motion_of([*whose("Ann"), "CLAV", "box 1", *whose("Bob")])
    found = chosen(motion, "Ann")
    # But what the person has too is somebody else's.
    assert sorted(found.names) == sorted((*MARKERS, "box 1"))
    assert len(set(found.names)) == len(found.names)
    np.testing.assert_array_equal(found.of("CLAV"), motion.of("Ann:CLAV"))


def test_a_part_of_a_person_is_nobody() -> None:
    # A hand of somebody else, and markers too few to be a person.
    motion = motion_of([*whose("Ann"), *whose("Bob", MARKERS[:5])])
    assert chosen(motion).names == MARKERS
    few = motion_of([*whose("Ann", MARKERS[:5]), *whose("Bob", MARKERS[5:9])])
    assert chosen(few) is few
    assert chosen(few, "Bob").names == MARKERS[5:9]


@pytest.mark.parametrize("first", [None, 0, 7])
@pytest.mark.parametrize("scale", [0.1, 1.0, 0.001, 100.0])
def test_a_thing_with_a_name_becomes_an_object(first: int | None, scale: float) -> None:
    points, turn, _ = carried(scale=scale)
    found = chosen(with_thing(motion_of(whose("Ann")), "box", points, first))
    assert found.names == MARKERS
    assert found.notes == (
        "The person is 'Ann'.",
        "box is an object of 5 markers: its origin is their middle, and its axes are the file's"
        " axes in the first frame in which it is seen.",
    )
    poses = found.objects["box"]
    np.testing.assert_allclose(poses[:, :3, 3], points.mean(axis=1), rtol=1e-6)
    for i in range(COUNT):
        # Independently: the turn that brings the first frame's points to this frame's.
        away = [points[j] - points[j].mean(axis=0) for j in (i, 0)]
        theirs = Rotation.align_vectors(away[0], away[1])[0]
        assert (Rotation.from_matrix(poses[i, :3, :3]) * theirs.inv()).magnitude() < 1e-6
        assert (theirs * (turn[i] * turn[0].inv()).inv()).magnitude() < 1e-6
    np.testing.assert_array_equal(poses[:, 3], np.tile([0, 0, 0, 1], (COUNT, 1)))


def test_a_thing_of_which_something_is_lost_or_astray() -> None:
    points, turn, place = carried()
    draw = np.random.default_rng(4)
    points[draw.integers(COUNT, size=20), draw.integers(5, size=20)] = np.nan
    points[0, 1] = np.nan  # the first whole frame is another
    points[7] = np.nan
    points[9, :3] = np.nan
    points[11, 4] += 5000.0  # another marker's place
    found = chosen(with_thing(motion_of(whose("Ann")), "box", points))
    poses = found.objects["box"]
    lost = np.isfinite(points).all(axis=2).sum(axis=1) < 3
    assert lost[7]
    np.testing.assert_array_equal(np.isnan(poses[:, 0, 0]), lost)
    np.testing.assert_allclose(poses[~lost, :3, 3], place[~lost], atol=1e-3)
    for i in np.flatnonzero(~lost).tolist():
        right = turn[i] * turn[0].inv()
        assert (Rotation.from_matrix(poses[i, :3, :3]) * right.inv()).magnitude() < 1e-5


@pytest.mark.parametrize(
    "points",
    [
        carried()[0][:, :2],  # two points
        np.full((COUNT, 4, 3), np.nan),  # never seen
        np.where(np.arange(4)[:, None] < 2, carried()[0][:, :4], np.nan),  # two seen
        np.arange(4.0)[:, None] * np.ones(3) + np.zeros((COUNT, 1, 1)),  # in a line
        np.zeros((COUNT, 4, 3)),  # in one place
    ],
)
def test_what_shows_no_pose_is_told(points: np.ndarray) -> None:
    found = chosen(with_thing(motion_of(whose("Ann")), "box", points))
    assert found.names == MARKERS
    assert dict(found.objects) == {}
    assert "Also in the recording, and left out: 'box'." in found.notes


def test_somebody_of_whom_little_is_seen_is_no_thing() -> None:
    """Who stands still is known by the names, who moves by not keeping a shape."""
    places = walk()[0]
    few = ("pelvis", "neck", "right_shoulder", "right_elbow", "right_wrist", "right_hip")
    few = (*few, "right_knee")
    whole = np.stack([places[c] for c in CENTRES if c in places], axis=1)
    moving = np.stack([places[c] for c in few], axis=1)
    count = len(moving)
    for names, points in (
        (few, moving),
        (few, np.tile(moving[:1], (count, 1, 1))),
        (tuple("abcdefg"), moving),
    ):
        joints = [*whose("Ann", tuple(c for c in CENTRES if c in places)), *whose("Bob", names)]
        positions = np.concatenate([whole, points], axis=1)
        found = chosen(JointMotion(tuple(joints), positions, np.arange(count) / 10))
        assert dict(found.objects) == {}
        assert "Also in the recording, and left out: 'Bob'." in found.notes


def test_a_marker_that_fell_off_a_thing_is_no_other_thing() -> None:
    points, _, place = carried()
    points[2 * COUNT // 3 :, 1] = [9000, 9000, 0]
    poses = chosen(with_thing(motion_of(whose("Ann")), "box", points)).objects["box"]
    np.testing.assert_allclose(poses[-1, :3, 3] - place[-1], 0, atol=1.0)


@pytest.mark.parametrize("mark", [":", "/"])
def test_colons_and_slashes_are_marks_of_a_prefix(mark: str) -> None:
    names = [f"{who}{mark}{name}" for who in ("/lab/Ann", "Bob") for name in MARKERS]
    motion = motion_of(names)
    with pytest.raises(RecordingError, match=r"got 2 people \(lab/Ann, Bob\), allowed one"):
        chosen(motion)
    for subject in ("lab/Ann", "/lab/Ann", f"lab/Ann{mark}"):
        found = chosen(motion, subject)
        assert found.names == MARKERS
        np.testing.assert_array_equal(found.positions, motion.positions[:, : len(MARKERS)])
    alone = chosen(motion_of([f"{mark}{name}" for name in MARKERS]))
    assert alone.names == MARKERS
    assert alone.notes == ()


def test_one_marker_of_a_thing_is_never_seen() -> None:
    points, turn, _ = carried()
    points[:, 2] = np.nan
    poses = chosen(with_thing(motion_of(whose("Ann")), "box", points)).objects["box"]
    for i in range(COUNT):
        right = turn[i] * turn[0].inv()
        assert (Rotation.from_matrix(poses[i, :3, :3]) * right.inv()).magnitude() < 1e-5


def test_an_object_that_the_file_has_ready_stays() -> None:
    ready = {"box": np.tile(np.eye(4), (COUNT, 1, 1)), "lid": np.zeros((COUNT, 4, 4))}
    motion = motion_of(whose("Ann"), objects=ready)
    found = chosen(with_thing(motion, "box", carried()[0]))
    assert found.objects["box"] is ready["box"]
    assert set(found.objects) == {"box", "lid"}
    assert found.notes == ("The person is 'Ann'.",)


def test_single_precision_and_long_recordings() -> None:
    points, turn, place = carried()
    many = 400
    motion = motion_of(whose("Ann"))
    motion = replace(
        with_thing(motion, "box", points),
        positions=np.tile(with_thing(motion, "box", points).positions, (many, 1, 1)).astype("f4"),
        time=np.arange(many * COUNT) / 10,
    )
    poses = chosen(motion).objects["box"]
    assert poses.shape == (many * COUNT, 4, 4)
    np.testing.assert_allclose(poses[:, :3, 3], np.tile(place, (many, 1)), atol=0.01)
    right = (turn[COUNT - 1] * turn[0].inv()).as_matrix()
    np.testing.assert_allclose(poses[COUNT - 1 :: COUNT, :3, :3] - right, 0, atol=1e-4)


def test_the_person_and_the_box_of_a_handling_study(shared: Path) -> None:
    path = shared / "mocap" / "c3d" / "pyomeca_box_handling.c3d"
    motion = read_c3d(path, unseen, TableOptions())
    found = chosen(motion)
    assert all(":" not in name for name in found.names)
    assert len(found.names) == 43
    assert list(found.objects) == ["boite"]
    poses, names = found.objects["boite"], [n for n in motion.names if n.startswith("boite:")]
    points = np.stack([motion.of(name) for name in names], axis=1).astype(float)
    whole = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))
    for i in whole[::20]:
        away = [points[j] - points[j].mean(axis=0) for j in (i, whole[0])]
        theirs = Rotation.align_vectors(away[0], away[1])[0]
        turn = Rotation.from_matrix(poses[i, :3, :3] @ poses[whole[0], :3, :3].T)
        assert np.degrees((turn * theirs.inv()).magnitude()) < 1.5
        assert np.linalg.norm(poses[i, :3, 3] - points[i].mean(axis=0)) < 5


def test_another_person_under_unknown_names_is_not_followed_as_a_thing() -> None:
    theirs = tuple(f"J{i}" for i in range(60))
    motion = motion_of([*whose("Ann", theirs), *whose("Bob", theirs), *whose("Eve", theirs[:20])])
    start = process_time()
    found = chosen(motion, "Ann")
    assert process_time() - start < 1.0
    assert found.names == theirs
    assert found.notes[1] == "Also in the recording, and left out: 'Bob', 'Eve'."


def test_many_points_of_others_end_soon() -> None:
    motion = with_thing(motion_of(whose("Ann")), "crowd", 100 * motion_of(["x"] * 60).positions)
    start = process_time()
    assert not chosen(motion, "Ann").objects
    assert process_time() - start < 5.0
    _, turn, place = carried()
    shape = np.random.default_rng(3).normal(scale=200.0, size=(30, 3))
    box = np.stack([turn.apply(point) for point in shape], axis=1) + place[:, None]
    found = chosen(with_thing(motion_of(whose("Ann")), "box", box), "Ann")
    assert "box is an object of 30 markers (10 of them are followed): its" in found.notes[1]
    assert set(found.objects) == {"box"}
