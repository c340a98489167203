"""The fleet as JSON, on the terminal and as a Parquet table."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from rovid.core.formatting import SafeConsole
from rovid.core.output_files import FLEET_TABLE, LOG
from rovid.fleet.campaigns import CampaignRecord
from rovid.fleet.results import Fleet, shrink
from rovid.fleet.run import FleetOutput, fleet_document, parquet_table, show_fleet
from tests.conftest import ROOT
from tests.fleet.conftest import Made, fleet_of


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


LOST = CampaignRecord(campaign="z", folder="", digest="", error="no logs", failure="input")


def test_a_wide_table_is_recognised(made: Made, tmp_path: Path) -> None:
    wide = {f"effect{k}.size": (1.0, 1.0) for k in range(150)}
    for fleet in (fleet_of(), fleet_of(LOST), fleet_of(made("a", wide))):
        (tmp_path / "a.parquet").write_bytes(parquet_table(fleet, ()))
        assert FLEET_TABLE.matches(tmp_path / "a.parquet")
        assert LOG.matches(tmp_path / "a.parquet")  # so the signature has to check more than the format
        pq.read_table(tmp_path / "a.parquet")
    frame = pd.DataFrame({"a": [1.0]})
    frame.to_parquet(tmp_path / "a.parquet")
    assert not FLEET_TABLE.matches(tmp_path / "a.parquet")


def test_empty_columns_have_types() -> None:
    table = pq.read_table(io.BytesIO(parquet_table(fleet_of(LOST), ())))
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds["start"] == "timestamp[us, tz=UTC]"
    assert kinds["findings"].startswith("list<")
    assert kinds["seconds"] == "double"
    assert table.to_pylist()[0]["error"] == "no logs"


def test_unknown_values_are_null(made: Made) -> None:
    fleet = fleet_of(made("a", {"inertia": (5.0, float("nan"))}), LOST)
    first, second = pq.read_table(io.BytesIO(parquet_table(fleet, ()))).to_pylist()
    assert (first["inertia"], first["inertia_standard_error"]) == (5.0, None)
    assert (second["inertia"], second["verdict"], second["findings"]) == (None, None, [])


def test_shrunk_values_have_columns_of_their_own(made: Made) -> None:
    fleet: Fleet = fleet_of(*(made(f"{k}", {"inertia": (100.0 + k, 5.0)}, vehicle=f"{k}") for k in range(5)), LOST)
    rows = pq.read_table(io.BytesIO(parquet_table(fleet, shrink(fleet)))).to_pylist()
    assert rows[4]["inertia"] == 104.0
    assert 100.0 < rows[4]["inertia_shrunk"] < 104.0
    assert rows[5]["inertia_shrunk"] is None
