"""Angles of an OpenSim model in a wrong unit, or of hinges that bend backward, are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.opensim import check_unit, is_length, with_bent_hinges
from ergoqp.mocap.formats.opensim_models import MODELS
from ergoqp.mocap.load import load_recording

FULL_BODY, THORACOSCAPULAR, *_ = MODELS

COUNT = 200
SWING = np.sin(np.linspace(0, 6 * np.pi, COUNT))
WALK = {
    "hip_flexion_r": 15 + 25 * SWING, "hip_flexion_l": 15 - 25 * SWING,
    "knee_angle_r": 35 + 30 * SWING, "knee_angle_l": 35 - 30 * SWING,
    "ankle_angle_r": 10 * SWING, "pelvis_tilt": -5 + 3 * SWING,
    "lumbar_extension": -8 + 2 * SWING, "pelvis_rotation": 400 + SWING,
    "elbow_flex_r": 30 + 15 * SWING, "elbow_flex_l": 30 - 15 * SWING,
}  # fmt: skip
"""Angles [deg] on the spot."""


def angles(**degrees: np.ndarray | float) -> dict[str, np.ndarray]:
    return {
        name: np.full(COUNT, value) * (1.0 if name[-3:-1] == "_t" else np.pi / 180)
        for name, value in degrees.items()
    }


def small(share: float = np.pi / 180) -> dict[str, np.ndarray]:
    """The walk in radians that are taken as degrees, or by another share of itself."""
    return angles(**{name: share * each for name, each in WALK.items()})


def test_a_walk_is_nothing_to_speak_of() -> None:
    given = angles(**WALK)
    assert check_unit(FULL_BODY, given, "a.mot") == []
    found, said = with_bent_hinges(given, "a.mot")
    assert said == []
    for name, each in given.items():
        np.testing.assert_array_equal(found[name], each)


def test_radians_that_are_taken_as_degrees_are_refused() -> None:
    with pytest.raises(RecordingError, match=r"^a\.mot: no angle of the joints exceeds 1\.1 deg"):
        check_unit(FULL_BODY, small(), "a.mot")


def test_somebody_who_goes_somewhere_bends() -> None:
    # Small steps: no three joints would be bent much.
    steps = small(0.3 * np.pi / 180)
    assert len(check_unit(FULL_BODY, steps, "a.mot")) == 1
    for far, axis in ((0.2, "x"), (0.2, "y"), (0.2, "z")):
        goes = {**steps, f"pelvis_t{axis}": np.linspace(0, far, COUNT)}
        with pytest.raises(RecordingError, match="while the person moves"):
            check_unit(FULL_BODY, goes, "a.mot")
        sways = {**steps, f"pelvis_t{axis}": np.linspace(0, 0.05, COUNT)}
        assert len(check_unit(FULL_BODY, sways, "a.mot")) == 1


def test_somebody_who_stands_may_be_and_it_is_said() -> None:
    still = angles(pelvis_tilt=2.1, knee_angle_r=1.0 + 0.2 * SWING, hip_flexion_r=-2.0)
    (said,) = check_unit(FULL_BODY, still, "a.mot")
    assert said.startswith("No angle of the joints exceeds 2.1 deg: radians that are taken as")
    # Two joints that move are no three; and what is larger, or none at all, is no radian.
    two = angles(pelvis_tilt=2 * SWING, knee_angle_r=1 + SWING, hip_flexion_r=0.0)
    assert len(check_unit(FULL_BODY, two, "a.mot")) == 1
    assert check_unit(FULL_BODY, angles(**{**WALK, "knee_angle_r": 4.1}), "a.mot") == []
    assert check_unit(FULL_BODY, angles(pelvis_tilt=4.1, knee_angle_r=1.0), "a.mot") == []
    assert check_unit(FULL_BODY, angles(pelvis_tilt=0.05, knee_angle_r=0.0), "a.mot") == []
    assert check_unit(FULL_BODY, angles(pelvis_tilt=np.nan, knee_angle_r=np.nan), "a.mot") == []
    assert check_unit(FULL_BODY, {}, "a.mot") == []


@pytest.mark.parametrize(
    "name", ["knee_angle_r", "knee_angle_l", "elbow_flex_l", "hip_rotation_l", "lumbar_bending"]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_no_joint_turns_round(name: str, sign: int) -> None:
    given = angles(**WALK)
    far = {**given, name: np.where(np.arange(COUNT) == 7, sign * 3.7, 0.3)}
    with pytest.raises(RecordingError, match=rf"{name} reaches 3\.7 rad, allowed 3\.6 rad: the un"):
        check_unit(FULL_BODY, far, "a.mot")
    said = check_unit(FULL_BODY, far, "a.mot", trusted=True)
    assert said == [f"The unit of the angles is right, as stated, although {name} reaches 3.7 rad."]
    near = {**given, name: np.where(np.arange(COUNT) == 7, sign * 3.5, 0.3)}
    assert check_unit(FULL_BODY, near, "a.mot") == []


def test_small_degrees_that_are_said_to_be_radians_are_refused() -> None:
    with pytest.raises(RecordingError, match=r"allowed 3\.6 rad"):
        check_unit(FULL_BODY, small(0.1 * 180 / np.pi), "a.mot")


def test_a_whole_body_and_an_arm_that_hangs_may_turn_farther() -> None:
    for model, name in (
        (FULL_BODY, "pelvis_tilt"),
        (FULL_BODY, "pelvis_list"),
        (THORACOSCAPULAR, "plane_elv"),
        (THORACOSCAPULAR, "axial_rot"),
        (THORACOSCAPULAR, "ground_thorax_rot_x"),
    ):
        assert check_unit(model, {name: np.full(COUNT, 6.0)}, "a.mot") == []
        with pytest.raises(RecordingError, match=f"{name} reaches 13 rad, allowed two whole turns"):
            check_unit(model, {name: np.full(COUNT, 13.0)}, "a.mot")
    with pytest.raises(RecordingError, match="shoulder_elv reaches 6 rad"):
        check_unit(THORACOSCAPULAR, {"shoulder_elv": np.full(COUNT, 6.0)}, "a.mot")


@pytest.mark.parametrize(
    "wrong",
    [
        ("knee_angle_r",),
        ("knee_angle_l",),
        ("elbow_flex_r",),
        ("elbow_flex_r", "elbow_flex_l"),
        ("knee_angle_r", "knee_angle_l", "elbow_flex_l"),
    ],
)
def test_a_hinge_of_the_wrong_sign_is_refused_by_name(wrong: tuple[str, ...]) -> None:
    given = angles(**WALK)
    given |= {name: -given[name] for name in wrong}
    with pytest.raises(RecordingError, match="backward by up to") as told:
        with_bent_hinges(given, "a.mot")
    both = {"knee_angle_r", "knee_angle_l"} <= set(wrong)
    named = [name for name in wrong if not (both and name.startswith("knee"))]
    assert all(name in str(told.value) for name in named)
    others = (name for name in WALK if name not in named)
    assert not any(name in str(told.value) for name in others)
    degrees = "65" if named[0].startswith("knee") else "45"
    assert f"by up to {degrees} deg, allowed 10 deg: the sign of the angle" in str(told.value)
    assert str(told.value).endswith("(trust angles)")
    said = " ".join(with_bent_hinges(given, "a.mot", trusted=True)[1])
    assert all(f"{name} is bent backward by more than 10 deg" in said for name in named)


@pytest.mark.parametrize("lacks", [(), ("knee_angle_l",), ("knee_angle_r",)])
def test_knees_that_bend_negatively_are_reversed(lacks: tuple[str, ...]) -> None:
    given = {name: each for name, each in angles(**WALK).items() if name not in lacks}
    theirs = {name: -each if "knee" in name else each for name, each in given.items()}
    found, said = with_bent_hinges(theirs, "a.mot")
    assert said == [
        "The angles of the knees are negative in flexion, as in gait2392: they are reversed."
    ]
    for name, each in given.items():
        np.testing.assert_array_equal(found[name], each)


def test_a_knee_that_shows_no_sign_goes_with_the_other() -> None:
    given = angles(knee_angle_r=-70.0, knee_angle_l=4.0)
    found, said = with_bent_hinges(given, "a.mot")
    assert len(said) == 1
    assert found["knee_angle_r"][0] == pytest.approx(np.radians(70))
    assert found["knee_angle_l"][0] == pytest.approx(np.radians(0.5))
    # Of two that show none the larger one is taken.
    straight = angles(knee_angle_r=-8.0, knee_angle_l=-2.0)
    assert with_bent_hinges(straight, "a.mot")[0]["knee_angle_r"][0] == pytest.approx(np.radians(8))


def test_what_is_bent_backward_sometimes_is_taken_as_straight_and_said() -> None:
    given = angles(**WALK)
    given["knee_angle_r"][20:32] = np.radians(-15)
    given["elbow_flex_l"][50:60] = np.radians(-9)
    given["knee_angle_l"][3] = np.nan
    found, said = with_bent_hinges(given, "a.mot")
    assert said == [
        "knee_angle_r is bent backward by more than 10 deg in 12 of 200 frames, by up to 15 deg: it"
        " is taken as straight there."
    ]
    for name, rows in (("knee_angle_r", slice(20, 32)), ("elbow_flex_l", slice(50, 60))):
        assert found[name][rows] == pytest.approx(np.radians(0.5))
    assert np.isnan(found["knee_angle_l"][3])


def test_a_straight_leg_may_be_a_little_beyond() -> None:
    # Who stands: of the frames in which it is bent at all, most are not far backward.
    stands = angles(knee_angle_r=-7.0, knee_angle_l=2.0, elbow_flex_r=20.0)
    stands["knee_angle_r"][:20] = np.radians(-11)
    stands["knee_angle_l"][:5] = np.radians(30)
    _, said = with_bent_hinges(stands, "a.mot")
    assert said[0].startswith("knee_angle_r is bent backward by more than 10 deg in 20 of 200")


@pytest.mark.parametrize(
    ("stated", "factor", "said"),
    [
        ("inDegrees=yes", np.pi / 180, "while the person moves"),
        ("inDegrees=no", 1.0, "allowed 3.6 rad|allowed two whole turns"),
        ("inDegrees=no", 0.05, "allowed 3.6 rad"),
    ],
)
def test_squats_in_a_wrong_unit(
    stated: str, factor: float, said: str, shared: Path, tmp_path: Path
) -> None:
    head, body = (shared / "mocap" / "mot" / "opencap_squats.mot").read_text().split("endheader\n")
    names, *rows = body.strip().split("\n")
    turns = [not is_length(name) and name != "time" for name in names.split("\t")]
    numbers = np.array([row.split("\t") for row in rows], dtype=float)
    numbers[:, turns] *= factor
    text = "\n".join("\t".join(f"{x:.6f}" for x in row) for row in numbers)
    path = tmp_path / "a.mot"
    path.write_text(f"{head.replace('inDegrees=yes', stated)}endheader\n{names}\n{text}\n")
    assert stated in path.read_text()
    with pytest.raises(RecordingError, match=said):
        load_recording(path)
