"""Tables fit what they are printed on, and no number is cut in two."""

from __future__ import annotations

import io
import re

import pytest
from rich.cells import cell_len
from rich.text import Text

from rovid.core.console import SafeConsole
from rovid.present.terminal.table import Columns, table

HEADINGS = ("trial", "R²", "heading after 60 s, deg", "RMSE rad/s", "value ± standard error", "samples")
ROWS = (
    ("a_run_with_a_longer_name.mcap", "0.9999", "3.4", "0.00018", "5046.4 ± 14.8", "123456"),
    ("b.csv", "-12.5", "–", "1.2e-08", "2530 ± 560", "17"),
)


def printed(rows: Columns, width: int) -> list[str]:
    out = io.StringIO()
    SafeConsole(file=out, width=width).print(rows)
    return [line.rstrip() for line in out.getvalue().splitlines()]


def filled() -> Columns:
    rows = table("Something to be looked at", *HEADINGS)
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
        assert f"No room in {width} columns: {', '.join(gone)}." in text
    else:
        assert "No room" not in text


def test_there_is_room_for_all_where_it_is_wide() -> None:
    lines = printed(filled(), 120)
    assert lines[0] == "Something to be looked at"
    assert [len(re.split(r"  +", line.strip())) for line in lines[1:2] + lines[3:5]] == [6, 6, 6]


def test_text_alone_is_folded_and_never_left_out() -> None:
    rows = table("", "signal", "taken from", "why", left=3)
    rows.add_row("command of servo_output_raw_servo12_raw", "SERVO_OUTPUT_RAW.servo12_raw", "named so; 1100 to 1660")
    for width in (24, 30, 60, 80, 200):
        lines = printed(rows, width)
        assert max(map(cell_len, lines)) <= width
        assert "No room" not in " ".join(lines)
    # A name is folded behind a sign that parts it, not within a word.
    assert {"SERVO_OUTPUT_RAW.", "servo12_raw"} <= set(" ".join(printed(rows, 60)).split())


def test_prose_at_the_end_is_text() -> None:
    rows = table("", "method", "value", "note", prose=True)
    rows.add_row("peak", "2530 ± 560", "biased: on the identified model it returns 50 % of the truth")
    lines = printed(rows, 50)
    assert max(map(len, lines)) <= 50
    assert "No room" not in " ".join(lines)


def test_sections_and_styles_and_wide_letters() -> None:
    rows = table("", "name", "n")
    rows.add_row(Text("走行試験の記録", "red"), "1")
    rows.add_section()
    rows.add_row("all")
    lines = printed(rows, 17)
    assert max(map(cell_len, lines)) == 17
    assert lines[2] == "走行試験の記録  1"
    assert lines[4:] == ["all", ""]
    assert printed(table("", "a"), 10)[0] == "a"


def test_what_is_shown_is_not_markup() -> None:
    rows = table("[bold]t", "[red]h")
    rows.add_row("[link=x]c")
    assert [line.strip() for line in printed(rows, 40)][:4:3] == ["[bold]t", "[link=x]c"]
