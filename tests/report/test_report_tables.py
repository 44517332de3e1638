import csv
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from report_samples import make_run
from rich.console import Console

from ergoqp.errors import MissingExtraError
from ergoqp.report.run_facts import RunFacts
from ergoqp.report.run_page import write_run_page
from ergoqp.report.score_page import write_score_page
from ergoqp.report.scores import summary_of, write_scores
from ergoqp.report.tables import run_table, score_table
from ergoqp.sheets import reba


def printed(table):
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        console.print(table)
        return console.export_text()


def test_run_table_has_scores_statuses_timing_and_limits(run):
    text = printed(run_table(run))
    facts = RunFacts(run)
    assert f"{facts.before} high" in text
    assert "right upper arm" in text
    assert "settled after" in text
    assert "median" in text
    assert "boundary 2 steps, worst 0.012" in text
    assert "neck_flexion 3 samples" in text


def test_run_table_of_somebody_who_let_go(run):
    text = printed(
        run_table(
            replace(
                run, let_go=2.5, title="[bold]not markup[/bold]", violations={}, person_outside={}
            )
        )
    )
    assert "could not reach any more at 2.5 s" in text
    assert "[bold]not markup[/bold]" in text
    assert "limits broken" in text


def test_facts_follow_from_the_arrays(run):
    facts = RunFacts(run)
    assert sum(facts.status_counts.values()) == len(run.time)
    assert facts.best == run.reba.min()
    assert run.reba[np.searchsorted(run.time, facts.best_at)] == facts.best
    assert facts.settled_after == pytest.approx(0.8 * 6, abs=0.05)
    assert facts.change == f"{facts.before} to {facts.after}."
    alone = RunFacts(replace(run, reba_standing_still=facts.before + 1))
    assert alone.change == (
        f"{facts.before + 1} to {facts.after} by moving the object: {facts.before} at the start,"
        f" {facts.before + 1} had the object stayed where it was."
    )
    same = RunFacts(replace(run, reba_standing_still=facts.before))
    assert same.change == (
        f"{facts.before} to {facts.after} by moving the object ({facts.before} had it stayed)."
    )
    assert facts.costs == "nothing"
    worse = RunFacts(replace(run, assessment=reba.assess(run.postures[:1]), reba=run.reba[:1]))
    assert worse.after == facts.before
    assert worse.costs == " · ".join(worse.stays)
    assert "trunk" in worse.costs
    assert RunFacts(replace(run, statuses=["optimal"] * len(run.time))).settled_after is None


def test_score_table_names_the_worst_frame(recording):
    assessment = reba.assess(recording.scored_postures)
    text = printed(score_table(recording, assessment))
    assert f"{assessment.valid.sum()} of {len(recording.time)} scored" in text
    assert f"max {assessment.final.max()}" in text
    assert assessment.reasons(assessment.worst(recording.time))[0] in text


@pytest.mark.slow
def test_frames_with_the_score_of_the_worst_are_counted(recording, tmp_path):
    assessment = reba.assess(recording.scored_postures)
    highest = int(assessment.final.max())
    first = int(assessment.final.argmax())
    for others in (0, 3):
        final = np.where(assessment.valid, 1, 0)
        usable = np.flatnonzero(assessment.valid & (np.arange(len(final)) >= first))
        final[usable[: others + 1]] = highest
        tied = replace(assessment, final=final)
        worst, frame = summary_of(recording, tied)["worst"], tied.worst(recording.time)
        assert frame in usable[: others + 1]
        assert (worst["frame"], worst["others"]) == (frame, others)
        where = f"rame {frame} at {recording.time[frame]:.2f} s{' and 3 more' if others else ''}:"
        assert f"f{where}" in " ".join(printed(score_table(recording, tied)).split())
        write_score_page(recording, tied, tmp_path / "score.html", [])
        assert f"F{where}" in (tmp_path / "score.html").read_text(encoding="utf-8")


def test_scores_as_files(recording, tmp_path):
    assessment = reba.assess(recording.scored_postures)
    rows, summary = write_scores(recording, assessment, tmp_path / "new" / "folder")
    assert (rows.name, summary.name) == ("scores.csv", "scores.json")
    with rows.open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    assert [int(row["reba"]) for row in read] == assessment.final.tolist()
    assert [int(row["valid"]) for row in read] == assessment.valid.astype(int).tolist()
    assert [int(row["left_wrist"]) for row in read] == assessment.segments["left_wrist"].tolist()
    assert read[22]["risk"] == "not scored"
    assert read[22]["arm"] == ""
    assert float(read[-1]["time_s"]) == pytest.approx(recording.time[-1])

    data = json.loads(summary.read_text(encoding="utf-8"))
    assert data["frames"] == len(recording.time)
    assert data["valid_frames"] == int(assessment.valid.sum())
    assert data["max"] == assessment.final.max() == data["worst"]["reba"]
    assert data["mean"] == pytest.approx(assessment.final[assessment.valid].mean(), abs=1e-4)
    assert sum(data["share"].values()) == pytest.approx(1, abs=1e-5)
    assert list(data["share"]) == list(reba.ACTION_LEVELS)
    assert data["worst"]["reasons"] == assessment.reasons(data["worst"]["frame"])
    assert all(
        sum(each["share"].values()) == pytest.approx(1, abs=1e-5)
        for each in data["segments"].values()
    )


def test_what_was_read_is_in_the_file_and_folded_on_the_page(recording, tmp_path):
    read = {"A:LASI": "left_asis", "A:<i>": ""}
    recording = replace(recording, read=read)
    assessment = reba.assess(recording.scored_postures)
    _, summary = write_scores(recording, assessment, tmp_path)
    assert json.loads(summary.read_text(encoding="utf-8"))["read"] == read
    for given, there in ((recording, True), (replace(recording, read={}), False)):
        write_score_page(given, assessment, tmp_path / "score.html", [])
        page = (tmp_path / "score.html").read_text(encoding="utf-8")
        assert ("What was read" in page) is there
    write_score_page(recording, assessment, tmp_path / "score.html", [])
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    folded = page[page.index("<details") : page.rindex("</details>")]
    assert "What was read" in folded
    assert "A:LASI" in folded
    assert "A:&lt;i&gt;" in folded
    assert "not read" in folded


def test_scores_of_a_recording_that_cannot_be_scored(recording, tmp_path):
    nothing = replace(
        recording,
        fit_error=np.full(len(recording.time), np.nan),
        not_scored={"arms not seen": np.ones(len(recording.time), dtype=bool)},
    )
    assessment = reba.assess(nothing.scored_postures)
    _, summary = write_scores(nothing, assessment, tmp_path)
    data = json.loads(summary.read_text(encoding="utf-8"))
    assert data["valid_frames"] == 0
    assert data["mean"] is data["worst"] is data["fit_error_mm"] is None
    assert "0 of" in printed(score_table(nothing, assessment))


@pytest.mark.parametrize("module", ["viser", "jinja2"])
def test_a_missing_extra_is_named(run, recording, tmp_path, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        MissingExtraError, match=rf"the report page needs the package '{module}'.*\[report\]'`"
    ):
        write_run_page(make_run(0.2), tmp_path / "report.html")
    with pytest.raises(MissingExtraError, match=module):
        write_score_page(
            recording, reba.assess(recording.scored_postures), tmp_path / "report.html", []
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_tables_need_no_extra():
    code = (
        "import sys; sys.modules['viser'] = sys.modules['jinja2'] = None; from ergoqp.report.scores"
        " import write_scores; from ergoqp.report.tables import run_table, score_table"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_what_the_robot_did_stands_on_table_and_page_with_what_can_be_done(run, tmp_path):
    """The page showed at the very end alone that the object had stood still for nine tenths of the
    time."""
    steps = len(run.time)
    reasons = ["robot: late by 80 ms", *["robot: late by 81 ms"] * (steps - 2), ""]
    late = replace(run, reasons=reasons)
    sentence = f"robot: late by 81 ms ({(steps - 1) * run.dt:.1f} s)"
    hint = "elays and errors of a robot can be declared under [robot] in the problem file"
    text = " ".join(printed(run_table(late)).split())
    assert sentence in text
    assert f"d{hint}" in text
    write_run_page(late, tmp_path / "late.html")
    page = (tmp_path / "late.html").read_text(encoding="utf-8")
    assert f"<p>Messages during the run: {sentence}. D{hint}.</p>" in page
    bent = replace(
        run,
        reasons=[
            "left knee flexion measured 4.0 deg beyond its range, held at the end of the range"
        ]
        * steps,
    )
    write_run_page(bent, tmp_path / "bent.html")
    page = (tmp_path / "bent.html").read_text(encoding="utf-8")
    assert "<p>Messages during the run: left knee flexion measured 4.0 deg" in page
    assert hint not in page
