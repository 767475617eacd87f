from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.report.markup import StyleSheet, clean, table, tag
from tests.unit.sim.report.reading import read


@given(st.text(), st.text())
def test_text_and_attributes_read_back_as_they_were_given(text: str, value: str) -> None:
    page = read(str(tag("p", text, title=value)))
    assert page.elements == [("p", {"title": read_back(value)})] and page.unbalanced == []
    assert page.text == (read_back(text) + " " if text else "")


def read_back(text: str) -> str:
    """What HTML may hold of a text."""
    return "".join("\N{REPLACEMENT CHARACTER}" if clean(char) == "\N{REPLACEMENT CHARACTER}" else char for char in text)


@pytest.mark.parametrize("name", ["", "a b", "p>", "1p", "on\"click"])
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="no name"):
        tag(name)
    with pytest.raises(ValueError, match="no name"):
        tag("p", None, **{name or " ": "x"})


def test_style_that_could_end_its_element_is_refused() -> None:
    with pytest.raises(ValueError, match="<"):
        str(StyleSheet("style", (), ("</style><script>",)))


def test_columns_of_figures_stand_to_the_right() -> None:
    page = read(str(table(("What", "#Value"), [("a", "1"), ("b", tag("b", "2"))])))
    assert [attributes.get("class") for name, attributes in page.elements if name in ("td", "th")] == [None, "figure"] * 3
