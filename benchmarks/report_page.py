"""Pages of runs in a real browser: size, requests, errors, first drawing.

``python -m benchmarks.report_page FOLDER...``; needs playwright and Chromium, as the tests of the page do.
"""

from __future__ import annotations

import os
import shutil
import statistics
from pathlib import Path

from playwright.sync_api import sync_playwright

from benchmarks.table import words

ROUNDS = 3
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)


def main(folders: list[str]) -> None:
    """Print a line a page."""
    words = ["--enable-unsafe-swiftshader", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=words)
        for page in (Path(folder).resolve() / "report.html" for folder in folders):
            requests, errors, drawn = list[str](), list[str](), list[float]()
            for _ in range(ROUNDS):
                tab = browser.new_page(viewport={"width": 1280, "height": 800})
                tab.on("request", lambda request, seen=requests: seen.append(request.url))
                tab.on("pageerror", lambda error, seen=errors: seen.append(str(error)))
                tab.on(
                    "console",
                    lambda said, seen=errors: seen.append(said.text) if said.type == "error" else None,
                )
                tab.goto(page.as_uri())
                while not tab.evaluate("window.page ? window.page.data.firstDrawing : 0"):
                    tab.wait_for_timeout(10)  # asked from outside: the page's policy forbids `eval` inside
                drawn.append(tab.evaluate("window.page.data.firstDrawing"))
                tab.close()
            others = sum(not url.startswith("file:") for url in requests)
            print(
                f"{page.parent.name}: {page.stat().st_size / 1e6:.2f} MB, {others} requests, {len(errors)} "
                f"errors, first drawing {statistics.median(drawn):.0f} ms",
                flush=True,
            )
        browser.close()


if __name__ == "__main__":
    main(words(__doc__))
