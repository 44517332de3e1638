"""From a file to postures: the project's own recording, read back; what is found out and said about
a file."""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_motions import RATE, fitted, stoop, walk
from ergoqp import JOINTS
from ergoqp.errors import InputError, RecordingError
from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.mocap import Recording, fit_postures, load_recording
from ergoqp.mocap.fitting.axes import UPS, axes_of
from ergoqp.mocap.formats.bvh import write_bvh

DEGREE = np.radians(1)


def movement(frames: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Smooth postures far from straight limbs, and a pelvis that walks along an arc."""
    generator = np.random.default_rng(7)
    middle = np.radians(
        [20, 5, 5, 15, 3, 8, *2 * [40, 25, 15, 70, 10, 5, 4], *2 * [40, 10, 8, 60, 5, 6]]
    )
    amplitude = np.radians(
        [12, 6, 8, 8, 5, 10, *2 * [20, 15, 12, 25, 25, 15, 8], *2 * [15, 7, 8, 20, 8, 6]]
    )
    phase = generator.uniform(0, 2 * np.pi, len(JOINTS))
    time = np.linspace(0, 2 * np.pi, frames)[:, None]
    postures = middle + amplitude * np.sin(time + phase)
    heading = 2.5 + np.linspace(0, 2, frames)
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(heading)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(heading), -np.sin(heading)
    poses[:, :3, 3] = np.stack(
        [np.cos(heading), np.sin(heading), 0.9 + 0.02 * np.sin(time[:, 0])], axis=1
    )
    return postures, poses


def edited(source: Path, target: Path, *changes: tuple[str, str]) -> Path:
    text = source.read_text()
    for old, new in changes:
        text = re.sub(old, new, text)
    target.write_text(text)
    return target


def told(recording: Recording) -> str:
    return " ".join(recording.assumptions)


def test_what_was_written_is_read_back(tmp_path: Path):
    postures, poses = movement()
    body = Body.of_lengths(
        {"upper_arm": 0.33, "forearm": 0.24, "thigh": 0.40, "shank": 0.42, "trunk": 0.50}
    )
    path = write_bvh(tmp_path / "own.bvh", postures, poses, body, 1 / 50)
    recording = load_recording(path)
    assert recording.observed.all()
    assert recording.postures.shape == recording.observed.shape == (60, 32)
    assert np.abs(recording.postures - postures).max() < DEGREE
    assert np.abs(recording.base_poses[:, :3, 3] - poses[:, :3, 3]).max() < 0.002
    assert np.abs(recording.base_poses[:, :3, :3] - poses[:, :3, :3]).max() < DEGREE
    assert recording.fit_error.max() < 0.002
    assert recording.time == pytest.approx(np.arange(60) / 50)
    assert recording.object_poses is None
    for segment in (
        "upper_arm",
        "forearm",
        "thigh",
        "shank",
        "trunk",
        "shoulder_width",
        "foot_length",
    ):
        assert recording.person.lengths[segment] == pytest.approx(body.lengths[segment], abs=1e-4)


def test_a_quarter_turn_in_the_middle_of_the_rotation_order_is_written_right(tmp_path: Path):
    postures, poses = movement(3)
    postures[1, INDEX["left_elbow_flexion"]] = np.pi / 2
    postures[1, INDEX["left_forearm_pronation"]] = 0.0
    recording = load_recording(
        write_bvh(tmp_path / "turn.bvh", postures, poses, Body.of_stature(1.75), 0.1)
    )
    assert recording.fit_error.max() < 0.001


def test_the_demo_recording_is_a_stooped_screwdriver(demo: Path):
    recording = load_recording(demo)
    assert len(recording.time) == 181
    assert recording.time[-1] == pytest.approx(6.0)
    assert recording.person.stature == pytest.approx(1.72, abs=1e-4)
    assert recording.fit_error.max() < 0.001
    stroke = np.degrees(recording.postures[70:, INDEX["right_forearm_pronation"]])
    assert np.ptp(stroke) == pytest.approx(75, abs=2)
    assert np.degrees(recording.postures[-1, INDEX["trunk_flexion"]]) == pytest.approx(46, abs=1)
    kinematics = Kinematics(recording.person)
    for posture, pose in zip(recording.postures, recording.base_poses, strict=True):
        sole = np.array(kinematics.at("left_sole", ca.DM(posture))[0]).ravel()
        assert abs(pose[2, 3] + sole[2]) < 0.004  # on the floor


def test_ranges_are_kept_exactly_even_where_the_recording_goes_beyond(tmp_path: Path):
    postures, poses = movement(20)
    postures[:, INDEX["trunk_flexion"]] = np.radians(118)
    postures[:, INDEX["right_hip_abduction"]] = np.radians(60)
    recording = load_recording(
        write_bvh(tmp_path / "beyond.bvh", postures, poses, Body.of_stature(1.7), 0.1)
    )
    assert (recording.postures >= LOWER).all()
    assert (recording.postures <= UPPER).all()
    assert recording.fit_error.max() > 0.01


def seen_at_all(recording: Recording) -> np.ndarray:
    """Return the joints that are seen at some time (32,) bool."""
    return recording.observed.any(axis=0)


def test_a_missing_arm_is_not_invented(demo: Path, tmp_path: Path):
    # Under names that no naming has, the joints are as good as gone.
    path = edited(
        demo, tmp_path / "one_arm.bvh", (r"right_(elbow|wrist|knuckles|thumb)", r"extra_\1")
    )
    recording = load_recording(path)
    arm = [
        i for i, name in enumerate(JOINTS) if re.match("right_(shoulder|elbow|forearm|wrist)", name)
    ]
    assert not recording.observed[:, arm].any()
    assert (recording.postures[:, arm] == 0).all()
    assert seen_at_all(recording)[[i for i in range(32) if i not in arm]].all()
    assert recording.seen.all()
    for joint in arm:
        assert JOINTS[joint].replace("_", " ") in told(recording)
    assert recording.fit_error.max() < 0.001


def test_what_the_points_do_not_tell_is_unobserved(demo: Path, tmp_path: Path):
    path = edited(
        demo,
        tmp_path / "few.bvh",
        (r"(nose|right_thumb|left_knuckles|left_toe|left_thumb)", r"extra_\1"),
    )
    recording = load_recording(path)
    seen = seen_at_all(recording)
    missing = {name for name, each in zip(JOINTS, seen, strict=True) if not each}
    assert recording.seen.all()
    assert missing == {
        "neck_twist",
        "right_forearm_pronation",
        "left_forearm_pronation",
        "left_wrist_flexion",
        "left_wrist_deviation",
        "left_ankle_flexion",
        "left_ankle_inversion",
    }


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001, 0.0254, 0.056444])
def test_the_unit_is_found_by_the_stature(unit: float, demo: Path, tmp_path: Path):
    recording = load_recording(scaled(demo, tmp_path / "scaled.bvh", 0.01 / unit))
    assert recording.person.stature == pytest.approx(1.72, abs=2e-3)
    assert f"{unit:g} m" in told(recording)


def scaled(source: Path, target: Path, factor: float) -> Path:
    """The same movement in another unit of length."""
    lines = []
    for line in source.read_text().splitlines():
        words = line.split()
        if words[0] == "OFFSET":
            words[1:] = [f"{float(word) * factor:.9g}" for word in words[1:]]
        elif len(words) > 20:
            words[:3] = [f"{float(word) * factor:.9g}" for word in words[:3]]
        lines.append(" ".join(words))
    target.write_text("\n".join(lines))
    return target


def test_a_unit_that_fits_nobody_is_asked_for(demo: Path, tmp_path: Path):
    path = scaled(demo, tmp_path / "feet.bvh", 0.01 / 0.3048)
    with pytest.raises(RecordingError, match=r"feet.bvh: the unit of length is unknown.*unit_to_m"):
        load_recording(path)
    assert load_recording(path, unit_to_m=0.3048).person.stature == pytest.approx(1.72, abs=2e-3)
    with pytest.raises(RecordingError, match=r"with a unit of 1 m, stature.*check unit_to_m"):
        load_recording(path, unit_to_m=1.0)


def test_the_vertical_axis_is_found_and_may_be_stated(demo: Path, tmp_path: Path):
    # The same numbers with z up: y becomes z, z becomes x, x becomes y, in offsets, positions and
    # turns.
    text = demo.read_text()
    for axis, other in (
        ("Xpos", "ypos"),
        ("Ypos", "zpos"),
        ("Zpos", "xpos"),
        ("Xrot", "yrot"),
        ("Yrot", "zrot"),
        ("Zrot", "xrot"),
    ):
        text = text.replace(axis, other)
    text = re.sub(r"\b([xyz])(?=pos|rot)", lambda axis: axis[1].upper(), text)
    text = re.sub(r"OFFSET (\S+) (\S+) (\S+)", r"OFFSET \3 \1 \2", text)
    path = tmp_path / "z_up.bvh"
    path.write_text(text)
    expected = load_recording(demo)
    for recording in (load_recording(path), load_recording(path, up="z")):
        assert np.abs(recording.postures - expected.postures).max() < DEGREE
    assert "although the head is above the feet along z" in told(load_recording(path, up="y"))


@pytest.mark.parametrize("up", UPS)
def test_any_axis_may_be_vertical(up: str):
    places, _ = walk()
    turned = {centre: path @ axes_of(up) for centre, path in places.items()}
    for stated in (None, up):
        recording = fitted(turned, up=stated)
        plain = fitted(places)
        np.testing.assert_allclose(recording.postures, plain.postures, atol=1e-9)
        assert recording.base_poses[:, 2, 3] == pytest.approx(plain.base_poses[:, 2, 3])
    assert np.linalg.det(axes_of(up)) == pytest.approx(1)


@pytest.mark.parametrize("tilt", [12.0, 25.0, 40.0])
def test_a_tilted_camera_is_told_by_people_who_stand(tilt: float):
    both = [
        np.concatenate(each)
        for each in zip(*(p.values() for p in (walk()[0], stoop()[0])), strict=True)
    ]
    places = dict(zip(walk()[0], both, strict=True))
    camera = Rotation.from_euler("yx", [tilt, tilt / 3], degrees=True).as_matrix()
    turned = {centre: path @ camera for centre, path in places.items()}
    recording, plain = fitted(turned, up=None), fitted(places)
    assert "The camera is taken to be tilted" in told(recording)
    trunk = INDEX["trunk_flexion"]
    np.testing.assert_allclose(
        recording.postures[:, trunk], plain.postures[:, trunk], atol=np.radians(4)
    )
    # Somebody who stoops all the time is no camera.
    assert "The camera is taken" not in told(fitted(stoop(deepest=60.0, stands=False)[0], up=None))


def test_a_window_is_read_alone(demo: Path):
    recording, every = load_recording(demo, window=(2.0, 3.0)), load_recording(demo)
    inside = (every.time >= 1.999) & (every.time <= 3.001)
    assert recording.time == pytest.approx(every.time[inside])
    np.testing.assert_allclose(recording.postures, every.postures[inside], atol=DEGREE)


def test_joint_centres_at_hand_are_fitted_in_any_order():
    places, _ = walk(1.0)
    plain = fitted(places)
    names = list(np.random.default_rng(0).permutation(list(places)))
    mixed = fit_postures(names, np.stack([places[name] for name in names], axis=1), RATE)
    np.testing.assert_array_equal(mixed.postures, plain.postures)
    cm = fit_postures(
        names, np.stack([100 * places[n] for n in names], axis=1), RATE, unit_to_m=None
    )
    np.testing.assert_allclose(cm.postures, plain.postures, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((["neck"], np.zeros((3, 2, 3)), 50.0), r"positions: got numbers of shape \(3, 2, 3\)"),
        ((["neck", "neck"], np.zeros((3, 2, 3)), 50.0), "a name twice"),
        ((["neck"], "me", 50.0), "positions: got 'me'"),
        ((["neck"], np.zeros((0, 1, 3)), 50.0), r"shape \(0, 1, 3\), allowed"),
        ((["neck"], np.zeros((3, 1, 3)), 0.0), "rate: got 0"),
        ((["neck"], np.full((3, 1, 3), np.inf), 50.0), "positions with infinite numbers"),
        (([], np.zeros((3, 0, 3)), 50.0), r"names: got \[\]"),
        ((["nape"], np.zeros((3, 1, 3)), 50.0), "whose names are unknown"),
    ],
)
def test_arrays_that_are_none_are_told(arguments: tuple, said: str):
    with pytest.raises((InputError, RecordingError), match=said):
        fit_postures(*arguments)


def test_the_person_may_be_stated(demo: Path, tmp_path: Path):
    assert load_recording(demo, person=1.80).person.stature == 1.80
    assert load_recording(demo, person=1.80).fit_error.mean() > 0.005
    file = tmp_path / "person.toml"
    file.write_text("stature = 1.66\nmass = 58\n[lengths]\nupper_arm = 0.31\n")
    body = load_recording(demo, person=file).person
    assert (body.stature, body.mass, body.lengths["upper_arm"]) == (1.66, 58, 0.31)
    file.write_text("[lengths]\nthigh = 0.41\nshank = 0.41\n")
    assert load_recording(demo, person=str(file)).person.lengths["thigh"] == 0.41


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("stature = 'tall'", "stature: got 'tall', allowed a number"),
        ("stature = nan", "stature: got nan m, allowed 1.2 to 2.3 m"),
        ("height = 1.7", r"got \['height'\]"),
        ("mass = 70", "required are a stature"),
        ("lengths = 3", "allowed a table of segments"),
        ("[lengths]\nwing = 0.3", "wing"),
        ("stature 1.7", "not a TOML file"),
    ],
)
def test_a_wrong_person_file_is_told(content: str, said: str, demo: Path, tmp_path: Path):
    file = tmp_path / "person.toml"
    file.write_text(content)
    with pytest.raises(InputError, match=said):
        load_recording(demo, person=file)


@pytest.mark.parametrize(
    "wrong",
    [
        {"person": 17.5},
        {"person": True},
        {"person": "no.toml"},
        {"unit_to_m": -1.0},
        {"unit_to_m": float("nan")},
        {"unit_to_m": "cm"},
        {"up": "w"},
        {"window": (2.0, 1.0)},
        {"window": (1.0,)},
        {"window": (0.0, float("nan"))},
        {"window": (50.0, 60.0)},
    ],
)
def test_wrong_arguments_are_told(wrong: dict, demo: Path):
    with pytest.raises(InputError):
        load_recording(demo, **wrong)


def test_an_unknown_skeleton_needs_a_mapping(demo: Path, tmp_path: Path):
    path = edited(demo, tmp_path / "own.bvh", (r"(ROOT|JOINT) (\w+)", r"\1 x_\2_joint"))
    with pytest.raises(RecordingError, match=r"names are unknown.*x_pelvis_joint.*mapping"):
        load_recording(path)
    mapping = tmp_path / "mapping.toml"
    names = (
        "neck",
        "head",
        "right_shoulder",
        "left_shoulder",
        "right_elbow",
        "right_wrist",
        "right_hip",
        "left_hip",
    )
    mapping.write_text("".join(f'{name} = "x_{name}_joint"\n' for name in names))
    recording = load_recording(path, mapping=mapping)
    expected = load_recording(demo)
    for joint in ("trunk_flexion", "neck_flexion", "right_shoulder_flexion", "right_elbow_flexion"):
        assert recording.observed[:, INDEX[joint]].all()
        assert (
            np.abs(recording.postures[:, INDEX[joint]] - expected.postures[:, INDEX[joint]]).max()
            < DEGREE
        )
    assert "right knee flexion" in told(recording)
    for line, said in (
        ('neck = "nobody"', "names nobody"),
        ('nape = "x_neck_joint"', "got the centre 'nape'"),
        ("neck = 1", "neck is 1"),
    ):
        mapping.write_text(line)
        with pytest.raises((RecordingError, InputError), match=said):
            load_recording(path, mapping=mapping)
    mapping.write_text('neck = ["x_right_shoulder_joint", "x_left_shoulder_joint"]')
    with pytest.raises(RecordingError, match="the pelvis cannot be placed"):
        load_recording(path, mapping=mapping)


@pytest.mark.parametrize("prefix", ["mixamorig:", "Character1_", "A:b_"])
def test_a_prefix_of_all_names_does_not_count(prefix: str, demo: Path, tmp_path: Path):
    path = edited(demo, tmp_path / "prefix.bvh", (r"(ROOT|JOINT) (\w+)", rf"\1 {prefix}\2"))
    recording, plain = load_recording(path), load_recording(demo)
    assert seen_at_all(recording).all()
    assert np.array_equal(recording.observed, plain.observed)
    assert np.array_equal(recording.postures, plain.postures)


def test_leaps_are_told(demo: Path, tmp_path: Path):
    lines = demo.read_text().splitlines()
    first_row = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    lines[first_row] = "500 " + lines[first_row].split(" ", 1)[1]
    path = tmp_path / "leap.bvh"
    path.write_text("\n".join(lines))
    assert "Between the frames 1 and 2 a joint moves by" in told(load_recording(path))
    assert "Between" not in told(load_recording(demo))


@pytest.mark.parametrize("name", ["recording.c3d", "recording", "recording.txt"])
def test_no_file_is_told(name: str, tmp_path: Path):
    with pytest.raises(RecordingError, match=r"no such file"):
        load_recording(tmp_path / name)


@pytest.mark.parametrize("name", ["recording.wav", "recording"])
def test_another_format_is_told(name: str, tmp_path: Path):
    (tmp_path / name).write_bytes(b"RIFF\0\0\0\0WAVE")
    with pytest.raises(RecordingError, match=r"got the ending.*content of no known.*allowed .bvh"):
        load_recording(tmp_path / name)


def test_a_folder_is_told(tmp_path: Path):
    with pytest.raises(RecordingError, match="is a folder"):
        load_recording(tmp_path)


def test_wrong_shapes_are_not_written(tmp_path: Path):
    postures, poses = movement(4)
    for wrong in (
        (postures[:, :31], poses, 0.1),
        (postures, poses[:3], 0.1),
        (postures * np.nan, poses, 0.1),
        (postures, poses, 0.0),
    ):
        with pytest.raises(InputError):
            write_bvh(tmp_path / "no.bvh", wrong[0], wrong[1], Body(), wrong[2])


@pytest.mark.slow
def test_progress_moves_from_begin_to_end(tmp_path: Path) -> None:
    poses, postures = np.tile(np.eye(4), (9000, 1, 1)), np.zeros((9000, 32))
    path = write_bvh(tmp_path / "long.bvh", postures, poses, Body(), 1 / RATE)
    told: list[float] = []
    load_recording(path, progress=told.append)
    assert len(told) >= 4
    assert told == sorted(told)
    assert max(np.diff([0.0, *told])) < 0.5
    assert told[-1] == 1
