import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_samples import EASY, posture

from ergoqp.human import Body
from ergoqp.report import palette
from ergoqp.report.body.figure import posture_figure
from ergoqp.report.charts.over_time import lines_chart, score_chart, shares_chart, timing_chart
from ergoqp.report.charts.strips import Strip, segments_chart, segments_strips, strips_chart


def parsed(svg):
    root = ET.fromstring(svg)
    assert root.tag == "svg"
    assert root.find("title") is not None
    assert root.find("desc").text
    assert "nan" not in svg.lower()
    assert "inf" not in "".join(path.get("d") for path in root.iter("path"))
    return root


def words(root):
    return [text.text for text in root.iter("text")]


def test_score_chart_names_its_bands_axes_and_marks():
    time = np.arange(100) / 10
    final = np.repeat([9, 4], 50)
    root = parsed(score_chart(time, final, final + 0.1, [(0.0, 9, "before"), (9.9, 4, "after")]))
    assert {
        "time, s",
        "REBA score",
        "negligible",
        "low",
        "medium",
        "high",
        "before 9",
        "after 4",
    } <= set(words(root))
    assert "From 9 to 4, highest 9, lowest 4." in root.find("desc").text


def test_score_chart_leaves_a_gap_where_there_is_no_score():
    root = parsed(score_chart(np.arange(6.0), np.array([3, 3, 0, 0, 5, 5])))
    line = next(path for path in root.iter("path") if path.get("class") == "line score")
    assert line.get("d").count("M") == 2


def test_score_chart_of_nothing_scored():
    assert (
        "No score." in parsed(score_chart(np.arange(3.0), np.zeros(3, dtype=int))).find("desc").text
    )


@pytest.mark.parametrize("count", [1, 2, 60_000])
def test_charts_of_any_length_are_small(count):
    random = np.random.default_rng(0)
    time = np.arange(count) / 1000
    final = random.integers(1, 13, count)
    segments = {name: random.integers(1, 3, count) for name in palette.SEGMENTS}
    drawn = [
        score_chart(time, final, final + random.normal(size=count)),
        lines_chart(
            "twist", time, {"vx": random.normal(size=count), "vy": np.zeros(count)}, "mm/s"
        ),
        segments_strips(time, segments),
        timing_chart(1e-5 * random.lognormal(size=count), 0.001),
    ]
    for svg in drawn:
        parsed(svg)
        assert len(svg) < 1_300_000


def test_lines_without_a_number_leave_an_empty_frame():
    parsed(
        lines_chart(
            "fit error", np.arange(5.0), {"fit error": np.full(5, np.nan)}, "mm", from_zero=True
        )
    )


def test_timing_chart_says_median_and_period():
    root = parsed(timing_chart(np.full(10, 4e-5), 0.01))
    assert {"median 40 µs", "max 40 µs", "period 10 ms"} <= set(words(root))
    parsed(timing_chart(np.full(3, np.nan), 0.01))


def test_shares_are_written():
    root = parsed(
        shares_chart("share", {"": {"low risk": 0.75, "high risk": 0.25, "none": 0.0}}, [1, 3, -1])
    )
    assert {"75 %", "25 %", "low risk, 75.0 %", "none, 0.0 %"} <= set(words(root))


def test_shares_of_several_scores_are_bars_with_names():
    bars = {"lowest": {"low": 1.0, "high": 0.0}, "highest": {"low": 0.25, "high": 0.75}}
    root = parsed(shares_chart("share", bars, [1, 3]))
    assert {"lowest", "highest", "100 %", "25 %", "75 %", "low", "high"} <= set(words(root))
    assert "highest: low 25.0 %; high 75.0 %." in root.find("desc").text


def areas(root):
    return [path.get("d") for path in root.iter("path") if path.get("class") == "span"]


def test_score_chart_fills_from_the_lowest_to_the_highest():
    time, final = np.arange(6.0), np.array([3, 3, 0, 0, 5, 5])
    low, high = np.array([2, 2, 0, 0, 5, 4]), np.array([4, 7, 0, 0, 5, 9])
    root = parsed(score_chart(time, final, marks=[(4.0, 5, "worst")], ends=(low, high)))
    (area,) = areas(root)
    assert area.count("M") == area.count("Z") == 2
    assert {"lowest to highest", "REBA, likeliest posture", "worst 5", "high"} <= set(words(root))
    assert "It may be 2 to 9." in root.find("desc").text
    # The highest value of a column of many samples is not lost.
    many = np.full(60_000, 2)
    peak = many.copy()
    peak[31_000] = 12
    (long,) = areas(parsed(score_chart(np.arange(60_000) / 100, many, ends=(many, peak))))
    top = min(float(point.split()[1]) for point in long[1:-1].split("L"))
    (flat,) = areas(parsed(score_chart(np.arange(60_000) / 100, many, ends=(many, many + 10))))
    assert top == min(float(point.split()[1]) for point in flat[1:-1].split("L"))


def test_strips_of_segments_are_grey_where_not_seen_and_tell_the_highest():
    time = np.arange(4.0)
    segments = {name: np.array([1, 1, -1, 0]) for name in palette.SEGMENTS}
    most = {name: np.array([0, 2, 3, 0]) for name in palette.SEGMENTS}
    notes = dict.fromkeys(palette.SEGMENTS, "mean 1.0 to 3.0 of 3")
    root = parsed(segments_strips(time, segments, most, notes))
    drawn = [
        (rect.get("class"), rect.find("title").text)
        for rect in root.iter("rect")
        if rect.find("title") is not None and rect.find("title").text.startswith("legs")
    ]
    assert drawn == [
        ("level0", "legs: 1, 0.00 to 2.00 s"),
        ("unscored", "legs: not seen, 2.00 to 3.00 s"),
        ("level1", "legs: at most 2, 1.00 to 2.00 s"),
        ("level2", "legs: at most 3, 2.00 to 3.00 s"),
    ]
    assert "mean 1.0 to 3.0 of 3" in words(root)


def test_strips_show_a_single_step():
    values = np.zeros(10_000, dtype=int)
    values[5000] = 1
    strip = Strip("speed", values, {1: ("active", "active")}, "< 1 %")
    root = parsed(strips_chart("limits", np.arange(10_000) / 100, [strip]))
    active = [rect for rect in root.iter("rect") if rect.get("class") == "active"]
    assert len(active) == 1
    assert float(active[0].get("width")) >= 1


@pytest.mark.slow
@given(st.text(min_size=1, max_size=80).filter(lambda text: text.isprintable()))
def test_names_in_charts_are_escaped(name):
    strip = Strip(name, np.array([1, 0]), {1: ("active", name)}, name)
    root = ET.fromstring(strips_chart(name, np.arange(2.0), [strip]))
    assert root.find("desc").text == f"{name} {name}."


def test_segments_before_and_after():
    before = dict.fromkeys(palette.SEGMENTS, 2)
    root = parsed(segments_chart(before, before | {"neck": 1}))
    assert "2 → 1" in words(root)
    assert words(root).count("2, unchanged") == len(palette.SEGMENTS) - 1


def test_figure_has_the_colours_of_the_scores():
    svg = posture_figure(
        Body(),
        posture(EASY),
        np.eye(4),
        dict.fromkeys(palette.SEGMENTS, 1) | {"trunk": 5},
        "before",
        np.eye(4),
    )
    parsed(svg)
    assert palette.COLOURS[0] in svg
    assert palette.COLOURS[4] in svg
