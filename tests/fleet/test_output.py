"""What a fleet says at a terminal and in JSON."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rovid.core.console import SafeConsole
from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.output import FleetOutput, fleet_document, show_fleet
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
def test_the_table_fits_and_nothing_is_left_out(written: FleetOutput, width: int) -> None:
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
