"""The fleet's results as a Parquet table, as JSON and on the terminal."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from rovid import __version__
from rovid.fleet.campaigns import CampaignRecord
from rovid.fleet.page import cause_changes, caution, headline
from rovid.fleet.results import Fleet, causes, guessed, outliers, verdict
from rovid.fleet.shrinkage import ShrunkParameter
from rovid.present.tables.table import ResultTable, text_column

SCHEMA = "rovid-fleet/1"
_Column = tuple[Any, list[Any], str]


@dataclass(frozen=True, kw_only=True)
class FleetOutput:
    """The results, the written files and the number of campaigns diagnosed in this run."""

    fleet: Fleet
    table: Path
    page: Path
    diagnosed_anew: int


def parquet_table(fleet: Fleet, means: Sequence[ShrunkParameter]) -> bytes:
    """One row a campaign as Parquet, reproducible to the byte: the time that a diagnosis took is not included."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    records = fleet.records
    text, number, texts = pa.string(), pa.float64(), pa.list_(pa.string())
    starts = [None if one.start is None else datetime.fromtimestamp(round(one.start, 6), UTC) for one in records]
    # Name -> type, values, unit.
    columns: dict[str, _Column] = {
        "campaign": (text, [record.campaign for record in records], ""),
        "vehicle": (text, [record.vehicle for record in records], ""),
        "start": (pa.timestamp("us", tz="UTC"), starts, ""),
        "verdict": (text, list(map(verdict, records)), ""),
        "findings": (texts, [causes(record, "findings") for record in records], ""),
        "suspects": (texts, [causes(record, "suspects") for record in records], ""),
        "guessed": (texts, list(map(guessed, records)), ""),
    }
    for name in fleet.parameters:
        values = [fleet.values[record.campaign].get(name) for record in records]
        columns |= _parameter_columns(name, values, fleet.units[name], number)
    for mean in means:
        values = [mean.values.get(record.campaign) for record in records]
        columns |= _parameter_columns(f"{mean.name}_shrunk", values, fleet.units[mean.name], number)
    columns["seconds"] = (number, [record.seconds for record in records], "s")
    columns["error"] = (text, [record.error for record in records], "")
    fields = [
        pa.field(name, kind, metadata={"unit": unit} if unit else None) for name, (kind, _, unit) in columns.items()
    ]
    metadata = json.dumps({"schema": SCHEMA, "rovid": __version__, "axis": fleet.axis})
    schema = pa.schema(fields, metadata={"rovid": metadata})
    arrays = [pa.array(values, kind) for kind, values, _ in columns.values()]
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), stream, compression="zstd")
    return stream.getvalue()


def _parameter_columns(name: str, values: Sequence[Any], unit: str, kind: Any) -> dict[str, _Column]:
    """Columns of the values and of their standard errors."""
    errors = [value.error if value is not None and math.isfinite(value.error) else None for value in values]
    return {
        name: (kind, [None if value is None else value.value for value in values], unit),
        f"{name}_standard_error": (kind, errors, unit),
    }


def fleet_document(output: FleetOutput) -> dict[str, Any]:
    """The document of `rovid fleet --json`."""
    fleet = output.fleet
    return {
        "schema": SCHEMA,
        "axis": fleet.axis,
        "table": str(output.table),
        "page": str(output.page),
        "diagnosed_anew": output.diagnosed_anew,
        "campaigns": list(map(_campaign_document, fleet.records)),
        "changes": list(cause_changes(fleet)),
        "outliers": [
            {"campaign": one.campaign, "parameter": one.name, "distance": one.distance} for one in outliers(fleet)
        ],
    }


def _campaign_document(record: CampaignRecord) -> dict[str, Any]:
    return {
        "campaign": record.campaign,
        "vehicle": record.vehicle,
        "verdict": verdict(record),
        "findings": causes(record, "findings"),
        "suspects": causes(record, "suspects"),
        "guessed": guessed(record),
        "took_seconds": record.took,
        "peak_memory_bytes": record.peak_memory,
        "error": record.error,
    }


def show_fleet(console: Console, output: FleetOutput) -> None:
    """Print one row a campaign, a summary line and the path of the page."""
    fleet = output.fleet
    rows = ResultTable("", *map(text_column, ("campaign", "vehicle", "verdict", "causes or error")))
    for record in fleet.records:
        found = record.error or ", ".join(causes(record, "findings")) or "–"
        words = (verdict(record) or "no diagnosis").replace("_", " ")
        rows.add_row(record.campaign, record.vehicle or "–", words, found)
    console.print(rows)
    console.print(headline(fleet))
    if warning := caution(fleet):
        console.print(warning, style="bold")
    console.print(str(output.page), highlight=False, soft_wrap=True)
