"""CSV in all its spellings."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest

from rovid.ground.errors import ConfigError, LogError
from rovid.readers import read_log
from rovid.readers.csv_header import Layout
from tests.readers.logs import campaign, csv_text, kinds, read_csv, standard, toml, turning

TIME, HEADING = turning()
DATES = np.datetime64("2026-01-07T12:00:00", "ms") + np.round(TIME * 1000).astype(int)


def assert_standard(trial_heading: object, time: object) -> None:
    np.testing.assert_allclose(np.asarray(time), TIME, atol=1e-6)
    # four decimals of a degree
    np.testing.assert_allclose(np.asarray(trial_heading), np.deg2rad(HEADING), atol=2e-6)


def test_an_ordinary_log(tmp_path: Path) -> None:
    trial = read_csv(tmp_path, csv_text(standard()))
    assert_standard(trial.position, trial.time)
    np.testing.assert_array_equal(trial.commands[:, 0], np.where(TIME < 10.0, 1.0, 2.0))
    assert trial.remarks == ()
    assert trial.name == "hold_3.csv"


def decimal_comma(text: str) -> str:
    return text.replace(".", ",")


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
    "exponents": csv_text(standard(), form=".9e").encode(),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spellings(spelling: str, tmp_path: Path) -> None:
    trial = read_csv(tmp_path, SPELLINGS[spelling])
    assert_standard(trial.position, trial.time)
    assert trial.remarks == ()


def test_any_column_names(tmp_path: Path) -> None:
    names = {"time_s": "Zeit [µs]", "heading_deg": "Kurs (°)", "fore_V": "Δ"}
    config = campaign(
        tmp_path,
        toml(time='time = { csv = "Zeit [µs]" }', heading='heading = { csv = "Kurs (°)" }', command='{ csv = "Δ" }'),
    )
    columns = {names[key]: value for key, value in standard().items()}
    columns["Zeit [µs]"] = np.round(TIME * 1e6).astype(int)  # the name says microseconds
    trial = read_csv(tmp_path, csv_text(columns), config)
    assert_standard(trial.position, trial.time)


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_declared_time_units(unit: str, scale: float, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time=f'time = {{ csv = "time_s", unit = "{unit}" }}'))
    trial = read_csv(tmp_path, csv_text(standard(time_s=np.round(TIME * scale, 3))), config)
    assert_standard(trial.position, trial.time)


def test_nanoseconds_lose_no_digit(tmp_path: Path) -> None:
    ticks = 1767787200000000001 + np.arange(400) * 50_000_007
    trial = read_csv(tmp_path, csv_text(standard(time_s=ticks)))
    np.testing.assert_allclose(trial.time, np.arange(400) * 0.050000007, rtol=0, atol=1e-13)


def test_nanoseconds_with_an_empty_cell(tmp_path: Path) -> None:
    ticks = [str(1767787200000000001 + k * 50_000_000) for k in range(400)]
    ticks[7] = ""
    trial = read_csv(tmp_path, csv_text(standard(time_s=ticks)))
    assert len(trial.time) == 399
    assert kinds(trial) == {"missing": 1}


def test_decimal_commas_that_begin_late(tmp_path: Path) -> None:
    text = decimal_comma(csv_text(standard(), ";")).split("\n")
    text[1:301] = [";".join(cell.split(",")[0] for cell in row.split(";")) for row in text[1:301]]
    config = campaign(tmp_path)
    times = [f"{k}" for k in range(300)]
    text[1:301] = [";".join([t, *row.split(";")[1:]]) for t, row in zip(times, text[1:301], strict=True)]
    text[301:401] = [";".join([f"{300 + k},5", *row.split(";")[1:]]) for k, row in enumerate(text[301:401])]
    trial = read_csv(tmp_path, "\n".join(text), config)
    assert trial.time[-1] == pytest.approx(399.5)


def test_empty_cells_are_counted(tmp_path: Path) -> None:
    heading = np.asarray(standard()["heading_deg"]).copy()
    command = np.asarray(standard()["fore_V"]).copy()
    heading[[5, 6, 100]] = np.nan
    command[200:250] = np.nan
    text = csv_text(standard(heading_deg=heading, fore_V=command)).replace("\n0.3500,", "\n0.3500, NaN ,", 1)
    trial = read_csv(tmp_path, csv_text(standard(heading_deg=heading, fore_V=command)))
    assert kinds(trial) == {"missing": 53}
    assert trial.measured.sum() == 397
    assert trial.commands[-1, 0] == 2.0
    assert "fore_V" in " ".join(remark.text for remark in trial.remarks)
    assert "NaN" in text


@pytest.mark.parametrize("word", ["", "nan", "NaN", "  ", "inf", "-inf", " nan "])
def test_words_for_missing(word: str, tmp_path: Path) -> None:
    cells = [f"{value:.3f}" for value in np.asarray(standard()["heading_deg"])]
    cells[50] = word
    trial = read_csv(tmp_path, csv_text(standard(heading_deg=cells)))
    assert kinds(trial) == {"missing": 1}
    assert trial.measured.sum() == 399


def test_one_value_a_row(tmp_path: Path) -> None:
    """Tables of events hold one signal in each row, and rows of one instant belong together."""
    rows = ["time_s,heading_deg,fore_V"]
    for k in range(200):
        rows += [f"{k * 0.1:.1f},{k * 0.7 + 0.01 * (k % 3):.3f},", f"{k * 0.1:.1f},,{1 + k // 100}"]
    trial = read_csv(tmp_path, "\n".join(rows) + "\n")
    assert trial.measured.all()
    assert set(trial.commands[:, 0]) == {1.0, 2.0}


CUT: dict[str, tuple[Callable[[bytes], bytes], int]] = {
    "in a number": (lambda data: data[:-3], 399),
    "after a delimiter": (lambda data: data[: data.rstrip().rfind(b",") + 1], 399),
    "at the end of a row": (lambda data: data.rstrip(), 399),
    "NUL bytes": (lambda data: data + bytes(5000), 400),
    "NUL bytes after a part": (lambda data: data[:-3] + bytes(200_000), 399),
}


@pytest.mark.parametrize("cut", CUT)
def test_a_crash_cut_the_file(cut: str, tmp_path: Path) -> None:
    how, left = CUT[cut]
    trial = read_csv(tmp_path, how(csv_text(standard()).encode()))
    assert len(trial.time) == left
    assert "truncated" in kinds(trial)
    np.testing.assert_allclose(trial.position, np.deg2rad(HEADING[:left]), atol=2e-6)


def row(number: int, cell: str) -> str:
    """The standard log with ``cell`` as heading in line ``number`` of the file."""
    lines = csv_text(standard()).split("\n")
    parts = lines[number - 1].split(",")
    lines[number - 1] = ",".join([parts[0], cell, parts[2]])
    return "\n".join(lines)


BAD: dict[str, tuple[str | bytes, tuple[str, ...]]] = {
    "text": (
        row(17, "N/A"),
        ("hold_3.csv:17: heading_deg is 'N/A', a number was expected. Delete the row or leave the cell empty.",),
    ),
    "text far down": (row(399, "off"), ("hold_3.csv:399: heading_deg is 'off'",)),
    "text below comments": ("# a\n\n# b\n" + row(17, "-"), ("hold_3.csv:20: heading_deg is '-'",)),
    "text below CRLF": (row(17, "x").replace("\n", "\r\n"), ("hold_3.csv:17:",)),
    "text below empty lines": (row(17, "x").replace("\n", "\n\n"), ("hold_3.csv:33:",)),
    "text in UTF-16": (row(17, "x").encode("utf-16"), ("hold_3.csv:17:",)),
    "text after a cut": (row(17, "x")[:-3], ("hold_3.csv:17:",)),
    "text below a quoted line end": (
        csv_text({**standard(heading_deg=["1"] * 10 + ["x"] * 390), "n": ['"a\nb"'] * 400}),
        ("hold_3.csv:22: heading_deg is 'x'",),
    ),
    "underscore": (row(9, "1_0"), (":9:", "'1_0'")),
    "units row": ("time_s,heading_deg,fore_V\ns,deg,V\n" + csv_text(standard()).split("\n", 1)[1], (":2:", "'deg'")),
    "NUL bytes": (row(9, "1\x00").encode(), ("hold_3.csv",)),
    "binary": (bytes(range(256)) * 40, ("hold_3.csv", "no text")),
    "zip": (b"PK\x03\x04" + bytes(range(1, 200)) * 10, ("no text",)),
    "empty": (b"", ("is empty", "Delete it")),
    "only NUL": (bytes(4000), ("only NUL",)),
    "only spaces": (b" \n\n", ("is empty",)),
    "only comments": (b"# a\n# b\n", ("no header",)),
    "header only": (b"time_s,heading_deg,fore_V\n", ("no rows",)),
    "header only, the wanted last": (b"a,b,c,d,time_s,heading_deg,fore_V\n", ("no rows",)),
    "the only row cut": (b"a,b,c,d,time_s,heading_deg,fore_V\n1,2,3,4,5,6", ("no rows",)),
    "header without end": (b"time_s,heading_deg,fore_V", ("hold_3.csv",)),
    "missing column": (
        csv_text({"time_s": TIME, "heding_deg": TIME, "fore_V": TIME}),
        ("no column 'heading_deg'", "Nearest: 'heding_deg'", "heading"),
    ),
    "no column near": (csv_text({"time_s": TIME, "a": TIME, "b": TIME}), ("There are: 'time_s', 'a', 'b'",)),
    "two columns of one name": (
        "time_s,heading_deg,fore_V,heading_deg\n0,1,2,3\n",
        ("2 columns named 'heading_deg'",),
    ),
    "decimal comma between commas": (decimal_comma(csv_text(standard())), ("6 cells", "3 columns", "semicolons")),
    "open quote": (row(9, '"1.0'), ("hold_3.csv",)),
    "open quote above many rows": (
        row(9, '"1.0') + "1,2,3\n" * 50_000,
        ("hold_3.csv:9: has a cell of more than 100 000 characters", "quotation mark", "never closed"),
    ),
    "bad date": (
        csv_text(standard(time_s=[*(f"{t}Z" for t in DATES[:20]), "soon", *(f"{t}Z" for t in DATES[21:])])),
        ("hold_3.csv:22: time_s is 'soon'", "ISO 8601"),
    ),
    "time of day": (csv_text(standard(time_s=[f"12:00:{t:.2f}" for t in TIME])), (":2:", "time_s", "ISO 8601")),
}


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


@pytest.mark.parametrize("name", BAD)
def test_bad_tables(name: str, tmp_path: Path) -> None:
    text, words = BAD[name]
    with pytest.raises(LogError) as caught:
        read_csv(tmp_path, text)
    for word in words:
        assert word in str(caught.value)


def test_time_runs_backwards_at_a_line(tmp_path: Path) -> None:
    time = TIME.copy()
    time[200:] -= 5.0
    text = "# a comment\n" + csv_text(standard(time_s=time))
    with pytest.raises(LogError, match=r"time_s runs backwards at line 203, from 9\.95 s to 5 s"):
        read_csv(tmp_path, text)


@pytest.mark.parametrize("blank", ["", "   "])
def test_lines_are_counted_over_blank_ones(blank: str, tmp_path: Path) -> None:
    time = TIME.copy()
    time[200:] -= 5.0
    lines = csv_text(standard(time_s=time)).split("\n")
    lines.insert(50, blank)
    with pytest.raises(LogError, match="at line 203,"):
        read_csv(tmp_path, "\n".join(lines))


def test_time_must_be_mapped(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time=""))
    with pytest.raises(ConfigError, match="time names no csv column"):
        read_csv(tmp_path, csv_text(standard()), config)


def test_heading_must_be_mapped_for_the_format(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading='heading = { mcap = "/h.data" }'))
    with pytest.raises(ConfigError, match="heading names no csv source"):
        read_csv(tmp_path, csv_text(standard()), config)


def test_unknown_suffix_and_missing_file(tmp_path: Path) -> None:
    config = campaign(tmp_path)
    with pytest.raises(LogError, match=r"\.xlsx"):
        read_log(tmp_path / "a.xlsx", config)
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "a.csv", config)


def test_the_time_column_may_be_an_extra_too(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml('clock = { csv = "time_s" }'))
    trial = read_csv(tmp_path, csv_text(standard(time_s=[f"{t}Z" for t in DATES])), config)
    np.testing.assert_allclose(trial.extras["clock"], TIME, atol=1e-6)
