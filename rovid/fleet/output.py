"""What a fleet came to, as JSON and at a terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.page import caution, headline, summary
from rovid.fleet.results import causes, guessed, verdict
from rovid.fleet.run import FleetOutput
from rovid.fleet.table import SCHEMA
from rovid.present.terminal.table import table


def fleet_document(written: FleetOutput) -> dict[str, Any]:
    """What `rovid fleet --json` prints."""
    fleet = written.fleet
    return {
        "schema": SCHEMA,
        "axis": fleet.axis,
        "table": str(written.table),
        "page": str(written.page),
        "diagnosed_anew": written.diagnosed_anew,
        "campaigns": [_campaign(record) for record in fleet.records],
        **summary(fleet),
    }


def _campaign(record: CampaignRecord) -> dict[str, Any]:
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


def show_fleet(console: Console, written: FleetOutput) -> None:
    """A row a campaign, then in a line what they came to, and where the page is."""
    fleet = written.fleet
    rows = table("", "campaign", "vehicle", "verdict", "causes, or what went wrong", left=4)
    for record in fleet.records:
        why = record.error or ", ".join(causes(record, "findings")) or "–"
        rows.add_row(record.campaign, record.vehicle or "–", (verdict(record) or "no diagnosis").replace("_", " "), why)
    console.print(rows)
    console.print(headline(fleet))
    if said := caution(fleet):
        console.print(said, style="bold")
    console.print(str(written.page), highlight=False, soft_wrap=True)
