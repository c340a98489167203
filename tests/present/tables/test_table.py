"""Captioned tables of text."""

from __future__ import annotations

import pytest

from rovid.present.tables.table import TableBuilder, mixed_number_column, number_column, text_column


def test_rows_become_columns_under_their_headings() -> None:
    table = TableBuilder("A", text_column("name"), number_column("size", "m"), mixed_number_column("value"))
    table.add("one", "1.5", "100")
    table.add("two", "10", "0.25")
    grid = table.grid()
    assert grid.caption == "A"
    assert [column.title for column in grid.columns] == ["name", "size", "value"]
    assert [cell for _, cell in grid.rows[1]][::2] == ["two", "0.25"]


def test_points_stand_in_line_in_a_column_of_one_kind_alone() -> None:
    table = TableBuilder("A", number_column("size"), mixed_number_column("value"))
    table.add("1.5", "1.5")
    table.add("10", "10")
    size, value = table.grid().columns
    # A space as wide as a point and one as wide as a digit.
    assert size.cells == ("1.5", "10\u2008\u2007")
    assert value.cells == ("1.5", "10")


def test_a_row_that_is_too_short_is_a_mistake() -> None:
    table = TableBuilder("A", text_column("name"), number_column("size"))
    table.add("one")
    with pytest.raises(IndexError):
        table.grid()
