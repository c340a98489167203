"""How a CSV file is written."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import LogError
from rovid.readers.csv_dialect import Layout
from tests.readers.logs import campaign, csv_text, read_csv, standard
from tests.readers.test_csv_reader import DATES, TIME, assert_standard, decimal_comma, row

LATE = standard(time_s=995.0 + TIME)


def swapped(number: str) -> str:
    """A number with points between the thousands and a decimal comma."""
    return number.replace(",", "_").replace(".", ",").replace("_", ".")


SPELLINGS: dict[str, bytes] = {
    "semicolon": csv_text(standard(), ";").encode(),
    "tab": csv_text(standard(), "\t").encode(),
    "decimal comma": decimal_comma(csv_text(standard(), ";")).encode(),
    "decimal comma, tab": decimal_comma(csv_text(standard(), "\t")).encode(),
    "quoted decimal comma": csv_text(
        {k: [f'"{v:.4f}"'.replace(".", ",") for v in np.asarray(c)] for k, c in standard().items()}
    ).encode(),
    "CRLF": csv_text(standard()).replace("\n", "\r\n").encode(),
    "CR": csv_text(standard()).replace("\n", "\r").encode(),
    "BOM": b"\xef\xbb\xbf" + csv_text(standard()).encode(),
    "UTF-16": csv_text(standard()).encode("utf-16"),
    "UTF-16 without mark": csv_text(standard()).encode("utf-16-le"),
    "UTF-16, CRLF": csv_text(standard()).replace("\n", "\r\n").encode("utf-16"),
    "spaces": csv_text(standard(), " , ").encode(),
    "quoted": csv_text({f'"{k}"': [f'"{v:.4f}"' for v in np.asarray(c)] for k, c in standard().items()}).encode(),
    "quotes after spaces": csv_text(
        {
            "time_s": TIME,
            ' "a, note"': [' "x, 5, y"'] * len(TIME),
            "heading_deg": np.asarray(standard()["heading_deg"]),
            "fore_V": np.asarray(standard()["fore_V"]),
        }
    ).encode(),
    "comments first": b'# rosub, tank\n#\n\n# V, deg, "odd quote\n' + csv_text(standard()).encode(),
    "header in a comment": b"# " + csv_text(standard()).encode(),
    "empty lines": csv_text(standard()).replace("\n", "\n\n").encode(),
    "delimiter at line ends": csv_text(standard()).replace("\n", ",\n").encode(),
    "delimiter at line ends of rows": csv_text(standard()).replace("\n", ",\n").replace("V,\n", "V\n", 1).encode(),
    "other columns": csv_text({"µ": ["é"] * 400, **standard(), "°C": ["\u20ac"] * 400}).encode(),
    "latin-1": csv_text({"µ": ["é"] * 400, **standard(), "°C": ["x"] * 400}).encode("latin-1"),
    "cp1252": csv_text({"µ": ["é"] * 400, **standard(), "°C": ["\u20ac"] * 400}).encode("cp1252"),
    "ISO 8601": csv_text(standard(time_s=[f"{t}Z" for t in DATES])).encode(),
    "ISO 8601 without zone": csv_text(standard(time_s=[str(t).replace("T", " ") for t in DATES])).encode(),
    "ISO 8601 with zone": csv_text(standard(time_s=[f"{t}+05:30" for t in DATES])).encode(),
    "epoch s": csv_text(standard(time_s=1767787200.0 + TIME)).encode(),
    "epoch ms": csv_text(standard(time_s=1767787200000 + np.round(TIME * 1e3).astype(int))).encode(),
    "epoch us": csv_text(standard(time_s=1767787200000000 + np.round(TIME * 1e6).astype(int))).encode(),
    "epoch ns": csv_text(standard(time_s=1767787200000000001 + np.round(TIME * 1e9).astype(int))).encode(),
    "row of units": csv_text(standard()).replace("_V\n", "_V\n[s],[deg],[V]\n").encode(),
    "row of units, one of them 1": csv_text(standard()).replace("_V\n", "_V\n\ns,deg,1\n").encode(),
    "names, units, short names": (
        "A title; of two parts\n\nTime;Heading;1st command;\ns;deg;V;\n"
        + csv_text(standard(), ";").replace("\n", ";\n")
    ).encode(),
    "a title, settings": ("Logger 7\nrate,20\n\n" + csv_text(standard())).encode(),
    "units in ms": csv_text(standard(time_s=np.round(1e3 * TIME).astype(int)))
    .replace("_V\n", "_V\nms,deg,V\n")
    .encode(),
    "quoted thousands": csv_text({k: [f'"{v:,.4f}"' for v in np.asarray(c)] for k, c in LATE.items()}).encode(),
    "thousands with points": csv_text(
        {k: [swapped(f"{v:,.4f}") for v in np.asarray(c)] for k, c in LATE.items()}, ";"
    ).encode(),
    "thousands with apostrophes": csv_text(
        {k: [f"{v:,.4f}".replace(",", "'") for v in np.asarray(c)] for k, c in LATE.items()}
    ).encode(),
    "exponents": csv_text(standard(), form=".9e").encode(),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spellings(spelling: str, tmp_path: Path) -> None:
    trial = read_csv(tmp_path, SPELLINGS[spelling])
    assert_standard(trial.position, trial.time)
    assert trial.remarks == ()


def test_decimal_commas_that_begin_late(tmp_path: Path) -> None:
    text = decimal_comma(csv_text(standard(), ";")).split("\n")
    text[1:301] = [";".join(cell.split(",")[0] for cell in row.split(";")) for row in text[1:301]]
    config = campaign(tmp_path)
    times = [f"{k}" for k in range(300)]
    text[1:301] = [";".join([t, *row.split(";")[1:]]) for t, row in zip(times, text[1:301], strict=True)]
    text[301:401] = [";".join([f"{300 + k},5", *row.split(";")[1:]]) for k, row in enumerate(text[301:401])]
    trial = read_csv(tmp_path, "\n".join(text), config)
    assert trial.time[-1] == pytest.approx(399.5)


def test_how_numbers_are_written_is_looked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the search for the cell that is no number takes minutes in a long table."""
    looked = []
    decimal = Layout.decimal

    def counted(layout: Layout, columns: Collection[int]) -> str:
        looked.append(columns)
        return decimal(layout, columns)

    monkeypatch.setattr(Layout, "decimal", counted)
    with pytest.raises(LogError, match=":399: heading_deg is 'off'"):
        read_csv(tmp_path, row(399, "off"))
    assert len(looked) < 10
