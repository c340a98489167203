"""The table: one row a campaign, the same bytes for the same logs, on one core or many."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from rovid import __version__
from rovid.fleet.results import Fleet, causes, guessed, verdict
from rovid.fleet.shrinkage import ShrunkParameter

SCHEMA = "rovid-fleet/1"
_ERROR = "_standard_error"


def parquet_table(fleet: Fleet, means: Sequence[ShrunkParameter]) -> bytes:
    """The table as Parquet. How long a diagnosis took is not in it, for that is never the same twice."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    records = fleet.records
    text, number, texts = pa.string(), pa.float64(), pa.list_(pa.string())
    columns: dict[str, tuple[Any, list[Any], str]] = {
        "campaign": (text, [record.campaign for record in records], ""),
        "vehicle": (text, [record.vehicle for record in records], ""),
        "start": (pa.timestamp("us", tz="UTC"), [_instant(record.start) for record in records], ""),
        "verdict": (text, [verdict(record) for record in records], ""),
        "findings": (texts, [causes(record, "findings") for record in records], ""),
        "suspects": (texts, [causes(record, "suspects") for record in records], ""),
    }
    columns["guessed"] = (texts, [guessed(record) for record in records], "")
    for name in fleet.parameters:
        values = [fleet.values[record.campaign].get(name) for record in records]
        columns |= _pair(name, values, fleet.units[name], number)
    for one in means:
        values = [one.values.get(record.campaign) for record in records]
        columns |= _pair(f"{one.name}_shrunk", values, fleet.units[one.name], number)
    columns["seconds"] = (number, [record.seconds for record in records], "s")
    columns["error"] = (text, [record.error for record in records], "")
    fields = [
        pa.field(name, kind, metadata={"unit": unit} if unit else None) for name, (kind, _, unit) in columns.items()
    ]
    mark = json.dumps({"schema": SCHEMA, "rovid": __version__, "axis": fleet.axis})
    schema = pa.schema(fields, metadata={"rovid": mark})
    arrays = [pa.array(values, kind) for kind, values, _ in columns.values()]
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), stream, compression="zstd")
    return stream.getvalue()


def _pair(name: str, values: Sequence[Any], unit: str, kind: Any) -> dict[str, tuple[Any, list[Any], str]]:
    """Columns of a parameter and of its standard error."""
    return {
        name: (kind, [None if one is None else one.value for one in values], unit),
        f"{name}{_ERROR}": (kind, [None if one is None else _known(one.error) for one in values], unit),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _instant(start: float | None) -> datetime | None:
    return None if start is None else datetime.fromtimestamp(round(start, 6), UTC)
