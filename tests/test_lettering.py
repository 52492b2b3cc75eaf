"""What people read holds formulas as they are written by hand: no epsilon, omega, sqrt( or ** beside them."""

import re
from html.parser import HTMLParser

import pytest

import gsp
from gsp import models
from gsp.report import write_report
from gsp.results.lettering import GREEK
from tests.analyses import analysis_of
from tests.cards.test_cards import NOUNS, QUICK
from tests.cases import sampled, thinned
from tests.test_transport import noun

PLAIN = re.compile(rf"\b(?:{'|'.join(GREEK)})\b|sqrt\(|\*\*|\w\^\w|\b[a-z]_[0-9]\b|<=")


class Words(HTMLParser):
    """The text that a reader sees: not scripts and styles, nor what is offered to be typed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.seen: list[str] = []
        self.hidden = 0
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs) -> None:
        self.hidden += tag in ("script", "style", "code", "kbd")
        self.hidden += tag == "pre" and not dict(attrs).get("style")

    def handle_endtag(self, tag) -> None:
        self.hidden -= self.hidden > 0 and tag in ("script", "style", "code", "kbd", "pre")

    def handle_data(self, data: str) -> None:
        if not self.hidden:
            self.seen.append(data)


def plain_in(page: str) -> list[str]:
    text = " ".join(Words(page).seen)
    return [text[max(0, found.start() - 40) : found.end() + 20] for found in PLAIN.finditer(text)]


@pytest.mark.parametrize("name", sampled(NOUNS, always=QUICK))
def test_a_card_is_lettered(name: str) -> None:
    assert plain_in(noun(name)._repr_html_()) == []


@pytest.mark.parametrize("name", sampled(["chaplygin_sleigh", "van_der_pol"], always=["van_der_pol"]))
def test_a_report_is_lettered(name: str, tmp_path) -> None:
    page = write_report(analysis_of(name), tmp_path / "report")
    assert plain_in(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("name", thinned(models.names(), 5))
def test_a_demo_is_lettered_in_words_menus_and_pictures(name: str, page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load(name), tmp_path / "demo.html"))
    read = (
        "const drawn = []; const proto = CanvasRenderingContext2D.prototype; const kept = proto.fillText;"
        "proto.fillText = function (text, ...at) { drawn.push(text); kept.call(this, text, ...at); };"
        "document.querySelectorAll('details').forEach((part) => (part.open = true));"
        "const seen = []; for (let step = 0; step < Math.max(1, data.story.length); step++) {"
        "  if (data.story.length) turnTo(step); update(); seen.push(document.body.innerText); }"
        "proto.fillText = kept; const said = [...document.querySelectorAll('[aria-label]')];"
        "return [...seen, ...drawn, ...said.map((part) => part.getAttribute('aria-label'))].join(' | ');"
    )
    text = page.run(read)
    assert [text[max(0, m.start() - 40) : m.end() + 20] for m in PLAIN.finditer(text)] == []
