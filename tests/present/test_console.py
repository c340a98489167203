"""Text on a terminal: wrapping and escaping."""

from __future__ import annotations

import io
import os
import re

import pytest
from rich.text import Text

from rovid.core.errors import display_text
from rovid.core.formatting import SafeConsole, labelled_text
from rovid.present.console import VERDICT_STYLES, bind_units, print_labelled, wrap_text
from tests.hostile import NAMES, STEERING

SAID = (
    "sampled every 0.1 s; in all 0.88 s late, ± 12.0 kg m² of 5072.3 ± 12.0 kg m², 3548 N m s²/rad², 95 % of 7 runs, "
    "294 (100 %), DQ −12 %"
)
WHOLE = ("0.1 s;", "0.88 s", "5072.3 ± 12.0 kg m²,", "3548 N m s²/rad²,", "95 %", "7 runs,", "(100 %),", "−12 %")


def lines(text: str, width: int, hang: int = 0) -> list[str]:
    return wrap_text(Text(text), width, hang).plain.split("\n")


@pytest.mark.parametrize("width", [20, 21, 30, 44, 60, 79, 200])
def test_numbers_keep_their_units(width: int) -> None:
    found = lines(SAID, width)
    assert max(map(len, found)) <= width
    assert " ".join(found) == SAID
    assert [whole for whole in WHOLE if not any(whole in line for line in found)] == []


def test_further_lines_hang_in() -> None:
    found = lines("1. Measure the arms, and put that into rovid.toml.", 24, 3)
    assert found == ["1. Measure the arms, and", "   put that into", "   rovid.toml."]


def test_what_is_longer_than_a_line_is_cut_where_it_can_be() -> None:
    assert lines("5072.3 ± 12.0 kg m²", 14) == ["5072.3 ± 12.0", "kg m²"]
    assert lines("/servo_output/servo12_raw", 15) == ["/servo_output/", "servo12_raw"]
    assert lines("abcdefgh", 3) == ["abc", "def", "gh"]


def test_styles_stay() -> None:
    text = wrap_text(Text.assemble(("Next:", "bold"), " a run of 3 min"), 14)
    assert text.plain == "Next: a run of\n3 min"
    assert text.spans[0].style == "bold"


def test_a_page_that_folds_by_itself_keeps_them_too() -> None:
    assert (
        bind_units("1 to 3 s a level, 5.0 ± 0.1 kg m²")
        == "1\u00a0to 3\u00a0s a level, 5.0\u00a0±\u00a00.1\u00a0kg\u00a0m²"
    )


@pytest.mark.parametrize("name", [*NAMES, os.fsdecode(b"\xff"), "y" * 100_000])
def test_nothing_that_is_printed_steers_a_terminal(name: str) -> None:
    from rovid.present.console import ResultTable, show_warnings, text_column

    out = io.StringIO()
    screen = SafeConsole(file=out, force_terminal=True, color_system=None, width=4000, legacy_windows=False)
    rows = ResultTable(name, text_column(name), text_column("b"))
    rows.add_row(name, labelled_text("lead", name, "red"))
    screen.print(rows)
    screen.print(name)
    show_warnings(screen, [name])
    text = re.sub("\x1b\\[\\d*(;\\d+)*m", "", out.getvalue()) if "\x1b[31m" not in name else out.getvalue()
    assert not STEERING.search(text)
    assert display_text(name, 2000)[:100] in text, "as it is: neither markup nor an emoji"
    assert len(text) < 40_000


def test_a_verdict_has_a_colour_and_without_colours_bold_type(monkeypatch: pytest.MonkeyPatch) -> None:
    def printed(kind: str) -> str:
        stream = io.StringIO()
        print_labelled(SafeConsole(file=stream, force_terminal=True), "Go", style=VERDICT_STYLES[kind])
        return stream.getvalue()

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert len({printed(kind) for kind in VERDICT_STYLES}) == 3
    monkeypatch.setenv("NO_COLOR", "1")
    assert {printed(kind) for kind in VERDICT_STYLES} == {"\x1b[1mGo\x1b[0m\n"}
