"""Serious findings of axe-core on pages, in headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, sync_playwright

WIDTHS: Final = (1400, 420)
"""Of the window: a desk's and a telephone's [pixels]."""
SCHEMES: Final = ("light", "dark")
SERIOUS: Final = ("serious", "critical")
ARGUMENTS: Final = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE: Final = 120_000
"""With a replay that software draws [ms]."""


def serious_of(pages: Sequence[Path], say: Callable[[str], None]) -> int:
    """Return the number of elements with a serious finding, over all widths and schemes.

    Args:
        pages: HTML files.
        say: gets a line for each finding.

    Raises:
        SystemExit: without Chromium.
    """
    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = next((found for name in names if (found := shutil.which(name))), None)
    if chromium is None:
        raise SystemExit("benchmarks.site: found no Chromium, which axe-core runs in")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        found = [
            f"{page.parent.name}/{page.name}, {width} pixels, {scheme}: {each}"
            for page in pages
            for width in WIDTHS
            for scheme in SCHEMES
            for each in _findings(browser, page, width, scheme)
        ]
        browser.close()
    for each in found:
        say(each)
    return len(found)


def _findings(browser: Browser, path: Path, width: int, scheme: str) -> list[str]:
    size = {"width": width, "height": 900}
    context = browser.new_context(viewport=size, color_scheme=scheme)  # type: ignore[arg-type]
    page = context.new_page()
    page.goto(path.as_uri(), wait_until="load", timeout=PATIENCE)
    if page.query_selector("iframe"):
        slider = page.frame_locator("iframe").locator("[role=slider]").first
        slider.wait_for(state="attached", timeout=PATIENCE)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    # axe does not look into the replay by itself.
    found = [
        f"{rule['id']}: {node['target']}"
        for frame in page.frames
        for rule in Axe().run(frame).response["violations"]  # type: ignore[arg-type]
        if rule["impact"] in SERIOUS
        for node in rule["nodes"]
    ]
    context.close()
    return found
