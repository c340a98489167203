"""NMEA text: sentences, checksums and times, and the log of the same name that holds the commands."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError
from rovid.readers import read_campaign, read_log
from rovid.trial.config import Config
from rovid.trial.trial import Trial
from tests.readers.logs import EPOCH, campaign, csv_text, dive, kinds, mcap_bytes, toml
from tests.readers.recordings import COMMANDS_BESIDE, HEADING, TIME, iso, sentence

HEADING_MAP = 'heading = { nmea = "heading" }'
PAIRS = list(zip(TIME.tolist(), (HEADING % 360.0).tolist(), strict=True))


def configured(folder: Path, *signals: str, heading: str = HEADING_MAP, command: str = '{ csv = "fore_V" }') -> Config:
    return campaign(folder, toml(*signals, heading=heading, command=command))


def read(folder: Path, text: str, *signals: str, beside: str = COMMANDS_BESIDE, heading: str = HEADING_MAP) -> Trial:
    config = configured(folder, *signals, heading=heading)
    (folder / "a.nmea").write_text(text)
    (folder / "a.csv").write_text(beside)
    return read_log(folder / "a.nmea", config)


def headings(front: str = "{iso} ") -> str:
    lines = []
    for t, h in PAIRS:
        stamp = front.format(iso=iso(t), epoch=f"{EPOCH / 1e9 + t:.3f}", ms=EPOCH // 10**6 + round(1e3 * t))
        lines.append(sentence(f"HEHDT,{h:.6f},T", stamp))
    return "".join(lines)


def assert_headings(trial: Trial, time: FloatArray = TIME, atol: float = 1e-5) -> None:
    rows = np.flatnonzero(trial.measured)
    np.testing.assert_allclose(trial.time[rows], time, atol=1e-5)
    np.testing.assert_allclose(np.rad2deg(trial.position[rows]), HEADING[: len(rows)], atol=atol)


@pytest.mark.parametrize("front", ["{iso} ", "{iso}, ", "[{iso}] ", "{epoch},", "{ms}\t"])
def test_times_in_front(front: str, tmp_path: Path) -> None:
    trial = read(tmp_path, headings(front))
    assert_headings(trial)
    assert [round(t, 4) for t in trial.time[1:][np.diff(trial.commands[:, 0]) != 0.0]] == [3.017, 7.033]


def clock(at: float) -> str:
    seconds = 43200.0 + at
    return f"{int(seconds // 3600) % 24:02d}{int(seconds % 3600 // 60):02d}{seconds % 60:09.6f}"


@pytest.mark.parametrize("kind", ["ZDA", "GGA"])
@pytest.mark.parametrize("every", [1, 20])
def test_times_from_sentences(kind: str, every: int, tmp_path: Path) -> None:
    lines = []
    for at, (t, h) in enumerate(PAIRS):
        if at % every == 0:
            date = ",07,01,2026,00,00" if kind == "ZDA" else ",5300.0,N,00800.0,E,1,08,0.9,5.0,M,,M,,"
            lines.append(sentence(f"GP{kind},{clock(t)}{date}"))
        lines.append(sentence(f"HEHDT,{h:.6f},T"))
    assert_headings(read(tmp_path, "".join(lines)))


def test_a_year_of_many_digits_is_no_time(tmp_path: Path) -> None:
    lines = [
        sentence(f"GPZDA,{clock(t)},07,01,{'9' * 30 if at == 0 else 2026},00,00") for at, (t, _) in enumerate(PAIRS)
    ]
    text = "".join(line + sentence(f"HEHDT,{h:.6f},T") for line, (_, h) in zip(lines, PAIRS, strict=True))
    assert read(tmp_path, text).measured.sum() >= len(PAIRS) - 1


@pytest.mark.parametrize("second", ["1e308", "inf", "7000000"])
def test_a_second_of_many_digits_is_no_time(second: str, tmp_path: Path) -> None:
    position = ",5300.0,N,00800.0,E,1,08,0.9,5.0,M,,M,,"
    lines = [sentence(f"GPGGA,{f'1200{second}' if at == 9 else clock(t)}{position}") for at, (t, _) in enumerate(PAIRS)]
    text = "".join(line + sentence(f"HEHDT,{h:.6f},T") for line, (_, h) in zip(lines, PAIRS, strict=True))
    assert read(tmp_path, text).measured.sum() >= len(PAIRS) - 2


def test_angles_and_rate(tmp_path: Path) -> None:
    lines = [
        sentence(f"HEHDT,{h:.6f},T", f"{iso(t)} ")
        + sentence("PIXSE,ATITUD,-1.641,-0.490", f"{iso(t)} ")
        + sentence("HEROT,480.0,A", f"{iso(t)} ")
        for t, h in PAIRS
    ]
    signals = (
        'roll = { nmea = "roll" }',
        'pitch = { nmea = "pitch", sign = -1 }',
        'yaw_rate = { nmea = "yaw_rate", unit = "deg/s" }',
    )
    trial = read(tmp_path, "".join(lines), *signals)
    for values, expected in ((trial.roll, -1.641), (trial.pitch, 0.490), (trial.rate, 8.0)):
        assert values is not None
        np.testing.assert_allclose(np.rad2deg(values[trial.measured]), expected)


def test_checksums_are_those_of_a_real_ins() -> None:
    assert sentence("HEHDT,116.581,T") == "$HEHDT,116.581,T*25\r\n"
    assert sentence("PIXSE,ATITUD,-1.641,-0.490") == "$PIXSE,ATITUD,-1.641,-0.490*6D\r\n"


def test_bad_sentences_are_counted(tmp_path: Path) -> None:
    lines = headings().splitlines(keepends=True)
    lines[5] = lines[5].replace("HDT,1", "HDT,9")
    lines[9] = lines[9][:40] + "\r\n"
    lines[11] = "no sentence at all\r\n"
    trial = read(tmp_path, "".join(lines))
    assert kinds(trial)["truncated"] == 2
    assert "2 sentences are cut or have a wrong checksum" in trial.remarks[0].text
    assert trial.measured.sum() == len(TIME) - 3


@pytest.mark.parametrize(
    ("text", "signal", "words"),
    [
        (headings("{iso} ").replace("*", "*0"), HEADING_MAP, "300 sentences, none of them with a right checksum"),
        (headings(""), HEADING_MAP, "has no time"),
        (headings("17.5 "), HEADING_MAP, "has no time"),
        (headings(), 'heading = { nmea = "headings" }', "no 'headings' .* Nearest: 'heading'"),
        (
            sentence("HEROT,1.0,A", f"{iso(0.0)} "),
            HEADING_MAP,
            r"no sentence HDT or THS or HDG or HDM \(heading\), but 1 HEROT",
        ),
    ],
)
def test_what_it_cannot_give(text: str, signal: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read(tmp_path, text, heading=signal)


def test_the_log_beside_it(tmp_path: Path) -> None:
    config = configured(tmp_path)
    (tmp_path / "a.nmea").write_text(headings())
    with pytest.raises(LogError, match=r"holds no commands, and no log of its name is in its folder.*a\.csv"):
        read_log(tmp_path / "a.nmea", config)
    with pytest.raises(LogError, match=r"a\.csv: has no absolute time"):
        read(tmp_path, headings(), beside="time_s,fore_V\n0.0,1\n10.0,2\n")
    (tmp_path / "a.mcap").write_bytes(mcap_bytes(dive()))
    with pytest.raises(LogError, match="2 logs of its name"):
        read_log(tmp_path / "a.nmea", config)


def test_commands_of_another_day_are_no_commands(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="0 heading readings come after every command is known"):
        read(tmp_path, headings(), beside=COMMANDS_BESIDE.replace("2026-01-07", "2026-01-09"))


def test_commands_from_a_recording(tmp_path: Path) -> None:
    config = configured(tmp_path, command='{ mcap = "/thrusters/fore.data" }')
    (tmp_path / "a.nmea").write_text(headings())
    (tmp_path / "a.mcap").write_bytes(mcap_bytes(dive()))
    trial = read_log(tmp_path / "a.nmea", config)
    assert_headings(trial)
    assert trial.commands[-1, 0] == 2.0


def test_in_a_folder_both_are_one_trial(tmp_path: Path) -> None:
    config = configured(tmp_path)
    (tmp_path / "a.nmea").write_text(headings())
    (tmp_path / "a.csv").write_text(COMMANDS_BESIDE)
    assert [trial.name for trial in read_campaign([tmp_path], config).trials] == ["a.nmea"]


def test_a_command_is_never_mapped_to_it(tmp_path: Path) -> None:
    config = configured(tmp_path, command='{ nmea = "heading" }')
    (tmp_path / "a.nmea").write_text(headings())
    with pytest.raises(ConfigError, match=r"sentences hold no commands. Map it in another format, .* a\.csv"):
        read_log(tmp_path / "a.nmea", config)


def test_what_is_measured_may_stand_beside_it(tmp_path: Path) -> None:
    beside = csv_text({"time_s": [iso(t) for t in TIME], "fore_V": np.ones(300), "heading_deg": HEADING % 360.0})
    signals = {"heading": 'heading = { csv = "heading_deg" }'}
    text = "".join(sentence("PIXSE,ATITUD,1.0,2.0", f"{iso(t)} ") for t in TIME)
    trial = read(tmp_path, text, 'roll = { nmea = "roll" }', beside=beside, heading=signals["heading"])
    assert trial.roll is not None
    np.testing.assert_allclose(np.rad2deg(trial.roll), 1.0)
    with pytest.raises(ConfigError, match=r"heading names neither an nmea source nor one of a\.csv"):
        read(tmp_path, text, 'roll = { nmea = "roll" }', heading='heading = { mcap = "/h" }')


@pytest.mark.parametrize("body", ["GNTHS,{:.6f},A", "HCHDG,{:.6f},,,2.0,E", "HCHDM,{:.6f},M"])
def test_headings_of_other_sentences(body: str, tmp_path: Path) -> None:
    assert_headings(read(tmp_path, "".join(sentence(body.format(h), f"{iso(t)} ") for t, h in PAIRS)))


def test_an_invalid_heading_is_missing(tmp_path: Path) -> None:
    lines = [
        sentence(f"GNTHS,{h:.6f},{'V' if 100 <= at < 103 else 'A'}", f"{iso(t)} ") for at, (t, h) in enumerate(PAIRS)
    ]
    trial = read(tmp_path, "".join(lines))
    assert trial.measured.sum() == len(PAIRS) - 3


@pytest.mark.parametrize("unit", ["s", "ms"])
def test_times_in_tag_blocks(unit: str, tmp_path: Path) -> None:
    every = 20 if unit == "s" else 1
    stamps = [EPOCH // 10**9 + at if unit == "s" else EPOCH // 10**6 + round(1e3 * t) for at, t in enumerate(TIME)]
    lines = [
        sentence(f"HEHDT,{h:.6f},T", f"\\s:IN0001,c:{stamp}*5A\\")
        for stamp, h in list(zip(stamps, (HEADING % 360.0).tolist(), strict=True))
    ]
    beside = COMMANDS_BESIDE if unit == "ms" else COMMANDS_BESIDE.replace(iso(20.0), iso(400.0))
    trial = read(tmp_path, "".join(lines), beside=beside)
    assert_headings(trial, TIME * every)


@pytest.mark.parametrize("front", ["%H:%M:%S.%f ", "[%H:%M:%S,%f] ", "%Y/%m/%d %H:%M:%S.%f > "])
def test_other_times_in_front(front: str, tmp_path: Path) -> None:
    stamps = [datetime.fromisoformat(iso(t)).strftime(front) for t in TIME.tolist()]
    text = "".join(sentence(f"HEHDT,{h:.6f},T", stamp) for stamp, (_, h) in zip(stamps, PAIRS, strict=True))
    assert_headings(read(tmp_path, text))


def test_of_two_talkers_the_one_that_sends_most_is_taken(tmp_path: Path) -> None:
    lines = [
        sentence(f"HEHDT,{h:.6f},T", f"{iso(t)} ") + (sentence("GPHDT,7.0,T", f"{iso(t)} ") if at % 5 == 0 else "")
        for at, (t, h) in enumerate(PAIRS)
    ]
    trial = read(tmp_path, "".join(lines))
    assert_headings(trial)
    (remark,) = trial.remarks
    assert (remark.kind, remark.count) == ("chosen", 60)
    assert "heading was taken from HEHDT (300 sentences); GPHDT (60) was not used" in remark.text


def test_two_talkers_of_the_time_do_not_interleave(tmp_path: Path) -> None:
    lines = []
    for at, (t, h) in enumerate(PAIRS):
        if at % 10 == 0:
            lines.append(
                sentence(f"GPZDA,{clock(t)},07,01,2026,00,00") + sentence(f"INZDA,{clock(t + 0.3)},07,01,2026,00,00")
            )
        lines.append(sentence(f"HEHDT,{h:.6f},T"))
    assert_headings(read(tmp_path, "".join(lines)))


def test_a_text_without_measurements_names_what_it_holds(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="holds no sentence ATITUD, HDG, HDM, HDT, ROT, THS, but 300 GPRMC"):
        read(tmp_path, "".join(sentence("GPRMC,1,A", f"{iso(t)} ") for t, _ in PAIRS))
