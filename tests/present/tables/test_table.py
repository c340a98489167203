"""One table for terminal and page."""

from __future__ import annotations

import io
import re

import pytest
from rich.cells import cell_len
from rich.text import Text

from rovid.core.formatting import SafeConsole
from rovid.present.console import ResultTable, mixed_number_column, number_column, text_column


def test_rows_become_columns_under_their_headings() -> None:
    table = ResultTable("A", text_column("name"), number_column("size", "m"), mixed_number_column("value"))
    table.add_row("one", "1.5", "100")
    table.add_row("two", "10", "0.25")
    grid = table
    assert grid.caption == "A"
    assert [column.title for column in grid.columns] == ["name", "size", "value"]
    assert [cell for _, cell in grid.rows[1]][::2] == ["two", "0.25"]


def test_points_stand_in_line_in_a_column_of_one_kind_alone() -> None:
    table = ResultTable("A", number_column("size"), mixed_number_column("value"))
    table.add_row("1.5", "1.5")
    table.add_row("10", "10")
    size, value = table.columns
    # A space as wide as a point and one as wide as a digit.
    assert size.cells == ("1.5", "10\u2008\u2007")
    assert value.cells == ("1.5", "10")


def test_a_row_may_be_short_but_not_too_long() -> None:
    table = ResultTable("A", text_column("name"), number_column("size"))
    table.add_row("one")
    assert [column.cells for column in table.columns] == [("one",), ("",)]
    with pytest.raises(ValueError, match="3 cells for 2 columns"):
        table.add_row("one", "2", "3")


def test_a_column_can_be_left_out() -> None:
    table = ResultTable("A", text_column("name", ["one", "two"]), number_column("size", "m", ["1", "2"]))
    assert [column.title for column in table.without("name").columns] == ["size"]
    assert [[cell for _, cell in row] for row in table.without("name").rows] == [["1"], ["2"]]


HEADINGS = ("trial", "R²", "heading after 60 s, deg", "RMSE rad/s", "value ± standard error", "samples")
ROWS = (
    ("a_run_with_a_longer_name.mcap", "0.9999", "3.4", "0.00018", "5046.4 ± 14.8", "123456"),
    ("b.csv", "-12.5", "–", "1.2e-08", "2530 ± 560", "17"),
)


def printed(rows: ResultTable, width: int) -> list[str]:
    out = io.StringIO()
    SafeConsole(file=out, width=width).print(rows)
    return [line.rstrip() for line in out.getvalue().splitlines()]


def titled(caption: str, first: str, *others: str) -> ResultTable:
    return ResultTable(caption, text_column(first), *map(mixed_number_column, others))


def filled() -> ResultTable:
    rows = titled("Something to be looked at", *HEADINGS)
    for row in ROWS:
        rows.add_row(*row)
    return rows


@pytest.mark.parametrize("width", [20, 30, 40, 50, 60, 80, 120, 200])
def test_lines_fit_and_the_last_columns_give_way(width: int) -> None:
    lines = printed(filled(), width)
    assert max(map(cell_len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    there = [all(row[at] in text for row in ROWS) for at in range(1, len(HEADINGS))]
    assert there == sorted(there, reverse=True), "the last of them first"
    gone = [heading for heading, shown in zip(HEADINGS[1:], there, strict=True) if not shown]
    if gone:
        assert f"Not shown in {width} columns: {', '.join(gone)}." in text
    else:
        assert "Not shown" not in text


def test_there_is_room_for_all_where_it_is_wide() -> None:
    lines = printed(filled(), 120)
    assert lines[0] == "Something to be looked at"
    assert [len(re.split(r"  +", line.strip())) for line in lines[1:2] + lines[3:5]] == [6, 6, 6]


def test_text_alone_is_folded_and_never_left_out() -> None:
    rows = ResultTable("", *map(text_column, ("signal", "taken from", "why")))
    rows.add_row("command of servo_output_raw_servo12_raw", "SERVO_OUTPUT_RAW.servo12_raw", "by name; 1100 to 1660")
    for width in (24, 30, 60, 80, 200):
        lines = printed(rows, width)
        assert max(map(cell_len, lines)) <= width
        assert "Not shown" not in " ".join(lines)
    # A name is folded behind a sign that parts it, not within a word.
    assert {"SERVO_OUTPUT_RAW.", "servo12_raw"} <= set(" ".join(printed(rows, 60)).split())


def test_prose_at_the_end_is_text() -> None:
    rows = ResultTable("", text_column("method"), mixed_number_column("value"), text_column("note"))
    rows.add_row("peak", "2530 ± 560", "biased: on the identified model it returns 50 % of the truth")
    lines = printed(rows, 50)
    assert max(map(len, lines)) <= 50
    assert "Not shown" not in " ".join(lines)


def test_sections_and_styles_and_wide_letters() -> None:
    rows = titled("", "name", "n")
    rows.add_row(Text("走行試験の記録", "red"), "1")
    rows.add_row("all", begins_section=True)
    lines = printed(rows, 17)
    assert max(map(cell_len, lines)) == 17
    assert lines[2] == "走行試験の記録  1"
    assert lines[4:] == ["all", ""]
    assert printed(titled("", "a"), 10)[0] == "a"


def test_what_is_shown_is_not_markup() -> None:
    rows = titled("[bold]t", "[red]h")
    rows.add_row("[link=x]c")
    assert [line.strip() for line in printed(rows, 40)][:4:3] == ["[bold]t", "[link=x]c"]
