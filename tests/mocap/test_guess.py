"""The nearest guess at unknown names, and the mapping file that it is written to."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ergoqp.mocap.name_words import guessed, template
from ergoqp.mocap.naming import CENTRES, LANDMARKS, known_namings, read_mapping

WANTED = (*CENTRES, *LANDMARKS)
SIGNS = ("=", "'", "", " ", "[table]", "# comment", "C:\\hips", "tab\there", "\\u0041", 'R_Hip"\n')
CONTROLS = (
    "bell\x07",
    "del\x7f",
    "nul\0",
    "next\x85line",
    "line\u2028",
    "\ufeffbom",
    "\udcff lone",
)
WILD = (*SIGNS, *CONTROLS, 'say "hip"', "a\nright_hip = 'x'", "左手", "é", "🙂", "L_Elbow")
WORDS = {
    "neck": ("C7", "SpineShoulder"),
    "pelvis": ("Hips", "root"),
    "nose": ("Nose",),
    "head": ("Head", "Tête"),
    "head_top": ("HeadTop", "head_end"),
    "right_shoulder": ("Skel_R_UpperArm", "E\u0301paule droite"),
    "left_shoulder": ("bip01 L UpperArm", "Épaule gauche"),
    "right_elbow": ("RElbow1", "R_Elbow_02", "ForeArm2.R", "rradius"),
    "left_elbow": (
        "LElbow",
        "lElbow",
        "LELBOW",
        "l_elbow",
        "elbow_l",
        "ElbowLeft",
        "LEFT_ELBOW",
        "Left Fore-Arm",
    ),
    "right_wrist": ("RIGHT HAND",),
    "left_wrist": ("hand_l",),
    "right_knuckles": ("index_02_r", "RightHandMiddle1"),
    "right_thumb": ("rthumb",),
    "left_thumb": ("LeftHandThumb1", "thumb_01_l"),
    "right_hip": ("RightUpLeg", "Hüfte rechts"),
    "left_hip": ("lfemur",),
    "right_knee": ("rtibia",),
    "left_ankle": ("lfoot", "Knöchel_li"),
    "right_toe": ("rightToeBase",),
    "left_toe": ("ball_l",),
}


@pytest.mark.parametrize(
    ("name", "centre"), [(name, centre) for centre, names in WORDS.items() for name in names]
)
def test_the_words_of_a_name(name: str, centre: str) -> None:
    assert guessed((name,)) == {centre: name}


@pytest.mark.parametrize(
    "name",
    ["L5", "R12", "L", "r", "1", "", "Leg", "Elbow", "Rib", "Neck9", "LeftHead", "左手", "box"],
)
def test_names_that_say_nothing(name: str) -> None:
    assert guessed((name,)) == {}


def test_the_plainest_name_is_taken_and_each_once() -> None:
    names = ("HeadTop", "Head_2", "Head", "LeftUpLeg", "LeftLeg", "LeftHandIndex1", "LeftHand")
    assert guessed(names) == guessed(names[::-1])
    assert guessed(names) == {
        "head": "Head",
        "head_top": "HeadTop",
        "left_wrist": "LeftHand",
        "left_knuckles": "LeftHandIndex1",
        "left_hip": "LeftUpLeg",
        "left_knee": "LeftLeg",
    }


@pytest.mark.parametrize(
    ("names", "centre", "right"),
    [
        (("LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand"), "left_shoulder", "LeftArm"),
        (("RightShoulder", "RightUpperArm", "x"), "right_shoulder", "RightUpperArm"),
        (("r_clavicle", "r_shoulder", "r_uarm"), "right_shoulder", "r_uarm"),
        (("LeftShoulder", "LeftElbow"), "left_shoulder", "LeftShoulder"),
        (("LHipJoint", "LeftUpLeg", "LeftLeg"), "left_hip", "LeftUpLeg"),
    ],
)
def test_the_bone_and_not_the_collar(names: tuple[str, ...], centre: str, right: str) -> None:
    assert guessed(names)[centre] == right
    assert f'{centre} = "{right}"' in template(names, WANTED)


XSENS = ("ArmLatEpicondyle", "ArmMedEpicondyle", "KneeLatEpicondyle", "RadialStyloid", "ASI")


def test_markers_on_the_skin_are_no_joints() -> None:
    names = ("pSacrum", "pC7SpinalProcess", "pIJ", "pTopOfHead")
    names += tuple(f"p{side}{name}" for side in ("Right", "Left") for name in XSENS)
    assert guessed(names) == {
        "sacrum": "pSacrum",
        "c7": "pC7SpinalProcess",
        "notch": "pIJ",
        **{
            f"{side}_{place}": f"p{side.title()}{name}"
            for side in ("right", "left")
            for place, name in zip(
                ("outer_elbow", "inner_elbow", "outer_knee", "wrist_thumb", "asis"),
                XSENS,
                strict=True,
            )
        },
    }
    # Nor is one alone.
    assert guessed(("pRightArmLatEpicondyle", "R.Knee.Medial")) == {}
    french = ("R.EIAS", "LEIAS", "REPS", "L.Epi.Lat")
    assert set(guessed(french)) == {"right_asis", "left_asis", "right_psis", "left_outer_elbow"}


@pytest.mark.parametrize("name", ["RThigh{}", "ArmL:Marker{}", "root-{}", "R_SHANK_{}"])
def test_markers_beside_each_other_are_no_joint(name: str) -> None:
    assert guessed(tuple(name.format(i) for i in (1, 2, 3))) == {}


def test_short_words_of_limbs() -> None:
    names = ("UpArm_R", "LoArm_R", "Hand_R", "UpLeg_R", "LoLeg_R", "Foot_R", "Toe_R")
    parts = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")
    assert guessed(names) == {f"right_{p}": n for p, n in zip(parts, names, strict=True)}


def test_most_joints_of_the_known_skeletons_are_guessed() -> None:
    right, wrong = 0, []
    for naming in known_namings():
        single = {c: theirs[0] for c, theirs in naming.centres.items() if len(theirs) == 1}
        found = guessed(tuple(single.values()))
        assert len(set(found.values())) == len(found)
        right += sum(found.get(centre) == name for centre, name in single.items())
        wrong += [
            (naming.title, centre, name)
            for centre, name in found.items()
            if single.get(centre, name) != name
        ]
    assert right > 200
    assert not wrong


def mapping_of(text: str, folder: Path) -> dict[str, tuple[str, ...]]:
    path = folder / "mapping.toml"
    path.write_text(text, encoding="utf-8")
    return dict(read_mapping(path).centres)


def uncommented(text: str) -> str:
    return re.sub(r"^# (?=\w+ = )", "", text, flags=re.MULTILINE)


@pytest.mark.parametrize("names", [("Skel_L_Elbow", "Skel_R_UpperArm", "box"), (), CENTRES, WILD])
def test_the_template_is_a_mapping_file(names: tuple[str, ...], tmp_path: Path) -> None:
    text, guess = template(names, WANTED), guessed(names)
    assert mapping_of(text, tmp_path) == {centre: (name,) for centre, name in guess.items()}
    whole = mapping_of(uncommented(text), tmp_path)
    assert list(whole) == list(WANTED)
    assert whole == {centre: (guess.get(centre, ""),) for centre in WANTED}
    # All that follows the centres is comment, a line for each name.
    lines = text.removesuffix("\n").split("\n")
    behind = lines[lines.index("# The recording has:") + 1 :]
    assert len(behind) == len(names)
    assert all(line.startswith("#   ") and line.isprintable() for line in behind)


def test_names_are_written_as_they_are_or_as_toml_has_them() -> None:
    text = template(("R_Hip", 'a "b"\\', "é 左", "x\ny"), ("right_hip", "nose"))
    assert text.split("\n")[2:] == [
        'right_hip = "R_Hip"',
        '# nose = ""',
        "",
        "# The recording has:",
        '#   "R_Hip"',
        r'#   "a \"b\"\\"',
        '#   "é 左"',
        r'#   "x\u000ay"',
        "",
    ]


@pytest.mark.slow
@settings(deadline=2000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(names=st.lists(st.text(max_size=12), max_size=6))
def test_no_name_breaks_the_template(names: list[str], tmp_path: Path) -> None:
    theirs = tuple(f"L_Hip {name}" for name in names)
    mapped = mapping_of(template(theirs, WANTED), tmp_path)
    assert {name for found in mapped.values() for name in found} <= set(theirs)
