"""The table's bytes and types, of fleets that were made up."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq

from rovid.core.signatures import FLEET_TABLE, LOG
from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.output import parquet_table
from rovid.fleet.results import Fleet
from rovid.fleet.shrinkage import shrink
from tests.fleet.conftest import Made, fleet_of

LOST = CampaignRecord(campaign="z", folder="", digest="", error="no logs", failure="input")


def test_it_is_known_again_by_its_end_however_wide_it_is(made: Made, tmp_path: Path) -> None:
    wide = {f"effect{k}.size": (1.0, 1.0) for k in range(150)}
    for fleet in (fleet_of(), fleet_of(LOST), fleet_of(made("a", wide))):
        (tmp_path / "a.parquet").write_bytes(parquet_table(fleet, ()))
        assert FLEET_TABLE.matches(tmp_path / "a.parquet")
        assert LOG.matches(tmp_path / "a.parquet")  # which is why its form says more than Parquet
        pq.read_table(tmp_path / "a.parquet")
    frame = pd.DataFrame({"a": [1.0]})
    frame.to_parquet(tmp_path / "a.parquet")
    assert not FLEET_TABLE.matches(tmp_path / "a.parquet")


def test_columns_are_typed_though_all_of_them_are_empty() -> None:
    table = pq.read_table(io.BytesIO(parquet_table(fleet_of(LOST), ())))
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds["start"] == "timestamp[us, tz=UTC]"
    assert kinds["findings"].startswith("list<")
    assert kinds["seconds"] == "double"
    assert table.to_pylist()[0]["error"] == "no logs"


def test_what_is_unknown_is_null(made: Made) -> None:
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
