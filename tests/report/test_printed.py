"""Rows of figures on paper: in their order, never too wide, as large as there is room."""

import pytest

from geoident.report.page.printed import (
    HEIGHT,
    WIDTH,
    Drawn,
    printed_rows,
    table_height,
    text_height,
)
from geoident.report.text.layout import TextTable

SQUARE, WIDE, HIGH = Drawn(700, 700, 150), Drawn(980, 300, 150), Drawn(700, 1300, 150)


def flat(rows):
    return [place for row in rows for place in row]


def height(figure, place):
    return figure.height * place.part / 100 * WIDTH / figure.width


@pytest.mark.parametrize("before", [0.0, 300.0, 700.0, 950.0])
def test_rows_keep_the_order_and_the_width_and_a_page(before):
    figures = [SQUARE, WIDE, HIGH, SQUARE, SQUARE, WIDE, HIGH, HIGH]
    (rows,) = printed_rows([before, figures])
    assert len(flat(rows)) == len(figures)
    for row in rows:
        assert sum(place.part for place in row) + 2 * (len(row) - 1) <= 100
        assert not any(place.beside for place in row) or len(row) == 1
    for figure, place in zip(figures, flat(rows), strict=True):
        assert height(figure, place) < HEIGHT
        assert place.part / 100 * WIDTH / figure.width > 0.3  # letters can be read


def test_two_squares_stand_side_by_side_over_the_whole_width():
    (rows,) = printed_rows([[SQUARE, SQUARE]])
    (row,) = rows
    assert [place.part for place in row] == [48, 48]


def test_a_figure_becomes_smaller_where_it_then_ends_the_page():
    (alone,), (tight,) = printed_rows([[SQUARE]]), printed_rows([HEIGHT - 330.0, [SQUARE]])
    assert 0.8 * alone[0][0].part < tight[0][0].part < alone[0][0].part
    assert height(SQUARE, tight[0][0]) < 330.0
    # where the page has no room for it the next one has
    (fresh,) = printed_rows([HEIGHT - 60.0, [SQUARE]])
    assert fresh[0][0] == alone[0][0]


def test_every_item_of_figures_gets_its_own_rows():
    first, second = printed_rows([40.0, [SQUARE], 200.0, [WIDE, WIDE]])
    assert (len(flat(first)), len(flat(second))) == (1, 2)
    assert printed_rows([40.0]) == []


def test_heights_of_texts_and_tables_grow_with_what_is_in_them():
    assert text_height("") == 0.0
    one = text_height("<p>short</p>")
    assert text_height("<p>short</p><p>short</p>") == 2 * one
    assert text_height(f"<p>{'long ' * 100}</p>") > 4 * one / 2
    narrow = TextTable(("a", "b"), [("1", "2")] * 10)
    wide = TextTable(("a", "b"), [("1 " * 60, "2 " * 60)] * 10)
    assert table_height(wide) > 1.8 * table_height(narrow)
