"""Each fault that a reader of the site would meet is found, and a page without one is left alone."""

from pathlib import Path

import pytest

from tests import site

HEAD = '<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width"><article>'
SOUND = """<h1 id="top">A page</h1><p>Words, <code>a_b</code> and <a href="other.html#here">a link</a>.</p>
<div class="highlight-python"><pre style="overflow: auto">a = r"\\d", `x`, and a line that is longer than
                                                                      any telephone</pre></div>"""


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("", None),
        ('<div style="width: 500px">wide</div>', "at 360: is 5"),
        ('<table style="width: 20px; table-layout: fixed"><td>hyperbolicity</td></table>', "has a column of"),
        ('<img src="gone.png">', "lacks the picture gone.png"),
        ('<a href="nowhere.html">x</a>', "link to nowhere.html, which is not there"),
        ('<a href="other.html#there">x</a>', "link to other.html#there, where no such place is"),
        ("<p>through epsilon^`correction`</p>", "shows a mark of markup: through epsilon^`"),
        ('<div class="highlight"><pre>x\\**3</pre></div>', "shows a mark of markup: x\\*"),
        ("<script>missing()</script>", "complains: "),
        ('<img src="https://example.invalid/x.png">', "asks for https://example.invalid/x.png"),
    ],
)  # fmt: skip
def test_a_fault_of_the_site_is_found(fault: str, said: str | None, page, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(HEAD + SOUND + fault, encoding="utf-8")
    (tmp_path / "other.html").write_text(HEAD + '<p id="here">Here.</p>', encoding="utf-8")
    found = site.faults(tmp_path, page)
    assert (found == []) if said is None else any(said in line for line in found), found


def test_parts_that_are_no_pages_are_not_opened(tmp_path: Path) -> None:
    for name in ("index.html", "gallery/a.html", "_static/b.html", "demos/c.html"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(HEAD, encoding="utf-8")
    assert [p.name for p in site.pages(tmp_path)] == ["a.html", "index.html"]
