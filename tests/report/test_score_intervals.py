"""A recording that shows a part of the body only: files, table and page give both ends."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from report_samples import make_recording
from rich.console import Console

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.mocap.fitting.unknown import spans_of
from ergoqp.report import palette
from ergoqp.report.between import risk_between
from ergoqp.report.score_page import write_score_page
from ergoqp.report.scores import summary_of, write_angles, write_scores
from ergoqp.report.seen import not_seen, observed_shares, shown_scores
from ergoqp.report.tables import score_table
from ergoqp.sheets import reba

LEGS = [
    joint for name, joint in INDEX.items() if any(part in name for part in ("hip", "knee", "ankle"))
]
WRIST = [INDEX[f"right_{name}"] for name in ("wrist_flexion", "wrist_deviation")]
CAUSE = "right hand off by more than 0.2 m"


@pytest.fixture(scope="module")
def partial():
    """Legs are never seen, the right hand not in the first half, five frames are not scored."""
    recording = make_recording()
    count = len(recording.time)
    early = np.arange(count) < count // 2
    observed = recording.observed.copy()
    observed[:, LEGS] = False
    observed[np.ix_(early, WRIST)] = False
    postures = np.clip(recording.postures, LOWER, UPPER)
    postures[:, LEGS] = 0.0
    postures.setflags(write=False)
    return replace(
        recording,
        postures=postures,
        observed=observed,
        spans=spans_of(postures, observed, recording.time)[0],
        doubts={CAUSE: early},
    )


@pytest.fixture(scope="module")
def scored(partial):
    return assessed(partial)


def assessed(recording, **task):
    return reba.assess(recording.scored_postures, low=recording.low, high=recording.high, **task)


def printed(recording, assessment):
    console = Console(width=160, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        console.print(score_table(recording, assessment))
        return console.export_text()


@pytest.fixture(scope="module")
def page(partial, scored, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "score.html"
    write_score_page(partial, scored, path, [])
    return path.read_text(encoding="utf-8")


def test_rows_hold_both_ends_and_what_is_observed(partial, scored, tmp_path):
    rows, _ = write_scores(partial, scored, tmp_path)
    with rows.open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    valid = scored.valid
    for column, wanted in (
        ("reba_low", scored.final_low),
        ("reba", scored.final),
        ("reba_high", scored.final_high),
        ("legs_low", scored.segments_low["legs"]),
        ("legs_high", scored.segments_high["legs"]),
        ("right_wrist_high", scored.segments_high["right_wrist"]),
    ):
        assert [int(row[column]) for row in read] == (wanted * valid).tolist(), column
    assert {row["legs_observed"] for row in read} == {"0"}
    # Of flexion, deviation and pronation only the last is seen.
    assert [read[0]["right_wrist_observed"], read[-1]["right_wrist_observed"]] == ["0.33", "1"]
    assert (read[0]["doubts"], read[-1]["doubts"]) == (CAUSE, "")
    assert read[22]["not_scored"] == "left elbow not seen"
    assert {read[22][name] for name in ("reba_low", "reba", "reba_high", "neck_high")} == {"0"}


def test_no_statistic_counts_a_frame_that_is_not_scored(partial, scored, tmp_path):
    _, path = write_scores(partial, scored, tmp_path)
    summary = json.loads(path.read_text(encoding="utf-8"))
    valid = scored.valid
    assert 0 < summary["valid_frames"] == valid.sum() < len(valid)
    for end, final in (
        ("_low", scored.final_low[valid]),
        ("", scored.final[valid]),
        ("_high", scored.final_high[valid]),
    ):
        assert summary[f"mean{end}"] == pytest.approx(final.mean(), abs=1e-4)
        assert summary[f"median{end}"] == np.median(final)
        assert summary[f"p95{end}"] == pytest.approx(np.percentile(final, 95), abs=1e-4)
        assert summary[f"max{end}"] == final.max()
        assert sum(summary[f"share{end}"].values()) == pytest.approx(1, abs=1e-5)
    assert summary["share_high"]["negligible"] == np.mean(scored.final_high[valid] == 1)
    assert summary["exact_frames"] == (scored.final_low == scored.final_high)[valid].sum()
    assert summary["doubts"] == {CAUSE: int(partial.doubts[CAUSE].sum())}
    worst = summary["worst"]
    assert worst["reba_low"] <= worst["reba"] <= worst["reba_high"]
    assert worst["reba_high"] == scored.final_high[worst["frame"]]


def test_segments_have_both_ends_and_how_much_of_them_is_seen(partial, scored):
    segments = summary_of(partial, scored)["segments"]
    valid = scored.valid
    for name in palette.SEGMENTS:
        for end, scores in (
            ("_low", scored.segments_low),
            ("", scored.segments),
            ("_high", scored.segments_high),
        ):
            assert segments[name][f"mean{end}"] == pytest.approx(
                scores[name][valid].mean(), abs=1e-4
            )
            assert segments[name][f"max{end}"] == scores[name][valid].max()
    assert segments["legs"]["observed"] == 0
    assert segments["legs"]["usual"] == {"low": 1, "high": 3, "share": 1.0}
    assert segments["neck"]["observed"] == 1
    assert 0.6 < segments["right_wrist"]["observed"] < 0.75


def test_a_segment_that_is_known_without_sensors_is_not_called_unseen(partial):
    seated = assessed(partial, seated=True)
    rows = slice(0, len(partial.time))
    assert not not_seen(partial, rows, seated)["legs"].any()
    assert (observed_shares(partial, rows, seated)["legs"] == 1).all()
    lines = [each.split() for each in printed(partial, seated).splitlines()]
    assert ["legs", "100", "%", "1.00", "1", "1", "100", "%"] in lines


def test_what_is_not_seen_has_no_colour(partial, scored):
    shown, most = shown_scores(partial, scored, palette.SEGMENTS)
    valid = scored.valid
    assert (shown["legs"][valid] == -1).all()
    assert (shown["legs"][~valid] == 0).all()
    assert (most["legs"][valid] == 3).all()
    assert (shown["trunk"] == scored.segments["trunk"]).all()
    assert not most["trunk"].any()
    wrist, open_ = shown["right_wrist"], scored.segments_low["right_wrist"]
    open_ = (open_ < scored.segments_high["right_wrist"]) & valid
    half = len(wrist) // 2
    assert ((wrist[:half] == -1) == open_[:half]).all()
    assert open_[:half].any()
    assert (wrist[half:] > 0).all()


def test_the_table_never_gives_a_bare_score_of_what_is_not_seen(partial, scored):
    text = printed(partial, scored)
    summary = summary_of(partial, scored)
    lines = {line.split("  ")[0]: line for line in text.splitlines()}
    assert "not seen" in lines["legs"]
    assert "1.0 to 3.0" in lines["legs"]
    assert f"{summary['exact_frames']} of {summary['valid_frames']}" in lines["one score, no range"]
    assert f"{summary['mean_high']:.2f}" in lines["REBA"]
    assert {"time at risk, lowest scores", "time at risk, highest scores"} <= set(lines)
    assert CAUSE in lines["in doubt"]
    worst = summary["worst"]
    assert f"{worst['reba_low']} to {worst['reba_high']}" in lines["worst"]


def test_the_page_gives_both_ends_and_leaves_the_unseen_grey(scored, partial, page):
    summary = summary_of(partial, scored)
    assert f"{summary['mean_low']:.1f} to {summary['mean_high']:.1f}" in page
    assert 'class="levels"' in page
    assert '<span class="chip none">not seen</span>' in page
    assert "not seen, 1 to 3" in page
    assert "Not seen: legs." in page
    assert "Seen in part, or for a part of the time: right wrist." in page
    assert "lowest to highest" in page
    assert "Highest scores: " in page
    assert "in doubt, and taken as not seen" in page
    assert "set to zero" not in page


def test_a_recording_of_which_nothing_is_lost_looks_as_if_there_were_no_ends(tmp_path):
    recording = make_recording()
    assessment = assessed(recording)
    write_score_page(recording, assessment, tmp_path / "score.html", [])
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    for words in ("lowest to highest", "not seen</span>", 'class="levels"', "no range"):
        assert words not in page
    assert ">REBA</text>" in page
    assert "REBA, exact" not in page
    text = printed(recording, assessment)
    assert "seen" not in text.replace("left elbow not seen", "")
    assert "no range" not in text


def test_headlines_have_a_colour_only_if_the_ends_share_a_level(partial, scored, tmp_path):
    final = np.where(scored.valid, 9, 0)
    for highest, coloured in ((10, True), (11, False)):
        other = replace(scored, final=final, final_low=final, final_high=final * highest // 9)
        write_score_page(partial, other, tmp_path / "score.html", [])
        page = (tmp_path / "score.html").read_text(encoding="utf-8")
        assert ('class="headline level3 ends"' in page) == coloured
        assert ('class="levels"' in page) != coloured
        words = "high risk" if coloured else "high to very high risk"
        assert f'<span class="words">{words}' in page


def test_it_is_said_that_another_frame_may_reach_more_than_the_worst(partial, scored, tmp_path):
    final = np.where(scored.valid, 3, 0)
    final[10], highest = 4, final.copy()
    highest[10], highest[30] = 4, 8
    other = replace(scored, final=final, final_low=final, final_high=highest)
    summary = summary_of(partial, other)
    assert (summary["worst"]["frame"], summary["worst"]["reba_high"]) == (10, 4)
    said = "REBA 4, medium; other frames may reach 8, high"
    (line,) = (each for each in printed(partial, other).splitlines() if each.startswith("worst"))
    assert line.rstrip().endswith(said)
    write_score_page(partial, other, tmp_path / "score.html", [])
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    assert f"{said}." in page
    assert '<span class="words">medium risk; other frames may reach 8, high</span>' in page
    # Without such a frame nothing is added.
    same = replace(scored, final=final, final_low=final, final_high=final)
    assert "may reach" not in printed(partial, same)


def test_risk_has_both_ends_and_the_arm_is_empty_where_either_may_count(partial, tmp_path):
    low, high = partial.low.copy(), partial.high.copy()
    for side in ("right", "left"):
        low[:20, INDEX[f"{side}_shoulder_flexion"]] = np.nan
        high[:20, INDEX[f"{side}_shoulder_flexion"]] = np.nan
    scored = reba.assess(partial.scored_postures, low=low, high=high)
    rows, path = write_scores(partial, scored, tmp_path)
    with rows.open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    known = scored.arm_known
    assert known[scored.valid].any()
    assert not known[scored.valid].all()
    for i, row in enumerate(read):
        if scored.valid[i]:
            assert row["risk"] == risk_between(scored.final_low[i], scored.final_high[i])
            assert row["arm"] == (scored.arm[i] if known[i] else "")
        else:
            assert (row["risk"], row["arm"]) == ("not scored", "")
    assert any(" to " in row["risk"] for row in read)
    worst = json.loads(path.read_text(encoding="utf-8"))["worst"]
    assert (worst["risk"], worst["arm"]) == tuple(
        read[worst["frame"]][name] for name in ("risk", "arm")
    )


def test_an_angle_that_is_not_observed_has_an_empty_cell(partial, tmp_path):
    observed = partial.observed.copy()
    observed[5, INDEX["left_shoulder_abduction"]] = False
    recording = replace(partial, observed=observed)
    table, motion = write_angles(recording, tmp_path)
    with table.open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    for i, row in enumerate(read):
        for joint, j in INDEX.items():
            cell = row[f"{joint}_deg"]
            if observed[i, j]:
                assert float(cell) == pytest.approx(np.degrees(partial.postures[i, j]), abs=1e-4)
            else:
                assert cell == ""
        for name in ("elevation", "elevation_plane"):
            assert (row[f"left_{name}_deg"] == "") == (i == 5)
            assert row[f"right_{name}_deg"]
    lines = motion.read_text(encoding="utf-8").splitlines()
    values = [line.split("\t") for line in lines[lines.index("endheader") + 2 :]]
    assert np.isfinite(np.array(values, dtype=float)).all()
