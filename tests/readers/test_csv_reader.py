"""CSV tables of any dialect."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.readers import csv_reader, read_log
from rovid.readers.csv_dialect import Layout
from rovid.readers.csv_reader import sources
from rovid.trial.axis import Signal
from rovid.trial.config import Config
from rovid.trial.vehicle import Vehicle
from tests.readers.logs import campaign, csv_text, kinds, read_csv, standard, toml, turning

TIME, HEADING = turning()
MIDNIGHT = np.timedelta64(43190, "s")  # noon to 10 s before midnight
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


def test_empty_cells_are_counted(tmp_path: Path) -> None:
    heading = np.asarray(standard()["heading_deg"]).copy()
    command = np.asarray(standard()["fore_V"]).copy()
    heading[[5, 6, 100]] = np.nan
    command[200:250] = np.nan
    trial = read_csv(tmp_path, csv_text(standard(heading_deg=heading, fore_V=command)))
    assert kinds(trial) == {"missing": 53}
    assert trial.measured.sum() == 397
    assert trial.commands[-1, 0] == 2.0
    assert "fore_V" in " ".join(remark.text for remark in trial.remarks)


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


def test_a_table_with_the_newest_row_first_is_told_so(tmp_path: Path) -> None:
    header, *rows = csv_text(standard()).splitlines()
    with pytest.raises(LogError, match="backwards") as caught:
        read_csv(tmp_path, "\n".join([header, *rows[::-1]]) + "\n")
    assert "newest row comes first" in str(caught.value)


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


@pytest.mark.parametrize("end", ["\n", ""])
def test_a_decimal_comma_far_down_moves_no_cells(end: str, tmp_path: Path) -> None:
    """The row, which has a cell more than the header, is left out and named."""
    trial = read_csv(tmp_path, row(350, "12,5").rstrip("\n") + end)
    (remark,) = (one for one in trial.remarks if one.kind == "skipped")
    assert "as by a decimal comma" in remark.text
    assert "line 350: " in remark.text
    assert np.abs(trial.position - np.deg2rad(HEADING)[np.isin(TIME, trial.time)]).max() < 2e-6


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
    "text row that names no units": (
        "time_s,heading_deg,fore_V\nnone,east,off\n" + csv_text(standard()).split("\n", 1)[1],
        (":2:", "'east'"),
    ),
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
    "two columns of one name": ("time_s,heading_deg,fore_V,heading_deg\n0,1,2,3\n", ("2 columns named 'heading_deg'",)),
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
    "date of unknown order": (
        csv_text(standard(time_s=[f"01/07/2026 12:00:{t:.2f}" for t in TIME])),
        (":2:", "time_s", "ISO 8601", "Write the column so."),
    ),
}


def test_rows_without_data_are_left_out_and_counted(tmp_path: Path) -> None:
    lines = csv_text(standard()).rstrip("\n").split("\n")
    plain = read_csv(tmp_path, "\n".join((*lines[:13], *lines[15:])) + "\n")
    dirty = ["# a comment", *lines[:5], "# operator: waves", *lines[5:8], lines[0], *lines[8:13]]
    found = read_csv(tmp_path, "\n".join((*dirty, lines[13] + lines[14], *lines[15:])) + "\n")
    np.testing.assert_array_equal(found.position, plain.position)
    (remark,) = [one for one in found.remarks if "two rows in one" in one.text]
    assert (remark.count, "line 7: # operator: waves" in remark.text) == (3, True)


@pytest.mark.parametrize("word", ["NULL", "None", "#N/A", "-nan(ind)", "1.#QNAN"])
def test_words_of_programs_for_a_missing_value_are_missing(word: str, tmp_path: Path) -> None:
    plain, found = read_csv(tmp_path, row(9, "")), read_csv(tmp_path, row(9, word))
    np.testing.assert_array_equal(found.position, plain.position)
    assert len(found.remarks) == len(plain.remarks)


def test_names_may_differ_in_capitals_and_spaces(tmp_path: Path) -> None:
    head, rows = csv_text(standard()).split("\n", 1)
    plain, found = read_csv(tmp_path, f"{head}\n{rows}"), read_csv(tmp_path, f"{head.title()} \n{rows}")
    np.testing.assert_array_equal(found.position, plain.position)


@pytest.mark.parametrize("more", ["s,deg,V\n", "s,deg,V\nt,psi,u\n", "[s],[deg],[V]\n", "long,names,here\ns,deg,V\n"])
def test_rows_of_units_and_short_names_below_the_header_are_no_data(more: str, tmp_path: Path) -> None:
    head, rows = csv_text(standard()).split("\n", 1)
    plain, found = read_csv(tmp_path, f"{head}\n{rows}"), read_csv(tmp_path, f"{head}\n{more}{rows}")
    for name, values in plain.arrays().items():
        np.testing.assert_array_equal(found.arrays()[name], values)
    bad = row(17, "N/A").split("\n", 1)
    with pytest.raises(LogError, match=f":{17 + more.count(chr(10))}:"):
        read_csv(tmp_path, f"{bad[0]}\n{more}{bad[1]}")


def test_units_of_a_row_below_the_names_belong_to_the_names(tmp_path: Path) -> None:
    path = tmp_path / "motor.csv"
    path.write_text("Time;speed;current;\nms;rad/s;A;\nt;v;i;\n" + "".join(f"{30.5 * k};{k};2;\n" for k in range(9)))
    assert csv_reader.sources(path).clock == "Time [ms]"
    assert csv_reader.sources(path).sources == ("speed [rad/s]", "current [A]")


def test_a_clock_in_seconds_and_nanoseconds(tmp_path: Path) -> None:
    path = tmp_path / "car.csv"
    stamps = 1651541648_900000000 + 37_000_000 * np.arange(50)
    path.write_text("s,ns,x\n" + "".join(f"{at // 10**9},{at % 10**9},{at % 7}\n" for at in stamps.tolist()))
    assert csv_reader.sources(path).clock == "s + ns"
    assert csv_reader.sources(path).sources == ("x",)
    config = Config(
        path=path,
        vehicle=Vehicle(name="", thrusters=()),
        time=Signal(name="time", sources={"csv": "s + ns"}, unit="auto"),
        signals={"x": Signal(name="x", sources={"csv": "x"})},
        commands=(),
        measured_signal="x",
    )
    raw = csv_reader.read(path, config)
    np.testing.assert_allclose(raw.channels["x"].time, 0.037 * np.arange(50), atol=1e-12)
    assert raw.epoch == pytest.approx(1651541648.9)


@pytest.mark.parametrize("name", BAD)
def test_bad_tables(name: str, tmp_path: Path) -> None:
    text, words = BAD[name]
    with pytest.raises(LogError) as caught:
        read_csv(tmp_path, text)
    for word in words:
        assert word in str(caught.value)


def test_a_wild_stamp_stands_at_a_line(tmp_path: Path) -> None:
    time = TIME.copy()
    time[200] -= 5.0
    (fault,) = read_csv(tmp_path, "# a comment\n" + csv_text(standard(time_s=time))).faults
    assert "at line 203, 5 s from" in fault.text


@pytest.mark.parametrize("blank", ["", "   "])
def test_lines_are_counted_over_blank_ones(blank: str, tmp_path: Path) -> None:
    time = TIME.copy()
    time[200] -= 5.0
    lines = csv_text(standard(time_s=time)).split("\n")
    lines.insert(50, blank)
    (fault,) = read_csv(tmp_path, "\n".join(lines)).faults
    assert "at line 203," in fault.text


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


@pytest.mark.parametrize(
    ("header", "rows", "clock"),
    [
        ("Frame,Horodatage,cap", "{k},2026-01-05T08:00:{k:02d}.000Z,{k}.5", "Horodatage"),
        ("n,stamp_a,cap", "{k},2026-01-05 08:00:{k:02d},{k}.5", "stamp_a"),
        ("Frame,x_s,cap", "{k},{k}.25,1.5", "x_s"),
    ],
)
def test_the_clock_is_told_by_what_stands_there(header: str, rows: str, clock: str, tmp_path: Path) -> None:
    text = "\n".join([header, *(rows.format(k=k) for k in range(12))])
    (tmp_path / "log.csv").write_text(text + "\n")
    assert csv_reader.sources(tmp_path / "log.csv").clock == clock


@pytest.mark.parametrize(("names", "unit"), [(("stamp.secs", "stamp.nsecs"), 1e-9), (("t_s", "t_us"), 1e-6)])
@pytest.mark.parametrize("begin", [0, 1767787200])
def test_time_in_two_columns(names: tuple[str, str], unit: float, begin: int, tmp_path: Path) -> None:
    ticks = np.round((TIME + 0.25) / unit).astype(int)
    per_second = round(1.0 / unit)
    columns = {names[0]: begin + ticks // per_second, names[1]: ticks % per_second, **standard()}
    del columns["time_s"]
    text = csv_text(columns)
    trial = read_csv(tmp_path, text, campaign(tmp_path, toml(time=f'time = {{ csv = "{names[0]}" }}')))
    assert_standard(trial.position, trial.time)
    assert trial.start_epoch == (pytest.approx(begin + 0.25, abs=1e-6) if begin else None)
    contents = sources(tmp_path / "hold_3.csv")
    assert contents.clock == " + ".join(names)
    assert not {*names} & set(contents.sources)


def test_units_of_a_row_apply_to_the_time(tmp_path: Path) -> None:
    text = csv_text(standard(time_s=np.round(1e3 * TIME).astype(int))).replace("time_s", "t", 1)
    text = text.replace("_V\n", "_V\nms,deg,V\n")
    trial = read_csv(tmp_path, text, campaign(tmp_path, toml(time='time = { csv = "t" }')))
    assert_standard(trial.position, trial.time)
    assert sources(tmp_path / "hold_3.csv").clock == "t [ms]"


def test_short_names_below_the_names_may_be_mapped(tmp_path: Path) -> None:
    text = "Time;Heading;Bow;\nms;deg;V;\n" + csv_text(standard(time_s=np.round(1e3 * TIME).astype(int)), ";")
    text = text.replace("time_s", "t", 1)
    trial = read_csv(tmp_path, text, campaign(tmp_path, toml(time='time = { csv = "t" }')))
    assert_standard(trial.position, trial.time)
    bad = text.replace(text.split("\n")[8].split(";")[1], "x")
    with pytest.raises(LogError, match=r"hold_3.csv:9: heading_deg is 'x'"):
        read_csv(tmp_path, bad, campaign(tmp_path, toml(time='time = { csv = "t" }')))


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
    "time of day past midnight": csv_text(standard(time_s=[f"{t}"[11:] for t in DATES + MIDNIGHT])).encode(),
    "dotted date": csv_text(standard(time_s=[f"{t}".replace("2026-01-07T", "7.1.2026 ") for t in DATES])).encode(),
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
