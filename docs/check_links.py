"""Check the built site without a network: ``python docs/check_links.py FOLDER``.

Every link to a page, a file or a place on a page leads somewhere, and no page fetches anything from another
host. Links to other hosts, which a reader follows, are counted, not fetched.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

FETCHED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "video": "src"}
CODE = ("code", "pre", "script", "style")


class Page(HTMLParser):
    """The ids of a page, its links, and what a browser loads with it."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.unread: list[str] = []  #: Markdown that was left as text
        self.code = 0
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take up one element."""
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in FETCHED and FETCHED[tag] in given:
            self.loads.append(given[FETCHED[tag]])
        self.code += tag in CODE

    def handle_endtag(self, tag: str) -> None:
        """Leave one element."""
        self.code -= tag in CODE

    def handle_data(self, data: str) -> None:
        """Look for links that are text."""
        if "](" in data and not self.code:
            self.unread.append(data.strip()[:80])


def faults(folder: Path) -> tuple[list[str], int, int]:
    """What is wrong, how many links within the site were followed, and how many lead outside."""
    pages = {file.resolve(): Page(file) for file in folder.rglob("*.html") if "_static" not in file.parts}
    wrong, inside, outside = [], 0, 0
    for file, page in pages.items():
        where = file.relative_to(folder.resolve())
        wrong += [f"{where}: not read as a link: {text}" for text in page.unread]
        for link in [*page.loads, *page.links]:
            parts = urlsplit(link)
            if parts.scheme == "data":
                continue
            if parts.scheme or parts.netloc:
                outside += 1
                if link in page.loads:
                    wrong.append(f"{where}: loads {link}")
                continue
            inside += 1
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not target.is_file():
                wrong.append(f"{where}: {link} does not exist")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids:
                wrong.append(f"{where}: {link} names no place on that page")
    for style in folder.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        wrong += [
            f"{style.name}: loads from another host" for mark in ("url(http", "@import") if mark in text
        ]
    return wrong, inside, outside


if __name__ == "__main__":
    found, followed, left = faults(Path(sys.argv[1]))
    print(*found, sep="\n", end="\n" if found else "")
    print(
        f"{followed} links and files within the site, {left} links to other hosts not fetched, {len(found)} "
        "wrong"
    )
    sys.exit(bool(found))
