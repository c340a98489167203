"""The reader of each file, and the logs in folders."""

from __future__ import annotations

import functools
import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from PIL import Image

from rovid.core import budget
from rovid.core.errors import ConfigError, LogError
from rovid.readers import READERS, find_logs, read_campaign, read_log
from rovid.trial.config import Config, load_config
from rovid.trial.trial import Campaign, Trial
from tests.conftest import ROOT, SAMPLES, Rovid
from tests.readers.logs import campaign, csv_text, dive, kinds, mcap_bytes, standard, toml, turning
from tests.readers.recordings import CHANGES, HEADING, RECORDINGS, TIME
from tests.readers.test_fuzz import EDITS, FUZZ, Edits, edited, survive
from tests.whole.test_bad_input import assert_one_message


def names(found: Campaign) -> list[str]:
    return [trial.name for trial in found.trials]


def said(found: Campaign) -> str:
    return " ".join(remark.text for remark in found.remarks)


def log(seed: int, rate: float = 8.0) -> str:
    time, heading = turning(seed=seed, rate=rate)
    return csv_text(standard(time_s=time, heading_deg=heading % 360.0))


def test_a_folder_in_the_order_of_names(tmp_path: Path, config: Config) -> None:
    for folder in ("b", "a/deep", ".hidden"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "b" / "x.csv").write_text(log(1))
    (tmp_path / "a" / "deep" / "y.CSV").write_text(log(2, rate=5.0))
    (tmp_path / "z.mcap").write_bytes(mcap_bytes(dive(300)))
    (tmp_path / ".hidden" / "h.csv").write_text("nonsense")
    (tmp_path / ".h.csv").write_text("nonsense")
    (tmp_path / "notes.txt").write_text("nonsense")
    found = read_campaign([tmp_path], config)
    assert names(found) == ["a/deep/y.CSV", "b/x.csv", "z.mcap"]
    assert found.remarks == ()
    assert found.sources == (tmp_path,)


TABLES = {
    "curve": "command,thrust_N\n0,0\n1,1\n",
    "steady": "command,yaw_rate_rad_s,torque_Nm\n1,0.1,42\n",
    "sine": "trial,period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s\na,40,100,0.1\n",
}


@pytest.mark.parametrize("table", TABLES)
def test_known_tables_are_no_logs(table: str, tmp_path: Path, config: Config) -> None:
    (tmp_path / "table.csv").write_text(TABLES[table])
    (tmp_path / "hold.csv").write_text(log(1))
    found = read_campaign([tmp_path], config)
    assert names(found) == ["hold.csv"]
    assert found.remarks == ()


@pytest.mark.parametrize("text", ["PWM (µs), Force\n1100,-4\n", "-4.9,-63.1\n-4.8,-57.3\n", "just a note\n"])
def test_tables_without_a_mapped_column_are_said(text: str, tmp_path: Path, config: Config) -> None:
    (tmp_path / "bench.csv").write_bytes(text.encode("latin-1"))
    (tmp_path / "hold.csv").write_text(log(1))
    found = read_campaign([tmp_path], config)
    assert names(found) == ["hold.csv"]
    assert [remark.kind for remark in found.remarks] == ["skipped"]
    assert "bench.csv was left out" in said(found)


@pytest.mark.parametrize("missing", ["time_s", "heading_deg", "fore_V"])
def test_a_log_that_lacks_one_column_is_an_error(missing: str, tmp_path: Path, config: Config) -> None:
    columns = standard()
    columns["other"] = columns.pop(missing)
    (tmp_path / "bad.csv").write_text(csv_text(columns))
    (tmp_path / "hold.csv").write_text(log(1))
    with pytest.raises(LogError, match=f"bad.csv: has no column '{missing}'"):
        read_campaign([tmp_path], config)


@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 10])
def test_a_file_that_cannot_be_looked_at_counts_as_a_log(content: bytes, tmp_path: Path, config: Config) -> None:
    (tmp_path / "bad.csv").write_bytes(content)
    (tmp_path / "hold.csv").write_text(log(1))
    found, _ = find_logs([tmp_path], config)
    assert [name for name, _ in found] == ["bad.csv", "hold.csv"]
    with pytest.raises(LogError, match=r"bad\.csv"):
        read_campaign([tmp_path], config)


def test_nothing_there(tmp_path: Path, config: Config) -> None:
    with pytest.raises(LogError, match=r"holds 1 table \(curve.csv\) but no log: none has .* maps \('fore_V', "):
        read_campaign([tmp_path], config)
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match=r"empty: holds no logs: no \.csv, \.mcap, "):
        read_campaign([tmp_path / "empty"], config)
    (tmp_path / "empty/run.xlsx").touch()
    with pytest.raises(LogError, match=r"It holds 1 \.xlsx\. Put the logs .* Export logs of another format as CSV"):
        read_campaign([tmp_path / "empty"], config)
    with pytest.raises(LogError, match=r"nowhere: there is no such file or folder"):
        read_campaign([tmp_path / "nowhere"], config)
    with pytest.raises(LogError, match="no column 'time_s'"):
        read_campaign([tmp_path / "curve.csv"], config)
    with pytest.raises(LogError, match=r"suffix '\.toml'"):
        read_campaign([tmp_path / "rovid.toml"], config)


def test_files_and_folders_together(tmp_path: Path, config: Config) -> None:
    for number, folder in enumerate(("mon", "tue")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "hold.csv").write_text(log(number, rate=5.0 + number))
        (tmp_path / folder / f"only_{folder}.csv").write_text(log(number, rate=9.0 + number))
    found = read_campaign([tmp_path / "mon", tmp_path / "tue", tmp_path / "mon" / "hold.csv"], config)
    assert sorted(Path(name).name for name in names(found)) == ["hold.csv", "hold.csv", "only_mon.csv", "only_tue.csv"]
    assert len(set(names(found))) == 4
    assert "the same file" in said(found)


def test_progress_is_told(tmp_path: Path, config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "_PROGRESS_INTERVAL", 0.0)
    (tmp_path / "a.csv").write_text(log(1))
    (tmp_path / "b.csv").write_text(log(2, rate=5.0))
    seen: list[str] = []
    read_campaign([tmp_path], config, seen.append)
    assert [words.partition(",")[0] for words in seen] == [
        "Reading the logs: log 1 of 2",
        "Reading the logs: log 2 of 2",
    ]


def test_unreadable_folder_entries_are_told(tmp_path: Path, config: Config) -> None:
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "hold.csv").write_text(log(1))
    (tmp_path / "gone.csv").symlink_to(tmp_path / "nowhere.csv")
    with pytest.raises(LogError, match=r"gone\.csv"):
        read_campaign([tmp_path], config)


def test_formats_mix(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml('supply = { csv = "supply_V" }'))
    (tmp_path / "a.csv").write_text(csv_text(standard(supply_V=np.full(400, 48.0))))
    (tmp_path / "b.mcap").write_bytes(mcap_bytes([(t, ns + 10**12, f) for t, ns, f in dive(700)]))
    found = read_campaign([tmp_path], config)
    assert [sorted(trial.extras) for trial in found.trials] == [["supply"], []]
    assert all(kinds(trial) == {} for trial in found.trials)


def test_readers_start_light() -> None:
    heavy = ["pandas", "mcap", "scipy", "numba", "rich"]
    code = "import sys, rovid.readers; print([m for m in sys.argv[1:] if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, *heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_when_each_trial_began_where_every_log_tells(tmp_path: Path, config: Config) -> None:
    """By the clock, whatever the names; parts of a trial begin later."""
    for name, hour in (("b.csv", 12), ("a.csv", 14)):
        begun = np.datetime64(f"2026-01-07T{hour}:00:00", "ms")
        time, heading = turning(seed=hour, rate=hour - 5.0)
        moments = [f"{moment}Z" for moment in begun + np.round(1000 * time).astype("timedelta64[ms]")]
        (tmp_path / name).write_text(csv_text(standard(time_s=moments, heading_deg=heading % 360.0)))
    second, first = read_campaign([tmp_path], config).trials
    assert (first.campaign_time, second.campaign_time) == pytest.approx((0.0, 7200.0))
    assert second.part(slice(100, None), "part").campaign_time == pytest.approx(7200.0 + second.time[100])


def test_where_no_log_tells_they_follow_each_other_by_name(tmp_path: Path, config: Config) -> None:
    for number in (1, 2, 3):
        (tmp_path / f"run_{number}.csv").write_text(log(number, rate=3.0 + number))
    trials = read_campaign([tmp_path], config).trials
    lengths = [trial.duration for trial in trials]
    assert [trial.campaign_time for trial in trials] == pytest.approx([0.0, lengths[0], lengths[0] + lengths[1]])


FORMATS = pytest.mark.parametrize("suffix", RECORDINGS)
# Without the second suffix of JSON lines: its reader and its content are the same.
DAMAGED = pytest.mark.parametrize("suffix", sorted(set(RECORDINGS) - {".ndjson"}))


@functools.cache
def recording(suffix: str) -> bytes:
    return RECORDINGS[suffix].write()


def configured(suffix: str, folder: Path) -> Config:
    one = RECORDINGS[suffix]
    folder.mkdir(exist_ok=True)
    for other, text in one.beside.items():
        for name in "ae":
            (folder / f"{name}{other}").write_text(text)
    return campaign(folder, toml(heading=one.heading, command=one.command))


def test_every_format_is_here_and_on_the_page() -> None:
    assert {suffix.lower() for suffix in RECORDINGS} == {
        suffix for suffix, form in READERS.items() if form.kind not in {"csv", "mcap"}
    }
    page = (ROOT / "docs" / "logs.md").read_text()
    assert all(f"| `{suffix}` |" in page for suffix in READERS)


@FORMATS
def test_the_run_is_the_same_in_each(suffix: str, tmp_path: Path) -> None:
    config = configured(suffix, tmp_path)
    (tmp_path / f"a{suffix}").write_bytes(recording(suffix))
    trial = read_log(tmp_path / f"a{suffix}", config)
    rows = np.searchsorted(trial.time, TIME + 1e-6) - 1  # a float holds seconds since 1970 to 0.2 us
    np.testing.assert_allclose(trial.time[rows], TIME, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(trial.position[rows]), HEADING, atol=RECORDINGS[suffix].tolerance)
    for at, value in CHANGES:  # a table knows of a change at its next row
        assert trial.commands[np.searchsorted(trial.time, at + 0.05) - 1, 0] == value
    assert trial.remarks == ()


def png() -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (40, 30)).save(out, "PNG")
    return out.getvalue()


FOREIGN = {
    "empty": b"",
    "random": np.random.default_rng(3).bytes(5000),
    "a picture": png(),
    "text": b"time_s,heading_deg\n0,1\n",
    "zeros": bytes(5000),
}


@DAMAGED
@pytest.mark.parametrize("content", FOREIGN)
def test_what_is_no_such_log_gets_one_message(suffix: str, content: str, tmp_path: Path, rovid: Rovid) -> None:
    config = configured(suffix, tmp_path / "logs")
    path = config.path.parent / f"a{suffix}"
    path.write_bytes(FOREIGN[content])
    done = rovid("fit-drag", path)
    assert done.code == 2
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith(f"rovid: {path}: {'is empty' if content == 'empty' else 'is not '}") or (
        content == "empty" and "is empty" in done.err
    ), done.err


@DAMAGED
@pytest.mark.parametrize("share", [0.001, 0.02, 0.3, 0.5, 0.9, 0.999])
def test_a_cut_log_is_read_or_refused(suffix: str, share: float, tmp_path: Path) -> None:
    config = configured(suffix, tmp_path)
    data = recording(suffix)
    (tmp_path / f"a{suffix}").write_bytes(data[: int(share * len(data))])
    try:
        trial = read_log(tmp_path / f"a{suffix}", config)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:  # a format without an end may be cut between two messages, and one with an index behind all of them
        assert kinds(trial).get("truncated", 0) > 0 or trial.time[-1] < TIME[-1] or share > 0.99


@pytest.mark.parametrize("suffix", sorted(set(RECORDINGS) - {".nmea"}))
def test_a_first_configuration_is_guessed_from_each(suffix: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / f"a{suffix}").write_bytes(recording(suffix))
    assert rovid("init", tmp_path).code == 0
    trial = read_log(tmp_path / f"a{suffix}", load_config(tmp_path / "rovid.toml"))
    assert np.rad2deg(trial.position[-1] - trial.position[0]) == pytest.approx(HEADING[-1] - HEADING[0], abs=1e-3)
    assert len(trial.commands.T) >= 1


@DAMAGED
@pytest.mark.parametrize("content", FOREIGN)
def test_nothing_is_guessed_from_what_is_no_such_log(suffix: str, content: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / f"a{suffix}").write_bytes(FOREIGN[content])
    assert_one_message(rovid("init", tmp_path), f"a{suffix}: is ")


@DAMAGED
@settings(FUZZ, max_examples=30)
@given(edits=EDITS)
def test_edited_logs_do_no_harm(suffix: str, edits: Edits, tmp_path: Path) -> None:
    path = tmp_path / f"e{suffix}"
    survive(path, edited(recording(suffix), edits), configured(suffix, tmp_path))


JOIN = 'parts = ["ins", "thr"]\n'
RUNS = ("hold_03", "hold_05", "sine_20s", "steps")
INS, THR = ["time_s", "heading_deg"], ["time_s", "fore_V", "aft_V"]


def day(folder: Path, *, split: str, late: float = 0.0, block: str = JOIN) -> Path:
    """Some logs of a day, one file a sensor; what commands is ``late`` by so many s by its own clock."""
    folder.mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_hidden" / name, folder)
    text = (folder / "rovid.toml").read_text(encoding="utf-8")
    (folder / "rovid.toml").write_text(f"{text}\n[join]\n{block}", encoding="utf-8")
    for run in RUNS:
        log = pd.read_csv(SAMPLES / "rosub_hidden" / f"{run}.csv")
        for part, columns in (("ins", INS), ("thr", THR)):
            own = log[columns].copy()
            if part == "thr":
                own = own.iloc[::2]
                own["time_s"] += late
            target = folder / split.format(run=run, part=part)
            target.parent.mkdir(exist_ok=True)
            own.to_csv(target, index=False)
    return folder


def trials(folder: Path) -> tuple[Trial, ...]:
    return read_campaign([folder], load_config(folder / "rovid.toml")).trials


@pytest.mark.parametrize("split", ["{run}_{part}.csv", "{run}/{part}.csv"])
def test_files_of_one_trial_are_read_as_one(split: str, tmp_path: Path) -> None:
    folder = day(tmp_path / "day", split=split)
    campaign = read_campaign([folder], load_config(folder / "rovid.toml"))
    assert len(campaign.trials) == len(RUNS)
    for trial in campaign.trials:
        assert np.ptp(trial.commands) > 0.0
        assert any(remark.kind == "joined" for remark in trial.remarks)


@pytest.mark.slow
def test_an_offset_that_is_given_brings_clocks_together(tmp_path: Path, rovid: Rovid) -> None:
    day(tmp_path / "apart", split="{run}_{part}.csv", late=0.6)
    day(tmp_path / "day", split="{run}_{part}.csv", late=0.6, block='parts = ["ins", "thr"]\noffset = { thr = -0.6 }\n')
    told = rovid("fit", "day", "--effect", "thruster_lag", "--json", "-p", "a.toml").document["parameters"]
    day(tmp_path / "plain", split="{run}_{part}.csv")
    plain = rovid("fit", "plain", "--effect", "thruster_lag", "--json", "-p", "c.toml").document
    lag = "thruster_lag.time_constant"
    assert told[lag]["value"] == pytest.approx(plain["parameters"][lag]["value"], abs=0.1)
    # Without the offset the vehicle seems to respond before its commands: no parameter is printed.
    refused = rovid("fit", "apart", "--effect", "thruster_lag", "--json", "-p", "b.toml")
    assert (refused.code, refused.out, Path("b.toml").exists()) == (2, "", False)
    offset = re.search(r"Put offset = \{ thr = (-[0-9.]+) \} into \[join\] of rovid.toml", refused.err)
    assert offset is not None
    assert float(offset[1]) == pytest.approx(-0.6, abs=0.1)


def test_a_clock_that_drifts_is_put_right(tmp_path: Path) -> None:
    block = JOIN + 'offset = { thr = -0.5, "steps_thr.csv" = 2.0 }\ndrift = { thr = -2000.0 }\n'
    plain = {trial.name: trial for trial in trials(day(tmp_path / "plain", split="{run}_{part}.csv"))}
    for trial in trials(day(tmp_path / "day", split="{run}_{part}.csv", block=block)):
        other = plain[trial.name]
        offset = 2.0 if trial.name == "steps_ins.csv" else -0.5
        since = other.time[1:][np.any(np.diff(other.commands, axis=0) != 0.0, axis=1)]
        moved = trial.time[1:][np.any(np.diff(trial.commands, axis=0) != 0.0, axis=1)]
        wanted = since * (1.0 - 2e-3) + offset
        # A trial begins when it is commanded; what fell out of it is not compared.
        begin = max(offset, 0.0)
        kept = wanted[(wanted > begin) & (wanted < begin + trial.duration)]
        assert len(kept) > 1
        assert np.abs(np.subtract.outer(kept - begin, moved)).min(axis=1).max() < 0.01
        (said,) = [remark.text for remark in trial.remarks if remark.kind == "clock"]
        assert f"{offset:+g} s" in said
        assert "-2000 ppm" in said


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("offset = { thruster = 0.5 }", "'thruster' is not known here"),
        ('offset = { "thr_1.csv" = "late" }', "[join] offset thr_1.csv"),
        ("drift = 3.0", "a table [drift] was expected"),
    ],
)
def test_a_clock_that_is_none_is_refused(block: str, said: str, tmp_path: Path) -> None:
    folder = day(tmp_path / "day", split="{run}_{part}.csv", block=f"{JOIN}{block}\n")
    with pytest.raises(ConfigError, match=re.escape(said)):
        load_config(folder / "rovid.toml")


def test_another_column_of_time_may_be_named(tmp_path: Path) -> None:
    block = 'parts = ["ins", "thr"]\ntime = { thr = { csv = "t_ms", unit = "ms" } }\n'
    folder = day(tmp_path / "day", split="{run}_{part}.csv", block=block)
    for path in folder.glob("*_thr.csv"):
        log = pd.read_csv(path)
        log["time_s"] *= 1000.0
        log.rename(columns={"time_s": "t_ms"}).to_csv(path, index=False)
    plain = trials(day(tmp_path / "plain", split="{run}_{part}.csv"))
    for trial, other in zip(trials(folder), plain, strict=True):
        assert trial.duration == pytest.approx(other.duration, abs=0.3)


def test_a_part_that_is_missing_is_named(tmp_path: Path) -> None:
    folder = day(tmp_path / "day", split="{run}_{part}.csv")
    (folder / "steps_thr.csv").unlink()
    wanted = (
        r"steps_ins\.csv: neither this nor the files joined with it hold 'fore_V', which rovid\.toml maps to command"
    )
    with pytest.raises(LogError, match=wanted):
        read_campaign([folder], load_config(folder / "rovid.toml"))
    misspelt = (folder / "rovid.toml").read_text().replace('"heading_deg"', '"headng_deg"')
    (folder / "rovid.toml").write_text(misspelt)
    with pytest.raises(
        LogError, match=r"hold 'headng_deg', which rovid\.toml maps to heading\. Nearest: 'heading_deg'"
    ):
        read_campaign([folder], load_config(folder / "rovid.toml"))


@pytest.mark.parametrize("split", ["{run}_{part}.csv", "{run}/{part}.csv"])
def test_init_sees_that_files_belong_together(split: str, tmp_path: Path, rovid: Rovid) -> None:
    folder = day(tmp_path / "day", split=split)
    (folder / "rovid.toml").unlink()
    for path in folder.rglob("*thr.csv"):
        pd.read_csv(path).rename(columns={"time_s": "t"}).to_csv(path, index=False)
    document = rovid("init", "day", "--json").document
    assert document["joined"] == ["ins", "thr"]
    assert {command["name"]: command["turns"] for command in document["commands"]["csv"]} == {"fore": 1, "aft": 1}
    checked = rovid("check", "day", "--json")
    assert not checked.document["unreadable"]


def test_a_fit_rests_on_every_file_of_a_trial_and_on_how_they_are_joined(tmp_path: Path, rovid: Rovid) -> None:
    folder = day(tmp_path / "day", split="{run}/{part}.csv")
    assert rovid("fit", "day").code == 0
    assert rovid("simulate").code == 0
    config, log = folder / "rovid.toml", folder / "hold_03" / "thr.csv"
    text = config.read_text(encoding="utf-8")
    config.write_text(text.replace('["ins", "thr"]', '["ins", "thr", "gps"]'), encoding="utf-8")
    assert "is out of date" in rovid("simulate").err
    config.write_text(text, encoding="utf-8")
    assert rovid("simulate").code == 0
    log.write_text(f"{log.read_text(encoding='utf-8')}900.0,0.0,0.0\n", encoding="utf-8")
    assert "is out of date" in rovid("simulate").err
