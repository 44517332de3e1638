"""The browser that the tests of pages use, where there is one."""

import shutil

CHROMIUM = next(
    (
        found
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
PATIENCE = 120_000  # of software rendering on a busy machine [ms]


def replay_of(page):
    """Return the replay of a page, once it plays."""
    replay = page.frame_locator("iframe")
    replay.locator("[role=slider]").first.wait_for(state="attached", timeout=PATIENCE)
    return replay
