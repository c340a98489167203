"""A fleet from the folders to its table and summary."""

from __future__ import annotations

import io
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest

from rovid.core.formatting import SafeConsole
from rovid.core.output_files import FLEET_TABLE, LOG
from rovid.fleet import campaigns
from rovid.fleet.campaigns import CampaignRecord
from rovid.fleet.results import Fleet, shrink
from rovid.fleet.run import FleetOutput, fleet_document, parquet_table, show_fleet
from tests.conftest import ROOT, Rovid, run_rovid
from tests.fleet.conftest import GOOD, Made, fleet_of


@pytest.fixture
def written(made: Made) -> FleetOutput:
    lost = CampaignRecord(
        campaign="beta/lost", folder="", digest="", error="no rovid.toml here. Run `rovid init LOGS`."
    )
    fleet = fleet_of(
        made("alpha", {"inertia": (1.0, 0.1)}, vehicle="A long name of a vehicle", causes=("thruster_lag",)), lost
    )
    return FleetOutput(fleet=fleet, table=Path("out/fleet.parquet"), page=Path("out/index.html"), diagnosed_anew=1)


@pytest.mark.parametrize("width", [60, 80, 120])
def test_the_terminal_table_fits_and_is_complete(written: FleetOutput, width: int) -> None:
    screen = SafeConsole(width=width, record=True, force_terminal=False)
    with screen.capture() as capture:
        show_fleet(screen, written)
    text = capture.get()
    assert max(map(len, text.splitlines())) <= width
    for words in ("alpha", "found", "thruster_lag", "beta/lost", "out/index.html", "2 campaigns of 1 vehicle"):
        assert words in text
    assert "no rovid.toml here" in " ".join(text.split()) or "rovid.toml" in text


def test_the_document_has_every_campaign(written: FleetOutput) -> None:
    document = fleet_document(written)
    assert document["schema"] == "rovid-fleet/1"
    assert [one["campaign"] for one in document["campaigns"]] == ["alpha", "beta/lost"]
    assert document["campaigns"][0]["findings"] == ["thruster_lag"]
    assert document["campaigns"][1]["error"].startswith("no rovid.toml")
    section = (
        (ROOT / "docs/files.md").read_text(encoding="utf-8").partition("### `rovid-fleet/1`")[2].partition("\n### ")[0]
    )
    told = set(re.findall(r"`(\w+)`", section))
    assert set(document) - {"schema"} <= told
    assert set(document["campaigns"][0]) <= told
    assert document["changes"] == document["outliers"] == []


FAILED = CampaignRecord(campaign="z", folder="", digest="", error="no logs", failure="input")


def test_a_wide_table_is_recognised(made: Made, tmp_path: Path) -> None:
    wide = {f"effect{k}.size": (1.0, 1.0) for k in range(150)}
    for fleet in (fleet_of(), fleet_of(FAILED), fleet_of(made("a", wide))):
        (tmp_path / "a.parquet").write_bytes(parquet_table(fleet, ()))
        assert FLEET_TABLE.matches(tmp_path / "a.parquet")
        assert LOG.matches(tmp_path / "a.parquet")  # so the signature has to check more than the format
        pq.read_table(tmp_path / "a.parquet")
    frame = pd.DataFrame({"a": [1.0]})
    frame.to_parquet(tmp_path / "a.parquet")
    assert not FLEET_TABLE.matches(tmp_path / "a.parquet")


def test_empty_columns_have_types() -> None:
    table = pq.read_table(io.BytesIO(parquet_table(fleet_of(FAILED), ())))
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds["start"] == "timestamp[us, tz=UTC]"
    assert kinds["findings"].startswith("list<")
    assert kinds["seconds"] == "double"
    assert table.to_pylist()[0]["error"] == "no logs"


def test_unknown_values_are_null(made: Made) -> None:
    fleet = fleet_of(made("a", {"inertia": (5.0, float("nan"))}), FAILED)
    first, second = pq.read_table(io.BytesIO(parquet_table(fleet, ()))).to_pylist()
    assert (first["inertia"], first["inertia_standard_error"]) == (5.0, None)
    assert (second["inertia"], second["verdict"], second["findings"]) == (None, None, [])


def test_shrunk_values_have_columns_of_their_own(made: Made) -> None:
    fleet: Fleet = fleet_of(*(made(f"{k}", {"inertia": (100.0 + k, 5.0)}, vehicle=f"{k}") for k in range(5)), FAILED)
    rows = pq.read_table(io.BytesIO(parquet_table(fleet, shrink(fleet)))).to_pylist()
    assert rows[4]["inertia"] == 104.0
    assert 100.0 < rows[4]["inertia_shrunk"] < 104.0
    assert rows[5]["inertia_shrunk"] is None


LOST = "lost & found"
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""
# Fates of three processes, by campaign.
DYING = """
import json, os, sys, time
name = json.loads(sys.argv[1])["name"]
if name == "alpha/summer": os.kill(os.getpid(), 9)
if name == "spring": time.sleep(600)
if name == "beta/summer": os._exit(3)
"""
REPORT = '<meta name="generator" content="rovid 0.2.0">\n'
NAMES = ["alpha/summer", "beta/summer", LOST, "spring"]


@pytest.fixture(scope="module")
def done(sea: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The fleet, diagnosed by two processes at a time; tests do not write there."""
    out = tmp_path_factory.mktemp("done") / "out"
    return out, run_rovid("fleet", sea, "-o", out, "--jobs", 2, "--json").document


def command(sea: Path, out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "rovid", "fleet", str(sea), "-o", str(out), *more]


def rows(out: Path) -> pd.DataFrame:
    return pd.read_parquet(out / "fleet.parquet").set_index("campaign")


def without(done: Path, out: Path, *names: str) -> Path:
    """A copy of the output without some campaigns, the table and the page."""
    shutil.copytree(done, out)
    for name in ("fleet.parquet", "index.html", *(f"campaigns/{name}.json" for name in names)):
        (out / name).unlink()
    return out


def test_each_campaign_has_its_row(done: tuple[Path, dict[str, Any]]) -> None:
    out, document = done
    table = rows(out)
    assert list(table.index) == NAMES == [one["campaign"] for one in document["campaigns"]]
    good = table[table["error"].isna()]
    assert len(good) == len(GOOD)
    assert list(good["vehicle"]) == ["Älpha", "Beta", "Älpha"]
    assert [list(each) for each in good["findings"]] == [["thruster_lag"], [], []]
    assert (good["seconds"] > 200.0).all()
    assert good["start"].notna().all()
    # 5 January 2026, when the first run with a clock began.
    assert {f"{start:%Y-%m-%d}" for start in good["start"]} == {"2026-01-05"}
    deviation = (good["inertia"] - 5057.0) / good["inertia_standard_error"]
    assert deviation.abs().max() < 4.0
    assert table["thruster_lag.time_constant"].notna().sum() == 1
    lost = table.loc[LOST]
    assert "no rovid.toml" in lost["error"]
    assert lost[["vehicle", "verdict", "inertia", "seconds"]].isna().all()


def test_the_columns_have_units(done: tuple[Path, dict[str, Any]]) -> None:
    schema = pq.read_schema(done[0] / "fleet.parquet")
    assert schema.field("inertia").metadata == {b"unit": b"kg m^2"}
    assert schema.field("thruster_lag.time_constant_standard_error").metadata == {b"unit": b"s"}
    assert [name for name in schema.names if name in {"campaign", "vehicle", "start", "verdict", "findings"}] == [
        "campaign", "vehicle", "start", "verdict", "findings",
    ]  # fmt: skip
    assert schema.names[-2:] == ["seconds", "error"]


@pytest.mark.slow
def test_each_diagnosis_is_written_completely(done: tuple[Path, dict[str, Any]], sea: Path, rovid: Rovid) -> None:
    kept = json.loads((done[0] / "campaigns" / "spring.json").read_text())
    assert kept["schema"] == "rovid-campaign/1"
    alone = rovid("diagnose", sea / "alpha/spring", "--json").document
    # A fleet has more time for each campaign, and each run takes another time.
    assert (kept["diagnosis"].pop("budget")["not_tried"], alone.pop("budget")["not_tried"]) == ([], [])
    assert kept["diagnosis"] == alone


def test_valid_results_are_not_repeated(done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(done[0], out)
    again = run_rovid("fleet", sea, "-o", out, "--json").document
    assert again["diagnosed_anew"] == 0
    for name in ("fleet.parquet", "index.html"):
        assert (out / name).read_bytes() == (done[0] / name).read_bytes()
    # The same folder has another name, because its neighbour is not given.
    alone_now = run_rovid("fleet", sea / "alpha", "-o", out, "--json").document
    assert alone_now["diagnosed_anew"] == 0
    assert [one["campaign"] for one in alone_now["campaigns"]] == ["spring", "summer"]
    assert json.loads((out / "campaigns/summer.json").read_text())["campaign"] == "summer"


def test_swapped_names_need_no_new_diagnosis(done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path) -> None:
    shutil.copytree(sea, tmp_path / "sea")
    out = shutil.copytree(done[0], tmp_path / "out")
    spring, summer, aside = (tmp_path / "sea/alpha" / name for name in ("spring", "summer", "aside"))
    for old, new in ((spring, aside), (summer, spring), (aside, summer)):
        old.rename(new)
    again = run_rovid("fleet", tmp_path / "sea", "-o", out, "--json").document
    assert again["diagnosed_anew"] == 0
    was, now = rows(done[0]), rows(out)
    for one, other in (("spring", "alpha/summer"), ("alpha/summer", "spring"), ("beta/summer", "beta/summer")):
        assert repr(now.loc[one].to_dict()) == repr(was.loc[other].to_dict())


def test_changed_logs_are_diagnosed_again(
    done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(sea, tmp_path / "sea")
    shutil.copytree(done[0], tmp_path / "out")
    log = tmp_path / "sea/alpha/spring/down.csv"
    log.write_text("\n".join(log.read_text().splitlines()[:-100]) + "\n")
    # New diagnoses fail, which is quick; valid results stay.
    monkeypatch.setattr(campaigns, "_CODE", "raise SystemExit('once more')")
    document = run_rovid("fleet", tmp_path / "sea", "-o", tmp_path / "out", "--json").document
    assert document["diagnosed_anew"] == 1
    errors = {one["campaign"]: one["error"] for one in document["campaigns"] if one["error"]}
    assert errors["spring"] == "its process ended with status 1: once more"
    assert set(errors) == {"spring", LOST}


@pytest.mark.slow
def test_a_killed_run_continues_to_the_same_bytes(done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path) -> None:
    out = without(done[0], tmp_path / "out", "beta/summer", "spring")
    kept = out / "campaigns"
    with subprocess.Popen(command(sea, out, "--jobs", "1"), cwd=ROOT, stdout=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 100.0
        while not (kept / "beta/summer.json").exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    before = {path: path.read_bytes() for path in kept.rglob("*.json")}
    assert len(before) == len(NAMES) - 1
    assert not (out / "fleet.parquet").exists()
    document = run_rovid("fleet", sea, "-o", out, "--jobs", 1, "--json").document
    assert document["diagnosed_anew"] == 1
    assert {path: path.read_bytes() for path in before} == before
    assert (out / "fleet.parquet").read_bytes() == (done[0] / "fleet.parquet").read_bytes()
    assert (out / "index.html").read_bytes() == (done[0] / "index.html").read_bytes()


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path) -> None:
    out = without(done[0], tmp_path / "out", LOST, "spring")
    with subprocess.Popen(
        [sys.executable, "-c", CLUSTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as cluster:
        assert cluster.stdout is not None
        address = cluster.stdout.readline().strip()
        ran = subprocess.run(
            command(sea, out, "--cluster", address), cwd=ROOT, capture_output=True, text=True, check=False
        )
    assert ran.returncode == 0, ran.stderr
    assert (out / "fleet.parquet").read_bytes() == (done[0] / "fleet.parquet").read_bytes()
    assert (out / "index.html").read_bytes() == (done[0] / "index.html").read_bytes()


@pytest.mark.slow
def test_a_crash_or_timeout_affects_only_its_row(sea: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaigns, "_CODE", DYING + campaigns._CODE)  # noqa: SLF001 - what the process runs
    out = tmp_path / "out"
    fleet = (sea / "alpha", sea / "beta/summer")
    document = run_rovid("fleet", *fleet, "-o", out, "--timeout", 4, "--json").document
    errors = {one["campaign"]: one["error"] for one in document["campaigns"]}
    assert errors["alpha/summer"] == "its process was ended by SIGKILL."
    assert errors["spring"] == "no diagnosis within 4 s. Increase the limit with --timeout."
    assert errors["beta/summer"] == "its process ended with status 3"
    # Killed processes are tried again; timeouts only with a longer limit.
    monkeypatch.setattr(campaigns, "_CODE", "raise SystemExit('tried')")
    for seconds, tried in ((3, {"alpha/summer", "beta/summer"}), (30, {"alpha/summer", "beta/summer", "spring"})):
        document = run_rovid("fleet", *fleet, "-o", out, "--timeout", seconds, "--json").document
        assert {one["campaign"] for one in document["campaigns"] if "tried" in one["error"]} == tried


def test_memory_is_released_between_campaigns(done: tuple[Path, dict[str, Any]]) -> None:
    peaks = [one["peak_memory_bytes"] for one in done[1]["campaigns"] if one["error"] is None]
    # Each campaign starts in a fresh process.
    assert len(peaks) == len(GOOD)
    assert max(peaks) < 1.3 * min(peaks)


def test_a_missing_folder_has_an_error_in_its_row(done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path) -> None:
    shutil.copytree(done[0], tmp_path / "out")
    document = run_rovid("fleet", sea, tmp_path / "gone", "-o", tmp_path / "out", "--json").document
    error = {one["campaign"]: one["error"] for one in document["campaigns"]}["gone"]
    assert error is not None
    assert "there is no such file or folder" in error


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("gone", "-o", "out"), "gone: there is no such folder"),
        (("sea", "-o", "sea/alpha/spring/out"), "lies in the campaign"),
        (("sea", "-o", "out", "--cluster", "tcp://127.0.0.1:9"), "there is no Dask scheduler"),
        (("sea", "-o", "taken"), "is not a table of rovid fleet"),
        (("sea", "-o", "reported"), "is not a page of rovid fleet"),
    ],
)
def test_user_errors_give_one_line(
    arguments: tuple[str, ...], said: str, sea: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rovid.fleet.run._CONNECT_TIMEOUT", 0.5)
    (here / "sea").symlink_to(sea)
    for name, text in (("taken/fleet.parquet", "PAR1 of somebody"), ("reported/index.html", REPORT)):
        (here / name).parent.mkdir()
        (here / name).write_text(text)
    ended = run_rovid("fleet", *arguments)
    assert ended.code == 2
    assert said in ended.err
    assert "Traceback" not in ended.err
    assert (here / "taken/fleet.parquet").read_text() == "PAR1 of somebody"
    assert (here / "reported/index.html").read_text() == REPORT


@pytest.mark.slow
def test_a_missing_library_is_named_with_the_extra_that_has_it(sea: Path, tmp_path: Path) -> None:
    code = "import sys; sys.modules['pyarrow'] = None; from rovid.cli.cli import main; main()"
    ended = subprocess.run(
        [sys.executable, "-c", code, "fleet", sea, "-o", tmp_path / "out"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert "needs the package pyarrow. Install it with `pip install 'rovid[fleet]'`." in ended.stderr


def test_hierarchical_means_are_optional(done: tuple[Path, dict[str, Any]], sea: Path, tmp_path: Path) -> None:
    shutil.copytree(done[0], tmp_path / "out")
    shutil.copytree(sea / "beta/summer", tmp_path / "gamma")
    document = run_rovid("fleet", sea, tmp_path / "gamma", "-o", tmp_path / "out", "--shrink", "--json").document
    assert document["diagnosed_anew"] == 0  # equal logs are recognised by their digest
    table = rows(tmp_path / "out")
    assert (table["inertia_shrunk_standard_error"] < 1.2 * table["inertia_standard_error"]).sum() == 4
    assert "inertia_shrunk" not in rows(done[0]).columns
