"""Whoever reads a page otherwise than by eye and mouse, on a telephone or on paper, gets all of it.

axe-core looks for what it can find by itself; the rest is asked for below.
"""

import pytest
from browsing import PATIENCE, replay_of

NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"


@pytest.fixture
def opened(browser, pages, place_pages):
    """Open a page, with what is folded unfolded if asked."""
    contexts = []

    def opened(name, width=1000, scheme="light", script=""):
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        if script:
            context.add_init_script(script)
        page = context.new_page()
        address = {**pages, **place_pages}[name].as_uri()
        page.goto(address, wait_until="load", timeout=PATIENCE)
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (420, "dark")])
@pytest.mark.parametrize("name", ["run", "score", "optimum", "group"])
def test_axe_finds_nothing_serious(opened, name, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = opened(name, width, scheme)
    if name in ("run", "score"):
        replay_of(page)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    # axe does not look into the replay by itself.
    for frame in page.frames:
        found = axe.run(frame).response["violations"]
        bad = [
            (rule["id"], node["target"], node["failureSummary"])
            for rule in found
            for node in rule["nodes"]
            if rule["impact"] in ("serious", "critical")
        ]
        assert bad == []


@pytest.mark.slow
def test_every_control_of_the_replay_has_a_name(opened):
    replay = replay_of(opened("run"))
    replay.get_by_role("button", name="Pause").click(timeout=PATIENCE)
    replay.get_by_role("button", name="Play").wait_for(timeout=PATIENCE)
    names = replay.locator("button, input:not([type=hidden]), [role=slider]").evaluate_all(
        "all => all.filter(each => !each.closest('.mantine-Notifications-root'))"
        ".map(each => each.getAttribute('aria-label'))"
    )
    assert len(names) >= 4
    assert all(names)


def test_the_wheel_is_the_page_s_until_the_replay_is_clicked(opened):
    page = opened("score")
    replay = replay_of(page)
    page.locator("iframe").scroll_into_view_if_needed()
    begun = page.evaluate("scrollY")
    box = page.locator("iframe").bounding_box()
    x, y = box["x"] + 200, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.wheel(0, 120)
    page.wait_for_function(f"scrollY > {begun + 60}", timeout=PATIENCE)
    page.wait_for_timeout(500)  # until it has come to rest
    page.mouse.click(x, y)
    replay.locator("html.awake").wait_for(timeout=PATIENCE)
    before = page.evaluate("scrollY")
    page.mouse.wheel(0, 200)
    page.wait_for_timeout(500)
    assert page.evaluate("scrollY") == before
    page.mouse.move(2, 500)
    replay.locator("html:not(.awake)").wait_for(timeout=PATIENCE)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_replay_is_as_dark_as_the_page(opened, scheme):
    page = opened("score", scheme=scheme)
    replay = replay_of(page)
    assert replay.locator("html").get_attribute("data-mantine-color-scheme") == scheme


def test_without_webgl_a_sentence_and_the_pictures_are_there(opened):
    page = opened("run", script=NO_WEBGL)
    assert page.locator("iframe").count() == 0
    assert page.get_by_text("This browser shows no replay").is_visible()
    assert page.locator(".live:visible").count() == 0
    assert page.locator(".pair svg:visible").count() == 2


def test_without_javascript_too(browser, pages):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(pages["run"].as_uri(), wait_until="load", timeout=PATIENCE)
    assert page.get_by_text("This browser shows no replay").is_visible()
    assert not page.locator("iframe").is_visible()
    context.close()


@pytest.mark.parametrize("name", ["run", "score", "optimum", "group"])
def test_letters_of_charts_are_large_enough_on_a_telephone(opened, name):
    page = opened(name, 420, script=NO_WEBGL)
    heights = page.evaluate(
        """() => [...document.querySelectorAll("svg.chart text")]
            .filter(each => each.getClientRects().length)
            .map(each => parseFloat(getComputedStyle(each).fontSize) * each.getScreenCTM().d)
            .map(Math.abs).filter(height => height > 0)"""
    )
    assert heights
    assert min(heights) > 8.5
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_options_are_folded_and_printed(opened):
    page = opened("run", script=NO_WEBGL)
    seed = page.locator("details td", has_text="seed")
    assert seed.count() == 1
    assert not seed.is_visible()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert seed.is_visible()
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert not seed.is_visible()
