"""Draw the README's picture of a shared place anew, in headless Chromium.

Run ``python docs/workplace_picture.py REPORT.html``.

REPORT.html is what ``ergoqp group overhead --people 1.55,1.65,1.75,1.85,1.95 --objective mean``
writes.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

ARGUMENTS = ["--headless=new", "--no-sandbox"]
MARGIN = 12

# The row of people, and the maps of the highest score; nothing else.
ONLY = """
for (const section of document.querySelectorAll("section")) {
  const title = section.querySelector("h2").textContent;
  if (!["Postures", "Map of the highest score"].includes(title)) section.remove();
}
document.querySelectorAll("header, footer, h2, .intro, section:first-of-type .legend, "
  + "section:first-of-type figcaption")
  .forEach(each => each.remove());
"""

report = Path(sys.argv[1]).resolve()
picture = Path(__file__).parent / "images" / "workplace.png"
with sync_playwright() as playwright:
    browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
    page = browser.new_page(viewport={"width": 940, "height": 900})
    page.goto(report.as_uri())
    page.evaluate(ONLY)
    box = page.locator("main").bounding_box()
    last = page.locator("section").last.bounding_box()
    assert box is not None
    assert last is not None
    clip = {
        "x": box["x"] + MARGIN,
        "y": MARGIN,
        "width": box["width"] - 2 * MARGIN,
        "height": last["y"] + last["height"],
    }
    page.screenshot(path=picture, full_page=True, clip=clip)
    browser.close()
print(picture, picture.stat().st_size, "bytes")
