"""The pages of an optimum and of a group's place in a browser, and the pictures on them."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from browsing import PATIENCE
from report_samples import AWKWARD, EASY, posture

from ergoqp.human import Body
from ergoqp.placing.optimise import begin_from, optimise
from ergoqp.placing.place import PoseParametrization, Slice, slices_through
from ergoqp.problem.load import load_problem
from ergoqp.report import palette
from ergoqp.report.body.figure import Drawing, Standing, lineup
from ergoqp.report.charts.strips import Spot, score_map
from ergoqp.report.optimum_page import change_of, place_words
from ergoqp.rest.model_person import ModelPerson

SECTIONS = {
    "optimum": [
        "Postures",
        "Map",
        "Segments and reasons",
        "At rest, and with the posture chosen",
        "Assumptions",
        "Starts",
        "Options",
    ],
    "group": [
        "Postures",
        "People",
        "What could be made adjustable",
        "Map of the highest score",
        "Map of the mean score",
        "Reasons",
        "Assumptions",
        "Options",
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["optimum", "group"])
@pytest.mark.parametrize("width", [390, 1000])
def test_page_in_a_browser(browser, place_pages, name, width):
    context = browser.new_context(viewport={"width": width, "height": 900})
    page = context.new_page()
    requests, errors = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on(
        "console", lambda message: errors.append(message.text) if message.type == "error" else None
    )
    page.goto(place_pages[name].as_uri(), wait_until="load", timeout=PATIENCE)
    assert page.locator("h2").all_inner_texts() == SECTIONS[name]
    charts = page.locator("svg.chart[role=img]:visible")
    assert charts.count() >= 3
    for i in range(charts.count()):
        box = charts.nth(i).bounding_box()
        assert box["width"] > 50
        assert box["height"] > 20
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    context.close()
    assert errors == []
    assert requests == [place_pages[name].as_uri()]


@pytest.mark.parametrize("name", ["optimum", "group"])
def test_words_are_escaped_and_the_page_is_small(place_pages, name):
    text = place_pages[name].read_text(encoding="utf-8")
    assert "<i>Desk" not in text
    assert "&lt;i&gt;Desk&lt;/i&gt; &amp; more" in text
    assert "<iframe" not in text
    assert len(text) < 500_000


def test_a_slice_is_what_the_person_does_there(desk):
    follower = ModelPerson(desk.response)
    pose = np.eye(4)
    pose[:3, 3] = (0.42, 1e-8, 0.7)  # on an end of the workspace, to rounding
    (found,) = slices_through(desk, [follower], pose, spacing=0.15)
    assert (found.across, found.up) == (3, 2)
    comfort = follower.response.comfort
    soles, grasp = follower.stand(comfort), follower.grasp(comfort)
    for row, column in ((0, 5), (2, 0), (5, 9)):
        there = np.eye(4)
        there[:3, 3] = (0.42, 0.0, found.vertical[row])
        angle = found.horizontal[column]
        there[:3, :3] = [
            [np.cos(angle), 0, np.sin(angle)],
            [0, 1, 0],
            [-np.sin(angle), 0, np.cos(angle)],
        ]
        rest, reached = follower.settle(comfort, there, grasp, soles)
        assert found.scores[0, row, column] == (desk.assess(rest).final[0] if reached else 0)


def test_tilts_outside_the_cone_are_no_places():
    dentist = load_problem("dentist")
    follower = ModelPerson(dentist.response)
    box = next(limit for limit in dentist.limits if hasattr(limit, "lower"))
    height = replace(box, lower=(0.4, 0.0, 0.8), upper=(0.4, 0.0, 0.8))
    turning = replace(dentist.twist_limit, axes=("rx", "ry", "rz"))
    kept = [limit for limit in dentist.limits if limit not in (box, dentist.twist_limit)]
    fixed = dentist.replace(limits=[turning, height, *kept])
    middle = PoseParametrization.of(fixed).pose(np.array([0.4, 0.0, 0.8, 0.0, 0.0]))
    (found,) = slices_through(fixed, [follower], middle)
    assert (found.across, found.up) == (3, 4)
    assert found.scores[0, 0, 0] == -1
    assert found.scores[0, 5, 5] >= 0


def made_slice(scores, across=0, up=2):
    rows, columns = scores.shape[1:]
    return Slice(
        across,
        up,
        np.linspace(-0.2, 0.2, columns),
        np.linspace(0.5, 1.0, rows),
        scores,
        np.zeros(5),
    )


def parsed(svg):
    assert "nan" not in svg.lower()
    return ET.fromstring(svg)


def test_a_map_has_a_numbered_cell_per_place():
    scores = np.array([[[1, 4, 0], [2, 9, -1]]])
    values = scores[0].astype(float)
    root = parsed(
        score_map(made_slice(scores), values, "map", [Spot(np.array([0.2, 0, 1.0, 0, 0]), "best")])
    )
    cells = [
        (rect.get("class"), rect.find("title").text)
        for rect in root.iter("rect")
        if rect.find("title") is not None
    ]
    assert [style for style, _ in cells] == ["level0", "level2", "missed", "level1", "level3"]
    assert [words.rpartition(": ")[2] for _, words in cells] == ["1", "4", "not reached", "2", "9"]
    assert cells[0][1].startswith("x −0.2, z 0.5")
    texts = [text.text for text in root.iter("text")]
    assert {"1", "4", "2", "9", "best", "x, forward, m", "z, height, m"} <= set(texts)
    assert "80 % of the places reached" in root.find("desc").text


def test_up_is_up_and_who_cannot_reach_is_told():
    scores = np.array([[[1, 2, 3], [4, 4, 4]]])
    root = parsed(
        score_map(
            made_slice(scores, across=3),
            np.array([[1.0, 0.0, 2.4], [4, 4, 4]]),
            "map",
            missing=lambda row, column: f"p{column}",
        )
    )
    cells = [rect for rect in root.iter("rect") if rect.find("title") is not None]
    # Turning about y by a negative angle tilts up, and up is to the right.
    assert float(cells[0].get("x")) > float(cells[2].get("x"))
    assert cells[1].find("title").text.endswith("not reached by p1")
    assert cells[2].get("class") == "level1"
    assert "2.4" in [text.text for text in root.iter("text")]


def standing(label, stature, angles, score):
    body = Body.of_stature(stature)
    base, contact = np.eye(4), np.eye(4)
    base[2, 3], contact[:3, 3] = 0.53 * stature, (0.4, -0.2, 1.0)
    segments = dict.fromkeys(palette.SEGMENTS, 1)
    return Standing(label, score, Drawing(body, posture(angles), base, segments, contact))


def test_a_row_of_people_is_on_one_scale():
    root = parsed(lineup([standing("small", 1.5, EASY, 2), standing("tall", 2.0, EASY, 5)], "row"))
    lines = [line for line in root.iter("line") if line.get("stroke")]
    highest = []
    for left, right in ((0.0, 0.5), (0.5, 1.0)):
        width = float(root.get("viewBox").split()[2])
        tops = [
            float(line.get("y1"))
            for line in lines
            if left * width <= float(line.get("x1")) < right * width
        ]
        highest.append(min(tops))
    floor = next(float(line.get("y1")) for line in root.iter("line") if line.get("class") == "axis")
    assert (floor - highest[0]) / (floor - highest[1]) == pytest.approx(1.5 / 2.0, rel=0.02)
    dots = [circle for circle in root.iter("circle") if circle.get("class") == "dot"]
    assert len({circle.get("cy") for circle in dots}) == 1
    assert {"REBA 2", "REBA 5", "small", "tall"} <= {text.text for text in root.iter("text")}


def test_a_long_row_is_broken():
    people = [standing(f"person {i}", 1.7, AWKWARD, 8) for i in range(11)]
    root = parsed(lineup(people, "row"))
    assert float(root.get("viewBox").split()[2]) <= 800
    floors = {line.get("y1") for line in root.iter("line") if line.get("class") == "axis"}
    assert len(floors) >= 2


def test_words():
    assert change_of(7, 3) == "4 points better."
    assert change_of(2, 3) == "1 point worse."
    assert change_of(2, 2) == "The score does not change."
    pose = np.eye(4)
    pose[:3, 3] = (-0.001, -0.25, 1.0)
    assert place_words(pose).replace("\u00a0", " ") == "x 0.00, y −0.25, z 1.00 m"


@pytest.mark.slow
def test_the_map_of_an_optimum_is_of_the_same_hold():
    """Held as in a twisted posture, on soles that stand apart: the map's cell at the best place has
    the optimum's score."""
    problem = load_problem("screwing")
    follower = ModelPerson(problem.response)
    now = posture(
        AWKWARD | {"right_wrist_flexion": 40, "left_hip_abduction": 10, "left_ankle_inversion": 5}
    )
    best = optimise(problem, now, starts=3)
    held = begin_from(follower, best.posture_before, best.pose_before)
    start = replace(held, posture=best.posture, pose=best.pose)
    for found in slices_through(problem, [follower], best.pose, starts=[start], spacing=0.3):
        row = int(np.argmin(np.abs(found.vertical - best.pose[2, 3])))
        column = int(np.argmin(np.abs(found.horizontal - found.point[found.across])))
        there = best.pose.copy()
        there[found.across, 3], there[2, 3] = found.horizontal[column], found.vertical[row]
        rest, reached = follower.settle(best.posture, there, held.grasp, held.soles)
        assert reached
        assert found.scores[0, row, column] == problem.assess(rest).final[0]
