"""Joint centres from OpenSim's angles: by other computations, by OpenSim itself, and fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ergoqp.arguments import unseen
from ergoqp.errors import RecordingError
from ergoqp.human import Body
from ergoqp.joints import INDEX
from ergoqp.mocap.formats.opensim import posed, read_storage
from ergoqp.mocap.formats.opensim_models import MODELS
from ergoqp.mocap.formats.text import TableOptions
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recording import JointMotion, Recording

FULL_BODY, THORACOSCAPULAR, _, UPPER_LIMB = MODELS

LENGTHS = Body().lengths
RIGHT_ARM = {"right_elbow", "right_wrist", "right_knuckles", "right_thumb"}


def motion(count: int = 1, **degrees: float | np.ndarray) -> JointMotion:
    """Angles in degrees, translations in metres, as if they were read from a file."""
    angles = {}
    for name, value in degrees.items():
        length = name.endswith(("_tx", "_ty", "_tz")) or "_trans" in name
        angles[name] = np.full(count, value) * (1.0 if length else np.pi / 180)
    time = np.arange(count) / 100
    return JointMotion((), np.empty((count, 0, 3)), time, angles=angles, unit=1.0, up="y")


def upright(**degrees: float | np.ndarray) -> JointMotion:
    """Of a whole body that stands straight but for some angles."""
    names = (
        *FULL_BODY.coordinates,
        *(f"{n[:-2]}_l" for n in FULL_BODY.coordinates if n[-2:] == "_r"),
    )
    count = max(np.size(value) for value in degrees.values()) if degrees else 1
    return motion(count, **{**dict.fromkeys(names, 0.0), **degrees})


def placed(given: JointMotion) -> dict[str, np.ndarray]:
    found = posed(given, "some.mot")
    return {name: found.of(name)[0] for name in found.names}


def bone(places: dict[str, np.ndarray], start: str, end: str) -> np.ndarray:
    way = places[end] - places[start]
    return way / np.linalg.norm(way)


def turned(angles: Mapping[str, np.ndarray], axes: str, *names: str, out: int = 1) -> Rotation:
    """By scipy's sequences: about x and y the left side is turned the other way (out = -1)."""
    turns = [
        angles[name] * (1 if axis == "Z" else out) for axis, name in zip(axes, names, strict=True)
    ]
    return Rotation.from_euler(axes, np.stack(turns, axis=1))


def test_a_standing_person_hangs_the_arms_and_has_the_palms_forward():
    places = placed(upright())
    for side, out in (("right", 1.0), ("left", -1.0)):
        limb = {name.removeprefix(f"{side}_"): place for name, place in places.items()}
        assert bone(places, "pelvis", "neck") == pytest.approx([0, 1, 0])
        assert bone(limb, "shoulder", "elbow") == pytest.approx([0, -1, 0])
        assert bone(limb, "hip", "knee") == pytest.approx([0, -1, 0])
        assert bone(limb, "knee", "ankle") == pytest.approx([0, -1, 0], abs=0.01)
        assert bone(limb, "ankle", "toe")[0] > 0.9
        assert out * (limb["shoulder"][2] - places["neck"][2]) == pytest.approx(
            LENGTHS["shoulder_width"] / 2
        )
        # The elbow's hinge is turned inward by 13 degrees, and so is the hand.
        thumb = limb["thumb"] - limb["knuckles"]
        assert out * thumb[2] > 0.04
        assert thumb[0] > 0.02


def test_single_angles_move_what_they_should():
    assert bone(placed(upright(arm_flex_r=90)), "right_shoulder", "right_elbow") == pytest.approx(
        [1, 0, 0]
    )
    assert bone(placed(upright(arm_add_l=-90)), "left_shoulder", "left_elbow") == pytest.approx(
        [0, 0, -1]
    )
    lean = bone(placed(upright(pelvis_tilt=-30)), "pelvis", "neck")
    assert lean == pytest.approx([0.5, np.sqrt(3) / 2, 0])
    lean = bone(placed(upright(pelvis_tilt=-10, lumbar_extension=-20)), "pelvis", "neck")
    assert lean == pytest.approx([0.5, np.sqrt(3) / 2, 0])
    assert bone(placed(upright(lumbar_bending=30)), "pelvis", "neck")[2] == pytest.approx(0.5)
    assert bone(placed(upright(hip_flexion_l=90)), "left_hip", "left_knee") == pytest.approx(
        [1, 0, 0]
    )
    assert bone(placed(upright(knee_angle_r=90)), "right_knee", "right_ankle") == pytest.approx(
        [-1, 0, 0]
    )
    turned = placed(upright(pelvis_rotation=90))
    assert bone(turned, "left_hip", "right_hip") == pytest.approx([1, 0, 0])
    toes = bone(placed(upright(ankle_angle_r=20)), "right_ankle", "right_toe")
    assert toes[1] > bone(placed(upright()), "right_ankle", "right_toe")[1] + 0.3
    moved = placed(upright(pelvis_tx=1.0, pelvis_ty=2.0, pelvis_tz=3.0))["pelvis"]
    assert moved - placed(upright())["pelvis"] == pytest.approx([1, 2, 3])


def near(value):
    """Return what single precision is near to."""
    return pytest.approx(value, abs=1e-5)


def test_it_is_what_scipys_sequences_give():
    rng = np.random.default_rng(3)
    given = {
        name: rng.uniform(3, 60, 20)
        * (1 if name.startswith(("knee", "elbow")) else rng.choice([-1, 1]))
        for name in upright().angles
    }
    found = posed(upright(**given), "some.mot")
    angle = {name: np.radians(each) for name, each in given.items()}

    pelvis = turned(angle, "ZXY", "pelvis_tilt", "pelvis_list", "pelvis_rotation")
    back = turned(angle, "ZXY", "lumbar_extension", "lumbar_bending", "lumbar_rotation")
    trunk = pelvis * back
    assert found.of("neck") - found.of("pelvis") == near(trunk.apply([0, LENGTHS["trunk"], 0]))
    for side, out in (("right", 1), ("left", -1)):

        def local(axes: str, *names: str, s: str = side[0], out: int = out) -> Rotation:
            return turned(angle, axes, *(f"{name}_{s}" for name in names), out=out)

        arm = trunk * local("ZXY", "arm_flex", "arm_add", "arm_rot")
        fore = arm * Rotation.from_euler("Y", out * 0.228) * local("Z", "elbow_flex")
        hand = fore * local("YZX", "pro_sup", "wrist_flex", "wrist_dev")
        leg = pelvis * local("ZXY", "hip_flexion", "hip_adduction", "hip_rotation")
        shank = leg * local("Z", "knee_angle").inv()
        foot = shank * local("ZX", "ankle_angle", "subtalar_angle")
        for start, end, segment, way in (
            (
                "pelvis",
                "shoulder",
                trunk,
                [0, LENGTHS["shoulder_height"], LENGTHS["shoulder_width"] / 2],
            ),
            ("shoulder", "elbow", arm, [0, -LENGTHS["upper_arm"], 0]),
            ("elbow", "wrist", fore, [0, -LENGTHS["forearm"], 0]),
            ("pelvis", "hip", pelvis, [0, 0, LENGTHS["hip_width"] / 2]),
            ("hip", "knee", leg, [0, -LENGTHS["thigh"], 0]),
            ("knee", "ankle", shank, [0, -LENGTHS["shank"], 0]),
            # As models/human.xml has it; of the hand the palm is ahead and the thumb outside.
            ("wrist", "knuckles", hand, [0, -0.0945, 0]),
            ("wrist", "thumb", hand, [0.02, -0.0945, 0.05]),
            ("ankle", "toe", foot, [0.133, -0.0511875, 0]),
        ):
            begin = start if start == "pelvis" else f"{side}_{start}"
            assert found.of(f"{side}_{end}") - found.of(begin) == near(
                segment.apply(np.array(way) * [1, 1, out])
            ), end


def test_the_left_side_is_the_mirrored_right_one():
    given = {
        "arm_flex": 40, "arm_add": -30, "arm_rot": 20, "elbow_flex": 70, "pro_sup": 60,
        "wrist_flex": 20, "wrist_dev": 10, "hip_flexion": 50, "hip_adduction": -15,
        "hip_rotation": 10, "knee_angle": 60, "ankle_angle": 10, "subtalar_angle": 8,
    }  # fmt: skip
    places = placed(upright(**{f"{name}_{s}": each for name, each in given.items() for s in "rl"}))
    for name, place in places.items():
        if name.startswith("right_"):
            other = places[name.replace("right_", "left_")]
            assert other == pytest.approx(place * [1, 1, -1])


THORAX = THORACOSCAPULAR.segments["trunk"].needed
SHOULDER = tuple(
    name for part in ("scapula", "upper_arm") for name in THORACOSCAPULAR.segments[part].needed
)


@pytest.mark.parametrize(
    ("thorax", "shoulder", "arm", "up"),
    [
        (
            (5, -10, -20),
            (-25, -5, 30, 8, 20, 70, 40),
            (0.01132, -0.16101, 0.98689),
            (0.33682, 0.93094, 0.14106),
        ),
        (
            (-3, 40, -9),
            (-16, -4, 8, 7, -28, 19, 50),
            (-0.00337, -0.96422, 0.2651),
            (0.11984, 0.98107, -0.15211),
        ),
    ],
)
def test_the_thoracoscapular_arm_is_where_opensim_has_it(
    thorax: tuple[float, ...],
    shoulder: tuple[float, ...],
    arm: tuple[float, ...],
    up: tuple[float, ...],
):
    """The numbers are OpenSim 4.6's for the model of Seth et al. 2019."""
    names = (*THORAX, *SHOULDER)
    places = placed(motion(**dict(zip(names, (*thorax, *shoulder), strict=True))))
    assert bone(places, "right_shoulder", "right_elbow") == pytest.approx(arm, abs=1e-4)
    assert bone(places, "pelvis", "neck") == pytest.approx(up, abs=1e-5)
    assert set(places) == {"pelvis", "neck", "right_shoulder", "left_shoulder", "right_elbow"}


def test_without_a_scapula_the_angles_are_those_to_the_thorax():
    for plane, ahead, aside in ((0, 0, 1), (90, 1, 0), (30, 0.5, np.sqrt(3) / 2)):
        given = motion(**dict.fromkeys(THORAX, 0.0), plane_elv=plane, shoulder_elv=60, axial_rot=33)
        found = posed(given, "some.mot")
        arm = bone(placed(given), "right_shoulder", "right_elbow")
        high = np.sqrt(3) / 2
        assert arm == pytest.approx([high * ahead, -0.5, high * aside])
        assert any("The file has no scapula" in note for note in found.notes)


@pytest.mark.parametrize(
    ("angles", "arm", "up"),
    [
        (
            (-28, -5, 15, -5, -6, 0, 26, 19, 19, -55, 53, 4),
            (-0.48596, 0.14708, -0.86152),
            (-0.46679, -0.09183, 0.87959),
        ),
        (
            (10, 20, -30, -20, -15, 3, 10, 30, 5, -90, 80, 60),
            (-0.28754, 0.78774, -0.54478),
            (0.15975, 0.34363, 0.92542),
        ),
    ],
)
def test_wus_arm_is_where_opensim_has_it(
    angles: tuple[float, ...], arm: tuple[float, ...], up: tuple[float, ...]
):
    """The numbers are OpenSim 4.6's for pyomeca's model, whose ground has z up."""
    names = UPPER_LIMB.coordinates[: len(angles)]
    places = placed(motion(**dict(zip(names, map(float, angles), strict=True))))
    ground = Rotation.from_euler("XYZ", [1.5708, 3.15159, 0])
    found = ground.apply(bone(places, "right_shoulder", "right_elbow"))
    assert found == pytest.approx(arm, abs=1e-4)
    assert ground.apply(bone(places, "pelvis", "neck")) == pytest.approx(up, abs=1e-4)


def test_a_thing_has_its_pose_in_the_axes_of_the_centres():
    pose = {"box_rotx": 90, "box_roty": 0, "box_rotz": 0,
            "box_transx": -0.1, "box_transy": 0.2, "box_transz": 0.3}  # fmt: skip
    thorax = dict.fromkeys(("thorax_tilt", "thorax_list", "thorax_rotation"), 0.0)
    found = posed(motion(2, **thorax, **pose, lid_rotx=5.0), "some.mot").objects
    assert list(found) == ["box"]
    # z is up in that ground, and people look along -x.
    assert found["box"][1, :3, 3] == pytest.approx([0.1, 0.3, 0.2], abs=4e-3)
    assert found["box"][0, :3, 1] == pytest.approx([0, 1, 0], abs=1e-4)
    pose["box_transy"] = np.nan
    lost = posed(motion(**thorax, **pose), "some.mot").objects["box"]
    assert np.isnan(lost[0, :3]).all()
    assert lost[0, 3].tolist() == [0, 0, 0, 1]
    same = posed(
        replace(
            upright(), angles={**upright().angles, **motion(**pose | {"box_transy": 0.2}).angles}
        ),
        "some.mot",
    )
    assert same.objects["box"][0, :3, 3] == pytest.approx([-0.1, 0.2, 0.3])


def test_knees_that_bend_negatively_are_reversed():
    knee = np.array([-70.0, -5.0, 3.0])
    found = posed(upright(knee_angle_r=knee, knee_angle_l=-10 + 0 * knee), "some.mot")
    shank = found.of("right_ankle") - found.of("right_knee")
    bent = np.degrees(np.arctan2(-shank[:, 0], -shank[:, 1]))
    assert bent == pytest.approx([70, 5, 0.5])
    assert sum("gait2392" in note for note in found.notes[1:]) == 1
    assert not any("reversed" in n for n in posed(upright(knee_angle_r=-knee), "some.mot").notes)


def test_names_may_be_paths():
    given = upright(arm_flex_r=50.0, hip_flexion_r=20.0)
    paths = {f"/jointset/any/{name}/value": each for name, each in given.angles.items()}
    paths |= {f"/jointset/any/{name}/speed": each + 9 for name, each in given.angles.items()}
    paths["/forceset/soleus_r/activation"] = np.ones(1)
    found, plain = (posed(each, "some.sto") for each in (replace(given, angles=paths), given))
    assert found.names == plain.names
    assert found.positions == pytest.approx(plain.positions)


def test_lengths_of_a_states_file_stay_lengths(tmp_path: Path):
    path = tmp_path / "states.sto"
    path.write_text(
        "states\nversion=3\ninDegrees=yes\nendheader\n"
        "time\t/jointset/ground_pelvis/pelvis_tilt/value\t/jointset/ground_pelvis/pelvis_ty/value\n"
        "0\t90\t0.9\n0.1\t90\t0.9\n"
    )
    angles = read_storage(path, unseen, TableOptions()).angles
    assert [each[0] for each in angles.values()] == pytest.approx([np.pi / 2, 0.9])


def test_what_the_file_does_not_have_is_left_out():
    some = {
        name: each
        for name, each in upright().angles.items()
        if name not in {"hip_flexion_l", "elbow_flex_r", "pro_sup_l", "subtalar_angle_r"}
    }
    found = posed(replace(upright(), angles=some), "some.mot")
    lost = {f"left_{name}" for name in ("knee", "ankle", "toe", "knuckles", "thumb")}
    lost |= {f"right_{name}" for name in ("wrist", "knuckles", "thumb")}
    assert set(posed(upright(), "some.mot").names) - set(found.names) == lost
    assert any("subtalar_angle_r" in note for note in found.notes)
    # Nothing is known above the pelvis.
    legs = {name: each for name, each in some.items() if not name.startswith("lumbar")}
    assert not {"neck", "right_shoulder"} & set(posed(replace(upright(), angles=legs), "x").names)


def test_columns_that_are_not_read_are_named_where_the_trunk_is_unknown():
    angles = {name.replace("lumbar", "L5_S1"): each for name, each in upright().angles.items()}
    with pytest.raises(RecordingError, match=r"the upper trunk cannot .* not read: L5_S1_extensi"):
        recording_of(replace(upright(), angles=angles), "some.mot", ReadOptions())


@pytest.mark.parametrize(
    "names",
    [
        ("ground_force_vx", "ground_force_vy"),
        ("pelvis_tx", "pelvis_ty", "arm_flex_r"),
        ("ground_thorax_rot_x", "plane_elv", "shoulder_elv"),
        (),
    ],
)
def test_no_known_model_is_said(names: tuple[str, ...]):
    with pytest.raises(RecordingError, match=r"walk\.mot: got the coordinates") as caught:
        posed(motion(**dict.fromkeys(names, 0.0)), "walk.mot")
    text = str(caught.value)
    assert all(name in text for name in (*names, "pelvis_tilt", "scapula_winging", "thorax_tilt"))
    assert text.count("thoracoscapular") == 1


def test_degrees_that_are_said_to_be_radians_are_told():
    given = upright()
    wrong = replace(given, angles={**given.angles, "hip_adduction_r": np.array([18.2])})
    with pytest.raises(RecordingError, match=r"hip_adduction_r reaches 18\.2 rad"):
        posed(wrong, "some.sto")
    round_and_round = {**given.angles, "pelvis_rotation": np.array([18.2])}
    assert posed(replace(given, angles=round_and_round), "some.sto").names


def test_frames_that_are_not_known_are_not_placed():
    flexion, height = np.array([10.0, np.nan, 30.0]), np.array([1.0, 1.0, np.nan])
    found = posed(upright(arm_flex_r=flexion, pelvis_ty=height), "some.mot")
    for name in found.names:
        known = np.isfinite(found.of(name)).all(axis=1)
        assert known.tolist() == [True, name not in RIGHT_ARM, False], name
    nothing = posed(upright(knee_angle_r=np.nan, knee_angle_l=np.nan), "some.mot")
    assert np.isnan(nothing.of("right_ankle")).all()
    assert np.isfinite(nothing.of("right_knee")).all()


def test_the_person_may_be_given():
    tall = Body.of_stature(1.95)
    found = posed(upright(), "some.mot", tall)
    arm = found.of("right_elbow") - found.of("right_shoulder")
    assert np.linalg.norm(arm) == pytest.approx(tall.lengths["upper_arm"])
    assert any("1.95 m" in note for note in found.notes)


def fitted(given: JointMotion) -> tuple[Recording, dict[str, np.ndarray], Rotation]:
    """What comes of it, the body's centres, and the axes of its trunk."""
    recording = recording_of(posed(given, "some.mot"), "some.mot", ReadOptions(unit=1.0, up="y"))
    poses = recording.base_poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    centres = centres_of(
        recording.person, np.column_stack([poses[:, :3, 3], yaw]), recording.postures
    )
    trunk = Rotation.from_euler("Z", yaw[:, None]) * Rotation.from_euler(
        "YXZ",
        np.stack(
            [
                joint(recording, "trunk_flexion"),
                -joint(recording, "trunk_side_bend"),
                joint(recording, "trunk_twist"),
            ],
            axis=1,
        ),
    )
    assert not recording.not_scored
    assert not any("smoothed" in each for each in recording.assumptions)
    return recording, centres, trunk


def joint(recording: Recording, name: str) -> np.ndarray:
    return recording.postures[:, INDEX[name]]


def rms(angles: np.ndarray) -> float:
    """In degrees."""
    return float(np.degrees(np.sqrt(np.mean(angles**2))))


def to_down(ways: np.ndarray) -> np.ndarray:
    return np.arctan2(np.linalg.norm(ways[:, :2], axis=1), -ways[:, 2])


def test_the_fitted_joints_are_those_of_the_file():
    """Of a body that moves all of its joints."""
    phase = np.linspace(0, 2 * np.pi, 200)
    wave = {
        "pelvis_tilt": -15 + 10 * np.sin(phase), "lumbar_extension": -10 + 8 * np.cos(phase),
        "lumbar_bending": 5 * np.sin(phase), "lumbar_rotation": 9 * np.sin(phase),
        "pelvis_rotation": 50 * np.sin(phase),
    }  # fmt: skip
    for s in "rl":
        wave |= {
            f"hip_flexion_{s}": 40 + 20 * np.sin(phase), f"knee_angle_{s}": 50 + 30 * np.cos(phase),
            f"ankle_angle_{s}": 10 * np.sin(phase), f"arm_flex_{s}": 30 + 40 * np.sin(phase),
            f"arm_add_{s}": -25 + 10 * np.cos(phase), f"arm_rot_{s}": 10 * np.sin(phase),
            f"elbow_flex_{s}": 60 + 30 * np.cos(phase), f"pro_sup_{s}": 80 + 30 * np.sin(phase),
            f"wrist_flex_{s}": 30 * np.cos(phase), f"wrist_dev_{s}": 5 + 15 * np.sin(phase),
        }  # fmt: skip
    recording, _, _ = fitted(upright(**wave))
    for side in ("right", "left"):
        s = side[0]
        for ours, theirs, less in (
            ("knee_flexion", "knee_angle", 0), ("ankle_flexion", "ankle_angle", 0),
            ("elbow_flexion", "elbow_flex", 0), ("forearm_pronation", "pro_sup", 90),
            ("wrist_flexion", "wrist_flex", 0), ("wrist_deviation", "wrist_dev", 0),
        ):  # fmt: skip
            off = joint(recording, f"{side}_{ours}") - np.radians(wave[f"{theirs}_{s}"] - less)
            assert rms(off) < 0.1, (side, ours)


@pytest.mark.parametrize("name", ["ABD01", "FLX21"])
def test_the_arm_is_raised_by_scapula_and_shoulder(name: str, shared: Path):
    given = read_storage(
        shared / "mocap" / "mot" / f"thoracoscapular_{name}.mot", unseen, TableOptions()
    )
    recording, centres, trunk = fitted(given)
    arm = to_down(trunk.inv().apply(centres["right_elbow"] - centres["right_shoulder"]))
    # OpenSim itself has the arm overhead: at 159 and 158 degrees, from 10 and 9.
    assert np.degrees([arm.min(), arm.max()]) == pytest.approx(
        {"ABD01": (10.3, 158.6), "FLX21": (9.2, 158.3)}[name], abs=0.5
    )
    assert rms(joint(recording, "right_elbow_flexion")) < 1

    alone = {n: each for n, each in given.angles.items() if not n.startswith("scapula_")}
    _, centres, trunk = fitted(replace(given, angles=alone))
    arm = to_down(trunk.inv().apply(centres["right_elbow"] - centres["right_shoulder"]))
    off = arm - given.angles["shoulder_elv"]
    assert rms(off) < 0.1
    assert np.degrees(np.abs(off).max()) < 1


def test_squats_have_the_angles_of_their_file(shared: Path):
    given = read_storage(shared / "mocap" / "mot" / "opencap_squats.mot", unseen, TableOptions())
    recording, centres, _ = fitted(given)
    angle = given.angles
    pelvis = turned(angle, "ZXY", "pelvis_tilt", "pelvis_list", "pelvis_rotation")
    back = pelvis * turned(angle, "ZXY", "lumbar_extension", "lumbar_bending", "lumbar_rotation")
    lean = np.pi - to_down(centres["neck"] - centres["pelvis"])
    assert rms(lean - np.arccos(back.apply([0, 1, 0])[:, 1])) < 0.1
    for side in ("right", "left"):
        s, out = side[0], 1 if side == "right" else -1
        assert rms(joint(recording, f"{side}_knee_flexion") - angle[f"knee_angle_{s}"]) < 0.1
        assert rms(joint(recording, f"{side}_elbow_flexion") - angle[f"elbow_flex_{s}"]) < 0.1
        pronation = joint(recording, f"{side}_forearm_pronation")
        assert rms(pronation - angle[f"pro_sup_{s}"] + np.pi / 2) < 0.1
        # Our pelvis is upright: its tilt goes into the hips.
        names = (f"hip_{name}_{s}" for name in ("flexion", "adduction", "rotation"))
        hip = turned(angle, "ZXY", *names, out=out)
        thigh, across = (pelvis * hip).apply([0, -1, 0]), pelvis.apply([0, 0, 1])
        ahead = np.cross([0, 1, 0], across)
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        flexion = np.arctan2((ahead * thigh).sum(axis=1), -thigh[:, 1])
        assert rms(joint(recording, f"{side}_hip_flexion") - flexion) < 0.1
        tilted = angle[f"hip_flexion_{s}"] + angle["pelvis_tilt"]
        assert rms(joint(recording, f"{side}_hip_flexion") - tilted) < 2


def test_the_hand_lifts_the_box(shared: Path):
    path = shared / "mocap" / "mot" / "pyomeca_box_ik_comma_badcount.mot"
    given = read_storage(path, unseen, TableOptions())
    recording, centres, trunk = fitted(given)
    arm = to_down(trunk.inv().apply(centres["right_elbow"] - centres["right_shoulder"]))
    # By OpenSim, with pyomeca's model.
    assert np.degrees(arm[[0, -8]]) == pytest.approx([56.8, 26.8], abs=0.5)
    for ours, theirs, sign in (
        ("elbow_flexion", "elbow_flexion", 1), ("forearm_pronation", "pro_sup", 1),
        ("wrist_flexion", "hand_r_Flex", 1), ("wrist_deviation", "hand_r_Add", -1),
    ):  # fmt: skip
        assert rms(joint(recording, f"right_{ours}") - sign * given.angles[theirs]) < 2, ours
    found = posed(given, path.name)
    box, hand = found.objects["box"][:, :3, 3], found.of("right_knuckles")
    assert box[-1, 1] - box[0, 1] == pytest.approx(0.29, abs=0.01)
    assert np.abs(hand[:, 1] - box[:, 1]).max() < 0.15
    assert (np.linalg.norm(hand - box, axis=1) < 0.4).all()
