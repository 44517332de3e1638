"""The pages in a browser: complete, quiet and on their own."""

import threading
from dataclasses import replace
from html.parser import HTMLParser

import msgspec
import numpy as np
import pytest
from browsing import PATIENCE
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_samples import make_recording, make_run

from ergoqp.report.body.person import Movement, timing_of
from ergoqp.report.body.scene import scene_html
from ergoqp.report.page import (
    Headline,
    Page,
    PageTable,
    Picture,
    Section,
    is_seated,
    render,
    write_page,
)
from ergoqp.report.run_page import write_run_page
from ergoqp.report.score_page import write_score_page
from ergoqp.sheets import reba

SERIES = [
    "time",
    "postures",
    "base_poses",
    "poses",
    "twists",
    "reba",
    "cost",
    "statuses",
    "reasons",
    "active",
    "step_time",
]


@pytest.mark.parametrize("name", ["run", "score"])
def test_page_in_a_browser(browser, pages, name):
    context = browser.new_context(viewport={"width": 1000, "height": 900})
    page = context.new_page()
    requests, errors = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on(
        "console", lambda message: errors.append(message.text) if message.type == "error" else None
    )
    page.goto(pages[name].as_uri(), wait_until="load", timeout=PATIENCE)

    replay = page.frame_locator("iframe")
    replay.locator("canvas").first.wait_for(state="visible", timeout=PATIENCE)
    bar = replay.locator("[role=slider]").first
    bar.wait_for(state="attached", timeout=PATIENCE)
    seconds = float(bar.get_attribute("aria-valuemax"))
    assert seconds == pytest.approx(3 if name == "run" else 2, abs=0.1)

    charts = page.locator("svg.chart[role=img]:visible")
    assert charts.count() >= 6
    for i in range(charts.count()):
        box = charts.nth(i).bounding_box()
        assert box["width"] > 50
        assert box["height"] > 20
    assert page.locator("h2").all_inner_texts()[:3] == ["Postures", "Replay", "Score"]
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    context.close()

    assert errors == []
    outside = [url for url in requests if not url.startswith(("file:", "data:", "blob:", "about:"))]
    assert outside == []
    assert [url for url in requests if url.startswith("file:")] == [pages[name].as_uri()]


def test_pages_are_small_and_escaped(pages):
    texts = {name: path.read_text(encoding="utf-8") for name, path in pages.items()}
    assert all(len(text) < 3_000_000 for text in texts.values())
    assert "<i>Screwing" not in texts["run"]
    assert "&lt;i&gt;Screwing&lt;/i&gt; &amp; more" in texts["run"]
    assert "<script>bad()" not in texts["run"]
    assert "take&lt;1&gt;.bvh" in texts["score"]


NASTY = ("<script>", "</title><b>", '"><img src=x>', "{{ page }}", "&amp;", "'")


class Reader(HTMLParser):
    """Collects the tags outside the fixed head, and the words of every table cell."""

    def __init__(self):
        super().__init__()
        self.tags, self.words = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)

    def handle_data(self, data):
        self.words.append(data)


def page_with(words):
    return Page(
        title=words,
        subtitle=words,
        headlines=[Headline(words, words, 2, words)],
        change=words,
        facts=[(words, words)],
        replay=words,
        replay_note=words,
        figures=[Picture("<svg></svg>", words)],
        sections=[
            Section(
                words,
                words,
                [Picture("<svg></svg>", words)],
                [PageTable((words,), [(words,)], [0], [0])],
                [words],
            )
        ],
    )


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None, max_examples=60)
@given(
    st.one_of(
        st.text(max_size=40),
        st.sampled_from(["<script>", "</title><b>", '"><img src=x>', "{{ page }}", "&amp;", "'"]),
    )
)
def test_words_of_the_user_never_become_markup(words):
    plain, given_words = Reader(), Reader()
    plain.feed(render(page_with("x")))
    given_words.feed(render(page_with(words or "y")))
    assert given_words.tags == plain.tags
    if words.strip() and words.isprintable():
        assert words.strip() in "".join(given_words.words)


def test_a_name_that_no_encoding_can_write_is_still_written(tmp_path):
    write_page(page_with("take\udcff.bvh"), tmp_path / "page.html")
    assert "take?.bvh" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_nothing_is_printed_and_no_thread_is_left(tmp_path, capfd):
    before = threading.active_count()
    write_run_page(make_run(0.3), tmp_path / "run.html")
    assert capfd.readouterr() == ("", "")
    assert threading.active_count() <= before + 1


def test_a_recording_without_any_score_still_has_a_page(tmp_path):
    recording = make_recording(2, 50)
    lost = {"arms not seen": np.ones(len(recording.time), dtype=bool)}
    recording = replace(recording, not_scored=lost)
    write_score_page(
        recording, reba.assess(recording.scored_postures), tmp_path / "score.html", [], "nothing"
    )
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    assert "no frame could be scored" in page
    assert "arms not seen" in page


def test_the_same_reason_is_told_once(tmp_path):
    run = make_run(1)
    reasons = [
        f"outside, coming back: workspace x by {0.1 - i / 1000:.3f}" for i in range(len(run.time))
    ]
    write_run_page(
        replace(run, reasons=reasons, statuses=["recovering"] * len(run.time)),
        tmp_path / "run.html",
    )
    assert (tmp_path / "run.html").read_text(encoding="utf-8").count("workspace x by") == 1


def test_the_time_out_of_balance_is_told(tmp_path):
    for share, told in ((0.0, False), (0.125, True)):
        path = tmp_path / "run.html"
        write_run_page(replace(make_run(0.2), unbalanced=share), path)
        assert ("12.5 % of the time" in path.read_text(encoding="utf-8")) == told


def test_a_seated_person_has_a_seat(tmp_path):
    run = make_run(0.2)
    seated = replace(run, assessment=reba.assess(run.postures[[0, -1]], seated=True))
    movement = Movement(
        run.body,
        run.time,
        run.postures,
        run.base_poses,
        run.reba,
        {},
        None,
        is_seated(seated.assessment),
    )
    assert movement.seated
    timing = timing_of(run.time)
    assert len(scene_html(movement, timing)) > len(
        scene_html(replace(movement, seated=False), timing)
    )


def test_poses_written_into_the_recording_are_those_of_the_setters(monkeypatch, caplog):
    run = make_run(0.5)
    way = run.base_poses.copy()
    way[:, :3, 3] += np.random.default_rng(0).normal([0.5, 0.0, 0.3], 0.02, (len(way), 3))
    forces = np.random.default_rng(1).normal(0.0, 20.0, (len(way), 6))
    movement = Movement(
        run.body,
        run.time,
        run.postures,
        run.base_poses,
        run.reba,
        {"trunk": np.arange(len(way)) // 9 % 4},
        way,
        held=True,
        forces=forces,
    )
    timing = timing_of(run.time)
    caplog.set_level("INFO", logger="ergoqp.report")
    written = scene_html(movement, timing)
    assert not caplog.text
    monkeypatch.setattr(msgspec, "Raw", None)  # as in a viser whose recordings are built otherwise
    assert scene_html(movement, timing) == written
    assert "poses are set one by one" in caplog.text


def test_a_run_of_one_step_has_a_page(tmp_path):
    run = make_run(0.2)
    cut = {name: getattr(run, name)[:1] for name in SERIES}
    write_run_page(
        replace(run, **cut, assessment=reba.assess(run.postures[:1])), tmp_path / "run.html"
    )
    assert (tmp_path / "run.html").stat().st_size > 100_000
