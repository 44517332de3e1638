"""The body: joints and their signs, scaling by stature and by measured lengths, and what is
refused."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ergoqp.errors import InputError
from ergoqp.human import FRACTIONS, FRAMES, Body, Kinematics
from ergoqp.human.body import NOMINAL_MASS, stature_of
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER

X, Y, Z = range(3)


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(Body())


def sites(body: Body, angles: dict[str, float] | None = None) -> dict[str, np.ndarray]:
    """Positions of all frames by MuJoCo, with the pelvis at the origin and some joints at angles
    [deg]."""
    data = mujoco.MjData(body.model)
    for joint, angle in (angles or {}).items():
        data.qpos[4 + INDEX[joint]] = np.radians(angle)
    mujoco.mj_kinematics(body.model, data)
    return {frame: data.site(frame).xpos.copy() for frame in FRAMES}


def test_the_joints_are_those_of_the_design_in_order() -> None:
    arm = [
        "shoulder_flexion",
        "shoulder_abduction",
        "shoulder_rotation",
        "elbow_flexion",
        "forearm_pronation",
    ]
    arm += ["wrist_flexion", "wrist_deviation"]
    leg = [
        "hip_flexion",
        "hip_abduction",
        "hip_rotation",
        "knee_flexion",
        "ankle_flexion",
        "ankle_inversion",
    ]
    expected = [
        f"{part}_{motion}"
        for part in ("trunk", "neck")
        for motion in ("flexion", "side_bend", "twist")
    ]
    expected += [f"{side}_{joint}" for side in ("right", "left") for joint in arm]
    expected += [f"{side}_{joint}" for side in ("right", "left") for joint in leg]
    assert list(JOINTS) == expected
    model = Body().model
    names = [model.joint(i).name for i in range(model.njnt)]
    assert names == ["base_x", "base_y", "base_z", "base_yaw", *expected]


@pytest.mark.parametrize("stature", [1.4, 1.75, 2.1])
def test_ranges_of_the_model_are_those_of_the_joints(stature: float) -> None:
    model = Body.of_stature(stature).model
    np.testing.assert_allclose(model.jnt_range[4:], np.column_stack([LOWER, UPPER]), atol=1e-12)
    assert model.jnt_limited[4:].all()
    assert not model.jnt_limited[:4].any()


# (joint, the frame that shows it, axis of the pelvis, direction): "o" stands for the side's outward
# direction.
MIDDLE_SIGNS = [
    ("trunk_flexion", "head", X, +1),
    ("trunk_side_bend", "head", Y, +1),
    ("trunk_twist", "nose", Y, +1),
    ("neck_flexion", "nose", Z, -1),
    ("neck_flexion", "head_top", X, +1),
    ("neck_side_bend", "head_top", Y, +1),
    ("neck_twist", "nose", Y, +1),
]
SIDE_SIGNS = [
    ("shoulder_flexion", {}, "knuckles", X, +1),
    ("shoulder_abduction", {}, "knuckles", Y, "outward"),
    ("shoulder_rotation", {"elbow_flexion": 90}, "knuckles", Y, "inward"),
    ("elbow_flexion", {}, "knuckles", X, +1),
    ("elbow_flexion", {}, "knuckles", Z, +1),
    # Palms to the thighs: the thumb is in front; turned to pronation it comes to the thigh and the
    # palm looks backward.
    ("forearm_pronation", {}, "thumb", Y, "inward"),
    ("forearm_pronation", {}, "grip", X, -1),
    ("wrist_flexion", {}, "fingertips", Y, "inward"),
    # Ulnar: to the side of the little finger, which is behind when the thumb is in front.
    ("wrist_deviation", {}, "fingertips", X, -1),
    ("hip_flexion", {}, "ankle", X, +1),
    ("hip_abduction", {}, "ankle", Y, "outward"),
    ("hip_rotation", {}, "toe", Y, "inward"),
    ("knee_flexion", {}, "ankle", X, -1),
    ("ankle_flexion", {}, "toe", Z, +1),
    # The sole looks inward: its middle, below the ankle, goes inward.
    ("ankle_inversion", {}, "sole", Y, "inward"),
]


@pytest.mark.parametrize(("joint", "frame", "axis", "sign"), MIDDLE_SIGNS)
def test_a_positive_angle_of_trunk_and_neck(joint: str, frame: str, axis: int, sign: int) -> None:
    moved = sites(Body(), {joint: 10})[frame] - sites(Body())[frame]
    assert sign * moved[axis] > 0.002


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("joint", "others", "frame", "axis", "sign"), SIDE_SIGNS)
def test_a_positive_angle_means_the_same_on_both_sides(
    side: str, joint: str, others: dict[str, float], frame: str, axis: int, sign: int | str
) -> None:
    outward = -1 if side == "right" else 1
    direction = {"outward": outward, "inward": -outward}.get(sign, sign)  # type: ignore[arg-type]
    before = {f"{side}_{name}": angle for name, angle in others.items()}
    moved = (
        sites(Body(), before | {f"{side}_{joint}": 10})[f"{side}_{frame}"]
        - sites(Body(), before)[f"{side}_{frame}"]
    )
    assert direction * moved[axis] > 0.002


def test_both_sides_are_mirror_images(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(0)
    q = np.zeros(32)
    for joint in JOINTS:
        if joint.startswith("right_"):
            value = rng.uniform(LOWER[INDEX[joint]], UPPER[INDEX[joint]])
            q[INDEX[joint]] = q[INDEX[joint.replace("right_", "left_")]] = value
    mirror = np.array([1, -1, 1])
    for frame in (frame for frame in FRAMES if frame.startswith("right_")):
        right, left = (
            np.array(kinematics.function(f)(q)[0]).ravel()
            for f in (frame, frame.replace("right", "left"))
        )
        np.testing.assert_allclose(right * mirror, left, atol=1e-12)


def test_zero_is_upright_with_hanging_arms_and_palms_to_the_thighs(kinematics: Kinematics) -> None:
    at = {frame: np.array(kinematics.function(frame)(np.zeros(32))[0]).ravel() for frame in FRAMES}
    assert at["head_top"][Z] - at["right_sole"][Z] == pytest.approx(1.75, abs=0.005)
    for side, outward in (("right", -1), ("left", 1)):
        assert outward * at[f"{side}_shoulder"][Y] > 0.15
        np.testing.assert_allclose(
            at[f"{side}_fingertips"][:2], at[f"{side}_shoulder"][:2], atol=1e-9
        )
        # The palm's middle is on the body's side of the knuckles, the thumb in front.
        assert outward * (at[f"{side}_knuckles"][Y] - at[f"{side}_grip"][Y]) > 0.01
        assert at[f"{side}_thumb"][X] > 0.04


def test_the_grip_has_the_axes_of_the_world_when_the_elbow_is_bent_square(
    kinematics: Kinematics,
) -> None:
    for side in SIDES:
        q = np.zeros(32)
        q[INDEX[f"{side}_elbow_flexion"]] = np.pi / 2
        np.testing.assert_allclose(
            np.array(kinematics.function(f"{side}_grip")(q)[1]), np.eye(3), atol=1e-12
        )


def measured(body: Body) -> dict[str, float]:
    """Segment lengths as distances between frames of the zero posture, which know nothing of how
    the model was scaled."""
    at = sites(body)

    def apart(a: str, b: str) -> float:
        return float(np.linalg.norm(at[a] - at[b]))

    found = {
        "trunk": at["neck"][Z] - (at["right_hip"][Z] + at["left_hip"][Z]) / 2,
        "shoulder_height": (at["right_shoulder"][Z] + at["left_shoulder"][Z]) / 2 - at["pelvis"][Z],
        "shoulder_width": apart("right_shoulder", "left_shoulder"),
        "neck": apart("neck", "head"),
        "head": apart("head", "head_top"),
        "hip_width": apart("right_hip", "left_hip"),
    }
    for side in SIDES:
        sides = {
            "upper_arm": apart(f"{side}_shoulder", f"{side}_elbow"),
            "forearm": apart(f"{side}_elbow", f"{side}_wrist"),
            "hand": apart(f"{side}_wrist", f"{side}_fingertips"),
            "thigh": apart(f"{side}_hip", f"{side}_knee"),
            "shank": apart(f"{side}_knee", f"{side}_ankle"),
            "foot_height": at[f"{side}_ankle"][Z] - at[f"{side}_sole"][Z],
        }
        for name, value in sides.items():
            assert found.setdefault(name, value) == pytest.approx(value, abs=1e-12)
    return found


@pytest.mark.parametrize("stature", [1.4, 1.75, 2.05])
def test_a_stature_scales_every_segment(stature: float) -> None:
    for name, length in measured(Body.of_stature(stature)).items():
        assert length == pytest.approx(FRACTIONS[name] * stature, rel=1e-9), name


@pytest.mark.parametrize("name", [name for name in FRACTIONS if name != "foot_length"])
@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_a_measured_length_is_kept_and_changes_no_other(name: str, factor: float) -> None:
    lengths = dict(Body().lengths)
    lengths[name] *= factor
    found = measured(Body(lengths={name: lengths[name]}))
    for other, length in found.items():
        assert length == pytest.approx(lengths[other], rel=1e-9), other


def test_a_longer_foot_reaches_further_forward() -> None:
    before, after = (
        sites(Body()),
        sites(Body(lengths={"foot_length": 1.1 * Body().lengths["foot_length"]})),
    )
    heel_to_toe = {
        name: at["right_toe"][X] - at["right_heel"][X]
        for name, at in (("before", before), ("after", after))
    }
    assert heel_to_toe["after"] == pytest.approx(1.1 * heel_to_toe["before"])


def test_lengths_alone_suggest_the_stature_of_most_of_the_body() -> None:
    lengths = {name: FRACTIONS[name] * 1.60 for name in ("trunk", "thigh", "shank", "forearm")}
    assert stature_of(lengths) == pytest.approx(1.60)
    # One badly measured short segment does not change it.
    body = Body.of_lengths(lengths | {"neck": FRACTIONS["neck"] * 2.0})
    assert body.stature == pytest.approx(1.60)
    assert body.lengths["upper_arm"] == pytest.approx(FRACTIONS["upper_arm"] * 1.60)
    assert body.lengths["neck"] == pytest.approx(FRACTIONS["neck"] * 2.0)


def test_mass_is_that_of_the_person() -> None:
    assert Body().model.body_subtreemass[0] == pytest.approx(NOMINAL_MASS, abs=1e-3)
    assert Body.of_stature(1.6, mass=95.0).model.body_subtreemass[0] == pytest.approx(
        95.0, abs=1e-3
    )
    # The same build at every stature.
    for stature in (1.5, 2.0):
        body = Body.of_stature(stature)
        assert body.mass / stature**2 == pytest.approx(NOMINAL_MASS / 1.75**2)
        assert body.model.body_subtreemass[0] == pytest.approx(body.mass, abs=1e-3)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Body.of_stature(1.75e3), "stature: got 1750.0 m, allowed 1.2 to 2.3 m"),
        (lambda: Body.of_stature(2.4079459656957733), "stature: got 2.408 m, allowed 1.2 to 2.3"),
        (lambda: Body.of_stature(2.3001), "stature: got 2.3001 m, allowed 1.2 to 2.3 m"),
        (lambda: Body.of_stature(float("nan")), "stature: got nan m"),
        (lambda: Body.of_stature(1.7, mass=-70), "mass: got -70 kg, allowed 20 to 300 kg"),
        (lambda: Body.of_stature(1.7, mass=float("nan")), "mass: got nan kg"),
        (lambda: Body(lengths={"tail": 0.2}), r"segment lengths: got \['tail'\], allowed"),
        (lambda: Body(lengths={"thigh": 43.0}), "length of thigh: got 43.000 m, allowed 0.1"),
        (lambda: Body(lengths={"thigh": float("nan")}), "length of thigh: got nan m"),
        (lambda: Body.of_lengths({}), r"segment lengths: got \[\], allowed a non-empty part"),
        (lambda: Body.of_lengths({"tail": 0.2}), r"segment lengths: got \['tail'\]"),
        (
            lambda: Body.of_lengths({"thigh": 0.43, "trunk": 0.53, "shank": 0.0}),
            "length of shank: got 0.0 m",
        ),
    ],
)
def test_a_body_that_is_not_one_is_refused(make, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()
