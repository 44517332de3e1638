"""Draw the README's picture anew.

``python docs/picture.py REPORT.html`` takes it from a report, in headless Chromium.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

ARGUMENTS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
MARGIN = 12

report = Path(sys.argv[1]).resolve()
picture = Path(__file__).parent / "images" / "report.png"
with sync_playwright() as playwright:
    browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
    page = browser.new_page(viewport={"width": 1000, "height": 900})
    page.goto(report.as_uri())
    # The two postures, and the chart of the score below them, without the replay between.
    page.locator("section", has=page.locator("iframe")).evaluate("each => each.remove()")
    first = page.locator("section .columns").first.bounding_box()
    last = page.locator("section").nth(1).locator("figure svg").first.bounding_box()
    assert first is not None
    assert last is not None
    page.screenshot(
        path=picture,
        full_page=True,
        clip={
            "x": min(first["x"], last["x"]) - MARGIN,
            "y": first["y"],
            "width": max(first["width"], last["width"]) + 2 * MARGIN,
            "height": last["y"] + last["height"] - first["y"],
        },
    )
    browser.close()
print(picture, picture.stat().st_size, "bytes")
