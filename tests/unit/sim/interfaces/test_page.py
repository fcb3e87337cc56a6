"""Pages of results: what is text is escaped, numbers stand right, and what is empty is left out."""

import re

from matplotlib.figure import Figure

from uuv.sim.interfaces import page
from uuv.sim.interfaces.page import Html


def test_text_is_escaped_once_wherever_it_is_put_in():
    """From title to cell; what a function of the module returned is HTML and stays as it is."""
    odd = "a < b & 'c'"
    parts = [
        page.heading(odd, False, reasons=[odd], notes=[odd], about=odd),
        page.section(odd, page.table([odd], [[odd]]), page.paragraph(odd), page.items([odd])),
        page.folded(odd, page.paragraph(page.strong(odd))),
        page.provenance({odd: odd}),
    ]
    document = page.page(odd, parts)
    assert odd not in document
    assert "&amp;lt;" not in document
    assert document.count("a &lt; b &amp; &#x27;c&#x27;") == 14


def test_columns_of_numbers_are_marked_and_columns_of_text_are_not():
    rows = [("drag", 2.5, "kg/m", page.verdict(True, ("ok", "missed")))]
    table = page.table(("name", "value", "unit", ""), rows, texts=(0, 2, 3))
    assert re.findall(r"<t[hd] class=n>([^<]*)<", table) == ["value", "2.5"]
    assert "<td><span class='accepted'>ok</span></td>" in table
    assert page.table((), []) == ""
    assert page.table(("name",), []) == "<table><tr><th>name</th></tr></table>"


def test_verdict_and_its_reasons_stand_in_the_heading():
    refused = page.heading("run", False, reasons=["force error 3 N, bound 2 N"])
    assert "<h1>run <span class='not-accepted'>not accepted</span></h1>" in refused
    assert "<ul class=reasons><li>force error 3 N, bound 2 N</li></ul>" in refused
    assert page.heading("run") == "<header><h1>run</h1></header>"


def test_sections_without_content_are_left_out():
    assert page.section("none", Html(), Html()) == page.folded("none") == ""
    assert page.page("t", [page.heading("t"), Html()]).count("<section") == 0


def test_figures_are_embedded_so_that_a_page_fetches_nothing():
    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0.0, 1.0], [0.3, 0.7])
    document = page.page("t", [page.figure("a < b", "as measured", figure)] * 2)
    assert document.count('src="data:image/svg+xml;base64,') == document.count("src=") == 2
    assert document.count("<p class=caption>as measured</p>") == 2
    assert 'alt="a &lt; b"' in document


def test_cards_for_notebooks_need_no_style_sheet():
    card = page.card("runs/a", False, ["lost < contact"], [("force error", "1.25", "N")])
    assert "class=" not in card
    assert "not accepted: lost &lt; contact" in card
    assert '<td>force error</td><td style="text-align:right">1.25</td><td>N</td>' in card
