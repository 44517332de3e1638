from dataclasses import replace

import pytest
from browsing import ARGUMENTS, CHROMIUM
from report_samples import make_recording, make_run

from ergoqp.lab.group import best_for_group
from ergoqp.lab.group_search import read_people
from ergoqp.placing.optimise import optimise
from ergoqp.problem.load import load_problem
from ergoqp.report.group_page import write_group_page
from ergoqp.report.optimum_page import write_optimum_page
from ergoqp.report.run_page import write_run_page
from ergoqp.report.score_page import write_score_page
from ergoqp.sheets import reba


@pytest.fixture(scope="session")
def run():
    return make_run()


@pytest.fixture(scope="session")
def recording():
    return make_recording()


@pytest.fixture(scope="session")
def browser():
    if CHROMIUM is None:
        pytest.skip("no chromium executable on the PATH")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def pages(tmp_path_factory):
    """A run's and a recording's page."""
    folder = tmp_path_factory.mktemp("pages")
    run = make_run(
        3,
        50,
        title="<i>Screwing</i> & more",
        recording="a<b>.bvh",
        reasons=["<script>bad()</script>"] * 151,
    )
    write_run_page(run, folder / "run.html")
    recording = make_recording(2, 50)
    assessment = reba.assess(recording.postures, seated=True)
    write_score_page(
        recording, assessment, folder / "score.html", [("load", "0 kg")], "take<1>.bvh"
    )
    return {"run": folder / "run.html", "score": folder / "score.html"}


@pytest.fixture(scope="session")
def desk():
    return load_problem("desk")


@pytest.fixture(scope="session")
def place_pages(desk, tmp_path_factory):
    """An optimum's and a group's page."""
    folder = tmp_path_factory.mktemp("places")
    best = replace(optimise(desk, starts=2), title="<i>Desk</i> & more")
    write_optimum_page(
        best,
        desk,
        folder / "optimum.html",
        cooperative=optimise(desk, starts=1, mode="cooperative"),
    )
    people = read_people(desk, (1.5, 1.9))
    found = replace(best_for_group(desk, people, starts=1, cache=False), title="<i>Desk</i> & more")
    write_group_page(found, desk, people, folder / "group.html")
    return {"optimum": folder / "optimum.html", "group": folder / "group.html"}
