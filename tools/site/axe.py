"""Serious findings of axe-core on pages, in headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, Literal

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, sync_playwright

WIDTHS: Final = (1400, 420)
"""Of the window: a desk's and a telephone's [pixels]."""
SCHEMES: Final[tuple[Literal["light", "dark"], ...]] = ("light", "dark")
SERIOUS: Final = ("serious", "critical")
ARGUMENTS: Final = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
OPTIONS: Final = {"resultTypes": ["violations"]}
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
        raise SystemExit("tools.site: found no Chromium, which axe-core runs in")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        found = [
            each
            for page in pages
            for scheme in SCHEMES
            for each in _findings(browser, page, scheme)
        ]
        browser.close()
    for each in found:
        say(each)
    return len(found)


def _findings(browser: Browser, path: Path, scheme: Literal["light", "dark"]) -> Iterator[str]:
    page = browser.new_page(color_scheme=scheme)
    page.goto(path.as_uri(), wait_until="load", timeout=PATIENCE)
    if page.query_selector("iframe"):
        slider = page.frame_locator("iframe").locator("[role=slider]").first
        slider.wait_for(state="attached", timeout=PATIENCE)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        # axe does not look into the replay by itself.
        for frame in page.frames:
            answer = Axe().run(frame, options=OPTIONS).response  # type: ignore[arg-type]
            for rule in answer["violations"]:
                if rule["impact"] in SERIOUS:
                    where = f"{path.parent.name}/{path.name}, {width} pixels, {scheme}"
                    yield from (
                        f"{where}: {rule['id']}: {node['target']}" for node in rule["nodes"]
                    )
    page.close()
