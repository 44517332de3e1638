"""The sheet's data: cells, monotony, published cases, combine."""

import itertools
import json

import numpy as np
import pytest
from reba_facts import CASES, TABLES
from sheet_postures import posture

from ergoqp import reba
from ergoqp.errors import InputError
from ergoqp.sheets.interval import interval_sheet
from ergoqp.sheets.options import sheet_of

SHEET = sheet_of(reba.Method())
NAMES = {
    "neck": "neck",
    "trunk": "trunk",
    "legs": "legs",
    "upper": "upper_arm",
    "lower": "lower_arm",
    "wrist": "wrist",
}
# Cases whose angles are measured by our conventions; the scores of what they leave out come from
# their segments.
WITH_ANGLES = {
    "ergo_edge_ext_one_leg",
    "ergovision_stoop",
    "ergo_edge_worst",
    "ergo_edge_neutral",
    "ergo_edge_left_arm",
    "ergo_edge_lift",
    "ergo_edge_lift_act",
    "ergovision_neutral90",
    "ergo_edge_shock",
}


@pytest.mark.parametrize("name", "ABC")
def test_cells_are_the_verified_ones(name):
    np.testing.assert_array_equal(SHEET.tables[name].cells, TABLES[name])


def test_the_facts_are_those_of_the_reference(shared):
    cells = json.loads((shared / "reba" / "tables.json").read_text(encoding="utf-8"))
    for name, table in TABLES.items():
        np.testing.assert_array_equal(table, cells[name])
    cases = json.loads((shared / "reba" / "cases.json").read_text(encoding="utf-8"))["cases"]
    assert len(cases) == len(CASES)
    for case in cases:
        ours = CASES[case["id"].replace(".", "_")]
        assert (ours["source"], ours["expected"]) == (case["source"], case["expected"])
        assert ours.get("angles") == (case["angles_deg"] or None)
        assert segments_of(ours) == (case["segments"] or {})


def test_there_are_240_cells_and_every_table_rises_along_every_axis():
    assert sum(table.cells.size for table in SHEET.tables.values()) == 240
    for table in SHEET.tables.values():
        for axis in range(table.cells.ndim):
            assert (np.diff(table.cells, axis=axis) >= 0).all()


@pytest.mark.parametrize("sheet_given", [lambda: SHEET, interval_sheet], ids=["reba", "interval"])
def test_no_band_of_a_segment_scores_less_than_one_by_itself(sheet_given):
    # The sheet is read in the test: mutants find the tests of a line by who runs it.
    for segment in sheet_given().segments.values():
        assert segment.start + min(segment.base.scores) >= 1, segment.name


def test_every_joint_is_read_by_one_segment_at_most():
    joints = [
        segment.joint(step, side)
        for segment in SHEET.segments.values()
        for step in segment.steps
        for side in (("right", "left") if segment.worse_side else segment.sides)
    ]
    assert len(joints) == len(set(joints)) == 22


def test_action_levels():
    assert reba.ACTION_LEVELS == ("negligible", "low", "medium", "high", "very high")
    assert SHEET.level_starts == (1, 2, 4, 8, 11)


def segments_of(case):
    if "cell" in case:
        return {"table": case["cell"][0], "index": case["cell"][1:]}
    return case.get("segments", {})


def our_scores(segments):
    if "table" in segments:
        cells = SHEET.tables[segments["table"]].cells
        return {"cell": int(cells[tuple(i - 1 for i in segments["index"])])}
    if "score_a" in segments:
        segments = {"neck": 1, "trunk": 2, "legs": 1, "load": 1, "upper": 6, "lower": 1, "wrist": 2}
    points = {name: segments.get(name, 0) for name in ("load", "coupling", "activity")}
    scores = reba.combine(**{name: segments.get(key, 1) for key, name in NAMES.items()}, **points)
    return {name: int(getattr(scores, name)) for name in vars(scores)}


def test_published_cases_agree_by_their_segments():
    assert len(CASES) == 25
    wrong = {
        name
        for name, case in CASES.items()
        if segments_of(case)
        and not case["expected"].items() <= our_scores(segments_of(case)).items()
    }
    assert wrong == {"ugeyik_tableC_3_4"}, "that one contradicts every worksheet and must disagree"


@pytest.mark.parametrize("name", sorted(WITH_ANGLES))
def test_published_cases_agree_by_their_angles(name):
    angles, segments = CASES[name]["angles"], CASES[name]["segments"]
    degrees = {
        "trunk_flexion": angles["trunk"],
        "trunk_twist": 30 if angles.get("trunk_twisted") else 0,
        "neck_flexion": angles["neck"],
    }
    for side in ("right", "left"):
        degrees |= {
            f"{side}_shoulder_flexion": angles["upper"],
            f"{side}_elbow_flexion": angles.get("lower", 0),
            f"{side}_knee_flexion": angles["knee"],
            f"{side}_wrist_flexion": 30 if segments["wrist"] > 1 else 0,
            f"{side}_wrist_deviation": 20 if segments["wrist"] > 2 else 0,
        }
    supported = bool(angles.get("arm_supported"))
    one_leg = segments["legs"] - (angles["knee"] > 30) - (angles["knee"] > 60) == 2
    shock = segments["load"] == 3 or bool(angles.get("shock"))
    result = reba.assess(
        posture(**degrees),
        load_kg=angles.get("load_kg", {0: 0, 1: 7, 2: 12}[segments["load"] - shock]),
        shock=shock,
        coupling=segments["coupling"],
        activity=segments["activity"],
        one_leg=one_leg,
        arm_supported=(supported, supported),
    )
    assert {key: int(result.segments[full][0]) for key, full in NAMES.items()} == {
        key: segments[key] for key in NAMES
    }
    assert result.final[0] == our_scores(segments)["final"]


def test_pause_case_disagrees_by_the_sign_of_its_neck_alone():
    case = CASES["pause_test_joint_data"]
    degrees = {
        "trunk_flexion": 70,
        "trunk_side_bend": 20,
        "right_knee_flexion": 70,
        "left_knee_flexion": 75,
    }
    degrees |= {
        "right_shoulder_flexion": 55,
        "right_shoulder_abduction": 15,
        "right_wrist_flexion": 5,
    }
    degrees |= {"right_elbow_flexion": 40, "left_elbow_flexion": 70}
    assert reba.assess(posture(neck_flexion=20, **degrees), activity=1).final[0] == 9
    assert (
        reba.assess(posture(neck_flexion=-20, **degrees), activity=1).final[0]
        == case["expected"]["final"]
        == 10
    )


def test_the_publication_s_own_example():
    scores = reba.combine(
        neck=2, trunk=5, legs=3, upper_arm=3, lower_arm=2, wrist=1, coupling=1, activity=1
    )
    assert (scores.table_a, scores.score_a, scores.table_b, scores.score_b) == (8, 8, 4, 5)
    assert (scores.score_c, scores.final) == (10, 11)
    degrees = {
        "trunk_flexion": 65,
        "trunk_side_bend": 15,
        "neck_flexion": -10,
        "right_knee_flexion": 70,
    }
    degrees |= {
        "right_shoulder_flexion": 60,
        "right_shoulder_abduction": 30,
        "right_elbow_flexion": 40,
    }
    result = reba.assess(posture(**degrees), coupling=1, activity=1, arm_supported=(True, False))
    assert (result.final[0], result.band[0], result.arm[0]) == (11, 4, "right")


def test_combine_is_monotone_and_reaches_1_and_15():
    axes = [range(1, size + 1) for size in (3, 5, 4, 6, 2, 3)]
    grid = np.array(list(itertools.product(*axes))).T.reshape(6, 3, 5, 4, 6, 2, 3)
    final = reba.combine(**dict(zip(NAMES.values(), grid, strict=True))).final
    assert final.shape == (3, 5, 4, 6, 2, 3)
    for axis in range(6):
        assert (np.diff(final, axis=axis) >= 0).all()
    assert final.min() == 1
    assert (
        reba.combine(
            **dict(zip(NAMES.values(), grid, strict=True)), load=3, coupling=3, activity=3
        ).final.max()
        == 15
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("neck", 4),
        ("neck", 0),
        ("neck", 1.5),
        ("neck", np.nan),
        ("neck", "two"),
        ("wrist", None),
        ("trunk", 6),
        ("legs", 5),
        ("upper_arm", 7),
        ("lower_arm", 3),
        ("wrist", 4),
        ("load", 4),
        ("coupling", -1),
        ("activity", 4),
    ],
)
def test_combine_names_what_is_out_of_range(name, value):
    good = dict.fromkeys(NAMES.values(), 1)
    with pytest.raises(InputError, match=f"^{name}: got .*allowed: "):
        reba.combine(**(good | {name: value}))


def test_combine_names_shapes_that_do_not_fit():
    good = dict.fromkeys(NAMES.values(), 1)
    with pytest.raises(InputError, match=r"neck \(2,\).*trunk \(3,\).*broadcast"):
        reba.combine(**(good | {"neck": [1, 1], "trunk": [1, 1, 1]}))
