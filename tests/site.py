"""The built site as a reader meets it: `python -m tests.site docs/_build` opens every page in a browser.

At a telephone's and at a desktop's width no page may be wider than the window, no column of a table so narrow that its
words stand letter under letter, and no picture missing. No page may complain, ask another host for anything, show
marks of a markup language, or have a link that leads nowhere. Ends with status 1 when one does.
"""

from __future__ import annotations

import re
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from tests.demos.browser import Page, windows

WIDTHS = (360, 1280)
# Made by Sphinx of others' parts, or tested as pages of their own.
NOT_PAGES = ("_static", "_sources", "_downloads", "demos")
# Pixels of a column in which a word of more letters than these stands letter under letter.
COLUMN, WORD = 24, 8
FAULTS = """
const [width, column, word] = arguments, found = [], wide = document.documentElement.scrollWidth;
if (wide > width) found.push(`is ${wide} pixels wide in a window of ${width}`);
for (const cell of document.querySelectorAll('article td')) {
  const style = getComputedStyle(cell), text = cell.textContent.trim();
  const room = cell.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
  if (room < column && text.length > word) found.push(`has a column of ${room} pixels for "${text.slice(0, 30)}"`);
}
for (const image of document.querySelectorAll('article img'))
  if (image.complete && image.naturalWidth === 0) found.push(`lacks the picture ${image.getAttribute('src')}`);
return found;
"""


class Text(HTMLParser):
    """The links of a page, the names that a link can end on, and what the article says outside scripts' code."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()
        self.said: list[str] = []
        self._open: list[tuple[str, bool]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {key: value or "" for key, value in attrs}
        self.names.add(values.get("id", ""))
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in ("article", "div"):
            # Code and what it printed may hold any mark; a docstring's example may not be escaped.
            kinds = values.get("class", "").split()
            self._open.append((tag, "highlight" in kinds or any(k.startswith("highlight-") for k in kinds)))

    def handle_endtag(self, tag: str) -> None:
        if self._open and tag == self._open[-1][0]:
            self._open.pop()

    def handle_data(self, data: str) -> None:
        if any(tag == "article" for tag, _ in self._open):
            is_code = any(code for _, code in self._open)
            self.said.extend(
                re.findall(r".{0,20}\\[*_|].{0,20}" if is_code else r".{0,20}(?:`|\\[*_|]).{0,20}", data)
            )


@cache
def read(file: Path) -> Text:
    text = Text()
    text.feed(file.read_text(encoding="utf-8"))
    return text


def pages(site: Path) -> list[Path]:
    """Files of the site that are pages, sorted."""
    return sorted(p for p in site.rglob("*.html") if p.relative_to(site).parts[0] not in NOT_PAGES)


def broken(file: Path) -> list[str]:
    """What is wrong with the text of a page and with its links into the site."""
    text = read(file)
    found = [f"shows a mark of markup: {part.strip()}" for part in text.said]
    for link in text.links:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
        if not target.is_file():
            found.append(f"has a link to {link}, which is not there")
        elif parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in read(target).names:
            found.append(f"has a link to {link}, where no such place is")
    return found


def seen(page: Page, file: Path, width: int) -> list[str]:
    """What a browser finds wrong with a page in a window of `width` pixels."""
    page.open(file, width=width)
    faults = page.run(FAULTS, width, COLUMN, WORD)
    return [
        *faults,
        *(f"complains: {said}" for said in page.complaints()),
        *(f"asks for {url}" for url in page.requests()),
    ]


def faults(site: Path, page: Page) -> list[str]:
    """Every fault of every page, a line each."""
    found = []
    for file in pages(site):
        name = file.relative_to(site)
        found += [f"{name} {fault}" for fault in broken(file)]
        for width in WIDTHS:
            found += [f"{name} at {width}: {fault}" for fault in seen(page, file, width)]
    return found


def main(arguments: list[str]) -> int:
    (folder,) = arguments
    site = Path(folder).resolve()
    number = len(pages(site))
    for page in windows():
        found = faults(site, page)
        print(*found, f"{number} pages of {folder}, {len(found)} faults", sep="\n")
        return int(bool(found) or number == 0)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
