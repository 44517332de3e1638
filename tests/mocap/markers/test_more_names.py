"""Names of several marker sets beside each other, and mappings that add to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from marker_takes import NAMES, PLACES, at, read, said, undisturbed

from ergoqp.mocap import load_recording
from ergoqp.mocap.naming import known_namings, known_sets, landmarks_in

USUAL = {
    # name: (landmark, markers beside which it stands)
    "VSAC": ("sacrum", NAMES),
    "R.PSIS": ("right_psis", ("R.ASIS", "L.ASIS", "R.Shoulder", "L.Shoulder", "R.Knee", "L.Knee")),
    "L.PSIS": ("left_psis", ("R.ASIS", "L.ASIS", "R.Shoulder", "L.Shoulder", "R.Knee", "L.Knee")),
    "S2": ("sacrum", ("R.ASIS", "L.ASIS", "R.Shoulder", "L.Shoulder", "R.Knee", "L.Knee")),
    "R.Bicep": ("right_upper_arm", ("R.ASIS", "L.ASIS", "V.Sacral", "R.Acromium", "L.Acromium")),
    "R_SAJ": ("right_acromion", ("R_IAS", "L_IAS", "R_IPS", "L_IPS", "SXS", "CV7", "R_FLE")),
    "SNJ": ("notch", ("R_IAS", "L_IAS", "R_IPS", "L_IPS", "SXS", "CV7", "R_FLE")),
    "C7": ("c7", ("R_IAS", "L_IAS", "R_IPS", "L_IPS", "SXS", "SJN", "R_FLE")),
    "RBAC": (None, NAMES),
    "CHEST": (None, NAMES),
}
MORE = ("R.Elbow", "L.Elbow", "R.Wrist", "L.Wrist", "R_HLE", "L_HLE", "R_HME", "L_HME")


@pytest.mark.parametrize("name", USUAL)
def test_usual_names(name: str) -> None:
    landmark, others = USUAL[name]
    names = (*(each for each in (*others, *MORE) if each != name), name)
    best = landmarks_in(names)
    assert best is not None
    assert {mark for mark, theirs in best[1].items() if theirs == name} == (
        set() if landmark is None else {landmark}
    )


def test_a_name_with_several_meanings_is_not_taken_from_another_set() -> None:
    # In one set it is the notch, in another the chest below it.
    best = landmarks_in((*NAMES, "CHEST"))
    assert best is not None
    assert best[0] is known_sets()[0]
    assert "CHEST" not in best[1].values()


def test_no_known_skeleton_is_taken_for_markers() -> None:
    for naming in known_namings():
        names = tuple({name for theirs in naming.centres.values() for name in theirs})
        best = landmarks_in(names)
        assert best is None or len(best[1]) <= len(naming.found_in(names)), naming.title


def test_a_set_without_its_back_markers_is_read_by_another_name() -> None:
    kept = tuple(name for name in NAMES if name not in {"RPSI", "LPSI"})
    back = (PLACES[:, at("RPSI")] + PLACES[:, at("LPSI")]) / 2
    places = np.concatenate([PLACES[:, at(*kept)], back], axis=1)
    recording = read(places, (*kept, "VSAC"))
    assert recording.scored.mean() > 0.95 * undisturbed().scored.mean()
    other = read(places, (*kept, "V.Sacral"))
    assert "Named as in other sets: V.Sacral." in said(other)
    np.testing.assert_array_equal(other.postures, recording.postures)
    assert "other sets" not in said(recording)


@pytest.mark.parametrize("line", ['right_wrist_thumb = "XX"', 'left_asis = "nothing"'])
def test_a_line_is_added_to_a_set(line: str, tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text(f"{line}\n", encoding="utf-8")
    names = tuple("XX" if name == "RWRA" else name for name in NAMES)
    recording = read(PLACES, names if "XX" in line else NAMES, mapping=mapping)
    np.testing.assert_array_equal(recording.postures, undisturbed().postures)
    assert "The mapping file map.toml is added to them." in said(recording)
    lacks = "The mapping file map.toml names nothing, which the recording does not have."
    assert (lacks in said(recording)) is ("nothing" in line)


def test_markers_whose_names_suggest_a_place_are_proposed() -> None:
    theirs = {
        f"{letter}{short}": f"{letter}_{name}"
        for letter in "RL"
        for short, name in (("ELB", "ArmLatEpicondyle"), ("ANK", "LatMalleolus"))
    }
    recording = read(PLACES, tuple(theirs.get(name, name) for name in NAMES))
    assert 'right_outer_elbow = "R_ArmLatEpicondyle"' in said(recording)
    assert 'left_outer_ankle = "L_LatMalleolus".' in said(recording)
    assert "suggest" not in said(undisturbed())


def test_one_wrist_marker_of_motion_analysis() -> None:
    names = tuple({"RWRA": "RWRI", "LWRA": "LWRI"}.get(name, name) for name in NAMES)
    np.testing.assert_array_equal(read(PLACES, names).postures, undisturbed().postures)


def test_a_joint_centre_beside_markers(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text('head_top = "Top"\nright_head_front = ""\n', encoding="utf-8")
    top = PLACES[:, at("RFHD")] + [0.0, 0.0, 0.1]
    places = np.concatenate([PLACES, top], axis=1)
    recording = read(places, (*NAMES, "Top"), mapping=mapping)
    assert "head_top" in recording.errors
    assert not {"Top", "RFHD"} & set(recording.markers)


def test_a_marker_that_is_needed_and_there_twice(tmp_path: Path) -> None:
    take = tmp_path / "take.trc"
    names = (*NAMES, "LASI")
    head = "\t".join(["Frame#", "Time", *(f"{name}\t\t" for name in names)])
    axes = "\t".join(["", "", *(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(names) + 1))])
    top = f"PathFileType\t4\nDataRate\tUnits\n60\tm\n{head}\n{axes}\n"
    for off in (0.0, 0.1):
        places = np.concatenate([PLACES[:30], PLACES[:30, at("LASI")] + off], axis=1)
        rows = [
            "\t".join([str(i), f"{i / 60:.4f}", *(f"{v:.4f}" for v in row)])
            for i, row in enumerate(places.reshape(30, -1))
        ]
        take.write_text(top + "\n".join(rows) + "\n", encoding="utf-8")
        used = said(load_recording(take, up="z"))
        if off:
            assert "the others are left out: LASI (up to 173 mm apart)." in used
        else:
            assert "more than once, of which the first is used: LASI" in used
